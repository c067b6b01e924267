//! The library's generation, which grows across restarts also when the clock steps back.
//!
//! A number above all that may be announced stands on disk before one is announced. Where it cannot be
//! read any more, the clock stands in for it: every number was above the clock of its time.

use std::io;
use std::path::Path;

use super::file::{text, write_atomically};

/// The file's name in the state directory.
const FILE: &str = "generation";
/// How many generations are set aside at once.
const BLOCK: u64 = 4096;

/// The last generation that was given, and those set aside.
#[derive(Debug)]
pub(crate) struct Generation {
    last: u64,
    /// Generations up to this one were set aside on disk.
    reserved: u64,
}

impl Generation {
    /// Goes on where the last run in `folder` ended. `now_us`: the clock, microseconds since 1970.
    pub(crate) fn open(folder: &Path, now_us: u64) -> Self {
        let path = folder.join(FILE);
        let stored = match text(&path) {
            Ok(text) => text.trim().parse().unwrap_or_else(|_| {
                tracing::warn!(path = %path.display(), "no generation stands there; the clock gives one");
                0
            }),
            Err(_) => 0,
        };
        // The largest that a reply of the service can hold.
        let last = now_us.max(stored).min(i64::MAX as u64 / 2);
        Self { last, reserved: last }
    }

    /// Sets the next generations aside, if none is left.
    ///
    /// # Errors
    /// When that cannot be written. [`Self::next`] goes on nevertheless.
    pub(crate) fn reserve(&mut self, folder: &Path) -> io::Result<()> {
        if self.reserved > self.last {
            return Ok(());
        }
        let reserved = self.last + BLOCK;
        write_atomically(folder, FILE, format!("{reserved}\n").as_bytes())?;
        self.reserved = reserved;
        Ok(())
    }

    /// The next one.
    pub(crate) fn next(&mut self) -> u64 {
        self.last += 1;
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gives `count` generations after a start at `now_us`; the first and the last.
    fn run(folder: &Path, now_us: u64, count: u64) -> (u64, u64) {
        let mut generation = Generation::open(folder, now_us);
        let mut given = (0..count).map(|_| {
            generation.reserve(folder).expect("room");
            generation.next()
        });
        let first = given.next().expect("at least one");
        (first, given.last().unwrap_or(first))
    }

    #[test]
    fn it_grows_across_restarts_also_when_the_clock_steps_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut before = 0;
        for now_us in [1_000_000, 2_000_000, 500, 0, 2_000_001] {
            let (first, last) = run(folder.path(), now_us, 2 * BLOCK + 7);
            assert!(first > before, "{first} after {before}");
            before = last;
        }
    }

    #[test]
    fn a_file_that_is_lost_or_broken_is_stood_in_for_by_the_clock() {
        let folder = tempfile::tempdir().expect("a folder");
        let (_, last) = run(folder.path(), 1_000_000, 10);
        std::fs::write(folder.path().join(FILE), "green").expect("room");
        assert!(run(folder.path(), 2_000_000, 1).0 > last);
        std::fs::remove_file(folder.path().join(FILE)).expect("it is there");
        assert!(run(folder.path(), 3_000_000, 1).0 > 2_000_000);
    }

    #[test]
    fn a_generation_of_nonsense_does_not_overflow() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join(FILE), u64::MAX.to_string()).expect("room");
        assert!(i64::try_from(run(folder.path(), 1, 3).1).is_ok());
    }
}
