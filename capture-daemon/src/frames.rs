//! The frame thread: frames from the source through the session, captures to the keeper. Its own
//! progress feeds systemd's watchdog: a source that is silent or hangs does not stop it, a stage that hangs does.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError};
use std::time::{Duration, Instant};

use common::preview;
use common::protocol::{CaptureReply, StationError, Status};
use tokio::sync::{oneshot, watch};

use crate::config::Config;
use crate::feed::Feed;
use crate::frame::DepthFrame;
use crate::keeper::{Holdings, Job, Outcome};
use crate::note::Note;
use crate::preview::Previewer;
use crate::recorder::{Cause, Recorder, Shape};
use crate::recording::{self, OpenError};
use crate::recurring::Recurring;
use crate::region::RegionWatch;
use crate::session::{Capture, Session, SessionParams};
use crate::source::host::{Fares, Health, SensorSource};
use crate::source::{FrameSource, SourceError};
use crate::stages::blade::CapturedBlade;
use crate::station::State;
use crate::store::record::{Measured, Provenance, Record};
use crate::visitor::Message;

mod ends;
mod watchdog;

pub(crate) use self::ends::{FrameOrder, NewParams, Outlets};
use self::watchdog::Watchdog;

/// Orders that may wait for the frame thread.
pub(crate) const QUEUE: usize = 16;
/// The thread looks after its orders and the watchdog at least so often.
const TICK: Duration = Duration::from_millis(200);
/// How often the rate of frames is measured.
const RATE_WINDOW: Duration = Duration::from_secs(1);
/// How long a sensor may give no frames before the staff is called.
const PATIENCE: Duration = Duration::from_secs(60);
/// How long it is waited, at most, before a recording that cannot be played again is tried once more.
const LONGEST_RETRY: Duration = Duration::from_secs(60);

/// A source as the frame thread has it.
pub(crate) type Source = Box<dyn FrameSource + Send>;

/// Opens the source that the configuration names; `None` where it names none.
///
/// # Errors
/// When it cannot be opened.
pub(crate) fn open_source(config: &Config) -> Result<Option<Source>, OpenError> {
    if config.sensor.driver.is_some() {
        return Ok(Some(Box::new(SensorSource::new(config, None))));
    }
    let Some(path) = &config.source.recording else {
        tracing::warn!("neither source.recording nor sensor.driver is set: nothing will be captured");
        return Ok(None);
    };
    recording::open(path, &config.open_options()).map(Some)
}

/// Frames in the last second or so.
#[derive(Debug)]
struct Rate {
    since: Instant,
    frames: u32,
}

/// What the frame thread owns.
pub(crate) struct Frames {
    config: Config,
    config_hash: String,
    session: Session,
    params: SessionParams,
    status: watch::Sender<Status>,
    previewer: Previewer,
    holdings: watch::Receiver<Arc<Holdings>>,
    keeper: SyncSender<Job>,
    recorder: Recorder,
    orders: Receiver<FrameOrder>,
    stop: Arc<AtomicBool>,
    source_name: String,
    /// Size, unit and camera of the frames that come.
    shape: Option<Shape>,
    has_source: bool,
    /// How the live sensor fares, if the source is one.
    health: Option<Arc<Health>>,
    /// Since when it gives no frames, while it does not.
    silent_since: Option<Instant>,
    /// Who waits for a capture.
    asked: Option<oneshot::Sender<Outcome<CaptureReply>>>,
    watchdog: Watchdog,
    rate: Rate,
    dropped: Recurring,
    skipped: Recurring,
    region: RegionWatch,
}

impl Frames {
    /// `holdings`: what was captured before; `orders`: what it is asked to do; `stop`: once true, it ends.
    pub(crate) fn new(
        config: &Config,
        outlets: Outlets,
        holdings: watch::Receiver<Arc<Holdings>>,
        orders: Receiver<FrameOrder>,
        stop: Arc<AtomicBool>,
    ) -> Self {
        let Outlets { status, looks, keeper, recorder } = outlets;
        let params = config.session_params();
        Self {
            config: config.clone(),
            config_hash: config.capture_hash(),
            session: Session::new(params.clone()),
            params,
            status,
            previewer: Previewer::new(looks),
            holdings,
            keeper,
            recorder,
            orders,
            stop,
            source_name: String::new(),
            shape: None,
            has_source: false,
            health: None,
            silent_since: None,
            asked: None,
            watchdog: Watchdog::new(),
            rate: Rate { since: Instant::now(), frames: 0 },
            dropped: Recurring::default(),
            skipped: Recurring::default(),
            region: RegionWatch::default(),
        }
    }

    /// Plays the source, again and again if it loops, until it is told to stop. Without a source it
    /// stays to answer who asks.
    pub(crate) fn run(mut self, source: Option<Source>) {
        let mut next = source;
        let mut retry = TICK;
        loop {
            match next.take() {
                Some(source) => {
                    retry = TICK;
                    let Some(is_over) = self.play(source) else { return };
                    self.has_source = false;
                    self.answer(Err(StationError::NothingHeld));
                    if is_over && self.config.source.looped {
                        next = self.open_again();
                    }
                }
                None => {
                    let wait = if self.config.source.looped { retry } else { LONGEST_RETRY };
                    let is_hopeful = wait < LONGEST_RETRY && self.config.source.recording.is_some();
                    let message = if is_hopeful { Message::Reconnecting } else { Message::CallStaff };
                    self.previewer.no_source(message, &self.params.pipeline.mask);
                    self.say_state(preview::State::NoSource.name());
                    if !self.attend(wait) {
                        return;
                    }
                    if self.config.source.looped && self.config.source.recording.is_some() {
                        retry = (2 * retry).min(LONGEST_RETRY);
                        next = self.open_again();
                    }
                }
            }
        }
    }

    fn open_again(&mut self) -> Option<Source> {
        match open_source(&self.config) {
            Ok(source) => source,
            Err(error) => {
                tracing::error!(%error, "the recording cannot be played again; it will be tried later");
                None
            }
        }
    }

    /// Plays a source to its end: whether it was its proper end; `None` when told to stop.
    fn play(&mut self, source: Source) -> Option<bool> {
        // A recording's clock steps back where it begins again, so the session begins anew too.
        self.session = Session::new(self.params.clone());
        self.recorder.note(Note::Begins { captured: false });
        self.previewer.begin();
        self.source_name = source.describe();
        self.health = source.health();
        if self.health.is_some() {
            self.begin_silence();
        }
        let feed = match Feed::start(source, self.config.source.rate) {
            Ok(feed) => feed,
            Err(error) => {
                tracing::error!(%error, "the thread of the source cannot be started");
                return Some(false);
            }
        };
        self.has_source = self.health.is_none();
        loop {
            // What was ordered before a frame holds for it.
            if !self.attend(Duration::ZERO) {
                return None;
            }
            let given = feed.next(TICK);
            self.count_dropped(feed.take_dropped());
            match given {
                Ok(Ok(frame)) => {
                    self.end_silence();
                    let region = self.params.pipeline.mask.roi;
                    if let Some(warning) = self.region.warning(region, [frame.width, frame.height]) {
                        tracing::warn!("{warning}");
                    }
                    let frame = Arc::new(frame);
                    self.note_shape(&frame);
                    self.recorder.frame(&frame, &mut self.session);
                    let capture = self.session.push(&frame).map(Arc::new);
                    let is_known = capture.as_ref().is_some_and(|capture| self.is_known(capture));
                    if let Some(capture) = &capture {
                        if capture.steps.blades.is_empty() {
                            self.recorder.went_wrong(Cause::Refused);
                        }
                        self.deliver(capture);
                    } else if self.session.state() == State::Waiting {
                        self.answer(Err(StationError::NothingHeld));
                    }
                    self.previewer.frame(frame, &self.session, capture, is_known);
                    self.count_frame();
                }
                Ok(Err(SourceError::BadFrame(reason))) => self.count_skipped(&reason),
                Ok(Err(SourceError::Told(note))) => {
                    self.recorder.note(note.clone());
                    self.session.take_note(&note);
                }
                Ok(Err(SourceError::Interrupted(reason))) => {
                    tracing::warn!(reason, "no frames come from the sensor; it is tried again");
                    self.begin_silence();
                }
                Ok(Err(SourceError::End)) => {
                    if !self.config.source.looped {
                        tracing::info!("the recording is over");
                    }
                    return Some(true);
                }
                Ok(Err(SourceError::Failed(reason))) => {
                    tracing::error!(reason, "the recording cannot be read further");
                    return Some(false);
                }
                Err(RecvTimeoutError::Timeout) => self.tell_of_silence(),
                Err(RecvTimeoutError::Disconnected) => {
                    tracing::error!("the thread of the source ended by itself; see the log above");
                    return Some(false);
                }
            }
        }
    }

    /// The sensor gives no frames from now on, unless it has not given any for longer.
    fn begin_silence(&mut self) {
        if self.silent_since.is_none() {
            self.silent_since = Some(Instant::now());
            self.has_source = false;
            self.interrupt();
            self.answer(Err(StationError::NothingHeld));
            self.recorder.went_wrong(Cause::Sensor);
        }
        self.tell_of_silence();
    }

    fn interrupt(&mut self) {
        self.session.interrupt();
        self.recorder.note(Note::Interrupted);
    }

    /// Frames of another size, unit or camera show something else than those before.
    fn note_shape(&mut self, frame: &DepthFrame) {
        let shape = Shape::of(frame);
        if self.shape.replace(shape).is_some_and(|before| before != shape) {
            self.interrupt();
        }
    }

    /// Tells the visitor, and after a while that he should call somebody.
    fn tell_of_silence(&mut self) {
        let Some(since) = self.silent_since else { return };
        let message = if since.elapsed() < PATIENCE { Message::Reconnecting } else { Message::CallStaff };
        self.previewer.no_source(message, &self.params.pipeline.mask);
        self.say_state(preview::State::NoSource.name());
    }

    /// A frame has come.
    fn end_silence(&mut self) {
        if self.silent_since.take().is_some() {
            self.has_source = true;
            self.previewer.begin();
            let fares = self.health.as_ref().map(|health| health.now());
            if let Some(Fares { name: Some(name), serial, .. }) = fares {
                self.recorder.sensor(&name, serial.as_deref().unwrap_or_default());
                self.source_name = name;
                let source = self.source_name.clone();
                self.status.send_modify(|status| status.source = source);
            }
        }
    }

    /// Has the status say how the sensor fares.
    fn say_health(&self) {
        let Some(fares) = self.health.as_ref().map(|health| health.now()) else { return };
        let counts = [fares.starts, fares.silences, fares.deaths, fares.failures, fares.lost_frames];
        let [starts, silences, deaths, failures, lost] = counts.map(u64::cast_signed);
        let sensor = fares.trouble.unwrap_or_else(|| "ok".to_owned());
        self.status.send_if_modified(|status| {
            let before = status.clone();
            status.sensor = sensor;
            (status.sensor_starts, status.sensor_silences) = (starts, silences);
            (status.sensor_deaths, status.sensor_failures) = (deaths, failures);
            status.lost_frames = lost;
            *status != before
        });
    }

    /// Does what is asked for so long; whether to go on.
    fn attend(&mut self, wait: Duration) -> bool {
        let due = Instant::now() + wait;
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return false;
            }
            self.watchdog.feed();
            self.measure_rate();
            self.say_health();
            let left = due.saturating_duration_since(Instant::now());
            match self.orders.recv_timeout(left.min(TICK)) {
                Ok(FrameOrder::Params(params)) => {
                    let NewParams { session, hash, toml } = *params;
                    self.params = session.clone();
                    self.config_hash.clone_from(&hash);
                    self.session.set_params(session);
                    self.recorder.config(toml);
                    self.status.send_modify(|status| status.config = hash);
                }
                Ok(FrameOrder::Capture(asked)) => {
                    // Who asked first is not forgotten for who asks again.
                    if !self.has_source {
                        let _ = asked.send(Err(StationError::NoFrames));
                    } else if self.asked.is_some() {
                        let _ = asked.send(Err(StationError::Busy));
                    } else {
                        self.session.demand();
                        self.recorder.note(Note::Asked);
                        self.asked = Some(asked);
                    }
                }
                Err(RecvTimeoutError::Timeout) if Instant::now() >= due => return true,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return false,
            }
        }
    }

    fn answer(&mut self, outcome: Outcome<CaptureReply>) {
        if let Some(asked) = self.asked.take() {
            // Who asked may have left.
            let _ = asked.send(outcome);
        }
    }

    fn count_dropped(&mut self, more: u64) {
        if more > 0 {
            self.recorder.went_wrong(Cause::Dropped);
            self.status.send_modify(|status| status.dropped_frames += more.cast_signed());
        }
        if let Some(frames) = self.dropped.count(more) {
            tracing::warn!(frames, "frames were dropped: they come faster than the stages are");
        }
    }

    fn count_skipped(&mut self, reason: &str) {
        self.status.send_modify(|status| status.skipped_frames += 1);
        if let Some(frames) = self.skipped.count(1) {
            tracing::warn!(frames, reason, "frames were skipped: they cannot be read or used");
        }
    }

    fn count_frame(&mut self) {
        self.rate.frames += 1;
        self.status.send_modify(|status| status.frames += 1);
        self.say_state(self.session.state().name());
    }

    fn say_state(&self, state: &str) {
        self.status.send_if_modified(|status| {
            let is_other = status.state != state;
            if is_other {
                state.clone_into(&mut status.state);
            }
            is_other
        });
    }

    fn measure_rate(&mut self) {
        let elapsed = self.rate.since.elapsed();
        if elapsed >= RATE_WINDOW {
            let per_second = (f64::from(self.rate.frames) / elapsed.as_secs_f64() * 10.0).round() / 10.0;
            self.rate = Rate { since: Instant::now(), frames: 0 };
            self.status.send_if_modified(|status| {
                let is_other = status.frames_per_second != per_second;
                status.frames_per_second = per_second;
                is_other
            });
        }
    }

    /// Whether all blades of a capture were captured before.
    fn is_known(&self, capture: &Capture) -> bool {
        let known = &self.holdings.borrow().known;
        capture.steps.blades.iter().all(|captured| known.contains(&captured.blade.id()))
    }

    /// Sends a capture to the keeper, who announces it once it is on disk.
    fn deliver(&mut self, capture: &Capture) {
        let refused: Vec<String> = capture.steps.refused.iter().map(ToString::to_string).collect();
        for refusal in &capture.steps.refused {
            tracing::info!(frame = capture.frame, code = refusal.code(), %refusal, "refused");
        }
        let (frame, blades) = (capture.frame, &capture.steps.blades);
        tracing::debug!(frame, timestamp_ns = capture.timestamp_ns, blades = blades.len(), "stages done");
        if blades.is_empty() {
            return self.answer(Ok(CaptureReply { names: Vec::new(), refused }));
        }
        let records: Vec<Record> =
            blades.iter().enumerate().map(|(index, blade)| self.record(frame, index, blade)).collect();
        // The keeper answers who asked, once the blades are announced.
        let asked = self.asked.take().map(|asked| (asked, refused));
        if let Err(TrySendError::Full(job) | TrySendError::Disconnected(job)) =
            self.keeper.try_send(Job::Captured(records, asked))
        {
            tracing::error!(frame, "captured blades are lost: the store does not keep up");
            self.status.send_modify(|status| status.lost += 1);
            if let Job::Captured(_, Some((asked, _))) = job {
                let _ = asked.send(Err(StationError::Busy));
            }
        }
    }

    fn record(&self, frame: u64, index: usize, captured: &CapturedBlade) -> Record {
        let CapturedBlade { blade, quality, .. } = captured;
        Record {
            blade: blade.clone(),
            pinned: false,
            sequence: None,
            measured: Some(Measured {
                pixels_across: quality.pixels_across,
                hausdorff_m: quality.hausdorff_m,
                length_error_m: quality.length_error_m,
                width_error_m: quality.width_error_m,
            }),
            provenance: Provenance {
                source: Some(self.source_name.clone()),
                frame: Some(frame),
                frames: Some(quality.evidence.frames as u64),
                index: Some(index as u64),
                config: Some(self.config_hash.clone()),
            },
        }
    }
}
