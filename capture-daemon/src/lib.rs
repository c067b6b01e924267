//! The capture station as a library: its stages, its sources, its recordings and its service.

pub mod cli;
pub mod config;
mod control;
pub mod daemon;
pub mod exchange;
pub mod explain;
pub mod frame;
pub mod pipeline;
pub mod recording;
pub mod replay;
pub mod session;
pub mod source;
pub mod stages;
pub mod station;
pub mod synth;
