//! What would fill a log: said at once, and then added up.

use std::time::{Duration, Instant};

/// How often, at most, the log says what recurs.
const SAY_EVERY: Duration = Duration::from_secs(60);

/// Something that may happen very often, and is said once in a while with how often it did.
#[derive(Debug, Default)]
pub(crate) struct Recurring {
    said: Option<Instant>,
    unsaid: u64,
}

impl Recurring {
    /// Counts; how many to tell of, if it is time to.
    pub(crate) fn count(&mut self, more: u64) -> Option<u64> {
        self.unsaid += more;
        let is_time = self.said.is_none_or(|said| said.elapsed() >= SAY_EVERY);
        (self.unsaid > 0 && is_time).then(|| {
            self.said = Some(Instant::now());
            std::mem::take(&mut self.unsaid)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_recurs_is_said_at_once_and_then_added_up() {
        let mut recurring = Recurring::default();
        assert_eq!(recurring.count(0), None, "there is nothing to say");
        assert_eq!(recurring.count(3), Some(3));
        assert_eq!(recurring.count(1), None);
        assert_eq!(recurring.count(1), None);
        recurring.said = Instant::now().checked_sub(SAY_EVERY);
        assert_eq!(recurring.count(0), Some(2));
        assert_eq!(recurring.count(0), None);
    }
}
