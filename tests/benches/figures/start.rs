//! How long a start takes until systemd would hear that it is over.

use std::os::unix::net::UnixDatagram;
use std::time::Instant;

use tests::daemon::Daemon;
use tests::programs::{DEADLINE, Running};

use crate::table::Table;
use crate::{fill, nothing_to_see};

/// Starts of each library.
const STARTS: usize = 10;

/// Measures, and adds rows.
pub(crate) fn measure(table: &mut Table) {
    for blades in [0, 4096] {
        let folder = tempfile::tempdir().expect("a folder");
        fill(&folder.path().join("state"), blades);
        let ready: Vec<f64> = (0..=STARTS).map(|_| ready_ms(folder.path(), blades)).collect();
        // The first one makes what is missing of the folders, and finds no file in the cache.
        table.row(
            &format!("**exec → READY=1** with {blades} blades in the store"),
            "ms",
            ready[1..].to_vec(),
        );
    }
}

fn ready_ms(folder: &std::path::Path, blades: usize) -> f64 {
    let notify = folder.join("notify");
    let _ = std::fs::remove_file(&notify);
    let manager = UnixDatagram::bind(&notify).expect("a free path");
    manager.set_read_timeout(Some(DEADLINE)).expect("a socket has a timeout");
    let mut command = Daemon::command(folder, &nothing_to_see());
    command.env("NOTIFY_SOCKET", &notify);
    let start = Instant::now();
    let running = Running::start(command);
    let mut message = [0; 4096];
    let ms = loop {
        let read = manager.recv(&mut message).expect("it gets ready");
        let text = String::from_utf8_lossy(&message[..read]).into_owned();
        if text.lines().any(|line| line == "READY=1") {
            break 1e3 * start.elapsed().as_secs_f64();
        }
    };
    let status = tests::station::Station::connect(&folder.join("station.socket")).status();
    assert_eq!(status["blades"].as_u64(), Some(blades as u64), "{status}");
    running.terminate();
    assert_eq!(running.finish(DEADLINE).code, Some(0));
    ms
}
