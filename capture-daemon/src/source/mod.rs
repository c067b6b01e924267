//! Where frames come from. Replay and hardware differ in this trait alone.

pub(crate) mod access;
mod clock;
pub mod faulty;
pub mod host;
pub mod listed;
pub mod openni2;
pub mod pixels;
pub mod profile;
pub mod synthetic;
#[cfg_attr(not(feature = "v4l2"), expect(dead_code, reason = "V4L2 alone wants all of it"))]
mod usb;
#[cfg(feature = "v4l2")]
mod v4l2;

use std::sync::Arc;

use self::host::Health;
use crate::frame::DepthFrame;
use crate::note::Note;

/// A sensor or a recording. Blocking.
pub trait FrameSource {
    /// What it is, for logs and status lines: a path, a model and serial.
    fn describe(&self) -> String;

    /// How a live sensor fares; `None` for what is played at one's own pace.
    fn health(&self) -> Option<Arc<Health>> {
        None
    }

    /// The next frame.
    ///
    /// # Errors
    /// [`SourceError::End`] after the last frame; [`SourceError::BadFrame`] for one that is skipped and
    /// [`SourceError::Interrupted`] while a sensor is started again (the next call goes on after it);
    /// [`SourceError::Told`] where a recording says what the session was told before its next frame; all others end
    /// the source.
    fn next_frame(&mut self) -> Result<DepthFrame, SourceError>;
}

/// Why there is no frame.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SourceError {
    /// The recording is over.
    #[error("the recording is over")]
    End,
    /// One frame cannot be used.
    #[error("{0}")]
    BadFrame(String),
    /// The session was told something before the next frame.
    #[error("the session was told something")]
    Told(Note),
    /// A sensor gives no frames at present; it is tried again.
    #[error("{0}")]
    Interrupted(String),
    /// Nothing more can be read.
    #[error("{0}")]
    Failed(String),
}
