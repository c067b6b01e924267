//! The same for many seeds, on all processors.

use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// What `measure` gives for each seed, in the order of the seeds, on as many threads as there are
/// processors: the result does not depend on how many there are.
///
/// # Panics
/// When `measure` does.
pub fn sweep<T: Send>(seeds: Range<u64>, measure: impl Fn(u64) -> T + Sync) -> Vec<T> {
    let next = AtomicU64::new(seeds.start);
    let results = Mutex::new(Vec::new());
    let work = || {
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= seeds.end {
                return;
            }
            let result = measure(seed);
            results.lock().expect("nothing panics while it is locked").push((seed, result));
        }
    };
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..processors {
            scope.spawn(work);
        }
    });
    let mut results = results.into_inner().expect("nothing panics while it is locked");
    results.sort_unstable_by_key(|(seed, _)| *seed);
    results.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_the_order_of_the_seeds() {
        // The first ones take longest.
        let slow = |seed: u64| (0..(20 - seed) * 1000).fold(seed, |sum, i| std::hint::black_box(sum ^ i ^ i));
        assert_eq!(sweep(3..20, slow), (3..20).collect::<Vec<_>>());
        assert!(sweep(5..5, slow).is_empty());
    }
}
