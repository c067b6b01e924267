//! What the session sees, written to disk by a thread of its own: recordings that are asked for, and the last seconds
//! where something went wrong.
//!
//! Goals: a writer never holds up the frames: they wait in a queue that is bounded in number and bytes, and those that
//! find it full are dropped from the recording and counted by cause. What is on disk can be read up to the last second, however
//! the station or its disk ends ([`mod@file`]). A replay captures what the live run captured: a recording begins where a session
//! can begin, and holds what the session was told ([`crate::note`]). Non-goals: frames that the session never saw.
//!
//! ```text
//! frames ─► session          queue, ≤ 64 frames
//!    └────► Recorder ────────────────────────► Work ─► a file: chunks of half a second, synced
//!                                               └────► the ring: the last seconds, in memory ─► a file
//! ```

mod file;
mod ring;
mod shelf;
mod shot;
mod work;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use common::protocol::{self, StationError};
use tokio::sync::{oneshot, watch};

use crate::frame::DepthFrame;
use crate::note::Note;
use crate::session::Session;

pub(crate) use self::shelf::Limits;
pub(crate) use self::shot::{Shape, Shot};
pub(crate) use self::work::Work;

/// Frames that may wait for the disk.
const MAX_WAITING: usize = 64;
/// Bytes of these.
const MAX_WAITING_BYTES: usize = 64 << 20;
/// Other jobs that may wait.
const MAX_JOBS: usize = 64;

/// Where recordings go, and which are made unasked.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Settings {
    /// The folder; or the one file, of the verb `record`.
    pub(crate) target: Target,
    /// What is kept in the folder.
    pub(crate) limits: Limits,
    /// After how long a recording goes on in another file.
    pub(crate) file_span: Duration,
    /// Records from the first frame on.
    pub(crate) is_always: bool,
    /// How much is kept in memory to be saved later; none: nothing.
    pub(crate) ring: Option<RingSettings>,
    /// What of is saved unasked.
    pub(crate) save_on: Vec<Cause>,
    /// The sections of the configuration that a capture goes by, TOML.
    pub(crate) config: String,
}

/// What is written to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    /// Files in this folder.
    Folder(PathBuf),
    /// This file.
    File(PathBuf),
}

/// How much the ring holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RingSettings {
    /// How long a frame stays.
    pub(crate) span: Duration,
    /// Bytes at most.
    pub(crate) max_bytes: usize,
}

/// Why the ring is saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cause {
    /// Something that was held up was refused, or shows no blade.
    Refused,
    /// The sensor gives no frames.
    Sensor,
    /// The stages did not keep up with the sensor.
    Dropped,
    /// Somebody asked.
    #[serde(skip)]
    Asked,
}

impl Cause {
    /// What stands in the name of the file.
    fn name(self) -> &'static str {
        match self {
            Self::Refused => "refused",
            Self::Sensor => "sensor",
            Self::Dropped => "dropped",
            Self::Asked => "saved",
        }
    }
}

/// What the recorder says of itself.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub(crate) struct Told {
    /// Name of the recording that is being written or about to be.
    pub(crate) recording: Option<String>,
    /// Why nothing can be written at present.
    pub(crate) trouble: Option<String>,
    /// Frames that were written since the start.
    pub(crate) frames: u64,
    /// Frames that are missing since the disk or the processor is too slow.
    pub(crate) slow_frames: u64,
    /// Frames that are missing since the disk is full or broken.
    pub(crate) disk_frames: u64,
    /// Times that the ring was saved.
    pub(crate) saves: u64,
    /// Recordings that were begun and are over, or failed; of the verb `record` one.
    pub(crate) ended: u64,
}

/// How an order went.
pub(crate) type Reply<T> = oneshot::Sender<Result<T, StationError>>;

/// What comes to the recorder.
#[derive(Debug)]
pub(crate) enum Job {
    /// A frame.
    Shot(Shot),
    /// Record from now on; the name.
    Start(Reply<String>),
    /// No longer; the name, and how many frames the last file has.
    Stop(Reply<protocol::RecordingEnd>),
    /// Save the ring; its name.
    Save(Cause, Option<Reply<String>>),
    /// What there is.
    List(Reply<Vec<protocol::Recording>>),
    /// Have one stay, or no longer.
    Pin(String, bool, Reply<()>),
    /// Remove one.
    Remove(String, Reply<()>),
    /// The sensor's model and mode, and its serial number.
    Sensor(String, String),
    /// The station goes by another configuration: what a capture goes by, TOML.
    Config(String),
    /// Finish.
    End,
}

/// What both sides know.
#[derive(Debug, Default)]
struct Shared {
    /// Somebody wants frames at all.
    is_wanted: AtomicBool,
    /// A recording waits for a frame that a session can begin with.
    is_beginning: AtomicBool,
    waiting: AtomicUsize,
    waiting_bytes: AtomicUsize,
    slow_frames: AtomicU64,
}

/// The frame thread's side.
#[derive(Debug)]
pub(crate) struct Recorder {
    jobs: SyncSender<Job>,
    shared: Arc<Shared>,
    /// What the session was told since the last frame that went through.
    notes: Vec<Note>,
    dropped: u64,
    /// Waits for the disk, as nothing else waits for the frames.
    is_patient: bool,
}

/// What [`Work`] is given to do.
pub(crate) struct Inbox {
    jobs: Receiver<Job>,
    shared: Arc<Shared>,
}

/// Both ends of the queue. `is_patient`: a frame that finds it full waits.
pub(crate) fn queue(is_patient: bool) -> (Recorder, Inbox) {
    let (jobs, come) = sync_channel(MAX_WAITING + MAX_JOBS);
    let shared = Arc::new(Shared::default());
    let recorder = Recorder { jobs, shared: Arc::clone(&shared), notes: Vec::new(), dropped: 0, is_patient };
    (recorder, Inbox { jobs: come, shared })
}

impl Recorder {
    /// The queue, for orders.
    pub(crate) fn jobs(&self) -> SyncSender<Job> {
        self.jobs.clone()
    }

    /// What the session is told before the next frame.
    pub(crate) fn note(&mut self, note: Note) {
        if self.shared.is_wanted.load(Ordering::Relaxed) {
            self.notes.push(note);
        }
    }

    /// A frame that `session` is about to take. Where a recording is to begin in the midst of a hold, the hold begins anew.
    /// O(1), and waits for nothing.
    pub(crate) fn frame(&mut self, frame: &Arc<DepthFrame>, session: &mut Session) {
        let Shared { is_wanted, is_beginning, waiting, waiting_bytes, slow_frames } = &*self.shared;
        if !is_wanted.load(Ordering::Relaxed) {
            self.notes.clear();
            self.dropped = 0;
            return;
        }
        if session.checkpoint().is_none() && is_beginning.load(Ordering::Relaxed) {
            session.interrupt();
            self.notes.push(Note::Interrupted);
        }
        let bytes = 2 * frame.depth.len();
        let has_room = || {
            waiting.load(Ordering::Relaxed) < MAX_WAITING
                && waiting_bytes.load(Ordering::Relaxed) + bytes <= MAX_WAITING_BYTES
        };
        while self.is_patient && !has_room() {
            std::thread::sleep(Duration::from_millis(2));
        }
        if !has_room() {
            slow_frames.fetch_add(1, Ordering::Relaxed);
            self.dropped += 1;
            return;
        }
        if self.dropped > 0 {
            self.notes.push(Note::Dropped { frames: std::mem::take(&mut self.dropped) });
        }
        let notes = std::mem::take(&mut self.notes);
        let shot = Shot { notes, begins: session.checkpoint(), frame: Arc::clone(frame) };
        if shot.begins.is_some() {
            // Before it is in the queue: who wants another beginning once it was seen there says so later.
            is_beginning.store(false, Ordering::Relaxed);
        }
        waiting.fetch_add(1, Ordering::Relaxed);
        waiting_bytes.fetch_add(bytes, Ordering::Relaxed);
        // There is room for it beside all others, unless the thread is gone: then nothing waits.
        if self.jobs.try_send(Job::Shot(shot)).is_err() {
            waiting.fetch_sub(1, Ordering::Relaxed);
            waiting_bytes.fetch_sub(bytes, Ordering::Relaxed);
        }
    }

    /// Something went wrong: the last seconds are worth keeping, where the configuration says so.
    pub(crate) fn went_wrong(&self, cause: Cause) {
        self.tell(Job::Save(cause, None));
    }

    /// The sensor's model and mode, and its serial number.
    pub(crate) fn sensor(&self, name: &str, serial: &str) {
        self.tell(Job::Sensor(name.to_owned(), serial.to_owned()));
    }

    /// The station goes by another configuration.
    pub(crate) fn config(&mut self, toml: String) {
        self.note(Note::Config { toml: toml.clone() });
        self.tell(Job::Config(toml));
    }

    fn tell(&self, job: Job) {
        if let Err(TrySendError::Full(job)) = self.jobs.try_send(job) {
            tracing::debug!(?job, "the recorder is busy");
        }
    }
}

/// Where [`Work`] says how it is.
pub(crate) type Tell = watch::Sender<Told>;

#[cfg(test)]
mod tests;
