//! The verb `run`: frames on one thread, the store on another, the service here; and how they begin,
//! take another configuration, and end.

use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::Context;
use common::protocol::{ReloadReply, StationError, Status};
use common::sentence::counted;
use sd_notify::NotifyState;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::{mpsc as async_mpsc, oneshot, watch};

use crate::cli::ConfigArgs;
use crate::config::{self, Config};
use crate::frames::{self, FrameOrder, Frames, NewParams, Outlets, open_source};
use crate::keeper::{self, Announcements, Holdings, Job, Keeper, Outcome};
use crate::recorder::{self, Told, Work};
use crate::service::{Access, Previews, ReloadOrder, Service, Socket, passed_socket};
use crate::store::Store;

/// How often systemd's status line is brought up to date.
const STATUS_EVERY: Duration = Duration::from_secs(2);

/// How long after a SIGHUP the configuration is read, so that many of them are one.
const HANG_UP_QUIET: Duration = Duration::from_millis(50);

/// Runs the station until SIGTERM or SIGINT; a second signal ends it at once.
///
/// # Errors
/// A configuration that is not valid; the socket or the state directory in use; a recording that is to
/// be the sensor and cannot be opened.
pub fn run(args: &ConfigArgs) -> anyhow::Result<()> {
    let config = config::load(args.config.as_deref(), &args.sets)?;
    let passed = passed_socket()?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .context("the service's runtime cannot be started")?;
    tokio::task::LocalSet::new().block_on(&runtime, serve(args, config, passed))
}

fn heed(kind: SignalKind, name: &str) -> anyhow::Result<Signal> {
    signal(kind).with_context(|| format!("{name} cannot be handled"))
}

/// The signals that end the station.
struct EndSignals {
    terminate: Signal,
    interrupt: Signal,
}

impl EndSignals {
    /// From now on the second of these signals ends the process at once, whatever its threads wait for.
    fn new() -> anyhow::Result<Self> {
        let is_asked = Arc::new(AtomicBool::new(false));
        for kind in [SIGTERM, SIGINT] {
            // In this order: the signal that sets the flag does not find it set.
            flag::register_conditional_shutdown(kind, 1, Arc::clone(&is_asked))
                .and_then(|_| flag::register(kind, Arc::clone(&is_asked)))
                .context("the signals that end the station cannot be handled")?;
        }
        let terminate = heed(SignalKind::terminate(), "SIGTERM")?;
        Ok(Self { terminate, interrupt: heed(SignalKind::interrupt(), "SIGINT")? })
    }

    /// Which of them came.
    async fn next(&mut self) -> &'static str {
        tokio::select! { _ = self.terminate.recv() => "SIGTERM", _ = self.interrupt.recv() => "SIGINT" }
    }
}

/// A thread, and how one hears of its end.
struct Worker {
    thread: JoinHandle<()>,
    ended: oneshot::Receiver<()>,
}

impl Worker {
    fn start(name: &str, work: impl FnOnce() + Send + 'static) -> anyhow::Result<Self> {
        let (alive, ended) = oneshot::channel::<()>();
        let thread = std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            // Dropped at its end, also by a panic.
            let _alive = alive;
            work();
        });
        let thread = thread.with_context(|| format!("the thread of the {name} cannot be started"))?;
        Ok(Self { thread, ended })
    }

    async fn join(self) -> bool {
        let joined = tokio::task::spawn_blocking(move || self.thread.join()).await;
        matches!(joined, Ok(Ok(())))
    }
}

async fn serve(args: &ConfigArgs, config: Config, passed: Option<UnixListener>) -> anyhow::Result<()> {
    let mut ends = EndSignals::new()?;
    let mut hang_up = heed(SignalKind::hangup(), "SIGHUP")?;
    let source = open_source(&config)?;
    let socket = listen(passed, &config).await?;
    let folder = store_folder(&config);
    let store = open_store(&folder, &config).await?;

    let (library, library_seen) = watch::channel(None);
    let (holdings, holdings_seen) = watch::channel(Arc::new(Holdings::default()));
    let description = source.as_ref().map_or_else(|| "none".to_owned(), |source| source.describe());
    let config_file =
        args.config.as_deref().map(|file| file.canonicalize().unwrap_or_else(|_| file.to_path_buf()));
    let (status, status_seen) = watch::channel(Status {
        config_file: config_file.map(|file| file.display().to_string()),
        ..Status::at_start(&description, &config.capture_hash(), env!("CARGO_PKG_VERSION"))
    });
    let (looks, looks_seen) = watch::channel(None);
    let (access, access_seen) = watch::channel(access_of(&config));
    let (jobs, jobs_come) = mpsc::sync_channel(keeper::QUEUE);
    let (orders, orders_come) = mpsc::sync_channel(frames::QUEUE);
    let (reload, mut reloads_come) = async_mpsc::channel::<ReloadOrder>(4);

    let (recorder, inbox) = recorder::queue(false);
    let (tell, recording) = watch::channel(Told::default());
    let record_jobs = recorder.jobs();
    let work = Work::new(config.recorder_settings(&folder), &description, inbox, tell);
    let mut work = Worker::start("recorder", move || work.run())?;
    let mut keeper = Keeper::new(store, Announcements { library, holdings }, jobs.clone());
    keeper.begin();
    let mut keeper = Worker::start("store", move || keeper.run(&jobs_come))?;
    let stop = Arc::new(AtomicBool::new(false));
    let outlets = Outlets { status, looks, keeper: jobs.clone(), recorder };
    let frames = Frames::new(&config, outlets, holdings_seen.clone(), orders_come, Arc::clone(&stop));
    let mut frames = Worker::start("frames", move || frames.run(source))?;

    let service = Service {
        library: library_seen,
        holdings: holdings_seen,
        status: status_seen,
        previews: Previews::new(looks_seen),
        access: access_seen,
        keeper: jobs.clone(),
        frames: orders.clone(),
        reload,
        recorder: record_jobs.clone(),
        recording,
        clients: Arc::default(),
    };
    let overview = service.clone();
    let limit = config.service.max_connections;
    let shown = socket.path().display().to_string();
    tracing::info!(
        socket = shown,
        source = overview.status().source,
        blades = overview.status().blades,
        "ready"
    );
    tell_systemd(&[NotifyState::Ready, NotifyState::Status(&line(&overview.status()))]);

    let mut reloader = Reloader { args, config, access, orders };
    let mut said = String::new();
    let mut reload_at = None;
    let mut ticks = tokio::time::interval(STATUS_EVERY);
    let serving = socket.serve(service, limit);
    tokio::pin!(serving);
    let failed = loop {
        tokio::select! {
            () = &mut serving => break None,
            name = ends.next() => {
                tracing::info!("{name}: ending");
                break None;
            }
            // Of many signals in a row one counts, and one that comes while that is done counts again.
            _ = hang_up.recv() => reload_at = reload_at.or_else(|| Some(Instant::now() + HANG_UP_QUIET)),
            () = until(reload_at) => {
                // Told in the log; whoever wants to know calls Reload.
                let is_busy = matches!(reloader.reload(), Err(StationError::Busy));
                reload_at = is_busy.then(|| Instant::now() + HANG_UP_QUIET);
            }
            Some(asked) = reloads_come.recv() => {
                let _ = asked.send(reloader.reload());
            }
            _ = ticks.tick() => {
                let line = line(&overview.status());
                if line != said {
                    tell_systemd(&[NotifyState::Status(&line)]);
                    said = line;
                }
            }
            _ = &mut frames.ended => break Some("frames"),
            _ = &mut keeper.ended => break Some("store"),
            _ = &mut work.ended => break Some("recorder"),
        }
    };
    tell_systemd(&[NotifyState::Stopping]);
    stop.store(true, Ordering::Relaxed);
    let frames = frames.join().await;
    // The keeper empties its queue: what was captured before the end is kept.
    let stopped = tokio::task::spawn_blocking(move || jobs.send(Job::Stop)).await;
    let keeper = keeper.join().await && stopped.is_ok();
    // What was recorded gets its end.
    let ended = tokio::task::spawn_blocking(move || record_jobs.send(recorder::Job::End)).await;
    let work = work.join().await && ended.is_ok();
    if let Some(thread) = failed {
        anyhow::bail!("the thread of the {thread} ended by itself; see the log above");
    }
    anyhow::ensure!(frames && keeper && work, "a thread panicked; see the log above");
    Ok(())
}

/// Waits until then; without a moment, for ever.
async fn until(moment: Option<Instant>) {
    match moment {
        Some(moment) => tokio::time::sleep_until(moment.into()).await,
        None => std::future::pending().await,
    }
}

async fn listen(passed: Option<UnixListener>, config: &Config) -> anyhow::Result<Socket> {
    let wanted = &config.service.socket;
    let Some(passed) = passed else {
        return Ok(Socket::bind(wanted, config.service.socket_mode).await?);
    };
    let socket = Socket::of_passed(passed)?;
    if socket.path() != wanted {
        tracing::warn!(
            passed = %socket.path().display(),
            configured = %wanted.display(),
            "systemd passes another socket than service.socket, where status, reload and blades will look for it"
        );
    }
    Ok(socket)
}

/// The state directory.
fn store_folder(config: &Config) -> PathBuf {
    config.store.folder(std::env::var("STATE_DIRECTORY").ok().as_deref())
}

async fn open_store(folder: &Path, config: &Config) -> anyhow::Result<Store> {
    make_way_to(folder, std::env::var("STATE_DIRECTORY").ok().as_deref());
    let folder = folder.to_owned();
    let archive_max = config.store.archive_max;
    let now_us = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |now| now.as_micros() as u64);
    let opened = tokio::task::spawn_blocking(move || Store::open(&folder, now_us, archive_max)).await;
    Ok(opened.context("the store cannot be opened")??)
}

/// Within the folders that systemd gave us for our state (`given`: `$STATE_DIRECTORY`), those around the store's own are
/// made as well; elsewhere the store makes its own folder alone.
fn make_way_to(folder: &Path, given: Option<&str>) {
    let is_ours = given.unwrap_or_default().split(':').any(|own| !own.is_empty() && folder.starts_with(own));
    if let Some(around) = folder.parent().filter(|_| is_ours)
        && let Err(error) = std::fs::create_dir_all(around)
    {
        // The store says what comes of it.
        tracing::debug!(%error, "the folders around the store cannot be made");
    }
}

fn access_of(config: &Config) -> Arc<Access> {
    Arc::new(Access::new(&config.service.watch, &config.service.change))
}

/// Status as systemd shows it.
fn line(status: &Status) -> String {
    let Status { state, blades, captures, frames_per_second, store, .. } = status;
    let counts = format!(
        "{}, {}",
        counted(blades.cast_unsigned(), "blade"),
        counted(captures.cast_unsigned(), "capture")
    );
    let trouble = if store == "ok" { String::new() } else { format!("; the store is in trouble: {store}") };
    format!("{state}; {counts}, {frames_per_second} frames a second{trouble}")
}

fn tell_systemd(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::debug!(%error, "systemd cannot be told");
    }
}

/// Takes another configuration while the station runs.
struct Reloader<'a> {
    args: &'a ConfigArgs,
    config: Config,
    access: watch::Sender<Arc<Access>>,
    orders: mpsc::SyncSender<FrameOrder>,
}

impl Reloader<'_> {
    /// Reads the configuration again; when it is valid, the frame thread goes by it from its next frame
    /// on.
    fn reload(&mut self) -> Outcome<ReloadReply> {
        let mut reloading = vec![NotifyState::Reloading];
        reloading.extend(NotifyState::monotonic_usec_now());
        tell_systemd(&reloading);
        let outcome = self.swap();
        match &outcome {
            Ok(ReloadReply { changed, restart }) => {
                tracing::info!(changed = changed.join(", "), restart = restart.join(", "), "reloaded");
            }
            Err(error) => tracing::error!(%error, "the configuration is not taken; the old one stays"),
        }
        tell_systemd(&[NotifyState::Ready]);
        outcome
    }

    fn swap(&mut self) -> Outcome<ReloadReply> {
        let new = config::load(self.args.config.as_deref(), &self.args.sets)
            .map_err(|error| StationError::InvalidConfig { reason: error.to_string() })?;
        let (changed, restart): (Vec<String>, Vec<String>) =
            self.config.differences(&new).into_iter().partition(|key| Config::is_live(key));
        // What needs a restart is named again at the next reload.
        let before = self.config.clone();
        let config::ServiceConfig { watch, change, .. } = new.service.clone();
        let config::CameraConfig { tilt_rad, roll_rad, .. } = new.camera;
        let now = Config {
            source: before.source,
            sensor: before.sensor,
            store: before.store,
            record: before.record,
            service: config::ServiceConfig { watch, change, ..before.service },
            camera: config::CameraConfig { tilt_rad, roll_rad, ..before.camera },
            ..new
        };
        let (session, hash, toml) = (now.session_params(), now.capture_hash(), now.capture_toml());
        let order = FrameOrder::Params(Box::new(NewParams { session, hash, toml }));
        self.orders.try_send(order).map_err(|_| StationError::Busy)?;
        self.access.send_replace(access_of(&now));
        self.config = now;
        Ok(ReloadReply { changed, restart })
    }
}
