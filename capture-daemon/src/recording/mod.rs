//! Recordings: MCAP files with ROS 2 messages, rosbag2 folders of such, folders of 16-bit PNGs, and OpenNI2's `.oni`.

mod cdr;
mod distortion;
mod in_order;
mod info;
mod mcap;
mod oni;
mod open_error;
mod png_sequence;
mod recover;
mod ros2;
mod rosbag2;

use std::fs::{self, File};
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

pub use self::cdr::CdrError;
pub use self::distortion::{Distortion, DistortionError};
pub use self::info::{Info, TopicInfo, info};
pub use self::mcap::{CAMERA_INFO_TOPIC, IMAGE_TOPIC, McapWriter, NOTES_TOPIC, RecordingParams};
pub use self::open_error::OpenError;
pub use self::png_sequence::PngWriter;
pub use self::recover::{RecoverError, Recovered, recover};
pub use self::ros2::{FLOAT_DEPTH_UNIT_M, MessageError};
use crate::config::SensorConfig;
use crate::frame::CameraModel;
use crate::source::{FrameSource, SourceError};

/// When the first frame of a folder of PNGs was taken, which does not say so itself: nanoseconds
/// since 1970, in November 2023. Synthetic clips begin then too.
pub const START_NS: u64 = 1_700_000_000_000_000_000;

/// Intrinsics for a recording that has none.
#[derive(Clone, Debug, PartialEq)]
pub struct GivenCamera {
    /// The pinhole.
    pub camera: CameraModel,
    /// The lens.
    pub distortion: Distortion,
}

/// What a recording leaves open.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// Intrinsics of a recording that has none.
    pub camera: Option<GivenCamera>,
    /// Topic of the depth images, among several.
    pub topic: Option<String>,
    /// How OpenNI2 plays its own: of these the library and whether the picture is to be mirrored.
    pub sensor: SensorConfig,
    /// The file of `sward-capture`, which reads those in a process of its own; none where this is it.
    pub program: Option<PathBuf>,
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
    #[error(
        "{path}: cannot be written ({source}); check the folder, its permissions and the room on the disk"
    )]
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

/// What is known of a recording once it is open.
#[derive(Clone, Debug, PartialEq)]
struct Contents {
    /// `mcap`, `png` or `oni`.
    format: &'static str,
    /// Topic of the depth images; none of pictures.
    image_topic: Option<String>,
    /// The distortion that is undone in them.
    distortion: Distortion,
    /// The MCAP files; none of pictures.
    parts: Vec<PathBuf>,
}

/// An open recording.
struct Recording {
    contents: Contents,
    source: Box<dyn FrameSource + Send>,
}

/// Opens a recording: a file by its first bytes, whatever its name; a folder with a `metadata.yaml` or
/// with MCAP files but no PNGs as a rosbag2 one; any other folder as PNGs.
///
/// Frames are read when asked for, in the order of their times: those of a file that are up to 8 frames and
/// a second late are sorted in, and where its clock was set back farther, they go on in the order of
/// the file. One that cannot be used is a [`SourceError::BadFrame`]; a file that is cut short ends with its last whole message and one warning
/// in the log. A distortion of the lens is undone.
///
/// # Errors
/// When it is missing, or not one frame of it can be read; each error is one sentence.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn FrameSource + Send>, OpenError> {
    Ok(open_recording(path, options)?.source)
}

fn open_recording(path: &Path, options: &OpenOptions) -> Result<Recording, OpenError> {
    match kind(path)? {
        Kind::Mcap(parts) => mcap::open(path, parts, options),
        Kind::Pictures => png_sequence::open(path),
        Kind::Oni => oni::open(path, options),
    }
}

/// Of which kind a recording is.
enum Kind {
    /// MCAP files, in their order.
    Mcap(Vec<mcap::Part>),
    /// A folder of PNGs.
    Pictures,
    /// A recording of OpenNI2.
    Oni,
}

/// Looks at what is at a path.
fn kind(path: &Path) -> Result<Kind, OpenError> {
    let io = |source| OpenError::Io { path: path.to_owned(), source };
    let metadata = match fs::metadata(path) {
        Ok(metadata) => metadata,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return Err(OpenError::Missing { path: path.to_owned() });
        }
        Err(error) => return Err(io(error)),
    };
    if metadata.is_dir() {
        if path.join(rosbag2::METADATA_FILE).exists() {
            return rosbag2::parts(path).map(Kind::Mcap);
        }
        // rosbag2 writes its metadata last: a power failure leaves the files alone.
        let parts = rosbag2::numbered_parts(path)?;
        let has_pictures = !png_sequence::pictures(path).map_err(io)?.is_empty();
        return Ok(if has_pictures || parts.is_empty() { Kind::Pictures } else { Kind::Mcap(parts) });
    }
    if !metadata.is_file() {
        // Reading a pipe or a device could take for ever.
        return Err(not_a_recording(path, "neither a file nor a folder"));
    }
    let mut start = Vec::new();
    File::open(path).and_then(|file| file.take(8).read_to_end(&mut start)).map_err(io)?;
    match start.as_slice() {
        [] => Err(not_a_recording(path, "an empty file")),
        start if start == mcap::MAGIC => Ok(Kind::Mcap(vec![mcap::Part { path: path.to_owned() }])),
        start if start.starts_with(oni::MAGIC) => Ok(Kind::Oni),
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

/// The configuration that a recording of a live run was made under: those sections, as TOML, that a capture goes by.
/// `None` where it says nothing of the kind, or cannot be read: opening it says why.
pub fn recorded_config(path: &Path) -> Option<String> {
    match kind(path).ok()? {
        Kind::Mcap(parts) => mcap::recorded_config(parts.first()?),
        Kind::Pictures | Kind::Oni => None,
    }
}

fn not_a_recording(path: &Path, found: &str) -> OpenError {
    OpenError::NotARecording { path: path.to_owned(), found: found.to_owned() }
}

/// Opens a file that is part of a recording. Anything else that has a path, such as a pipe, is refused:
/// reading it could take for ever.
fn open_file(path: &Path) -> Result<File, std::io::Error> {
    let is_file = fs::metadata(path)?.is_file();
    if is_file { File::open(path) } else { Err(std::io::Error::other("it is not a regular file")) }
}

/// Reads up to the first usable frame.
fn ensure_one_frame(path: &Path, source: &mut dyn FrameSource) -> Result<(), OpenError> {
    let mut reason = String::new();
    loop {
        match source.next_frame() {
            Ok(_) => return Ok(()),
            Err(SourceError::BadFrame(why)) if reason.is_empty() => reason = format!("; {why}"),
            Err(SourceError::BadFrame(_) | SourceError::Interrupted(_) | SourceError::Told(_)) => {}
            Err(SourceError::End) => return Err(OpenError::NoFrames { path: path.to_owned(), reason }),
            Err(SourceError::Failed(why)) => {
                let reason = format!("; {why}");
                return Err(OpenError::NoFrames { path: path.to_owned(), reason });
            }
        }
    }
}
