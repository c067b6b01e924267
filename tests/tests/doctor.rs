//! Does the doctor find what is wrong with a station and its machine, and nothing where all is well?

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

use rustix::process::Signal;
use serde_json::Value;
use tests::daemon::Daemon;
use tests::programs::{DEADLINE, Finished, Program, Running, wait_for};
use tests::shipped_recording;

/// What the doctor is told of the station in `folder`.
fn arguments(folder: &Path) -> Vec<String> {
    let settings = [
        ("source.recording", shipped_recording()),
        ("service.socket", folder.join("station.socket")),
        ("store.directory", folder.join("state")),
    ];
    let sets = settings.map(|(key, path)| ["--set".to_owned(), format!("{key}={path:?}")]);
    let verb = ["doctor".to_owned(), "--json".to_owned()];
    verb.into_iter().chain(sets.into_iter().flatten()).collect()
}

fn doctor(folder: &Path) -> Finished {
    let mut command = Program::Capture.command(arguments(folder));
    command.env("SWARD_LOG", "off");
    Running::start(command).finish(DEADLINE)
}

/// The findings of a check; stdout is JSON and nothing else, and the exit code says whether there is trouble.
#[track_caller]
fn findings(finished: &Finished, check: &str) -> Vec<Value> {
    let report: Value = serde_json::from_str(&finished.stdout).unwrap_or_else(|_| panic!("{finished:?}"));
    let trouble = report["trouble"].as_u64().expect("a number");
    assert_eq!(finished.code, Some(i32::from(trouble > 0)), "{finished:?}");
    assert_eq!(finished.stderr.lines().count(), usize::from(trouble > 0), "{finished:?}");
    let all = report["checks"].as_array().expect("a list").iter();
    let found: Vec<Value> = all.filter(|finding| finding["check"] == check).cloned().collect();
    assert!(!found.is_empty(), "{check} is not checked: {report}");
    found
}

#[track_caller]
fn is_well(finished: &Finished, checks: &[&str]) {
    for check in checks {
        for finding in findings(finished, check) {
            assert_eq!(finding["verdict"], "ok", "{finding}");
        }
    }
}

#[track_caller]
fn is_trouble(finished: &Finished, check: &str, words: &[&str]) {
    let all = findings(finished, check);
    let finding = all.iter().find(|finding| finding["verdict"] == "trouble");
    let finding = finding.unwrap_or_else(|| panic!("no trouble: {all:?}"));
    for key in ["where", "found", "expected", "remedy"] {
        assert!(finding[key].is_string(), "{finding}");
    }
    for word in words {
        assert!(finding.to_string().contains(word), "does not say {word:?}: {finding}");
    }
}

#[test]
fn a_station_that_is_well_is_found_well_and_what_becomes_of_it_is_seen() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut daemon = Daemon::start_in(folder, &[("source.loop", "true".to_owned())]);
    let mut station = daemon.connect();
    station.library_of_at_least(1);
    let has_rate = || (station.status()["frames_per_second"].as_f64() > Some(0.0)).then_some(());
    wait_for(DEADLINE, has_rate).expect("frames come");
    let place = daemon.folder().to_path_buf();
    let seen = doctor(&place);
    let of_store = ["store", "store.writable", "store.blades", "store.archive"];
    is_well(
        &seen,
        &["configuration", "source", "socket", "station.version", "station.frames", "station.store"],
    );
    is_well(&seen, &of_store);
    is_well(&seen, &["limits.memfd", "limits.files", "clock", "service.watch"]);
    // The station's limit counts, not that of whoever asks.
    let station = format!("process {}", daemon.running().id());
    assert!(findings(&seen, "limits.files")[0]["where"].as_str().is_some_and(|it| it.contains(&station)));
    let limit = rustix::process::Rlimit { current: Some(100), maximum: Some(4096) };
    let pid = rustix::process::Pid::from_raw(daemon.running().id() as i32);
    rustix::process::prlimit(pid, rustix::process::Resource::Nofile, limit).expect("it is ours");
    is_trouble(
        &doctor(&place),
        "limits.files",
        &[&station, "it may have 100 open files", "start the station anew"],
    );
    assert!(!place.join("state/.doctor").exists(), "the probe is removed");

    fs::write(daemon.blades().join("torn.toml"), "format = 1\nknots = [\n").expect("room");
    is_trouble(&doctor(&place), "store.refused", &["torn.toml", "mend"]);
    fs::remove_file(daemon.blades().join("torn.toml")).expect("it is there");

    // A station that hangs accepts nobody.
    daemon.running().signal(Signal::STOP);
    is_trouble(&doctor(&place), "socket", &["station.socket", "does not answer within 5 s"]);
    daemon.running().signal(Signal::CONT);
    let folder = daemon.kill();
    is_trouble(&doctor(&place), "socket", &["left over", "start a station"]);
    drop(folder);
    is_trouble(&doctor(&place), "store", &["not there"]);
}

#[test]
fn people_read_a_line_for_each_check() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut arguments = arguments(folder.path());
    arguments.retain(|argument| argument != "--json");
    let finished = Program::Capture.run(&arguments);
    assert_eq!(finished.code, Some(1), "{finished:?}");
    assert!(finished.stderr.contains("checks found trouble; stdout says"), "{finished:?}");
    let line = finished.stdout.lines().find(|line| line.starts_with("TROUBLE  store ")).expect("no store");
    assert!(line.contains("it is not there yet; expected a folder") && line.contains("; make it"), "{line}");
    assert!(finished.stdout.lines().any(|line| line.starts_with("ok       source ")), "{finished:?}");
}

#[test]
fn what_another_user_may_not_do_is_said() {
    if !rustix::process::getuid().is_root() {
        eprintln!("skipped: only root can be somebody else");
        return;
    }
    let daemon = Daemon::start(&[]);
    // Where the build and the recordings are, strangers may not go; so they get a copy.
    let program = daemon.folder().join("sward-capture");
    fs::copy(Program::Capture.path(), &program).expect("room");
    let state = daemon.folder().join("state");
    fs::set_permissions(&state, PermissionsExt::from_mode(0o555)).expect("it is ours");
    let mut command = Command::new(&program);
    command.args(arguments(daemon.folder())).env("SWARD_LOG", "off").current_dir("/").uid(4242).gid(4243);
    let seen = Running::start(command).finish(DEADLINE);
    is_trouble(&seen, "store.writable", &["state", "Permission denied", "as the station's user"]);
    is_trouble(&seen, "socket", &["may not connect", "mode 0660", "join the group"]);
}
