//! Does the station live under a real systemd, process 1 of namespaces of its own, with its very units: socket,
//! readiness, hardening, restarts, watchdog, reload?
//!
//! Skipped, and said so, where that may not be started: it needs root, `unshare`, systemd and cgroup2.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use rustix::process::{Pid, Signal, kill_process};
use serde_json::json;
use tempfile::TempDir;
use tests::programs::{DEADLINE, Finished, Program, Running, wait_for};
use tests::station::Station;
use tests::{root, shipped_recording};

const STATION: &str = "sward-capture.service";
const MEADOW: &str = "sward-render.service";
/// Where the programs and their configuration are in there.
const INSIDE: &str = "/run/sward-test";
/// Small pictures of the meadow, where its unit lets it write.
const HEADLESS: &str = "--headless --frames 100000000 --size 64x36 --socket /run/sward/station.sock --out /var/cache/sward-render/out";
/// What the units want of a machine to be there, and nothing in it.
const STUBS: [&str; 6] = ["sysinit", "basic", "sockets", "shutdown", "umount", "final"];

/// A systemd at work; ended when dropped.
struct Machine {
    boot: Running,
    /// Its process id outside.
    systemd: u32,
    _folder: TempDir,
}

/// Whether such a thing may be started here.
fn is_possible() -> bool {
    let mut command = Command::new("unshare");
    command.args(["--mount", "--pid", "--fork", "--uts", "--ipc", "--net", "--cgroup", "--mount-proc"]);
    command.args([
        "sh",
        "-c",
        "mount --make-rprivate / && mount -t cgroup2 cgroup2 /mnt && test -x /lib/systemd/systemd",
    ]);
    command.output().is_ok_and(|output| output.status.success())
}

/// The child, its child, and so on, that is called that.
fn descendant(of: u32, name: &str) -> Option<u32> {
    let children = fs::read_to_string(format!("/proc/{of}/task/{of}/children")).ok()?;
    children.split_ascii_whitespace().filter_map(|id| id.parse().ok()).find_map(|child: u32| {
        let called = fs::read_to_string(format!("/proc/{child}/comm")).ok()?;
        if called.trim() == name { Some(child) } else { descendant(child, name) }
    })
}

impl Machine {
    /// One with the station's units, whose watchdog has less patience.
    fn boot() -> Option<Self> {
        if !is_possible() {
            eprintln!("skipped: no systemd can be started as process 1 of its own namespaces here");
            return None;
        }
        let folder = tempfile::tempdir().expect("a folder");
        fs::set_permissions(folder.path(), PermissionsExt::from_mode(0o755)).expect("it is ours");
        let [units, programs, config] = ["units", "bin", "etc"].map(|name| folder.path().join(name));
        for made in [&units, &programs, &config] {
            fs::create_dir(made).expect("room");
        }
        fs::copy(Program::Capture.path(), programs.join("sward-capture")).expect("room");
        fs::copy(Program::Render.path(), programs.join("sward-render")).expect("room");
        fs::copy(shipped_recording(), config.join("row-3.mcap")).expect("room");
        let text = format!("[source]\nrecording = \"{INSIDE}/etc/row-3.mcap\"\nloop = true\n");
        fs::write(config.join("capture-daemon.toml"), text).expect("room");
        for unit in [STATION, "sward-capture.socket", MEADOW] {
            let text = fs::read_to_string(root().join("systemd").join(unit)).expect("readable");
            let text = text.replace("/usr/bin/", &format!("{INSIDE}/bin/"));
            let text = text.replace("/etc/sward/", &format!("{INSIDE}/etc/"));
            let text = text.replace("WatchdogSec=30", "WatchdogSec=8");
            // There is no display in there.
            let text = text.replace("sward-render --kiosk", &format!("sward-render {HEADLESS}"));
            fs::write(units.join(unit), text).expect("room");
        }
        for stub in STUBS {
            fs::write(units.join(format!("{stub}.target")), "[Unit]\nDefaultDependencies=no\n")
                .expect("room");
        }
        let target = format!("[Unit]\nDefaultDependencies=no\nWants=sward-capture.socket {STATION}\n");
        fs::write(units.join("sward-test.target"), target).expect("room");

        let mut command = Command::new(root().join("tests/pid1/boot.sh"));
        command.arg(folder.path());
        let mut boot = Running::start(command);
        let systemd = wait_for(DEADLINE, || {
            assert_eq!(boot.ended(), None, "it boots");
            descendant(boot.id(), "systemd")
        });
        Some(Self { systemd: systemd.expect("it boots"), boot, _folder: folder })
    }

    /// A path in there as it is seen from here.
    fn path(&self, inside: &str) -> PathBuf {
        Path::new(&format!("/proc/{}/root", self.systemd)).join(inside.trim_start_matches('/'))
    }

    fn systemctl(&self, arguments: &[&str]) -> Finished {
        let mut command = Command::new("nsenter");
        command.args(["--target", &self.systemd.to_string(), "--mount", "--pid", "systemctl"]);
        command.args(arguments).env("SYSTEMD_COLORS", "0");
        Running::start(command).finish(DEADLINE)
    }

    /// What systemd knows of the station.
    fn property(&self, name: &str) -> String {
        let shown = self.systemctl(&["show", "--value", "--property", name, STATION]);
        shown.stdout.trim().to_owned()
    }

    fn waits_for(&self, name: &str, value: &str) {
        let reached = wait_for(DEADLINE, || (self.property(name) == value).then_some(()));
        assert!(reached.is_some(), "{name} is not {value}: {:?}", self.systemctl(&["status", STATION]));
    }

    fn connect(&self) -> Station {
        Station::connect(&self.path("/run/sward/station.sock"))
    }
}

impl Drop for Machine {
    /// All in there ends with process 1; then its control group is taken away.
    fn drop(&mut self) {
        let id = i32::try_from(self.systemd).ok().and_then(Pid::from_raw);
        let _ = id.map(|id| kill_process(id, Signal::KILL));
        wait_for(DEADLINE, || self.boot.ended());
    }
}

fn ids(station: &mut Station) -> BTreeSet<String> {
    station.library_of_at_least(1).blades().map(|blade| blade.id().to_string()).collect()
}

#[test]
fn the_station_lives_under_systemd_as_its_units_say() {
    let Some(machine) = Machine::boot() else { return };
    machine.waits_for("ActiveState", "active");
    assert_eq!((machine.property("Type"), machine.property("User")), ("notify".into(), "sward".into()));
    let mut station = machine.connect();
    let before = ids(&mut station);
    assert!(machine.property("StatusText").contains(" blades, "), "{}", machine.property("StatusText"));
    let mode =
        |path: &str| fs::metadata(machine.path(path)).expect("it is there").permissions().mode() & 0o777;
    assert_eq!((mode("/run/sward/station.sock"), mode("/var/lib/sward")), (0o660, 0o750));

    // Killed, it is there again, with every blade; who connects meanwhile is served then.
    let killed = machine.property("MainPID");
    assert_eq!(machine.systemctl(&["kill", "--signal=KILL", STATION]).code, Some(0));
    wait_for(DEADLINE, || (machine.property("MainPID") != killed).then_some(())).expect("it is gone");
    let mut station = machine.connect();
    let after = ids(&mut station);
    assert!(after.is_superset(&before), "{before:?}, and then {after:?}");
    machine.waits_for("NRestarts", "1");

    // The meadow draws its blades with all that its unit takes from it, shaders compiled to machine code and the
    // station's socket among what is left.
    assert_eq!(machine.systemctl(&["start", MEADOW]).code, Some(0));
    let drawn = wait_for(DEADLINE, || {
        let pictures = fs::read_dir(machine.path("/var/cache/sward-render/out")).ok()?;
        (pictures.count() >= 3).then_some(())
    });
    let told = || machine.systemctl(&["status", "--no-pager", MEADOW]);
    assert!(drawn.is_some(), "no picture comes: {:?}", told());
    let serves = || (station.status()["clients"].as_i64() > Some(1)).then_some(());
    wait_for(DEADLINE, serves).unwrap_or_else(|| panic!("it is no client: {:?}", told()));
    assert_eq!(machine.systemctl(&["stop", MEADOW]).code, Some(0));

    // A reload waits for what comes of it.
    let config = machine.path(&format!("{INSIDE}/etc/capture-daemon.toml"));
    let good = fs::read_to_string(&config).expect("readable");
    fs::write(&config, format!("{good}\n[refine]\nknots = 65\n")).expect("room");
    assert_eq!(machine.systemctl(&["reload", STATION]).code, Some(1), "65 knots are too many");
    fs::write(&config, format!("{good}\n[refine]\nknots = 9\n")).expect("room");
    let hash = station.status()["config"].take();
    assert_eq!(machine.systemctl(&["reload", STATION]).code, Some(0));
    wait_for(DEADLINE, || (station.status()["config"] != hash).then_some(())).expect("it is taken");
    assert_eq!(
        (machine.property("ActiveState"), machine.property("NRestarts")),
        ("active".into(), "1".into())
    );

    // What does not go on any more is started anew.
    assert_eq!(machine.systemctl(&["kill", "--signal=STOP", STATION]).code, Some(0));
    machine.waits_for("NRestarts", "2");
    machine.waits_for("ActiveState", "active");
    assert!(ids(&mut machine.connect()).is_superset(&before));

    assert_eq!(machine.systemctl(&["stop", STATION]).code, Some(0));
    assert_eq!(
        (machine.property("ActiveState"), machine.property("Result")),
        ("inactive".into(), "success".into())
    );
    // The socket stays, and whoever connects starts it.
    assert_eq!(machine.connect().status()["store"], json!("ok"));
    machine.waits_for("ActiveState", "active");
}
