//! Does the real libOpenNI2 play our recordings through the program, pixel for pixel: each frame once, to its end, over
//! again, and of one that was cut off what there is?

use std::path::{Path, PathBuf};
use std::time::Instant;

use capture_daemon::frame::DepthFrame;
use capture_daemon::recording::{self, OpenOptions, START_NS};
use capture_daemon::source::{FrameSource, SourceError};
use capture_daemon::synth::{Clip, ClipParams, Family, Scene};
use serde_json::Value;
use tempfile::TempDir;
use tests::daemon::Daemon;
use tests::oni::{OniParams, OniWriter};
use tests::openni2;
use tests::programs::{DEADLINE, Program, wait_for};

fn options() -> OpenOptions {
    OpenOptions { program: Some(Program::Capture.path()), ..OpenOptions::default() }
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Some pixel of some frame: depth that shows shift, mirroring, and exchange of frames or rows.
fn pixel(frame: u64, x: u32, y: u32) -> u16 {
    let number = frame.wrapping_mul(7919) + u64::from(x) * 3 + u64::from(y) * 1021;
    if number.is_multiple_of(97) { 0 } else { (300 + number % 60_000) as u16 }
}

fn picture(frame: u64, params: &OniParams) -> Vec<u16> {
    (0..params.height).flat_map(|y| (0..params.width).map(move |x| pixel(frame, x, y))).collect()
}

/// Writes so many frames; `is_finished`: as they are without a crash.
fn write(path: &Path, params: &OniParams, frames: u64, is_finished: bool) {
    let mut writer = OniWriter::create(path, params);
    for index in 0..frames {
        writer.frame(index * 33_333, &picture(index, params));
    }
    if is_finished {
        writer.finish();
    }
}

/// A recording of so many frames.
fn written(folder: &TempDir, params: &OniParams, frames: u64, is_finished: bool) -> PathBuf {
    let path = folder.path().join("depth.oni");
    write(&path, params, frames, is_finished);
    path
}

/// All frames and what else was said.
fn drain(source: &mut dyn FrameSource) -> (Vec<DepthFrame>, Vec<SourceError>) {
    let (mut frames, mut said) = (Vec::new(), Vec::new());
    loop {
        match source.next_frame() {
            Ok(frame) => frames.push(frame),
            Err(error @ (SourceError::End | SourceError::Failed(_))) => {
                said.push(error);
                return (frames, said);
            }
            Err(error) => said.push(error),
        }
    }
}

fn read(path: &Path) -> (Vec<DepthFrame>, Vec<SourceError>) {
    drain(recording::open(path, &options()).unwrap_or_else(|error| panic!("{error}")).as_mut())
}

#[test]
fn every_frame_comes_once_with_every_pixel() {
    if !openni2::is_there() {
        return;
    }
    let (folder, params) = (folder(), OniParams::default());
    let path = written(&folder, &params, 60, true);
    let (frames, said) = read(&path);
    assert_eq!(said, [SourceError::End]);
    assert_eq!(frames.len(), 60);
    for (index, frame) in (0..).zip(&frames) {
        assert_eq!((frame.width, frame.height, frame.depth_unit_m), (640, 480, 0.001));
        assert_eq!(frame.timestamp_ns, START_NS + index * 33_333_000, "frame {index}");
        assert!(frame.depth == picture(index, &params), "frame {index} has other pixels");
        assert!((frame.camera.fx - 570.34).abs() < 0.01 && frame.camera.cx == 319.5, "{:?}", frame.camera);
    }
}

#[test]
fn tenths_of_millimetres_and_other_sizes_are_read() {
    if !openni2::is_there() {
        return;
    }
    let params = OniParams { width: 320, height: 240, is_fine: true, ..OniParams::default() };
    let folder = folder();
    let (frames, said) = read(&written(&folder, &params, 7, true));
    assert_eq!((frames.len(), said), (7, vec![SourceError::End]));
    assert_eq!((frames[6].width, frames[6].height, frames[6].depth_unit_m), (320, 240, 0.0001));
    assert!(frames[6].depth == picture(6, &params));
    assert!((frames[6].camera.fx - 285.17).abs() < 0.01, "half as many pixels see the same angle");
}

#[test]
fn what_was_recorded_mirrored_is_turned_back() {
    if !openni2::is_there() {
        return;
    }
    let params = OniParams { width: 160, height: 120, is_mirrored: true, ..OniParams::default() };
    let folder = folder();
    let (frames, _) = read(&written(&folder, &params, 3, true));
    let turned: Vec<u16> =
        picture(2, &params).chunks(160).flat_map(|row| row.iter().rev().copied()).collect();
    assert_eq!(frames.len(), 3);
    assert!(frames[2].depth == turned);
}

#[test]
fn a_recording_that_was_never_finished_plays_to_its_last_frame() {
    if !openni2::is_there() {
        return;
    }
    let params = OniParams { width: 160, height: 120, ..OniParams::default() };
    let folder = folder();
    let path = written(&folder, &params, 12, false);
    let (frames, said) = read(&path);
    assert_eq!((frames.len(), said), (12, vec![SourceError::End]));
    assert!(frames[11].depth == picture(11, &params));
}

#[test]
fn what_is_cut_off_or_damaged_is_refused_or_read_as_far_as_it_is_whole() {
    if !openni2::is_there() {
        return;
    }
    let params = OniParams { width: 160, height: 120, ..OniParams::default() };
    let folder = folder();
    let path = written(&folder, &params, 6, true);
    let bytes = std::fs::read(&path).expect("it was written");
    let mut most = 0;
    let frame_bytes = 160 * 120 * 2 + 40;
    for part in 1..24 {
        let kept = bytes.len() * part / 24;
        std::fs::write(&path, &bytes[..kept]).expect("room");
        match recording::open(&path, &options()) {
            Ok(mut source) => {
                let (frames, said) = drain(source.as_mut());
                assert_eq!(said, [SourceError::End], "part {part}");
                // Before the first frame there are some properties, behind the last its table.
                assert!(frames.len() + 1 >= kept / frame_bytes, "part {part}: {} frames", frames.len());
                for (index, frame) in (0..).zip(&frames) {
                    assert!(frame.depth == picture(index, &params), "part {part}, frame {index}");
                }
                most = most.max(frames.len());
            }
            Err(error) => {
                assert!(kept < frame_bytes + 2000, "part {part}: {error}");
                assert!(error.to_string().contains("depth.oni"), "{error}");
            }
        }
    }
    assert_eq!(most, 5, "the last part misses a twenty-fourth");
}

#[test]
fn the_library_that_is_absent_is_named_with_what_to_do() {
    let folder = folder();
    let path = written(&folder, &OniParams { width: 16, height: 12, ..OniParams::default() }, 2, true);
    let library = "sensor.openni2_library=\"/nowhere/libOpenNI2.so.0\"";
    for verb in ["replay", "info"] {
        let finished = Program::Capture.run([verb, path.to_str().expect("UTF-8"), "--set", library]);
        assert_eq!(finished.code, Some(3), "{finished:?}");
        let said = &finished.stderr;
        assert!(said.contains("/nowhere/libOpenNI2.so.0") && said.contains("libopenni2-0"), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
    // It is an error where it is wanted, and else what can be said without it is.
    let wanted = "sensor.driver=\"openni2\"";
    for (sets, code) in [(&["--set", library][..], 0), (&["--set", library, "--set", wanted], 4)] {
        let finished = Program::Capture.run([&["devices", "--json"], sets].concat());
        assert_eq!(finished.code, Some(code), "{finished:?}");
        assert!(finished.stderr.contains("sensor.openni2_library"), "{finished:?}");
        assert_eq!(finished.stdout.is_empty(), code != 0, "{finished:?}");
    }
}

#[test]
fn a_replay_finds_the_blades_of_the_same_frames_in_mcap() {
    if !openni2::is_there() {
        return;
    }
    let folder = folder();
    let clip = Clip::new(Scene::new(Family::Single, 3), ClipParams { frames: 30, ..ClipParams::default() });
    let clip = clip.expect("the parameters are in range");
    // Seen from the angle that the synthetic camera has.
    let camera = clip.frame(0).camera;
    let [across, down] =
        [(640.0, camera.fx), (480.0, camera.fy)].map(|(pixels, focal)| 2.0 * (pixels / 2.0 / focal).atan());
    let params = OniParams { field_of_view: [across, down], ..OniParams::default() };
    let path = folder.path().join("blade.oni");
    let mut writer = OniWriter::create(&path, &params);
    for (index, frame) in (0..).zip(clip.frames()) {
        writer.frame(index * 33_333, &frame.depth);
    }
    writer.finish();
    let shown = path.to_str().expect("UTF-8");
    let finished = Program::Capture.run(["replay", shown, "--json"]);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    let events: Vec<Value> =
        finished.stdout.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    let blades: Vec<&Value> = events.iter().filter(|event| event["event"] == "blade").collect();
    assert_eq!(blades.len(), 1, "{events:?}");
    let end = events.last().expect("an end");
    assert_eq!((&end["frames"], &end["skipped_frames"]), (&30.into(), &0.into()), "{end}");
    assert_eq!(
        Program::Capture.run(["replay", shown, "--json"]).stdout,
        finished.stdout,
        "the same each time"
    );

    let start = Instant::now();
    let paced = Program::Capture.run(["replay", shown, "--json", "--realtime"]);
    assert_eq!(paced.stdout, finished.stdout, "in real time, too, each frame comes once");
    assert!(start.elapsed().as_secs_f64() > 0.9, "29 frames after the first, at 30 a second");

    let info = Program::Capture.run(["info", shown, "--json"]);
    let info: Value = serde_json::from_str(&info.stdout).expect("JSON");
    assert_eq!(
        (&info["format"], &info["frames"], &info["width"]),
        (&"oni".into(), &30.into(), &640.into()),
        "{info}"
    );
}

#[test]
fn a_station_plays_it_over_and_over() {
    if !openni2::is_there() {
        return;
    }
    let params = OniParams { width: 160, height: 120, ..OniParams::default() };
    let folder = folder();
    let path = written(&folder, &params, 10, true);
    let settings = [
        ("source.recording", format!("{path:?}")),
        ("source.loop", "true".to_owned()),
        ("source.rate", "0.0".to_owned()),
    ];
    let daemon = Daemon::start(&settings);
    let mut station = daemon.connect();
    let played = || Some(station.status()).filter(|status| status["frames"].as_i64() > Some(30));
    let status = wait_for(DEADLINE, played).expect("it begins again at its end");
    assert_eq!((&status["skipped_frames"], &status["sensor"]), (&0.into(), &"none".into()), "{status}");
}
