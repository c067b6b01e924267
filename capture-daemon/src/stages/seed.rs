//! Part → the first cross-sections of a ribbon, between the two sides of its outline.

use common::geometry::polyline;
use glam::Vec2;

use super::mask::Mask;
use super::partition::{Part, Side};
use super::rank::Few;
use super::ribbon::{ANCHOR, MIN_SEED_PX, Section, tolerance_m};
use super::section::{Expected, Fold, Measured, Middle};
use super::settle::{across_at, slopes};

/// The stretch that the outline shows, from the part's base to its tip.
pub(super) fn seed(mask: &Mask, part: &Part) -> Option<Vec<Section>> {
    let (midrib, widths) = matched_sides(part)?;
    let cumulative = polyline::cumulative_length(&midrib);
    let count = cumulative.last()?.round() as usize;
    if count < MIN_SEED_PX {
        return None;
    }
    let places: Vec<(usize, f32)> = polyline::locate_evenly(&cumulative, count).collect();
    let mids: Vec<Vec2> = places.iter().map(|&(k, t)| midrib[k].lerp(midrib[k + 1], t)).collect();
    let tolerance_m = tolerance_m(mask);
    // The very end may be too thin for a reading.
    let first_depth_m = mids.iter().find_map(|mid| depth_near(mask, part.label, *mid))?;
    let mut sections: Vec<Section> = Vec::with_capacity(count);
    for (i, (k, t)) in places.into_iter().enumerate() {
        let half_px = 0.5 * (widths[k] + (widths[k + 1] - widths[k]) * t);
        let across = across_at(&mids, i);
        let known = depth_near(mask, part.label, mids[i]);
        let depth_m = known.or(sections.last().map(|s| s.expected.depth_m)).unwrap_or(first_depth_m);
        let expected = Expected {
            mid: mids[i],
            across,
            half_px,
            depth_m,
            slope_m: 0.0,
            fold: Fold::default(),
            tolerance_m,
            search_px: 2.5 + 0.3 * half_px,
        };
        let slope_moments = slope_moments(mask, part.label, &expected);
        let measured = Measured { slope_moments, ..Measured::nothing(Middle::Blade) };
        sections.push(Section { expected, measured, anchor: ANCHOR, guide_px: None });
    }
    let slopes = slopes(&sections);
    for (section, slope_m) in sections.iter_mut().zip(slopes) {
        section.expected.slope_m = slope_m;
        section.measured = section.expected.measure(mask);
    }
    Some(sections)
}

/// Σ t·(z − expected) and Σ t² over the piece's readings between both sides: a broad blade that is turned
/// aside leaves the depths that are tolerated long before its edges.
fn slope_moments(mask: &Mask, piece: u16, expected: &Expected) -> [f32; 2] {
    let reach = (0.8 * expected.half_px) as i32;
    let reading = |k: i32| {
        let index = mask.index_at(expected.mid + expected.across * k as f32)?;
        let inside = mask.pieces.of[index] == piece && mask.occupancy[index] > 0.85;
        inside.then(|| (k as f32, mask.depth_m[index] - expected.depth_m))
    };
    let readings = (-reach..=reach).filter_map(reading);
    readings.fold([0.0; 2], |[tz, tt], (t, z)| [tz + t * z, tt + t * t])
}

/// Median depth of the piece's pixels around a point.
fn depth_near(mask: &Mask, piece: u16, point: Vec2) -> Option<f32> {
    const REACH: usize = 2;
    let center = mask.index_at(point)?;
    let (x, y) = (center % mask.width, center / mask.width);
    let mut depths = Few::default();
    let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(mask.width);
    for v in y.saturating_sub(REACH)..(y + REACH + 1).min(mask.height) {
        let row = v * mask.width + columns.start..v * mask.width + columns.end;
        let pixels = mask.pieces.of[row.clone()].iter().zip(&mask.occupancy[row.clone()]);
        for ((of, occupancy), depth) in pixels.zip(&mask.depth_m[row]) {
            if (*of == piece) & (*occupancy > 0.85) {
                depths.push(*depth);
            }
        }
    }
    (depths.len() > 0).then(|| {
        let [median] = depths.ranked([depths.len() / 2]);
        median
    })
}

/// Midpoints of the points on both sides at equal distance from the root, and their distances.
fn matched_sides(part: &Part) -> Option<(Vec<Vec2>, Vec<f32>)> {
    let lowest = |side: &Side| side.flow_px.first().copied();
    let from = lowest(&part.left)?.max(lowest(&part.right)?);
    let to = part.left.flow_px.last().copied()?;
    let levels = ((to - from) as usize).max(1);
    if to - from < 6.0 {
        return None;
    }
    let at = |side: &Side, passed: &mut usize, level: f32| {
        // Flow can waver; the first point that reaches the level is the one that counts.
        let reached = side.flow_px[*passed..].iter().position(|flow| *flow >= level);
        let index = reached.map_or(side.points.len() - 1, |more| *passed + more);
        *passed = index;
        let before = index.saturating_sub(1);
        let (low, high) = (side.flow_px[before], side.flow_px[index]);
        let t = if high > low { ((level - low) / (high - low)).clamp(0.0, 1.0) } else { 1.0 };
        side.points[before].lerp(side.points[index], t)
    };
    // Levels rise: what did not reach one does not reach the next.
    let [mut passed_left, mut passed_right] = [0; 2];
    let mut sides: Vec<(Vec2, f32)> = (0..=levels)
        .map(|k| from + (to - from) * k as f32 / levels as f32)
        .map(|level| (at(&part.left, &mut passed_left, level), at(&part.right, &mut passed_right, level)))
        .map(|(left, right)| (left.midpoint(right), left.distance(right)))
        .collect();
    sides.dedup_by(|a, b| a.0.distance(b.0) < 1e-3);
    (sides.len() >= 2).then(|| sides.into_iter().unzip())
}
