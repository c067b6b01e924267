//! The records of an MCAP file, one at a time.
//!
//! The file's own framing is read here, so that no length in it is believed beyond the end of the
//! file; compressed chunks are handed to the `mcap` crate. A chunk that is whole gives its records only
//! if its checksum is right; of one that is cut off, whatever records can still be decompressed. Where
//! the framing itself is damaged, reading goes on with the next chunk or, in a file without chunks, with the
//! next record that fits what was read before.

use std::io::{ErrorKind, Read, Seek, SeekFrom};

use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::chunk::{self, ChunkHeader};
use super::record::{Fields, MAX_RECORD_LEN, Record, matters, op, parse};
use super::resume::{self, BEGINNING_LEN, Proof, Seen, is_ending};

/// The bytes that an MCAP file begins and ends with.
pub(in crate::recording) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
/// Bytes read from the file at a time.
const FEED_LEN: usize = 128 << 10;
/// A record's kind and length.
pub(super) const FRAMING_LEN: u64 = 9;
/// Footer record and closing magic.
const ENDING_LEN: u64 = FRAMING_LEN + 20 + 8;

/// Why there is no next record.
#[derive(Debug, thiserror::Error)]
pub(in crate::recording) enum RecordError {
    /// The file ends before its end.
    #[error("it is cut short: it ends within a record, at byte {0}")]
    CutShort(u64),
    /// One record or chunk cannot be read; the next call goes on behind it.
    #[error("the {what} at byte {at} is damaged ({reason})")]
    Damaged { what: &'static str, at: u64, reason: String },
    /// The file cannot be read.
    #[error("it cannot be read ({0})")]
    Io(#[from] std::io::Error),
}

/// Where the reader stands.
enum Place {
    /// Between the records of the file.
    File,
    /// Within an uncompressed chunk.
    PlainChunk(Chunk),
    /// Within a compressed chunk.
    CompressedChunk(Chunk),
    /// Behind the last record.
    End,
}

/// Where a chunk lies in the file.
#[derive(Clone, Copy)]
struct Chunk {
    /// Its record's first byte.
    start: u64,
    header: ChunkHeader,
    /// Its data's first byte.
    data_start: u64,
    /// Behind the last byte of its data.
    data_end: u64,
    /// Behind its record: the same, but for padding.
    end: u64,
    /// Its end was never written: behind what can be read of it, the file is over.
    torn: bool,
    /// A record of it was given.
    given: bool,
}

/// Reads records in the order of the file.
pub(in crate::recording) struct RecordReader<R> {
    input: R,
    /// Bytes of the file, as it was when it was opened.
    file_len: u64,
    position: u64,
    place: Place,
    chunk: LinearReader,
    buffer: Vec<u8>,
    seen: Seen,
}

impl<R: Read + Seek> RecordReader<R> {
    /// Starts behind the magic, which must have been checked, of a file of `file_len` bytes.
    pub(super) fn new(mut input: R, file_len: u64) -> Result<Self, std::io::Error> {
        let position = input.seek(SeekFrom::Start(MAGIC.len() as u64))?;
        let chunk = chunk_reader(false);
        let (buffer, seen) = (Vec::new(), Seen::default());
        Ok(Self { input, file_len, position, place: Place::File, chunk, buffer, seen })
    }

    /// Expects messages on these channels, of which nothing may have been read.
    pub(super) fn expect_channels(&mut self, channels: impl IntoIterator<Item = u16>) {
        self.seen.channels.extend(channels);
    }

    /// Goes on with the file's first record.
    pub(in crate::recording) fn go_to_start(&mut self) -> Result<(), std::io::Error> {
        self.go_to(MAGIC.len() as u64)
    }

    /// Goes on with the record at a byte of the file.
    pub(super) fn go_to(&mut self, position: u64) -> Result<(), std::io::Error> {
        self.place = Place::File;
        self.skip_to(position.clamp(MAGIC.len() as u64, self.file_len.max(MAGIC.len() as u64)))
    }

    /// Goes on with the records of the file's summary, where the footer says that it is. `false`: the
    /// file has none, or it is damaged, or the file is cut short; the reader then stands at the file's
    /// start.
    pub(in crate::recording) fn go_to_summary(&mut self) -> Result<bool, std::io::Error> {
        let Some(footer_at) = self.file_len.checked_sub(ENDING_LEN) else {
            self.go_to_start()?;
            return Ok(false);
        };
        let mut ending = [0; ENDING_LEN as usize];
        self.input.seek(SeekFrom::Start(footer_at))?;
        self.input.read_exact(&mut ending)?;
        let mut fields = Fields(&ending[FRAMING_LEN as usize..]);
        let (summary, _offsets) = (fields.u64().unwrap_or(0), fields.u64());
        let checksum = fields.u32().unwrap_or(0);
        let known = ending[0] == op::FOOTER && ending.ends_with(MAGIC);
        let known = known && (MAGIC.len() as u64..footer_at).contains(&summary);
        // The checksum is of all from the summary's start up to itself.
        let checksum_at = footer_at + FRAMING_LEN + 16;
        let whole = known && (checksum == 0 || self.checksum(summary, checksum_at)? == checksum);
        self.go_to(if whole { summary } else { 0 })?;
        Ok(whole)
    }

    /// The next record that matters; `None` behind the last one.
    pub(in crate::recording) fn next(&mut self) -> Result<Option<Record<'_>>, RecordError> {
        let at = self.position;
        let Some(opcode) = self.advance()? else { return Ok(None) };
        match parse(opcode, &self.buffer) {
            Some(record) => Ok(Some(record)),
            None => Err(RecordError::Damaged { what: "record", at, reason: "its fields do not fit".into() }),
        }
    }

    /// Reads the next record that matters into the buffer and returns its kind.
    fn advance(&mut self) -> Result<Option<u8>, RecordError> {
        loop {
            match self.place {
                Place::End => return Ok(None),
                Place::CompressedChunk(chunk) => {
                    if let Some(opcode) = self.next_of_chunk(chunk)? {
                        return Ok(Some(opcode));
                    }
                }
                Place::PlainChunk(chunk) if self.position + FRAMING_LEN > chunk.data_end => {
                    self.leave_chunk(chunk)?;
                }
                Place::File | Place::PlainChunk(_) => {
                    if let Some(opcode) = self.next_of_file()? {
                        return Ok(Some(opcode));
                    }
                }
            }
        }
    }

    fn next_of_file(&mut self) -> Result<Option<u8>, RecordError> {
        let at = self.position;
        self.read(FRAMING_LEN, at)?;
        let opcode = self.buffer[0];
        let len = Fields(&self.buffer[1..]).u64().expect("the framing holds a length");
        let end = self.position.saturating_add(len);
        if let Place::PlainChunk(chunk) = self.place
            && end > chunk.data_end
        {
            self.leave_chunk(chunk)?;
            let reason = "it reaches beyond its chunk".into();
            return Err(RecordError::Damaged { what: "record", at, reason });
        }
        match opcode {
            op::CHUNK if matches!(self.place, Place::File) => {
                self.enter_chunk(at, end)?;
                Ok(None)
            }
            // The summary says again what was said, and statistics. Reading goes on to it only from
            // `go_to_summary`, so the data's end is the end.
            op::DATA_END | op::FOOTER if is_ending(opcode, len) => {
                self.place = Place::End;
                let whole = self.ends_in(MAGIC)?;
                if whole { Ok(None) } else { Err(self.cut_short(self.file_len)) }
            }
            // No record is of kind 0: a system that lost its power leaves zeros at a file's end.
            0 => Err(self.resume(at, "its kind is 0")?),
            _ if end > self.file_len => Err(self.resume(at, "its length is wrong")?),
            op::DATA_END | op::FOOTER => Err(self.resume(at, "its length is wrong")?),
            _ if matters(opcode, len) => {
                if opcode == op::MESSAGE
                    && let Some(within) = self.first_within(at, end)?
                {
                    self.skip_to(within)?;
                    let reason = "its length is wrong".into();
                    return Err(RecordError::Damaged { what: "record", at, reason });
                }
                self.read(len, at)?;
                if matches!(self.place, Place::File) {
                    self.seen.note(opcode, &self.buffer);
                }
                Ok(Some(opcode))
            }
            _ => {
                self.skip_to(end)?;
                Ok(None)
            }
        }
    }

    /// Goes on with the first chunk or record behind a record that cannot be read; without one, the file is
    /// cut short there.
    fn resume(&mut self, at: u64, reason: &str) -> Result<RecordError, std::io::Error> {
        let behind = (at + 1, self.file_len);
        let proof = Proof::NextOrBefore;
        Ok(match resume::find(&mut self.input, behind, self.file_len, &self.seen, proof)? {
            Some(next) => {
                self.place = Place::File;
                self.skip_to(next)?;
                RecordError::Damaged { what: "record", at, reason: reason.into() }
            }
            None => self.cut_short(at),
        })
    }

    /// The first chunk from a byte on. The reader then stands anywhere.
    fn find_chunk(&mut self, from: u64) -> Result<Option<u64>, std::io::Error> {
        let behind = (from, self.file_len);
        resume::find(&mut self.input, behind, self.file_len, &Seen::chunks_only(), Proof::Next)
    }

    /// The first record within a message outside of chunks that begins at `at` and seems to end at `end`,
    /// where no record begins: its length is wrong then. The reader stands behind its framing.
    fn first_within(&mut self, at: u64, end: u64) -> Result<Option<u64>, std::io::Error> {
        let room = self.file_len - end;
        if !matches!(self.place, Place::File) || self.seen.chunks || room < FRAMING_LEN {
            return Ok(None);
        }
        let ahead = i64::try_from(end - self.position).unwrap_or(i64::MAX);
        let mut next = Vec::new();
        // Not `seek`, which would empty the buffer for each of many short messages.
        self.input.seek_relative(ahead)?;
        self.input.by_ref().take(BEGINNING_LEN).read_to_end(&mut next)?;
        if self.seen.can_begin(&next, room) {
            self.input.seek_relative(-ahead - next.len() as i64)?;
            return Ok(None);
        }
        let position = self.position;
        let found = resume::find(&mut self.input, (at + 1, end), self.file_len, &self.seen, Proof::Next)?;
        self.skip_to(position)?;
        Ok(found)
    }

    /// Enters the chunk record that begins at `at` and ends at `end`; the reader stands behind its
    /// framing.
    fn enter_chunk(&mut self, at: u64, end: u64) -> Result<(), RecordError> {
        let torn = end > self.file_len;
        if torn && let Some(next) = self.find_chunk(at + 1)? {
            self.skip_to(next)?;
            return Err(damaged_chunk(at, "its length is wrong"));
        }
        self.skip_to(at + FRAMING_LEN)?;
        self.read(chunk::MAX_HEADER_LEN.min(end.min(self.file_len) - self.position), at)?;
        let header = match ChunkHeader::parse(&self.buffer) {
            Ok(header) => header,
            Err(reason) if torn => return Err(self.resume(at, &reason)?),
            Err(reason) => {
                self.skip_to(end)?;
                return Err(damaged_chunk(at, reason));
            }
        };
        let data_start = at + FRAMING_LEN + header.len;
        let data_end = data_start.saturating_add(header.data_len);
        if data_end > end {
            self.skip_to(end.min(self.file_len))?;
            return Err(damaged_chunk(at, "its data reach beyond it"));
        }
        self.seen.chunks = true;
        let chunk = Chunk { start: at, header, data_start, data_end, end, torn, given: false };
        if header.is_compressed() {
            return Ok(self.begin_compressed(chunk)?);
        }
        if !torn && header.checksum != 0 && self.checksum(data_start, data_end)? != header.checksum {
            self.leave_chunk(chunk)?;
            return Err(damaged_chunk(at, "its checksum is wrong"));
        }
        self.place = Place::PlainChunk(chunk);
        Ok(self.skip_to(data_start)?)
    }

    /// Hands a compressed chunk to the decompressor, which stops where its data end, or the file does.
    fn begin_compressed(&mut self, mut chunk: Chunk) -> Result<(), std::io::Error> {
        chunk.data_end = chunk.data_end.min(self.file_len);
        // A larger one gives its records before its checksum is known.
        let fits = chunk.header.size.max(chunk.header.data_len) <= MAX_RECORD_LEN;
        let alone = chunk.header.for_data_len(chunk.data_end - chunk.data_start);
        self.chunk = chunk_reader(fits && !chunk.torn);
        self.chunk.insert(alone.len()).copy_from_slice(&alone);
        self.chunk.notify_read(alone.len());
        self.place = Place::CompressedChunk(chunk);
        self.skip_to(chunk.data_start)
    }

    /// The next record of a compressed chunk that matters; `None` when the chunk is over.
    fn next_of_chunk(&mut self, chunk: Chunk) -> Result<Option<u8>, RecordError> {
        loop {
            let reason = match self.chunk.next_event() {
                Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                    if !chunk.given {
                        self.place = Place::CompressedChunk(Chunk { given: true, ..chunk });
                    }
                    if matters(opcode, data.len() as u64) {
                        self.buffer.clear();
                        self.buffer.extend_from_slice(data);
                        return Ok(Some(opcode));
                    }
                    return Ok(None);
                }
                Some(Ok(LinearReadEvent::ReadRequest(_))) if self.position < chunk.data_end => {
                    let len = (chunk.data_end - self.position).min(FEED_LEN as u64) as usize;
                    self.input.read_exact(self.chunk.insert(len))?;
                    self.chunk.notify_read(len);
                    self.position += len as u64;
                    continue;
                }
                // All was read: it asks for the record behind the chunk.
                Some(Ok(LinearReadEvent::ReadRequest(_))) | None => None,
                Some(Err(error)) => Some(error.to_string()),
            };
            if chunk.torn {
                return Err(self.cut_short(chunk.start));
            }
            if reason.is_some() && !chunk.given && self.ends_in_zeros(chunk.end)? {
                // The chunk's own end is among them.
                self.begin_compressed(Chunk { torn: true, ..chunk })?;
                return Ok(None);
            }
            self.leave_chunk(chunk)?;
            return match reason {
                None => Ok(None),
                Some(reason) => Err(damaged_chunk(chunk.start, reason)),
            };
        }
    }

    /// Whether the file ends as one does that a system made longer and lost its power before writing:
    /// without a chunk at byte `from` or behind, and with zeros. The reader then stands anywhere.
    fn ends_in_zeros(&mut self, from: u64) -> Result<bool, std::io::Error> {
        Ok(self.ends_in(&[0; 64])? && self.find_chunk(from)?.is_none())
    }

    /// Whether these are the last bytes of the file. The reader then stands anywhere.
    fn ends_in<const N: usize>(&mut self, bytes: &[u8; N]) -> Result<bool, std::io::Error> {
        let Some(at) = self.file_len.checked_sub(N as u64) else { return Ok(false) };
        let mut ending = [0; N];
        self.skip_to(at)?;
        self.input.read_exact(&mut ending)?;
        Ok(ending == *bytes)
    }

    /// CRC-32 of a stretch of the file; the reader then stands anywhere.
    fn checksum(&mut self, start: u64, end: u64) -> Result<u32, std::io::Error> {
        self.skip_to(start)?;
        let mut hasher = crc32fast::Hasher::new();
        while self.position < end {
            let len = (end - self.position).min(FEED_LEN as u64);
            self.buffer.resize(len as usize, 0);
            self.input.read_exact(&mut self.buffer)?;
            hasher.update(&self.buffer);
            self.position += len;
        }
        Ok(hasher.finalize())
    }

    /// Reads `len` bytes of the record at `at` into the buffer.
    fn read(&mut self, len: u64, at: u64) -> Result<(), RecordError> {
        if self.position + len > self.file_len {
            return Err(self.cut_short(at));
        }
        self.buffer.resize(len as usize, 0);
        match self.input.read_exact(&mut self.buffer) {
            Ok(()) => {
                self.position += len;
                Ok(())
            }
            // Somebody made the file shorter since it was opened.
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => Err(self.cut_short(at)),
            Err(error) => Err(error.into()),
        }
    }

    fn skip_to(&mut self, position: u64) -> Result<(), std::io::Error> {
        self.input.seek(SeekFrom::Start(position))?;
        self.position = position;
        Ok(())
    }

    /// Goes on behind a chunk.
    fn leave_chunk(&mut self, chunk: Chunk) -> Result<(), std::io::Error> {
        self.place = Place::File;
        self.skip_to(chunk.end.min(self.file_len))
    }

    fn cut_short(&mut self, at: u64) -> RecordError {
        self.place = Place::End;
        RecordError::CutShort(at)
    }
}

fn damaged_chunk(at: u64, reason: impl Into<String>) -> RecordError {
    RecordError::Damaged { what: "chunk", at, reason: reason.into() }
}

/// A reader for one chunk, without a file around it. `validated`: it gives no record before the
/// checksum of all of them is known to be right, and holds them in memory meanwhile.
fn chunk_reader(validated: bool) -> LinearReader {
    LinearReader::new_with_options(LinearReaderOptions {
        skip_start_magic: true,
        skip_end_magic: true,
        validate_chunk_crcs: true,
        prevalidate_chunk_crcs: validated,
        record_length_limit: Some(MAX_RECORD_LEN as usize),
        ..LinearReaderOptions::default()
    })
}
