//! The types of `io.sward.Station`, as `io.sward.Station.varlink` defines them, for both ends.

use serde::{Deserialize, Serialize};
use zlink_core::introspect;

mod error;

pub use self::error::StationError;

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
    /// `none`, or the name of the recording that is being written.
    pub recording: String,
    /// `ok`, or why nothing can be recorded at present.
    pub recording_trouble: String,
    /// Frames that were written to recordings.
    pub recorded_frames: i64,
    /// Frames missing there since disk or processor do not keep up.
    pub unrecorded_slow: i64,
    /// Frames missing there since the disk is full or broken.
    pub unrecorded_disk: i64,
    /// How often the last seconds were saved.
    pub saves: i64,
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
            recording: "none".to_owned(),
            recording_trouble: "ok".to_owned(),
            recorded_frames: 0,
            unrecorded_slow: 0,
            unrecorded_disk: 0,
            saves: 0,
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

/// A recording that the station made.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, introspect::CustomType)]
#[zlink(crate = "zlink_core")]
pub struct Recording {
    /// Its name.
    pub name: String,
    /// Its size.
    pub bytes: i64,
    /// When it was last written, nanoseconds since 1970.
    pub written_unix_ns: i64,
    /// It does not go by itself.
    pub pinned: bool,
    /// It is being written.
    pub writing: bool,
}

/// The reply of `ListRecordings`.
#[derive(Clone, Debug, PartialEq, Eq, Default, Serialize, Deserialize, introspect::Type)]
#[zlink(crate = "zlink_core")]
pub struct ListRecordingsReply {
    /// The oldest first.
    pub recordings: Vec<Recording>,
}

/// The reply of `StartRecording` and `SaveRecording`.
#[derive(Clone, Debug, PartialEq, Eq, Default, Serialize, Deserialize, introspect::Type)]
#[zlink(crate = "zlink_core")]
pub struct RecordingName {
    /// What the recording is called.
    pub name: String,
}

/// The reply of `StopRecording`.
#[derive(Clone, Debug, PartialEq, Eq, Default, Serialize, Deserialize, introspect::Type)]
#[zlink(crate = "zlink_core")]
pub struct RecordingEnd {
    /// What the recording is called.
    pub name: String,
    /// Frames of its file.
    pub frames: i64,
    /// Bytes of its file.
    pub bytes: i64,
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
        for custom in [
            Status::CUSTOM_TYPE,
            Blade::CUSTOM_TYPE,
            EarlierBlade::CUSTOM_TYPE,
            RefusedFile::CUSTOM_TYPE,
            Recording::CUSTOM_TYPE,
        ] {
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
            ("StartRecording()", RecordingName::TYPE),
            ("StopRecording()", RecordingEnd::TYPE),
            ("SaveRecording()", RecordingName::TYPE),
            ("ListRecordings()", ListRecordingsReply::TYPE),
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
        known.insert("methodPinRecording(name:string,pinned:bool)->()".to_owned());
        known.insert("methodRemoveRecording(name:string)->()".to_owned());
        known.insert("methodRemoveBlade(name:string)->()".to_owned());
        known.insert("methodRestoreBlade(name:string,back:?int)->()".to_owned());
        assert_eq!(known, members);
    }
}
