//! Recordings that were cut off. The library plays one that was never finished, as a crash leaves it, though it does not
//! tell its end; but it refuses one that was finished and cut off after that, since the table that its head points to is
//! not there, and it may stumble over a record that is torn. Such a file is copied up to its last whole record, with a
//! head that says what one says that was never finished.
//!
//! A record is 28 bytes (magic, type, node, bytes of the fields with these 28, bytes of the payload, 4 each, and a
//! position of 8), its fields, its payload. The fields of the one that adds a node begin with the length of its name (4
//! bytes), its name and its type (4), and end with the number of its frames (4), their first and last time and the
//! position of the table (8 each). All little-endian.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

use tempfile::TempPath;

/// Bytes of the file's head.
const FILE_HEAD: u64 = 24;
/// Each record begins with it.
const RECORD_MAGIC: u32 = 0x0052_494E;
/// Bytes of a record before its fields.
const RECORD_HEAD: usize = 28;
/// The record that adds a node.
const NODE_ADDED: u32 = 0x0D;
/// The record of a frame.
const NEW_DATA: u32 = 0x0A;
/// The type of a node that gives depth.
const DEPTH: u32 = 2;
/// A name is no longer than this.
const MAX_NAME: u64 = 1 << 10;
/// The last record.
const END: u32 = 0x0B;
/// Bytes at the end of the fields of [`NODE_ADDED`] that are known at the end alone.
const LATE_BYTES: u64 = 28;
/// What stands there before: so many frames, from the first instant to the last, and no table.
const UNKNOWN: [u8; LATE_BYTES as usize] = {
    let mut bytes = [0; LATE_BYTES as usize];
    let mut at = 0;
    while at < 20 {
        // But for the first time, which is 0.
        if at < 4 || at >= 12 {
            bytes[at] = 0xFF;
        }
        at += 1;
    }
    bytes
};

/// A record's head.
struct Head {
    kind: u32,
    node: u32,
    fields_bytes: u64,
    payload_bytes: u64,
}

fn head_at(file: &File, position: u64) -> io::Result<Option<Head>> {
    let mut bytes = [0; RECORD_HEAD];
    match file.read_exact_at(&mut bytes, position) {
        Ok(()) => {}
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
        Err(error) => return Err(error),
    }
    let number = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let (kind, node, fields_bytes, payload_bytes) =
        (number(4), number(8), number(12).into(), number(16).into());
    let is_record = number(0) == RECORD_MAGIC && fields_bytes >= RECORD_HEAD as u64;
    Ok(is_record.then_some(Head { kind, node, fields_bytes, payload_bytes }))
}

/// What is whole of a file that was cut off.
#[derive(Debug, PartialEq, Eq)]
struct Survey {
    /// Bytes up to the end of the last whole record.
    whole_bytes: u64,
    /// Where the late bytes of each node stand.
    late_at: Vec<u64>,
    /// Frames of depth.
    frames: u64,
    /// It has to be copied to be played.
    is_copied: bool,
}

/// The type of the node that a record adds.
fn node_type(file: &File, position: u64) -> io::Result<Option<u32>> {
    let fields_at = position + RECORD_HEAD as u64;
    let number = |at| -> io::Result<u32> {
        let mut bytes = [0; 4];
        file.read_exact_at(&mut bytes, at)?;
        Ok(u32::from_le_bytes(bytes))
    };
    let name_bytes = u64::from(number(fields_at)?);
    if name_bytes > MAX_NAME {
        return Ok(None);
    }
    match number(fields_at + 4 + name_bytes) {
        Ok(kind) => Ok(Some(kind)),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
        Err(error) => Err(error),
    }
}

/// Looks at a file: nothing is to be done with one that has its end. O(records).
fn survey(file: &File) -> io::Result<Option<Survey>> {
    let bytes = file.metadata()?.len();
    let last = bytes.checked_sub(RECORD_HEAD as u64).filter(|last| *last >= FILE_HEAD);
    let has_end = match last {
        Some(last) => head_at(file, last)?.is_some_and(|head| head.kind == END),
        None => false,
    };
    if has_end {
        return Ok(None);
    }
    let mut depth_node = None;
    let mut survey =
        Survey { whole_bytes: FILE_HEAD.min(bytes), late_at: Vec::new(), frames: 0, is_copied: false };
    while let Some(head) = head_at(file, survey.whole_bytes)? {
        let next = survey.whole_bytes + head.fields_bytes + head.payload_bytes;
        if next > bytes {
            break;
        }
        if head.kind == NODE_ADDED && head.fields_bytes >= RECORD_HEAD as u64 + LATE_BYTES {
            survey.late_at.push(survey.whole_bytes + head.fields_bytes - LATE_BYTES);
            if depth_node.is_none() && node_type(file, survey.whole_bytes)? == Some(DEPTH) {
                depth_node = Some(head.node);
            }
        }
        survey.frames += u64::from(head.kind == NEW_DATA && depth_node == Some(head.node));
        survey.whole_bytes = next;
    }
    survey.is_copied = survey.whole_bytes != bytes;
    for at in &survey.late_at {
        let mut table_at = [0; 8];
        file.read_exact_at(&mut table_at, at + LATE_BYTES - 8)?;
        survey.is_copied |= table_at != [0; 8];
    }
    Ok(Some(survey))
}

/// How a file is.
pub(super) enum State {
    /// The library plays it as it is.
    Whole,
    /// It was never finished, or cut off.
    CutOff {
        /// Its whole frames of depth, at least one.
        frames: u64,
        /// What is played in its place, unless it is played as it is.
        copy: Option<TempPath>,
    },
    /// It was cut off before there was a frame.
    Hopeless,
}

/// Looks at a file, and makes a copy that the library plays where it was cut off. The copy takes as much room in the
/// folder for temporary files as the recording, unless that is on the same file system and shares its blocks.
///
/// # Errors
/// When the file cannot be read, or there is no room for the copy.
pub(super) fn state(path: &Path) -> io::Result<State> {
    let file = File::open(path)?;
    let Some(survey) = survey(&file)? else { return Ok(State::Whole) };
    if survey.frames == 0 {
        return Ok(State::Hopeless);
    }
    if !survey.is_copied {
        return Ok(State::CutOff { frames: survey.frames, copy: None });
    }
    let mut copy = tempfile::Builder::new().prefix("sward-").suffix(".oni").tempfile()?;
    let mut source = &file;
    io::copy(&mut io::Read::take(&mut source, survey.whole_bytes), copy.as_file_mut())?;
    for at in &survey.late_at {
        copy.as_file().write_all_at(&UNKNOWN, *at)?;
    }
    Ok(State::CutOff { frames: survey.frames, copy: Some(copy.into_temp_path()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(kind: u32, fields: &[u8], payload: &[u8]) -> Vec<u8> {
        let numbers = [RECORD_MAGIC, kind, 1, (RECORD_HEAD + fields.len()) as u32, payload.len() as u32];
        let mut record: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        record.extend([0; 8]);
        record.extend(fields);
        record.extend(payload);
        record
    }

    /// A node of depth with a table, three frames and an end.
    fn recording() -> Vec<u8> {
        let added = record(NODE_ADDED, &[&[2, 0, 0, 0, b'd', 0, 2, 0, 0, 0], &[7; 30][..]].concat(), &[]);
        let frames = (0..3).flat_map(|_| record(NEW_DATA, &[1; 12], &[2; 100]));
        [0; FILE_HEAD as usize].into_iter().chain(added).chain(frames).chain(record(END, &[], &[])).collect()
    }

    /// Frames, and the bytes of the copy if one is made; `None` of a file that is whole.
    fn of(bytes: &[u8]) -> Option<(u64, Vec<u8>)> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.oni");
        std::fs::write(&path, bytes).expect("room");
        match state(&path).expect("it is readable") {
            State::Whole => None,
            State::CutOff { frames, copy } => {
                Some((frames, copy.map_or_else(Vec::new, |copy| std::fs::read(copy).expect("readable"))))
            }
            State::Hopeless => Some((0, Vec::new())),
        }
    }

    #[test]
    fn what_is_whole_of_a_file_that_was_cut_off_is_copied() {
        let whole = recording();
        assert_eq!(of(&whole), None);
        let frame = RECORD_HEAD + 112;
        for (cut, frames) in [(1, 3), (28, 3), (29, 2), (100, 2), (frame + 28, 2), (frame + 29, 1)] {
            let (found, copy) = of(&whole[..whole.len() - cut]).expect("it was cut off");
            assert_eq!(found, frames, "{cut} bytes are missing");
            assert_eq!(copy.len(), 24 + 68 + frames as usize * frame, "{cut} bytes are missing");
            assert_eq!(copy[24 + 38..24 + 40], [7; 2], "what was known before stays");
            assert_eq!(copy[24 + 40..24 + 68], UNKNOWN);
            assert_eq!(copy[24 + 68..], whole[24 + 68..copy.len()]);
        }
        assert_eq!(UNKNOWN[..4], [0xFF; 4]);
        assert_eq!(UNKNOWN[4..12], [0; 8], "the first time");
        assert_eq!(UNKNOWN[12..20], [0xFF; 8]);
        assert_eq!(UNKNOWN[20..], [0; 8], "no table");
    }

    #[test]
    fn a_file_that_was_never_finished_is_left_as_it_is() {
        let mut bytes = recording();
        bytes.truncate(bytes.len() - RECORD_HEAD);
        bytes[24 + 60..24 + 68].fill(0);
        assert_eq!(of(&bytes), Some((3, Vec::new())));
        bytes.pop();
        let (frames, copy) = of(&bytes).expect("its last record is torn");
        assert_eq!((frames, copy.len()), (2, bytes.len() - (RECORD_HEAD + 111)));
        assert_eq!(of(&bytes[..24 + 68]), Some((0, Vec::new())), "there is no frame");
        assert_eq!(of(&bytes[..24 + 30]), Some((0, Vec::new())), "there is no node");
        assert_eq!(of(&[0; 5]), Some((0, Vec::new())));
    }
}
