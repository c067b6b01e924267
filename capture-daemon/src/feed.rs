//! Frames on their way from a source to the stages: a thread reads them and waits for their time, a queue holds
//! those that the stages are not ready for yet.
//!
//! A sensor does not wait: its frame that finds the queue full is dropped and counted. A recording waits, also in
//! real time: it shows each frame each time it is played, so that a loop captures the same again and not its like.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};

use crate::frame::DepthFrame;
use crate::frames::Source;
use crate::replay::Pace;
use crate::source::SourceError;

/// Frames that may wait for the stages.
pub(crate) const QUEUE: usize = 8;
/// A thread that waits for a frame's time notices at least so often that nobody wants it any more.
const TICK: Duration = Duration::from_millis(200);

/// What a source gives.
type Given = Result<DepthFrame, SourceError>;

/// A source at work. Its thread ends once this is dropped; one that hangs in its source is left behind.
#[derive(Debug)]
pub(crate) struct Feed {
    frames: Receiver<Given>,
    dropped: Arc<AtomicU64>,
    is_over: Arc<AtomicBool>,
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
    }
}

impl Feed {
    /// `rate`: times real time; 0 as fast as they are taken. A live sensor has its own.
    ///
    /// # Errors
    /// When there can be no other thread.
    pub(crate) fn start(source: Source, rate: f64) -> io::Result<Self> {
        let (to_stages, frames) = sync_channel(QUEUE);
        let (dropped, is_over) = (Arc::default(), Arc::default());
        let is_live = source.health().is_some();
        let reader = Reader {
            source,
            is_live,
            pace: (rate > 0.0 && !is_live).then(|| Pace::new(rate)),
            to_stages,
            dropped: Arc::clone(&dropped),
            is_over: Arc::clone(&is_over),
        };
        std::thread::Builder::new().name("source".to_owned()).spawn(move || reader.run())?;
        Ok(Self { frames, dropped, is_over })
    }

    /// The next frame, once it is due. After [`SourceError::End`] or [`SourceError::Failed`] there is none.
    ///
    /// # Errors
    /// When it takes longer than `wait`, or the source's thread has ended.
    pub(crate) fn next(&self, wait: Duration) -> Result<Given, RecvTimeoutError> {
        self.frames.recv_timeout(wait)
    }

    /// Frames that were dropped since this was asked last.
    pub(crate) fn take_dropped(&self) -> u64 {
        self.dropped.swap(0, Ordering::Relaxed)
    }
}

/// The thread's side.
struct Reader {
    source: Source,
    pace: Option<Pace>,
    /// It waits for nobody.
    is_live: bool,
    to_stages: SyncSender<Given>,
    dropped: Arc<AtomicU64>,
    is_over: Arc<AtomicBool>,
}

impl Reader {
    fn run(mut self) {
        loop {
            let given = self.source.next_frame();
            if matches!(given, Err(SourceError::End | SourceError::Failed(_))) {
                // Before it is opened again: two would take twice the memory.
                drop(self.source);
                let _ = self.to_stages.send(given);
                return;
            }
            let is_wanted = match (&mut self.pace, given) {
                (Some(pace), Ok(frame)) => {
                    let due = Instant::now() + pace.wait(frame.timestamp_ns);
                    self.wait_until(due) && self.to_stages.send(Ok(frame)).is_ok()
                }
                (None, Ok(frame)) if self.is_live => self.offer(frame),
                (_, given) => self.to_stages.send(given).is_ok(),
            };
            if !is_wanted {
                return;
            }
        }
    }

    /// Whether anybody still wants frames then.
    fn wait_until(&self, due: Instant) -> bool {
        loop {
            if self.is_over.load(Ordering::Relaxed) {
                return false;
            }
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return true;
            }
            std::thread::sleep(left.min(TICK));
        }
    }

    /// Whether anybody still wants frames.
    fn offer(&self, frame: DepthFrame) -> bool {
        tracing::trace!(timestamp_ns = frame.timestamp_ns, "frame due");
        match self.to_stages.try_send(Ok(frame)) {
            Ok(()) => true,
            Err(TrySendError::Full(_)) => {
                self.dropped.fetch_add(1, Ordering::Relaxed);
                true
            }
            Err(TrySendError::Disconnected(_)) => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Sender, channel};

    use super::*;
    use crate::frame::CameraModel;
    use crate::source::FrameSource;
    use crate::source::host::Health;

    /// Longer than any of this takes.
    const LONG: Duration = Duration::from_secs(60);

    /// Frames a nanosecond apart, of which the fourth cannot be used.
    struct Burst {
        next: u64,
        frames: u64,
        is_live: bool,
    }

    impl Burst {
        fn of(frames: u64) -> Box<Self> {
            Box::new(Self { next: 0, frames, is_live: false })
        }
    }

    impl FrameSource for Burst {
        fn describe(&self) -> String {
            "a burst".to_owned()
        }

        fn health(&self) -> Option<Arc<Health>> {
            self.is_live.then(Arc::default)
        }

        fn next_frame(&mut self) -> Given {
            let index = self.next;
            self.next += 1;
            match index {
                3 => Err(SourceError::BadFrame("all zero".to_owned())),
                _ if index == self.frames => Err(SourceError::End),
                _ => Ok(DepthFrame {
                    width: 1,
                    height: 1,
                    depth: vec![500],
                    depth_unit_m: 0.001,
                    camera: CameraModel { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 },
                    timestamp_ns: index,
                }),
            }
        }
    }

    /// A source that hangs in its driver until it is let go.
    struct Hung(Receiver<()>);

    impl FrameSource for Hung {
        fn describe(&self) -> String {
            "a hung sensor".to_owned()
        }

        fn next_frame(&mut self) -> Given {
            let _ = self.0.recv();
            Err(SourceError::End)
        }
    }

    /// All that comes, by the frames' times, a bad one as `None`.
    fn all(feed: &Feed) -> Vec<Option<u64>> {
        let mut times = Vec::new();
        loop {
            match feed.next(LONG).expect("it comes to its end") {
                Ok(frame) => times.push(Some(frame.timestamp_ns)),
                Err(SourceError::BadFrame(_)) => times.push(None),
                Err(SourceError::End) => return times,
                Err(other) => panic!("{other}"),
            }
        }
    }

    #[test]
    fn of_a_live_sensor_what_finds_the_queue_full_is_dropped_and_counted() {
        let live = Box::new(Burst { is_live: true, ..*Burst::of(20) });
        let feed = Feed::start(live, 0.0).expect("a thread");
        let start = Instant::now();
        let mut dropped = 0;
        while dropped < 11 && start.elapsed() < LONG {
            dropped += feed.take_dropped();
            std::thread::sleep(Duration::from_millis(1));
        }
        // 19 frames and a bad one, of which 8 wait; then the end waits for its place.
        assert_eq!(dropped, 12);
        let expected = [Some(0), Some(1), Some(2), None, Some(4), Some(5), Some(6), Some(7)];
        assert_eq!(all(&feed), expected);
        assert_eq!(feed.take_dropped(), 0, "counted once");
    }

    #[test]
    fn of_a_recording_none_is_dropped_at_any_rate() {
        for rate in [0.0, 1000.0] {
            assert_waits(&Feed::start(Burst::of(50), rate).expect("a thread"));
        }
    }

    /// Of 50 frames.
    fn assert_waits(feed: &Feed) {
        // The source is far ahead of who takes its frames.
        std::thread::sleep(Duration::from_millis(20));
        let times = all(feed);
        assert_eq!(times.len(), 50);
        assert!(times.iter().enumerate().all(|(index, time)| *time == (index != 3).then_some(index as u64)));
        assert_eq!(feed.take_dropped(), 0);
    }

    #[test]
    fn a_source_that_hangs_holds_up_nobody() {
        let (let_go, held): (Sender<()>, _) = channel();
        let feed = Feed::start(Box::new(Hung(held)), 1.0).expect("a thread");
        assert!(matches!(feed.next(Duration::from_millis(5)), Err(RecvTimeoutError::Timeout)));
        drop(feed);
        drop(let_go);
    }
}
