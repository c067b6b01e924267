//! Do the blades of a recording come through the daemon and its socket into the picture?

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use common::library::library_hash;
use serde_json::{Value, json};
use tempfile::TempDir;
use tests::programs::{Program, Running};
use tests::root;
use tests::station::Station;

/// A shipped recording.
fn recording() -> PathBuf {
    root().join("recordings/tuft.mcap")
}

/// A daemon on the shipped recording, with a socket of its own.
struct Daemon {
    folder: TempDir,
    _running: Running,
}

impl Daemon {
    /// `again`: the recording starts over at its end; `rate`: how fast, 0 as fast as it can.
    fn start(again: bool, rate: f64) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let socket = folder.path().join("station.socket");
        let settings = [
            format!("source.recording={:?}", recording()),
            format!("source.loop={again}"),
            format!("source.rate={rate:?}"),
            format!("service.socket={socket:?}"),
        ];
        let arguments = settings.into_iter().flat_map(|setting| ["--set".to_owned(), setting]);
        let command = Program::Capture.command(["run".to_owned()].into_iter().chain(arguments));
        let running = Running::start(command).wait_for_socket(&socket);
        Self { folder, _running: running }
    }

    fn socket(&self) -> PathBuf {
        self.folder.path().join("station.socket")
    }

    fn connect(&self) -> Station {
        Station::connect(&self.socket())
    }
}

/// The events of a replay of the shipped recording.
fn replay() -> Vec<Value> {
    let recording = recording();
    let finished = Program::Capture.run([Path::new("replay"), &recording, Path::new("--json")]);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    finished.stdout.lines().map(|line| serde_json::from_str(line).expect("JSON Lines")).collect()
}

#[test]
fn the_library_holds_the_very_blades_of_a_replay() {
    let events = replay();
    let end = events.last().expect("a replay ends with an event");
    assert_eq!(end["event"], "end");
    let ids: BTreeSet<&str> =
        events.iter().filter(|e| e["event"] == "blade").flat_map(|e| e["id"].as_str()).collect();
    assert!(!ids.is_empty(), "the recording shows blades");
    assert_eq!(end["blades"].as_u64(), Some(ids.len() as u64));

    let daemon = Daemon::start(false, 0.0);
    let library = daemon.connect().library_of_at_least(ids.len());
    let captured: BTreeSet<String> = library.blades().map(|blade| blade.id().to_string()).collect();
    assert_eq!(captured.iter().map(String::as_str).collect::<BTreeSet<_>>(), ids);
    assert_eq!(end["library_hash"].as_str(), Some(library_hash(library.bytes()).as_str()));
}

#[test]
fn a_replay_is_the_same_every_time() {
    assert_eq!(replay(), replay());
}

#[test]
fn a_reader_that_waits_gets_the_next_generation() {
    let daemon = Daemon::start(true, 0.0);
    let mut station = daemon.connect();
    let first = station.library_of_at_least(1);
    let second = station.library(first.generation());
    assert!(second.generation() > first.generation());
    let status = station.status();
    assert!(status["frames"].as_u64() > Some(0), "{status}");
    assert!(status["generation"].as_u64() >= Some(second.generation()), "{status}");
}

#[test]
fn a_reader_that_stalls_holds_nobody_up() {
    let daemon = Daemon::start(true, 0.0);
    let mut stalled = daemon.connect();
    stalled.library(0);
    let mut reader = daemon.connect();
    let first = reader.library_of_at_least(1);
    let second = reader.library(first.generation());
    let newest = stalled.library(1).generation();
    assert!(newest >= second.generation(), "the newest, not the next: {newest}");
}

#[test]
fn what_the_interface_does_not_know_gets_an_error() {
    let daemon = Daemon::start(true, 1.0);
    let mut station = daemon.connect();
    let (reply, descriptors) = station.call("GetLibrary", &json!({"after": -1}));
    assert_eq!(reply["error"], "io.sward.Station.InvalidGeneration", "{reply}");
    assert!(descriptors.is_empty());
    let (reply, _) = daemon.connect().call("MowTheLawn", &json!({}));
    assert!(reply["error"].is_string(), "{reply}");
    assert!(daemon.connect().status()["state"].is_string(), "the station still answers");
}

#[test]
fn the_renderer_draws_the_daemons_blades() {
    let daemon = Daemon::start(true, 1.0);
    let (socket, out) = (daemon.socket(), daemon.folder.path().join("pictures"));
    let arguments: [&dyn AsRef<std::ffi::OsStr>; 11] = [
        &"--headless",
        &"--socket",
        &socket,
        &"--out",
        &out,
        &"--frames",
        &"2",
        &"--wait-blades",
        &"1",
        &"--timeout-secs",
        &"50",
    ];
    let finished = Program::Render.run(arguments.map(|argument| argument.as_ref().to_owned()));
    assert_eq!(finished.code, Some(0), "{finished:?}");
    let pictures: Vec<&str> = finished.stdout.lines().collect();
    assert_eq!(pictures.len(), 2, "each path alone on a line: {finished:?}");
    for picture in pictures {
        let picture = image::open(picture).unwrap_or_else(|error| panic!("{picture}: {error}")).to_rgb8();
        let colours: BTreeSet<[u8; 3]> = picture.pixels().map(|pixel| pixel.0).collect();
        assert!(colours.len() > 100, "{} colours are no meadow", colours.len());
    }
}
