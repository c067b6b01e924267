//! systemd's units, where it runs.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use super::{Finding, within};

/// What a station lives by; the picture may be on another machine.
const UNITS: [&str; 2] = ["sward-capture.socket", "sward-capture.service"];
const CHECK: &str = "systemd";

/// Whether the units are installed, enabled and active. `booted`: what is there only where systemd runs.
pub(super) fn units(systemctl: &Path, booted: &Path, deadline: Duration) -> Vec<Finding> {
    if !booted.exists() {
        return vec![Finding::skipped(CHECK, "", "this machine is not run by systemd")];
    }
    let of_unit = |unit: &'static str| match properties(systemctl, unit, deadline) {
        Ok(properties) => state(unit, &properties),
        Err(found) => {
            let expected = "an answer to systemctl show";
            Finding::trouble(CHECK, unit, found, expected, "see whether systemd and its bus run")
        }
    };
    UNITS.map(of_unit).into()
}

/// The process of the station that systemd started, where it did.
pub(super) fn station(systemctl: &Path, deadline: Duration) -> Option<u32> {
    let properties = properties(systemctl, UNITS[1], deadline).ok()?;
    properties.get("MainPID")?.parse().ok().filter(|pid| *pid > 0)
}

/// What systemd knows of a unit.
fn properties(systemctl: &Path, unit: &str, deadline: Duration) -> Result<BTreeMap<String, String>, String> {
    let mut command = Command::new(systemctl);
    let wanted = "--property=LoadState,UnitFileState,ActiveState,Result,NRestarts,MainPID";
    command.args(["show", "--no-pager", wanted, unit]);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = command.spawn().map_err(|error| format!("systemctl cannot be run: {error}"))?;
    let stdout = child.stdout.take();
    let said = within(deadline, move || {
        let mut said = String::new();
        stdout.map(|mut stdout| stdout.read_to_string(&mut said));
        said
    });
    if said.is_none() {
        // It hangs on a bus that does not answer.
        let _ = child.kill();
    }
    let is_well = child.wait().is_ok_and(|status| status.success());
    let Some(said) = said else {
        return Err(format!("systemctl does not answer within {} s", deadline.as_secs_f64()));
    };
    if !is_well {
        return Err("systemctl fails".to_owned());
    }
    let pairs = said.lines().filter_map(|line| line.split_once('='));
    Ok(pairs.map(|(key, value)| (key.to_owned(), value.to_owned())).collect())
}

fn state(unit: &'static str, properties: &BTreeMap<String, String>) -> Finding {
    let of = |key: &str| properties.get(key).map_or("", String::as_str);
    let (load, file, active) = (of("LoadState"), of("UnitFileState"), of("ActiveState"));
    let restarts = of("NRestarts").parse::<u64>().unwrap_or(0);
    let enabled = "one that is enabled and active";
    match (load, file, active) {
        ("not-found", ..) => Finding::skipped(CHECK, unit, "it is not installed"),
        ("loaded", ..) if file == "disabled" || file == "masked" => {
            let remedy = format!("run systemctl enable --now {unit}");
            Finding::trouble(CHECK, unit, format!("it is {file}, and {active} now"), enabled, remedy)
        }
        ("loaded", _, "active" | "reloading") if restarts == 0 => {
            Finding::ok(CHECK, unit, format!("{file}, {active}"))
        }
        ("loaded", _, "active" | "reloading") => {
            Finding::ok(CHECK, unit, format!("{file}, {active}, {restarts} restarts"))
        }
        ("loaded", ..) => {
            let found = format!("it is {active} (result {}, {restarts} restarts)", of("Result"));
            Finding::trouble(CHECK, unit, found, enabled, format!("see journalctl -u {unit}, then start it"))
        }
        _ => {
            let found = format!("systemd cannot load it ({load})");
            Finding::trouble(CHECK, unit, found, enabled, format!("see systemctl status {unit}"))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::super::tests::assert_trouble;
    use super::super::{DEADLINE, Verdict};
    use super::*;

    /// A folder whose `systemctl` is this script.
    fn folder(script: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        let systemctl = folder.path().join("systemctl");
        std::fs::write(&systemctl, format!("#!/bin/sh\n{script}\n")).expect("room");
        std::fs::set_permissions(&systemctl, PermissionsExt::from_mode(0o755)).expect("it is ours");
        folder
    }

    /// What is found where `systemctl` is this script.
    fn with(script: &str, deadline: Duration) -> Vec<Finding> {
        let folder = folder(script);
        units(&folder.path().join("systemctl"), folder.path(), deadline)
    }

    /// The same where it says this of every unit.
    fn said(load: &str, file: &str, active: &str) -> Finding {
        let script = format!(
            "echo LoadState={load}; echo UnitFileState={file}; echo ActiveState={active}; echo NRestarts=3"
        );
        with(&script, DEADLINE).remove(0)
    }

    #[test]
    fn a_unit_that_is_not_enabled_or_not_active_is_trouble() {
        assert_eq!(
            units(Path::new("systemctl"), Path::new("/no/such"), DEADLINE)[0].verdict,
            Verdict::Skipped
        );
        assert_eq!(said("not-found", "", "inactive").verdict, Verdict::Skipped);
        let well = said("loaded", "enabled", "active");
        assert_eq!((well.verdict, &*well.found), (Verdict::Ok, "enabled, active, 3 restarts"));
        assert_trouble(&said("loaded", "disabled", "active"), &["disabled", "systemctl enable --now"]);
        assert_trouble(&said("loaded", "enabled", "failed"), &["failed", "3 restarts", "journalctl -u"]);
        assert_trouble(&said("loaded", "enabled", "activating"), &["activating"]);
        assert_trouble(&said("bad-setting", "enabled", "inactive"), &["bad-setting", "systemctl status"]);
    }

    #[test]
    fn the_station_s_process_is_known_while_it_runs() {
        let of = |script: &str| station(&folder(script).path().join("systemctl"), DEADLINE);
        assert_eq!(of("echo MainPID=4242"), Some(4242));
        assert_eq!([of("echo MainPID=0"), of("exit 1"), of("echo")], [None; 3]);
    }

    #[test]
    fn a_systemctl_that_fails_or_hangs_is_trouble() {
        assert_trouble(&with("exit 1", DEADLINE)[0], &["systemctl fails"]);
        assert_trouble(&with("exec sleep 1000", Duration::from_millis(50))[0], &["does not answer"]);
        let nowhere = units(Path::new("/no/such/systemctl"), Path::new("/"), DEADLINE);
        assert_trouble(&nowhere[1], &["sward-capture.service", "cannot be run"]);
    }
}
