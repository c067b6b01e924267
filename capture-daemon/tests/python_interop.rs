//! Do the public Python packages read our recordings, and we theirs?
//!
//! They are looked for in the interpreter that `SWARD_PYTHON` names, else `python3`. Without them the
//! tests are skipped and say so; `SWARD_REQUIRE_PYTHON=1` makes that a failure.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use capture_daemon::config::Config;
use capture_daemon::frame::{CameraModel, DepthFrame};
use capture_daemon::note::Note;
use capture_daemon::recording::{
    self, CAMERA_INFO_TOPIC, Distortion, GivenCamera, IMAGE_TOPIC, McapWriter, NOTES_TOPIC, OpenOptions,
    RecordingParams,
};
use capture_daemon::source::SourceError;
use capture_daemon::synth::{self, Clip, ClipParams, Family, Format, Scene};
use serde_json::{Value, json};

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

/// A file with three frames that Python writes.
fn write(folder: &Path, form: &Value) -> PathBuf {
    let path = folder.join("python.mcap");
    run(&["write", text(&path), &form.to_string()]);
    path
}

const CAMERA: CameraModel = CameraModel { fx: 571.5, fy: 572.5, cx: 9.25, cy: 5.75 };

/// Frame `i` of those that Python writes.
fn frame(i: u16) -> DepthFrame {
    DepthFrame {
        width: 20,
        height: 12,
        depth: (0..240).map(|pixel| 500 + 7 * i + pixel).collect(),
        depth_unit_m: 0.001,
        timestamp_ns: 1_700_000_000_000_000_000 + u64::from(i) * 100_000_000,
        camera: CAMERA,
    }
}

/// All frames of a recording; none may be skipped.
fn read(path: &Path, options: &OpenOptions) -> Result<Vec<DepthFrame>, String> {
    let mut source = recording::open(path, options).map_err(|error| error.to_string())?;
    let mut frames = Vec::new();
    loop {
        match source.next_frame() {
            Ok(frame) => frames.push(frame),
            Err(SourceError::End) => return Ok(frames),
            Err(error) => panic!("{error}"),
        }
    }
}

/// Asserts what is read of a file that Python writes.
fn check(form: &Value, expected: &[DepthFrame]) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = write(folder.path(), form);
    assert_eq!(read(&path, &OpenOptions::default()).as_deref(), Ok(expected), "{form}");
}

/// Asserts what is said of a file that Python writes.
fn check_refusal(form: &Value, expected: &str) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = write(folder.path(), form);
    let why = read(&path, &OpenOptions::default()).expect_err("refused");
    assert!(why.contains(expected), "{form}: {why}");
}

#[test]
fn every_form_of_file_that_python_writes_is_read() {
    if !has_python() {
        return;
    }
    let expected = [0, 1, 2].map(frame);
    for compression in ["NONE", "LZ4", "ZSTD"] {
        for (chunked, summary) in [(true, true), (true, false), (false, true), (false, false)] {
            for chunk_size in [1 << 20, 100] {
                let form = json!({"compression": compression, "chunked": chunked, "summary": summary, "chunk_size": chunk_size});
                check(&form, &expected);
            }
        }
    }
}

#[test]
fn every_form_of_image_that_python_writes_is_read() {
    if !has_python() {
        return;
    }
    let expected = [0, 1, 2].map(frame);
    for encoding in ["16UC1", "mono16"] {
        check(&json!({"encoding": encoding, "padding": 6}), &expected);
        check(&json!({"encoding": encoding, "padding": 3, "big_endian": true}), &expected);
    }
    let in_metres = expected.clone().map(|frame| {
        let mut depth: Vec<u16> = frame.depth.iter().map(|count| 10 * count).collect();
        depth[..3].fill(0);
        DepthFrame { depth, depth_unit_m: recording::FLOAT_DEPTH_UNIT_M, ..frame }
    });
    check(&json!({"encoding": "32FC1"}), &in_metres);
    check(&json!({"encoding": "32FC1", "padding": 5, "big_endian": true}), &in_metres);
    let logged = expected
        .clone()
        .map(|frame| DepthFrame { timestamp_ns: frame.timestamp_ns + 100_000_000_000_000_000, ..frame });
    check(&json!({"stamp": false}), &logged);
    check_refusal(&json!({"encoding": "rgb8"}), "/camera/depth/image_rect_raw (rgb8)");
}

#[test]
fn frames_that_python_writes_out_of_order_are_sorted() {
    if !has_python() {
        return;
    }
    for stamp in [true, false] {
        let as_logged = |frame: DepthFrame| {
            let later_ns = if stamp { 0 } else { 100_000_000_000_000_000 };
            DepthFrame { timestamp_ns: frame.timestamp_ns + later_ns, ..frame }
        };
        let check_order = |order: &[u16], expected: &[u16]| {
            let expected: Vec<DepthFrame> = expected.iter().map(|&i| as_logged(frame(i))).collect();
            for form in [json!({}), json!({"chunked": false}), json!({"chunk_size": 100})] {
                let mut form = form;
                (form["order"], form["stamp"]) = (json!(order), json!(stamp));
                check(&form, &expected);
            }
        };
        check_order(&[2, 0, 1], &[0, 1, 2]);
        check_order(&[1, 2, 3, 4, 5, 6, 7, 8, 0, 9], &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
        // The clock was set back by two seconds: no frame is lost, and none moved across that.
        check_order(&[20, 22, 21, 0, 2, 1], &[20, 21, 22, 0, 1, 2]);
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = write(folder.path(), &json!({"order": [20, 22, 21, 0, 2, 1]}));
    let info = recording::info(&path, &OpenOptions::default()).expect("a recording");
    assert_eq!((info.frames, info.steps_back, info.damage), (6, 1, Vec::new()));
}

#[test]
fn folders_that_python_writes_are_read() {
    if !has_python() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    run(&["pictures", text(folder.path())]);
    assert_eq!(read(folder.path(), &OpenOptions::default()).as_deref(), Ok(&[0, 1, 2].map(frame)[..]));

    // rosbag2 goes on in the next file, at whose start it says all topics again.
    let bag = tempfile::tempdir().expect("a folder");
    for (name, form) in [
        ("bag_0.mcap", json!({"order": [0, 1, 2]})),
        ("bag_1.mcap", json!({"order": [4, 3], "compression": "LZ4"})),
        ("bag_2.mcap", json!({"order": [5, 6], "chunked": false, "summary": false})),
    ] {
        run(&["write", text(&bag.path().join(name)), &form.to_string()]);
    }
    let expected = [0, 1, 2, 3, 4, 5, 6].map(frame);
    let metadata = "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n  \
        compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - bag_0.mcap\n    \
        - bag_1.mcap\n    - bag_2.mcap\n";
    for metadata in [None, Some(metadata)] {
        if let Some(text) = metadata {
            std::fs::write(bag.path().join("metadata.yaml"), text).expect("written");
        }
        assert_eq!(read(bag.path(), &OpenOptions::default()).as_deref(), Ok(&expected[..]));
    }
    let info = recording::info(bag.path(), &OpenOptions::default()).expect("a recording");
    assert_eq!((info.files.len(), info.frames, info.steps_back), (3, 7, 0));
    assert_eq!(info.topics["/camera/depth/image_rect_raw"].messages, 7);
    assert_eq!(info.metadata["session"]["visitor"], "a child");
}

#[test]
fn a_file_without_chunks_that_python_writes_is_read_on_behind_damage() {
    if !has_python() {
        return;
    }
    let all = [0, 1, 2, 3, 4, 5, 6, 7].map(frame);
    for summary in [true, false] {
        let folder = tempfile::tempdir().expect("a folder");
        let form = json!({"chunked": false, "summary": summary, "order": [0, 1, 2, 3, 4, 5, 6, 7]});
        let whole = std::fs::read(write(folder.path(), &form)).expect("readable");
        let (mut messages, mut at) = (Vec::new(), 8);
        while at + 9 < whole.len() - 8 {
            let len = u64::from_le_bytes(whole[at + 1..at + 9].try_into().expect("eight bytes")) as usize;
            if whole[at] == 5 {
                messages.push(at..at + 9 + len);
            }
            at += 9 + len;
        }
        assert_eq!(messages.len(), 16, "the image and the intrinsics of each frame");
        let path = folder.path().join("damaged.mcap");
        for (fill, len) in [(0xff, 12), (0, 40)] {
            for at in (messages[2].start..messages[15].end - len).step_by(53) {
                let mut bytes = whole.clone();
                bytes[at..at + len].fill(fill);
                std::fs::write(&path, bytes).expect("written");
                let mut source = recording::open(&path, &OpenOptions::default()).expect("a recording");
                let mut frames = Vec::new();
                loop {
                    match source.next_frame() {
                        Ok(frame) => frames.push(frame),
                        Err(SourceError::BadFrame(_)) => {}
                        Err(SourceError::End) => break,
                        Err(error) => panic!("{error}"),
                    }
                }
                for (i, frame) in all.iter().enumerate() {
                    let image = &messages[2 * i];
                    let touched = image.start < at + len && at < image.end;
                    assert!(touched || frames.contains(frame), "frame {i}, {len} x {fill:#x} at byte {at}");
                }
            }
        }
    }
}

#[test]
fn topics_and_intrinsics_that_python_writes_are_found() {
    if !has_python() {
        return;
    }
    let expected = [0, 1, 2].map(frame);
    for info in ["before", "after"] {
        check(&json!({"info": info, "summary": false}), &expected);
        check(&json!({"info": info, "topics": ["/infrared", "/aligned_Depth/image"]}), &expected);
    }
    let two = json!({"topics": ["/infrared", "/color"]});
    check_refusal(&two, "/color (16UC1), /infrared (16UC1); name one with `source.topic`");
    check_refusal(&json!({"info": "never"}), "camera.fx, camera.fy, camera.cx and camera.cy");
    let folder = tempfile::tempdir().expect("a folder");
    let options = OpenOptions { topic: Some("/color".into()), ..OpenOptions::default() };
    assert_eq!(read(&write(folder.path(), &two), &options).as_deref(), Ok(&expected[..]));
}

#[test]
fn distortions_that_python_writes_are_undone_or_refused_by_name() {
    if !has_python() {
        return;
    }
    let expected = [0, 1, 2].map(frame);
    check(&json!({"d": []}), &expected);
    check(&json!({"model": "", "d": []}), &expected);
    check(&json!({"model": "equidistant", "d": [0.0, 0.0, 0.0, 0.0]}), &expected);
    // Less than half a pixel anywhere.
    check(&json!({"model": "rational_polynomial", "d": [0.01, 0, 0, 0, 0, 0, 0, 0]}), &expected);
    for model in ["equidistant", "fisheye"] {
        check_refusal(&json!({"model": model, "d": [0.1, 0.0, 0.0, 0.0]}), &format!("{model:?}"));
    }
    check_refusal(&json!({"d": [0.1, 0.0]}), "plumb_bob has 2 coefficients");
    // 400 · r² · r is some pixels at the corners, where the pincushion shows nothing.
    let folder = tempfile::tempdir().expect("a folder");
    let path = write(folder.path(), &json!({"d": [400.0, 0.0, 0.0, 0.0, 0.0]}));
    let frames = read(&path, &OpenOptions::default()).expect("read");
    assert_eq!((frames[0].depth[0], frames[0].depth[6 * 20 + 9]), (0, expected[0].depth[6 * 20 + 9]));
}

#[test]
fn a_file_cut_at_every_byte_is_read_to_its_last_whole_image() {
    if !has_python() {
        return;
    }
    let given = GivenCamera { camera: CAMERA, distortion: Distortion::default() };
    let options = OpenOptions { camera: Some(given), ..OpenOptions::default() };
    let all = [0, 1, 2].map(frame);
    let forms = [
        json!({"compression": "ZSTD"}),
        json!({"compression": "LZ4", "summary": false}),
        json!({"compression": "NONE", "summary": false}),
        json!({"compression": "ZSTD", "chunk_size": 100, "summary": false}),
        json!({"chunked": false, "summary": false}),
    ];
    for form in forms {
        let folder = tempfile::tempdir().expect("a folder");
        let path = write(folder.path(), &form);
        let expected: Vec<usize> = serde_json::from_str(&run(&["whole", text(&path)])).expect("JSON");
        let bytes = std::fs::read(&path).expect("readable");
        assert_eq!((expected.len(), expected.last()), (bytes.len() + 1, Some(&3)), "{form}");
        let cut = folder.path().join("cut.mcap");
        for (len, &expected) in expected.iter().enumerate() {
            std::fs::write(&cut, &bytes[..len]).expect("written");
            match read(&cut, &options) {
                Ok(frames) => assert_eq!(frames, all[..expected], "{form}, {len} bytes"),
                Err(why) => assert_eq!(expected, 0, "{form}, {len} bytes: {why}"),
            }
        }
    }
}

#[test]
fn a_file_that_is_cut_and_recovered_python_reads() {
    if !has_python() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = write(folder.path(), &json!({"compression": "LZ4", "chunk_size": 100}));
    let bytes = std::fs::read(&path).expect("readable");
    let whole: Vec<usize> = serde_json::from_str(&run(&["whole", text(&path)])).expect("JSON");
    let len = whole.iter().position(|&images| images == 2).expect("two images");
    let (cut, mended) = (folder.path().join("cut.mcap"), folder.path().join("mended.mcap"));
    std::fs::write(&cut, &bytes[..len]).expect("written");
    let recovered = recording::recover(&cut, &mended).expect("recovered");
    assert_eq!((recovered.images, recovered.damaged_places), (2, 1));
    let read = |path: &Path| -> Vec<Value> {
        let lines = run(&["read", text(path)]);
        lines.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect()
    };
    let (before, after) = (read(&path), read(&mended));
    assert_eq!(after[0]["compressions"], json!(["zstd"]));
    assert_eq!((&after[0]["profile"], after.len()), (&json!("ros2"), 1 + 3));
    assert_eq!(after[1..], before[1..4], "the messages are the same");
    // The whole file has metadata behind its messages.
    let again = folder.path().join("again.mcap");
    recording::recover(&path, &again).expect("recovered");
    assert_eq!(read(&again)[0]["metadata"], before[0]["metadata"]);
    assert_eq!(before[0]["metadata"]["session"]["visitor"], "a child");
}

#[test]
fn a_live_run_s_recording_and_its_notes_python_reads() {
    if !has_python() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("live.mcap");
    let params = RecordingParams { serial: "F1".to_owned(), is_live: true, ..RecordingParams::default() };
    let mut writer = McapWriter::create(&path, params).expect("room");
    let notes = [Note::Begins { captured: false }, Note::Interrupted, Note::Dropped { frames: 3 }];
    for (i, note) in (0..).zip(&notes) {
        writer.write_noted(std::slice::from_ref(note), &frame(i)).expect("room");
        writer.end_chunk().expect("room");
    }
    writer.finish().expect("room");
    let lines: Vec<Value> =
        run(&["read", text(&path)]).lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(lines[0]["metadata"]["sward"]["order"], "as seen");
    assert_eq!((lines.len(), lines[0]["compressions"].clone()), (1 + 9, json!(["zstd"])));
    for (i, (note, messages)) in notes.iter().zip(lines[1..].chunks(3)).enumerate() {
        assert_eq!(
            (messages[0]["topic"].as_str(), messages[2]["topic"].as_str()),
            (Some(NOTES_TOPIC), Some(IMAGE_TOPIC))
        );
        assert_eq!(messages[0]["text"].as_str().and_then(Note::of_json).as_ref(), Some(note));
        assert_eq!(messages[2]["stamp_ns"].as_u64(), Some(frame(i as u16).timestamp_ns));
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
    let config = file["metadata"]["sward"]["config"].as_str().expect("text");
    assert_eq!(toml::from_str(config), Ok(Config::default()));
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
