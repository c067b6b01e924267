//! The synthetic sensor: a clip of `synth`, without a file between.

use super::{FrameSource, SourceError};
use crate::frame::DepthFrame;
use crate::synth::Clip;

/// Plays a clip once.
pub struct SyntheticSource {
    clip: Clip,
    next: usize,
}

impl SyntheticSource {
    /// A source that starts at the clip's first frame.
    pub fn new(clip: Clip) -> Self {
        Self { clip, next: 0 }
    }
}

impl FrameSource for SyntheticSource {
    fn describe(&self) -> String {
        let scene = self.clip.scene();
        format!("synthetic sensor, {} {}", scene.family.name(), scene.seed)
    }

    fn next_frame(&mut self) -> Result<DepthFrame, SourceError> {
        if self.next >= self.clip.params().frames {
            return Err(SourceError::End);
        }
        self.next += 1;
        Ok(self.clip.frame(self.next - 1))
    }
}
