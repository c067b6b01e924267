//! How much of a core the daemon takes.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tests::daemon::Daemon;
use tests::process::Process;
use tests::programs::Program;

use crate::synthetic;
use crate::table::Table;

/// How long each time.
const WINDOW: Duration = Duration::from_secs(10);
/// How often.
const WINDOWS: usize = 3;

/// Measures, and adds rows.
pub(crate) fn measure(table: &mut Table) {
    let recordings = tempfile::tempdir().expect("a folder");
    let empty = synthetic(recordings.path(), "empty", 300);
    let held = format!("{:?}", tests::root().join("recordings/held-2.mcap"));
    for (what, recording, is_busy, is_watched) in [
        ("idle, no source", None, false, false),
        ("idle, an empty scene at 30 frames a second", Some(&empty), false, false),
        ("the same, and a reader of every preview", Some(&empty), false, true),
        ("busy, held-2 again and again: a capture of new blades each 1.9 s", Some(&held), true, false),
        ("the same, and a reader of every preview", Some(&held), true, true),
    ] {
        let shares = shares(recording.map(String::as_str), is_busy, is_watched);
        table.row(&format!("**CPU share**, {what}"), "% of a core", shares);
    }
}

/// Per cent of a core in each window.
fn shares(recording: Option<&str>, is_busy: bool, is_watched: bool) -> Vec<f64> {
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("station.toml");
    let knots = |number: usize| {
        std::fs::write(&config, format!("refine.knots = {}\n", 3 + number % 62)).expect("room")
    };
    knots(0);
    let mut daemon = match recording {
        Some(recording) => {
            let settings = [("source.loop", "true".to_owned()), ("source.recording", recording.to_owned())];
            Daemon::start_in(folder, &settings)
        }
        None => {
            let mut command = Program::Capture.command(["run"]);
            for (key, name) in [("service.socket", "station.socket"), ("store.directory", "state")] {
                command.arg("--set").arg(format!("{key}={:?}", folder.path().join(name)));
            }
            Daemon::start_command(folder, command)
        }
    };
    let process = Process(daemon.running().id());
    let is_over = Arc::new(AtomicBool::new(false));
    let reader = is_watched.then(|| {
        let (mut station, is_over) = (daemon.connect(), Arc::clone(&is_over));
        std::thread::spawn(move || {
            let mut after = 0;
            while !is_over.load(Ordering::Relaxed) {
                after = station.preview(after).header().sequence;
            }
        })
    });
    let mut station = daemon.connect();
    let mut number = 0;
    // Each loop is to show blades that are not there yet: else nothing would be written or announced.
    let mut until = |end: Instant| {
        while let Some(left) = end.checked_duration_since(Instant::now()) {
            std::thread::sleep(left.min(Duration::from_secs(1)));
            if is_busy {
                number += 1;
                knots(number);
                assert_eq!(station.call("Reload", &json!({})).0["error"], Value::Null);
            }
        }
    };
    until(Instant::now() + Duration::from_secs(3));
    let mut shares = Vec::new();
    for _ in 0..WINDOWS {
        let (start, before) = (Instant::now(), process.processor_time());
        until(start + WINDOW);
        let taken = process.processor_time() - before;
        shares.push(100.0 * taken.as_secs_f64() / start.elapsed().as_secs_f64());
    }
    is_over.store(true, Ordering::Relaxed);
    if let Some(reader) = reader {
        reader.join().expect("the reader does not panic");
    }
    let status = daemon.connect().status();
    let count = |name| status[name].as_u64().expect("a number");
    let captures = count("captures") + count("repeats");
    assert_eq!(captures > 3, is_busy, "{captures} captures");
    shares
}
