//! How far captured blades are from the truth.

use common::geometry::{distance, polyline};
use glam::Vec3;

use super::blade::SyntheticBlade;
use super::clip::{Clip, ClipParams, ClipParamsError};
use super::scene::{Family, Scene};
use crate::session::{Session, SessionParams};
use crate::stages::blade::{CapturedBlade, Quality};

/// A captured blade belongs to a true one when their midribs are on average no farther apart, metres.
pub const MATCH_M: f32 = 0.015;
/// Points evenly along a midrib at which distances are taken.
const POINTS: usize = 64;

/// One matched blade's errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BladeError {
    /// |length − truth| / truth.
    pub length: f32,
    /// |largest width − truth| / truth.
    pub max_width: f32,
    /// Mean distance of the midribs, metres; of blades in a hand after the best translation.
    pub midrib_m: f32,
    /// Hausdorff distance of the midribs, metres; of blades in a hand after the best translation.
    pub hausdorff_m: f32,
    /// Signed error of the length over the predicted one's standard deviation.
    pub length_deviations: f32,
    /// Signed error of the largest width over the predicted one's standard deviation.
    pub width_deviations: f32,
    /// What the capture told of it.
    pub quality: Quality,
}

/// 95 % of a normal distribution lie within so many standard deviations.
pub const BAND_95: f32 = 1.96;

impl BladeError {
    /// Whether the true length and the true width each lie in the predicted 95 % band.
    pub fn within_bands(&self) -> [bool; 2] {
        [self.length_deviations, self.width_deviations].map(|deviations| deviations.abs() <= BAND_95)
    }
}

/// What became of one clip.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ClipResult {
    /// Seed of the clip.
    pub seed: u64,
    /// Captures that gave a blade.
    pub captures: usize,
    /// Captures there should be: one of a scene with blades, one of each visitor's.
    pub expected_captures: usize,
    /// Blades captured.
    pub captured: usize,
    /// Blades there were.
    pub truth: usize,
    /// The matched ones, in the truth's order.
    pub matched: Vec<BladeError>,
    /// What the capture told of blades that are none.
    pub unmatched: Vec<Quality>,
}

impl ClipResult {
    /// One capture of each visitor, as many blades as the truth, each matched; nothing where there is none.
    pub fn is_exact(&self) -> bool {
        let each_once = self.captures == self.expected_captures;
        each_once && self.captured == self.truth && self.matched.len() == self.truth
    }
}

/// Films a scene, captures it and compares. A hand trembles: blades that it holds are compared after the
/// best translation, and each visitor's with the captures of their own time.
///
/// # Errors
/// When `clip` is out of its ranges.
pub fn measure(
    family: Family,
    seed: u64,
    clip: ClipParams,
    params: &SessionParams,
) -> Result<ClipResult, ClipParamsError> {
    let clip = Clip::new(Scene::new(family, seed), clip)?;
    let (scene, visits) = (clip.scene(), clip.visits());
    // The true blades of each visit and the captured ones; those of a scene without a hand are of one.
    let mut groups: Vec<(&[SyntheticBlade], Vec<CapturedBlade>)> =
        scene.visits.iter().map(|visit| (&scene.blades[visit.blades.clone()], Vec::new())).collect();
    if groups.is_empty() {
        groups.push((&scene.blades, Vec::new()));
    }
    let mut result = ClipResult { seed, truth: scene.blades.len(), ..ClipResult::default() };
    result.expected_captures = groups.iter().filter(|(truth, _)| !truth.is_empty()).count();
    let mut session = Session::new(params.clone());
    for (index, frame) in clip.frames().enumerate() {
        let Some(capture) = session.push(&frame) else { continue };
        result.captures += usize::from(!capture.steps.blades.is_empty());
        result.captured += capture.steps.blades.len();
        // The latest visit that has begun.
        let visit = visits.iter().rposition(|visit| visit.visible.start <= index).unwrap_or(0);
        groups[visit].1.extend(capture.steps.blades);
    }
    for (truth, captured) in groups {
        let (matched, unmatched) = matches(truth, &captured, !scene.visits.is_empty());
        result.matched.extend(matched);
        result.unmatched.extend(unmatched);
    }
    Ok(result)
}

/// The errors of true blades that were captured, in the truth's order, and what was told of captured ones
/// that are no true ones: pairs are made from the closest on, each blade in one at most.
fn matches(
    truth: &[SyntheticBlade],
    captured: &[CapturedBlade],
    in_hand: bool,
) -> (Vec<BladeError>, Vec<Quality>) {
    let true_midribs: Vec<Vec<Vec3>> = truth
        .iter()
        .map(|blade| blade.sections.iter().step_by(4).map(|section| section.center.as_vec3()).collect())
        .collect();
    let midribs: Vec<Vec<Vec3>> = captured.iter().map(midrib_of).collect();
    let mut pairs: Vec<(f32, usize, usize)> = Vec::new();
    for (i, of_truth) in true_midribs.iter().enumerate() {
        pairs.extend(midribs.iter().enumerate().map(|(j, found)| (mean_distance(of_truth, found), i, j)));
    }
    pairs.retain(|pair| pair.0 <= MATCH_M);
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut partner: Vec<Option<usize>> = vec![None; truth.len()];
    for (_, i, j) in pairs {
        if partner[i].is_none() && !partner.contains(&Some(j)) {
            partner[i] = Some(j);
        }
    }
    let errors = truth.iter().zip(&true_midribs).zip(&partner).filter_map(|((truth, midrib), partner)| {
        let CapturedBlade { blade, quality, .. } = &captured[(*partner)?];
        let found = &midribs[(*partner)?];
        let by = if in_hand { best_translation(found, midrib) } else { Vec3::ZERO };
        let found: Vec<Vec3> = found.iter().map(|&point| point + by).collect();
        let relative = |found: f32, truth: f64| (f64::from(found) / truth - 1.0).abs() as f32;
        let deviations = |found: f32, truth: f64, sigma: f32| (f64::from(found) - truth) as f32 / sigma;
        Some(BladeError {
            quality: *quality,
            length_deviations: deviations(blade.length_m(), truth.length_m, quality.length_error_m),
            width_deviations: deviations(blade.max_width_m(), truth.max_width_m, quality.width_error_m),
            length: relative(blade.length_m(), truth.length_m),
            max_width: relative(blade.max_width_m(), truth.max_width_m),
            midrib_m: mean_distance(midrib, &found),
            hausdorff_m: distance::hausdorff(midrib, &found),
        })
    });
    let unmatched = captured.iter().enumerate().filter(|(j, _)| !partner.contains(&Some(*j)));
    (errors.collect(), unmatched.map(|(_, captured)| captured.quality).collect())
}

/// The translation that brings a midrib closest to another: from points to those nearest to them, both
/// ways, again and again.
fn best_translation(midrib: &[Vec3], to: &[Vec3]) -> Vec3 {
    const ROUNDS: usize = 12;
    let (points, targets) = (polyline::resample(midrib, POINTS), polyline::resample(to, POINTS));
    let mut by = Vec3::ZERO;
    for _ in 0..ROUNDS {
        let moved: Vec<Vec3> = points.iter().map(|&point| point + by).collect();
        let nearest = |point: Vec3, among: &[Vec3]| {
            let closer =
                |a: &&Vec3, b: &&Vec3| a.distance_squared(point).total_cmp(&b.distance_squared(point));
            among.iter().min_by(closer).copied().unwrap_or(point)
        };
        let forth: Vec3 = moved.iter().map(|&point| nearest(point, &targets) - point).sum();
        let back: Vec3 = targets.iter().map(|&target| target - nearest(target, &moved)).sum();
        by += (forth + back) / (2.0 * POINTS as f32);
    }
    by
}

fn midrib_of(blade: &CapturedBlade) -> Vec<Vec3> {
    blade.knots_in_camera.iter().map(|knot| knot.position).collect()
}

/// Mean of the distances from each to the other, both ways, over points evenly along them.
fn mean_distance(a: &[Vec3], b: &[Vec3]) -> f32 {
    let one_way = |from: &[Vec3], to: &[Vec3]| {
        let points = polyline::resample(from, POINTS);
        points.iter().map(|point| distance::point_polyline(*point, to)).sum::<f32>() / POINTS as f32
    };
    0.5 * (one_way(a, b) + one_way(b, a))
}

/// What became of some clips.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Clips.
    pub clips: usize,
    /// Seeds of those that are not exact.
    pub inexact: Vec<u64>,
    /// Matched blades.
    pub matched: usize,
    /// Half of the matched blades have smaller errors.
    pub median: Errors,
    /// 95 % of the matched blades have smaller errors.
    pub p95: Errors,
    /// Share of the matched blades whose true length lies in the predicted 95 % band, and whose true width
    /// does.
    pub within_bands: [f32; 2],
}

/// One quantile of each of the errors of [`BladeError`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// |length − truth| / truth.
    pub length: f32,
    /// |largest width − truth| / truth.
    pub max_width: f32,
    /// Mean distance of the midribs, metres.
    pub midrib_m: f32,
    /// Hausdorff distance of the midribs, metres.
    pub hausdorff_m: f32,
}

impl Summary {
    /// The head of a Markdown table of [`Self::markdown_row`]s.
    pub const MARKDOWN_HEAD: &str = "\
| family | clips | exact | length p50 / p95 | max. width p50 / p95 | midrib p50 | Hausdorff p95 | in 95 % band: length / width |
|---|---|---|---|---|---|---|---|";

    /// What the columns mean.
    pub const LEGEND: &str = "Exact: one capture a visitor, with as many blades as the truth and each of \
        them matched (a midrib within 15 mm on average). Errors are those of matched blades; those in a hand, \
        which trembles, are compared after the best translation. The last column is the share of blades whose \
        true length, and width, lies in the predicted 95 % band.";

    /// The summary of some clips.
    pub fn of(results: &[ClipResult]) -> Self {
        let blades = || results.iter().flat_map(|result| &result.matched);
        let at = |share| {
            let error = |of: fn(&BladeError) -> f32| quantile(blades().map(of).collect(), share);
            Errors {
                length: error(|e| e.length),
                max_width: error(|e| e.max_width),
                midrib_m: error(|e| e.midrib_m),
                hausdorff_m: error(|e| e.hausdorff_m),
            }
        };
        let matched = blades().count();
        let within = |i: usize| {
            blades().filter(|blade| blade.within_bands()[i]).count() as f32 / matched.max(1) as f32
        };
        let inexact = results.iter().filter(|result| !result.is_exact()).map(|result| result.seed).collect();
        Self {
            clips: results.len(),
            inexact,
            matched,
            median: at(0.5),
            p95: at(0.95),
            within_bands: [within(0), within(1)],
        }
    }

    fn exact_percent(&self) -> f64 {
        1e2 * (self.clips - self.inexact.len()) as f64 / self.clips.max(1) as f64
    }

    /// A row of a Markdown table, named `family`; errors are left out where no blade was matched.
    pub fn markdown_row(&self, family: &str) -> String {
        let Self { clips, median, p95, within_bands: [length, width], .. } = self;
        let exact = self.exact_percent();
        if self.matched == 0 {
            return format!("| {family} | {clips} | {exact:.1} % | – | – | – | – | – |");
        }
        format!(
            "| {family} | {clips} | {exact:.1} % | {:.2} / {:.2} % | {:.2} / {:.2} % | {:.2} mm | {:.2} mm | {:.1} / {:.1} % |",
            1e2 * median.length,
            1e2 * p95.length,
            1e2 * median.max_width,
            1e2 * p95.max_width,
            1e3 * median.midrib_m,
            1e3 * p95.hausdorff_m,
            1e2 * length,
            1e2 * width,
        )
    }
}

impl std::fmt::Display for Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { clips, inexact, median, p95, within_bands: [length, width], .. } = self;
        write!(
            f,
            "{clips:4} clips  exact {:5.1} %  length {:4.2} / {:5.2} %  width {:4.2} / {:5.2} %  midrib {:4.2} mm  Hausdorff {:5.2} mm  in band {:5.1} / {:5.1} %",
            self.exact_percent(),
            1e2 * median.length,
            1e2 * p95.length,
            1e2 * median.max_width,
            1e2 * p95.max_width,
            1e3 * median.midrib_m,
            1e3 * p95.hausdorff_m,
            1e2 * length,
            1e2 * width,
        )?;
        if inexact.is_empty() { Ok(()) } else { write!(f, "  inexact seeds {inexact:?}") }
    }
}

/// The value below which `share` (0..=1) of `values` lie; 0 for none.
fn quantile(mut values: Vec<f32>, share: f32) -> f32 {
    values.sort_by(f32::total_cmp);
    let last = values.len().saturating_sub(1);
    values.get((share * last as f32).round() as usize).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_translation_undoes_one() {
        let midrib: Vec<Vec3> = (0..64)
            .map(|i| i as f32 / 63.0)
            .map(|t| Vec3::new(0.04 * t * t, -0.2 * t, 0.6 + 0.03 * t * t * t))
            .collect();
        let by = Vec3::new(0.002, -0.001, 0.0025);
        let moved: Vec<Vec3> = midrib.iter().map(|&point| point + by).collect();
        assert!(mean_distance(&midrib, &moved) > 0.002);
        let back = best_translation(&moved, &midrib);
        let again: Vec<Vec3> = moved.iter().map(|&point| point + back).collect();
        assert!(mean_distance(&midrib, &again) < 0.0004, "{back}");
    }
}
