//! The capture station as a library: its stages, its sources, its recordings and its service.

pub mod frame;
pub mod recording;
pub mod source;
pub mod synth;
