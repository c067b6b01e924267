//! Time stamps of V4L2, and which clock they are of.

use std::fmt;

use rustix::time::{ClockId, clock_gettime};

use crate::source::clock::unix_ns;

/// A stamp of the kernel's clock that is older, nanoseconds, is of another clock: no frame waits so long.
const OLDEST_NS: i128 = 10_000_000_000;

/// The clock that a driver stamps frames by.
///
/// # Source
/// The kernel's *Userspace API, Video for Linux*, "Buffer Flags": `V4L2_BUF_FLAG_TIMESTAMP_*`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Clock {
    /// `CLOCK_MONOTONIC`.
    Monotonic,
    /// As it was given with what the frame is made of.
    Copied,
    /// The driver does not say.
    Unknown,
}

/// The same moment on two clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Moment {
    /// `CLOCK_MONOTONIC`, nanoseconds.
    monotonic_ns: i128,
    /// Nanoseconds since 1970.
    unix_ns: u64,
}

impl Moment {
    pub(super) fn now() -> Self {
        let now = clock_gettime(ClockId::Monotonic);
        let monotonic_ns = i128::from(now.tv_sec) * 1_000_000_000 + i128::from(now.tv_nsec);
        Self { monotonic_ns, unix_ns: unix_ns() }
    }
}

/// When a frame was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stamp {
    /// The driver's stamp, nanoseconds of its clock.
    pub(super) sensor_ns: i128,
    /// That clock.
    pub(super) clock: Clock,
    /// Whether it is of the start of the exposure, and not of the frame's end.
    pub(super) is_of_start: bool,
    /// When the frame was there.
    pub(super) now: Moment,
}

impl Stamp {
    /// How long ago it was taken, where that can be told, nanoseconds.
    fn age_ns(&self) -> Option<i128> {
        let age_ns = self.now.monotonic_ns - self.sensor_ns;
        (self.clock == Clock::Monotonic && (0..OLDEST_NS).contains(&age_ns)).then_some(age_ns)
    }

    /// When it was taken, nanoseconds since 1970; when it came, where the clock of the stamp is not known.
    pub(super) fn unix_ns(&self) -> u64 {
        let taken = i128::from(self.now.unix_ns) - self.age_ns().unwrap_or(0);
        u64::try_from(taken).unwrap_or(0)
    }
}

impl fmt::Display for Stamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match (self.clock, self.age_ns()) {
            (Clock::Monotonic, Some(_)) => "of the kernel's monotonic clock",
            (Clock::Monotonic, None) => {
                "said to be of the kernel's monotonic clock and are not: the first is set to when it came"
            }
            (Clock::Copied, _) => "those of the frames' source: the first is set to when it came",
            (Clock::Unknown, _) => {
                "of a clock that the driver does not name: the first is set to when it came"
            }
        })?;
        f.write_str(if self.is_of_start {
            ", at the start of the exposure"
        } else {
            ", at the end of the frame"
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamp(sensor_ns: i128, clock: Clock) -> Stamp {
        let now = Moment { monotonic_ns: 50_000_000_000, unix_ns: 1_700_000_000_000_000_000 };
        Stamp { sensor_ns, clock, is_of_start: true, now }
    }

    #[test]
    fn a_frame_was_taken_before_it_came() {
        let stamp = stamp(49_960_000_000, Clock::Monotonic);
        assert_eq!(stamp.unix_ns(), 1_700_000_000_000_000_000 - 40_000_000);
        assert_eq!(stamp.to_string(), "of the kernel's monotonic clock, at the start of the exposure");
    }

    #[test]
    fn a_stamp_of_another_clock_is_not_believed_but_for_its_distances() {
        for (sensor_ns, clock) in [
            (49_960_000_000, Clock::Unknown),
            (49_960_000_000, Clock::Copied),
            (0, Clock::Monotonic),
            (50_000_000_001, Clock::Monotonic),
            (1_700_000_000_000_000_000, Clock::Monotonic),
        ] {
            let stamp = stamp(sensor_ns, clock);
            assert_eq!(stamp.unix_ns(), 1_700_000_000_000_000_000, "{stamp}");
            assert!(stamp.to_string().contains("when it came"), "{stamp}");
        }
    }
}
