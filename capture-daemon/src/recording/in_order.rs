//! Frames in the order of their times.

use std::collections::VecDeque;

use crate::frame::DepthFrame;
use crate::source::{FrameSource, SourceError};

/// Frames that are held back because an earlier one may come yet.
const WINDOW: usize = 8;
/// A frame that was taken so much before another, nanoseconds, is not late: the clock was set back.
const STEP_NS: u64 = 1_000_000_000;

/// Sorts the frames of a source by their times, as far as they are out of order by up to [`WINDOW`] frames
/// and one second. A frame that steps back farther stands for a clock that was set back: frames go on from
/// there in the order of the source, with one warning in the log, so that no frame is lost.
///
/// Frames of the same time stay in the order of the source. What cannot be used is told as soon as it is
/// met.
pub(super) struct InOrder<S> {
    source: S,
    /// What was read and not given yet, in order.
    pending: VecDeque<DepthFrame>,
    /// Latest time that was read since the clock was set back.
    newest_ns: u64,
    /// Time of the last frame that was given since.
    given_ns: u64,
    /// What comes once all that is pending was given.
    then: Option<Result<DepthFrame, SourceError>>,
    warned: bool,
}

impl<S: FrameSource> InOrder<S> {
    pub(super) fn new(source: S) -> Self {
        let pending = VecDeque::with_capacity(WINDOW + 1);
        Self { source, pending, newest_ns: 0, given_ns: 0, then: None, warned: false }
    }

    fn insert(&mut self, frame: DepthFrame) {
        self.newest_ns = self.newest_ns.max(frame.timestamp_ns);
        let behind = self.pending.partition_point(|other| other.timestamp_ns <= frame.timestamp_ns);
        self.pending.insert(behind, frame);
    }

    fn warn(&mut self, frame: &DepthFrame) {
        if !self.warned {
            tracing::warn!(
                "{}: a frame of {} ns comes behind one of {} ns; its clock was set back, and frames go on in \
                 the order of the file",
                self.source.describe(),
                frame.timestamp_ns,
                self.newest_ns
            );
        }
        self.warned = true;
    }
}

impl<S: FrameSource> FrameSource for InOrder<S> {
    fn describe(&self) -> String {
        self.source.describe()
    }

    fn next_frame(&mut self) -> Result<DepthFrame, SourceError> {
        loop {
            if (self.then.is_some() || self.pending.len() > WINDOW)
                && let Some(frame) = self.pending.pop_front()
            {
                self.given_ns = frame.timestamp_ns;
                return Ok(frame);
            }
            match self.then.take() {
                Some(Ok(frame)) => {
                    (self.newest_ns, self.given_ns) = (0, 0);
                    self.insert(frame);
                }
                Some(Err(end)) => {
                    self.then = Some(Err(end.clone()));
                    return Err(end);
                }
                None => match self.source.next_frame() {
                    Ok(frame)
                        if frame.timestamp_ns < self.given_ns
                            || frame.timestamp_ns.saturating_add(STEP_NS) < self.newest_ns =>
                    {
                        self.warn(&frame);
                        self.then = Some(Ok(frame));
                    }
                    Ok(frame) => self.insert(frame),
                    Err(passing @ (SourceError::BadFrame(_) | SourceError::Told(_))) => return Err(passing),
                    Err(end) => self.then = Some(Err(end)),
                },
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CameraModel;

    /// Frames taken at some times, in milliseconds; none: one that cannot be used.
    struct Times(VecDeque<Option<u64>>);

    impl FrameSource for Times {
        fn describe(&self) -> String {
            "a list".to_owned()
        }

        fn next_frame(&mut self) -> Result<DepthFrame, SourceError> {
            let time = self.0.pop_front().ok_or(SourceError::End)?;
            let time = time.ok_or_else(|| SourceError::BadFrame("bad".to_owned()))?;
            Ok(DepthFrame {
                width: 1,
                height: 1,
                depth: vec![500],
                depth_unit_m: 0.001,
                timestamp_ns: 1_700_000_000_000_000_000 + time * 1_000_000,
                camera: CameraModel { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 },
            })
        }
    }

    #[track_caller]
    fn check(times: &[u64], expected: &[u64]) {
        let mut source = InOrder::new(Times(times.iter().copied().map(Some).collect()));
        let given: Vec<u64> = std::iter::from_fn(|| source.next_frame().ok())
            .map(|frame| (frame.timestamp_ns - 1_700_000_000_000_000_000) / 1_000_000)
            .collect();
        assert_eq!(given, expected);
        assert_eq!(source.next_frame(), Err(SourceError::End), "the end stays");
    }

    #[test]
    fn frames_that_are_late_are_sorted_in() {
        check(&[], &[]);
        check(&[200, 0, 100], &[0, 100, 200]);
        check(&[0, 33, 100, 66, 133, 133, 166], &[0, 33, 66, 100, 133, 133, 166]);
        let late = [10, 20, 30, 40, 50, 60, 70, 80, 0, 90];
        check(&late, &[0, 10, 20, 30, 40, 50, 60, 70, 80, 90]);
    }

    #[test]
    fn a_clock_that_was_set_back_costs_no_frame() {
        for times in [
            &[5000, 5033, 5066, 0, 33, 66][..],
            // Later than what is held back.
            &[10, 20, 30, 40, 50, 60, 70, 80, 90, 0, 100],
            // One time that is far off.
            &[0, 33, 9_000_000, 66, 100, 133],
        ] {
            check(times, times);
        }
        check(&[5033, 5000, 33, 0], &[5000, 5033, 0, 33]);
    }

    #[test]
    fn what_cannot_be_used_is_told() {
        let mut source = InOrder::new(Times([Some(1), None, Some(0)].into()));
        assert!(matches!(source.next_frame(), Err(SourceError::BadFrame(_))));
        assert!(source.next_frame().is_ok_and(|frame| frame.timestamp_ns.is_multiple_of(10_000_000)));
        assert!(source.next_frame().is_ok());
        assert_eq!(source.next_frame(), Err(SourceError::End));
    }
}
