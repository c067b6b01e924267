//! The capture station as a library: its stages, its sources, its recordings and its service.

#[cfg(test)]
mod bar;
pub mod cli;
pub mod client;
pub mod config;
pub mod daemon;
pub mod devices;
pub mod doctor;
pub mod exchange;
pub mod explain;
mod feed;
pub mod frame;
mod frames;
mod keeper;
pub mod logging;
mod mistake;
pub mod note;
pub mod pipeline;
pub mod preview;
pub mod quality;
pub mod record;
mod recorder;
pub mod recording;
mod recurring;
mod region;
pub mod replay;
mod service;
pub mod session;
pub mod source;
pub mod stages;
pub mod station;
pub mod store;
pub mod synth;
pub mod visitor;
