//! The midrib of an outline for which none is drawn.
//!
//! That of a blade is found as before the camera: the outline is drawn as a depth image and goes through the capture
//! stages. What is broad, toothed or lobed has its midrib on the straight line about which it is most alike on both
//! sides, from its bottom to its top.

use common::geometry::polyline;
use glam::Vec2;

use super::outline::Outline;
use super::section;
use crate::frame::{CameraModel, DepthFrame};
use crate::pipeline::{self, PipelineParams};
use crate::stages::accumulate::Accumulation;
use crate::stages::skeleton::STATIONS;

/// Pixels of the picture in which a midrib is looked for, along the longer side of the outline, at most.
const PICTURE_PX: f32 = 900.0;
/// Pixels of the picture that an outline fills, at most: as blades do that are long and narrow. The time that the
/// stages take grows with it.
const FILLED_PX: f32 = 60_000.0;

/// The straight line, from the lowest to the highest of the outline along it, about which its two sides are most alike;
/// of those that lean by 60 degrees at most. O(points).
pub(super) fn straight(outline: &Outline) -> Vec<Vec2> {
    /// Degrees from one line that is tried to the next, and of the last.
    const STEP_DEG: i16 = 5;
    const STEEPEST_DEG: i16 = 60;
    const SECTIONS: usize = 128;
    let [low, high] = outline.bounds();
    let coarse = outline.thinned((high - low).max_element() / 1000.0);
    let coarse = if coarse.points.len() < 3 { outline } else { &coarse };
    let centre = coarse.centre();
    let line = |degrees: i16| {
        let up = Vec2::from_angle(f32::from(degrees).to_radians()).rotate(Vec2::Y);
        let heights = coarse.points.iter().map(|point| (*point - centre).dot(up));
        let (bottom, top) = heights.fold((0.0_f32, 0.0_f32), |(a, b), height| (a.min(height), b.max(height)));
        [centre + up * bottom, centre + up * top]
    };
    let score = |degrees: &i16| {
        let [wrong, aside] = section::misfit(coarse, line(*degrees), SECTIONS);
        wrong + 0.5 * aside + 0.1 * f32::from(degrees.abs()) / f32::from(STEEPEST_DEG)
    };
    let tried = (-STEEPEST_DEG..=STEEPEST_DEG).step_by(STEP_DEG as usize);
    let best = tried.map(|degrees| (score(&degrees), degrees)).min_by(|a, b| a.0.total_cmp(&b.0));
    line(best.map_or(0, |(_, degrees)| degrees)).into()
}

/// The midrib of an outline, as if it were held before the camera; `None` where the stages find no blade.
pub(super) fn found(outline: &Outline) -> Option<Vec<Vec2>> {
    const BORDER_PX: usize = 40;
    const DEPTH: u16 = 500;
    let [low, high] = outline.bounds();
    let mm_per_px = ((high - low).max_element() / PICTURE_PX).max((outline.area() / FILLED_PX).sqrt());
    let size = ((high - low) / mm_per_px).ceil();
    let (width, height) = (size.x as usize + 2 * BORDER_PX, size.y as usize + 2 * BORDER_PX);
    let border = Vec2::splat(BORDER_PX as f32);
    let to_px = |point: Vec2| Vec2::new(point.x - low.x, high.y - point.y) / mm_per_px + border;
    let from_px = |pixel: Vec2| {
        let at = (pixel - border) * mm_per_px;
        Vec2::new(low.x + at.x, high.y - at.y)
    };
    let in_px = Outline { points: outline.points.iter().map(|point| to_px(*point)).collect() };
    let mut depth = vec![2 * DEPTH; width * height];
    for (y, row) in depth.chunks_mut(width).enumerate() {
        for stretch in in_px.stretches(y as f32).chunks_exact(2) {
            let (from, to) = (stretch[0].ceil().max(0.0) as usize, stretch[1].ceil().max(0.0) as usize);
            row[from.min(width)..to.min(width)].fill(DEPTH);
        }
    }
    // As large as blades are before the camera: 200 mm.
    let focal = f64::from((high - low).max_element() / mm_per_px) * 0.5 / 0.2;
    let camera = CameraModel { fx: focal, fy: focal, cx: width as f64 / 2.0, cy: height as f64 / 2.0 };
    let frame = DepthFrame { width, height, depth, depth_unit_m: 0.001, timestamp_ns: 0, camera };
    let params = PipelineParams::default();
    let mut frames = Accumulation::like(&frame);
    frames.add(&frame, &params.mask);
    let steps = pipeline::capture(&frames, &camera, 0, &params);
    let longest = steps.skeletons.iter().max_by(|a, b| a.length_px.total_cmp(&b.length_px));
    let mids: Vec<Vec2> = longest?.stations.iter().map(|station| from_px(station.mid)).collect();
    // Of what was found in pixels the sides are more exact, and tell better where the ends are.
    let centred_once = centred(outline, &mids);
    Some(centred(outline, &to_the_ends(outline, centred(outline, &centred_once))))
}

/// Brings a midrib to the middle between the drawn sides.
fn centred(outline: &Outline, mids: &[Vec2]) -> Vec<Vec2> {
    const WINDOW: usize = 4;
    let n = mids.len();
    let middle = |k: usize| {
        if k == 0 || k + 1 == n {
            return mids[k];
        }
        let along = (mids[(k + WINDOW).min(n - 1)] - mids[k.saturating_sub(WINDOW)]).normalize_or(Vec2::Y);
        let reach = |way: Vec2| outline.reach(mids[k], way).filter(|_| outline.contains(mids[k]));
        let across = Vec2::new(along.y, -along.x);
        let aside = reach(across).unwrap_or(0.0) - reach(-across).unwrap_or(0.0);
        mids[k] + across * 0.5 * aside
    };
    (0..n).map(middle).collect()
}

/// Carries both ends of a midrib on to the outline as it bends before, instead of what leans into a corner there.
fn to_the_ends(outline: &Outline, mut mids: Vec<Vec2>) -> Vec<Vec2> {
    let step = polyline::length(&mids) / mids.len() as f32;
    let longest = mids.len() / 3;
    for _ in 0..2 {
        mids.reverse();
        let inner = mids.len() * 9 / 10;
        let along = (mids[inner] - mids[inner - 3]).normalize_or(Vec2::Y);
        let reach = |way: Vec2| outline.reach(mids[inner], way).unwrap_or(0.0);
        let width = reach(along.perp()) + reach(-along.perp());
        let doubtful = ((0.8 * width / step) as usize).clamp(2, mids.len() / 6);
        mids.truncate(mids.len() - doubtful);

        let trusted = mids.len();
        let (last, stretch) = (trusted - 1, trusted / 8);
        let chord = |from: usize| (mids[from + stretch] - mids[from]).normalize_or(along);
        let (before, after) = (chord(last - 2 * stretch), chord(last - stretch));
        let turn = before.angle_to(after) / stretch as f32;
        let mut ahead = Vec2::from_angle(0.5 * turn * stretch as f32).rotate(after);
        for _ in 0..longest {
            ahead = Vec2::from_angle(turn).rotate(ahead);
            let last = mids[mids.len() - 1];
            let left = outline.reach(last, ahead).filter(|left| *left < step);
            mids.push(last + ahead * left.unwrap_or(step));
            if left.is_some() {
                break;
            }
        }
        // It may pass beside a point that lies farther ahead.
        let end = mids[mids.len() - 1];
        let off = |point: &Vec2| ((*point - end).dot(ahead), (*point - end).dot(ahead.perp()).abs());
        let near = outline.points.iter().filter(|point| point.distance(end) < 0.6 * width);
        let point = near.max_by(|a, b| off(a).0.total_cmp(&off(b).0));
        if let Some(point) = point.filter(|point| off(point).0 > 0.7 * off(point).1) {
            mids.truncate(trusted);
            mids.push(*point);
        }
    }
    polyline::resample(&mids, STATIONS)
}
