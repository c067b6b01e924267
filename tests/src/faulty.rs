//! A sensor that fails as a test tells it to: a shipped recording over and over, with the faults of a script.

use std::path::{Path, PathBuf};
use std::process::Command;

use capture_daemon::source::faulty::{Fault, FaultKind, Script};
use serde_json::Value;
use tempfile::TempDir;

use crate::programs::{DEADLINE, wait_for};
use crate::root;
use crate::station::Station;

/// The sensor, and its script in a folder of its own.
#[derive(Debug)]
pub struct Faulty {
    folder: TempDir,
    recording: PathBuf,
}

impl Faulty {
    /// One that shows a shipped recording, by its name, and is well.
    ///
    /// # Panics
    /// If there is no room.
    pub fn on(recording: &str) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let faulty = Self { folder, recording: root().join("recordings").join(recording) };
        faulty.befalls(&[]);
        faulty
    }

    /// Has these faults befall it from now on, each so many seconds from now.
    ///
    /// # Panics
    /// If there is no room.
    pub fn befalls(&self, faults: &[(f64, FaultKind)]) {
        let faults = faults.iter().map(|(at_s, kind)| Fault { at_s: *at_s, kind: *kind }).collect();
        let script = Script { recording: self.recording.clone(), fps: None, faults };
        let hidden = self.folder.path().join(".script.toml");
        std::fs::write(&hidden, script.to_toml()).expect("room");
        std::fs::rename(hidden, self.script()).expect("the same folder");
    }

    /// Its script.
    pub fn script(&self) -> PathBuf {
        self.folder.path().join("script.toml")
    }

    /// Settings of a station on it.
    pub fn settings(&self) -> Vec<(&'static str, String)> {
        vec![
            ("sensor.driver", "\"faulty\"".to_owned()),
            ("sensor.device", format!("{:?}", self.script())),
            ("sensor.deadline_s", "1.0".to_owned()),
            // Disks of test machines are small.
            ("record.reserve_mb", "0.0".to_owned()),
        ]
    }

    /// The same as arguments of a program.
    pub fn arguments(&self) -> Vec<String> {
        self.settings()
            .iter()
            .flat_map(|(key, value)| ["--set".to_owned(), format!("{key}={value}")])
            .collect()
    }
}

/// The status once something holds of it.
///
/// # Panics
/// If it does not within [`DEADLINE`]; `what` is what was waited for.
pub fn wait_until(station: &mut Station, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
    let mut last = Value::Null;
    let status = wait_for(DEADLINE, || {
        last = station.status();
        holds(&last).then(|| last.clone())
    });
    status.unwrap_or_else(|| panic!("{what}: {last}"))
}

/// Number of a field of a status.
///
/// # Panics
/// If it has none.
pub fn count(status: &Value, field: &str) -> i64 {
    status[field].as_i64().unwrap_or_else(|| panic!("{field}: {status}"))
}

/// The command that runs `command` where `folder` is a file system of its own, in memory, of so many bytes; in a
/// namespace, so that nobody needs to be root. `None`, said aloud, where the system allows no namespaces.
pub fn on_a_small_disk(folder: &Path, bytes: u64, command: &Command) -> Option<Command> {
    let namespace = ["--user", "--map-root-user", "--mount"];
    let allowed =
        Command::new("unshare").args(namespace).args(["mount", "-t", "tmpfs", "tmpfs", "/mnt"]).status();
    if !allowed.is_ok_and(|status| status.success()) {
        eprintln!("skipped: this machine allows no mount in a namespace of its own");
        return None;
    }
    let mut inside = Command::new("unshare");
    let script = format!("mount -t tmpfs -o size={bytes} tmpfs \"$1\" && shift && exec \"$@\"");
    inside.args(namespace).args(["sh", "-c", &script, "sh"]).arg(folder);
    inside.arg(command.get_program()).args(command.get_args());
    inside.env_remove("STATE_DIRECTORY");
    Some(inside)
}
