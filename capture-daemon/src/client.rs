//! The verbs that talk to a station that runs: `status`, `preview`, `reload` and `blades`.

use std::fmt::Write;
use std::future::Future;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use anyhow::Context;
use common::blade::MAX_MIX;
use common::protocol::{
    Blade, EarlierBlade, ListBladesReply, ListHistoryReply, RefusedFile, StationError, Status,
};
use common::sentence::{counted, print, print_on};
use common::station::StationProxy;
use serde::Serialize;

use crate::cli::{BladesVerb, ListArgs, StationArgs, StatusArgs};
use crate::config;
use crate::store::orders::MIN_MIX;

/// How long a station may take to answer.
const PATIENCE: Duration = Duration::from_secs(10);
/// How a closed connection shows when it is written to.
const HANGUPS: [ErrorKind; 2] = [ErrorKind::BrokenPipe, ErrorKind::ConnectionReset];

mod files;
mod nobody;
mod preview;
mod recordings;
mod reload;
mod restore;

pub use preview::preview;
pub use recordings::{RecordingsVerb, recordings};
pub use reload::reload;

/// Why a station did not do what was asked. One sentence without its full stop.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// Nobody listens.
    #[error("{socket}: {}", nobody::told(.reason))]
    NoStation {
        /// The socket.
        socket: String,
        /// What the system said.
        reason: std::io::Error,
    },
    /// It takes too long.
    #[error("{socket}: the station does not answer within {patience_s} s; see its log, or start it anew")]
    Silent {
        /// The socket.
        socket: String,
        /// How long it was waited for, seconds.
        patience_s: f64,
    },
    /// It closes the connection.
    #[error(
        "{socket}: the station hung up before it answered: it is ending, or was killed; try again, and see its log where that does not help"
    )]
    HungUp {
        /// The socket.
        socket: String,
    },
    /// We may not do this.
    #[error(
        "{socket}: the station does not allow you to do this; ask whoever runs it to add you to service.change (or service.watch) of its configuration"
    )]
    Denied {
        /// The socket.
        socket: String,
    },
    /// It is no station of ours, or of another version.
    #[error(
        "{socket}: what answers there is not understood: {reason}; expected io.sward.Station of this version"
    )]
    Strange {
        /// The socket.
        socket: String,
        /// What is odd.
        reason: String,
    },
    /// A file or an argument that was given is not what is needed.
    #[error("{file}: {reason}")]
    BadFile {
        /// The file.
        file: String,
        /// What is wrong, and what was expected.
        reason: String,
    },
    /// It answers with an error.
    #[error("{0}")]
    Refused(StationError),
}

impl ClientError {
    /// Whether it is for what was typed, rather than for the station.
    pub fn is_bad_argument(&self) -> bool {
        use StationError::{InvalidConfig, InvalidMix, InvalidName};
        let refused =
            matches!(self, Self::Refused(InvalidConfig { .. } | InvalidMix { .. } | InvalidName { .. }));
        refused || matches!(self, Self::BadFile { .. })
    }
}

/// A connection to a station, for calls that block.
struct Station {
    runtime: tokio::runtime::Runtime,
    connection: zlink::tokio::unix::Connection,
    socket: String,
    /// How long it may take to answer.
    patience: Duration,
}

impl Station {
    fn connect(args: &StationArgs) -> anyhow::Result<Self> {
        Self::at(&socket_of(args)?, PATIENCE)
    }

    fn at(socket: &Path, patience: Duration) -> anyhow::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .context("the runtime cannot be started")?;
        let shown = socket.display().to_string();
        let connected = runtime.block_on(patiently(&shown, patience, connect(socket)))?;
        let connection =
            connected.map_err(|reason| ClientError::NoStation { socket: shown.clone(), reason })?;
        Ok(Self { runtime, connection, socket: shown, patience })
    }

    fn call<T>(
        &mut self,
        call: impl AsyncFnOnce(&mut zlink::tokio::unix::Connection) -> zlink::Result<Result<T, StationError>>,
    ) -> Result<T, ClientError> {
        self.call_with(Some(self.patience), call)
    }

    /// `patience`: how long it may take to answer; `None` for something new, which may never come.
    fn call_with<T>(
        &mut self,
        patience: Option<Duration>,
        call: impl AsyncFnOnce(&mut zlink::tokio::unix::Connection) -> zlink::Result<Result<T, StationError>>,
    ) -> Result<T, ClientError> {
        let Self { runtime, connection, socket, .. } = self;
        let answer = match patience {
            Some(patience) => runtime.block_on(patiently(socket, patience, call(connection)))?,
            None => runtime.block_on(call(connection)),
        };
        match answer {
            Ok(answer) => answer.map_err(ClientError::Refused),
            Err(zlink::Error::VarlinkService(error))
                if *error.inner() == zlink::varlink_service::Error::PermissionDenied =>
            {
                Err(ClientError::Denied { socket: socket.clone() })
            }
            Err(zlink::Error::UnexpectedEof) => Err(ClientError::HungUp { socket: socket.clone() }),
            Err(zlink::Error::Io(error)) if HANGUPS.contains(&error.kind()) => {
                Err(ClientError::HungUp { socket: socket.clone() })
            }
            Err(error) => Err(ClientError::Strange { socket: socket.clone(), reason: error.to_string() }),
        }
    }
}

async fn connect(socket: &Path) -> std::io::Result<zlink::tokio::unix::Connection> {
    match zlink::tokio::unix::connect(socket).await {
        Err(zlink::Error::Io(error)) => Err(error),
        other => other.map_err(std::io::Error::other),
    }
}

async fn patiently<T>(
    socket: &str,
    patience: Duration,
    future: impl Future<Output = T>,
) -> Result<T, ClientError> {
    let patience_s = patience.as_secs_f64();
    let silent = |_| ClientError::Silent { socket: socket.to_owned(), patience_s };
    tokio::time::timeout(patience, future).await.map_err(silent)
}

fn socket_of(args: &StationArgs) -> anyhow::Result<PathBuf> {
    match &args.socket {
        Some(socket) => Ok(socket.clone()),
        None => Ok(config::load(args.config.config.as_deref(), &args.config.sets)?.service.socket),
    }
}

/// What the station at `socket` is doing.
///
/// # Errors
/// When none answers within `patience`.
pub(crate) fn status_of(socket: &Path, patience: Duration) -> anyhow::Result<Status> {
    Ok(Station::at(socket, patience)?.call(async |station| station.get_status().await)?.status)
}

/// `sward-capture status`.
///
/// # Errors
/// When no station answers, or stdout cannot be written.
pub fn status(args: &StatusArgs) -> anyhow::Result<()> {
    let mut station = Station::connect(&args.station)?;
    let mut before: Option<Status> = None;
    loop {
        let status = station.call(async |station| station.get_status().await)?.status;
        let text = if args.json {
            json(&status)?
        } else if args.watch {
            status_line(&status, before.as_ref())
        } else {
            status_page(&status)
        };
        before = Some(status);
        if !print_on(&text)? || !args.watch {
            return Ok(());
        }
        std::thread::sleep(Duration::from_secs(1));
    }
}

/// `sward-capture blades`.
///
/// # Errors
/// When no station answers, it refuses, or stdout cannot be written.
pub fn blades(verb: &BladesVerb) -> anyhow::Result<()> {
    match verb {
        BladesVerb::List(args) => list(args),
        BladesVerb::Show { name, list } => show(name, list),
        BladesVerb::Rename { name, new_name, station } => {
            change(station, async |station| station.rename_blade(name, new_name).await)
        }
        BladesVerb::Remove { name, station } => {
            change(station, async |station| station.remove_blade(name).await)
        }
        BladesVerb::Restore { name: Some(name), back, station, .. } => {
            change(station, async |station| station.restore_blade(name, Some(*back)).await)
        }
        BladesVerb::Restore { name: None, since, station, .. } => restore::all(*since, station),
        BladesVerb::Export { file, names, station } => files::export(file, names, station),
        BladesVerb::Import { file, name, length_mm, station } => {
            files::import(file, name.as_deref(), *length_mm, station)
        }
        BladesVerb::Mix { name, weight, station } => {
            if *weight != 0.0 && !(MIN_MIX..=f64::from(MAX_MIX)).contains(weight) {
                // JSON could not even hold some of these.
                return Err(ClientError::Refused(StationError::InvalidMix { mix: *weight }).into());
            }
            change(station, async |station| station.set_mix(name, *weight).await)
        }
    }
}

fn change(
    args: &StationArgs,
    call: impl AsyncFnOnce(&mut zlink::tokio::unix::Connection) -> zlink::Result<Result<(), StationError>>,
) -> anyhow::Result<()> {
    Ok(Station::connect(args)?.call(call)?)
}

fn list(args: &ListArgs) -> anyhow::Result<()> {
    let listed = Station::connect(&args.station)?.call(async |station| station.list_blades().await)?;
    if args.json {
        return Ok(print(&json(&listed)?)?);
    }
    let ListBladesReply { blades, refused } = listed;
    let mut text = String::new();
    let width = blades.iter().map(|blade| blade.name.chars().count()).max().unwrap_or(0);
    for Blade { name, length_m, max_width_m, mix, quality, kind, pinned, .. } in &blades {
        let (length, wide, pinned) =
            (length_m * 1e3, max_width_m * 1e3, if *pinned { "  pinned" } else { "" });
        writeln!(
            text,
            "{name:width$}  {kind:5}  {length:6.1} mm long  {wide:5.1} mm wide  quality {quality:.2}  mix {mix}{pinned}"
        )?;
    }
    for RefusedFile { reason, .. } in &refused {
        writeln!(text, "refused: {reason}")?;
    }
    Ok(print(&text)?)
}

fn show(name: &str, args: &ListArgs) -> anyhow::Result<()> {
    let mut station = Station::connect(&args.station)?;
    let ListBladesReply { blades, refused } = station.call(async |station| station.list_blades().await)?;
    let ListHistoryReply { earlier } = station.call(async |station| station.list_history(name).await)?;
    let blade = blades.iter().find(|blade| blade.name == name);
    let refused = refused.iter().find(|file| file.name == name);
    if blade.is_none() && earlier.is_empty() {
        let name = name.to_owned();
        let error = refused.map_or(StationError::NoSuchBlade { name }, |file| StationError::FileRefused {
            reason: file.reason.clone(),
        });
        return Err(ClientError::Refused(error).into());
    }
    if args.json {
        return Ok(print(&json(&Shown {
            name: blade.is_none().then_some(name),
            blade,
            refused,
            earlier: &earlier,
        })?)?);
    }
    let mut text = String::new();
    writeln!(text, "name      {name}")?;
    match blade {
        None => writeln!(
            text,
            "          no blade has this name now; sward-capture blades restore brings one back"
        )?,
        Some(blade) => {
            writeln!(text, "id        {}", blade.id)?;
            writeln!(text, "kind      {}", blade.kind)?;
            writeln!(text, "length    {:.1} mm", blade.length_m * 1e3)?;
            writeln!(text, "width     {:.1} mm", blade.max_width_m * 1e3)?;
            writeln!(text, "knots     {}", blade.knots)?;
            writeln!(text, "quality   {}", blade.quality)?;
            writeln!(text, "mix       {}", blade.mix)?;
            writeln!(text, "pinned    {}", if blade.pinned { "yes" } else { "no" })?;
            writeln!(text, "captured  {}", utc(blade.captured_unix_ns))?;
            writeln!(text, "source    {}", blade.source.as_deref().unwrap_or("made by hand"))?;
            if let Some(frames) = blade.frames {
                writeln!(text, "frames    {frames}")?;
            }
        }
    }
    if let Some(file) = refused {
        writeln!(text, "refused   {}", file.reason)?;
    }
    for EarlierBlade { back, kept_unix_ns, archived, renamed_to, blade } in &earlier {
        let Blade { length_m, max_width_m, mix, .. } = blade;
        let (length, wide, until) = (length_m * 1e3, max_width_m * 1e3, utc(*kept_unix_ns));
        let title = if *back == 1 { "history" } else { "" };
        write!(
            text,
            "{title:8}{back:3}  until {until}  {length:6.1} mm long  {wide:5.1} mm wide  mix {mix}"
        )?;
        if let Some(to) = renamed_to {
            write!(text, "  renamed to {to:?}")?;
        }
        writeln!(text, "{}", if *archived { "  in the archive" } else { "" })?;
    }
    Ok(print(&text)?)
}

/// What `blades show --json` prints.
#[derive(Serialize)]
struct Shown<'a> {
    /// Where no blade has it now; else it is the blade's.
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<&'a str>,
    #[serde(flatten)]
    blade: Option<&'a Blade>,
    #[serde(skip_serializing_if = "Option::is_none")]
    refused: Option<&'a RefusedFile>,
    earlier: &'a [EarlierBlade],
}

fn json(value: &impl Serialize) -> anyhow::Result<String> {
    Ok(serde_json::to_string(value).context("the reply cannot be written as JSON")? + "\n")
}

/// Nanoseconds since 1970 as a date and time of day in UTC (RFC 3339), to the millisecond.
fn utc(unix_ns: i64) -> String {
    let time = SystemTime::UNIX_EPOCH + Duration::from_nanos(u64::try_from(unix_ns).unwrap_or(0));
    humantime::format_rfc3339_millis(time).to_string()
}

/// A line of `status --watch`: rates, counts, and what was dropped and skipped since the line before.
fn status_line(status: &Status, before: Option<&Status>) -> String {
    let Status { state, frames_per_second, frames, captures, blades, store, .. } = status;
    let since = |count: fn(&Status) -> i64| {
        let now = count(status);
        let more = before.map_or(0, |before| now - count(before));
        if more <= 0 { now.to_string() } else { format!("{now} ({more:+})") }
    };
    let dropped = since(|status| status.dropped_frames);
    let skipped = since(|status| status.skipped_frames);
    let [frames, captures, blades] = [(frames, "frame"), (captures, "capture"), (blades, "blade")]
        .map(|(number, noun)| counted(number.cast_unsigned(), noun));
    format!(
        "{state:8}  {frames_per_second:6.1} frames/s  {frames}  {dropped} dropped  {skipped} skipped  {captures}  {blades}  store {store}\n"
    )
}

/// How the sensor fares, if there is one.
fn sensor_line(status: &Status) -> String {
    let Status {
        sensor, sensor_starts, sensor_silences, sensor_deaths, sensor_failures, lost_frames, ..
    } = status;
    if sensor == "none" {
        return String::new();
    }
    let starts = counted(sensor_starts.cast_unsigned(), "process");
    let starts = starts.replace("processs", "processes");
    format!(
        "sensor    {sensor}\n          {starts} started, of which {sensor_silences} fell silent, {sensor_deaths} died, \
         {sensor_failures} could not open or lost it; {lost_frames} frames lost on the way\n"
    )
}

/// What is recorded, if anything is or was to be.
fn recording_lines(status: &Status) -> String {
    let Status {
        recording, recording_trouble, recorded_frames, unrecorded_slow, unrecorded_disk, saves, ..
    } = status;
    let is_idle = recording == "none" && recording_trouble == "ok";
    let missing = unrecorded_slow + unrecorded_disk;
    if is_idle && recorded_frames + missing + saves == 0 {
        return String::new();
    }
    let trouble = if recording_trouble == "ok" { String::new() } else { format!("; {recording_trouble}") };
    let times = counted(saves.cast_unsigned(), "time");
    format!(
        "recording {recording}{trouble}\n          {recorded_frames} frames were written; missing are {unrecorded_slow} \
         that disk or processor were too slow for, and {unrecorded_disk} that the disk did not take; the last seconds \
         were saved {times}\n"
    )
}

fn status_page(status: &Status) -> String {
    let Status { state, source, frames, skipped_frames, dropped_frames, frames_per_second, .. } = status;
    let Status { captures, blades, generation, store, waiting, lost, refused_files, .. } = status;
    let Status { clients, config, version, repeats, .. } = status;
    let repeated = match repeats {
        0 => String::new(),
        repeats => format!(", and {repeats} of blades that were all captured before"),
    };
    let held = counted(blades.cast_unsigned(), "blade");
    let sensor = sensor_line(status);
    let mut text = format!(
        "state     {state}\nsource    {source}\n{sensor}frames    {frames} seen, {frames_per_second:.1} a second\n\
         dropped   {dropped_frames} frames, which came faster than the stages are\n\
         skipped   {skipped_frames} frames, which could not be read or used\n\
         captures  {captures}{repeated}\nlibrary   {held}, generation {generation}\nstore     {store}\n"
    );
    if *waiting > 0 {
        text += &format!(
            "waiting   {}, for room on the disk\n",
            counted(waiting.cast_unsigned(), "captured blade")
        );
    }
    if *lost > 0 {
        text +=
            &format!("lost      {} that found no room\n", counted(lost.cast_unsigned(), "captured blade"));
    }
    if *refused_files > 0 {
        text += &format!(
            "refused   {}; sward-capture blades list says why\n",
            counted(refused_files.cast_unsigned(), "file")
        );
    }
    text += &recording_lines(status);
    let file = status.config_file.as_ref().map_or(String::new(), |file| format!(", with {file}"));
    text + &format!("clients   {clients}\nconfig    {config}{file}\nversion   {version}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_the_rate_and_what_was_dropped_and_skipped_since_the_last() {
        let status = |frames, dropped_frames, skipped_frames| Status {
            state: "settling".to_owned(),
            blades: 3,
            frames,
            captures: 2,
            skipped_frames,
            dropped_frames,
            frames_per_second: 28.5,
            ..Status::at_start("a recording", "", "")
        };
        let before = status(100, 5, 1);
        let counts = "  2 captures  3 blades  store ok\n";
        let first = format!("settling    28.5 frames/s  100 frames  5 dropped  1 skipped{counts}");
        assert_eq!(status_line(&before, None), first);
        let next = format!("settling    28.5 frames/s  128 frames  7 (+2) dropped  1 skipped{counts}");
        assert_eq!(status_line(&status(128, 7, 1), Some(&before)), next);
        // A station that was started anew begins at 0.
        assert!(status_line(&status(1, 0, 0), Some(&before)).contains("0 dropped  0 skipped"));
    }

    #[test]
    fn a_time_is_a_date_of_utc() {
        assert_eq!(utc(1_700_000_001_033_333_323), "2023-11-14T22:13:21.033Z");
        assert_eq!(utc(0), "1970-01-01T00:00:00.000Z");
        assert_eq!(utc(-1), "1970-01-01T00:00:00.000Z");
        assert!(utc(i64::MAX).starts_with("2262-"));
    }
}
