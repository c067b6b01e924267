//! Does a varlink client that is not ours understand the station? Python's package reads the interface
//! that the station describes, and calls every method of it.
//!
//! It is looked for in the interpreter that `SWARD_PYTHON` names, else `python3`. Without it the test is
//! skipped and says so; `SWARD_REQUIRE_PYTHON=1` makes that a failure.

use std::fs;
use std::process::{Command, Output};

use tests::daemon::Daemon;

fn python(arguments: &[&str]) -> std::io::Result<Output> {
    let python = std::env::var_os("SWARD_PYTHON").unwrap_or_else(|| "python3".into());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/python/station.py");
    Command::new(python).arg(script).args(arguments).output()
}

#[test]
fn python_calls_every_method() {
    let checked = python(&["check"]);
    if !checked.as_ref().is_ok_and(|output| output.status.success()) {
        let required = std::env::var_os("SWARD_REQUIRE_PYTHON").is_some_and(|value| value == "1");
        assert!(!required, "the Python package varlink is required: {checked:?}");
        eprintln!("skipped: no Python with varlink; SWARD_PYTHON names one");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let blades = folder.path().join("state/blades");
    fs::create_dir_all(&blades).expect("room");
    let fern = "format = 1\nknots = [\n  { position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004] },\n  { position_m = [0.0, 0.2, 0.0], half_width_m = [0.0, 0.0] },\n]\n";
    fs::write(blades.join("fern.toml"), fern).expect("room");
    let settings = [
        ("capture.hold_s", "60.0".to_owned()),
        ("source.loop", "true".to_owned()),
        ("record.ring_s", "5.0".to_owned()),
        ("record.reserve_mb", "0.0".to_owned()),
    ];
    let daemon = Daemon::start_in(folder, &settings);
    let socket = daemon.socket();
    let called = python(&["call", socket.to_str().expect("UTF-8")]).expect("it ran before");
    assert!(called.status.success(), "{}", String::from_utf8_lossy(&called.stderr));
}
