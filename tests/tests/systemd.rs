//! Does the station live under systemd as its units say: are they what systemd accepts, are they tight, and does the
//! socket that systemd holds outlive the station?
//!
//! systemd's tools say the first two. Where they are not installed, that is skipped and says so;
//! `SWARD_REQUIRE_SYSTEMD=1` makes it a failure.

use std::fs;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::json;
use tempfile::TempDir;
use tests::daemon::Daemon;
use tests::programs::{DEADLINE, Finished, Program, Running};
use tests::root;
use tests::station::Station;

/// The largest exposure that is let pass, of 100 (`systemd-analyze security`).
const EXPOSURE: &str = "15";

/// Runs one of systemd's tools in `folder`; `None` where it is not installed, which is said.
fn tool(folder: &Path, name: &str, arguments: &[&str]) -> Option<Finished> {
    match Command::new(name).arg("--version").output() {
        Ok(_) => {
            let mut command = Command::new(name);
            command.args(arguments).current_dir(folder).env("SYSTEMD_COLORS", "0");
            Some(Running::start(command).finish(DEADLINE))
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let required = std::env::var_os("SWARD_REQUIRE_SYSTEMD").is_some_and(|value| value == "1");
            assert!(!required, "{name} is not installed, and SWARD_REQUIRE_SYSTEMD=1");
            eprintln!("skipped: {name} is not installed");
            None
        }
        Err(error) => panic!("{name}: {error}"),
    }
}

/// A copy of `systemd/` whose units start the programs that were built; the units' names.
fn units() -> (TempDir, Vec<String>) {
    let folder = tempfile::tempdir().expect("a folder");
    let mut names = Vec::new();
    for entry in fs::read_dir(root().join("systemd")).expect("it is there") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            continue;
        }
        let name = path.file_name().and_then(|name| name.to_str()).expect("UTF-8").to_owned();
        let mut text = fs::read_to_string(&path).expect("readable");
        for program in [Program::Capture, Program::Render] {
            let built = program.path();
            let installed = Path::new("/usr/bin").join(built.file_name().expect("a file"));
            text = text.replace(installed.to_str().expect("UTF-8"), built.to_str().expect("UTF-8"));
        }
        fs::write(folder.path().join(&name), text).expect("room");
        names.push(name);
    }
    names.sort();
    (folder, names)
}

#[test]
fn systemd_accepts_the_units() {
    let (folder, names) = units();
    assert_eq!(names, ["sward-capture.service", "sward-capture.socket", "sward-render.service"]);
    let verify = |names: &[&str]| {
        tool(
            folder.path(),
            "systemd-analyze",
            &[&["verify", "--man=no", "--recursive-errors=no"], names].concat(),
        )
    };
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let Some(verified) = verify(&names) else { return };
    assert_eq!(verified.code, Some(0), "{verified:?}");
    // What it does not know it ignores, and says so.
    assert!(!verified.stderr.contains("sward"), "{verified:?}");

    let broken = fs::read_to_string(folder.path().join("sward-capture.service")).expect("it was written");
    let broken = broken.replace("ExecStart=", "ExecStart=/no/such/folder");
    fs::write(folder.path().join("broken.service"), broken).expect("room");
    let verified = verify(&["broken.service"]).expect("it was there");
    assert_ne!(verified.code, Some(0), "what is broken is found: {verified:?}");
}

#[test]
fn the_exposure_of_both_services_is_small() {
    let (folder, _) = units();
    let threshold = format!("--threshold={EXPOSURE}");
    for unit in ["sward-capture.service", "sward-render.service"] {
        let arguments = ["security", "--offline=true", "--no-pager", &threshold, &format!("./{unit}")];
        let Some(exposed) = tool(folder.path(), "systemd-analyze", &arguments) else { return };
        assert_eq!(exposed.code, Some(0), "{}\n{}", exposed.stdout, exposed.stderr);
        assert!(exposed.stdout.contains(&format!("Overall exposure level for {unit}")), "{exposed:?}");
    }
}

#[test]
fn users_and_folders_are_made() {
    let folder = tempfile::tempdir().expect("a folder");
    let there = folder.path().to_str().expect("UTF-8");
    fs::create_dir(folder.path().join("etc")).expect("room");
    let conf = |kind: &str| root().join("systemd").join(kind).join("sward.conf").display().to_string();
    let root_is = format!("--root={there}");
    let Some(made) = tool(folder.path(), "systemd-sysusers", &[&root_is, &conf("sysusers.d")]) else {
        return;
    };
    assert_eq!(made.code, Some(0), "{made:?}");
    let lines = |file: &str| fs::read_to_string(folder.path().join("etc").join(file)).expect("it was made");
    for user in ["sward:", "sward-render:"] {
        assert!(lines("passwd").lines().any(|line| line.starts_with(user)), "{user} {}", lines("passwd"));
    }
    let members = |group: &str| -> Vec<String> {
        let groups = lines("group");
        let line = groups.lines().find(|line| line.starts_with(&format!("{group}:"))).expect("that group");
        line.rsplit(':').next().expect("members").split(',').map(str::to_owned).collect()
    };
    assert_eq!(members("sward"), ["sward-render"], "the renderer's user may connect");
    assert!(members("video").contains(&"sward".to_owned()), "{:?}", members("video"));

    if !rustix::process::getuid().is_root() {
        eprintln!("skipped: only root can give folders to others");
        return;
    }
    let Some(made) = tool(folder.path(), "systemd-tmpfiles", &[&root_is, "--create", &conf("tmpfiles.d")])
    else {
        return;
    };
    assert_eq!(made.code, Some(0), "{made:?}");
    let owner = fs::metadata(folder.path().join("run/sward")).expect("it was made");
    let sward = lines("passwd")
        .lines()
        .find_map(|line| line.strip_prefix("sward:x:")?.split(':').next()?.parse().ok());
    assert_eq!(Some(std::os::unix::fs::MetadataExt::uid(&owner)), sward);
    assert_eq!(owner.permissions().mode() & 0o777, 0o755);
}

#[test]
fn nothing_takes_the_picture_down_with_the_station() {
    let unit = fs::read_to_string(root().join("systemd/sward-render.service")).expect("it is there");
    let mut settings = unit.lines().filter_map(|line| line.split_once('='));
    let binding =
        ["Requires", "Requisite", "BindsTo", "PartOf", "Upholds", "Conflicts", "StopPropagatedFrom"];
    assert_eq!(settings.clone().find(|(key, _)| binding.contains(key)), None);
    assert!(settings.any(|setting| setting == ("Restart", "always")));
}

#[test]
fn the_units_and_the_configuration_name_one_socket() {
    let socket = fs::read_to_string(root().join("systemd/sward-capture.socket")).expect("it is there");
    let listened = socket.lines().find_map(|line| line.strip_prefix("ListenStream="));
    let config = fs::read_to_string(root().join("capture-daemon/capture-daemon.toml")).expect("it is there");
    let config: toml::Table = config.parse().expect("TOML");
    assert_eq!(listened, config["service"]["socket"].as_str());
}

/// What starts a daemon in `folder` with `descriptor` passed as systemd passes a socket.
fn with_passed(folder: &Path, descriptor: OwnedFd) -> Command {
    let daemon = Daemon::command(folder, &[("capture.hold_s", "60.0".to_owned())]);
    let mut command = Command::new("sh");
    // The process stays the same, and so its id.
    command.args(["-c", "exec 3<&0 </dev/null; LISTEN_FDS=1 LISTEN_PID=$$ exec \"$@\"", "sh"]);
    command.arg(daemon.get_program()).args(daemon.get_args()).stdin(descriptor);
    for (name, value) in daemon.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    command.current_dir(daemon.get_current_dir().expect("it has one"));
    command
}

fn passed_socket(folder: &Path) -> (PathBuf, UnixListener) {
    let path = folder.join("station.socket");
    let socket = UnixListener::bind(&path).expect("a free path");
    fs::set_permissions(&path, PermissionsExt::from_mode(0o604)).expect("it is ours");
    (path, socket)
}

#[test]
fn a_socket_that_is_passed_outlives_the_station() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, socket) = passed_socket(folder.path());
    let start = |folder: TempDir| {
        let socket = socket.try_clone().expect("a descriptor");
        let command = with_passed(folder.path(), socket.into());
        Daemon::start_command(folder, command)
    };
    let asks = || {
        let mut station = Station::connect(&path);
        station.send(br#"{"method":"io.sward.Station.GetStatus"}"#).expect("there is room");
        station
    };
    let is_answered = |mut station: Station| {
        let (reply, _) = station.reply().expect("it is served");
        assert_eq!(reply["parameters"]["status"]["store"], json!("ok"), "{reply}");
    };

    // Who came before the station is served.
    let early = asks();
    let daemon = start(folder);
    is_answered(early);
    assert_eq!(daemon.connect().status()["store"], json!("ok"));
    let mode = || fs::metadata(&path).expect("it is there").permissions().mode() & 0o777;
    assert_eq!(mode(), 0o604, "its mode is not the station's to say");

    let (folder, finished) = daemon.end();
    assert_eq!(finished.code, Some(0), "{finished:?}");
    assert!(finished.stderr.contains(path.to_str().expect("UTF-8")), "{finished:?}");
    let meanwhile = asks();
    let daemon = start(folder);
    is_answered(meanwhile);

    let folder = daemon.kill();
    let meanwhile = [asks(), asks()];
    let daemon = start(folder);
    meanwhile.into_iter().for_each(is_answered);
    assert_eq!(mode(), 0o604);
    let (_folder, finished) = daemon.end();
    assert_eq!(finished.code, Some(0), "{finished:?}");
    assert!(path.exists(), "systemd's file is left alone");
}

#[test]
fn what_is_passed_and_cannot_be_listened_on_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let (connected, _other) = UnixStream::pair().expect("a pair");
    let file = fs::File::open("/dev/null").expect("it is there");
    for (descriptor, reason) in [(OwnedFd::from(connected), "does not listen"), (file.into(), "not a socket")]
    {
        let finished = Running::start(with_passed(folder.path(), descriptor)).finish(DEADLINE);
        assert_eq!((finished.code, &*finished.stdout), (Some(1), ""), "{finished:?}");
        for words in [reason, "LISTEN_FDS", "sward-capture.socket"] {
            assert!(finished.stderr.contains(words), "does not say {words:?}: {finished:?}");
        }
    }
}

#[test]
fn systemds_own_tool_passes_a_socket() {
    let folder = tempfile::tempdir().expect("a folder");
    if tool(folder.path(), "systemd-socket-activate", &["--version"]).is_none() {
        return;
    }
    let path = folder.path().join("station.socket");
    let daemon = Daemon::command(folder.path(), &[("service.socket_mode", "0o600".to_owned())]);
    let mut command = Command::new("systemd-socket-activate");
    command.arg("--listen").arg(&path).arg(daemon.get_program()).args(daemon.get_args());
    command.current_dir(root()).env_remove("NOTIFY_SOCKET");
    let mut daemon = Daemon::start_command(folder, command);
    assert_eq!(daemon.connect().status()["store"], json!("ok"));
    let program = fs::read_link(format!("/proc/{}/exe", daemon.running().id())).expect("it runs");
    assert_eq!(program.file_name(), Program::Capture.path().file_name(), "it became the station");
}
