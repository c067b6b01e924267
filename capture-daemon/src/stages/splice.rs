//! One blade that was followed from both of its ends, put together again: blades do not branch.

use super::join::bridge;
use super::mask::Mask;
use super::ribbon::{End, Ribbon, Section, reverse, tolerance_m};

/// The last stretch of a blade on which another one that begins there is its own other end: a share of its
/// sections.
const LAST: f32 = 0.35;
/// Of the other one at most this share lies on it.
const OVERLAP: f32 = 0.5;
/// Shortest ribbon that is put together with another, sections.
const MIN_SECTIONS: usize = 12;
/// Sections over which a direction is told.
const REACH: usize = 8;
/// Cosine of the largest angle between both where they meet.
const TURNED: f32 = -0.5;

/// Cosine of the least angle between two stretches that run against each other.
const AGAINST: f32 = -0.8;

/// Where one ribbon goes on as another one.
struct Seam {
    ribbons: [usize; 2],
    /// Sections of the first up to there, and the first one of the other that is beyond.
    sections: [usize; 2],
    /// Whether the other one leads to there with its root.
    turned: bool,
}

/// Joins each ribbon that begins on the last stretch of another one, and leads farther than that does, to it.
/// O(ribbons² · sections).
pub(super) fn join(mask: &Mask, ribbons: &mut Vec<Ribbon>) {
    ribbons.iter_mut().for_each(|ribbon| unfold(mask, ribbon));
    loop {
        let pairs = (0..ribbons.len()).flat_map(|i| (0..ribbons.len()).map(move |k| (i, k)));
        let ways = pairs.filter(|(i, k)| i != k).flat_map(|(i, k)| [(i, k, false), (i, k, true)]);
        let found = ways.filter_map(|(i, k, turned)| seam(mask, ribbons, [i, k], turned)).next();
        let Some(Seam { ribbons: [i, k], sections: [end, first], turned }) = found else { break };
        let mut other = ribbons[k].clone();
        if turned {
            turn(&mut other);
        }
        let ribbon = &mut ribbons[i];
        ribbon.sections.truncate(end);
        bridge(&mut ribbon.sections, other.sections[first]);
        ribbon.sections.extend_from_slice(&other.sections[first..]);
        ribbon.tip = other.tip;
        ribbons.remove(k);
    }
}

/// Ends a ribbon where it turns back over itself: it was put together of two stretches that lie on each other.
fn unfold(mask: &Mask, Ribbon { sections, tip, .. }: &mut Ribbon) {
    let n = sections.len();
    let along = |i: usize| {
        let i = i.clamp(REACH / 2, n - 1 - REACH / 2);
        sections[i + REACH / 2].expected.mid - sections[i - REACH / 2].expected.mid
    };
    if n < 4 * MIN_SECTIONS {
        return;
    }
    // Two that run against each other do not both lie within half of that angle of the first one.
    let first = along(0).normalize_or_zero();
    if (0..n).all(|i| along(i).normalize_or_zero().dot(first) > (0.5 * AGAINST.acos()).cos()) {
        return;
    }
    // What leads back may hook, lie a little aside, or go on beyond the root.
    let back = (n / 2..n).rev().find_map(|last| {
        let before = &sections[..last - 2 * MIN_SECTIONS];
        let at = nearest_on(mask, before, &sections[last])?;
        (along(at).normalize_or_zero().dot(along(last).normalize_or_zero()) < AGAINST).then_some((at, last))
    });
    let Some((first, last)) = back else { return };
    let turn = first.midpoint(last);
    let folded =
        (first..turn).filter(|i| nearest_on(mask, &sections[turn..=last], &sections[*i]).is_some()).count();
    if 2 * folded <= turn - first {
        return;
    }
    // Of its two courses that is right from which more was seen.
    let seen = |sections: &[Section]| sections.iter().map(Section::edges_seen).sum::<usize>();
    let mut back = sections[turn..=last].to_vec();
    sections.truncate(turn);
    if seen(&back) > seen(&sections[first..]) {
        sections.truncate(first);
        reverse(&mut back);
        sections.append(&mut back);
    }
    *tip = End::Lost;
}

fn turn(ribbon: &mut Ribbon) {
    reverse(&mut ribbon.sections);
    std::mem::swap(&mut ribbon.root, &mut ribbon.tip);
}

/// `turned`: whether the other one is looked at from its tip.
fn seam(mask: &Mask, ribbons: &[Ribbon], [i, k]: [usize; 2], turned: bool) -> Option<Seam> {
    let (ribbon, other) = (&ribbons[i].sections, &ribbons[k].sections);
    let (n, m) = (ribbon.len(), other.len());
    let far_end = if turned { ribbons[k].root } else { ribbons[k].tip };
    if ribbons[i].tip == End::Shared
        || n < MIN_SECTIONS
        || m < MIN_SECTIONS
        || turned && far_end == End::Shared
    {
        return None;
    }
    let at = |b: usize| &other[if turned { m - 1 - b } else { b }];
    let last = &ribbon[n - ((LAST * n as f32) as usize).max(1)..];
    let on = |b: usize| nearest_on(mask, last, at(b));
    // Its very end may hook.
    let start = (0..REACH.min(m)).find(|b| on(*b).is_some())?;
    let beyond = (start..m).find(|b| on(*b).is_none())?;
    let end = n - last.len() + on(beyond - 1)? + 1;
    let is_longer = m - beyond > n - end && m - beyond >= MIN_SECTIONS / 2;
    if beyond as f32 > OVERLAP * m as f32 || !is_longer || end < REACH {
        return None;
    }
    // Where it was led it leads to what was taken for its base.
    let first = (beyond..m).find(|b| at(*b).guide_px.is_none())?;
    let mid = |section: &Section| section.expected.mid;
    let along = mid(&ribbon[end - 1]) - mid(&ribbon[end - REACH]);
    let onward = mid(at((first + REACH).min(m - 1))) - mid(&ribbon[end - 1]);
    let ahead = along.normalize_or_zero().dot(onward.normalize_or_zero());
    let [wide, other_px] = [ribbon[end - 1].expected.half_px, at(first).expected.half_px];
    let alike = other_px < 1.8 * wide + 1.0 && wide < 3.0 * other_px + 1.0;
    // At what several share there is no telling which goes on as which.
    let shared = ribbons.iter().enumerate().any(|(other, ribbon)| {
        other != i && other != k && nearest_on(mask, &ribbon.sections, at(first)).is_some()
    });
    (ahead > TURNED && alike && !shared).then_some(Seam { ribbons: [i, k], sections: [end, first], turned })
}

/// The one of these sections nearest to another one that lies on them.
fn nearest_on(mask: &Mask, sections: &[Section], section: &Section) -> Option<usize> {
    let away = |own: &Section| own.expected.mid.distance_squared(section.expected.mid);
    let (nearest, own) = sections.iter().enumerate().min_by(|a, b| away(a.1).total_cmp(&away(b.1)))?;
    let near = away(own).sqrt() < own.expected.half_px.max(1.0) + 0.5;
    let off_m = (own.expected.depth_m - section.expected.depth_m).abs();
    (near && off_m < 3.0 * tolerance_m(mask)).then_some(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::accumulate::Accumulation;
    use crate::stages::mask::{self, MaskParams};
    use crate::stages::ribbon::ANCHOR;
    use crate::stages::section::{Expected, Fold, Measured, Middle};
    use glam::Vec2;

    /// A leaf that rises, bends over to the right and hangs down: its midrib a pixel apart.
    fn arch(k: usize) -> Vec2 {
        let (away, radius) = (k as f32 - 80.0, 30.0);
        let angle = (away / radius).clamp(0.0, std::f32::consts::PI);
        let beyond = (away - angle * radius).max(0.0);
        Vec2::new(
            100.0 + radius * (1.0 - angle.cos()),
            120.0 + (-away).max(0.0) - radius * angle.sin() + beyond,
        )
    }

    fn ribbon(places: impl Iterator<Item = Vec2>, [root, tip]: [End; 2]) -> Ribbon {
        let mids: Vec<Vec2> = places.collect();
        let section = |i: usize| {
            let expected = Expected {
                mid: mids[i],
                across: crate::stages::settle::across_at(&mids, i),
                half_px: 4.0,
                depth_m: 0.6,
                slope_m: 0.0,
                fold: Fold::default(),
                tolerance_m: 0.004,
                search_px: 2.0,
            };
            Section { expected, measured: Measured::nothing(Middle::Blade), anchor: ANCHOR, guide_px: None }
        };
        Ribbon { sections: (0..mids.len()).map(section).collect(), root, tip, unsure: 0 }
    }

    fn joined(mut ribbons: Vec<Ribbon>) -> Vec<Ribbon> {
        let params = MaskParams::default();
        let frame = crate::frame::DepthFrame {
            width: 200,
            height: 220,
            depth: vec![600; 200 * 220],
            depth_unit_m: 0.001,
            timestamp_ns: 0,
            camera: crate::frame::CameraModel { fx: 570.0, fy: 570.0, cx: 100.0, cy: 100.0 },
        };
        let mut accumulation = Accumulation::like(&frame);
        accumulation.add(&frame, &params);
        join(&mask::extract(&accumulation, &params), &mut ribbons);
        ribbons
    }

    #[test]
    fn a_leaf_followed_from_both_ends_is_one() {
        let lower = ribbon((0..120).map(arch), [End::Shared, End::Free]);
        // The other one runs from the tip back onto it, and on, straight.
        let upper = ribbon((105..220).rev().map(arch), [End::Free, End::Free]);
        for pair in [vec![lower.clone(), upper.clone()], vec![upper, lower]] {
            let joined = joined(pair);
            assert_eq!(joined.len(), 1);
            let mids: Vec<Vec2> = joined[0].sections.iter().map(|section| section.expected.mid).collect();
            assert_eq!((mids[0], mids[mids.len() - 1]), (arch(0), arch(219)));
            assert!(mids.windows(2).all(|pair| pair[0].distance(pair[1]) < 2.5), "{mids:?}");
        }
    }

    #[test]
    fn a_leaf_that_was_followed_on_and_back_ends_at_its_tip() {
        let there_and_back = (0..150).map(arch).chain((60..148).rev().map(|k| arch(k) + Vec2::new(0.6, 0.4)));
        let joined = joined(vec![ribbon(there_and_back, [End::Shared, End::Free])]);
        let sections = &joined[0].sections;
        assert!((145..155).contains(&sections.len()), "{} sections", sections.len());
        // An arch beside its stem does not.
        let whole = ribbon((0..220).map(arch), [End::Shared, End::Free]);
        assert_eq!(self::joined(vec![whole.clone()]), [whole]);
    }

    #[test]
    fn what_crosses_a_leaf_or_grows_beside_its_base_is_another() {
        let leaf = ribbon((0..150).map(arch), [End::Shared, End::Free]);
        let sideward = |from: Vec2, along: Vec2| (0..70).map(move |k| from + along * k as f32);
        let across = ribbon(sideward(arch(20), Vec2::new(0.8, -0.6)), [End::Shared, End::Free]);
        assert_eq!(joined(vec![leaf.clone(), across]).len(), 2);
        let back = ribbon(sideward(arch(140), (arch(100) - arch(140)).normalize()), [End::Shared, End::Free]);
        assert_eq!(joined(vec![leaf, back]).len(), 2);
    }
}
