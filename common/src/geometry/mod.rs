//! Curves as the rest of the project needs them.

pub mod distance;
pub mod polyline;
pub mod smooth;
