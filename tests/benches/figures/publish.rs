//! How long a library takes to be announced, and to be received.

use std::sync::mpsc::channel;
use std::time::Instant;

use serde_json::json;
use tests::daemon::Daemon;
use tests::log::listen;
use tests::programs::DEADLINE;

use crate::table::Table;
use crate::{fill, nothing_to_see};

/// Measures, and adds rows.
pub(crate) fn measure(table: &mut Table) {
    for (blades, times) in [(1, 200), (256, 200), (4096, 60)] {
        of_library(table, blades, times);
    }
}

fn ms(since: Instant) -> f64 {
    1e3 * since.elapsed().as_secs_f64()
}

fn of_library(table: &mut Table, blades: usize, times: usize) {
    let folder = tempfile::tempdir().expect("a folder");
    fill(&folder.path().join("state"), blades);
    let mut command = Daemon::command(folder.path(), &nothing_to_see());
    command.env("SWARD_LOG", "info,capture_daemon::keeper=debug");
    let (heard, told) = listen(&["announced"]);
    let daemon = Daemon::start_followed(folder, command, heard);
    let (mut orders, mut reader, mut waiter) = (daemon.connect(), daemon.connect(), daemon.connect());
    let mut after = waiter.library(0).generation();
    let _ = told.try_iter().count();

    let (came, comes) = channel();
    let waiting = std::thread::spawn(move || {
        while let Ok(library) = waiter.try_library(after) {
            after = library.generation();
            if came.send((after, Instant::now())).is_err() {
                return;
            }
        }
    });
    let (mut publish, mut order, mut wait, mut receive) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for number in 0..times {
        let asked = Instant::now();
        let mix = json!({"name": "b0", "mix": 1 + number % 7});
        assert_eq!(orders.call("SetMix", &mix).0, json!({}));
        order.push(ms(asked));
        let line = told.recv_timeout(DEADLINE).expect("it is announced");
        publish.push(1e3 * line.field::<f64>("seconds").expect("it is said"));
        let generation: u64 = line.field("generation").expect("it is said");
        let (_, at) = comes.iter().find(|(came, _)| *came == generation).expect("the reader has it");
        wait.push(1e3 * at.duration_since(asked).as_secs_f64());
        let asked = Instant::now();
        let library = reader.library(0);
        receive.push(ms(asked));
        assert_eq!((library.generation(), library.len()), (generation, blades));
    }
    drop((comes, daemon));
    waiting.join().expect("the reader does not panic");
    let plural = if blades == 1 { "1 blade".to_owned() } else { format!("{blades} blades") };
    table.row(
        &format!("**{plural}: publish** (encode, hash, seal, hand to whoever waits; in the daemon)"),
        "ms",
        publish,
    );
    table.row(
        &format!("**{plural}: receive** (`GetLibrary` → mapped and checked snapshot; in the client)"),
        "ms",
        receive,
    );
    table.row(
        &format!("{plural}: `SetMix` sent → its reply (the blade's file is on disk by then)"),
        "ms",
        order,
    );
    table.row(
        &format!("{plural}: `SetMix` sent → a reader that waited has the checked snapshot"),
        "ms",
        wait,
    );
}
