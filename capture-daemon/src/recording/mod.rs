//! Recordings: MCAP files with ROS 2 messages, and folders of 16-bit PNGs.

mod cdr;
mod mcap;
mod png_sequence;
mod ros2;

use std::fs::{self, File};
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

pub use self::cdr::CdrError;
pub use self::mcap::{CAMERA_INFO_TOPIC, IMAGE_TOPIC, McapWriter, RecordingParams};
pub use self::png_sequence::PngWriter;
pub use self::ros2::{FLOAT_DEPTH_UNIT_M, MessageError};
use crate::frame::CameraModel;
use crate::source::{FrameSource, SourceError};

/// When the first frame of a folder of PNGs was taken, which does not say so itself: nanoseconds
/// since 1970, in November 2023. Synthetic clips begin then too.
pub const START_NS: u64 = 1_700_000_000_000_000_000;

/// What a recording leaves open.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// Intrinsics of a recording that has none.
    pub camera: Option<CameraModel>,
    /// Topic of the depth images, among several.
    pub topic: Option<String>,
}

/// Why a recording cannot be replayed: it is missing, or not one frame of it can be read.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Nothing is there.
    #[error(
        "{path}: there is no such file or folder; expected a recording, an MCAP file or a folder of 16-bit PNGs with camera.toml"
    )]
    Missing {
        /// Where.
        path: PathBuf,
    },
    /// The system refuses to read it.
    #[error("{path}: cannot be read ({source}); check the file and its permissions")]
    Io {
        /// Where.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Something else.
    #[error(
        "{path}: is not a recording but {found}; expected an MCAP file or a folder of 16-bit PNGs with camera.toml"
    )]
    NotARecording {
        /// Where.
        path: PathBuf,
        /// What is there.
        found: String,
    },
    /// A recording of a kind that is not read.
    #[error("{path}: is {found}, which is not read; {remedy}")]
    Unsupported {
        /// Where.
        path: PathBuf,
        /// What is there.
        found: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// No topic with depth images.
    #[error(
        "{path}: has no depth images: {found}; expected sensor_msgs/msg/Image messages with encoding 16UC1, mono16 or 32FC1"
    )]
    NoDepthTopic {
        /// Where.
        path: PathBuf,
        /// The topics.
        found: String,
    },
    /// More than one topic may be meant.
    #[error("{path}: has depth images on several topics, {found}; name one with `source.topic`")]
    SeveralTopics {
        /// Where.
        path: PathBuf,
        /// The topics.
        found: String,
    },
    /// The topic that was asked for is not there.
    #[error("{path}: has no images on the topic {wanted} that `source.topic` names: {found}")]
    NoSuchTopic {
        /// Where.
        path: PathBuf,
        /// The topic asked for.
        wanted: String,
        /// The topics.
        found: String,
    },
    /// No intrinsics, and none in the options.
    #[error(
        "{path}: has no camera intrinsics for the images on {image_topic} (expected sensor_msgs/msg/CameraInfo messages on {beside}); give them with the keys camera.fx, camera.fy, camera.cx and camera.cy"
    )]
    NoIntrinsics {
        /// Where.
        path: PathBuf,
        /// Topic of the images.
        image_topic: String,
        /// Where the intrinsics would be.
        beside: String,
    },
    /// Intrinsics that cannot be used.
    #[error("{path}: the camera intrinsics on {topic} cannot be used: {error}")]
    Intrinsics {
        /// Where.
        path: PathBuf,
        /// Their topic.
        topic: String,
        /// Why.
        error: MessageError,
    },
    /// A folder of PNGs without `camera.toml`.
    #[error(
        "{path}: there is no such file; a folder of PNGs needs it to hold fx, fy, cx, cy and depth_unit_m"
    )]
    NoCameraFile {
        /// The missing file.
        path: PathBuf,
    },
    /// A `camera.toml` that cannot be used.
    #[error("{path}, line {line}, column {column}: {reason}")]
    CameraFile {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What was expected.
        reason: String,
    },
    /// A recording without a single usable frame.
    #[error("{path}: not one frame can be read{reason}")]
    NoFrames {
        /// Where.
        path: PathBuf,
        /// Of the first frame, if there is one.
        reason: String,
    },
}

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The system refuses.
    #[error(
        "{path}: cannot be written ({source}); check the folder, its permissions and the room on the disk"
    )]
    Io {
        /// Where.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The MCAP file cannot be written.
    #[error("the recording cannot be written ({0}); check the room on the disk")]
    Mcap(#[from] ::mcap::McapError),
    /// A PNG cannot be written.
    #[error("{path}: cannot be written ({source})")]
    Png {
        /// Where.
        path: PathBuf,
        /// The encoder's reason.
        source: image::ImageError,
    },
    /// The folder holds something already.
    #[error("{path}: the folder is not empty; a folder of PNGs is one recording, so give another one")]
    NotEmpty {
        /// Where.
        path: PathBuf,
    },
    /// Frames of two sensors in one recording.
    #[error("the frame has a depth unit of {found} m, those before it {expected} m; a recording has one")]
    DepthUnit {
        /// Of the frames before, metres.
        expected: f64,
        /// Of this frame, metres.
        found: f64,
    },
}

/// Opens a recording: a file by its first bytes, whatever its name; a folder as PNGs.
///
/// Frames are read when asked for. One that cannot be used is a [`SourceError::BadFrame`]; a file
/// that is cut short ends with its last whole message and one warning in the log.
///
/// # Errors
/// When it is missing, or not one frame of it can be read; each error is one sentence.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn FrameSource + Send>, OpenError> {
    let io = |source| OpenError::Io { path: path.to_owned(), source };
    let metadata = match fs::metadata(path) {
        Ok(metadata) => metadata,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return Err(OpenError::Missing { path: path.to_owned() });
        }
        Err(error) => return Err(io(error)),
    };
    if metadata.is_dir() {
        return if path.join("metadata.yaml").exists() {
            Err(OpenError::Unsupported {
                path: path.to_owned(),
                found: "a rosbag2 folder",
                remedy: "open the .mcap file in it",
            })
        } else {
            png_sequence::open(path)
        };
    }
    if !metadata.is_file() {
        // Reading a pipe or a device could take for ever.
        return Err(not_a_recording(path, "neither a file nor a folder"));
    }
    let mut start = Vec::new();
    File::open(path).and_then(|file| file.take(8).read_to_end(&mut start)).map_err(io)?;
    match start.as_slice() {
        [] => Err(not_a_recording(path, "an empty file")),
        start if start == mcap::MAGIC => mcap::open(path, metadata.len(), options),
        [b'N', b'I', b'1', b'0', ..] => Err(OpenError::Unsupported {
            path: path.to_owned(),
            found: "an OpenNI recording",
            remedy: "convert it to MCAP or to a folder of 16-bit PNGs",
        }),
        start if start.starts_with(b"\x89PNG") => Err(not_a_recording(path, "one picture; give its folder")),
        start if mcap::MAGIC.starts_with(start) => {
            Err(not_a_recording(path, "an MCAP file cut off in its first bytes"))
        }
        start if start.iter().all(|byte| byte.is_ascii_graphic() || byte.is_ascii_whitespace()) => {
            Err(not_a_recording(path, "a text file"))
        }
        _ => Err(not_a_recording(path, "a file of another kind")),
    }
}

fn not_a_recording(path: &Path, found: &str) -> OpenError {
    OpenError::NotARecording { path: path.to_owned(), found: found.to_owned() }
}

/// Reads up to the first usable frame.
fn ensure_one_frame(path: &Path, source: &mut dyn FrameSource) -> Result<(), OpenError> {
    let mut reason = String::new();
    loop {
        match source.next_frame() {
            Ok(_) => return Ok(()),
            Err(SourceError::BadFrame(why)) if reason.is_empty() => reason = format!("; {why}"),
            Err(SourceError::BadFrame(_)) => {}
            Err(SourceError::End) => return Err(OpenError::NoFrames { path: path.to_owned(), reason }),
            Err(SourceError::Failed(why)) => {
                let reason = format!("; {why}");
                return Err(OpenError::NoFrames { path: path.to_owned(), reason });
            }
        }
    }
}
