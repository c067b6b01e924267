//! Does bad input get one clear sentence and the right exit code?

use std::ffi::OsStr;
use std::fs::write;
use std::path::Path;

use tempfile::TempDir;
use tests::programs::{DEADLINE, Finished, Program, Running};
use tests::shipped_recording;

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// Runs a program with its log off: what is left on stderr is what it says to its user.
fn run<A: AsRef<OsStr>>(program: Program, arguments: impl IntoIterator<Item = A>) -> Finished {
    let mut command = program.command(arguments);
    command.env("SWARD_LOG", "off");
    Running::start(command).finish(DEADLINE)
}

/// Asserts one sentence on stderr, nothing on stdout, the exit code, and that each of `named` is in
/// the sentence.
#[track_caller]
fn refused(finished: &Finished, code: i32, named: &[&str]) {
    assert_eq!(finished.code, Some(code), "{finished:?}");
    assert_eq!(finished.stdout, "", "{finished:?}");
    let sentence = finished.stderr.strip_suffix('\n').unwrap_or_default();
    assert!(sentence.ends_with('.') && !sentence.contains('\n'), "not one sentence: {finished:?}");
    for name in named {
        assert!(sentence.contains(name), "does not say {name:?}: {sentence}");
    }
}

fn replay(path: &Path) -> Finished {
    run(Program::Capture, ["replay", text(path), "--json"])
}

/// A replay with this text as its config.
fn with_config(config: &str) -> (Finished, String) {
    let folder = folder();
    let path = folder.path().join("station.toml");
    write(&path, config).expect("a file");
    let finished = run(Program::Capture, ["replay", text(&shipped_recording()), "--config", text(&path)]);
    (finished, text(&path).to_owned())
}

#[test]
fn a_recording_that_is_not_there() {
    let path = folder().path().join("lost.mcap");
    refused(&replay(&path), 3, &[text(&path)]);
}

#[test]
fn a_text_file_that_is_called_mcap() {
    let folder = folder();
    let path = folder.path().join("notes.mcap");
    write(&path, "Remember to water the grass.\n").expect("a file");
    refused(&replay(&path), 3, &[text(&path)]);
}

#[test]
fn an_empty_file() {
    let folder = folder();
    let path = folder.path().join("empty.mcap");
    write(&path, "").expect("a file");
    refused(&replay(&path), 3, &[text(&path)]);
}

#[test]
fn an_empty_folder() {
    let folder = folder();
    refused(&replay(folder.path()), 3, &[text(folder.path())]);
}

#[test]
fn a_config_with_an_unknown_key() {
    let (finished, path) = with_config("# Ours.\n[mask]\nnear_m = 0.4\n  nears_m = 0.4\n");
    refused(&finished, 2, &[&format!("{path}:4:3"), "nears_m"]);
}

#[test]
fn a_config_with_an_unknown_table() {
    let (finished, path) = with_config("\n[masks]\nnear_m = 0.4\n");
    refused(&finished, 2, &[&format!("{path}:2:2"), "masks"]);
}

#[test]
fn a_config_with_a_value_of_the_wrong_type() {
    let (finished, path) = with_config("[mask]\nnear_m = \"close\"\n");
    refused(&finished, 2, &[&format!("{path}:2:10: `mask.near_m` is text"), "expected a number, such as"]);
}

#[test]
fn a_config_with_a_value_out_of_its_range() {
    let (finished, path) = with_config("[refine]\n\nknots = 65\n");
    refused(&finished, 2, &[&format!("{path}:3:9"), "refine.knots", "2 to 64"]);
}

#[test]
fn a_config_that_is_not_toml() {
    let (finished, path) = with_config("[mask]\nnear_m 0.4\n");
    refused(&finished, 2, &[&format!("{path}:2:8")]);
}

#[test]
fn a_config_that_is_not_there() {
    let lost = folder().path().join("lost.toml");
    let finished = run(Program::Capture, ["replay", text(&shipped_recording()), "--config", text(&lost)]);
    refused(&finished, 2, &[text(&lost)]);
}

#[test]
fn an_unknown_key_to_set() {
    let finished = run(Program::Capture, ["replay", text(&shipped_recording()), "--set", "mask.nears_m=0.4"]);
    refused(&finished, 2, &["nears_m"]);
}

#[test]
fn a_value_to_set_that_is_no_toml() {
    let finished =
        run(Program::Capture, ["replay", text(&shipped_recording()), "--set", "mask.near_m=close"]);
    refused(&finished, 2, &["mask.near_m"]);
}

#[test]
fn an_unknown_verb() {
    refused(&run(Program::Capture, ["replya"]), 2, &["replya", "see sward-capture --help"]);
    refused(
        &run(Program::Capture, ["blades", "rename", "fern"]),
        2,
        &["see sward-capture blades rename --help"],
    );
    refused(&run(Program::Capture, ["blades"]), 2, &["list or show", "see sward-capture blades --help"]);
    refused(&run(Program::Capture, [""; 0]), 2, &["run or replay", "see sward-capture --help"]);
}

#[test]
fn an_unknown_option() {
    refused(
        &run(Program::Capture, ["replay", "--jason"]),
        2,
        &["--jason", "see sward-capture replay --help"],
    );
    refused(&run(Program::Render, ["--headles"]), 2, &["--headles"]);
}

#[test]
fn a_socket_in_use() {
    let folder = folder();
    let socket = folder.path().join("station.socket");
    let arguments = [
        "run".to_owned(),
        "--set".to_owned(),
        format!("source.recording={:?}", text(&shipped_recording())),
        "--set".to_owned(),
        format!("service.socket={:?}", text(&socket)),
        "--set".to_owned(),
        "source.loop=true".to_owned(),
        "--set".to_owned(),
        format!("store.directory={:?}", text(&folder.path().join("state"))),
    ];
    let first = Running::start(Program::Capture.command(&arguments)).wait_for_socket(&socket);
    refused(&run(Program::Capture, &arguments), 1, &[text(&socket)]);
    let mut first = first.wait_for_socket(&socket);
    assert_eq!(first.ended(), None, "the first daemon goes on");
}

#[test]
fn no_vulkan_device() {
    let folder = folder();
    let out = folder.path().join("out");
    let mut command = Program::Render.command(["--headless", "--frames", "1", "--out", text(&out)]);
    command.env("VK_ICD_FILENAMES", "/nonexistent").env("VK_DRIVER_FILES", "/nonexistent");
    refused(&Running::start(command).finish(DEADLINE), 1, &["Vulkan"]);
}

#[test]
fn a_library_that_is_a_text_file() {
    let folder = folder();
    let (library, out) = (folder.path().join("library.bin"), folder.path().join("out"));
    write(&library, "This is no library, although it has enough bytes to hold the header of one: 64.")
        .expect("a file");
    let arguments = ["--headless", "--library", text(&library), "--frames", "1", "--out", text(&out)];
    refused(&run(Program::Render, arguments), 1, &[text(&library)]);
}

#[test]
fn a_library_that_is_not_there() {
    let folder = folder();
    let (library, out) = (folder.path().join("lost.bin"), folder.path().join("out"));
    let arguments = ["--headless", "--library", text(&library), "--frames", "1", "--out", text(&out)];
    refused(&run(Program::Render, arguments), 1, &[text(&library)]);
}

#[test]
fn no_daemon_within_the_time_given() {
    let folder = folder();
    let (socket, out) = (folder.path().join("nobody.socket"), folder.path().join("out"));
    let arguments = [
        "--headless",
        "--socket",
        text(&socket),
        "--wait-blades",
        "1",
        "--timeout-secs",
        "1",
        "--frames",
        "1",
        "--out",
        text(&out),
    ];
    refused(&run(Program::Render, arguments), 1, &[text(&socket)]);
}
