//! Where a ribbon runs in the picture, and whether another one runs there too.

use glam::Vec2;

use super::mask::Mask;
use super::ribbon::{Section, tolerance_m};

/// The place of a ribbon in the picture, to tell whether others lie on it.
pub(super) struct Course<'a> {
    sections: &'a [Section],
    /// Bounding box of what it reaches.
    reached: Extent,
    /// The same of each [`BLOCK`] of its sections.
    blocks: Vec<Extent>,
}

/// Sections that are passed over together.
const BLOCK: usize = 16;

/// A box in the image, pixels.
#[derive(Clone, Copy)]
struct Extent {
    low: Vec2,
    high: Vec2,
}

impl Extent {
    fn around(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn has(&self, point: Vec2) -> bool {
        point.cmpge(self.low).all() && point.cmple(self.high).all()
    }
}

impl<'a> Course<'a> {
    pub(super) fn of(sections: &'a [Section]) -> Self {
        let reached = |section: &Section| {
            let (mid, reach) = (section.expected.mid, Vec2::splat(Self::reach_px(section)));
            Extent { low: mid - reach, high: mid + reach }
        };
        let nothing = Extent { low: Vec2::INFINITY, high: Vec2::NEG_INFINITY };
        let block = |sections: &[Section]| sections.iter().map(reached).fold(nothing, Extent::around);
        let blocks: Vec<Extent> = sections.chunks(BLOCK).map(block).collect();
        Self { sections, reached: blocks.iter().copied().fold(nothing, Extent::around), blocks }
    }

    fn reach_px(section: &Section) -> f32 {
        section.expected.half_px.max(1.0) + 0.5
    }

    /// Whether a section lies on one of it at about the same depth.
    /// `guess`: one that may be it, and then is.
    fn has(&self, section: &Section, tolerance_m: f32, guess: &mut usize) -> bool {
        let mid = section.expected.mid;
        let lies_on = |own: &Section| {
            let near = own.expected.mid.distance(mid) < Self::reach_px(own);
            near && (own.expected.depth_m - section.expected.depth_m).abs() < tolerance_m
        };
        if self.sections.get(*guess).is_some_and(lies_on) {
            return true;
        }
        let near = self.blocks.iter().zip(self.sections.chunks(BLOCK)).enumerate();
        let found = near.filter(|(_, (reached, _))| reached.has(mid)).find_map(|(block, (_, sections))| {
            sections.iter().position(lies_on).map(|at| block * BLOCK + at)
        });
        *guess = found.unwrap_or(*guess);
        found.is_some()
    }

    /// Whether it has most of what is seen of another one.
    pub(super) fn covers(&self, other: &Self, mask: &Mask) -> bool {
        if self.reached.low.cmpgt(other.reached.high).any()
            || other.reached.low.cmpgt(self.reached.high).any()
        {
            return false;
        }
        let tolerance_m = 3.0 * tolerance_m(mask);
        let clear = || other.sections.iter().filter(|section| section.edges_seen() > 0);
        // Half of them that it does not have are enough to tell.
        let (mut left, mut guess) = (clear().count().div_ceil(2), 0);
        left > 0
            && clear().all(|section| {
                left -= usize::from(!self.has(section, tolerance_m, &mut guess));
                left > 0
            })
    }
}
