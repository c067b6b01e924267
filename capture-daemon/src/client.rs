//! The verbs that talk to a station that runs: `status`, `preview`, `reload` and `blades`.

use std::fmt::Write;
use std::future::Future;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context;
use common::protocol::{Blade, ListBladesReply, RefusedFile, ReloadReply, StationError, Status};
use common::sentence::print;
use common::station::StationProxy;
use serde::Serialize;

use crate::cli::{BladesVerb, ListArgs, StationArgs, StatusArgs};
use crate::config;

/// How long a station may take to answer.
const PATIENCE: Duration = Duration::from_secs(10);
/// How a closed connection shows when it is written to.
const HANGUPS: [ErrorKind; 2] = [ErrorKind::BrokenPipe, ErrorKind::ConnectionReset];

mod files;
mod preview;

pub use preview::preview;

/// Why a station did not do what was asked. One sentence without its full stop.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// Nobody listens.
    #[error(
        "{socket}: no station answers: {reason}; start one with sward-capture run, or name its socket with --socket"
    )]
    NoStation {
        /// The socket.
        socket: String,
        /// What the system said.
        reason: String,
    },
    /// It takes too long.
    #[error("{socket}: the station does not answer within {} s; see its log, or start it anew", PATIENCE.as_secs())]
    Silent {
        /// The socket.
        socket: String,
    },
    /// It closes the connection.
    #[error(
        "{socket}: the station hung up: it has as many connections as service.max_connections allows, or it is ending; try again"
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
    /// A file that was named is not what is needed.
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

/// How long it is waited for an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Patience {
    /// [`PATIENCE`].
    Short,
    /// For something new, which may never come.
    Endless,
}

/// A connection to a station, for calls that block.
struct Station {
    runtime: tokio::runtime::Runtime,
    connection: zlink::tokio::unix::Connection,
    socket: String,
}

impl Station {
    fn connect(args: &StationArgs) -> anyhow::Result<Self> {
        let socket = socket_of(args)?;
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .context("the runtime cannot be started")?;
        let shown = socket.display().to_string();
        let connected = runtime.block_on(patiently(&shown, connect(&socket)))?;
        let connection = connected
            .map_err(|error| ClientError::NoStation { socket: shown.clone(), reason: error.to_string() })?;
        Ok(Self { runtime, connection, socket: shown })
    }

    fn call<T>(
        &mut self,
        call: impl AsyncFnOnce(&mut zlink::tokio::unix::Connection) -> zlink::Result<Result<T, StationError>>,
    ) -> Result<T, ClientError> {
        self.call_with(Patience::Short, call)
    }

    fn call_with<T>(
        &mut self,
        patience: Patience,
        call: impl AsyncFnOnce(&mut zlink::tokio::unix::Connection) -> zlink::Result<Result<T, StationError>>,
    ) -> Result<T, ClientError> {
        let Self { runtime, connection, socket } = self;
        let answer = match patience {
            Patience::Short => runtime.block_on(patiently(socket, call(connection)))?,
            Patience::Endless => runtime.block_on(call(connection)),
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

async fn patiently<T>(socket: &str, future: impl Future<Output = T>) -> Result<T, ClientError> {
    let silent = |_| ClientError::Silent { socket: socket.to_owned() };
    tokio::time::timeout(PATIENCE, future).await.map_err(silent)
}

fn socket_of(args: &StationArgs) -> anyhow::Result<PathBuf> {
    match &args.socket {
        Some(socket) => Ok(socket.clone()),
        None => Ok(config::load(args.config.config.as_deref(), &args.config.sets)?.service.socket),
    }
}

/// `sward-capture status`.
///
/// # Errors
/// When no station answers, or stdout cannot be written.
pub fn status(args: &StatusArgs) -> anyhow::Result<()> {
    let mut station = Station::connect(&args.station)?;
    loop {
        let status = station.call(async |station| station.get_status().await)?.status;
        let text = if args.json {
            json(&status)?
        } else if args.watch {
            status_line(&status)
        } else {
            status_page(&status)
        };
        print(&text)?;
        if !args.watch {
            return Ok(());
        }
        std::thread::sleep(Duration::from_secs(1));
    }
}

/// `sward-capture reload`.
///
/// # Errors
/// When no station answers, it refuses, or stdout cannot be written.
pub fn reload(args: &StationArgs) -> anyhow::Result<()> {
    let ReloadReply { changed, restart } =
        Station::connect(args)?.call(async |station| station.reload().await)?;
    let mut text = String::new();
    for key in &changed {
        writeln!(text, "{key} is changed")?;
    }
    for key in &restart {
        writeln!(text, "{key} changes with the next start")?;
    }
    if text.is_empty() {
        text.push_str("nothing is changed\n");
    }
    Ok(print(&text)?)
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
        BladesVerb::Restore { name, station } => {
            change(station, async |station| station.restore_blade(name).await)
        }
        BladesVerb::Export { file, names, station } => files::export(file, names, station),
        BladesVerb::Import { file, name, length_mm, station } => {
            files::import(file, name.as_deref(), *length_mm, station)
        }
        BladesVerb::Mix { name, weight, station } => {
            if !(weight.is_finite() && *weight >= 0.0) {
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
    let ListBladesReply { blades, refused } =
        Station::connect(&args.station)?.call(async |station| station.list_blades().await)?;
    let blade = blades.iter().find(|blade| blade.name == name);
    let refused = refused.iter().find(|file| file.name == name);
    let blade = match (blade, refused) {
        (Some(blade), _) => blade,
        (None, Some(file)) => {
            return Err(
                ClientError::Refused(StationError::FileRefused { reason: file.reason.clone() }).into()
            );
        }
        (None, None) => {
            return Err(ClientError::Refused(StationError::NoSuchBlade { name: name.to_owned() }).into());
        }
    };
    if args.json {
        return Ok(print(&json(blade)?)?);
    }
    let mut text = String::new();
    writeln!(text, "name      {}", blade.name)?;
    writeln!(text, "id        {}", blade.id)?;
    writeln!(text, "kind      {}", blade.kind)?;
    writeln!(text, "length    {:.1} mm", blade.length_m * 1e3)?;
    writeln!(text, "width     {:.1} mm", blade.max_width_m * 1e3)?;
    writeln!(text, "knots     {}", blade.knots)?;
    writeln!(text, "quality   {}", blade.quality)?;
    writeln!(text, "mix       {}", blade.mix)?;
    writeln!(text, "pinned    {}", if blade.pinned { "yes" } else { "no" })?;
    writeln!(text, "captured  {} ns since 1970", blade.captured_unix_ns)?;
    writeln!(text, "source    {}", blade.source.as_deref().unwrap_or("made by hand"))?;
    if let Some(frames) = blade.frames {
        writeln!(text, "frames    {frames}")?;
    }
    if let Some(file) = refused {
        writeln!(text, "refused   {}", file.reason)?;
    }
    Ok(print(&text)?)
}

fn json(value: &impl Serialize) -> anyhow::Result<String> {
    Ok(serde_json::to_string(value).context("the reply cannot be written as JSON")? + "\n")
}

fn status_line(status: &Status) -> String {
    let Status { state, frames_per_second, frames, skipped_frames, captures, blades, store, .. } = status;
    format!(
        "{state:8}  {frames_per_second:6.1} frames/s  {frames} frames  {skipped_frames} skipped  {captures} captures  {blades} blades  store {store}\n"
    )
}

fn status_page(status: &Status) -> String {
    let Status { state, source, frames, skipped_frames, frames_per_second, captures, .. } = status;
    let Status { blades, generation, store, waiting, lost, refused_files, clients, config, version, .. } =
        status;
    let mut text = format!(
        "state     {state}\nsource    {source}\nframes    {frames} seen, {skipped_frames} skipped, {frames_per_second:.1} a second\n\
         captures  {captures}\nlibrary   {blades} blades, generation {generation}\nstore     {store}\n"
    );
    if *waiting > 0 {
        text += &format!("waiting   {waiting} captured blades, for room on the disk\n");
    }
    if *lost > 0 {
        text += &format!("lost      {lost} captured blades that found no room\n");
    }
    if *refused_files > 0 {
        text += &format!("refused   {refused_files} files; sward-capture blades list names them\n");
    }
    text + &format!("clients   {clients}\nconfig    {config}\nversion   {version}\n")
}
