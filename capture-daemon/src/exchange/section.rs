//! Cross-sections of an outline, at right angles to a midrib: how far the outline reaches to both sides.
//!
//! A blade has one half width to a side, so of a section that leaves the outline and enters it again (between
//! lobes, through teeth, in the notch of a heart) the half width is taken with which the least is wrong: what
//! it leaves out and what it fills are as long together as for no other.

use common::geometry::polyline;
use glam::Vec2;

use super::outline::Outline;

/// Sections of an outline: enough that each tooth of a leaf is met some times.
pub(super) const SECTIONS: usize = 1024;
/// A section looks along the midrib over this share of the sections, to both sides.
const WINDOW: f32 = 1.0 / 64.0;
/// What is this much nearer to another place of the midrib is of that place.
const OWN: f32 = 0.9;

/// A cross-section as drawn: the midrib, the unit vector to the right, half of the width to both sides; millimetres.
pub(super) type Section = (Vec2, Vec2, [f32; 2]);

/// The half width to one side with which the least is wrong.
///
/// `crossings`: distances at which the outline is crossed, rising; `is_inside`: whether it begins inside. Gives the
/// half width and how much is wrong with it. O(crossings).
///
/// ```text
///  midrib |#####    ######   |      inside 5, a gap of 4, inside 6
///         0    5    9    15         15 fills 4, 5 leaves out 6: 15
/// ```
fn half_width(is_inside: bool, crossings: &[f32]) -> (f32, f32) {
    let mut stretches = crossings.iter().scan((0.0, is_inside), |(from, inside), to| {
        let stretch = (*from, *to, *inside);
        (*from, *inside) = (*to, !*inside);
        Some(stretch)
    });
    let all: f32 = stretches.clone().filter(|(.., inside)| *inside).map(|(from, to, _)| to - from).sum();
    let (mut wrong, mut best) = (all, (0.0, all));
    for (from, to, inside) in &mut stretches {
        wrong += if inside { from - to } else { to - from };
        if wrong < best.1 {
            best = (to, wrong);
        }
    }
    best
}

/// Where the midrib points `along` at its point `k`, seen over `window` points to both sides.
fn along(mids: &[Vec2], k: usize, window: usize) -> Vec2 {
    let (from, to) = (k.saturating_sub(window), (k + window).min(mids.len() - 1));
    (mids[to] - mids[from]).normalize_or(Vec2::Y)
}

/// Half widths to both sides at a point of a midrib, of which some points are given, and how much is wrong with
/// them; `None` where the outline is not around it: it is left out of it, and not between two of its lobes.
fn halves(outline: &Outline, at: Vec2, across: Vec2, midrib: &[Vec2]) -> Option<([f32; 2], f32)> {
    let is_inside = outline.contains(at);
    let sides = [-across, across].map(|way| {
        let mut crossings = outline.crossings(at, way);
        let is_own = |reach: f32| {
            let there = at + way * reach;
            midrib.iter().all(|other| other.distance(there) >= OWN * reach)
        };
        let foreign = crossings.iter().skip(usize::from(is_inside)).position(|reach| !is_own(*reach));
        if let Some(foreign) = foreign {
            let mut kept = foreign + usize::from(is_inside);
            // What begins here and ends over there is not ours.
            kept -= usize::from((kept % 2 == 0) == is_inside && kept > 1);
            crossings.truncate(kept);
        }
        half_width(is_inside, &crossings)
    });
    let is_around = is_inside || sides.iter().all(|(half, _)| *half > 0.0);
    is_around.then(|| (sides.map(|(half, _)| half), sides[0].1 + sides[1].1))
}

/// Some points of a midrib, enough to tell what belongs to which part of it.
fn some(mids: &[Vec2]) -> Vec<Vec2> {
    polyline::resample(mids, 48)
}

/// [`SECTIONS`] sections along a midrib (≥ 2 points), from root to tip. Where the outline is not around the midrib
/// the widths are 0. O(sections · points).
pub(super) fn sections(outline: &Outline, midrib: &[Vec2]) -> Vec<Section> {
    let mids = polyline::resample(midrib, SECTIONS);
    let (some, window) = (some(&mids), (WINDOW * SECTIONS as f32) as usize);
    let length = polyline::length(&mids);
    let mut all: Vec<Section> = Vec::with_capacity(SECTIONS);
    for k in 0..SECTIONS {
        let along = along(&mids, k, window);
        let across = Vec2::new(along.y, -along.x);
        // The very ends lie on the outline, and just beside it.
        let inward = if k == 0 { 1e-4 } else { -1e-4 * f32::from(u8::from(k + 1 == SECTIONS)) };
        let found = halves(outline, mids[k] + along * inward * length, across, &some);
        all.push((mids[k], across, found.map_or([0.0; 2], |(halves, _)| halves)));
    }
    all
}

/// What share of the outline's sections along a straight midrib is wrong, and how much its two sides differ, both as
/// shares of the width. O(sections · points).
pub(super) fn misfit(outline: &Outline, [root, tip]: [Vec2; 2], sections: usize) -> [f32; 2] {
    let mids = polyline::resample(&[root, tip], sections);
    let along = along(&mids, 0, 1);
    let across = Vec2::new(along.y, -along.x);
    let (mut width, mut wrong, mut aside) = (f32::MIN_POSITIVE, 0.0, 0.0);
    for mid in &mids {
        if let Some(([left, right], missed)) = halves(outline, *mid, across, &[]) {
            width += left + right;
            wrong += missed;
            aside += (left - right).abs();
        }
    }
    [wrong / width, aside / width]
}

/// A midrib brought to where the outline ends: what stands out of it is cut off, and where it ends within, it
/// goes on straight. `None` when it is not in the outline at all. O(sections · points).
pub(super) fn to_the_outline(outline: &Outline, midrib: &[Vec2]) -> Option<Vec<Vec2>> {
    /// Of its length, a midrib is carried on by this share to either side.
    const FARTHEST: f32 = 0.3;
    const STEPS: usize = SECTIONS / 2;
    let mut mids = polyline::resample(midrib, STEPS);
    let (some, window, step) = (some(&mids), STEPS / 32, polyline::length(&mids) / STEPS as f32);
    let is_around =
        |at: Vec2, along: Vec2| halves(outline, at, Vec2::new(along.y, -along.x), &some).is_some();
    let around: Vec<bool> = (0..STEPS).map(|k| is_around(mids[k], along(&mids, k, window))).collect();
    let first = around.iter().position(|it| *it)?;
    let last = around.iter().rposition(|it| *it)?;
    // One that ends on the outline is as long as it is drawn.
    let (first, last) = (first.saturating_sub(1), (last + 1).min(STEPS - 1));
    let is_cut = [first > 0, last + 1 < STEPS];
    mids.truncate(last + 1);
    mids.drain(..first);
    for is_cut in [is_cut[1], is_cut[0]] {
        let end = mids.len() - 1;
        let ahead = along(&mids, end, window) * step;
        let mut at = mids[end] + ahead;
        for _ in 0..(FARTHEST * STEPS as f32) as usize {
            if is_cut || !is_around(at, ahead.normalize_or(Vec2::Y)) {
                break;
            }
            mids.push(at);
            at += ahead;
        }
        mids.reverse();
    }
    (mids.len() > 2).then_some(mids)
}

/// `count` sections at equal steps, each with the mean half widths of those around it: over `1 / windows` of the length;
/// 0 windows: as they are. At the ends the window narrows, so that a point stays one. O(sections).
pub(super) fn smoothed(sections: &[Section], count: usize, windows: usize) -> Vec<Section> {
    let n = sections.len();
    let sums = |side: usize| {
        let mut sum = vec![0.0_f64];
        sum.extend(sections.iter().scan(0.0, |sum, section| {
            *sum += f64::from(section.2[side]);
            Some(*sum)
        }));
        sum
    };
    let sums = [sums(0), sums(1)];
    let half = n.checked_div(2 * windows).unwrap_or(0);
    let at = |k: usize| {
        let index = (k * (n - 1) + (count - 1) / 2) / (count - 1);
        let reach = half.min(index).min(n - 1 - index);
        let (from, to) = (index - reach, index + reach + 1);
        let halves = [0, 1].map(|side| ((sums[side][to] - sums[side][from]) / (to - from) as f64) as f32);
        (sections[index].0, sections[index].1, halves)
    };
    (0..count).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(half: f32) -> Outline {
        Outline {
            points: [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
                .map(|(x, y)| Vec2::new(x, y) * half)
                .into(),
        }
    }

    #[test]
    fn the_half_width_is_the_one_with_which_the_least_is_wrong() {
        assert_eq!(half_width(true, &[5.0]), (5.0, 0.0));
        assert_eq!(half_width(true, &[5.0, 9.0, 15.0]), (15.0, 4.0));
        assert_eq!(half_width(true, &[5.0, 15.0, 18.0]), (5.0, 3.0));
        assert_eq!(half_width(false, &[2.0, 7.0]), (7.0, 2.0));
        assert_eq!(half_width(false, &[9.0, 12.0]), (0.0, 3.0));
        assert_eq!(half_width(false, &[]), (0.0, 0.0));
    }

    #[test]
    fn a_midrib_is_cut_where_it_stands_out_and_goes_on_where_it_ends_within() {
        let of = square(10.0);
        for (from, to) in [(-30.0, 30.0), (-8.0, 7.0), (-10.0, 10.0)] {
            let mids =
                to_the_outline(&of, &[Vec2::new(1.0, from), Vec2::new(1.0, to)]).expect("it is in there");
            let ends = [mids[0], mids[mids.len() - 1]];
            let step = (to - from) / 256.0;
            assert!((ends[0].y + 10.0).abs() <= step && (ends[1].y - 10.0).abs() <= step, "{ends:?}");
        }
        assert_eq!(to_the_outline(&of, &[Vec2::new(20.0, -5.0), Vec2::new(20.0, 5.0)]), None);
    }

    #[test]
    fn teeth_are_evened_out_and_points_stay() {
        let section = |k: usize| {
            let width = 10.0 * (1.0 - k as f32 / 1023.0) + if k % 8 < 4 { 0.5 } else { -0.5 };
            (Vec2::Y * k as f32, Vec2::X, [width.max(0.0); 2])
        };
        let all: Vec<Section> = (0..SECTIONS).map(section).collect();
        let even = smoothed(&all, 33, 32);
        assert_eq!(even.len(), 33);
        assert!((even[16].2[0] - 5.0).abs() < 0.05, "{:?}", even[16]);
        assert!(even[32].2[1] < 0.01 && even[32].0 == Vec2::Y * 1023.0, "{:?}", even[32]);
        assert_eq!(smoothed(&all, 128, 0)[0].2, all[0].2);
    }
}
