//! Damaged recordings: what is lost with each kind of damage, and what is not.

mod reading;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use capture_daemon::frame::DepthFrame;
use capture_daemon::recording::{self, OpenOptions};
use capture_daemon::synth::{self, Clip, ClipParams, Family, Format, Scene};
use serde_json::Value;

/// A clip of four seconds, small.
fn clip() -> Clip {
    let params = ClipParams { width: 48, height: 36, frames: 40, fps: 10.0, ..ClipParams::default() };
    Clip::new(Scene::new(Family::Row, 1), params).expect("the parameters are in range")
}

/// It as a recording, and the same compressed in another way, chunk by chunk.
fn recording_of(folder: &Path, compression: Option<mcap::Compression>) -> Vec<u8> {
    let path = synth::write(folder, &clip(), Format::Mcap, 0).expect("written");
    let bytes = fs::read(path).expect("readable");
    let options = mcap::WriteOptions::new().profile("ros2").compression(compression);
    let mut output = options.create(std::io::Cursor::new(Vec::new())).expect("in memory");
    for (index, message) in mcap::MessageStream::new(&bytes).expect("an MCAP file").enumerate() {
        // Two messages a frame, ten frames a chunk.
        if index % 20 == 0 {
            output.flush().expect("in memory");
        }
        output.write(&message.expect("a message")).expect("in memory");
    }
    output.finish().expect("in memory");
    output.into_inner().into_inner()
}

const COMPRESSIONS: [Option<mcap::Compression>; 3] =
    [None, Some(mcap::Compression::Zstd), Some(mcap::Compression::Lz4)];

/// First byte and length of each chunk record.
fn chunks(bytes: &[u8]) -> Vec<(usize, usize)> {
    let (mut found, mut at) = (Vec::new(), 8);
    while at + 9 <= bytes.len() {
        let len = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().expect("eight bytes")) as usize;
        if bytes[at] == 6 {
            found.push((at, 9 + len));
        }
        at += 9 + len;
    }
    found
}

fn read(path: &Path) -> Result<(Vec<DepthFrame>, Vec<String>), String> {
    reading::to_its_end(path, &OpenOptions::default())
}

/// Damages a recording of four chunks and asserts which of its frames are read, and how many places
/// are reported as damaged.
#[track_caller]
fn check(
    compression: Option<mcap::Compression>,
    damage: impl Fn(&mut Vec<u8>, &[(usize, usize)]),
    expected: impl IntoIterator<Item = usize>,
    reported: &[&str],
) {
    let folder = tempfile::tempdir().expect("a folder");
    let mut bytes = recording_of(folder.path(), compression);
    let chunks = chunks(&bytes);
    assert_eq!(chunks.len(), 4);
    damage(&mut bytes, &chunks);
    let path = folder.path().join("damaged.mcap");
    fs::write(&path, bytes).expect("written");
    let (frames, skipped) = read(&path).expect("a recording");
    let all: Vec<DepthFrame> = clip().frames().collect();
    let expected: Vec<DepthFrame> = expected.into_iter().map(|frame| all[frame].clone()).collect();
    let times = |frames: &[DepthFrame]| frames.iter().map(|frame| frame.timestamp_ns).collect::<Vec<_>>();
    assert_eq!(times(&frames), times(&expected), "{compression:?}");
    assert_eq!(frames, expected, "{compression:?}");
    assert_eq!(skipped.len(), reported.len(), "{skipped:?}");
    for (why, reported) in skipped.iter().zip(reported) {
        assert!(why.contains(reported), "{why}");
    }
}

#[test]
fn a_chunk_with_a_wrong_byte_is_left_out() {
    for compression in COMPRESSIONS {
        let flip = |bytes: &mut Vec<u8>, chunks: &[(usize, usize)]| {
            bytes[chunks[1].0 + chunks[1].1 * 2 / 3] ^= 0x10;
        };
        check(compression, flip, (0..10).chain(20..40), &["the chunk at byte"]);
    }
}

#[test]
fn a_first_chunk_that_is_damaged_takes_no_topics_with_it() {
    for compression in COMPRESSIONS {
        let flip = |bytes: &mut Vec<u8>, chunks: &[(usize, usize)]| {
            bytes[chunks[0].0 + chunks[0].1 * 2 / 3] ^= 0x10;
        };
        check(compression, flip, 10..40, &["the chunk at byte"]);
    }
}

#[test]
fn a_chunk_with_a_wrong_checksum_is_left_out() {
    for compression in COMPRESSIONS {
        // Behind the framing, two times and the size.
        let flip = |bytes: &mut Vec<u8>, chunks: &[(usize, usize)]| bytes[chunks[2].0 + 9 + 24] ^= 1;
        check(compression, flip, (0..20).chain(30..40), &["damaged"]);
        // Without one, it is as good as right.
        let none = |bytes: &mut Vec<u8>, chunks: &[(usize, usize)]| {
            bytes[chunks[2].0 + 9 + 24..][..4].fill(0);
        };
        check(compression, none, 0..40, &[]);
    }
}

#[test]
fn absurd_lengths_cost_their_own_chunk() {
    for compression in COMPRESSIONS {
        for length in [u64::MAX, 1 << 40, 1 << 62] {
            let framing = |bytes: &mut Vec<u8>, chunks: &[(usize, usize)]| {
                bytes[chunks[1].0 + 1..][..8].copy_from_slice(&length.to_le_bytes());
            };
            check(compression, framing, (0..10).chain(20..40), &["the chunk at byte"]);
            let name_len = compression
                .map_or(0, |compression| if matches!(compression, mcap::Compression::Lz4) { 3 } else { 4 });
            let data = |bytes: &mut Vec<u8>, chunks: &[(usize, usize)]| {
                bytes[chunks[1].0 + 9 + 32 + name_len..][..8].copy_from_slice(&length.to_le_bytes());
            };
            check(compression, data, (0..10).chain(20..40), &["its data reach beyond it"]);
        }
        let name = |bytes: &mut Vec<u8>, chunks: &[(usize, usize)]| {
            bytes[chunks[1].0 + 9 + 28..][..4].fill(0xff);
        };
        check(compression, name, (0..10).chain(20..40), &["its header does not fit"]);
    }
    // The size without compression is believed only as far as there are bytes.
    for compression in [mcap::Compression::Zstd, mcap::Compression::Lz4] {
        for size in [1_u64 << 25, 1 << 40, u64::MAX] {
            let size = |bytes: &mut Vec<u8>, chunks: &[(usize, usize)]| {
                bytes[chunks[1].0 + 9 + 16..][..8].copy_from_slice(&size.to_le_bytes());
            };
            let folder = tempfile::tempdir().expect("a folder");
            let mut bytes = recording_of(folder.path(), Some(compression));
            let chunks = chunks(&bytes);
            size(&mut bytes, &chunks);
            let path = folder.path().join("damaged.mcap");
            fs::write(&path, bytes).expect("written");
            let (frames, skipped) = read(&path).expect("a recording");
            assert!(frames.len() >= 30 && skipped.len() == 1, "{} frames, {skipped:?}", frames.len());
        }
    }
}

#[test]
fn a_record_whose_kind_is_lost_costs_what_is_up_to_the_next_chunk() {
    for compression in COMPRESSIONS {
        let zero = |bytes: &mut Vec<u8>, chunks: &[(usize, usize)]| bytes[chunks[1].0] = 0;
        check(compression, zero, (0..10).chain(20..40), &["the record at byte"]);
    }
}

#[test]
fn zeros_that_a_power_failure_leaves_are_the_end() {
    for compression in COMPRESSIONS {
        // Between two records, and where the next one would be.
        let at_a_record = |bytes: &mut Vec<u8>, chunks: &[(usize, usize)]| bytes[chunks[2].0..].fill(0);
        check(compression, at_a_record, 0..20, &[]);
    }
    // Within a chunk, what is before them is read.
    let folder = tempfile::tempdir().expect("a folder");
    let params = ClipParams { width: 320, height: 240, frames: 12, ..ClipParams::default() };
    let clip = Clip::new(Scene::new(Family::Row, 1), params).expect("the parameters are in range");
    let path = synth::write(folder.path(), &clip, Format::Mcap, 0).expect("written");
    let mut bytes = fs::read(&path).expect("readable");
    // The first chunk has the topics alone.
    let chunk = chunks(&bytes)[1];
    bytes.truncate(chunk.0 + chunk.1 + 4096);
    bytes[chunk.0 + chunk.1 / 2..].fill(0);
    fs::write(&path, bytes).expect("written");
    let (frames, skipped) = read(&path).expect("a recording");
    assert!((3..7).contains(&frames.len()), "{} frames", frames.len());
    assert_eq!(frames, clip.frames().take(frames.len()).collect::<Vec<_>>());
    assert_eq!(skipped, Vec::<String>::new());
}

#[test]
fn a_summary_that_lies_is_not_believed() {
    for compression in COMPRESSIONS {
        // The name of the depth topic, in the summary alone.
        let rename = |bytes: &mut Vec<u8>, chunks: &[(usize, usize)]| {
            let behind = chunks[3].0 + chunks[3].1;
            let name = recording::IMAGE_TOPIC.as_bytes();
            let at = bytes[behind..].windows(name.len()).position(|window| window == name);
            bytes[behind + at.expect("the summary repeats channels") + 3] ^= 1;
        };
        check(compression, rename, 0..40, &[]);
    }
}

fn sward_capture(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sward-capture"));
    command.args(arguments).env("SWARD_LOG", "info").output().expect("the program runs")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

fn lines(bytes: &[u8]) -> Vec<String> {
    String::from_utf8_lossy(bytes).lines().map(str::to_owned).collect()
}

/// Where to cut a recording, of its bytes and its chunks.
type Cut = fn(&[u8], &[(usize, usize)]) -> usize;

/// The recording cut short.
fn cut(folder: &Path, len: Cut) -> PathBuf {
    let bytes = recording_of(folder, Some(mcap::Compression::Zstd));
    let path = folder.join("cut.mcap");
    fs::write(&path, &bytes[..len(&bytes, &chunks(&bytes))]).expect("written");
    path
}

#[test]
fn replay_warns_once_of_a_recording_that_is_cut() {
    let folder = tempfile::tempdir().expect("a folder");
    let lengths: [Cut; 5] = [
        |bytes, _| bytes.len() - 1,
        |_, chunks| chunks[3].0,
        |_, chunks| chunks[2].0 + 5,
        |_, chunks| chunks[2].0 + chunks[2].1 / 2,
        |_, chunks| chunks[1].0 + chunks[1].1 + 40,
    ];
    for len in lengths {
        let path = cut(folder.path(), len);
        let output = sward_capture(&["replay", text(&path), "--json"]);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let warnings = lines(&output.stderr);
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        assert!(warnings[0].contains("cut short"), "{warnings:?}");
        let end: Value = serde_json::from_str(lines(&output.stdout).last().expect("a line")).expect("JSON");
        assert_eq!((end["event"].as_str(), end["skipped_frames"].as_u64()), (Some("end"), Some(0)));
    }
    // Within the first chunk's header nothing is left.
    let output = sward_capture(&["replay", text(&cut(folder.path(), |_, chunks| chunks[0].0 + 5)), "--json"]);
    assert_eq!((output.status.code(), lines(&output.stderr).len()), (Some(3), 1), "{output:?}");
}

#[test]
fn of_a_file_that_is_cut_before_its_first_image_every_verb_says_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let lengths: [Cut; 4] = [
        |_, _| 8,
        |_, _| 20,
        |_, chunks| chunks[0].0 + 5,
        // Topics and intrinsics are there.
        |_, chunks| chunks[0].0 + 9 + 40 + 700,
    ];
    for len in lengths {
        let path = cut(folder.path(), len);
        let out = folder.path().join("out.mcap");
        for verb in
            [&["info", text(&path)][..], &["replay", text(&path)], &["recover", text(&path), text(&out)]]
        {
            let output = sward_capture(verb);
            let said = lines(&output.stderr).join("\n");
            assert_eq!(output.status.code(), Some(3), "{said}");
            for expected in ["not one frame can be read", "cut short", "before its first image"] {
                assert!(
                    said.contains(expected),
                    "{verb:?} of {} bytes: {said}",
                    fs::metadata(&path).expect("there").len()
                );
            }
        }
        assert!(!out.exists());
    }
}

#[test]
fn of_frames_that_are_skipped_the_first_is_named_with_its_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    let pictures = synth::write(folder.path(), &clip(), Format::Png, 0).expect("written");
    fs::write(pictures.join("a_note.png"), "no picture").expect("written");
    fs::write(pictures.join("b_note.png"), "none either").expect("written");
    let output = sward_capture(&["replay", text(&pictures)]);
    let warnings = lines(&output.stderr);
    assert_eq!((output.status.code(), warnings.len()), (Some(0), 1), "{warnings:?}");
    assert!(warnings[0].contains("skipped=2") && warnings[0].contains("a_note.png"), "{warnings:?}");
    assert!(warnings[0].contains("not a whole PNG"), "{warnings:?}");
    let last = lines(&output.stdout).pop().expect("a line");
    assert!(last.starts_with("40 frames, ") && last.ends_with(", 2 frames skipped"), "{last}");
}

#[test]
fn a_region_beyond_the_images_is_told_of_with_their_size() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = synth::write(folder.path(), &clip(), Format::Mcap, 0).expect("written");
    let output = sward_capture(&["replay", text(&path), "--set", "mask.roi=[60, 90, 380, 325]"]);
    let warnings = lines(&output.stderr);
    assert_eq!((output.status.code(), warnings.len()), (Some(0), 1), "{warnings:?}");
    for expected in ["48x36", "mask.roi = [60, 90, 380, 325]", "nothing is seen"] {
        assert!(warnings[0].contains(expected), "{warnings:?}");
    }
}

#[test]
fn recover_rewrites_a_cut_recording_and_never_overwrites() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = cut(folder.path(), |_, chunks| chunks[2].0 + chunks[2].1 / 2);
    let before = fs::read(&path).expect("readable");
    let (frames, _) = read(&path).expect("a recording");
    assert!((20..30).contains(&frames.len()));

    let mended = folder.path().join("mended.mcap");
    let output = sward_capture(&["recover", text(&path), text(&mended)]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert_eq!(lines(&output.stderr).len(), 1, "one warning: {output:?}");
    assert_eq!(fs::read(&path).expect("readable"), before, "the input is only read");
    assert_eq!(read(&mended), Ok((frames, Vec::new())));
    let replayed = sward_capture(&["replay", text(&mended)]);
    assert_eq!((replayed.status.code(), lines(&replayed.stderr)), (Some(0), Vec::new()));
    let bytes = fs::read(&mended).expect("readable");
    let summary = mcap::Summary::read(&bytes).expect("a summary").expect("a summary");
    assert!(summary.chunk_indexes.len() >= 2);
    for chunk in &summary.chunk_indexes {
        assert_eq!(chunk.compression, "zstd");
        assert!(chunk.message_end_time - chunk.message_start_time < 1_000_000_000);
    }

    // Neither what is there, nor itself.
    for (from, to) in [(&path, &mended), (&path, &path)] {
        let output = sward_capture(&["recover", text(from), text(to)]);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        assert!(lines(&output.stderr)[0].contains("exists already"), "{output:?}");
    }
    assert_eq!(fs::read(&mended).expect("readable"), bytes);
    assert_eq!(fs::read(&path).expect("readable"), before);
}

#[test]
fn recover_leaves_nothing_behind_where_there_is_nothing_to_recover() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = cut(folder.path(), |_, chunks| chunks[0].0 + 5);
    let names = || {
        let entries = fs::read_dir(folder.path()).expect("readable");
        entries.map(|entry| entry.expect("readable").file_name()).collect::<std::collections::BTreeSet<_>>()
    };
    let before = names();
    let mended = folder.path().join("mended.mcap");
    for (from, code) in [(path, 3), (folder.path().join("lost.mcap"), 3)] {
        let output = sward_capture(&["recover", text(&from), text(&mended)]);
        assert_eq!(output.status.code(), Some(code), "{output:?}");
        assert_eq!(lines(&output.stderr).len(), 1, "{output:?}");
    }
    let nowhere = folder.path().join("no/such/folder.mcap");
    let whole = synth::write(&folder.path().join("synth"), &clip(), Format::Mcap, 0).expect("written");
    let output = sward_capture(&["recover", text(&whole), text(&nowhere)]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    fs::remove_dir_all(folder.path().join("synth")).expect("removed");
    assert_eq!(names(), before);
}

#[test]
fn recover_keeps_the_metadata_and_the_topics_of_a_damaged_first_chunk() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = synth::write(folder.path(), &clip(), Format::Mcap, 0).expect("written");
    let mut bytes = fs::read(&path).expect("readable");
    let first = chunks(&bytes)[0];
    bytes[first.0 + first.1 / 2] ^= 0x40;
    fs::write(&path, bytes).expect("written");
    let mended = folder.path().join("mended.mcap");
    let recovered = recording::recover(&path, &mended).expect("recovered");
    // Our own writer begins with a chunk of topics alone.
    assert_eq!((recovered.images, recovered.messages, recovered.damaged_places), (40, 80, 1));
    let info = recording::info(&mended, &OpenOptions::default()).expect("a recording");
    assert_eq!((info.frames, info.skipped_frames, info.damage.len()), (40, 0, 0));
    assert_eq!(info.metadata["sward"]["sensor"], "Sward synthetic sensor");
    let config: capture_daemon::config::Config =
        toml::from_str(&info.metadata["sward"]["config"]).expect("a configuration");
    assert_eq!(config, capture_daemon::config::Config::default());
}

#[test]
fn info_tells_what_a_recording_holds() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = synth::write(folder.path(), &clip(), Format::Mcap, 0).expect("written");
    let output = sward_capture(&["info", text(&path), "--json"]);
    assert_eq!((output.status.code(), lines(&output.stderr)), (Some(0), Vec::new()));
    let info: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!((info["format"].as_str(), info["frames"].as_u64()), (Some("mcap"), Some(40)));
    assert_eq!(info["image_topic"], recording::IMAGE_TOPIC);
    assert_eq!((info["width"].as_u64(), info["height"].as_u64()), (Some(48), Some(36)));
    assert_eq!(info["depth_unit_m"].as_f64(), Some(0.001));
    assert_eq!(info["distortion"]["coefficients"], serde_json::json!([]));
    assert!((info["duration_s"].as_f64().expect("a number") - 3.9).abs() < 1e-6, "{info}");
    assert!((info["rate_hz"].as_f64().expect("a number") - 10.0).abs() < 1e-6, "{info}");
    assert_eq!(info["camera"]["fx"].as_f64(), Some(clip().params().camera().fx));
    let topics = info["topics"].as_array().expect("a list");
    assert_eq!(topics.len(), 2);
    assert!(topics.iter().all(|topic| topic["messages"] == 40), "{info}");
    assert_eq!(info["metadata"]["sward"]["depth_unit_m"], "0.001");
    assert_eq!(info["damage"], serde_json::json!([]));

    let torn = cut(folder.path(), |_, chunks| chunks[3].0 + 20);
    let info = recording::info(&torn, &OpenOptions::default()).expect("a recording");
    assert_eq!((info.frames, info.damage.len()), (30, 1));
    let said = info.to_string();
    assert!(said.contains("30, and 0 skipped") && said.contains("it ends within a record"), "{said}");

    let pictures = synth::write(folder.path(), &clip(), Format::Png, 0).expect("written");
    let info = recording::info(&pictures, &OpenOptions::default()).expect("a recording");
    assert_eq!((info.frames, info.topics.len(), info.to_json()["format"].as_str()), (40, 0, Some("png")));
    let output = sward_capture(&["info", text(&folder.path().join("lost.mcap"))]);
    assert_eq!((output.status.code(), lines(&output.stderr).len()), (Some(3), 1));
}
