//! MCAP with ROS 2 messages, the form that `ros2 bag record` leaves behind.
//!
//! Reading goes over a file three times at most, with one record in memory: a survey of its topics
//! and intrinsics (of a whole file: its summary and its first messages), a look for one good frame,
//! and the replay itself.
//!
//! # Things we don't support
//! Folders of several files, and images that must be undistorted. The checksums of chunks that are
//! not compressed are not looked at.

mod read;
mod records;
mod survey;
mod write;

pub(super) use read::open;
pub(super) use records::MAGIC;
pub use write::{CAMERA_INFO_TOPIC, IMAGE_TOPIC, McapWriter, RecordingParams};

/// Name of the metadata record that Sward's own recordings have.
const METADATA_NAME: &str = "sward";
/// Its key for the metres of one count of depth.
const DEPTH_UNIT_KEY: &str = "depth_unit_m";
