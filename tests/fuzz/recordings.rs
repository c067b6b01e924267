//! MCAP files with damage: in the framing, in chunks, in the summary.

use std::fs;
use std::path::Path;

use capture_daemon::frame::{CameraModel, DepthFrame, MAX_PIXELS};
use capture_daemon::recording::{self, Distortion, GivenCamera, OpenOptions};
use capture_daemon::source::SourceError;

use tests::random::Random;

use crate::mutate::change;
use crate::seeds::RECORDINGS;

/// Offsets of the numbers in the framing of a file's records and in the headers of its chunks.
fn fields(bytes: &[u8]) -> Vec<usize> {
    let (mut fields, mut at) = (Vec::new(), 8);
    while at + 9 <= bytes.len() {
        fields.extend([at, at + 1]);
        let len = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().expect("eight bytes"));
        match bytes[at] {
            // Times, size, checksum, length of the name, the name, length of the data.
            0x06 => fields.extend([9, 17, 25, 33, 37, 41, 44, 45].map(|offset| at + offset)),
            // Ids, lengths of names, times.
            0x03..=0x05 => fields.extend([9, 11, 13, 15, 19].map(|offset| at + offset)),
            // Places, counts and lengths of the summary.
            _ => fields.extend((0..len.min(64) as usize).step_by(4).map(|offset| at + 9 + offset)),
        }
        let Some(next) = usize::try_from(len).ok().and_then(|len| (at + 9).checked_add(len)) else { break };
        at = next;
    }
    fields.retain(|&field| field < bytes.len());
    fields
}

/// Makes the checksums of all chunks unknown, so that their damage is not found by these.
fn forget_checksums(bytes: &mut [u8]) {
    let mut at = 8;
    while at + 37 <= bytes.len() {
        let len = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().expect("eight bytes"));
        if bytes[at] == 0x06 {
            bytes[at + 33..at + 37].fill(0);
        }
        let Some(next) = usize::try_from(len).ok().and_then(|len| (at + 9).checked_add(len)) else { break };
        at = next;
    }
}

pub(crate) fn case(random: &mut Random, folder: &Path) {
    let mut bytes = random.pick(&RECORDINGS).clone();
    if random.once_in(2) {
        forget_checksums(&mut bytes);
    }
    let fields = fields(&bytes);
    for _ in 0..1 + random.below(4) {
        change(&mut bytes, &fields, random);
    }
    if random.once_in(16) {
        let other = random.pick(&RECORDINGS);
        let (mine, theirs) = (random.below(bytes.len().max(1)), random.below(other.len()));
        bytes.truncate(mine);
        bytes.extend(&other[theirs..]);
    }
    let path = folder.join("damaged.mcap");
    fs::write(&path, &bytes).expect("a temporary file");
    examine(&path, random, folder);
}

/// Opens what is at a path in every way there is, and checks what must hold of what comes out.
pub(crate) fn examine(path: &Path, random: &mut Random, folder: &Path) {
    let camera = CameraModel { fx: 20.0, fy: 20.0, cx: 8.0, cy: 8.0 };
    let given = GivenCamera { camera, distortion: Distortion::default() };
    let camera = random.once_in(2).then_some(given);
    let options = OpenOptions { camera, ..OpenOptions::default() };
    let read = read(path, &options);
    if let Ok((frames, _)) = &read {
        assert!(!frames.is_empty(), "what opens has a frame");
    }
    if random.once_in(4) {
        match (&read, recording::info(path, &options)) {
            (Ok((frames, _)), Ok(info)) => assert_eq!(info.frames, frames.len() as u64),
            (read, info) => {
                assert_eq!(read.as_ref().err(), info.err().map(|error| error.to_string()).as_ref())
            }
        }
    }
    if random.once_in(4) {
        let mended = folder.join("mended.mcap");
        if mended.exists() {
            fs::remove_file(&mended).expect("it is ours");
        }
        let recovered = recording::recover(path, &mended);
        assert_eq!(recovered.is_ok(), mended.exists());
        if recovered.is_ok() {
            let (_, damage) = self::read(&mended, &options).unwrap_or_default();
            let of_file = |why: &String| why.contains("at byte");
            assert!(!damage.iter().any(of_file), "what is recovered is whole: {damage:?}");
            let bytes = fs::read(&mended).expect("readable");
            let summary = mcap::Summary::read(&bytes).expect("others read it").expect("it has a summary");
            assert!(summary.stats.is_some_and(|stats| stats.message_count > 0));
        }
    }
}

/// All frames, each of them checked, and the reasons for those skipped; or why it is refused.
fn read(path: &Path, options: &OpenOptions) -> Result<(Vec<DepthFrame>, Vec<String>), String> {
    let mut source = recording::open(path, options).map_err(|error| error.to_string())?;
    let (mut frames, mut skipped) = (Vec::new(), Vec::new());
    loop {
        match source.next_frame() {
            Ok(frame) => {
                assert_eq!(frame.depth.len(), frame.width * frame.height);
                assert!((1..=MAX_PIXELS).contains(&frame.depth.len()) && frame.camera.is_valid());
                assert!((1e-6..=0.1).contains(&frame.depth_unit_m));
                frames.push(frame);
            }
            Err(SourceError::BadFrame(why)) => skipped.push(why),
            Err(SourceError::Told(_)) => {}
            Err(SourceError::End) => break,
            Err(SourceError::Failed(why) | SourceError::Interrupted(why)) => {
                panic!("a file that is not touched can be read: {why}")
            }
        }
    }
    assert_eq!(source.next_frame(), Err(SourceError::End), "the end is the end");
    for why in &skipped {
        assert!(!why.contains('\n') && why.len() < 4096, "one sentence: {why}");
    }
    Ok((frames, skipped))
}
