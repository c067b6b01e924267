//! Where reading goes on behind damage.
//!
//! A chunk is told by its header alone. A record outside of chunks has neither checksum nor magic: it is
//! taken for one if its kind, its length and its first fields fit, if what lies behind it begins like a
//! record too, and, of a message, if it is on a known channel and was logged within a day of the one
//! before. Nothing is read to find out but the first bytes of either.

use std::collections::BTreeSet;
use std::io::{Error, Read, Seek, SeekFrom};

use super::chunk;
use super::record::{Fields, MAX_RECORD_LEN, op};
use super::records::FRAMING_LEN;

/// Bytes of a message before its data: channel u16, sequence u32, log and publish time u64.
const MESSAGE_LEN: u64 = 2 + 4 + 8 + 8;
/// Bytes that tell whether something begins like a record.
pub(super) const BEGINNING_LEN: u64 = FRAMING_LEN + MESSAGE_LEN;
/// Longest time between two messages of one recording, nanoseconds: a day.
const GAP_NS: u64 = 86_400 * 1_000_000_000;
/// Longest name of a schema or topic, and longest definition, that are looked for.
const MAX_NAME_LEN: u32 = 1024;
const MAX_DEFINITION_LEN: u64 = 1 << 20;
/// Longest end of the data and footer: they have 4 and 20 bytes, and fields may be added.
const MAX_ENDING_LEN: u64 = 64;
/// Bytes that are looked at first; twice as many each time that there is nothing in them.
const FIRST_BLOCK_LEN: u64 = 4 << 10;
const BLOCK_LEN: u64 = 64 << 10;
/// As long as the longest beginning that is looked at.
const OVERLAP: u64 = FRAMING_LEN + chunk::MAX_HEADER_LEN;

/// What was read so far: what is found has to agree with it.
#[derive(Clone, Debug, Default)]
pub(super) struct Seen {
    /// Whether there were chunks: then there are no messages outside of them.
    pub(super) chunks: bool,
    /// Channels that messages are on.
    pub(super) channels: BTreeSet<u16>,
    /// When the last message outside of chunks was logged, nanoseconds.
    log_time: Option<u64>,
}

impl Seen {
    /// What is found is to be a chunk.
    pub(super) fn chunks_only() -> Self {
        Self { chunks: true, ..Self::default() }
    }

    /// Takes note of a record outside of chunks, of its kind and content.
    pub(super) fn note(&mut self, opcode: u8, body: &[u8]) {
        let mut fields = Fields(body);
        match (opcode, fields.u16()) {
            (op::CHANNEL, Some(id)) => {
                self.channels.insert(id);
            }
            (op::MESSAGE, Some(_)) => {
                let (_sequence, log_time) = (fields.u32(), fields.u64());
                self.log_time = log_time.or(self.log_time);
            }
            _ => {}
        }
    }

    /// Whether a record can begin with these bytes, the first of the `room` bytes that are left of the
    /// file.
    pub(super) fn can_begin(&self, bytes: &[u8], room: u64) -> bool {
        can_begin(bytes, room, self.log_time)
    }
}

/// How sure a record outside of chunks has to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Proof {
    /// What lies behind it begins like a record.
    Next,
    /// That, or it was logged close to the message before: it is the last one before more damage.
    NextOrBefore,
}

/// Finds the first chunk, or record outside of chunks, that begins at byte `from` or behind, but before
/// byte `to`. O(bytes up to it); the input then stands anywhere.
///
/// # Errors
/// When the file cannot be read.
pub(super) fn find<R: Read + Seek>(
    input: &mut R,
    (from, to): (u64, u64),
    file_len: u64,
    seen: &Seen,
    proof: Proof,
) -> Result<Option<u64>, Error> {
    let to = to.min(file_len);
    let (mut block_at, mut block_len) = (from, FIRST_BLOCK_LEN);
    let mut block = Vec::new();
    while block_at < to {
        // A beginning may lie in this block and reach into the next.
        block.clear();
        input.seek(SeekFrom::Start(block_at))?;
        input.by_ref().take((block_len + OVERLAP).min(file_len - block_at)).read_to_end(&mut block)?;
        let passed = block_len.min(to - block_at).min(block.len() as u64) as usize;
        if passed == 0 {
            // Somebody made the file shorter since it was opened.
            break;
        }
        for (at, bytes) in (block_at..).zip((0..passed).map(|first| &block[first..])) {
            let begins = match bytes[0] {
                op::CHUNK => chunk::begins_a_chunk(bytes),
                op::SCHEMA | op::CHANNEL | op::MESSAGE if !seen.chunks => {
                    begins_a_record(input, (at, file_len), bytes, seen, proof)?
                }
                _ => false,
            };
            if begins {
                return Ok(Some(at));
            }
        }
        block_at += passed as u64;
        block_len = (2 * block_len).min(BLOCK_LEN);
    }
    Ok(None)
}

/// Whether a record outside of chunks begins with these bytes, which are those at `at`.
fn begins_a_record<R: Read + Seek>(
    input: &mut R,
    (at, file_len): (u64, u64),
    bytes: &[u8],
    seen: &Seen,
    proof: Proof,
) -> Result<bool, Error> {
    if !can_begin(bytes, file_len - at, seen.log_time) {
        return Ok(false);
    }
    let Some((opcode, len, mut fields)) = framing(bytes) else { return Ok(false) };
    let id = fields.u16();
    let (fits, log_time) = match opcode {
        op::MESSAGE => {
            let (_sequence, log_time) = (fields.u32(), fields.u64());
            (id.is_some_and(|id| seen.channels.contains(&id)), log_time)
        }
        op::SCHEMA => (id != Some(0) && begins_with_a_name(&mut fields, len), seen.log_time),
        _ => {
            let _schema = fields.u16();
            (begins_with_a_name(&mut fields, len), seen.log_time)
        }
    };
    if !fits {
        return Ok(false);
    }
    // Times close to 0, as of a simulation, are what pixels without a reading look like.
    let timed = opcode == op::MESSAGE && seen.log_time.is_some_and(|before| before > GAP_NS);
    if timed && proof == Proof::NextOrBefore {
        return Ok(true);
    }
    let end = at + FRAMING_LEN + len;
    let mut next = Vec::new();
    input.seek(SeekFrom::Start(end))?;
    input.by_ref().take(BEGINNING_LEN).read_to_end(&mut next)?;
    Ok(end == file_len || can_begin(&next, file_len - end, log_time))
}

/// Kind and length of a record, and what is behind them.
fn framing(bytes: &[u8]) -> Option<(u8, u64, Fields<'_>)> {
    let (&opcode, rest) = bytes.split_first()?;
    let mut fields = Fields(rest);
    let len = fields.u64()?;
    Some((opcode, len, fields))
}

/// Whether a record can begin with these bytes, the first of the `room` bytes that are left of the file:
/// one of a known kind that ends in the file and, of a message, is close in time to another.
fn can_begin(bytes: &[u8], room: u64, log_time: Option<u64>) -> bool {
    let Some((opcode, len, mut fields)) = framing(bytes) else { return false };
    let fits = match opcode {
        op::MESSAGE => {
            let (_channel, _sequence, time) = (fields.u16(), fields.u32(), fields.u64());
            let near = |time: u64| log_time.is_none_or(|other| time.abs_diff(other) <= GAP_NS);
            (MESSAGE_LEN..=MAX_RECORD_LEN).contains(&len) && time.is_some_and(near)
        }
        op::SCHEMA | op::CHANNEL => (1..=MAX_DEFINITION_LEN).contains(&len),
        op::DATA_END | op::FOOTER => is_ending(opcode, len),
        op::HEADER..=op::DATA_END => len > 0,
        _ => false,
    };
    fits && len.saturating_add(FRAMING_LEN) <= room
}

/// Whether an end of the data or a footer has such a length.
pub(super) fn is_ending(opcode: u8, len: u64) -> bool {
    let least = if opcode == op::FOOTER { 20 } else { 4 };
    (least..=MAX_ENDING_LEN).contains(&len)
}

/// Whether a name comes next that a record of `len` bytes has room for, as far as it can be seen.
fn begins_with_a_name(fields: &mut Fields<'_>, len: u64) -> bool {
    let Some(name_len) = fields.u32() else { return false };
    let fits = (1..=MAX_NAME_LEN).contains(&name_len) && u64::from(name_len) < len;
    fits && fields.0.iter().take(name_len as usize).all(u8::is_ascii_graphic)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    const TIME: u64 = 1_700_000_000_000_000_000;

    fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
        [&[opcode], (body.len() as u64).to_le_bytes().as_slice(), body].concat()
    }

    fn message(channel: u16, log_time: u64, data: &[u8]) -> Vec<u8> {
        let times = [log_time.to_le_bytes(), log_time.to_le_bytes()].concat();
        record(op::MESSAGE, &[&channel.to_le_bytes(), [0; 4].as_slice(), &times, data].concat())
    }

    fn seen() -> Seen {
        Seen { channels: BTreeSet::from([3]), log_time: Some(TIME), ..Seen::default() }
    }

    fn found(bytes: &[u8], seen: &Seen, proof: Proof) -> Option<u64> {
        let len = bytes.len() as u64;
        find(&mut Cursor::new(bytes), (0, len), len, seen, proof).expect("in memory")
    }

    #[test]
    fn a_message_is_found_wherever_it_begins() {
        for at in [0, 1, 77, 4 << 10, (4 << 10) - 12, (12 << 10) + 5, 200_000] {
            // Messages' kind everywhere, but no message.
            let mut bytes = vec![op::MESSAGE; at];
            bytes.extend(message(3, TIME + 5, &[9; 300]));
            bytes.extend(message(4, TIME + 6, &[9; 20]));
            assert_eq!(found(&bytes, &seen(), Proof::Next), Some(at as u64));
        }
    }

    #[test]
    fn what_is_no_message_is_passed_over() {
        let next = message(3, TIME, &[]);
        let check = |wrong: Vec<u8>| {
            let at = wrong.len() as u64;
            let bytes = [wrong.as_slice(), &next, &next].concat();
            assert_eq!(found(&bytes, &seen(), Proof::NextOrBefore), Some(at));
        };
        check(message(4, TIME, &[1; 50]));
        check(message(3, TIME + 2 * GAP_NS, &[1; 50]));
        check(message(3, 0, &[1; 50]));
        check(record(op::MESSAGE, &[0; 21]));
        check(record(op::SCHEMA, &[0; 60]));
        let mut endless = message(3, TIME, &[1; 50]);
        endless[8] = 1;
        check(endless);
    }

    #[test]
    fn the_last_message_before_more_damage_is_told_by_its_time() {
        let torn = [message(3, TIME, &[1; 50]), vec![0xff; 40]].concat();
        assert_eq!(found(&torn, &seen(), Proof::Next), None);
        assert_eq!(found(&torn, &seen(), Proof::NextOrBefore), Some(0));
        // Pixels without a reading are zeros, and so are the times of a simulation that begins.
        let simulated = Seen { log_time: Some(0), ..seen() };
        let torn = [message(3, 0, &[1; 50]), vec![0xff; 40]].concat();
        assert_eq!(found(&torn, &simulated, Proof::NextOrBefore), None);
    }

    #[test]
    fn definitions_are_found_and_nothing_outside_of_chunks_where_there_are_chunks() {
        let topic = [&[3, 0, 1, 0, 6, 0, 0, 0], b"/depth".as_slice(), &[0; 8]].concat();
        let bytes = [vec![0xff; 10], record(op::CHANNEL, &topic), message(3, TIME, &[])].concat();
        assert_eq!(found(&bytes, &Seen::default(), Proof::Next), Some(10));
        let chunked = Seen { chunks: true, ..seen() };
        assert_eq!(found(&bytes, &chunked, Proof::NextOrBefore), None);
    }
}
