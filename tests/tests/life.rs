//! Does the station live as it should: what systemd hears, reloads, its end?

use std::fs;
use std::os::unix::net::UnixDatagram;
use std::path::Path;

use rustix::process::Signal;
use serde_json::{Value, json};
use tests::daemon::Daemon;
use tests::programs::{DEADLINE, Program, wait_for};

/// What systemd would be told.
struct Manager(UnixDatagram);

impl Manager {
    fn listen(folder: &Path) -> Self {
        let socket = UnixDatagram::bind(folder.join("notify")).expect("a free path");
        socket.set_read_timeout(Some(DEADLINE)).expect("a socket has a timeout");
        Self(socket)
    }

    /// The next message that holds `what`.
    fn hears(&self, what: &str) -> String {
        let mut message = [0; 4096];
        loop {
            let read =
                self.0.recv(&mut message).unwrap_or_else(|error| panic!("{what} is not said: {error}"));
            let text = String::from_utf8_lossy(&message[..read]).into_owned();
            if text.lines().any(|line| line.starts_with(what)) {
                return text;
            }
        }
    }
}

#[test]
fn systemd_hears_of_its_life_and_a_reload_takes_only_what_is_valid() {
    let folder = tempfile::tempdir().expect("a folder");
    let manager = Manager::listen(folder.path());
    let config = folder.path().join("station.toml");
    fs::write(&config, "[refine]\nknots = 12\n").expect("room");
    let mut command = Daemon::command(folder.path(), &[("source.loop", "true".to_owned())]);
    command.env("NOTIFY_SOCKET", folder.path().join("notify")).env("WATCHDOG_USEC", "400000");
    let mut daemon = Daemon::start_command(folder, command);
    assert!(manager.hears("READY=1").contains("STATUS="));
    manager.hears("WATCHDOG=1");
    manager.hears("WATCHDOG=1");

    let mut station = daemon.connect();
    let before = station.status();
    fs::write(&config, "[refine]\nknots = 9\n[service]\nmax_connections = 99\n").expect("room");
    let reloaded = daemon.client(&["reload"]);
    assert_eq!(reloaded.code, Some(0), "{reloaded:?}");
    assert_eq!(
        reloaded.stdout,
        "refine.knots is changed\nservice.max_connections changes with the next start\n"
    );
    assert!(manager.hears("RELOADING=1").contains("MONOTONIC_USEC="));
    manager.hears("READY=1");
    let changed = wait_for(DEADLINE, || {
        let status = station.status();
        (status["config"] != before["config"]).then_some(status)
    });
    let changed = changed.expect("the frame thread takes it");

    fs::write(&config, "[refine]\n\nknots = 65\n").expect("room");
    let refused = daemon.client(&["reload"]);
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.stderr.contains("station.toml:3:1: `refine.knots`"), "{refused:?}");
    fs::write(&config, "knots\n").expect("room");
    daemon.running().signal(Signal::HUP);
    manager.hears("RELOADING=1");
    manager.hears("READY=1");
    assert_eq!(station.status()["config"], changed["config"], "the old one stays");
    let library = station.library_of_at_least(1);
    assert!(library.blades().any(|blade| blade.knots().len() == 9 || blade.knots().len() == 12));

    let (_, finished) = daemon.end();
    assert_eq!(finished.code, Some(0), "{finished:?}");
    manager.hears("STOPPING=1");
}

#[test]
fn reloads_in_the_middle_of_a_hold_lose_no_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("station.toml");
    fs::write(&config, "refine.knots = 16\n").expect("room");
    let daemon = Daemon::start_in(folder, &[]);
    let mut station = daemon.connect();
    let whole = Program::Capture.run(["replay", "recordings/row-3.mcap", "--json"]).stdout;
    let end: Value = serde_json::from_str(whole.lines().last().expect("it ends")).expect("JSON");
    let mut reloads = 0;
    let status = wait_for(DEADLINE, || {
        fs::write(&config, format!("refine.knots = {}\n", 10 + reloads % 5)).expect("room");
        let reply = station.call("Reload", &json!({})).0;
        assert_eq!(reply["error"], Value::Null, "{reply}");
        reloads += 1;
        let status = station.status();
        (status["frames"] == end["frames"]).then_some(status)
    });
    let status = status.expect("the recording is played to its end");
    assert!(reloads > 5, "{reloads} reloads");
    assert_eq!(status["captures"], json!(1), "{status}");
    assert_eq!(station.library_of_at_least(1).len() as u64, end["blades"].as_u64().expect("a number"));
    let reply = wait_for(DEADLINE, || {
        let reply = station.call("Capture", &json!({})).0;
        (reply["error"] != "io.sward.Station.NothingHeld").then_some(reply)
    });
    assert_eq!(reply.expect("an answer")["error"], "io.sward.Station.NoFrames");
}
