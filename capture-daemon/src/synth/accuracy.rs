//! How far captured blades are from the truth.

use common::geometry::{distance, polyline};
use glam::Vec3;

use super::clip::{Clip, ClipParams, ClipParamsError};
use super::scene::{Family, Scene};
use crate::pipeline::CapturedBlade;
use crate::session::{Session, SessionParams};

/// A captured blade belongs to a true one when their midribs are on average no farther apart, metres.
pub const MATCH_M: f32 = 0.015;

/// One matched blade's errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BladeError {
    /// |length − truth| / truth.
    pub length: f32,
    /// |largest width − truth| / truth.
    pub max_width: f32,
    /// Mean distance of the midribs, metres.
    pub midrib_m: f32,
    /// Hausdorff distance of the midribs, metres.
    pub hausdorff_m: f32,
}

/// What became of one clip.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ClipResult {
    /// Seed of the clip.
    pub seed: u64,
    /// Captures that gave a blade.
    pub captures: usize,
    /// Blades captured.
    pub captured: usize,
    /// Blades there were.
    pub truth: usize,
    /// The matched ones, in the truth's order.
    pub matched: Vec<BladeError>,
}

impl ClipResult {
    /// One capture, as many blades as the truth, each matched.
    pub fn is_exact(&self) -> bool {
        let one_capture = self.captures == usize::from(self.truth > 0);
        one_capture && self.captured == self.truth && self.matched.len() == self.truth
    }
}

/// Films a scene, captures it and compares.
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
    let mut session = Session::new(params.clone());
    let mut result = ClipResult { seed, truth: clip.scene().blades.len(), ..ClipResult::default() };
    let mut captured = Vec::new();
    for frame in clip.frames() {
        let Some(capture) = session.push(&frame) else { continue };
        result.captures += usize::from(!capture.steps.blades.is_empty());
        captured.extend(capture.steps.blades);
    }
    result.captured = captured.len();
    for truth in &clip.scene().blades {
        let midrib: Vec<Vec3> = truth.sections.iter().step_by(4).map(|s| s.center.as_vec3()).collect();
        let nearest = captured
            .iter()
            .enumerate()
            .map(|(index, blade)| (index, mean_distance(&midrib, &midrib_of(blade))))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((index, midrib_m)) = nearest.filter(|(_, mean)| *mean <= MATCH_M) {
            let blade = captured.swap_remove(index);
            let relative = |found: f32, truth: f64| (f64::from(found) / truth - 1.0).abs() as f32;
            result.matched.push(BladeError {
                length: relative(blade.blade.length_m(), truth.length_m),
                max_width: relative(blade.blade.max_width_m(), truth.max_width_m),
                midrib_m,
                hausdorff_m: distance::hausdorff(&midrib, &midrib_of(&blade)),
            });
        }
    }
    Ok(result)
}

fn midrib_of(blade: &CapturedBlade) -> Vec<Vec3> {
    blade.knots_in_camera.iter().map(|knot| knot.position).collect()
}

/// Mean of the distances from each to the other, both ways, over points evenly along them.
fn mean_distance(a: &[Vec3], b: &[Vec3]) -> f32 {
    const POINTS: usize = 64;
    let one_way = |from: &[Vec3], to: &[Vec3]| {
        let points = polyline::resample(from, POINTS);
        points.iter().map(|point| distance::point_polyline(*point, to)).sum::<f32>() / POINTS as f32
    };
    0.5 * (one_way(a, b) + one_way(b, a))
}

/// The value below which `share` (0..=1) of `values` lie; 0 for none.
pub fn quantile(mut values: Vec<f32>, share: f32) -> f32 {
    values.sort_by(f32::total_cmp);
    let last = values.len().saturating_sub(1);
    values.get((share * last as f32).round() as usize).copied().unwrap_or(0.0)
}
