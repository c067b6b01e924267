//! The header of a chunk.

use super::record::{Fields, op};

/// start_time, end_time, uncompressed_size, uncompressed_crc.
const FIXED_LEN: u64 = 8 + 8 + 8 + 4;
/// Most bytes from a chunk's framing to its data: no compression that is read has a longer name than
/// `zstd`, but an error names a longer one.
pub(super) const MAX_HEADER_LEN: u64 = FIXED_LEN + 4 + MAX_NAME_LEN + 8;
const MAX_NAME_LEN: u64 = 16;

/// How a chunk's records are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Compression {
    None,
    Lz4,
    Zstd,
}

impl Compression {
    fn name(self) -> &'static [u8] {
        match self {
            Self::None => b"",
            Self::Lz4 => b"lz4",
            Self::Zstd => b"zstd",
        }
    }
}

/// What a chunk says before its data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ChunkHeader {
    /// Bytes of its records without compression.
    pub(super) size: u64,
    /// Of the same, CRC-32; 0: not stated.
    pub(super) checksum: u32,
    compression: Compression,
    /// Bytes of its data.
    pub(super) data_len: u64,
    /// Bytes from behind its framing to its data.
    pub(super) len: u64,
}

impl ChunkHeader {
    /// Reads what stands behind the framing of a chunk.
    ///
    /// # Errors
    /// Why it cannot be read.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, String> {
        let short = || "its header does not fit".to_owned();
        let mut fields = Fields(bytes);
        let (_start, _end) = (fields.u64(), fields.u64());
        let size = fields.u64().ok_or_else(short)?;
        let checksum = fields.u32().ok_or_else(short)?;
        let name = fields.bytes().ok_or_else(short)?;
        let compression = [Compression::None, Compression::Lz4, Compression::Zstd];
        let compression = compression.into_iter().find(|known| known.name() == name).ok_or_else(|| {
            let name = String::from_utf8_lossy(name);
            format!("its compression is {name:?}; expected none, lz4 or zstd")
        })?;
        let data_len = fields.u64().ok_or_else(short)?;
        Ok(Self { size, checksum, compression, data_len, len: FIXED_LEN + 4 + name.len() as u64 + 8 })
    }

    pub(super) fn is_compressed(&self) -> bool {
        self.compression != Compression::None
    }

    /// A chunk's framing and header for the first `data_len` bytes of its data.
    pub(super) fn for_data_len(&self, data_len: u64) -> Vec<u8> {
        let name = self.compression.name();
        let mut bytes = vec![op::CHUNK];
        bytes.extend((self.len + data_len).to_le_bytes());
        // Its first and last time do not matter here.
        bytes.extend([0; 16]);
        bytes.extend(self.size.to_le_bytes());
        bytes.extend(self.checksum.to_le_bytes());
        bytes.extend((name.len() as u32).to_le_bytes());
        bytes.extend(name);
        bytes.extend(data_len.to_le_bytes());
        bytes
    }
}

/// Whether a chunk begins with these bytes: one whose two lengths agree, whose compression is known and
/// whose first time is not behind its last.
pub(super) fn begins_a_chunk(bytes: &[u8]) -> bool {
    let mut fields = Fields(&bytes[1..]);
    let (Some(len), rest) = (fields.u64(), fields.0) else { return false };
    let Ok(header) = ChunkHeader::parse(rest) else { return false };
    let (start, end) = (fields.u64(), fields.u64());
    header.len.checked_add(header.data_len) == Some(len) && start <= end && header.data_len > 0
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::super::records::FRAMING_LEN;
    use super::super::resume::{Proof, Seen, find};
    use super::*;

    fn header(compression: Compression) -> ChunkHeader {
        let len = FIXED_LEN + 4 + compression.name().len() as u64 + 8;
        ChunkHeader { size: 70_000, checksum: 5, compression, data_len: 1234, len }
    }

    #[test]
    fn what_is_written_is_read() {
        for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
            let header = header(compression);
            let bytes = header.for_data_len(1234);
            assert_eq!(ChunkHeader::parse(&bytes[FRAMING_LEN as usize..]), Ok(header));
        }
    }

    #[test]
    fn a_chunk_is_found_wherever_it_begins() {
        let chunk = header(Compression::Zstd).for_data_len(1234);
        for at in [0, 1, 77, (64 << 10) - 20, 64 << 10, (64 << 10) + 40, 200_000] {
            // Chunks' kind everywhere, but no chunk.
            let mut bytes = vec![op::CHUNK; at];
            bytes.extend(&chunk);
            let len = bytes.len() as u64;
            let found = |from, len| {
                let input = &mut Cursor::new(&bytes);
                find(input, (from, len), len, &Seen::default(), Proof::Next).expect("in memory")
            };
            assert_eq!(found(0, len), Some(at as u64));
            assert_eq!(found(at as u64 + 1, len), None);
            // A header that is not whole is none.
            assert_eq!(found(0, len - 1), None);
        }
    }
}
