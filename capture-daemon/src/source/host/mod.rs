//! A live sensor in a process of its own. A driver that hangs, crashes or leaks cannot take the station with it: its
//! process is killed and started again.
//!
//! The process is this same program with a verb that help does not show; its standard input is a socket, over which
//! each frame comes as a sealed memfd. It dies with the thread that started it.
//!
//! ```text
//!  start ─► opened ─► frame ─► frame ─► …
//!    ▲        │         │
//!    │        └─────────┴──► nothing for sensor.deadline_s, an end, a failure ─► killed
//!    └── after half a second, one, two … up to a minute ◄───────────────────────────┘
//! ```
//!
//! A sensor that is not there is waited for by a process that lives, which hears of it at once when it is plugged in;
//! that process, too, is replaced after the same waits, since a driver may have lost sight of its bus.

mod backoff;
mod health;
mod message;
mod process;
mod worker;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use self::backoff::Backoff;
pub(crate) use self::health::{Fares, Health};
pub(crate) use self::message::Message;
pub(crate) use self::process::{Process, ReceiveError};
pub use self::worker::work;
pub(crate) use self::worker::{Closed, Link};
use super::{FrameSource, SourceError};
use crate::config::{Config, SensorConfig};
use crate::frame::{CameraModel, DepthFrame};

/// This very program, also after its file was replaced.
const OWN_PROGRAM: &str = "/proc/self/exe";

/// What a sensor process is to do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) enum Task {
    /// Stream the sensor.
    Stream,
    /// Play a recording, each frame once, as fast as frames are taken.
    Play {
        /// Where it is.
        path: PathBuf,
        /// How many frames it has, where it does not say so itself.
        frames: Option<u64>,
    },
    /// List the devices.
    List,
}

/// What a sensor process is told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Order {
    /// fx, fy, cx and cy that replace what the sensor says, pixels.
    pub(crate) camera: Option<[f64; 4]>,
    /// What to do.
    pub(crate) task: Task,
    /// Which sensor, and how.
    pub(crate) sensor: SensorConfig,
}

impl Order {
    /// The camera that is given.
    pub(crate) fn camera(&self) -> Option<CameraModel> {
        self.camera.map(|[fx, fy, cx, cy]| CameraModel { fx, fy, cx, cy })
    }

    fn to_text(&self) -> String {
        toml::to_string(self).expect("numbers, texts and paths in UTF-8 can be written as TOML")
    }
}

/// Starts a process that does what it is told. `program`: `sward-capture`, where this is another.
///
/// # Errors
/// When there is no room for another process.
pub(crate) fn start(program: Option<&Path>, order: &Order) -> std::io::Result<Process> {
    Process::start(program.unwrap_or(Path::new(OWN_PROGRAM)), &order.to_text())
}

/// A live sensor.
#[derive(Debug)]
pub struct SensorSource {
    order: Order,
    deadline: Duration,
    program: Option<PathBuf>,
    process: Option<Process>,
    /// When to start the next one.
    due: Option<Instant>,
    /// When it last said something.
    heard: Instant,
    /// Until when it may wait for the sensor.
    missing_until: Option<Instant>,
    /// Since when its frames come.
    streams_since: Option<Instant>,
    backoff: Backoff,
    health: Arc<Health>,
}

impl SensorSource {
    /// The sensor that the configuration names. It is opened when its first frame is asked for. `program`:
    /// `sward-capture`, where this is another.
    pub fn new(config: &Config, program: Option<&Path>) -> Self {
        let camera = config.camera_model().map(|CameraModel { fx, fy, cx, cy }| [fx, fy, cx, cy]);
        let sensor = config.sensor.clone();
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |now| now.as_nanos() as u64);
        Self {
            deadline: Duration::from_secs_f64(sensor.deadline_s),
            order: Order { task: Task::Stream, camera, sensor },
            program: program.map(Path::to_owned),
            process: None,
            due: None,
            heard: Instant::now(),
            missing_until: None,
            streams_since: None,
            backoff: Backoff::new(now ^ u64::from(std::process::id())),
            health: Arc::default(),
        }
    }

    /// Kills the process; the next one is started after `wait`.
    fn interrupt(&mut self, reason: String, wait: Duration) -> SourceError {
        self.process = None;
        (self.missing_until, self.streams_since) = (None, None);
        self.due = Some(Instant::now() + wait);
        self.health.interrupted(&reason);
        SourceError::Interrupted(reason)
    }

    /// Starts the process, once it is time to.
    fn started(&mut self) -> Result<&mut Process, SourceError> {
        if self.process.is_none() {
            if let Some(due) = self.due.take() {
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
            self.health.count_start();
            match start(self.program.as_deref(), &self.order) {
                Ok(process) => {
                    self.heard = Instant::now();
                    self.process = Some(process);
                }
                Err(error) => {
                    let wait = self.backoff.wait();
                    return Err(
                        self.interrupt(format!("the sensor process cannot be started: {error}"), wait)
                    );
                }
            }
        }
        Ok(self.process.as_mut().expect("it was started above"))
    }

    /// What to make of a message: a frame or an error to tell, or nothing.
    fn take(&mut self, message: Message) -> Option<Result<DepthFrame, SourceError>> {
        self.heard = Instant::now();
        match message {
            Message::Opened(name) => {
                tracing::info!(sensor = name, "the sensor is open");
                self.health.opened(&name);
                self.missing_until = None;
                None
            }
            Message::Frame(frame) => {
                let since = *self.streams_since.get_or_insert(self.heard);
                if self.heard - since >= self.deadline {
                    self.backoff.reset();
                }
                self.health.streams();
                Some(Ok(frame))
            }
            Message::Serial(serial) => {
                self.health.has_serial(&serial);
                None
            }
            Message::Bad(reason) => Some(Err(SourceError::BadFrame(reason))),
            Message::Lost(frames) => {
                self.health.count_lost(frames);
                None
            }
            Message::Missing(reason) if self.missing_until.is_none() => {
                self.missing_until = Some(Instant::now() + self.backoff.wait());
                self.health.interrupted(&reason);
                Some(Err(SourceError::Interrupted(reason)))
            }
            Message::Missing(_) | Message::Devices(_) => None,
            Message::End => self.failed("the sensor's recording is over".to_owned()),
            Message::Failed(reason) => self.failed(reason),
        }
    }

    #[expect(clippy::unnecessary_wraps, reason = "an arm of what to tell")]
    fn failed(&mut self, reason: String) -> Option<Result<DepthFrame, SourceError>> {
        self.health.count_failure();
        let wait = self.backoff.wait();
        Some(Err(self.interrupt(reason, wait)))
    }

    /// When nothing came until now: whether that was too long.
    fn overdue(&mut self) -> Option<SourceError> {
        let now = Instant::now();
        if now.saturating_duration_since(self.heard) >= self.deadline {
            self.health.count_silence();
            let wait = self.backoff.wait();
            let seconds = self.deadline.as_secs_f64();
            return Some(self.interrupt(format!("the sensor gave no frame for {seconds} s"), wait));
        }
        if self.missing_until.is_some_and(|until| now >= until) {
            // The next one looks for it at once.
            self.process = None;
            self.missing_until = None;
        }
        None
    }
}

impl FrameSource for SensorSource {
    fn describe(&self) -> String {
        let SensorConfig { driver, device, .. } = &self.order.sensor;
        let driver = driver.map_or("sensor", |driver| driver.name());
        device.as_ref().map_or_else(|| driver.to_owned(), |device| format!("{driver} {device}"))
    }

    fn health(&self) -> Option<Arc<Health>> {
        Some(Arc::clone(&self.health))
    }

    fn next_frame(&mut self) -> Result<DepthFrame, SourceError> {
        loop {
            let mut due = self.heard + self.deadline;
            if let Some(until) = self.missing_until {
                due = due.min(until);
            }
            let is_new = self.process.is_none();
            let deadline = self.deadline;
            let process = self.started()?;
            let wait = if is_new { deadline } else { due.saturating_duration_since(Instant::now()) };
            match process.receive(wait) {
                Ok(message) => {
                    if let Some(given) = self.take(message) {
                        return given;
                    }
                }
                Err(ReceiveError::BadFrame(reason)) => {
                    self.heard = Instant::now();
                    return Err(SourceError::BadFrame(reason));
                }
                Err(ReceiveError::Silent) => {}
                Err(error) => {
                    self.health.count_death();
                    let wait = self.backoff.wait();
                    return Err(self.interrupt(error.to_string(), wait));
                }
            }
            if let Some(error) = self.overdue() {
                return Err(error);
            }
        }
    }
}
