//! Numbers and vectors of several strands side by side, reckoned with together: each lane comes out to the
//! bit as if it were alone.

use std::array;
use std::ops::{Add, Div, Mul, Sub};

use glam::Vec3;

/// Strands side by side: two registers of any processor, so that one is reckoned while the other waits.
pub(super) const LANES: usize = 8;

/// One number for each strand.
#[derive(Clone, Copy, Debug)]
pub(super) struct Numbers(pub(super) [f32; LANES]);

/// One vector for each strand.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vectors {
    x: Numbers,
    y: Numbers,
    z: Numbers,
}

/// Whether something holds, for each strand: all bits or none, as processors tell it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Truths([u32; LANES]);

impl Truths {
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(array::from_fn(|lane| self.0[lane] & other.0[lane]))
    }

    /// Whether it holds for all of them.
    #[inline(always)]
    fn all(self) -> bool {
        self.0.into_iter().fold(u32::MAX, |all, holds| all & holds) == u32::MAX
    }
}

impl Numbers {
    #[inline(always)]
    pub(super) fn all(value: f32) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }

    #[inline(always)]
    pub(super) fn above(self, other: Self) -> Truths {
        Truths(array::from_fn(|lane| if self.0[lane] > other.0[lane] { u32::MAX } else { 0 }))
    }

    /// `self` where `holds`, else `other`.
    #[inline(always)]
    pub(super) fn or_where_not(self, holds: Truths, other: Self) -> Self {
        let bits = |lane: usize| {
            let (mine, theirs) = (self.0[lane].to_bits(), other.0[lane].to_bits());
            mine & holds.0[lane] | theirs & !holds.0[lane]
        };
        Self(array::from_fn(|lane| f32::from_bits(bits(lane))))
    }
}

macro_rules! by_lanes {
    ($trait:ident, $method:ident, $operator:tt) => {
        impl $trait for Numbers {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(array::from_fn(|lane| self.0[lane] $operator other.0[lane]))
            }
        }
    };
}
by_lanes!(Add, add, +);
by_lanes!(Sub, sub, -);
by_lanes!(Mul, mul, *);
by_lanes!(Div, div, /);

impl Vectors {
    #[inline(always)]
    pub(super) fn all(value: Vec3) -> Self {
        let [x, y, z] = value.to_array().map(Numbers::all);
        Self { x, y, z }
    }

    pub(super) fn from_lanes(of_lane: impl Fn(usize) -> Vec3) -> Self {
        let [x, y, z] = [0, 1, 2].map(|axis| Numbers(array::from_fn(|lane| of_lane(lane)[axis])));
        Self { x, y, z }
    }

    pub(super) fn lane(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x.0[lane], self.y.0[lane], self.z.0[lane])
    }

    #[inline(always)]
    pub(super) fn dot(self, other: Self) -> Numbers {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    pub(super) fn cross(self, other: Self) -> Self {
        Self {
            x: self.y * other.z - other.y * self.z,
            y: self.z * other.x - other.z * self.x,
            z: self.x * other.y - other.x * self.y,
        }
    }

    #[inline(always)]
    pub(super) fn length(self) -> Numbers {
        self.dot(self).sqrt()
    }

    /// Its unit vector, `fallback` where it has none.
    #[inline(always)]
    pub(super) fn unit_or(self, fallback: Self) -> Self {
        self.unit_or_else(|| fallback)
    }

    /// The same with a fallback that is reckoned out only if a strand needs it.
    #[inline(always)]
    pub(super) fn unit_or_else(self, fallback: impl FnOnce() -> Self) -> Self {
        let per_length = Numbers::all(1.0) / self.length();
        let finite = Numbers::all(f32::INFINITY).above(per_length);
        let has_one = finite.and(per_length.above(Numbers::all(0.0)));
        let unit = self * per_length;
        if has_one.all() { unit } else { unit.or_where_not(has_one, fallback()) }
    }

    /// `self` where `holds`, else `other`.
    #[inline(always)]
    pub(super) fn or_where_not(self, holds: Truths, other: Self) -> Self {
        Self {
            x: self.x.or_where_not(holds, other.x),
            y: self.y.or_where_not(holds, other.y),
            z: self.z.or_where_not(holds, other.z),
        }
    }
}

impl Add for Vectors {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }
}

impl Sub for Vectors {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}

impl Mul<Numbers> for Vectors {
    type Output = Self;
    #[inline(always)]
    fn mul(self, by: Numbers) -> Self {
        Self { x: self.x * by, y: self.y * by, z: self.z * by }
    }
}
