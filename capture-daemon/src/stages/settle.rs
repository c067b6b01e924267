//! A ribbon's sections, smoothed along it and measured anew where that puts them.

use common::geometry::smooth::Penalised;
use glam::Vec2;

use super::margin;
use super::mask::Mask;
use super::ribbon::{MIN_SEED_PX, Section, tolerance_m};
use super::section::{Expected, Fold, Measured, Middle};

/// Half-height wavelengths of the smoothing along a ribbon, pixels.
const WIDTH_WAVELENGTH_PX: f64 = 16.0;
const DEPTH_WAVELENGTH_PX: f64 = 48.0;
/// σ of the window in which the slope across is fitted, pixels.
const SLOPE_WINDOW_PX: f32 = 9.0;
/// What the middle of a section counts that the border of the region cuts off.
const CUT_OFF: f64 = 0.01;

/// Smooths a ribbon over its whole length and measures it anew.
pub(super) fn settle(mask: &Mask, sections: &mut [Section], wavelength_px: f64) {
    // What is guided may be widest where it is hidden; the edges of a single frame do not tell how wide.
    let known = |s: &Section| match s.guide_px {
        Some(half_px) if mask.frames >= 4 => Some(f64::from(half_px)),
        _ => (s.edges_seen() == 2).then(|| measured_half(s)),
    };
    let mut widest = sections.iter().filter_map(known).fold(0.5, f64::max);
    // A strip beside what hides its other edge is as wide as it was found.
    if sections.iter().filter_map(known).nth(MIN_SEED_PX - 1).is_none() {
        widest = sections.iter().map(measured_half).fold(widest, f64::max);
    }
    smooth_and_measure(mask, sections, wavelength_px, widest, 0.0);
}

/// The same for sections that are but guessed: edges may be farther from where they are expected.
pub(super) fn settle_roughly(mask: &Mask, sections: &mut [Section], wavelength_px: f64) {
    let widest = sections.iter().map(measured_half).fold(0.5, f64::max);
    smooth_and_measure(mask, sections, wavelength_px, widest, 0.3);
}

fn measured_half(section: &Section) -> f64 {
    let (low, high) =
        section.guide_px.map_or((0.0, f64::INFINITY), |px| (0.9 * f64::from(px), 1.05 * f64::from(px)));
    let half = match (section.measured.left_px, section.measured.right_px) {
        (Some(left), Some(right)) => f64::from(0.5 * (right - left)),
        _ => f64::from(section.expected.half_px),
    };
    half.clamp(low, high)
}

/// `widest`: bound of the half width, pixels; `search`: how far beyond 2 px an edge may be from where it
/// is expected, in half widths.
fn smooth_and_measure(mask: &Mask, sections: &mut [Section], wavelength_px: f64, widest: f64, search: f32) {
    // Where a blade is only guided, what is seen may be its neighbour's.
    let of_it =
        |s: &Section| if s.guide_px.is_some() && s.edges_seen() == 0 { 0 } else { s.measured.readings };
    let readings = || sections.iter().map(|s| f64::from(of_it(s)));
    let mean = readings().sum::<f64>() / readings().filter(|r| *r > 0.0).count().max(1) as f64;
    // Of half the width, both coordinates of the middle, and depth. Where one of them is not seen, what was
    // expected counts a little, so that it does not run away.
    let weight = |s: &Section| {
        let both = if s.edges_seen() == 2 { 1.0 } else { 0.02 };
        let seen = f64::from(s.weight());
        // What the border of the region leaves of it leads aside.
        let seen = if margin::is_cut_off(mask, &s.expected) { seen.min(CUT_OFF) } else { seen };
        let place = seen.max(f64::from(s.anchor));
        [both, place, place, (f64::from(of_it(s)) / mean.max(1.0)).max(0.002)]
    };
    let sample = |s: &Section| {
        let (mid, depth_m) = (s.middle(), s.measured.depth_m.unwrap_or(s.expected.depth_m));
        [measured_half(s), f64::from(mid.x), f64::from(mid.y), f64::from(depth_m)]
    };
    let wavelengths = [WIDTH_WAVELENGTH_PX, wavelength_px, wavelength_px, DEPTH_WAVELENGTH_PX];
    let smooth = Penalised::new(sections.iter().map(weight).collect(), wavelengths)
        .smooth(sections.iter().map(sample).collect());
    let mids: Vec<Vec2> = smooth.iter().map(|[_, x, y, _]| Vec2::new(*x as f32, *y as f32)).collect();
    let slopes = slopes(sections);
    let tolerance = tolerance_m(mask);
    for (i, [half_px, _, _, depth_m]) in smooth.into_iter().enumerate() {
        let half_px = half_px.clamp(0.3, widest) as f32;
        let across = across_at(&mids, i);
        let expected = Expected {
            mid: mids[i],
            across,
            half_px,
            depth_m: depth_m as f32,
            slope_m: slopes[i],
            fold: fold_from(&sections[i].expected, mids[i], across),
            tolerance_m: tolerance,
            search_px: 2.0 + search * half_px,
        };
        let section = &mut sections[i];
        section.measured = moved(section, &expected).unwrap_or_else(|| expected.measure(mask));
        section.expected = expected;
        section.doubt();
    }
}

/// The fold of a section, which stays where it is, as seen from the middle `mid`.
fn fold_from(Expected { mid: before, fold, .. }: &Expected, mid: Vec2, across: Vec2) -> Fold {
    let folded = fold.slope_m != 0.0;
    Fold { at_px: if folded { fold.at_px - (mid - *before).dot(across) } else { 0.0 }, ..*fold }
}

/// What was measured, as seen from a place so near that it would be measured alike: the edges stay where
/// they are in the image.
pub(super) fn moved(Section { expected, measured, .. }: &Section, to: &Expected) -> Option<Measured> {
    const NEAR_PX: f32 = 0.25;
    const NEAR_TOLERANCES: f32 = 0.25;
    let by = to.mid - expected.mid;
    let aside = by.dot(to.across);
    let turned_px = (to.across - expected.across).length() * to.half_px;
    let tilted_m = (to.slope_m - expected.slope_m) * to.half_px;
    // Where less is searched, its edges have to be found all the same.
    let within = |edge: Option<f32>| edge.is_none_or(|e| (e - aside).abs() <= to.half_px + to.search_px);
    let near = by.length() + turned_px < NEAR_PX
        && (to.half_px - expected.half_px).abs() < 3.0 * NEAR_PX
        && to.search_px < expected.search_px + 3.0 * NEAR_PX
        && within(measured.left_px)
        && within(measured.right_px)
        && (to.depth_m - expected.depth_m).abs() + tilted_m.abs() < NEAR_TOLERANCES * to.tolerance_m
        && to.tolerance_m == expected.tolerance_m
        && to.fold.slope_m == expected.fold.slope_m;
    if !near || measured.middle != Middle::Blade {
        return None;
    }
    let [moment, square] = measured.slope_moments;
    Some(Measured {
        left_px: measured.left_px.map(|left| left - aside),
        right_px: measured.right_px.map(|right| right - aside),
        slope_moments: [moment + (expected.slope_m - to.slope_m) * square, square],
        ..*measured
    })
}

/// Slope of depth across, fitted in a window along the ribbon.
pub(super) fn slopes(sections: &[Section]) -> Vec<f32> {
    // What a slope is expected to be against the noise of one reading (1 px to the side, 0.4 mm of
    // noise, 0.6 mm a px of slope): keeps the fit calm where there are but a few pixels.
    const RIDGE: f32 = 0.5;
    let half = (3.0 * SLOPE_WINDOW_PX) as usize;
    let weights: Vec<f32> = (0..=half)
        .map(|away| {
            let away = away as f32 / SLOPE_WINDOW_PX;
            (-0.5 * away * away).exp()
        })
        .collect();
    let moments = sections.iter().map(|Section { expected, measured, guide_px, .. }| {
        let [moment, square] = measured.slope_moments;
        // The moments are those of what was left over the slope expected then.
        if guide_px.is_some() { (0.0, 0.0) } else { (moment + expected.slope_m * square, square) }
    });
    let (moments, squares): (Vec<f32>, Vec<f32>) = moments.unzip();
    // One neighbour after the other for all sections together: the processor adds several at a time.
    let n = sections.len();
    let around = |values: &[f32], start: f32| {
        let mut sums = vec![start; n];
        for away in (1..=half.min(n)).rev() {
            sums[away..].iter_mut().zip(values).for_each(|(sum, value)| *sum += weights[away] * value);
        }
        for away in 0..=half.min(n) {
            sums.iter_mut().zip(&values[away..]).for_each(|(sum, value)| *sum += weights[away] * value);
        }
        sums
    };
    let (fitted, weighed) = (around(&moments, 0.0), around(&squares, RIDGE));
    let mut slopes: Vec<f32> = fitted.iter().zip(&weighed).map(|(ta, tt)| ta / tt).collect();
    // Where a blade is only guided, what is seen may be its neighbour's: it goes on as it was.
    for i in (0..sections.len().saturating_sub(1)).rev() {
        if sections[i].guide_px.is_some() {
            slopes[i] = slopes[i + 1];
        }
    }
    slopes
}

/// Unit vector to the right of a midrib at one of its points.
pub(super) fn across_at(mids: &[Vec2], i: usize) -> Vec2 {
    let along = mids[(i + 2).min(mids.len() - 1)] - mids[i.saturating_sub(2)];
    let along = along.normalize_or(Vec2::NEG_Y);
    Vec2::new(-along.y, along.x)
}
