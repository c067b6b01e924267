//! The types of `io.sward.Station`, as `io.sward.Station.varlink` defines them, for both ends.

use serde::{Deserialize, Serialize};
use zlink_core::introspect;

/// The interface in varlink's own language.
pub const DEFINITION: &str = include_str!("io.sward.Station.varlink");
/// Largest snapshot that a receiver accepts: header, 4096 records, 4096 × 64 knots.
pub const MAX_SNAPSHOT_BYTES: u64 = 64 + 4096 * 128 + 4096 * 64 * 32;

/// The reply of `GetLibrary`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, introspect::Type)]
#[zlink(crate = "zlink_core")]
pub struct Library {
    /// Generation of the snapshot.
    pub generation: i64,
    /// Number of blades.
    pub blades: i64,
    /// Bytes of the memfd.
    pub size: i64,
    /// Index of the memfd among the reply's descriptors.
    pub fd: i64,
}

/// What the station is doing.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, introspect::CustomType)]
#[zlink(crate = "zlink_core")]
pub struct Status {
    /// `waiting`, `settling` or `captured`.
    pub state: String,
    /// Generation of the newest library; 0 before the first.
    pub generation: i64,
    /// Blades in it.
    pub blades: i64,
    /// Frames seen since the start.
    pub frames: i64,
    /// Captures since the start.
    pub captures: i64,
    /// Frames that could not be read or used.
    pub skipped_frames: i64,
    /// Where the frames come from.
    pub source: String,
}

/// The reply of `GetStatus`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, introspect::Type)]
#[zlink(crate = "zlink_core")]
pub struct GetStatusReply {
    /// The status.
    pub status: Status,
}

/// The errors of the interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, zlink_core::ReplyError, introspect::ReplyError)]
#[zlink(interface = "io.sward.Station", crate = "zlink_core")]
pub enum StationError {
    /// `after` was below zero.
    InvalidGeneration {
        /// What was sent.
        after: i64,
    },
    /// The station has no file descriptor left for the reply; try again.
    OutOfDescriptors,
}
