//! How long it is waited before a sensor is tried again.

use std::time::Duration;

use rand_pcg::Pcg32;
use rand_pcg::rand_core::RngCore;

/// The first wait.
const FIRST: Duration = Duration::from_millis(500);
/// The longest.
const LONGEST: Duration = Duration::from_secs(60);

/// Waits that double, from half a second up to a minute, each up to a quarter shorter by chance, so that stations that lost
/// power together do not come back together.
#[derive(Debug)]
pub(super) struct Backoff {
    next: Duration,
    random: Pcg32,
}

impl Backoff {
    /// `seed`: of the chance.
    pub(super) fn new(seed: u64) -> Self {
        Self { next: FIRST, random: Pcg32::new(seed, 0) }
    }

    /// The next wait.
    pub(super) fn wait(&mut self) -> Duration {
        let wait = self.next;
        self.next = (2 * wait).min(LONGEST);
        let share = f64::from(self.random.next_u32()) / f64::from(u32::MAX);
        wait.mul_f64(1.0 - 0.25 * share)
    }

    /// Begins anew: it works again.
    pub(super) fn reset(&mut self) {
        self.next = FIRST;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_double_up_to_a_minute_and_none_is_like_the_other() {
        let mut backoff = Backoff::new(7);
        let waits: Vec<f64> = (0..12).map(|_| backoff.wait().as_secs_f64()).collect();
        let mut full = 0.5;
        for wait in &waits {
            assert!((0.75 * full..=full).contains(wait), "{waits:?}");
            full = f64::min(2.0 * full, 60.0);
        }
        assert_ne!(waits[10], waits[11]);
        assert_ne!(Backoff::new(8).wait(), Backoff::new(9).wait());
        backoff.reset();
        assert!(backoff.wait() <= FIRST);
    }
}
