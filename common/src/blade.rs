//! A blade: knots from root to tip in the blade frame, each with its own width to both sides.
//!
//! Blade frame: origin at the root, +y up against gravity, +z horizontally towards the camera that
//! captured it, +x to the right. Metres.

use glam::Vec3;

/// Largest mix weight: the sum of those of a full library is far below what a number can hold.
pub const MAX_MIX: f32 = 1e6;
/// Fewest knots of a blade.
pub const MIN_KNOTS: usize = 2;
/// Most knots of a blade (Fan & Sheng §1: "no more than 64 vertices").
pub const MAX_KNOTS: usize = 64;
/// Longest name of a blade, in bytes of UTF-8.
pub const MAX_NAME_BYTES: usize = 48;
/// A blade longer than this many times its width is a grass blade, else a leaf.
pub const LEAF_ASPECT: f32 = 5.0;
/// How far `|across|` may be from one.
pub const UNIT_TOLERANCE: f32 = 1e-3;

/// One cross-section of a blade: 32 bytes, the very bytes that the vertex shader reads.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Knot {
    /// Position on the midrib, metres.
    pub position: Vec3,
    /// From the midrib to the left edge, metres, finite and ≥ 0.
    pub half_width_left: f32,
    /// Unit vector from the left edge to the right edge.
    pub across: Vec3,
    /// From the midrib to the right edge, metres, finite and ≥ 0.
    pub half_width_right: f32,
}

impl Knot {
    /// Width from edge to edge, metres.
    pub fn width(&self) -> f32 {
        self.half_width_left + self.half_width_right
    }

    /// The left edge's position.
    pub fn left(&self) -> Vec3 {
        self.position - self.across * self.half_width_left
    }

    /// The right edge's position.
    pub fn right(&self) -> Vec3 {
        self.position + self.across * self.half_width_right
    }
}

/// Grass blade or leaf, by length over width.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// Long and slim: length over width of at least [`LEAF_ASPECT`].
    Blade = 0,
    /// Broad.
    Leaf = 1,
}

/// The identity of a captured blade: the first 16 bytes of a BLAKE3 over frame timestamp, index in
/// the capture and knots.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct BladeId(pub [u8; 16]);

impl BladeId {
    /// The id of blade `index` of the capture at `timestamp_ns` with these `knots`.
    pub fn of(timestamp_ns: u64, index: u32, knots: &[Knot]) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&timestamp_ns.to_le_bytes());
        hasher.update(&index.to_le_bytes());
        hasher.update(bytemuck::cast_slice(knots));
        let mut id = [0; 16];
        id.copy_from_slice(&hasher.finalize().as_bytes()[..16]);
        Self(id)
    }
}

impl std::fmt::Display for BladeId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl std::fmt::Debug for BladeId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "BladeId({self})")
    }
}

/// Why some knots are not a blade.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum KnotError {
    /// Too few or too many knots.
    #[error("{0} knots; a blade has {MIN_KNOTS} to {MAX_KNOTS}")]
    Count(usize),
    /// A coordinate or width that is not a finite number.
    #[error("knot {0} holds a number that is not finite")]
    NotFinite(usize),
    /// A half width below zero.
    #[error("knot {0} has a half width below zero")]
    NegativeWidth(usize),
    /// `across` is not a unit vector.
    #[error("knot {0}: `across` has length {1}, expected 1")]
    AcrossNotUnit(usize, f32),
    /// Two successive knots at the same place.
    #[error("knot {0} stands where the knot before it stands: arc length must grow")]
    ArcLengthStalls(usize),
}

/// Checks the invariants of a blade's knots: count, finite numbers, half widths ≥ 0, unit `across`,
/// strictly growing arc length.
///
/// # Errors
/// The first knot that breaks one, and how.
pub fn check_knots(knots: &[Knot]) -> Result<(), KnotError> {
    if !(MIN_KNOTS..=MAX_KNOTS).contains(&knots.len()) {
        return Err(KnotError::Count(knots.len()));
    }
    for (index, knot) in knots.iter().enumerate() {
        let widths_finite = knot.half_width_left.is_finite() && knot.half_width_right.is_finite();
        if !(knot.position.is_finite() && knot.across.is_finite() && widths_finite) {
            return Err(KnotError::NotFinite(index));
        }
        if knot.half_width_left < 0.0 || knot.half_width_right < 0.0 {
            return Err(KnotError::NegativeWidth(index));
        }
        let across = knot.across.length();
        if (across - 1.0).abs() > UNIT_TOLERANCE {
            return Err(KnotError::AcrossNotUnit(index, across));
        }
        // `>` on the computed step also refuses a step that overflows to infinity minus infinity.
        let grows = index == 0 || knot.position.distance(knots[index - 1].position) > 0.0;
        if !grows {
            return Err(KnotError::ArcLengthStalls(index));
        }
    }
    Ok(())
}

/// A captured blade. Its knots satisfy [`check_knots`]; lengths are metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Blade {
    id: BladeId,
    name: String,
    knots: Vec<Knot>,
    length_m: f32,
    max_width_m: f32,
    mix: f32,
    captured_unix_ns: u64,
    quality: f32,
}

/// Why a blade cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BladeError {
    /// The knots break an invariant.
    #[error(transparent)]
    Knots(#[from] KnotError),
    /// The name does not fit the library's record.
    #[error("the name {0:?} has {len} bytes; 1 to {MAX_NAME_BYTES} without NUL are allowed", len = .0.len())]
    Name(String),
    /// A number out of its range.
    #[error("{what} is {value}; expected {expected}")]
    Range {
        /// Which number.
        what: &'static str,
        /// What it was.
        value: f32,
        /// What is allowed.
        expected: &'static str,
    },
}

impl Blade {
    /// Makes a blade from knots in the blade frame.
    ///
    /// `size_m`: arc length of the midrib (> 0) and largest width (≥ 0), both before refinement, which
    /// would take something off them; `quality`: 0..=1. The mix weight starts at 1.
    ///
    /// # Errors
    /// When the knots, the name or a number break an invariant.
    pub fn new(
        id: BladeId,
        name: impl Into<String>,
        knots: Vec<Knot>,
        size_m: [f32; 2],
        captured_unix_ns: u64,
        quality: f32,
    ) -> Result<Self, BladeError> {
        check_knots(&knots)?;
        let name = name.into();
        if name.is_empty() || name.len() > MAX_NAME_BYTES || name.contains('\0') {
            return Err(BladeError::Name(name));
        }
        let [length_m, max_width_m] = size_m;
        if !(max_width_m.is_finite() && max_width_m >= 0.0) {
            return Err(BladeError::Range { what: "max_width_m", value: max_width_m, expected: "0 or more" });
        }
        if !(length_m.is_finite() && length_m > 0.0) {
            return Err(BladeError::Range { what: "length_m", value: length_m, expected: "more than 0" });
        }
        if !(0.0..=1.0).contains(&quality) {
            return Err(BladeError::Range { what: "quality", value: quality, expected: "0 to 1" });
        }
        Ok(Self { id, name, knots, length_m, max_width_m, mix: 1.0, captured_unix_ns, quality })
    }

    /// The same blade with another mix weight.
    ///
    /// # Errors
    /// When the weight is not within 0 to [`MAX_MIX`].
    pub fn with_mix(mut self, mix: f32) -> Result<Self, BladeError> {
        if !(0.0..=MAX_MIX).contains(&mix) {
            return Err(BladeError::Range { what: "mix", value: mix, expected: "0 to 1000000" });
        }
        self.mix = mix;
        Ok(self)
    }

    /// Its identity.
    pub fn id(&self) -> BladeId {
        self.id
    }

    /// Its name, 1 to 48 bytes.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its knots from root to tip, blade frame, metres.
    pub fn knots(&self) -> &[Knot] {
        &self.knots
    }

    /// Arc length of the midrib before refinement, metres.
    pub fn length_m(&self) -> f32 {
        self.length_m
    }

    /// Largest width before refinement, metres.
    pub fn max_width_m(&self) -> f32 {
        self.max_width_m
    }

    /// How often it stands in the meadow, relative to the others; ≥ 0.
    pub fn mix(&self) -> f32 {
        self.mix
    }

    /// When it was captured, nanoseconds since 1970 (the recording's time in a replay).
    pub fn captured_unix_ns(&self) -> u64 {
        self.captured_unix_ns
    }

    /// How sure the capture is of it, 0 to 1.
    pub fn quality(&self) -> f32 {
        self.quality
    }

    /// Blade or leaf.
    pub fn kind(&self) -> Kind {
        if self.length_m >= LEAF_ASPECT * self.max_width_m() { Kind::Blade } else { Kind::Leaf }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn straight(n: usize) -> Vec<Knot> {
        (0..n)
            .map(|i| Knot {
                position: Vec3::Y * i as f32 * 0.01,
                half_width_left: 0.002,
                across: Vec3::X,
                half_width_right: 0.003,
            })
            .collect()
    }

    #[test]
    fn a_knot_is_32_bytes_in_the_order_of_the_library() {
        assert_eq!(size_of::<Knot>(), 32);
        assert_eq!(std::mem::offset_of!(Knot, half_width_left), 12);
        assert_eq!(std::mem::offset_of!(Knot, across), 16);
        assert_eq!(std::mem::offset_of!(Knot, half_width_right), 28);
    }

    #[test]
    fn each_broken_invariant_is_named() {
        let broken = |change: fn(&mut Vec<Knot>)| {
            let mut knots = straight(4);
            change(&mut knots);
            check_knots(&knots).expect_err("the invariant is broken")
        };
        assert_eq!(check_knots(&straight(4)), Ok(()));
        assert_eq!(broken(|k| k.truncate(1)), KnotError::Count(1));
        assert_eq!(broken(|k| *k = straight(65)), KnotError::Count(65));
        assert_eq!(broken(|k| k[2].position.x = f32::NAN), KnotError::NotFinite(2));
        assert_eq!(broken(|k| k[1].half_width_right = f32::INFINITY), KnotError::NotFinite(1));
        assert_eq!(broken(|k| k[1].half_width_left = -1e-6), KnotError::NegativeWidth(1));
        assert_eq!(broken(|k| k[3].across *= 1.1), KnotError::AcrossNotUnit(3, 1.1));
        assert_eq!(broken(|k| k[3].position = k[2].position), KnotError::ArcLengthStalls(3));
    }

    #[test]
    fn kind_follows_length_over_width() {
        let blade = |length| Blade::new(BladeId([0; 16]), "a", straight(3), [length, 0.005], 0, 1.0);
        assert_eq!(blade(0.1).expect("valid").kind(), Kind::Blade);
        assert_eq!(blade(0.02).expect("valid").kind(), Kind::Leaf);
    }

    #[test]
    fn id_depends_on_time_index_and_knots() {
        let id = BladeId::of(1, 0, &straight(3));
        assert_eq!(id, BladeId::of(1, 0, &straight(3)));
        assert_ne!(id, BladeId::of(2, 0, &straight(3)));
        assert_ne!(id, BladeId::of(1, 1, &straight(3)));
        assert_ne!(id, BladeId::of(1, 0, &straight(4)));
        assert_eq!(id.to_string().len(), 32);
    }
}
