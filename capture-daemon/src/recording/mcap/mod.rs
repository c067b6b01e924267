//! MCAP with ROS 2 messages, the form that `ros2 bag record` leaves behind.
//!
//! Reading goes over a file three times at most, with one record or one chunk in memory: a survey of
//! its topics and intrinsics (of a whole file: its summary and its first messages), a look for one good
//! frame, and the replay itself, which puts frames in the order of their times.
//!
//! # Things we don't support
//! Messages that are compressed one by one, `ros2idl` schemas, and intrinsics that change within a
//! recording: the first ones hold.

mod chunk;
mod part;
mod read;
mod record;
mod records;
mod resume;
mod survey;
mod write;

pub(super) use part::Part;
pub(super) use read::{open, recorded_config};
pub(super) use record::Record;
pub(super) use records::{MAGIC, RecordError, RecordReader};
pub use write::{CAMERA_INFO_TOPIC, IMAGE_TOPIC, McapWriter, NOTES_TOPIC, RecordingParams};
pub(super) use write::{ChunkSpan, write_options};

/// Name of the metadata record that Sward's own recordings have.
const METADATA_NAME: &str = "sward";
/// Its key for the metres of one count of depth.
const DEPTH_UNIT_KEY: &str = "depth_unit_m";
/// Its key for the configuration.
const CONFIG_KEY: &str = "config";
/// Its key for the order of the frames, and the value for the one in which a station saw them: it is kept, whatever
/// their times.
const ORDER_KEY: &str = "order";
const AS_SEEN: &str = "as seen";
