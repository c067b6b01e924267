//! Does a recording of a live run give the very blades of that run, can it be read whatever ends it, and does recording
//! harm nothing else? `SWARD_KILLS=100` kills the station so often while it records, instead of 5 times.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use capture_daemon::recording::{self, OpenOptions};
use capture_daemon::source::SourceError;
use capture_daemon::source::faulty::FaultKind;
use common::library::library_hash;
use serde_json::{Value, json};
use tests::daemon::Daemon;
use tests::faulty::{Faulty, count, on_a_small_disk, wait_until};
use tests::programs::{DEADLINE, Finished, Program, Running, wait_for};
use tests::random::Random;

/// The settings of a sensor and more.
fn with(faulty: &Faulty, more: &[(&'static str, &str)]) -> Vec<(&'static str, String)> {
    let mut settings = faulty.settings();
    settings.extend(more.iter().map(|(key, value)| (*key, (*value).to_owned())));
    settings
}

/// The events that a program printed.
fn events(finished: &Finished) -> Vec<Value> {
    assert_eq!(finished.code, Some(0), "{finished:?}");
    finished.stdout.lines().map(|line| serde_json::from_str(line).expect("JSON Lines")).collect()
}

fn replay(recording: &Path, more: &[&str]) -> Vec<Value> {
    let mut arguments = vec!["replay".to_owned(), recording.display().to_string(), "--json".to_owned()];
    arguments.extend(more.iter().map(|argument| (*argument).to_owned()));
    events(&Program::Capture.run(arguments))
}

fn ids(events: &[Value]) -> BTreeSet<String> {
    let blades = events.iter().filter(|event| event["event"] == "blade");
    blades.map(|event| event["id"].as_str().expect("an id").to_owned()).collect()
}

/// The recordings in a folder, oldest first.
fn recordings(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut files: Vec<PathBuf> = entries.filter(|path| path.is_file()).collect();
    files.sort();
    files
}

/// Times of all frames of a recording that can be opened.
fn times(path: &Path) -> Vec<u64> {
    let mut source = recording::open(path, &OpenOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    let mut times = Vec::new();
    loop {
        match source.next_frame() {
            Ok(frame) => times.push(frame.timestamp_ns),
            Err(SourceError::Told(_)) => {}
            Err(SourceError::End) => return times,
            Err(error) => panic!("{}: {error}", path.display()),
        }
    }
}

/// `sward-capture record` with these arguments, on a sensor.
fn record(faulty: &Faulty, arguments: &[&str]) -> Finished {
    let mut all = vec!["record".to_owned()];
    all.extend(arguments.iter().map(|argument| (*argument).to_owned()));
    all.extend(faulty.arguments());
    Program::Capture.run(all)
}

#[test]
fn what_record_captures_a_replay_captures_bit_for_bit() {
    let faulty = Faulty::on("row-3.mcap");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let shown = path.display().to_string();
    let settings = ["--set", "refine.knots=11", "--set", "mask.far_m=0.87", "--set", "capture.hold_s=0.3"];
    let arguments = [&[shown.as_str(), "--seconds", "4", "--json"], &settings[..]].concat();
    let live = events(&record(&faulty, &arguments));
    assert!(ids(&live).len() >= 10, "several captures: {live:?}");
    // The configuration is in there.
    assert_eq!(replay(&path, &[]), live);
    // What is given over it holds.
    assert!(
        replay(&path, &["--set", "refine.knots=9"])
            .iter()
            .any(|event| { event["knots"].as_array().is_some_and(|knots| knots.len() == 9) })
    );
    let config = folder.path().join("other.toml");
    fs::write(&config, "refine.knots = 7\n").expect("room");
    let other = replay(&path, &["--config", config.to_str().expect("UTF-8")]);
    assert!(other.iter().any(|event| event["knots"].as_array().is_some_and(|knots| knots.len() == 7)));

    let info = Program::Capture.run(["info", "--json", &shown]);
    let info: Value = serde_json::from_str(&info.stdout).expect("JSON");
    let metadata = &info["metadata"]["sward"];
    assert!(
        metadata["sensor"].as_str().is_some_and(|name| name.contains("faulty sensor, 640x480")),
        "{info}"
    );
    assert_eq!((&metadata["serial"], &metadata["depth_unit_m"]), (&json!("F1"), &json!("0.001")), "{info}");
    assert!(metadata["config"].as_str().is_some_and(|config| config.contains("knots = 11")), "{info}");
    assert_eq!((&info["damage"], &info["skipped_frames"]), (&json!([]), &json!(0)), "{info}");

    let again = record(&faulty, &[&shown, "--seconds", "1"]);
    assert!(again.code == Some(1) && again.stderr.contains("exists already"), "{again:?}");
}

#[test]
fn record_that_is_interrupted_ends_its_file() {
    let faulty = Faulty::on("row-3.mcap");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let mut arguments = vec!["record".to_owned(), path.display().to_string()];
    arguments.extend(faulty.arguments());
    let running = Running::start(Program::Capture.command(arguments));
    let has_frames = || fs::metadata(&path).is_ok_and(|metadata| metadata.len() > 500_000).then_some(());
    wait_for(DEADLINE, has_frames).expect("it records");
    running.terminate();
    let finished = running.finish(DEADLINE);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    let info = Program::Capture.run([Path::new("info"), &path, Path::new("--json")]);
    let info: Value = serde_json::from_str(&info.stdout).expect("JSON");
    assert_eq!(info["damage"], json!([]), "{info}");
}

#[test]
fn a_recording_that_stands_in_for_a_sensor_is_recorded_frame_by_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let shipped = tests::shipped_recording();
    let source = format!("source.recording={shipped:?}");
    let out = path.to_str().expect("UTF-8");
    let recorded =
        Program::Capture.run(["record", out, "--json", "--set", &source, "--set", "source.rate=0.0"]);
    let recorded = events(&recorded);
    assert_eq!(recorded, replay(&path, &[]));
    assert_eq!(recorded, replay(&shipped, &[]));
    assert_eq!(times(&path), times(&shipped));
}

#[test]
fn a_replay_of_what_a_station_recorded_gives_its_very_library_whatever_happened() {
    let faulty = Faulty::on("row-3.mcap");
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("station.toml");
    fs::write(&config, "refine.knots = 16\n").expect("room");
    let daemon = Daemon::start_in(folder, &with(&faulty, &[("record.always", "true")]));
    let mut station = daemon.connect();
    wait_until(&mut station, "it captures", |status| count(status, "captures") >= 1);
    let config = daemon.folder().join("station.toml");
    fs::write(&config, "refine.knots = 12\nmask.far_m = 0.88\n").expect("room");
    let (reply, _) = station.call("Reload", &json!({}));
    assert_eq!(reply["parameters"]["changed"], json!(["mask.far_m", "refine.knots"]), "{reply}");
    // Whatever comes of it.
    station.call("Capture", &json!({}));
    let before = count(&station.status(), "captures");
    faulty.befalls(&[
        (0.2, FaultKind::Clock { step_s: -3.0 }),
        (0.7, FaultKind::Zero { frames: 2 }),
        (1.2, FaultKind::Torn { frames: 2 }),
        (1.9, FaultKind::Lost { frames: 3 }),
        (2.6, FaultKind::Clock { step_s: 3600.0 }),
        (3.3, FaultKind::Reset),
        (7.0, FaultKind::Unplug { for_s: 1000.0 }),
    ]);
    wait_until(&mut station, "it captures on", |status| count(status, "captures") > before + 1);
    wait_until(&mut station, "it is gone", |status| {
        status["sensor"].as_str().is_some_and(|it| it.contains("not plugged"))
    });
    let status = wait_until(&mut station, "all is kept", |status| count(status, "waiting") == 0);
    assert_eq!((count(&status, "unrecorded_slow"), count(&status, "unrecorded_disk")), (0, 0), "{status}");
    let library = station.library(0);
    let (folder, finished) = daemon.end();
    assert_eq!(finished.code, Some(0), "{finished:?}");
    let files = recordings(&folder.path().join("state/recordings"));
    assert_eq!(files.len(), 1, "{files:?}");
    let replayed = replay(&files[0], &[]);
    let captured: BTreeSet<String> = library.blades().map(|blade| blade.id().to_string()).collect();
    assert_eq!(ids(&replayed), captured);
    let end = replayed.last().expect("an end");
    assert_eq!(end["library_hash"].as_str(), Some(library_hash(library.bytes()).as_str()), "{end}");
    assert_eq!(end["frames"], json!(count(&status, "frames")), "each frame that was seen");
}

#[test]
fn a_recording_that_is_begun_in_the_midst_of_a_visit_gives_the_blades_from_there_on() {
    let faulty = Faulty::on("row-3.mcap");
    let daemon = Daemon::start(&with(&faulty, &[]));
    let mut station = daemon.connect();
    let mut random = Random::new(3);
    wait_until(&mut station, "it captures", |status| count(status, "captures") >= 1);
    for _ in 0..3 {
        std::thread::sleep(Duration::from_secs_f64(random.within(0.0, 0.8)));
        let name = daemon.client(&["recordings", "start"]).stdout.trim().to_owned();
        let before = count(&station.status(), "captures");
        wait_until(&mut station, "it captures", |status| count(status, "captures") >= before + 2);
        let stopped = daemon.client(&["recordings", "stop"]);
        assert!(stopped.code == Some(0) && stopped.stdout.starts_with(&name), "{stopped:?}");
        let path = daemon.folder().join(format!("state/recordings/{name}.mcap"));
        let seen = times(&path);
        let (first, last) = (seen[0], seen[seen.len() - 1]);
        // Its own kept copy is announced soon after.
        let replayed = ids(&replay(&path, &[]));
        let within = |station: &mut tests::station::Station| -> BTreeSet<String> {
            let library = station.library(0);
            let of_recording =
                library.blades().filter(|blade| (first..=last).contains(&blade.captured_unix_ns()));
            of_recording.map(|blade| blade.id().to_string()).collect()
        };
        assert!(!replayed.is_empty());
        let agrees = wait_for(DEADLINE, || (within(&mut station) == replayed).then_some(()));
        let status = station.status();
        assert!(agrees.is_some(), "{replayed:?}, and the station has {:?}: {status}", within(&mut station));
    }
}

#[test]
fn killed_at_any_moment_a_recording_is_read_up_to_the_last_seconds() {
    let kills: u64 = std::env::var("SWARD_KILLS").map_or(5, |number| number.parse().expect("a whole number"));
    let faulty = Faulty::on("row-3.mcap");
    let mut folder = tempfile::tempdir().expect("a folder");
    let mut random = Random::new(11);
    let mut lost_ms = Vec::new();
    for round in 0..kills {
        let daemon = Daemon::start_in(
            folder,
            &with(&faulty, &[("record.always", "true"), ("record.max_mb", "200.0")]),
        );
        let mut station = daemon.connect();
        wait_until(&mut station, "it records", |status| count(status, "recorded_frames") > 30);
        std::thread::sleep(Duration::from_secs_f64(random.within(0.0, 1.5)));
        let seen = station.preview(0).header().timestamp_ns;
        folder = daemon.kill();
        let files = recordings(&folder.path().join("state/recordings"));
        let last = *times(files.last().expect("a recording")).last().expect("frames");
        lost_ms.push(seen.saturating_sub(last) / 1_000_000);
        // A second is what is aimed at; a machine that is busy with other tests takes longer for its disk.
        assert!(lost_ms[round as usize] < 3000, "round {round}: {lost_ms:?} ms are lost");
        for file in &files {
            assert!(!times(file).is_empty(), "{}", file.display());
        }
    }
    eprintln!("{kills} kills; of what was seen these ms are lost: {lost_ms:?}");
}

#[test]
fn a_full_disk_leaves_whole_recordings_and_it_goes_on_when_there_is_room() {
    let faulty = Faulty::on("row-3.mcap");
    let folder = tempfile::tempdir().expect("a folder");
    let disk = folder.path().join("disk");
    fs::create_dir(&disk).expect("room");
    let directory = format!("{:?}", disk.join("recordings"));
    let settings = with(&faulty, &[("record.always", "true"), ("record.directory", &directory)]);
    let command = Daemon::command(folder.path(), &settings);
    let Some(inside) = on_a_small_disk(&disk, 4_000_000, &command) else { return };
    let mut daemon = Daemon::start_command(folder, inside);
    let mut station = daemon.connect();
    // What the system said, and then what is lacking.
    let is_full = |status: &Value| {
        let trouble = status["recording_trouble"].as_str().unwrap_or_default();
        trouble.contains("No space left") || trouble.contains("MB are free")
    };
    let full = wait_until(&mut station, "it is full", is_full);
    let frames = count(&full, "recorded_frames");
    assert!(frames > 20, "{full}");
    // All else goes on, and what is missing is counted.
    let captures = count(&full, "captures");
    let status = wait_until(&mut station, "it goes on", |status| count(status, "captures") > captures);
    assert!(count(&status, "unrecorded_disk") > 0 && status["store"] == "ok", "{status}");
    let inside = Path::new(&format!("/proc/{}/root", daemon.running().id()))
        .join(disk.strip_prefix("/").expect("an absolute path"))
        .join("recordings");
    let files = recordings(&inside);
    let copy = daemon.folder().join("copy.mcap");
    fs::copy(&files[0], &copy).expect("room");
    let whole = times(&copy).len() as i64;
    // The chunk that found no room is missing.
    assert!(whole > frames - 40 && whole <= frames, "{whole} of {frames}");
    fs::remove_file(&files[0]).expect("it is there");
    wait_until(&mut station, "it records again", |status| {
        status["recording_trouble"] == "ok" && count(status, "recorded_frames") > frames + 10
    });
}

/// Starts a recording, waits for some frames, and stops it; its name.
fn record_some(daemon: &Daemon, frames: i64) -> String {
    let mut station = daemon.connect();
    let name = daemon.client(&["recordings", "start"]).stdout.trim().to_owned();
    let before = count(&station.status(), "recorded_frames");
    wait_until(&mut station, "it records", |status| count(status, "recorded_frames") > before + frames);
    let stopped = daemon.client(&["recordings", "stop"]);
    assert!(stopped.code == Some(0) && stopped.stdout.starts_with(&name), "{stopped:?}");
    name
}

#[test]
fn the_reserve_is_kept_free_and_it_goes_on_when_there_is_room() {
    let faulty = Faulty::on("row-3.mcap");
    let folder = tempfile::tempdir().expect("a folder");
    let disk = folder.path().join("disk");
    fs::create_dir(&disk).expect("room");
    let directory = format!("{:?}", disk.join("recordings"));
    let settings = with(&faulty, &[("record.directory", &directory), ("record.reserve_mb", "8.0")]);
    let command = Daemon::command(folder.path(), &settings);
    let Some(inside) = on_a_small_disk(&disk, 16_000_000, &command) else { return };
    let mut daemon = Daemon::start_command(folder, inside);
    let mut station = daemon.connect();
    wait_until(&mut station, "it streams", |status| count(status, "frames") > 0);
    let first = record_some(&daemon, 20);
    let second = daemon.client(&["recordings", "start"]).stdout.trim().to_owned();
    let lacks = |status: &Value| {
        status["recording_trouble"].as_str().is_some_and(|it| it.contains("record.reserve_mb"))
    };
    let status = wait_until(&mut station, "room is lacking", lacks);
    let inside = Path::new(&format!("/proc/{}/root", daemon.running().id()))
        .join(disk.strip_prefix("/").expect("an absolute path"))
        .join("recordings");
    // It ended where there was room for its end: whole, with its summary; and what was there stays.
    let info = Program::Capture.run([
        Path::new("info"),
        &inside.join(format!("{second}.mcap")),
        Path::new("--json"),
    ]);
    let info: Value = serde_json::from_str(&info.stdout).expect("JSON");
    assert_eq!(info["damage"], json!([]), "{info}");
    assert_eq!(recordings(&inside).len(), 2, "{status}");
    // Another one is refused at once, and made as soon as there is room.
    assert_eq!(daemon.client(&["recordings", "stop"]).code, Some(1));
    let refused = daemon.client(&["recordings", "start"]);
    assert!(refused.code == Some(1) && refused.stderr.contains("record.reserve_mb"), "{refused:?}");
    for name in [&first, &second] {
        assert_eq!(daemon.client(&["recordings", "remove", name]).code, Some(0));
    }
    record_some(&daemon, 20);
}

#[test]
fn of_too_much_the_oldest_goes_and_what_is_pinned_stays() {
    let faulty = Faulty::on("row-3.mcap");
    let daemon = Daemon::start(&with(&faulty, &[("record.max_mb", "0.5")]));
    let pinned = record_some(&daemon, 20);
    assert_eq!(daemon.client(&["recordings", "pin", &pinned]).code, Some(0));
    let _gone = record_some(&daemon, 20);
    let last = record_some(&daemon, 20);
    let kept = || {
        let listed = daemon.client(&["recordings", "list", "--json"]).stdout;
        let listed: Value = serde_json::from_str(&listed).expect("JSON");
        let listed = listed["recordings"].as_array().expect("a list").clone();
        let names =
            listed.iter().map(|it| (it["name"].as_str().expect("a name").to_owned(), it["pinned"] == true));
        names.collect::<Vec<_>>()
    };
    assert_eq!(kept(), [(pinned.clone(), true), (last.clone(), false)]);
    assert_eq!(daemon.client(&["recordings", "unpin", &pinned]).code, Some(0));
    let newest = record_some(&daemon, 20);
    assert_eq!(kept(), [(newest, false)]);
}

#[test]
fn the_last_seconds_are_saved_when_asked_and_when_something_goes_wrong() {
    let faulty = Faulty::on("row-3.mcap");
    let daemon = Daemon::start(&with(&faulty, &[("record.ring_s", "2.0")]));
    let mut station = daemon.connect();
    let folder = daemon.folder().join("state/recordings");
    wait_until(&mut station, "it captures", |status| count(status, "captures") >= 4);
    let saved = daemon.client(&["recordings", "save"]);
    assert_eq!(saved.code, Some(0), "{saved:?}");
    let path = folder.join(format!("{}.mcap", saved.stdout.trim()));
    let seen = times(&path);
    // From the first frame at which nothing was held.
    let seconds = (seen[seen.len() - 1] - seen[0]) as f64 * 1e-9;
    assert!((0.5..4.0).contains(&seconds), "{seconds} s");
    let library: BTreeSet<String> = station.library(0).blades().map(|blade| blade.id().to_string()).collect();
    let replayed = ids(&replay(&path, &[]));
    assert!(!replayed.is_empty() && replayed.is_subset(&library), "the very blades of the station");
    assert_eq!(recordings(&folder).len(), 1, "nothing else is recorded");

    faulty.befalls(&[(0.5, FaultKind::Unplug { for_s: 1000.0 })]);
    let sensor = wait_for(DEADLINE, || {
        recordings(&folder).into_iter().find(|path| path.display().to_string().ends_with("-sensor.mcap"))
    });
    let sensor = sensor.expect("it is saved unasked");
    let is_whole = || {
        let listed = daemon.client(&["recordings", "list"]).stdout;
        (listed.lines().count() == 2 && !listed.contains("being written")).then_some(())
    };
    wait_for(DEADLINE, is_whole).expect("it is written");
    assert!(times(&sensor).len() > 10);
    assert_eq!(count(&station.status(), "saves"), 2);
    drop(daemon);

    // A hand alone is no blade.
    let faulty = Faulty::on("hand-2.mcap");
    let daemon =
        Daemon::start(&with(&faulty, &[("record.ring_s", "3.0"), ("record.save_on", "[\"refused\"]")]));
    let folder = daemon.folder().join("state/recordings");
    let refused = wait_for(DEADLINE, || recordings(&folder).pop()).expect("it is saved unasked");
    assert!(refused.display().to_string().ends_with("-refused.mcap"), "{}", refused.display());
}

#[test]
fn each_refusal_says_why_in_a_sentence() {
    let faulty = Faulty::on("row-3.mcap");
    let daemon = Daemon::start(&with(&faulty, &[]));
    let refused = |finished: &Finished, code: i32, words: &str| {
        assert_eq!(finished.code, Some(code), "{finished:?}");
        assert!(finished.stderr.contains(words) && finished.stderr.lines().count() == 1, "{finished:?}");
    };
    refused(&daemon.client(&["recordings", "stop"]), 1, "nothing is being recorded");
    refused(&daemon.client(&["recordings", "save"]), 1, "record.ring_s");
    refused(&daemon.client(&["recordings", "pin", "no-such"]), 1, "no recording \"no-such\"");
    refused(&daemon.client(&["recordings", "remove", "../station"]), 1, "no recording");
    assert_eq!(daemon.client(&["recordings", "start"]).code, Some(0));
    refused(&daemon.client(&["recordings", "start"]), 1, "is being written");
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("a.mcap");
    let run = |sets: &[&str]| {
        let mut arguments = vec!["record", out.to_str().expect("UTF-8")];
        arguments.extend(sets.iter().flat_map(|set| ["--set", *set]));
        let mut command = Program::Capture.command(arguments);
        command.env("SWARD_LOG", "off");
        Running::start(command).finish(DEADLINE)
    };
    refused(&run(&[]), 2, "sensor.driver");
    refused(&run(&["source.recording=\"/no/such.mcap\""]), 3, "/no/such.mcap");
    refused(&run(&["sensor.driver=\"faulty\"", "sensor.device=\"/no/such.toml\""]), 4, "/no/such.toml");
    let into = folder.path().join("no/such/folder/a.mcap");
    let shipped = format!("source.recording={:?}", tests::shipped_recording());
    let mut command =
        Program::Capture.command([Path::new("record"), &into, Path::new("--set"), Path::new(&shipped)]);
    command.env("SWARD_LOG", "off");
    refused(&Running::start(command).finish(DEADLINE), 1, "cannot be written");
    assert!(!out.exists(), "nothing is left behind");
}

#[test]
fn recordings_have_names_that_say_when() {
    let faulty = Faulty::on("row-3.mcap");
    let daemon = Daemon::start(&with(&faulty, &[]));
    let now = SystemTime::now().duration_since(UNIX_EPOCH).expect("after 1970").as_secs();
    let name = daemon.client(&["recordings", "start"]).stdout;
    assert!(name.trim().ends_with('Z') && name.starts_with("20"), "{name}");
    let status =
        wait_until(&mut daemon.connect(), "it records", |status| count(status, "recorded_frames") > 30);
    assert_eq!(status["recording"].as_str(), Some(name.trim()));
    let shown = daemon.client(&["status"]).stdout;
    assert!(shown.contains(&format!("recording {}", name.trim())), "{shown}");
    let (folder, _) = daemon.end();
    let files = recordings(&folder.path().join("state/recordings"));
    // It ended with the station, whole.
    let info = Program::Capture.run([Path::new("info"), &files[0], Path::new("--json")]);
    let info: Value = serde_json::from_str(&info.stdout).expect("JSON");
    assert_eq!(info["damage"], json!([]), "{info}");
    assert!(info["start_ns"].as_u64() >= Some(now * 1_000_000_000), "{info}");
}
