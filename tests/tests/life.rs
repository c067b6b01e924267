//! Does the station live as it should: what systemd hears, reloads, its end?

use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use rustix::fs::OFlags;
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
    assert!(refused.stderr.contains("station.toml:3:9: `refine.knots`"), "{refused:?}");
    fs::write(&config, "knots\n").expect("room");
    daemon.running().signal(Signal::HUP);
    manager.hears("RELOADING=1");
    manager.hears("READY=1");
    assert_eq!(station.status()["config"], changed["config"], "the old one stays");
    let library = station.library_of_at_least(1);
    assert!(library.blades().any(|blade| blade.knots().len() == 9 || blade.knots().len() == 12));

    // However many signals come, what stands there then is taken.
    fs::write(&config, "refine.knots = 7\n").expect("room");
    (0..500).for_each(|_| daemon.running().signal(Signal::HUP));
    let taken = wait_for(DEADLINE, || (station.status()["config"] != changed["config"]).then_some(()));
    taken.expect("it is taken");

    let (_, finished) = daemon.end();
    assert_eq!(finished.code, Some(0), "{finished:?}");
    assert!(finished.stderr.matches("reloaded").count() < 50, "many signals are one: {finished:?}");
    manager.hears("STOPPING=1");
}

#[test]
fn reloads_in_the_middle_of_a_hold_lose_no_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("station.toml");
    fs::write(&config, "refine.knots = 16\n").expect("room");
    // Half as fast as it was taken, so that a capture on a busy machine does not outlast the queue.
    let daemon = Daemon::start_in(folder, &[("source.rate", "0.5".to_owned())]);
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
    assert_eq!(status["frames"], end["frames"], "{status}");
    assert_eq!(station.library_of_at_least(1).len() as u64, end["blades"].as_u64().expect("a number"));
    let reply = wait_for(DEADLINE, || {
        let reply = station.call("Capture", &json!({})).0;
        (reply["error"] != "io.sward.Station.NothingHeld").then_some(reply)
    });
    assert_eq!(reply.expect("an answer")["error"], "io.sward.Station.NoFrames");
    assert_eq!(station.status()["captures"], json!(1));
}

#[test]
fn a_recording_that_is_faster_than_the_stages_waits_for_them() {
    let settings = [("source.rate", "1000.0".to_owned()), ("capture.hold_s", "0.0".to_owned())];
    let daemon = Daemon::start(&settings);
    let whole = Program::Capture.run(["replay", "recordings/row-3.mcap", "--json"]).stdout;
    let end: Value = serde_json::from_str(whole.lines().last().expect("it ends")).expect("JSON");
    let mut station = daemon.connect();
    // While the first is captured, a thousand times as many are due as in real time.
    let over = wait_for(DEADLINE, || {
        let status = station.status();
        (status["frames"] == end["frames"]).then_some(status)
    });
    let over = over.expect("each frame is seen");
    let none = json!(0);
    assert_eq!((&over["dropped_frames"], &over["skipped_frames"], &over["lost"]), (&none, &none, &none));
}

/// A log that nobody reads any more: who writes to it waits. As a pipe with a name.
struct StuckLog {
    pipe: File,
}

impl StuckLog {
    /// Makes it, and has `daemon` log to it.
    fn of(folder: &Path, daemon: &Command) -> (Self, Command) {
        let path = folder.join("log");
        let made = Command::new("mkfifo").arg(&path).status().expect("mkfifo runs");
        assert!(made.success(), "{made:?}");
        let nonblocking = OFlags::NONBLOCK.bits().cast_signed();
        let pipe = OpenOptions::new().read(true).write(true).custom_flags(nonblocking).open(&path);
        let mut command = Command::new("sh");
        // The process stays the same, and so its id.
        command.args(["-c", "log=$1; shift; exec \"$@\" 2>\"$log\"", "sh"]).arg(&path);
        command.arg(daemon.get_program()).args(daemon.get_args());
        command.current_dir(daemon.get_current_dir().expect("it has one"));
        for (name, _) in daemon.get_envs().filter(|(_, value)| value.is_none()) {
            command.env_remove(name);
        }
        (Self { pipe: pipe.expect("a pipe opens") }, command)
    }

    /// Leaves no room in it.
    fn fill(&mut self) {
        for size in [4096, 1] {
            let full = loop {
                if let Err(error) = self.pipe.write(&vec![b'.'; size]) {
                    break error;
                }
            };
            assert_eq!(full.kind(), ErrorKind::WouldBlock, "{full}");
        }
    }

    /// Makes room again.
    fn drain(&mut self) {
        let mut bytes = [0; 4096];
        while self.pipe.read(&mut bytes).is_ok_and(|read| read > 0) {}
    }
}

/// A daemon whose frame thread waits for a log that is stuck; its recording is captured again and again.
fn with_a_stuck_frame_thread(manager: Option<&Path>) -> (Daemon, StuckLog) {
    let folder = tempfile::tempdir().expect("a folder");
    let settings = [("source.loop", "true".to_owned()), ("source.rate", "0.0".to_owned())];
    let command = Daemon::command(folder.path(), &settings);
    let (mut log, mut command) = StuckLog::of(folder.path(), &command);
    // That thread alone says something of each capture, also of one that was seen before.
    command.env("SWARD_LOG", "info,capture_daemon::frames=debug");
    if let Some(manager) = manager {
        command.env("NOTIFY_SOCKET", manager).env("WATCHDOG_USEC", "400000");
    }
    let daemon = Daemon::start_command(folder, command);
    let mut station = daemon.connect();
    station.library_of_at_least(1);
    log.fill();
    let mut before = (Value::Null, Instant::now());
    let stuck = wait_for(DEADLINE, || {
        let frames = station.status()["frames"].take();
        if frames != before.0 {
            before = (frames, Instant::now());
        }
        (before.1.elapsed() > Duration::from_secs(1)).then_some(())
    });
    stuck.expect("the frame thread waits for the log, and the service does not");
    (daemon, log)
}

#[test]
fn a_stuck_frame_thread_starves_the_watchdog_though_the_service_answers() {
    let folder = tempfile::tempdir().expect("a folder");
    let manager = Manager::listen(folder.path());
    let (daemon, mut log) = with_a_stuck_frame_thread(Some(&folder.path().join("notify")));
    // What was said before it stuck.
    manager.0.set_nonblocking(true).expect("it is a socket");
    while manager.0.recv(&mut [0; 4096]).is_ok() {}
    // Systemd would wait for 0.4 s.
    std::thread::sleep(Duration::from_secs(1));
    let mut message = [0; 4096];
    while let Ok(read) = manager.0.recv(&mut message) {
        let text = String::from_utf8_lossy(&message[..read]).into_owned();
        assert!(!text.contains("WATCHDOG=1"), "{text}");
    }
    assert_eq!(daemon.connect().status()["store"], json!("ok"));
    manager.0.set_nonblocking(false).expect("it is a socket");
    let reader = std::thread::spawn(move || {
        // As long as the test needs to hear of it.
        for _ in 0..100 {
            log.drain();
            std::thread::sleep(Duration::from_millis(20));
        }
    });
    manager.hears("WATCHDOG=1");
    drop(daemon);
    reader.join().expect("it reads");
}

#[test]
fn a_second_signal_ends_at_once_what_the_first_cannot() {
    for second in [Signal::TERM, Signal::INT] {
        let (mut daemon, _log) = with_a_stuck_frame_thread(None);
        daemon.running().terminate();
        std::thread::sleep(Duration::from_millis(500));
        assert_eq!(daemon.running().ended(), None, "it waits for its threads");
        daemon.running().signal(second);
        let status = wait_for(DEADLINE, || daemon.running().ended()).expect("it ends at once");
        assert_eq!(status.code(), Some(1));
    }
}
