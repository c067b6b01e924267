//! A frame as the recorder has it, and what makes frames part of one recording.

use std::sync::Arc;

use crate::frame::{CameraModel, DepthFrame};
use crate::note::Note;

/// A frame that the session takes, and what it was told before.
#[derive(Clone, Debug)]
pub(crate) struct Shot {
    /// What the session was told since the frame before.
    pub(crate) notes: Vec<Note>,
    /// What a session may begin with at this frame; `None` while a hold runs.
    pub(crate) begins: Option<Note>,
    /// The frame.
    pub(crate) frame: Arc<DepthFrame>,
}

/// What is the same for all frames of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Shape {
    width: usize,
    height: usize,
    depth_unit_m: f64,
    camera: CameraModel,
}

impl Shape {
    /// That of a frame.
    pub(crate) fn of(frame: &DepthFrame) -> Self {
        let DepthFrame { width, height, depth_unit_m, camera, .. } = *frame;
        Self { width, height, depth_unit_m, camera }
    }

    /// A frame like those, with other pixels and another time.
    pub(super) fn frame(&self, depth: Vec<u16>, timestamp_ns: u64) -> DepthFrame {
        let Self { width, height, depth_unit_m, camera } = *self;
        DepthFrame { width, height, depth, depth_unit_m, timestamp_ns, camera }
    }
}
