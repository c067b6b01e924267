//! Do readers that stop in the middle, or are killed there, harm anybody else?

use std::fs;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::time::Duration;

use serde_json::{Value, json};
use tests::daemon::Daemon;
use tests::log::listen;
use tests::process::Process;
use tests::programs::{DEADLINE, Program, Running, wait_for};

/// A daemon with so many blades, that captures nothing.
fn with_blades(count: usize) -> Daemon {
    let folder = tempfile::tempdir().expect("a folder");
    let blades = folder.path().join("state/blades");
    fs::create_dir_all(&blades).expect("room");
    for number in 0..count {
        let length = 0.1 + 1e-4 * number as f64;
        let text = format!(
            "format = 1\nknots = [\n  {{ position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004] }},\n  {{ position_m = [0.0, {length:?}, 0.0], half_width_m = [0.0, 0.0] }},\n]\n"
        );
        fs::write(blades.join(format!("b{number}.toml")), text).expect("room");
    }
    let settings = [
        ("source.rate", "0.0".to_owned()),
        ("mask.near_m", "0.01".to_owned()),
        ("mask.far_m", "0.02".to_owned()),
    ];
    Daemon::start_in(folder, &settings)
}

#[test]
fn a_reader_that_stops_in_the_middle_of_a_reply_gets_the_rest_when_it_goes_on() {
    let mut daemon = with_blades(2000);
    let process = Process(daemon.running().id());
    let call = b"{\"method\":\"io.sward.Station.ListBlades\"}\0";
    let mut readers: Vec<UnixStream> = (0..10)
        .map(|_| {
            let mut stream = UnixStream::connect(daemon.socket()).expect("it listens");
            stream.set_read_timeout(Some(DEADLINE)).expect("a socket has a timeout");
            stream.write_all(call).expect("it reads");
            stream.read_exact(&mut [0; 1000]).expect("it answers");
            stream
        })
        .collect();
    let before = process.resident_kib();
    let mut station = daemon.connect();
    for mix in 2..20 {
        let after = station.library(0).generation();
        assert_eq!(station.call("SetMix", &json!({"name": "b7", "mix": mix})).0, json!({}));
        assert_eq!(station.library(after).len(), 2000);
    }
    let grown = process.resident_kib().saturating_sub(before);
    assert!(grown < 16 << 10, "{grown} KiB more for ten readers that sleep");

    // What it was told is from before it fell asleep, and whole.
    let mut rest = Vec::new();
    let mut byte = [0];
    let mut awake = readers.pop().expect("ten of them");
    let mut awake = std::io::BufReader::new(&mut awake);
    while byte[0] != 0 || rest.is_empty() {
        awake.read_exact(&mut byte).expect("the rest comes");
        rest.push(byte[0]);
    }
    rest.pop();
    let text = String::from_utf8(rest).expect("UTF-8");
    let end = text.rfind("\"refused\"").map(|at| &text[at..]);
    assert_eq!(end, Some("\"refused\":[]}}"), "{}", &text[text.len().saturating_sub(200)..]);
    assert!(text.matches("\"captured_unix_ns\"").count() > 1990);
    // Those that go away in the middle leave nothing behind.
    drop(readers);
    wait_for(DEADLINE, || (station.status()["clients"] == json!(2)).then_some(())).expect("they are gone");
}

#[test]
fn renderers_that_are_killed_while_they_map_the_library_leave_nothing_behind() {
    let mut daemon = with_blades(300);
    let process = Process(daemon.running().id());
    let mut station = daemon.connect();
    let pictures = tempfile::tempdir().expect("a folder");
    let mut few = None;
    for round in 0..6u64 {
        let (heard, told) = listen(&["new library"]);
        let mut command = Program::Render.command(["--headless", "--frames", "100000000", "--size", "64x36"]);
        command.arg("--socket").arg(daemon.socket()).arg("--out").arg(pictures.path());
        let mut renderer = Running::follow(command, heard);
        told.recv_timeout(DEADLINE).expect("it gets its library");
        // It gets another one, and another, until it is killed with one in its hands.
        for mix in 1..=5 {
            assert_eq!(station.call("SetMix", &json!({"name": "b1", "mix": mix})).0, json!({}));
        }
        std::thread::sleep(Duration::from_millis(7 * round));
        renderer.kill();
        wait_for(DEADLINE, || (station.status()["clients"] == json!(1)).then_some(())).expect("it is gone");
        // A library that was replaced is let go of a moment later.
        let first = *few.get_or_insert_with(|| process.descriptors());
        let back = wait_for(DEADLINE, || (process.descriptors() <= first).then_some(()));
        assert!(back.is_some(), "round {round}: {} descriptors, {first} at first", process.descriptors());
    }
    let library = station.library(0);
    assert_eq!(library.len(), 300);
    assert_eq!(station.call("GetStatus", &json!({})).0["error"], Value::Null);
}
