//! The bytes of a snapshot, little-endian: header at 0, records at 64, knots at 64 + 128·n, total
//! 64 + 128·n + 32·k. The offsets below are the contract; [`encode`] writes them.

use crate::blade::Blade;

/// The first eight bytes.
pub const MAGIC: [u8; 8] = *b"SWARDLIB";
/// Version of this layout.
pub const VERSION: u32 = 1;
/// Bytes of the header.
pub const HEADER_BYTES: usize = 64;
/// Bytes of one blade record.
pub const RECORD_BYTES: usize = 128;
/// Bytes of one knot.
pub const KNOT_BYTES: usize = 32;
/// Most blades of a library.
pub const MAX_BLADES: usize = 4096;

/// Byte offsets of the header's fields.
pub mod header {
    /// `[u8; 8]` magic.
    pub const MAGIC: usize = 0;
    /// `u32` layout version.
    pub const VERSION: usize = 8;
    /// `u32` number of blades.
    pub const BLADES: usize = 12;
    /// `u64` generation.
    pub const GENERATION: usize = 16;
    /// `u32` number of knots.
    pub const KNOTS: usize = 24;
    /// `u32` header size, 64.
    pub const HEADER_SIZE: usize = 28;
    /// `u64` total bytes.
    pub const TOTAL: usize = 32;
    /// `[u8; 16]` hash over bytes 0..40 and 56..total.
    pub const HASH: usize = 40;
    /// `[u8; 8]` zero.
    pub const RESERVED: usize = 56;
}

/// Byte offsets of a record's fields.
pub mod record {
    /// `[u8; 16]` id.
    pub const ID: usize = 0;
    /// `[u8; 48]` UTF-8 name, zero padded.
    pub const NAME: usize = 16;
    /// `u32` index of the first knot.
    pub const FIRST_KNOT: usize = 64;
    /// `u32` number of knots.
    pub const KNOT_COUNT: usize = 68;
    /// `u32` kind: 0 blade, 1 leaf.
    pub const KIND: usize = 72;
    /// `f32` length, metres.
    pub const LENGTH: usize = 76;
    /// `f32` largest width, metres.
    pub const MAX_WIDTH: usize = 80;
    /// `f32` mix weight.
    pub const MIX: usize = 84;
    /// `u64` capture time, nanoseconds since 1970.
    pub const CAPTURED: usize = 88;
    /// `f32` quality, 0 to 1.
    pub const QUALITY: usize = 96;
    /// Zero from here to the end of the record.
    pub const RESERVED: usize = 100;
}

/// Why blades cannot be written as one library.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LibraryError {
    /// More than [`MAX_BLADES`].
    #[error("{0} blades; a library holds at most {MAX_BLADES}")]
    TooManyBlades(usize),
}

/// Writes `blades` as one snapshot.
///
/// # Errors
/// More than [`MAX_BLADES`] blades.
pub fn encode(generation: u64, blades: &[Blade]) -> Result<Vec<u8>, LibraryError> {
    if blades.len() > MAX_BLADES {
        return Err(LibraryError::TooManyBlades(blades.len()));
    }
    let knot_count: usize = blades.iter().map(|blade| blade.knots().len()).sum();
    let knots_at = HEADER_BYTES + RECORD_BYTES * blades.len();
    let total = knots_at + KNOT_BYTES * knot_count;
    let mut bytes = vec![0; total];
    put(&mut bytes, header::MAGIC, MAGIC);
    put(&mut bytes, header::VERSION, VERSION.to_le_bytes());
    put(&mut bytes, header::BLADES, (blades.len() as u32).to_le_bytes());
    put(&mut bytes, header::GENERATION, generation.to_le_bytes());
    put(&mut bytes, header::KNOTS, (knot_count as u32).to_le_bytes());
    put(&mut bytes, header::HEADER_SIZE, (HEADER_BYTES as u32).to_le_bytes());
    put(&mut bytes, header::TOTAL, (total as u64).to_le_bytes());
    let mut first_knot = 0;
    for (index, blade) in blades.iter().enumerate() {
        let at = HEADER_BYTES + RECORD_BYTES * index;
        put_record(&mut bytes[at..at + RECORD_BYTES], blade, first_knot as u32);
        for (offset, knot) in blade.knots().iter().enumerate() {
            put_knot(&mut bytes, knots_at + KNOT_BYTES * (first_knot + offset), knot);
        }
        first_knot += blade.knots().len();
    }
    let hash = hash(&bytes);
    put(&mut bytes, header::HASH, hash);
    Ok(bytes)
}

/// The header's hash of a snapshot of at least [`HEADER_BYTES`] bytes: the first 16 bytes of BLAKE3
/// over bytes 0..40 and 56..total.
pub fn hash(bytes: &[u8]) -> [u8; 16] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&bytes[..header::HASH]);
    hasher.update(&bytes[header::RESERVED..]);
    let mut hash = [0; 16];
    hash.copy_from_slice(&hasher.finalize().as_bytes()[..16]);
    hash
}

/// Hex of BLAKE3 over the records and knots of a snapshot: equal for equal blades, whatever the
/// generation.
pub fn library_hash(snapshot: &[u8]) -> String {
    blake3::hash(snapshot.get(HEADER_BYTES..).unwrap_or_default()).to_hex().to_string()
}

fn put<const N: usize>(bytes: &mut [u8], at: usize, value: [u8; N]) {
    bytes[at..at + N].copy_from_slice(&value);
}

fn put_record(bytes: &mut [u8], blade: &Blade, first_knot: u32) {
    put(bytes, record::ID, blade.id().0);
    bytes[record::NAME..][..blade.name().len()].copy_from_slice(blade.name().as_bytes());
    put(bytes, record::FIRST_KNOT, first_knot.to_le_bytes());
    put(bytes, record::KNOT_COUNT, (blade.knots().len() as u32).to_le_bytes());
    put(bytes, record::KIND, (blade.kind() as u32).to_le_bytes());
    put(bytes, record::LENGTH, blade.length_m().to_le_bytes());
    put(bytes, record::MAX_WIDTH, blade.max_width_m().to_le_bytes());
    put(bytes, record::MIX, blade.mix().to_le_bytes());
    put(bytes, record::CAPTURED, blade.captured_unix_ns().to_le_bytes());
    put(bytes, record::QUALITY, blade.quality().to_le_bytes());
}

fn put_knot(bytes: &mut [u8], at: usize, knot: &crate::blade::Knot) {
    let [px, py, pz] = knot.position.to_array();
    let [ax, ay, az] = knot.across.to_array();
    let fields = [px, py, pz, knot.half_width_left, ax, ay, az, knot.half_width_right];
    for (index, value) in fields.into_iter().enumerate() {
        put(bytes, at + 4 * index, value.to_le_bytes());
    }
}
