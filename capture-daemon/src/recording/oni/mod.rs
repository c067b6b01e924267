//! OpenNI2's own recordings, `.oni`, played by the real library in a process of its own: a file that makes it crash or
//! hang is refused like any other. One that was cut off is read to its last whole frame.
//!
//! Each frame comes once, as fast as frames are taken. They have the times of the file, which counts from the start of
//! the recording: the first instant is [`START_NS`](super::START_NS). Intrinsics are by the angles that the file says
//! the camera sees, unless the configuration gives others; what was recorded mirrored is turned back.

mod mend;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tempfile::TempPath;

use self::mend::State;

use super::{Contents, Distortion, OpenError, OpenOptions, Recording, ensure_one_frame, not_a_recording};
use crate::frame::{CameraModel, DepthFrame};
use crate::source::host::{self, Message, Order, Process, ReceiveError, Task};
use crate::source::{FrameSource, SourceError};

/// What such a file begins with.
pub(super) const MAGIC: &[u8] = b"NI10";
/// How long the library may take for a frame.
const DEADLINE: Duration = Duration::from_secs(20);

/// Opens a recording.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Recording, OpenError> {
    let failed = |reason: String| OpenError::OpenNi { path: path.to_owned(), reason };
    // The process may run in another folder one day.
    let absolute =
        std::path::absolute(path).map_err(|source| OpenError::Io { path: path.to_owned(), source })?;
    let camera = options.camera.as_ref().map(|given| &given.camera);
    let state = mend::state(path).map_err(|source| OpenError::Io { path: path.to_owned(), source })?;
    let (mended, frames) = match state {
        State::Whole => (None, None),
        State::CutOff { frames, copy } => {
            tracing::warn!(frames, "{}: was cut off; what is whole is read", path.display());
            (copy, Some(frames))
        }
        State::Hopeless => {
            return Err(not_a_recording(path, "a recording of OpenNI2 cut off before its first frame"));
        }
    };
    let order = Order {
        task: Task::Play { path: mended.as_ref().map_or(absolute, |copy| copy.to_path_buf()), frames },
        camera: camera.map(|CameraModel { fx, fy, cx, cy }| [*fx, *fy, *cx, *cy]),
        sensor: options.sensor.clone(),
    };
    let process =
        host::start(options.program.as_deref(), &order).map_err(|error| failed(error.to_string()))?;
    let mut source = OniSource {
        path: path.to_owned(),
        mode: String::new(),
        process: Some(process),
        _mended: mended,
        ahead: VecDeque::new(),
        end: SourceError::End,
    };
    match source.receive() {
        Ok(Message::Opened(mode)) => source.mode = mode,
        Ok(Message::Failed(reason)) => return Err(failed(reason)),
        Ok(_) => return Err(failed("OpenNI2 plays it before it is open".to_owned())),
        Err(reason) => return Err(failed(reason)),
    }
    let mut ahead = Ahead { source: &mut source, given: VecDeque::new() };
    ensure_one_frame(path, &mut ahead)?;
    let given = ahead.given;
    source.ahead = given;
    let distortion = Distortion::default();
    let contents = Contents { format: "oni", image_topic: None, distortion, parts: Vec::new() };
    Ok(Recording { contents, source: Box::new(source) })
}

/// Keeps what is given of a source.
struct Ahead<'s> {
    source: &'s mut OniSource,
    given: VecDeque<Result<DepthFrame, SourceError>>,
}

impl FrameSource for Ahead<'_> {
    fn describe(&self) -> String {
        self.source.describe()
    }

    fn next_frame(&mut self) -> Result<DepthFrame, SourceError> {
        let given = self.source.next_frame();
        self.given.push_back(given.clone());
        given
    }
}

/// A recording that OpenNI2 plays.
struct OniSource {
    path: PathBuf,
    /// Columns, rows, rate and unit, as the file says.
    mode: String,
    /// None once it is over.
    process: Option<Process>,
    /// What is played in its place.
    _mended: Option<TempPath>,
    /// What was read to see whether there is a frame.
    ahead: VecDeque<Result<DepthFrame, SourceError>>,
    /// How it ended.
    end: SourceError,
}

impl OniSource {
    fn receive(&mut self) -> Result<Message, String> {
        let Some(process) = &mut self.process else { return Ok(Message::End) };
        process.receive(DEADLINE).map_err(|error| match error {
            ReceiveError::Silent => format!("OpenNI2 gives no frame within {} s", DEADLINE.as_secs()),
            error => format!("OpenNI2 cannot play it: {error}"),
        })
    }

    fn finish(&mut self, end: SourceError) -> SourceError {
        self.process = None;
        self.end = end.clone();
        end
    }
}

impl FrameSource for OniSource {
    fn describe(&self) -> String {
        format!("{}, {}", self.path.display(), self.mode)
    }

    fn next_frame(&mut self) -> Result<DepthFrame, SourceError> {
        if let Some(given) = self.ahead.pop_front() {
            return given;
        }
        if self.process.is_none() {
            return Err(self.end.clone());
        }
        loop {
            return match self.receive() {
                Ok(Message::Frame(frame)) => Ok(frame),
                Ok(Message::Bad(reason)) => {
                    Err(SourceError::BadFrame(format!("{}: {reason}", self.path.display())))
                }
                Ok(Message::End) => Err(self.finish(SourceError::End)),
                Ok(Message::Failed(reason)) | Err(reason) => {
                    let reason = format!("{}: {reason}", self.path.display());
                    Err(self.finish(SourceError::Failed(reason)))
                }
                Ok(_) => continue,
            };
        }
    }
}
