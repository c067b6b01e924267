//! The records of an MCAP file, one at a time.
//!
//! The file's own framing is read here, so that no length in it is believed beyond the end of the
//! file; compressed chunks are handed to the `mcap` crate. What a chunk that is cut off still holds
//! is read as far as it can be decompressed.

use std::io::{ErrorKind, Read, Seek, SeekFrom};

use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// The bytes that an MCAP file begins and ends with.
pub(in crate::recording) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
/// Longest message that is read: an image of 1280×1024 has 5 MB. Longer ones are passed over.
const MAX_RECORD_LEN: u64 = 64 << 20;
/// Longest record of another kind that is read.
const MAX_OTHER_LEN: u64 = 1 << 20;
/// Bytes handed to the decompressor at a time.
const FEED_LEN: usize = 128 << 10;
/// A record's kind and length.
const FRAMING_LEN: u64 = 9;
/// Footer record and closing magic.
const ENDING_LEN: u64 = FRAMING_LEN + 20 + 8;

mod op {
    pub(super) const FOOTER: u8 = 0x02;
    pub(super) const SCHEMA: u8 = 0x03;
    pub(super) const CHANNEL: u8 = 0x04;
    pub(super) const MESSAGE: u8 = 0x05;
    pub(super) const CHUNK: u8 = 0x06;
    pub(super) const STATISTICS: u8 = 0x0b;
    pub(super) const METADATA: u8 = 0x0c;
    pub(super) const DATA_END: u8 = 0x0f;
}

/// A record that matters here; all others are passed over.
#[derive(Debug, PartialEq)]
pub(super) enum Record<'a> {
    Schema { id: u16, name: &'a str, encoding: &'a str },
    Channel { id: u16, schema: u16, topic: &'a str, message_encoding: &'a str },
    Message { channel: u16, log_time: u64, data: &'a [u8] },
    Metadata { name: &'a str, entries: Vec<(&'a str, &'a str)> },
    Statistics { message_counts: Vec<(u16, u64)> },
}

/// Why there is no next record.
#[derive(Debug, thiserror::Error)]
pub(super) enum RecordError {
    /// The file ends before its end.
    #[error("it ends within a record, at byte {0}")]
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
    /// Behind the last byte of its data.
    data_end: u64,
    /// Behind its record: the same, but for padding.
    end: u64,
}

/// Reads records in the order of the file.
pub(super) struct RecordReader<R> {
    input: R,
    /// Bytes of the file, as it was when it was opened.
    file_len: u64,
    position: u64,
    place: Place,
    chunk: LinearReader,
    buffer: Vec<u8>,
}

impl<R: Read + Seek> RecordReader<R> {
    /// Starts behind the magic, which must have been checked, of a file of `file_len` bytes.
    pub(super) fn new(mut input: R, file_len: u64) -> Result<Self, std::io::Error> {
        let position = input.seek(SeekFrom::Start(MAGIC.len() as u64))?;
        Ok(Self { input, file_len, position, place: Place::File, chunk: chunk_reader(), buffer: Vec::new() })
    }

    /// Goes on with the file's first record.
    pub(super) fn go_to_start(&mut self) -> Result<(), std::io::Error> {
        self.place = Place::File;
        self.skip_to(MAGIC.len() as u64)
    }

    /// Goes on with the records of the file's summary, where the footer says that it is. `false`: the
    /// file has none, or is cut short; the reader then stands at the file's start.
    pub(super) fn go_to_summary(&mut self) -> Result<bool, std::io::Error> {
        let mut ending = [0; ENDING_LEN as usize];
        if let Some(at) = self.file_len.checked_sub(ENDING_LEN) {
            self.input.seek(SeekFrom::Start(at))?;
            self.input.read_exact(&mut ending)?;
        }
        let mut fields = Fields(&ending[FRAMING_LEN as usize..]);
        let summary = fields.u64().unwrap_or(0);
        let known = ending[0] == op::FOOTER && ending.ends_with(MAGIC) && summary != 0;
        let known = known && (MAGIC.len() as u64..self.file_len).contains(&summary);
        self.go_to_start()?;
        if known {
            self.skip_to(summary)?;
        }
        Ok(known)
    }

    /// The next record that matters; `None` behind the last one.
    pub(super) fn next(&mut self) -> Result<Option<Record<'_>>, RecordError> {
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
            op::DATA_END | op::FOOTER => {
                self.place = Place::End;
                Ok(None)
            }
            _ if end > self.file_len => Err(self.cut_short(at)),
            _ if matters(opcode, len) => {
                self.read(len, at)?;
                Ok(Some(opcode))
            }
            _ => {
                self.skip_to(end)?;
                Ok(None)
            }
        }
    }

    /// Enters the chunk record that begins at `at` and ends at `end`; the reader stands behind its
    /// framing.
    fn enter_chunk(&mut self, at: u64, end: u64) -> Result<(), RecordError> {
        // start_time, end_time, uncompressed_size, uncompressed_crc.
        const FIXED_LEN: u64 = 8 + 8 + 8 + 4;
        self.read(FIXED_LEN + 4, at)?;
        let name_len = Fields(&self.buffer[FIXED_LEN as usize..]).u32().expect("four bytes were read");
        let data_start = at + FRAMING_LEN + FIXED_LEN + 4 + u64::from(name_len) + 8;
        let fixed = self.buffer.clone();
        // No compression has so long a name.
        if name_len > 64 || data_start > end {
            self.skip_to(end.min(self.file_len))?;
            let reason = "its header does not fit".into();
            return Err(RecordError::Damaged { what: "chunk", at, reason });
        }
        self.read(u64::from(name_len) + 8, at)?;
        let mut fields = Fields(&self.buffer[name_len as usize..]);
        let data_len = fields.u64().expect("eight bytes were read");
        let data_end = data_start.saturating_add(data_len);
        if data_end > end {
            self.skip_to(end.min(self.file_len))?;
            let reason = "its data reach beyond it".into();
            return Err(RecordError::Damaged { what: "chunk", at, reason });
        }
        if name_len == 0 {
            self.place = Place::PlainChunk(Chunk { start: at, data_end, end });
            return Ok(());
        }
        // The crate gets a chunk that ends where its data end, or where the file does.
        let data_end = data_end.min(self.file_len);
        self.place = Place::CompressedChunk(Chunk { start: at, data_end, end });
        let mut header = vec![op::CHUNK];
        header.extend((data_end - (at + FRAMING_LEN)).to_le_bytes());
        header.extend(fixed);
        header.extend(&self.buffer[..name_len as usize]);
        header.extend((data_end - data_start).to_le_bytes());
        self.chunk = chunk_reader();
        self.chunk.insert(header.len()).copy_from_slice(&header);
        self.chunk.notify_read(header.len());
        Ok(())
    }

    /// The next record of a compressed chunk that matters; `None` when the chunk is over.
    fn next_of_chunk(&mut self, chunk: Chunk) -> Result<Option<u8>, RecordError> {
        loop {
            let reason = match self.chunk.next_event() {
                Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                    if matters(opcode, data.len() as u64) {
                        self.buffer.clear();
                        self.buffer.extend_from_slice(data);
                        return Ok(Some(opcode));
                    }
                    continue;
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
            if chunk.end > self.file_len {
                return Err(self.cut_short(chunk.start));
            }
            self.leave_chunk(chunk)?;
            return match reason {
                None => Ok(None),
                Some(reason) => Err(RecordError::Damaged { what: "chunk", at: chunk.start, reason }),
            };
        }
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

/// Whether a record is read.
fn matters(opcode: u8, len: u64) -> bool {
    match opcode {
        op::MESSAGE => len <= MAX_RECORD_LEN,
        op::SCHEMA | op::CHANNEL | op::METADATA | op::STATISTICS => len <= MAX_OTHER_LEN,
        _ => false,
    }
}

/// A reader for one chunk, without a file around it.
fn chunk_reader() -> LinearReader {
    LinearReader::new_with_options(LinearReaderOptions {
        skip_start_magic: true,
        skip_end_magic: true,
        validate_chunk_crcs: true,
        record_length_limit: Some(MAX_RECORD_LEN as usize),
        ..LinearReaderOptions::default()
    })
}

/// A record from its bytes; `None` when they do not fit.
fn parse(opcode: u8, body: &[u8]) -> Option<Record<'_>> {
    let mut fields = Fields(body);
    Some(match opcode {
        op::SCHEMA => {
            Record::Schema { id: fields.u16()?, name: fields.string()?, encoding: fields.string()? }
        }
        op::CHANNEL => Record::Channel {
            id: fields.u16()?,
            schema: fields.u16()?,
            topic: fields.string()?,
            message_encoding: fields.string()?,
        },
        op::MESSAGE => {
            let (channel, _sequence) = (fields.u16()?, fields.u32()?);
            let (log_time, _publish_time) = (fields.u64()?, fields.u64()?);
            Record::Message { channel, log_time, data: fields.0 }
        }
        op::METADATA => {
            let name = fields.string()?;
            let mut map = Fields(fields.bytes()?);
            let mut entries = Vec::new();
            while !map.0.is_empty() {
                entries.push((map.string()?, map.string()?));
            }
            Record::Metadata { name, entries }
        }
        op::STATISTICS => {
            // message_count u64; schemas u16; channels, attachments, metadata, chunks u32; first and
            // last time u64.
            fields.take(8 + 2 + 4 * 4 + 2 * 8)?;
            let mut map = Fields(fields.bytes()?);
            let mut message_counts = Vec::new();
            while !map.0.is_empty() {
                message_counts.push((map.u16()?, map.u64()?));
            }
            Record::Statistics { message_counts }
        }
        _ => return None,
    })
}

/// The fields of a record, little-endian, in their order; `None` behind the end.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, len: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        Some(taken)
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn u16(&mut self) -> Option<u16> {
        self.number().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.number().map(u64::from_le_bytes)
    }

    fn bytes(&mut self) -> Option<&'a [u8]> {
        let len = self.u32()?;
        self.take(len as usize)
    }

    fn string(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.bytes()?).ok()
    }
}
