//! What the stages make of scenes that are painted by hand.

mod painter;
mod plants;
mod refusals;
mod roots;
