//! Runs the cases of a target, and watches their memory and their time.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::ALLOCATED;
use tests::random::Random;

/// Memory that one case may take above what was there before, bytes: a message and a chunk of 64 MiB
/// each, which is the most that is believed, and what they are decoded to.
const MAX_BYTES: usize = 256 << 20;
/// A case that takes longer hangs.
const MAX_CASE: Duration = Duration::from_secs(60);

/// One at a time: memory is counted for the whole program.
static ALONE: Mutex<()> = Mutex::new(());

fn variable(name: &str) -> Option<u64> {
    let value = std::env::var(name).ok()?;
    Some(value.parse().unwrap_or_else(|_| panic!("{name} is {value:?}; expected a whole number")))
}

/// Says which case it was when a panic passes by.
struct Witness<'a> {
    target: &'a str,
    case: u64,
}

impl Drop for Witness<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("{}: {}", self.target, repeat(self.case));
        }
    }
}

fn repeat(case: u64) -> String {
    format!("this was case {case}; SWARD_FUZZ_START={case} SWARD_FUZZ_CASES=1 repeats it")
}

/// Runs `cases` cases of a target, or as the environment says. Each gets its own random numbers and a
/// folder to write to, which is emptied now and then.
///
/// # Panics
/// When a case does, or takes too much memory. One that hangs ends the program.
pub(crate) fn run(target: &str, cases: u64, case: fn(&mut Random, &Path)) {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let start = variable("SWARD_FUZZ_START").unwrap_or(0);
    let seconds = variable("SWARD_FUZZ_SECONDS").map(Duration::from_secs);
    let cases =
        variable("SWARD_FUZZ_CASES").unwrap_or(if seconds.is_some() { u64::MAX - start } else { cases });
    let began = Instant::now();
    let (current, done) = (Arc::new(AtomicU64::new(start)), Arc::new(AtomicBool::new(false)));
    let watch = watch(target.to_owned(), current.clone(), done.clone());

    let mut folder = tempfile::tempdir().expect("a temporary folder");
    let (mut ran, mut most) = (0, 0);
    while ran < cases && seconds.is_none_or(|seconds| began.elapsed() < seconds) {
        let number = start + ran;
        current.store(number, Ordering::Relaxed);
        if ran % 512 == 511 {
            folder = tempfile::tempdir().expect("a temporary folder");
        }
        let witness = Witness { target, case: number };
        let before = ALLOCATED.current_usage();
        ALLOCATED.reset_peak_usage();
        case(&mut Random::new(number), folder.path());
        let taken = ALLOCATED.peak_usage().saturating_sub(before);
        assert!(taken <= MAX_BYTES, "{taken} bytes at once; {MAX_BYTES} are enough for any case");
        most = most.max(taken);
        drop(witness);
        ran += 1;
    }
    done.store(true, Ordering::Relaxed);
    watch.join().expect("the watch does not panic");
    let seconds = began.elapsed().as_secs_f64();
    eprintln!("{target}: {ran} cases in {seconds:.1} s, at most {} KiB at once", most >> 10);
}

/// Ends the program when the same case is at work for too long.
fn watch(target: String, current: Arc<AtomicU64>, done: Arc<AtomicBool>) -> std::thread::JoinHandle<()> {
    std::thread::spawn(move || {
        let (mut seen, mut since) = (current.load(Ordering::Relaxed), Instant::now());
        while !done.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(50));
            let now = current.load(Ordering::Relaxed);
            if now != seen {
                (seen, since) = (now, Instant::now());
            } else if since.elapsed() > MAX_CASE && Arc::strong_count(&done) > 1 {
                eprintln!("{target}: hangs for {MAX_CASE:?}; {}", repeat(seen));
                std::process::abort();
            }
        }
    })
}
