//! Why a recording cannot be opened.

use std::path::PathBuf;

use super::ros2::MessageError;

/// Why a recording cannot be replayed: it is missing, or not one frame of it can be read.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Nothing is there.
    #[error(
        "{path}: there is no such file or folder; expected a recording: an MCAP file, a rosbag2 folder, an .oni file or a folder of 16-bit PNGs with camera.toml"
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
        "{path}: is not a recording but {found}; expected an MCAP file, a rosbag2 folder, an .oni file or a folder of 16-bit PNGs with camera.toml"
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
        found: String,
        /// What to do.
        remedy: &'static str,
    },
    /// OpenNI2 does not play it.
    #[error("{path}: {reason}")]
    OpenNi {
        /// Where.
        path: PathBuf,
        /// Why.
        reason: String,
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
    /// A depth unit that cannot be one.
    #[error("{path}: its metadata say a depth unit of {found:?} m; expected 1e-6 to 0.1")]
    DepthUnit {
        /// Where.
        path: PathBuf,
        /// What it says.
        found: String,
    },
    /// A `metadata.yaml` that says not where the files are.
    #[error("{path}: {reason}; expected the metadata that `ros2 bag record` writes, or MCAP files beside it")]
    BagMetadata {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
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
