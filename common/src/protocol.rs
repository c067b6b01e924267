//! The types of `io.sward.Station`, as `io.sward.Station.varlink` defines them, for both ends.

use serde::{Deserialize, Serialize};
use zlink_core::introspect;

/// The interface in varlink's own language.
pub const DEFINITION: &str = include_str!("io.sward.Station.varlink");
/// Largest snapshot that a receiver accepts: header, 4096 records, 4096 × 64 knots.
pub const MAX_SNAPSHOT_BYTES: u64 = 64 + 4096 * 128 + 4096 * 64 * 32;

/// Longest message that the station reads, bytes of JSON.
pub const MAX_MESSAGE_BYTES: usize = 64 * 1024;

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

/// The reply of `GetPreview`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, introspect::Type)]
#[zlink(crate = "zlink_core")]
pub struct Preview {
    /// Sequence number of the preview.
    pub sequence: i64,
    /// `no_source`, `waiting`, `settling` or `captured`.
    pub state: String,
    /// What to tell the visitor, for programs.
    pub code: String,
    /// The same in plain words.
    pub words: String,
    /// Bytes of the memfd.
    pub size: i64,
    /// Index of the memfd among the reply's descriptors.
    pub fd: i64,
}

/// What the station is doing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, introspect::CustomType)]
#[zlink(crate = "zlink_core")]
pub struct Status {
    /// `no_source`, `waiting`, `settling` or `captured`.
    pub state: String,
    /// Generation of the newest library; 0 before the first.
    pub generation: i64,
    /// Blades in it.
    pub blades: i64,
    /// Frames seen since the start.
    pub frames: i64,
    /// Captures since the start that brought something new.
    pub captures: i64,
    /// Captures since the start of blades that were all captured before.
    pub repeats: i64,
    /// Frames that could not be read or used.
    pub skipped_frames: i64,
    /// Frames that came while the stages were behind: the queue to them was full.
    pub dropped_frames: i64,
    /// Over the last second or so.
    pub frames_per_second: f64,
    /// Where the frames come from.
    pub source: String,
    /// `none`, `ok`, or why no frames come from the sensor at present.
    pub sensor: String,
    /// Sensor processes that were started.
    pub sensor_starts: i64,
    /// Of these, killed since nothing came from them.
    pub sensor_silences: i64,
    /// Of these, crashed or ended.
    pub sensor_deaths: i64,
    /// Of these, could not open the sensor, or lost it.
    pub sensor_failures: i64,
    /// Frames that were lost between the sensor and the station.
    pub lost_frames: i64,
    /// `ok`, or why blades cannot be written at present.
    pub store: String,
    /// Captured blades that are announced as soon as they can be written.
    pub waiting: i64,
    /// Captured blades that found no room.
    pub lost: i64,
    /// Files in the store that are no blades.
    pub refused_files: i64,
    /// Connections at present.
    pub clients: i64,
    /// Hex of a hash of the keys that the capture goes by.
    pub config: String,
    /// Path of the configuration file that it reads; absent where it has none.
    pub config_file: Option<String>,
    /// Of the program.
    pub version: String,
}

impl Status {
    /// That of a station that begins: it waits, and all counts are 0.
    pub fn at_start(source: &str, config: &str, version: &str) -> Self {
        Self {
            state: "waiting".to_owned(),
            generation: 0,
            blades: 0,
            frames: 0,
            captures: 0,
            repeats: 0,
            skipped_frames: 0,
            dropped_frames: 0,
            frames_per_second: 0.0,
            source: source.to_owned(),
            sensor: "none".to_owned(),
            sensor_starts: 0,
            sensor_silences: 0,
            sensor_deaths: 0,
            sensor_failures: 0,
            lost_frames: 0,
            store: "ok".to_owned(),
            waiting: 0,
            lost: 0,
            refused_files: 0,
            clients: 0,
            config: config.to_owned(),
            config_file: None,
            version: version.to_owned(),
        }
    }
}

/// A blade of the library.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, introspect::CustomType)]
#[zlink(crate = "zlink_core")]
pub struct Blade {
    /// Its name, 1 to 48 bytes.
    pub name: String,
    /// Its id, 32 hexadecimal digits.
    pub id: String,
    /// `blade` or `leaf`.
    pub kind: String,
    /// Arc length of the midrib, metres.
    pub length_m: f64,
    /// Largest width, metres.
    pub max_width_m: f64,
    /// Number of knots.
    pub knots: i64,
    /// How often it stands in the meadow, relative to the others.
    pub mix: f64,
    /// 0 to 1.
    pub quality: f64,
    /// It never goes to the archive by itself.
    pub pinned: bool,
    /// When it was captured, nanoseconds since 1970.
    pub captured_unix_ns: i64,
    /// The recording or sensor it comes from.
    pub source: Option<String>,
    /// Frames that were added up.
    pub frames: Option<i64>,
}

/// An earlier blade of a name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, introspect::CustomType)]
#[zlink(crate = "zlink_core")]
pub struct EarlierBlade {
    /// How far back it is: 1 is the newest.
    pub back: i64,
    /// Until when it had the name, nanoseconds since 1970.
    pub kept_unix_ns: i64,
    /// It had to make room in a full library.
    pub archived: bool,
    /// The name that it got instead.
    pub renamed_to: Option<String>,
    /// The blade as it was.
    pub blade: Blade,
}

/// A file in the store that is no blade.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, introspect::CustomType)]
#[zlink(crate = "zlink_core")]
pub struct RefusedFile {
    /// The name that its blade would have.
    pub name: String,
    /// File, line, column, and what is wrong.
    pub reason: String,
}

/// The reply of `ListBlades`.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize, introspect::Type)]
#[zlink(crate = "zlink_core")]
pub struct ListBladesReply {
    /// The library's blades in its order.
    pub blades: Vec<Blade>,
    /// Files that are none.
    pub refused: Vec<RefusedFile>,
}

/// The reply of `ListHistory`.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize, introspect::Type)]
#[zlink(crate = "zlink_core")]
pub struct ListHistoryReply {
    /// What the name can go back to, the newest first.
    pub earlier: Vec<EarlierBlade>,
}

/// The reply of `ListRemoved`.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize, introspect::Type)]
#[zlink(crate = "zlink_core")]
pub struct ListRemovedReply {
    /// What names that no blade has now would go back to, what went last first.
    pub removed: Vec<EarlierBlade>,
}

/// The reply of `Capture`.
#[derive(Clone, Debug, PartialEq, Eq, Default, Serialize, Deserialize, introspect::Type)]
#[zlink(crate = "zlink_core")]
pub struct CaptureReply {
    /// The new blades.
    pub names: Vec<String>,
    /// Why something else that was seen is none, for the visitor.
    pub refused: Vec<String>,
}

/// The reply of `Reload`.
#[derive(Clone, Debug, PartialEq, Eq, Default, Serialize, Deserialize, introspect::Type)]
#[zlink(crate = "zlink_core")]
pub struct ReloadReply {
    /// Keys that hold another value from now on.
    pub changed: Vec<String>,
    /// Keys that do so only after a restart.
    pub restart: Vec<String>,
}

/// The reply of `GetStatus`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, introspect::Type)]
#[zlink(crate = "zlink_core")]
pub struct GetStatusReply {
    /// The status.
    pub status: Status,
}

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

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use zlink_core::introspect::{CustomType, ReplyError, Type};

    use super::*;

    /// Without comments and spaces.
    fn bare(text: &str) -> String {
        let code = text.lines().map(|line| line.split('#').next().unwrap_or_default());
        code.collect::<Vec<_>>().join(" ").split_whitespace().collect()
    }

    /// What stands in the file, member by member.
    fn members() -> BTreeSet<String> {
        let code: Vec<&str> = DEFINITION.lines().filter(|line| !line.starts_with('#')).collect();
        let code = code.join("\n");
        let starts = ["\nmethod ", "\ntype ", "\nerror "];
        let mut ends: Vec<usize> =
            starts.iter().flat_map(|start| code.match_indices(start)).map(|(at, _)| at).collect();
        ends.sort_unstable();
        ends.push(code.len());
        ends.windows(2).map(|pair| bare(&code[pair[0]..pair[1]])).collect()
    }

    #[test]
    fn the_types_are_those_of_the_file() {
        let members = members();
        let mut known = BTreeSet::new();
        for custom in
            [Status::CUSTOM_TYPE, Blade::CUSTOM_TYPE, EarlierBlade::CUSTOM_TYPE, RefusedFile::CUSTOM_TYPE]
        {
            known.insert(bare(&custom.to_string()));
        }
        for error in StationError::VARIANTS {
            known.insert(bare(&error.to_string()));
        }
        for (call, reply) in [
            ("GetLibrary(after:int)", Library::TYPE),
            ("GetPreview(after:int)", Preview::TYPE),
            ("GetStatus()", GetStatusReply::TYPE),
            ("ListBlades()", ListBladesReply::TYPE),
            ("ListHistory(name:string)", ListHistoryReply::TYPE),
            ("ListRemoved()", ListRemovedReply::TYPE),
            ("Capture()", CaptureReply::TYPE),
            ("Reload()", ReloadReply::TYPE),
        ] {
            known.insert(format!("method{call}->{}", bare(&reply.to_string())));
        }
        for call in [
            "SetMix(name:string,mix:float)",
            "RenameBlade(name:string,new_name:string)",
            "PutBlade(name:string,text:string)",
        ] {
            known.insert(format!("method{call}->()"));
        }
        known.insert("methodRemoveBlade(name:string)->()".to_owned());
        known.insert("methodRestoreBlade(name:string,back:?int)->()".to_owned());
        assert_eq!(known, members);
    }
}
