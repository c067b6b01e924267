//! A validated view of a snapshot's bytes: after [`Snapshot::validate`] every offset is in bounds
//! and every blade keeps the invariants of [`crate::blade`].

use super::layout::{
    self, HEADER_BYTES, KNOT_BYTES, MAGIC, MAX_BLADES, RECORD_BYTES, VERSION, header, record,
};
use crate::blade::{BladeId, Kind, Knot, KnotError, MAX_NAME_BYTES, check_knots};
use crate::head::{Head, HeadError, array, u32_at, u64_at};

/// How it begins.
const HEAD: Head = Head {
    of: "a snapshot",
    magic: MAGIC,
    version: (header::VERSION, VERSION),
    size: (header::HEADER_SIZE, HEADER_BYTES),
};

/// Why some bytes are not a snapshot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SnapshotError {
    /// It does not begin as it should.
    #[error(transparent)]
    Head(#[from] HeadError),
    /// Too many blades.
    #[error("{0} blades; a library holds at most {MAX_BLADES}")]
    TooManyBlades(u32),
    /// Counts, the stated total and the bytes there do not agree.
    #[error(
        "{blades} blades and {knots} knots take {expected} bytes, the header says {stated}, there are {found}"
    )]
    Size {
        /// Blades by the header.
        blades: u32,
        /// Knots by the header.
        knots: u32,
        /// Bytes that these take.
        expected: u64,
        /// Bytes by the header.
        stated: u64,
        /// Bytes there.
        found: u64,
    },
    /// Bytes that must be zero are not.
    #[error("reserved bytes of {0} are not zero")]
    Reserved(Place),
    /// The bytes are not the ones that were hashed.
    #[error("the hash does not match the bytes")]
    Hash,
    /// A record's name is not zero-padded UTF-8 of at least one byte.
    #[error("blade {0}: the name is not zero-padded UTF-8")]
    Name(u32),
    /// A record names knots that are not there.
    #[error("blade {blade}: knots {first}..{first}+{count} of {of}")]
    KnotRange {
        /// Index of the blade.
        blade: u32,
        /// Its first knot.
        first: u32,
        /// Its number of knots.
        count: u32,
        /// Knots in the snapshot.
        of: u32,
    },
    /// A record's kind is neither blade nor leaf.
    #[error("blade {0}: kind {1}, expected 0 or 1")]
    Kind(u32, u32),
    /// A record's number is out of its range.
    #[error("blade {blade}: {field} is {value}, out of range")]
    Number {
        /// Index of the blade.
        blade: u32,
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f32,
    },
    /// A blade's knots break an invariant.
    #[error("blade {0}: {1}")]
    Knots(u32, KnotError),
}

/// A part of a snapshot, for messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The header.
    Header,
    /// The record of a blade.
    Record(u32),
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Header => f.write_str("the header"),
            Self::Record(blade) => write!(f, "blade {blade}"),
        }
    }
}

/// A validated snapshot over bytes `B` (a mapping, a vector). `B` must give the same bytes at each
/// call, as a sealed mapping does.
#[derive(Debug)]
pub struct Snapshot<B> {
    bytes: B,
    blades: u32,
    knots: u32,
}

impl<B: AsRef<[u8]>> Snapshot<B> {
    /// Checks every byte once. O(total); allocates nothing that the bytes could make large.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn validate(bytes: B) -> Result<Self, SnapshotError> {
        let all = bytes.as_ref();
        HEAD.check(all)?;
        let (blades, knots) = (u32_at(all, header::BLADES), u32_at(all, header::KNOTS));
        if blades as usize > MAX_BLADES {
            return Err(SnapshotError::TooManyBlades(blades));
        }
        let expected = HEADER_BYTES as u64
            + RECORD_BYTES as u64 * u64::from(blades)
            + KNOT_BYTES as u64 * u64::from(knots);
        let (stated, found) = (u64_at(all, header::TOTAL), all.len() as u64);
        if stated != expected || found != expected {
            return Err(SnapshotError::Size { blades, knots, expected, stated, found });
        }
        if all[header::RESERVED..HEADER_BYTES].iter().any(|byte| *byte != 0) {
            return Err(SnapshotError::Reserved(Place::Header));
        }
        if layout::hash(all) != array(all, header::HASH) {
            return Err(SnapshotError::Hash);
        }
        let snapshot = Self { blades, knots, bytes };
        for index in 0..blades {
            snapshot.validate_blade(index)?;
        }
        Ok(snapshot)
    }

    fn validate_blade(&self, blade: u32) -> Result<(), SnapshotError> {
        let view = self.blade(blade);
        let name = view.name_field();
        let used = name.iter().position(|byte| *byte == 0).unwrap_or(MAX_NAME_BYTES);
        let padded = name[used..].iter().all(|byte| *byte == 0);
        if used == 0 || !padded || std::str::from_utf8(&name[..used]).is_err() {
            return Err(SnapshotError::Name(blade));
        }
        let (first, count) = (view.u32(record::FIRST_KNOT), view.u32(record::KNOT_COUNT));
        if first.checked_add(count).is_none_or(|end| end > self.knots) {
            return Err(SnapshotError::KnotRange { blade, first, count, of: self.knots });
        }
        let kind = view.u32(record::KIND);
        if kind > 1 {
            return Err(SnapshotError::Kind(blade, kind));
        }
        let number = |field, value: f32, valid: bool| {
            if value.is_finite() && valid {
                Ok(())
            } else {
                Err(SnapshotError::Number { blade, field, value })
            }
        };
        number("length_m", view.length_m(), view.length_m() > 0.0)?;
        number("max_width_m", view.max_width_m(), view.max_width_m() >= 0.0)?;
        number("mix", view.mix(), view.mix() >= 0.0)?;
        number("quality", view.quality(), (0.0..=1.0).contains(&view.quality()))?;
        if view.record[record::RESERVED..].iter().any(|byte| *byte != 0) {
            return Err(SnapshotError::Reserved(Place::Record(blade)));
        }
        check_knots(&view.knots()).map_err(|error| SnapshotError::Knots(blade, error))
    }

    /// Its generation: a larger one is newer.
    pub fn generation(&self) -> u64 {
        u64_at(self.bytes.as_ref(), header::GENERATION)
    }

    /// Number of blades.
    pub fn len(&self) -> usize {
        self.blades as usize
    }

    /// Whether it holds no blade.
    pub fn is_empty(&self) -> bool {
        self.blades == 0
    }

    /// Its blades, in the library's order.
    pub fn blades(&self) -> impl ExactSizeIterator<Item = BladeView<'_>> {
        (0..self.blades as usize).map(|index| self.blade(index as u32))
    }

    /// All knots as the bytes that the vertex shader reads, 32 each.
    pub fn knot_bytes(&self) -> &[u8] {
        &self.bytes.as_ref()[HEADER_BYTES + RECORD_BYTES * self.blades as usize..]
    }

    /// All bytes.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.as_ref()
    }

    fn blade(&self, index: u32) -> BladeView<'_> {
        let at = HEADER_BYTES + RECORD_BYTES * index as usize;
        BladeView { record: &self.bytes.as_ref()[at..at + RECORD_BYTES], knot_bytes: self.knot_bytes() }
    }
}

/// One blade of a validated snapshot.
#[derive(Clone, Copy, Debug)]
pub struct BladeView<'a> {
    record: &'a [u8],
    knot_bytes: &'a [u8],
}

impl<'a> BladeView<'a> {
    /// Its identity.
    pub fn id(&self) -> BladeId {
        BladeId(array(self.record, record::ID))
    }

    /// Its name.
    pub fn name(&self) -> &'a str {
        let name = self.name_field();
        let used = name.iter().position(|byte| *byte == 0).unwrap_or(MAX_NAME_BYTES);
        std::str::from_utf8(&name[..used]).expect("validated")
    }

    /// Its knots in the snapshot's list of knots.
    pub fn knot_range(&self) -> std::ops::Range<usize> {
        let first = self.u32(record::FIRST_KNOT) as usize;
        first..first + self.u32(record::KNOT_COUNT) as usize
    }

    /// Its knots from root to tip.
    pub fn knots(&self) -> Vec<Knot> {
        let range = self.knot_range();
        let bytes = &self.knot_bytes[range.start * KNOT_BYTES..range.end * KNOT_BYTES];
        bytes.chunks_exact(KNOT_BYTES).map(bytemuck::pod_read_unaligned).collect()
    }

    /// Blade or leaf.
    pub fn kind(&self) -> Kind {
        if self.u32(record::KIND) == 0 { Kind::Blade } else { Kind::Leaf }
    }

    /// Arc length before refinement, metres.
    pub fn length_m(&self) -> f32 {
        self.f32(record::LENGTH)
    }

    /// Largest width, metres.
    pub fn max_width_m(&self) -> f32 {
        self.f32(record::MAX_WIDTH)
    }

    /// Mix weight, ≥ 0.
    pub fn mix(&self) -> f32 {
        self.f32(record::MIX)
    }

    /// Capture time, nanoseconds since 1970.
    pub fn captured_unix_ns(&self) -> u64 {
        u64_at(self.record, record::CAPTURED)
    }

    /// Quality, 0 to 1.
    pub fn quality(&self) -> f32 {
        self.f32(record::QUALITY)
    }

    fn name_field(&self) -> &'a [u8] {
        &self.record[record::NAME..record::NAME + MAX_NAME_BYTES]
    }

    fn u32(&self, at: usize) -> u32 {
        u32_at(self.record, at)
    }

    fn f32(&self, at: usize) -> f32 {
        f32::from_le_bytes(array(self.record, at))
    }
}
