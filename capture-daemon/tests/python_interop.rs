//! Do the public Python packages read our recordings, and we theirs?
//!
//! They are looked for in the interpreter that `SWARD_PYTHON` names, else `python3`. Without them the
//! tests are skipped and say so; `SWARD_REQUIRE_PYTHON=1` makes that a failure.

use std::path::Path;
use std::process::{Command, Output};

use capture_daemon::frame::CameraModel;
use capture_daemon::recording::{self, CAMERA_INFO_TOPIC, IMAGE_TOPIC, OpenOptions};
use capture_daemon::source::SourceError;
use capture_daemon::synth::{self, Clip, ClipParams, Family, Format, Scene};
use serde_json::Value;

fn python(args: &[&str]) -> std::io::Result<Output> {
    let python = std::env::var_os("SWARD_PYTHON").unwrap_or_else(|| "python3".into());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/python/interop.py");
    Command::new(python).arg(script).args(args).output()
}

/// Whether the packages are there.
fn has_python() -> bool {
    let why = match python(&["check"]) {
        Ok(output) if output.status.success() => return true,
        Ok(output) => String::from_utf8_lossy(&output.stderr).lines().last().unwrap_or_default().to_owned(),
        Err(error) => error.to_string(),
    };
    let required = std::env::var_os("SWARD_REQUIRE_PYTHON").is_some_and(|value| value == "1");
    assert!(!required, "the Python packages mcap and mcap-ros2-support are required: {why}");
    eprintln!("skipped: no Python with mcap and mcap-ros2-support ({why}); SWARD_PYTHON names one");
    false
}

/// The standard output of the script.
fn run(args: &[&str]) -> String {
    let output = python(args).expect("the interpreter runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("UTF-8")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

#[test]
fn what_python_writes_is_read() {
    if !has_python() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    for compression in ["NONE", "LZ4", "ZSTD"] {
        let path = folder.path().join(format!("{compression}.mcap"));
        run(&["write", text(&path), compression]);
        let mut source = recording::open(&path, &OpenOptions::default()).expect("a recording");
        for i in 0..3_u16 {
            let frame = source.next_frame().expect("a frame");
            assert_eq!((frame.width, frame.height, frame.depth_unit_m), (20, 12, 0.001));
            assert_eq!(frame.depth, (0..240).map(|pixel| 500 + 7 * i + pixel).collect::<Vec<u16>>());
            assert_eq!(frame.timestamp_ns, 1_700_000_000_000_000_000 + u64::from(i) * 100_000_000);
            assert_eq!(frame.camera, CameraModel { fx: 571.5, fy: 572.5, cx: 9.25, cy: 5.75 });
        }
        assert_eq!(source.next_frame(), Err(SourceError::End));
    }
}

#[test]
fn what_we_write_python_reads() {
    if !has_python() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let params = ClipParams { width: 64, height: 48, frames: 70, ..ClipParams::default() };
    let clip = Clip::new(Scene::new(Family::Row, 2), params).expect("the parameters are in range");
    let path = synth::write(folder.path(), &clip, Format::Mcap, 0).expect("written");
    let lines: Vec<Value> =
        run(&["read", text(&path)]).lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    let (file, messages) = lines.split_first().expect("a line about the file");
    assert_eq!(file["profile"], "ros2");
    assert_eq!(file["compressions"], serde_json::json!(["zstd"]));
    assert!(file["longest_chunk_ns"].as_u64().expect("a number") < 1_000_000_000);
    assert_eq!(file["metadata"]["sward"]["depth_unit_m"], "0.001");
    assert_eq!(file["metadata"]["sward"]["sensor"], "Sward synthetic sensor");
    assert_eq!(messages.len(), 2 * 70);
    for (frame, pair) in clip.frames().zip(messages.chunks(2)) {
        let (info, image) = (&pair[0], &pair[1]);
        assert_eq!(
            (info["topic"].as_str(), image["topic"].as_str()),
            (Some(CAMERA_INFO_TOPIC), Some(IMAGE_TOPIC))
        );
        let CameraModel { fx, fy, cx, cy } = frame.camera;
        assert_eq!(info["k"], serde_json::json!([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]));
        assert_eq!(info["d"], serde_json::json!([0.0, 0.0, 0.0, 0.0, 0.0]));
        assert_eq!((image["encoding"].as_str(), image["step"].as_u64()), (Some("16UC1"), Some(128)));
        for message in pair {
            assert_eq!(message["stamp_ns"].as_u64(), Some(frame.timestamp_ns));
            assert_eq!(message["log_time_ns"].as_u64(), Some(frame.timestamp_ns));
            assert_eq!(message["size"], serde_json::json!([64, 48]));
        }
        let hex: String = frame.depth.iter().map(|count| format!("{:04x}", count.swap_bytes())).collect();
        assert_eq!(image["data"].as_str(), Some(hex.as_str()));
    }
}
