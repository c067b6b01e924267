//! Does the command line say what it did to a station, and refuse what it cannot do?

use std::fs;

use serde_json::json;
use tests::daemon::Daemon;
use tests::programs::{DEADLINE, Program, wait_for};
use tests::shipped_recording;

/// A blade of so many decimetres.
fn blade(height_dm: usize) -> String {
    format!(
        "format = 1\nknots = [\n  {{ position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004] }},\n  {{ position_m = [0.0, 0.{height_dm}, 0.0], half_width_m = [0.0, 0.0] }},\n]\n"
    )
}

/// Nothing but what is put there: the recording shows nothing within its window.
fn seeing_nothing() -> Vec<(&'static str, String)> {
    let looped = ("source.loop", "true".to_owned());
    vec![("mask.near_m", "0.1".to_owned()), ("mask.far_m", "0.11".to_owned()), looped]
}

#[test]
fn a_reload_takes_no_keys_and_no_other_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let own = folder.path().join("station.toml");
    fs::write(&own, "[refine]\nknots = 12\n").expect("room");
    let daemon = Daemon::start_in(folder, &seeing_nothing());
    let hash = |daemon: &Daemon| daemon.connect().status()["config"].clone();
    let before = hash(&daemon);
    let shown = daemon.client(&["status"]).stdout;
    assert!(shown.contains(&format!(", with {}\n", own.display())), "{shown}");
    let other = daemon.folder().join("other.toml");
    fs::write(&other, "[refine]\nknots = 9\n").expect("room");
    let other = other.display().to_string();
    for (arguments, words) in [
        (&["reload", "--set", "refine.knots=9"][..], ["--set refine.knots=9: ", "takes no key"]),
        (&["reload", "--config", &other], ["other.toml: the station goes by", "station.toml"]),
    ] {
        let refused = daemon.client(arguments);
        assert_eq!((refused.code, &*refused.stdout), (Some(2), ""), "{refused:?}");
        assert!(words.iter().all(|word| refused.stderr.contains(word)), "{refused:?}");
        assert_eq!(refused.stderr.lines().count(), 1, "{refused:?}");
    }
    assert_eq!(hash(&daemon), before);
    let own = own.display().to_string();
    assert_eq!(daemon.client(&["reload", "--config", &own]).stdout, "nothing is changed\n");
    fs::write(&own, "[refine]\nknots = 9\n").expect("room");
    assert_eq!(daemon.client(&["reload", "--config", &own]).stdout, "refine.knots is changed\n");
    // The frames go by it from the next one on.
    wait_for(DEADLINE, || (hash(&daemon) != before).then_some(())).expect("it is taken");
}

#[test]
fn a_socket_that_is_to_move_is_said_to_be_where_it_was() {
    let folder = tempfile::tempdir().expect("a folder");
    let [own, old, new] = ["own.toml", "station.socket", "new.socket"].map(|name| folder.path().join(name));
    let config = |socket: &std::path::Path| {
        let (recording, state) = (shipped_recording(), folder.path().join("state"));
        format!(
            "[source]\nrecording = {recording:?}\n[service]\nsocket = {socket:?}\n[store]\ndirectory = {state:?}\n"
        )
    };
    fs::write(&own, config(&old)).expect("room");
    let moved = config(&new);
    let command = Program::Capture.command(["run".as_ref(), "--config".as_ref(), own.as_os_str()]);
    let daemon = Daemon::start_command(folder, command);
    fs::write(&own, moved).expect("room");
    let reload = |more: &[&str]| {
        let config = own.display().to_string();
        Program::Capture.run([&["reload", "--config", &config][..], more].concat())
    };
    let lost = reload(&[]);
    assert_eq!(lost.code, Some(1), "{lost:?}");
    assert!(
        lost.stderr.contains("new.socket: no station") && lost.stderr.contains("that it was started with"),
        "{lost:?}"
    );
    let old = old.display().to_string();
    let found = reload(&["--socket", &old]);
    assert_eq!(found.code, Some(0), "{found:?}");
    let expected = format!(
        "service.socket changes with the next start; until then the station listens on {old}, for --socket\n"
    );
    assert_eq!(found.stdout, expected);
    drop(daemon);
}

#[test]
fn all_that_was_removed_comes_back_at_once() {
    let daemon = Daemon::start(&seeing_nothing());
    let names = ["fern", "moss", "reed"];
    for (height, name) in (1..).zip(names) {
        fs::write(daemon.blades().join(format!("{name}.toml")), blade(height)).expect("room");
    }
    let mut station = daemon.connect();
    station.library_of_at_least(names.len());
    let restore = |arguments: &[&str]| daemon.client(&[&["blades", "restore"], arguments].concat());
    assert_eq!(restore(&["--all"]).stdout, "nothing was removed that is not there again\n");

    // As rm -r does, which takes the folder last.
    for name in names {
        fs::remove_file(daemon.blades().join(format!("{name}.toml"))).expect("it is there");
    }
    let is_empty = || (station.status()["blades"] == json!(0)).then_some(());
    wait_for(DEADLINE, is_empty).expect("the library follows");
    assert_eq!(restore(&["--all", "--since", "0"]).stdout, "nothing was removed that is not there again\n");
    let back = restore(&["--all", "--since", "3600"]);
    assert_eq!((back.code, back.stdout.lines().count()), (Some(0), names.len()), "{back:?}");
    let listed = daemon.client(&["blades", "list"]).stdout;
    assert!(names.iter().all(|name| listed.contains(name)), "{listed}");

    // The folder itself, at once: the station says so, and takes a new one up with its next start.
    fs::remove_dir_all(daemon.blades()).expect("it is there");
    let gone = wait_for(DEADLINE, || {
        let store = daemon.connect().status()["store"].as_str().unwrap_or_default().to_owned();
        (store != "ok").then_some(store)
    });
    gone.expect("it is said");
    fs::create_dir(daemon.blades()).expect("room");
    let (folder, _) = daemon.end();
    let daemon = Daemon::start_in(folder, &seeing_nothing());
    let back = daemon.client(&["blades", "restore", "--all"]);
    assert_eq!((back.code, back.stdout.lines().count()), (Some(0), names.len()), "{back:?}");
    assert_eq!(daemon.connect().status()["blades"], json!(3));

    for (arguments, words) in [
        (&["--all", "fern"][..], "cannot be used with"),
        (&["--all", "--back", "2"], "cannot be used with"),
        (&["fern", "--since", "3600"], "cannot be used with"),
        (&["--all", "--since", "soon"], "--since"),
        (&[], "NAME"),
    ] {
        let refused = daemon.client(&[&["blades", "restore"], arguments].concat());
        assert_eq!(refused.code, Some(2), "{arguments:?}: {refused:?}");
        assert!(refused.stderr.contains(words), "{arguments:?}: {refused:?}");
    }
}

#[test]
fn a_weight_too_small_is_refused_and_the_doctor_looks_at_the_socket_it_is_told() {
    let daemon = Daemon::start(&seeing_nothing());
    fs::write(daemon.blades().join("fern.toml"), blade(2)).expect("room");
    let mut station = daemon.connect();
    station.library_of_at_least(1);
    let tiny = daemon.client(&["blades", "mix", "fern", "1e-50"]);
    assert_eq!(tiny.code, Some(2), "{tiny:?}");
    assert!(tiny.stderr.contains("1e-50, expected 0, or a number of 1e-30 to 1000000"), "{tiny:?}");
    let (reply, _) = station.call("SetMix", &json!({"name": "fern", "mix": 1e-50}));
    assert_eq!(reply["error"], "io.sward.Station.InvalidMix", "{reply}");
    assert_eq!(station.library(0).blades().next().expect("it is there").mix(), 1.0);

    let seen = daemon.client(&["doctor"]).stdout;
    let socket = daemon.socket().display().to_string();
    assert!(seen.contains(&format!("{socket}: a station answers")), "{seen}");
}
