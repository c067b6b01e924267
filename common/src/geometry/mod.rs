//! Curves as the rest of the project needs them.

pub mod distance;
pub mod fit;
pub mod polyline;
pub mod smooth;
