//! Damage within files without chunks: what is behind it is read.

mod reading;

use std::io::Cursor;
use std::ops::Range;

use capture_daemon::frame::DepthFrame;
use capture_daemon::recording::{self, McapWriter, OpenOptions, RecordingParams};
use capture_daemon::synth::{Clip, ClipParams, Family, Scene};

const MESSAGE: u8 = 5;

fn clip() -> Clip {
    let params = ClipParams { width: 48, height: 36, frames: 24, ..ClipParams::default() };
    Clip::new(Scene::new(Family::Row, 1), params).expect("the parameters are in range")
}

/// A recording of some frames without chunks, with a summary or without.
fn recording_of(frames: &[DepthFrame], summary: bool) -> Vec<u8> {
    let mut writer = McapWriter::new(Cursor::new(Vec::new()), RecordingParams::default()).expect("in memory");
    frames.iter().for_each(|frame| writer.write(frame).expect("in memory"));
    let bytes = writer.finish().expect("in memory").into_inner();
    let options = mcap::WriteOptions::new().profile("ros2").use_chunks(false).emit_summary_records(summary);
    let mut output = options.create(Cursor::new(Vec::new())).expect("in memory");
    for message in mcap::MessageStream::new(&bytes).expect("an MCAP file") {
        output.write(&message.expect("a message")).expect("in memory");
    }
    output.finish().expect("in memory");
    output.into_inner().into_inner()
}

/// First byte of each record, and behind it.
fn records(bytes: &[u8], kind: u8) -> Vec<Range<usize>> {
    let (mut found, mut at) = (Vec::new(), 8);
    while at + 9 <= bytes.len() - 8 {
        let len = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().expect("eight bytes")) as usize;
        if bytes[at] == kind {
            found.push(at..at + 9 + len);
        }
        at += 9 + len;
    }
    found
}

fn read(bytes: &[u8]) -> Result<(Vec<DepthFrame>, Vec<String>), String> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("it.mcap");
    std::fs::write(&path, bytes).expect("written");
    reading::to_its_end(&path, &OpenOptions::default())
}

/// Damages a recording and asserts that all frames but these are read, bit for bit, and how many places
/// are reported.
#[track_caller]
fn check(summary: bool, damage: impl Fn(&mut Vec<u8>, &[Range<usize>]), lost: Range<usize>, reported: usize) {
    let all: Vec<DepthFrame> = clip().frames().collect();
    let mut bytes = recording_of(&all, summary);
    let messages = records(&bytes, MESSAGE);
    assert_eq!(messages.len(), 2 * all.len(), "the intrinsics and the image of each frame");
    damage(&mut bytes, &messages);
    let (frames, skipped) = read(&bytes).expect("a recording");
    let expected: Vec<&DepthFrame> =
        all.iter().enumerate().filter(|(i, _)| !lost.contains(i)).map(|(_, frame)| frame).collect();
    let times = |frames: &[&DepthFrame]| frames.iter().map(|frame| frame.timestamp_ns).collect::<Vec<_>>();
    let frames: Vec<&DepthFrame> = frames.iter().collect();
    assert_eq!(times(&frames), times(&expected), "{skipped:?}");
    assert_eq!(frames, expected);
    assert_eq!(skipped.len(), reported, "{skipped:?}");
}

/// The image of frame `i` among the messages.
fn image(messages: &[Range<usize>], i: usize) -> Range<usize> {
    messages[2 * i + 1].clone()
}

fn set_len(bytes: &mut [u8], record: usize, len: u64) {
    bytes[record + 1..record + 9].copy_from_slice(&len.to_le_bytes());
}

#[test]
fn a_kind_that_is_lost_costs_one_message() {
    for summary in [true, false] {
        // The end of the data, the footer, a chunk, and kinds that no version of MCAP has.
        for kind in [0, 0x0f, 2, 6, 0x10, 0x80, 0xff] {
            let lose = |bytes: &mut Vec<u8>, messages: &[Range<usize>]| {
                bytes[image(messages, 7).start] = kind;
            };
            // Kinds that are not known are no error: their record is passed over.
            check(summary, lose, 7..8, usize::from(kind < 0x10));
        }
    }
}

#[test]
fn a_wrong_length_costs_one_message() {
    for summary in [true, false] {
        for len in [u64::MAX, 1 << 62, 1 << 40, 1 << 26] {
            let enlarge = |bytes: &mut Vec<u8>, messages: &[Range<usize>]| {
                set_len(bytes, image(messages, 7).start, len);
            };
            check(summary, enlarge, 7..8, 1);
        }
        // It ends within another one, or within itself.
        for other in [1, 100, 4000, 20_000] {
            let enlarge = |bytes: &mut Vec<u8>, messages: &[Range<usize>]| {
                let image = image(messages, 7);
                set_len(bytes, image.start, image.len() as u64 - 9 + other);
            };
            check(summary, enlarge, 7..8, 1);
        }
        for len in [0, 21, 22, 100, 3000] {
            let cut = |bytes: &mut Vec<u8>, messages: &[Range<usize>]| {
                set_len(bytes, image(messages, 7).start, len);
            };
            // The message that is too short cannot be used, nor what comes where it seems to end.
            check(summary, cut, 7..8, 2);
        }
    }
}

#[test]
fn overwritten_bytes_cost_the_frames_that_they_lie_in() {
    let all: Vec<DepthFrame> = clip().frames().collect();
    let whole = recording_of(&all, true);
    let messages = records(&whole, MESSAGE);
    let data = messages[1].end..messages[messages.len() - 1].end;
    for (fill, len) in [(0xff, 16), (0x00, 100), (0xa5, 64), (0x05, 300), (0xff, 9000)] {
        for at in data.clone().step_by(1009).filter(|at| at + len < data.end) {
            let mut bytes = whole.clone();
            bytes[at..at + len].fill(fill);
            let (frames, _) = read(&bytes).expect("a recording");
            let touched =
                |i: &usize| messages[2 * i..2 * i + 2].iter().any(|it| it.start < at + len && at < it.end);
            for i in (0..all.len()).filter(|i| !touched(i)) {
                assert!(frames.contains(&all[i]), "frame {i}, {len} bytes {fill:#x} at byte {at}");
            }
            assert!(frames.len() <= all.len());
        }
    }
}

#[test]
fn damaged_topics_are_found_again_where_they_can_be() {
    let all: Vec<DepthFrame> = clip().frames().collect();
    // Header, schema and channel come first: with any of them gone, the summary says it again.
    let whole = recording_of(&all, true);
    for kind in [1, 3, 4] {
        for record in records(&whole, kind) {
            if record.start < records(&whole, MESSAGE)[2].start {
                let mut bytes = whole.clone();
                bytes[record.start..record.start + 9].fill(0);
                let (frames, skipped) = read(&bytes).expect("a recording");
                assert_eq!((frames.as_slice(), skipped.len()), (all.as_slice(), 1), "{kind} {skipped:?}");
            }
        }
    }
    // Without a summary the header alone can be spared.
    let whole = recording_of(&all, false);
    let mut bytes = whole.clone();
    bytes[8..17].fill(0xee);
    let (frames, skipped) = read(&bytes).expect("a recording");
    assert_eq!((frames, skipped.len()), (all, 1));
}

#[test]
fn recover_takes_what_is_behind_damage() {
    let folder = tempfile::tempdir().expect("a folder");
    let all: Vec<DepthFrame> = clip().frames().collect();
    for summary in [true, false] {
        let mut bytes = recording_of(&all, summary);
        let messages = records(&bytes, MESSAGE);
        for i in [3, 10] {
            let start = image(&messages, i).start;
            bytes[start..start + 9].fill(0xff);
        }
        bytes.truncate(image(&messages, 20).start + 100);
        let path = folder.path().join("damaged.mcap");
        std::fs::write(&path, &bytes).expect("written");
        let info = recording::info(&path, &OpenOptions::default()).expect("a recording");
        assert_eq!((info.frames, info.skipped_frames, info.damage.len()), (18, 2, 3), "{:?}", info.damage);
        let mended = folder.path().join(format!("mended-{summary}.mcap"));
        let recovered = recording::recover(&path, &mended).expect("recovered");
        assert_eq!((recovered.images, recovered.messages, recovered.damaged_places), (18, 39, 3));
        let kept = [&all[..3], &all[4..10], &all[11..20]].concat();
        assert_eq!(read(&std::fs::read(&mended).expect("readable")), Ok((kept, Vec::new())));
    }
}
