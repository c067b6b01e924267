//! The recorder's thread: it owns the folder, the file that is being written, and the ring.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::RecvTimeoutError;
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use common::protocol::{self, StationError};

use super::file::{RecordingFile, Written, remove};
use super::ring::{Packed, Ring};
use super::shelf::{Kept, Shelf};
use super::{Cause, Inbox, Job, Reply, Settings, Shot, Target, Tell, Told};
use crate::recording::{RecordingParams, WriteError};

/// The thread looks at its clock at least so often.
const TICK: Duration = Duration::from_millis(100);
/// How often it looks at the room on the disk, and tries a disk again that refuses.
const TIDY_EVERY: Duration = Duration::from_secs(1);
/// How hard it compresses (zstd): as little as helps, since frames come faster than a busy processor does more.
const LEVEL: u32 = 1;
/// Room beyond the reserve, bytes, for which it is worth to begin again.
const LEAST_ROOM: u64 = 1_000_000;

/// The recorder's thread.
pub(crate) struct Work {
    settings: Settings,
    inbox: Inbox,
    tell: Tell,
    told: Told,
    /// `None`: there is one file alone.
    shelf: Option<Shelf>,
    is_recording: bool,
    /// The disk refused, and is tried again.
    is_paused: bool,
    /// Frames in files that are over.
    ended_frames: u64,
    /// Where the next recording goes, as it was told.
    next_path: Option<PathBuf>,
    open: Option<RecordingFile>,
    ring: Option<Ring>,
    save_on: HashSet<Cause>,
    saving: Option<Saving>,
    saved_at: Option<Instant>,
    sensor: String,
    serial: String,
    config: String,
    tidy_at: Instant,
}

/// The ring on its way to disk.
struct Saving {
    path: PathBuf,
    thread: JoinHandle<()>,
}

impl Work {
    /// `source`: what the frames come from, as long as no sensor tells its name.
    pub(crate) fn new(settings: Settings, source: &str, inbox: Inbox, tell: Tell) -> Self {
        let shelf = match &settings.target {
            Target::Folder(folder) => Some(Shelf::new(folder.clone(), settings.limits)),
            Target::File(_) => None,
        };
        let ring = settings.ring.map(|ring| Ring::new(ring.span, ring.max_bytes));
        let is_recording = settings.is_always;
        inbox.shared.is_wanted.store(is_recording || ring.is_some(), Ordering::Relaxed);
        inbox.shared.is_beginning.store(is_recording, Ordering::Relaxed);
        Self {
            inbox,
            tell,
            told: Told::default(),
            shelf,
            is_recording,
            is_paused: false,
            ended_frames: 0,
            next_path: None,
            open: None,
            ring,
            save_on: settings.save_on.iter().copied().collect(),
            saving: None,
            saved_at: None,
            sensor: source.to_owned(),
            serial: String::new(),
            config: settings.config.clone(),
            tidy_at: Instant::now(),
            settings,
        }
    }

    /// Does what comes until it is told to stop; then it ends what it writes.
    pub(crate) fn run(mut self) {
        self.publish();
        loop {
            match self.inbox.jobs.recv_timeout(TICK) {
                Ok(Job::End) | Err(RecvTimeoutError::Disconnected) => break,
                Ok(job) => self.take(job),
                Err(RecvTimeoutError::Timeout) => {}
            }
            self.tick(Instant::now());
            self.publish();
        }
        self.end_file();
        if let Some(saving) = self.saving.take() {
            // It tells by itself how that went.
            let _ = saving.thread.join();
        }
        self.publish();
    }

    fn take(&mut self, job: Job) {
        match job {
            Job::Shot(shot) => self.shot(&shot),
            Job::Start(reply) => answer(reply, self.start()),
            Job::Stop(reply) => answer(reply, self.stop()),
            Job::Save(cause, reply) => self.save(cause, reply),
            Job::List(reply) => answer(reply, Ok(self.list())),
            Job::Pin(name, pinned, reply) => answer(reply, self.pin(&name, pinned)),
            Job::Remove(name, reply) => answer(reply, self.remove(&name)),
            Job::Sensor(name, serial) => (self.sensor, self.serial) = (name, serial),
            Job::Config(config) => self.config = config,
            Job::End => {}
        }
    }

    fn publish(&mut self) {
        self.told.frames = self.ended_frames + self.open.as_ref().map_or(0, |open| open.frames().0);
        self.told.slow_frames = self.inbox.shared.slow_frames.load(Ordering::Relaxed);
        let about_to_be = || {
            self.next_path.as_deref().or(match &self.settings.target {
                Target::File(path) => Some(path),
                Target::Folder(_) => None,
            })
        };
        let path = self.open.as_ref().map(RecordingFile::path).or_else(about_to_be);
        self.told.recording = self.is_recording.then(|| path.map_or_else(|| "begins".to_owned(), name_of));
        let told = self.told.clone();
        self.tell.send_if_modified(|before| {
            let is_other = *before != told;
            *before = told;
            is_other
        });
    }

    fn shot(&mut self, shot: &Shot) {
        let shared = &self.inbox.shared;
        shared.waiting.fetch_sub(1, Ordering::Relaxed);
        shared.waiting_bytes.fetch_sub(2 * shot.frame.depth.len(), Ordering::Relaxed);
        let now = Instant::now();
        if let Some(ring) = &mut self.ring
            && let Err(error) = ring.push(shot, now)
        {
            tracing::debug!(%error, "a frame finds no room among the last seconds");
        }
        if self.is_recording {
            self.record(shot, now);
        }
    }

    fn record(&mut self, shot: &Shot, now: Instant) {
        if self.is_paused {
            self.told.disk_frames += 1;
            return;
        }
        if let Some(open) = &self.open {
            let is_full = open.age(now) >= self.settings.file_span && shot.begins.is_some();
            if !open.fits(shot) || is_full {
                self.end_file();
            }
        }
        if self.open.is_none() {
            if shot.begins.is_none() {
                return;
            }
            match self.begin(shot, now) {
                Ok(open) => self.open = Some(open),
                Err(reason) => {
                    self.told.disk_frames += 1;
                    return self.fail(reason);
                }
            }
        }
        let Some(open) = &mut self.open else { return };
        match open.write(shot, now) {
            Ok(()) => {
                // What was begun may still fail; what is on disk shows that it is mended.
                if open.frames().0 > 0 && self.told.trouble.take().is_some() {
                    tracing::info!("it is recorded again");
                }
            }
            Err(error) => self.fail(error.to_string()),
        }
    }

    fn begin(&mut self, shot: &Shot, now: Instant) -> Result<RecordingFile, String> {
        let path = match (&self.shelf, &self.settings.target) {
            (Some(shelf), _) => {
                make_room(shelf, &self.busy(), 0)?;
                self.next_path.take().unwrap_or_else(|| shelf.path_for(SystemTime::now(), None))
            }
            (None, Target::File(_)) if self.told.ended > 0 => {
                return Err(
                    "the sensor goes on in another mode, and a recording has one; record it anew".to_owned()
                );
            }
            (None, Target::File(path) | Target::Folder(path)) => path.clone(),
        };
        let open =
            RecordingFile::create(&path, self.params(), shot, now).map_err(|error| error.to_string())?;
        tracing::info!(path = %path.display(), "recording");
        Ok(open)
    }

    fn params(&self) -> RecordingParams {
        let (sensor, serial, config) = (self.sensor.clone(), self.serial.clone(), self.config.clone());
        let compression_level = LEVEL;
        RecordingParams { sensor, serial, config, compression_level, ..RecordingParams::default() }
    }

    /// The file is over; what was written, if there is one.
    fn end_file(&mut self) -> Option<Written> {
        let open = self.open.take()?;
        self.told.ended += 1;
        let path = open.path().display().to_string();
        let (synced, unsynced) = open.frames();
        match open.finish() {
            Ok(written) => {
                self.ended_frames += written.frames;
                tracing::info!(path, frames = written.frames, bytes = written.bytes, "recorded");
                Some(written)
            }
            Err(error) => {
                self.ended_frames += synced;
                self.told.disk_frames += unsynced;
                self.trouble(format!("{path} is cut short: {error}"));
                None
            }
        }
    }

    /// Nothing can be written at present.
    fn fail(&mut self, reason: String) {
        if let Some(open) = self.open.take() {
            let (synced, unsynced) = open.frames();
            self.ended_frames += synced;
            self.told.disk_frames += unsynced;
            self.told.ended += 1;
            open.salvage();
        }
        self.trouble(reason);
    }

    fn trouble(&mut self, reason: String) {
        if self.told.trouble.is_none() {
            tracing::error!(reason, "nothing can be recorded at present; it goes on when that is mended");
        }
        self.told.trouble = Some(reason);
        self.is_paused = true;
        self.tidy_at = Instant::now() + TIDY_EVERY;
    }

    fn tick(&mut self, now: Instant) {
        if let Some(open) = &mut self.open
            && let Err(error) = open.end_chunk_if_due(now)
        {
            self.fail(error.to_string());
        }
        if self.saving.as_ref().is_some_and(|saving| saving.thread.is_finished()) {
            self.saving = None;
        }
        if now < self.tidy_at || !self.is_recording {
            return;
        }
        self.tidy_at = now + TIDY_EVERY;
        let Some(shelf) = &self.shelf else { return };
        // So that it does not begin for a moment only.
        let reserve = self.settings.limits.reserve_bytes;
        let spare = if self.told.trouble.is_some() { (reserve / 10).max(LEAST_ROOM) } else { 0 };
        match make_room(shelf, &self.busy(), spare) {
            Ok(()) => {
                if std::mem::take(&mut self.is_paused) {
                    self.inbox.shared.is_beginning.store(true, Ordering::Relaxed);
                }
            }
            Err(reason) => {
                // As long as there is room for its end.
                self.end_file();
                self.trouble(reason);
            }
        }
    }

    /// Files that are being written.
    fn busy(&self) -> Vec<PathBuf> {
        let open = self.open.as_ref().map(|open| open.path().to_owned());
        open.into_iter().chain(self.saving.as_ref().map(|saving| saving.path.clone())).collect()
    }

    fn start(&mut self) -> Result<String, StationError> {
        let trouble = |reason| StationError::RecordingTrouble { reason };
        if self.is_recording {
            return Err(StationError::BeingWritten { name: self.told.recording.clone().unwrap_or_default() });
        }
        let Some(shelf) = &self.shelf else { return Err(StationError::Busy) };
        make_room(shelf, &self.busy(), 0).map_err(trouble)?;
        let path = shelf.path_for(SystemTime::now(), None);
        let name = name_of(&path);
        self.next_path = Some(path);
        self.is_recording = true;
        self.is_paused = false;
        self.told.trouble = None;
        self.inbox.shared.is_wanted.store(true, Ordering::Relaxed);
        self.inbox.shared.is_beginning.store(true, Ordering::Relaxed);
        Ok(name)
    }

    fn stop(&mut self) -> Result<protocol::RecordingEnd, StationError> {
        if !self.is_recording {
            return Err(StationError::NotRecording);
        }
        self.publish();
        let name = self.told.recording.clone().unwrap_or_default();
        self.is_recording = false;
        self.is_paused = false;
        self.inbox.shared.is_wanted.store(self.ring.is_some(), Ordering::Relaxed);
        self.inbox.shared.is_beginning.store(false, Ordering::Relaxed);
        self.next_path = None;
        let was_open = self.open.is_some();
        let written = self.end_file();
        let trouble = self.told.trouble.take();
        match (written, trouble) {
            (Some(Written { frames, bytes }), _) => {
                Ok(protocol::RecordingEnd { name, frames: frames.cast_signed(), bytes: bytes.cast_signed() })
            }
            (None, Some(reason)) => Err(StationError::RecordingTrouble { reason }),
            (None, None) => {
                debug_assert!(!was_open, "a file that ends says how");
                Ok(protocol::RecordingEnd { name, frames: 0, bytes: 0 })
            }
        }
    }

    fn save(&mut self, cause: Cause, reply: Option<Reply<String>>) {
        let is_asked = reply.is_some();
        let is_soon = || {
            let span = self.settings.ring.map_or(Duration::ZERO, |ring| ring.span);
            self.saved_at.is_some_and(|saved| saved.elapsed() < span)
        };
        if !is_asked && (!self.save_on.contains(&cause) || is_soon()) {
            return;
        }
        match self.begin_saving(cause) {
            Ok((path, frames)) => {
                if !is_asked {
                    self.saved_at = Some(Instant::now());
                }
                self.told.saves += 1;
                let (params, to) = (self.params(), path.clone());
                let work = move || {
                    let outcome = write_all(&to, params, &frames);
                    match &outcome {
                        Ok(()) => {
                            tracing::info!(path = %to.display(), frames = frames.len(), "the last seconds are saved")
                        }
                        Err(error) => tracing::error!(%error, "the last seconds cannot be saved"),
                    }
                    if let Some(reply) = reply {
                        let trouble =
                            |error: WriteError| StationError::RecordingTrouble { reason: error.to_string() };
                        answer(reply, outcome.map(|()| name_of(&to)).map_err(trouble));
                    }
                };
                match std::thread::Builder::new().name("save".to_owned()).spawn(work) {
                    Ok(thread) => self.saving = Some(Saving { path, thread }),
                    Err(error) => tracing::error!(%error, "the last seconds cannot be saved"),
                }
            }
            Err(error) => match reply {
                Some(reply) => answer(reply, Err(error)),
                // As at the start, when there was nothing yet.
                None if error == StationError::NothingToSave => {}
                None => tracing::warn!(%error, "the last seconds are not saved"),
            },
        }
    }

    fn begin_saving(&self, cause: Cause) -> Result<(PathBuf, Vec<Arc<Packed>>), StationError> {
        let (Some(shelf), Some(ring)) = (&self.shelf, &self.ring) else {
            return Err(StationError::NothingToSave);
        };
        if self.saving.is_some() {
            return Err(StationError::Busy);
        }
        let frames = ring.frames();
        if frames.is_empty() {
            return Err(StationError::NothingToSave);
        }
        make_room(shelf, &self.busy(), 0).map_err(|reason| StationError::RecordingTrouble { reason })?;
        Ok((shelf.path_for(SystemTime::now(), Some(cause.name())), frames))
    }

    fn list(&self) -> Vec<protocol::Recording> {
        let busy = self.busy();
        let told = |kept: Kept| protocol::Recording {
            bytes: kept.bytes.cast_signed(),
            written_unix_ns: kept
                .written
                .duration_since(UNIX_EPOCH)
                .map_or(0, |since| since.as_nanos() as i64),
            pinned: kept.is_pinned,
            writing: busy.contains(&kept.path),
            name: kept.name,
        };
        self.shelf.iter().flat_map(Shelf::kept).map(told).collect()
    }

    fn find(&self, name: &str) -> Result<(&Shelf, Kept), StationError> {
        let found = self.shelf.as_ref().and_then(|shelf| Some((shelf, shelf.find(name)?)));
        found.ok_or_else(|| StationError::NoSuchRecording { name: name.to_owned() })
    }

    fn pin(&mut self, name: &str, pinned: bool) -> Result<(), StationError> {
        let (shelf, kept) = self.find(name)?;
        if self.saving.as_ref().is_some_and(|saving| saving.path == kept.path) {
            return Err(StationError::BeingWritten { name: kept.name });
        }
        let place = shelf.place(&kept, pinned);
        if kept.is_pinned == pinned {
            return Ok(());
        }
        let trouble =
            |error| StationError::RecordingTrouble { reason: format!("{}: {error}", place.display()) };
        if place.exists() {
            return Err(StationError::NameTaken { name: kept.name });
        }
        std::fs::rename(&kept.path, &place).map_err(trouble)?;
        if let Some(open) = self.open.as_mut().filter(|open| open.path() == kept.path) {
            open.moved(place);
        }
        Ok(())
    }

    fn remove(&self, name: &str) -> Result<(), StationError> {
        let (_, kept) = self.find(name)?;
        if self.busy().contains(&kept.path) {
            return Err(StationError::BeingWritten { name: kept.name });
        }
        remove(&kept.path).map_err(|error| StationError::RecordingTrouble {
            reason: format!("{}: {error}", kept.path.display()),
        })
    }
}

/// Who asked may have left.
fn answer<T>(reply: Reply<T>, outcome: Result<T, StationError>) {
    let _ = reply.send(outcome);
}

fn name_of(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
}

/// Makes the folder, and the room that is needed.
fn make_room(shelf: &Shelf, busy: &[PathBuf], spare: u64) -> Result<(), String> {
    shelf
        .prepare()
        .map_err(|error| format!("the folder of recordings cannot be made: {error}; see record.directory"))?;
    let busy: Vec<&Path> = busy.iter().map(PathBuf::as_path).collect();
    shelf.tidy(&busy, spare, SystemTime::now())
}

fn write_all(path: &Path, params: RecordingParams, frames: &[Arc<Packed>]) -> Result<(), WriteError> {
    let io = |source| WriteError::Io { path: path.to_owned(), source };
    let mut file: Option<RecordingFile> = None;
    for packed in frames {
        let shot = packed.unpack().map_err(io)?;
        let now = Instant::now();
        let open = match &mut file {
            Some(open) => open,
            None => file.insert(RecordingFile::create(path, params.clone(), &shot, now)?),
        };
        if let Err(error) = open.write(&shot, now) {
            if let Some(open) = file {
                open.salvage();
            }
            return Err(error);
        }
    }
    file.map_or(Ok(()), |file| file.finish().map(drop))
}
