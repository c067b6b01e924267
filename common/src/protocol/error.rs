//! The errors of `io.sward.Station`.

use zlink_core::introspect;

/// The errors of the interface.
#[derive(Clone, Debug, PartialEq, zlink_core::ReplyError, introspect::ReplyError)]
#[zlink(interface = "io.sward.Station", crate = "zlink_core")]
pub enum StationError {
    /// `after` was below zero.
    InvalidGeneration {
        /// What was sent.
        after: i64,
    },
    /// `after` of a preview was below zero.
    InvalidSequence {
        /// What was sent.
        after: i64,
    },
    /// The station has no file descriptor or no memory left for the reply; try again.
    OutOfDescriptors,
    /// There is no blade of this name.
    NoSuchBlade {
        /// What was sent.
        name: String,
    },
    /// Another blade has this name, or the id of the one to be restored.
    NameTaken {
        /// The other blade.
        name: String,
    },
    /// No blade can have this name.
    InvalidName {
        /// What is wrong with it.
        reason: String,
    },
    /// The weight was below zero or too large.
    InvalidMix {
        /// What was sent.
        mix: f64,
    },
    /// There is no earlier blade of this name, or not so far back.
    NothingToRestore {
        /// What was sent.
        name: String,
    },
    /// The blade's file was edited and is not valid.
    FileRefused {
        /// File, line, column, and what is wrong.
        reason: String,
    },
    /// The disk is full, read-only or broken, or all blades of a full library are pinned.
    StoreTrouble {
        /// What the system said.
        reason: String,
    },
    /// What was captured is not on disk yet, and comes by itself.
    CaptureWaits {
        /// Blades of this capture that are in the library.
        names: Vec<String>,
        /// Blades of this capture that wait.
        waiting: i64,
        /// What the system said.
        reason: String,
    },
    /// Nothing is held before the camera, or it went away before it was captured.
    NothingHeld,
    /// No frames come.
    NoFrames,
    /// There is no recording of this name.
    NoSuchRecording {
        /// What was sent.
        name: String,
    },
    /// This recording is being written.
    BeingWritten {
        /// The recording.
        name: String,
    },
    /// Nothing is being recorded.
    NotRecording,
    /// The last seconds are not kept, or no frame came yet.
    NothingToSave,
    /// The disk has no room beyond its reserve, or is broken.
    RecordingTrouble {
        /// What is the matter.
        reason: String,
    },
    /// The configuration is not valid; the old one stays.
    InvalidConfig {
        /// File, line, column, and what is wrong.
        reason: String,
    },
    /// Too much is asked of the station at once; try again.
    Busy,
    /// The station serves as many connections as it may; this one is closed.
    TooManyConnections {
        /// How many this user may have.
        limit: i64,
    },
    /// The message was no JSON object; the connection is closed.
    NotAMessage,
    /// The message was too long to be read; the connection is closed.
    MessageTooLong {
        /// Longest message, bytes.
        limit: i64,
    },
}

impl std::fmt::Display for StationError {
    /// What it means and what to do; no full stop.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::InvalidGeneration { after } => write!(f, "the generation {after} is below zero"),
            Self::InvalidSequence { after } => write!(f, "the sequence number {after} is below zero"),
            Self::OutOfDescriptors => {
                f.write_str("the station has no file descriptor or no memory left; try again")
            }
            Self::NoSuchBlade { name } => {
                write!(f, "there is no blade {name:?}; sward-capture blades list shows what there is")
            }
            Self::NameTaken { name } => {
                write!(
                    f,
                    "there is a blade {name:?} already; rename or remove it first, or choose another name"
                )
            }
            Self::InvalidName { reason } | Self::FileRefused { reason } | Self::InvalidConfig { reason } => {
                f.write_str(reason)
            }
            Self::InvalidMix { mix } => {
                write!(f, "the mix weight is {mix:?}, expected 0, or a number of 1e-30 to 1000000")
            }
            Self::NothingToRestore { name } => write!(
                f,
                "there is no earlier blade {name:?}, or not so many; sward-capture blades show lists what there is"
            ),
            Self::StoreTrouble { reason } => {
                write!(
                    f,
                    "the store cannot do it: {reason}; nothing has changed, try again when that is mended"
                )
            }
            Self::CaptureWaits { waiting, reason, .. } => write!(
                f,
                "{} captured, and cannot be kept yet: {reason}; it is tried again every second and comes by itself when that is mended",
                if *waiting == 1 { "1 blade is".to_owned() } else { format!("{waiting} blades are") }
            ),
            Self::NothingHeld => {
                f.write_str("nothing is held before the camera; hold something up and try again")
            }
            Self::NoFrames => f.write_str("no frames come: there is no sensor, or the recording is over"),
            Self::NoSuchRecording { name } => write!(
                f,
                "there is no recording {name:?}; sward-capture recordings list shows what there is"
            ),
            Self::BeingWritten { name } => {
                write!(f, "the recording {name:?} is being written; sward-capture recordings stop ends it")
            }
            Self::NotRecording => {
                f.write_str("nothing is being recorded; sward-capture recordings start begins one")
            }
            Self::NothingToSave => f.write_str(
                "there are no last seconds to save: set record.ring_s and start the station anew, or wait for a frame",
            ),
            Self::RecordingTrouble { reason } => {
                write!(f, "it cannot be recorded: {reason}")
            }
            Self::Busy => f.write_str("the station is busy; try again"),
            Self::TooManyConnections { limit } => write!(
                f,
                "the station has as many connections as it may, {limit} for this user; close some, or raise service.max_connections and start it anew"
            ),
            Self::NotAMessage => f.write_str("the message is no JSON object, expected a call of varlink"),
            Self::MessageTooLong { limit } => {
                write!(f, "the message is too long for the station, expected {limit} bytes at most")
            }
        }
    }
}
