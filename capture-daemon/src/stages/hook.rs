//! Ribbons that turn where their blade does not: into the corner of an outline, or back over themselves.

use glam::Vec2;

use super::ribbon::{MIN_SEED_PX, Section};
use super::section::Expected;
use super::skeleton;

/// Sections that tell the direction of an end.
const REACH: usize = 24;

/// Leaves out the last sections where they hook into the corner of an outline, by more than 60°: what goes on
/// from there goes astray. A stretch no longer than its end is left as it is.
pub(super) fn unhook(sections: &mut Vec<Section>) {
    let last = sections.len() - 1;
    if last < REACH || sections[last].expected.along().dot(way(sections, last, REACH)) > 0.5 {
        return;
    }
    let hooked = skeleton::curl(&|from_end| &sections[last - from_end].expected, last + 1);
    sections.truncate((last + 1 - hooked).max(MIN_SEED_PX));
}

/// Unit vector along the `count` sections before a section, towards it.
pub(super) fn way(sections: &[Section], last: usize, count: usize) -> Vec2 {
    (sections[last].expected.mid - sections[last.saturating_sub(count)].expected.mid).normalize_or_zero()
}

/// The section that the last one lies on again, on its way back over the blade that it came from.
pub(super) fn doubled_back(sections: &[Section]) -> Option<usize> {
    let last = sections.len() - 1;
    let Expected { mid, half_px, .. } = sections[last].expected;
    let back = way(sections, last, 4);
    let apart = 8 + (4.0 * half_px) as usize;
    (0..last.saturating_sub(apart)).rev().find(|before| {
        let near = sections[*before].expected.mid.distance_squared(mid) < half_px * half_px;
        near && way(sections, *before, 4).dot(back) < -0.5
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::ribbon::ANCHOR;
    use crate::stages::section::{Fold, Measured, Middle};

    /// Sections `step_px` apart, each of which turns by so much after the one before.
    fn walk(sections: &mut Vec<Section>, count: usize, step_px: f32, turn: f32) {
        for _ in 0..count {
            let (mid, along) = sections.last().map_or((Vec2::ZERO, Vec2::NEG_Y), |last| {
                (last.expected.mid, Vec2::from_angle(turn).rotate(last.expected.along()))
            });
            let expected = Expected {
                mid: mid + step_px * along,
                across: along.perp(),
                half_px: 6.0,
                depth_m: 0.5,
                slope_m: 0.0,
                fold: Fold::default(),
                tolerance_m: 0.002,
                search_px: 2.0,
            };
            let measured = Measured::nothing(Middle::Unseen);
            sections.push(Section { expected, measured, anchor: ANCHOR, guide_px: None });
        }
    }

    #[test]
    fn a_hook_at_the_end_is_left_out() {
        let mut sections = Vec::new();
        walk(&mut sections, 60, 1.0, 0.0);
        walk(&mut sections, 10, 0.5, 0.2);
        unhook(&mut sections);
        assert!((52..=62).contains(&sections.len()), "{} of 60 are straight", sections.len());
        let end = sections[sections.len() - 1].expected;
        assert!(end.along().dot(Vec2::NEG_Y) > 0.9, "{}", end.along());
    }

    #[test]
    fn a_blade_that_bends_as_blades_do_is_left_whole() {
        let mut sections = Vec::new();
        walk(&mut sections, 100, 1.0, 0.02);
        let whole = sections.clone();
        unhook(&mut sections);
        assert_eq!(sections, whole);
        let mut short = Vec::new();
        walk(&mut short, 10, 1.0, 0.0);
        walk(&mut short, 8, 0.5, 0.2);
        unhook(&mut short);
        assert_eq!(short.len(), 18, "of a short stretch it cannot be told what is its hook");
    }
}
