//! The capture station as a library: its stages, its sources, its recordings and its service.

pub mod frame;
pub mod pipeline;
pub mod source;
pub mod stages;
pub mod station;
