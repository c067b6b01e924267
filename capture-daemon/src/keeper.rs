//! The keeper: a thread that owns the store. Captures, people's orders and changed files come to it; it
//! puts them on disk and then announces the library. A slow or full disk holds up nobody else.

use std::collections::{HashSet, VecDeque};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

use common::blade::BladeId;
use common::protocol::{self, CaptureReply, EarlierBlade, RefusedFile, StationError};
use notify::Watcher;
use notify::event::{AccessKind, AccessMode};
use tokio::sync::{oneshot, watch};

use crate::service::Published;
use crate::store::record::Record;
use crate::store::shelf::Version;
use crate::store::{Kept, Store, StoreError};

mod told;

use told::{shown, told};

/// Orders and captures that may wait for the keeper.
pub(crate) const QUEUE: usize = 256;
/// Captured blades that wait for room on the disk, at most.
const MAX_WAITING: usize = 256;
/// How often a disk that refuses is tried again, and how often a folder that cannot be watched is read.
const RETRY: Duration = Duration::from_secs(1);
/// How long a folder must be quiet before its changed files are read.
const QUIET: Duration = Duration::from_millis(60);
/// How long it is waited for that at most.
const PATIENCE: Duration = Duration::from_millis(400);
/// How often the folder is read though nothing was heard of it.
const BACKSTOP: Duration = Duration::from_secs(30);

/// Of a blade that was captured, removed, and held up again.
const REMOVED: &str =
    "it was captured before and then removed or replaced; sward-capture blades restore brings it back";
/// Of a blade that found no room.
const LOST: &str = "it could not be kept; the station's log says why";

/// What someone wants changed.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Order {
    /// Take a blade away.
    Remove { name: String },
    /// Give it another name.
    Rename { name: String, new_name: String },
    /// Go back to an earlier one: so many, from 1.
    Restore { name: String, back: usize },
    /// Set its weight.
    SetMix { name: String, mix: f64 },
    /// Put the blade of a file's text there, instead of one of that name.
    Put { name: String, text: BladeText },
}

/// The text of a blade's file; a log shows only how long it is.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct BladeText(pub(crate) String);

impl std::fmt::Debug for BladeText {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} bytes", self.0.len())
    }
}

/// How an order went.
pub(crate) type Outcome<T> = Result<T, StationError>;

/// Who asked for a capture, and what was refused in it.
pub(crate) type CaptureAsked = (oneshot::Sender<Outcome<CaptureReply>>, Vec<String>);

/// What comes to the keeper.
#[derive(Debug)]
pub(crate) enum Job {
    /// Blades of one capture, and who asked for it.
    Captured(Vec<Record>, Option<CaptureAsked>),
    /// An order and where its outcome goes.
    Order(Order, oneshot::Sender<Outcome<()>>),
    /// What a name can go back to.
    History(String, oneshot::Sender<Vec<EarlierBlade>>),
    /// What names that no blade has now would go back to.
    Removed(oneshot::Sender<Vec<EarlierBlade>>),
    /// Look whether files have changed.
    Files,
    /// Finish.
    Stop,
}

/// What the store holds, for the service.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct Holdings {
    /// The library's blades in its order.
    pub(crate) blades: Vec<protocol::Blade>,
    /// Files that are none.
    pub(crate) refused: Vec<RefusedFile>,
    /// Why blades cannot be written at present.
    pub(crate) trouble: Option<String>,
    /// Captured blades that wait for the disk.
    pub(crate) waiting: usize,
    /// Captured blades that found no room at all.
    pub(crate) lost: u64,
    /// Captures that brought something new.
    pub(crate) captures: u64,
    /// Captures of blades that were all captured before.
    pub(crate) repeats: u64,
    /// Every blade that was captured before, also those that were removed or replaced since.
    pub(crate) known: HashSet<BladeId>,
}

/// Where the keeper announces what it has.
#[derive(Debug)]
pub(crate) struct Announcements {
    /// The newest library; none before there is a blade.
    pub(crate) library: watch::Sender<Option<Arc<Published>>>,
    /// What the store holds.
    pub(crate) holdings: watch::Sender<Arc<Holdings>>,
}

/// The keeper.
pub(crate) struct Keeper {
    store: Store,
    announcements: Announcements,
    files_changed: Arc<AtomicBool>,
    wake: mpsc::SyncSender<Job>,
    watcher: Option<notify::RecommendedWatcher>,
    waiting: VecDeque<Record>,
    trouble: Option<String>,
    /// The log says that there is trouble, and not yet that it is over.
    is_said: bool,
    lost: u64,
    captures: u64,
    repeats: u64,
    /// The library is another than the one that is announced.
    stale: bool,
}

impl Keeper {
    /// A keeper of `store`. `wake` leads to the queue that [`Self::run`] is given the other end of.
    pub(crate) fn new(store: Store, announcements: Announcements, wake: mpsc::SyncSender<Job>) -> Self {
        let stale = !store.is_empty();
        Self {
            store,
            announcements,
            files_changed: Arc::default(),
            wake,
            watcher: None,
            waiting: VecDeque::new(),
            trouble: None,
            is_said: false,
            lost: 0,
            captures: 0,
            repeats: 0,
            stale,
        }
    }

    /// Announces what is there. To be called before [`Self::run`], so that a station that is ready has
    /// its library.
    pub(crate) fn begin(&mut self) {
        if let Err(error) = self.store.prepare() {
            self.note_trouble(&error);
        }
        self.watch_folder();
        self.announce();
    }

    /// Does what comes until it is told to stop.
    pub(crate) fn run(mut self, jobs: &mpsc::Receiver<Job>) {
        let mut rescan_at: Option<(Instant, Instant)> = None;
        let mut retry_at = Instant::now() + RETRY;
        loop {
            let now = Instant::now();
            let in_trouble = self.trouble.is_some() || self.stale || !self.waiting.is_empty();
            let mut wait = if in_trouble || self.watcher.is_none() {
                retry_at.saturating_duration_since(now)
            } else {
                BACKSTOP
            };
            if let Some((quiet, latest)) = rescan_at {
                wait = wait.min(quiet.min(latest).saturating_duration_since(now));
            }
            let job = jobs.recv_timeout(wait);
            let was_quiet = matches!(job, Err(mpsc::RecvTimeoutError::Timeout));
            match job {
                Ok(Job::Stop) | Err(mpsc::RecvTimeoutError::Disconnected) => break,
                Ok(Job::Captured(records, asked)) => self.captured(records, asked),
                Ok(Job::Order(order, asked)) => self.obey(&order, asked),
                Ok(Job::History(name, asked)) => self.tell_history(&name, asked),
                Ok(Job::Removed(asked)) => self.tell_removed(asked),
                Ok(Job::Files) | Err(mpsc::RecvTimeoutError::Timeout) => {}
            }
            let now = Instant::now();
            if self.files_changed.swap(false, Ordering::Relaxed) {
                let latest = rescan_at.map_or(now + PATIENCE, |(_, latest)| latest);
                rescan_at = Some((now + QUIET, latest));
            }
            let is_due = rescan_at.is_some_and(|(quiet, latest)| now >= quiet.min(latest));
            let is_idle = was_quiet && rescan_at.is_none();
            if is_due || is_idle {
                rescan_at = None;
                self.rescan();
            }
            if now >= retry_at {
                retry_at = now + RETRY;
                self.try_again();
            }
        }
        self.try_again();
        if !self.waiting.is_empty() {
            tracing::error!(
                blades = self.waiting.len(),
                "captured blades are lost: they could not be written"
            );
        }
    }

    /// Hears of changed files from now on. Where that cannot be had, the folder is read every second.
    fn watch_folder(&mut self) {
        let (changed, wake) = (Arc::clone(&self.files_changed), self.wake.clone());
        let heard = move |event: notify::Result<notify::Event>| {
            let is_reading = event.as_ref().is_ok_and(|event| match event.kind {
                notify::EventKind::Access(AccessKind::Close(AccessMode::Write)) => false,
                notify::EventKind::Access(_) => true,
                _ => false,
            });
            // Woken once until it looks: many changes crowd out no order. A queue that is full wakes it as well.
            if !is_reading && !changed.swap(true, Ordering::Relaxed) {
                let _ = wake.try_send(Job::Files);
            }
        };
        let watch = |folder: &Path| {
            let mut watcher = notify::recommended_watcher(heard)?;
            watcher.watch(folder, notify::RecursiveMode::NonRecursive)?;
            Ok::<_, notify::Error>(watcher)
        };
        match watch(&self.store.blades_folder()) {
            Ok(watcher) => self.watcher = Some(watcher),
            Err(error) => {
                tracing::debug!(%error, "the folder of blades cannot be watched; it is read every second")
            }
        }
    }

    fn captured(&mut self, records: Vec<Record>, asked: Option<CaptureAsked>) {
        let ids: Vec<BladeId> = records.iter().map(|record| record.blade.id()).collect();
        let mut is_new = false;
        for record in records {
            is_new |= self.keep(record);
        }
        if is_new {
            self.captures += 1;
        } else {
            self.repeats += 1;
        }
        self.announce();
        let Some((asked, mut refused)) = asked else { return };
        let mut names = Vec::new();
        let mut waiting = 0;
        for id in ids {
            if let Some(name) = self.store.name_of(id) {
                names.push(name.to_owned());
            } else if self.waiting.iter().any(|record| record.blade.id() == id) {
                waiting += 1;
            } else if self.store.is_removed(id) {
                refused.push(REMOVED.to_owned());
            } else {
                refused.push(LOST.to_owned());
            }
        }
        let reason = || self.trouble.clone().unwrap_or_else(|| "there is no room for it".to_owned());
        let outcome = match waiting {
            0 => Ok(CaptureReply { names, refused }),
            waiting => Err(StationError::CaptureWaits { names, waiting, reason: reason() }),
        };
        // Who asked may have left.
        let _ = asked.send(outcome);
    }

    /// Keeps a captured blade, on disk or until there is room; whether it is new.
    fn keep(&mut self, record: Record) -> bool {
        let blade = &record.blade;
        let [length_mm, width_mm] =
            [blade.length_m(), blade.max_width_m()].map(|metres| format!("{:.1}", metres * 1e3));
        let (quality, frame) = (format!("{:.2}", blade.quality()), record.provenance.frame);
        match self.store.keep(&record) {
            Ok(Kept::New) => {
                tracing::info!(frame, name = blade.name(), length_mm, width_mm, quality, "captured");
                self.stale = true;
                true
            }
            Ok(Kept::Known) => {
                tracing::debug!(frame, name = blade.name(), "seen again: it was captured before");
                false
            }
            Err(error) if error.is_disk() => {
                self.note_trouble(&error);
                self.let_wait(record)
            }
            Err(error) => {
                self.lost += 1;
                tracing::error!(%error, name = blade.name(), "a captured blade is lost");
                true
            }
        }
    }

    /// Whether it does not wait already.
    fn let_wait(&mut self, record: Record) -> bool {
        if self.waiting.iter().any(|waiting| waiting.blade.id() == record.blade.id()) {
            return false;
        }
        if self.waiting.len() >= MAX_WAITING {
            self.lost += 1;
            let lost = self.waiting.pop_front();
            let name = lost.as_ref().map_or("", |record| record.blade.name());
            tracing::error!(name, "a captured blade is lost: too many wait for room on the disk");
        }
        self.waiting.push_back(record);
        true
    }

    fn obey(&mut self, order: &Order, asked: oneshot::Sender<Outcome<()>>) {
        // What someone sees in the folder is what he means.
        self.rescan();
        let done = match order {
            Order::Remove { name } => self.store.remove(name),
            Order::Rename { name, new_name } => self.store.rename(name, new_name),
            Order::Restore { name, back } => self.store.restore(name, *back),
            Order::SetMix { name, mix } => self.store.set_mix(name, *mix),
            Order::Put { name, text } => self.store.put_text(name, &text.0),
        };
        match &done {
            Ok(()) => {
                tracing::info!(?order, "done");
                self.stale = true;
            }
            Err(error) => {
                tracing::info!(?order, %error, "refused");
                if error.is_disk() {
                    self.note_trouble(error);
                }
            }
        }
        self.announce();
        let _ = asked.send(done.map_err(told));
    }

    fn tell_history(&mut self, name: &str, asked: oneshot::Sender<Vec<EarlierBlade>>) {
        self.rescan();
        let earlier = self.store.earlier(name).into_iter().zip(1..);
        // Who asked may have left.
        let _ = asked.send(earlier.map(|(version, back)| self.earlier(version, back)).collect());
    }

    fn tell_removed(&mut self, asked: oneshot::Sender<Vec<EarlierBlade>>) {
        self.rescan();
        let removed = self.store.removed().into_iter();
        // Who asked may have left.
        let _ = asked.send(removed.map(|version| self.earlier(version, 1)).collect());
    }

    fn earlier(&self, version: Version, back: i64) -> EarlierBlade {
        EarlierBlade {
            back,
            kept_unix_ns: i64::try_from(version.kept_unix_ns).unwrap_or(i64::MAX),
            archived: self.store.is_archived(&version),
            renamed_to: version.renamed_to,
            blade: shown(&version.record),
        }
    }

    fn rescan(&mut self) {
        match self.store.rescan() {
            Ok(changes) => {
                if self.watcher.is_none() {
                    self.watch_folder();
                }
                self.stale |= changes.library;
                if changes.library || changes.refused {
                    self.announce();
                }
            }
            Err(error) => {
                // The watch is on a folder that may be gone.
                self.watcher = None;
                self.note_trouble(&error);
                self.announce();
            }
        }
    }

    /// Once a second while something is wrong: writes what waits, or sees whether anything can be
    /// written.
    fn try_again(&mut self) {
        if self.trouble.is_none() && !self.stale && self.waiting.is_empty() {
            return;
        }
        let before = self.trouble.take();
        if let Err(error) = self.store.prepare() {
            self.note_trouble(&error);
        }
        for record in std::mem::take(&mut self.waiting) {
            if self.trouble.is_some() {
                self.waiting.push_back(record);
            } else {
                self.keep(record);
            }
        }
        if self.trouble.is_none()
            && let Err(error) = self
                .store
                .probe()
                .and_then(|()| self.store.rescan().map(|changes| self.stale |= changes.library))
        {
            self.note_trouble(&error);
        }
        if before.is_some() && self.trouble.is_none() {
            self.is_said = false;
            tracing::info!("the store can be written again");
        }
        self.announce();
    }

    fn note_trouble(&mut self, error: &StoreError) {
        let reason = error.to_string();
        if !self.is_said {
            self.is_said = true;
            tracing::warn!(reason, "the store cannot be written; it is tried again every second");
        }
        self.trouble = Some(reason);
    }

    /// Announces the library if it has changed, and before it what else there is to know.
    fn announce(&mut self) {
        let published = self.publish();
        let refused = self.store.refused().iter();
        let refused =
            refused.map(|(name, refused)| RefusedFile { name: name.clone(), reason: refused.reason.clone() });
        let holdings = Holdings {
            blades: self.store.records().into_iter().map(shown).collect(),
            refused: refused.collect(),
            trouble: self.trouble.clone(),
            waiting: self.waiting.len(),
            lost: self.lost,
            captures: self.captures,
            repeats: self.repeats,
            known: self.store.known().collect(),
        };
        self.announcements.holdings.send_replace(Arc::new(holdings));
        if let Some(published) = published {
            self.announcements.library.send_replace(Some(Arc::new(published)));
        }
    }

    /// The library, if it has changed.
    fn publish(&mut self) -> Option<Published> {
        if !self.stale {
            return None;
        }
        if let Err(error) = self.store.prepare() {
            self.note_trouble(&error);
        }
        let started = Instant::now();
        match Published::new(self.store.next_generation(), &self.store.blades()) {
            Ok(published) => {
                self.stale = false;
                let (generation, blades) = (published.generation(), published.blades());
                let seconds = started.elapsed().as_secs_f32();
                tracing::debug!(generation, blades, seconds, "announced");
                Some(published)
            }
            Err(error) => {
                tracing::error!(%error, "the library cannot be published; the last one stays");
                None
            }
        }
    }
}
