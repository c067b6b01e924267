//! `recordings`.

use std::fmt::Write;
use std::time::Duration;

use clap::Subcommand;
use common::protocol::{ListRecordingsReply, Recording, RecordingEnd};
use common::sentence::print;
use common::station::StationProxy;

use super::{Station, json, utc};
use crate::cli::{ListArgs, StationArgs};

/// How long the last seconds may take to be written.
const PATIENCE: Duration = Duration::from_secs(120);

/// What to do with recordings of the station that runs.
#[derive(Debug, Subcommand)]
pub enum RecordingsVerb {
    /// A line for each recording, the oldest first
    ///
    /// Example: sward-capture recordings list --json
    List(ListArgs),
    /// Record what the station sees, until `stop`; prints the recording's name
    ///
    /// A replay of the recording captures what the station does, bit for bit.
    ///
    /// Example: sward-capture recordings start
    Start(StationArgs),
    /// End the recording
    ///
    /// Example: sward-capture recordings stop
    Stop(StationArgs),
    /// Save what was seen in the last `record.ring_s` seconds; prints the recording's name
    ///
    /// Example: sward-capture recordings save
    Save(StationArgs),
    /// Have a recording stay until it is removed
    ///
    /// Example: sward-capture recordings pin 2026-11-23T18-20-26.123Z
    Pin {
        /// Name of the recording
        name: String,
        /// Which station.
        #[command(flatten)]
        station: StationArgs,
    },
    /// Let a pinned recording go again, by age and size
    ///
    /// Example: sward-capture recordings unpin 2026-11-23T18-20-26.123Z
    Unpin {
        /// Name of the recording
        name: String,
        /// Which station.
        #[command(flatten)]
        station: StationArgs,
    },
    /// Remove a recording; nothing brings it back
    ///
    /// Example: sward-capture recordings remove 2026-11-23T18-20-26.123Z
    Remove {
        /// Name of the recording
        name: String,
        /// Which station.
        #[command(flatten)]
        station: StationArgs,
    },
}

/// `sward-capture recordings`.
///
/// # Errors
/// When no station answers, it refuses, or stdout cannot be written.
pub fn recordings(verb: &RecordingsVerb) -> anyhow::Result<()> {
    match verb {
        RecordingsVerb::List(args) => {
            let reply =
                Station::connect(&args.station)?.call(async |station| station.list_recordings().await)?;
            Ok(print(&if args.json { json(&reply)? } else { page(&reply) })?)
        }
        RecordingsVerb::Start(args) => {
            let begun = Station::connect(args)?.call(async |station| station.start_recording().await)?;
            Ok(print(&format!("{}\n", begun.name))?)
        }
        RecordingsVerb::Stop(args) => {
            let RecordingEnd { name, frames, bytes } =
                Station::connect(args)?.call(async |station| station.stop_recording().await)?;
            Ok(print(&format!("{name}  {frames} frames  {:.1} MB\n", bytes as f64 / 1e6))?)
        }
        RecordingsVerb::Save(args) => {
            let mut station = Station::connect(args)?;
            let saved = station.call_with(Some(PATIENCE), async |station| station.save_recording().await)?;
            Ok(print(&format!("{}\n", saved.name))?)
        }
        RecordingsVerb::Pin { name, station } => pin(name, true, station),
        RecordingsVerb::Unpin { name, station } => pin(name, false, station),
        RecordingsVerb::Remove { name, station } => {
            Ok(Station::connect(station)?.call(async |station| station.remove_recording(name).await)?)
        }
    }
}

fn pin(name: &str, pinned: bool, station: &StationArgs) -> anyhow::Result<()> {
    Ok(Station::connect(station)?.call(async |station| station.pin_recording(name, pinned).await)?)
}

fn page(reply: &ListRecordingsReply) -> String {
    let mut text = String::new();
    for Recording { name, bytes, written_unix_ns, pinned, writing } in &reply.recordings {
        let (mb, written) = (*bytes as f64 / 1e6, utc(*written_unix_ns));
        let pinned = if *pinned { "  pinned" } else { "" };
        let writing = if *writing { "  being written" } else { "" };
        // Writing to a text does not fail.
        let _ = writeln!(text, "{name}  {mb:8.1} MB  written {written}{pinned}{writing}");
    }
    text
}
