//! Do the blades of a recording come through the daemon and its socket into the picture?

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};

use common::blade::check_knots;
use common::library::library_hash;
use serde_json::{Value, json};
use tempfile::TempDir;
use tests::daemon::Daemon;
use tests::programs::{DEADLINE, Program, wait_for};
use tests::shipped_recording;

/// Two visitors after each other, each with a blade: the frames of two synthetic recordings in one
/// folder of pictures.
fn two_visitors(folder: &Path) -> PathBuf {
    let both = folder.join("both");
    std::fs::create_dir(&both).expect("a folder");
    for seed in ["3", "4"] {
        let arguments =
            ["--family", "single", "--format", "png", "--size", "320x240", "--seed", seed, "--out"];
        let arguments = ["synth"].into_iter().chain(arguments).map(Path::new).chain([folder]);
        assert_eq!(Program::Capture.run(arguments).code, Some(0));
        let visitor = std::fs::read_dir(folder.join(format!("single-{seed}"))).expect("it was written");
        for frame in visitor.map(|entry| entry.expect("readable").path()) {
            let name = frame.file_name().and_then(|name| name.to_str()).expect("UTF-8");
            let name = if name == "camera.toml" { name.to_owned() } else { format!("{seed}-{name}") };
            std::fs::rename(&frame, both.join(name)).expect("the same folder");
        }
    }
    both
}

fn on_the_shipped_recording() -> Daemon {
    Daemon::start(&[("source.rate", "0.0".to_owned())])
}

fn on_two_visitors() -> Daemon {
    let folder = folder();
    let recording = two_visitors(folder.path());
    Daemon::start_in(folder, &[("source.recording", format!("{recording:?}"))])
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// The events of a replay of the shipped recording.
fn replay() -> Vec<Value> {
    let recording = shipped_recording();
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

    let daemon = on_the_shipped_recording();
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
fn a_reader_that_waits_gets_each_generation_and_one_that_stalls_the_newest() {
    let daemon = on_two_visitors();
    let (mut reader, mut stalled) = (daemon.connect(), daemon.connect());
    let seen = stalled.library(0).generation();
    let first = reader.library_of_at_least(1);
    let second = reader.library(first.generation());
    assert_eq!((first.len(), second.len()), (1, 2), "the second visitor's blade joins the first's");
    assert!(second.generation() > first.generation());
    assert_eq!(stalled.library(seen).generation(), second.generation(), "the newest, not the next");

    let status = reader.status();
    assert_eq!(status["generation"].as_u64(), Some(second.generation()), "{status}");
    assert_eq!((status["blades"].as_u64(), status["captures"].as_u64()), (Some(2), Some(2)), "{status}");
    assert!(status["frames"].as_u64() > Some(0), "{status}");
}

#[test]
fn a_library_that_was_received_outlives_the_daemon() {
    let daemon = on_the_shipped_recording();
    let library = daemon.connect().library_of_at_least(1);
    let hash = library_hash(library.bytes());
    let _folder = daemon.kill();
    assert_eq!(library_hash(library.bytes()), hash);
    assert!(library.blades().all(|blade| check_knots(&blade.knots()).is_ok()));
}

#[test]
fn a_daemon_that_is_asked_to_end_ends_and_takes_its_socket_with_it() {
    let (folder, finished) = on_two_visitors().end();
    assert_eq!(finished.code, Some(0), "{finished:?}");
    assert!(!folder.path().join("station.socket").exists());
}

#[test]
fn the_station_serves_the_interface_of_its_file() {
    assert_eq!(on_the_shipped_recording().connect().description(), common::protocol::DEFINITION);
}

#[test]
fn a_recording_that_is_over_is_no_source() {
    let daemon = Daemon::start(&[("source.rate", "0.0".to_owned()), ("source.loop", "false".to_owned())]);
    let mut station = daemon.connect();
    wait_for(DEADLINE, || (station.status()["state"] == "no_source").then_some(())).expect("it is over");
    assert!(station.status()["frames"].as_u64() > Some(0), "{}", station.status());
}

#[test]
fn what_the_interface_does_not_know_harms_nobody_else() {
    let daemon = on_the_shipped_recording();
    let mut station = daemon.connect();
    let (reply, descriptors) = station.call("GetLibrary", &json!({"after": -1}));
    assert_eq!(reply["error"], "io.sward.Station.InvalidGeneration", "{reply}");
    assert!(descriptors.is_empty());
    let mut noise = UnixStream::connect(daemon.socket()).expect("it listens");
    noise.write_all(b"\x16\x03\x01 mow the lawn\0{}\0").expect("it reads");
    let mut unknown = UnixStream::connect(daemon.socket()).expect("it listens");
    unknown.write_all(b"{\"method\":\"io.sward.Station.Mow\"}\0").expect("it reads");
    let mut reply = [0; 100];
    let read = unknown.read(&mut reply).expect("it answers");
    let reply = String::from_utf8_lossy(&reply[..read]).into_owned();
    assert!(reply.contains("org.varlink.service.MethodNotFound"), "{reply}");
    assert!(station.status()["state"].is_string(), "the station still answers");
}

#[test]
fn the_renderer_draws_the_daemons_blades() {
    let daemon = on_two_visitors();
    let (socket, out) = (daemon.socket(), daemon.folder().join("pictures"));
    let arguments: [&dyn AsRef<OsStr>; 11] = [
        &"--headless",
        &"--socket",
        &socket,
        &"--out",
        &out,
        &"--frames",
        &"2",
        &"--wait-blades",
        &"2",
        &"--timeout-secs",
        &"50",
    ];
    let finished = Program::Render.run(arguments);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    let pictures: Vec<&str> = finished.stdout.lines().collect();
    assert_eq!(pictures.len(), 2, "each path alone on a line: {finished:?}");
    for picture in pictures {
        let picture = image::open(picture).unwrap_or_else(|error| panic!("{picture}: {error}")).to_rgb8();
        let colours: BTreeSet<[u8; 3]> = picture.pixels().map(|pixel| pixel.0).collect();
        assert!(colours.len() > 100, "{} colours are no meadow", colours.len());
    }
}
