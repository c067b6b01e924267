//! Sections of a ribbon → how deep its midrib lies, along it and beyond its ends.

use common::geometry::smooth;
use glam::{DMat4, DVec3, DVec4, Vec2};

use super::ribbon::Section;
use crate::frame::CameraModel;

/// A midrib that bends in depth.
///
/// The rays to a midrib form a cone, which unrolls to a plane; there it is a curve whose direction turns
/// by an even share of its length, and by a share that grows evenly. Where a blade bends away from the camera
/// each pixel spans more of it than the one before: a parabola over the image does not follow that, and
/// falls short by up to 10 mm at the tip.
#[derive(Clone, Debug)]
pub(super) struct Bend {
    camera: CameraModel,
    curve: Curve,
    /// At each section.
    states: Vec<State>,
    /// What the sections lie deeper than the curve, metres.
    off_m: Vec<f64>,
}

/// Half-height wavelength of the smoothing of what is left over the curve, pixels.
const LEFT_OVER_WAVELENGTH_PX: f64 = 48.0;
/// Sections over which the new depth fades into that of a stretch that was but guessed.
const FADE: f64 = 24.0;
/// Noise of a reading; of those of a section and of neighbouring ones one in five is news, metres.
const NOISE_M: f64 = 0.5e-3;
const NEWS: f64 = 0.2;
/// How fast the direction turns, and how fast that grows, one standard deviation: radians over
/// [`UNIT_M`] and over its square.
const TURNING: f64 = 0.32;
const TURNING_MORE: f64 = 0.14;
const UNIT_M: f64 = 0.1;
/// Nothing is seen that leads away at a steeper angle, radians.
const STEEPEST: f64 = 1.4;

impl Bend {
    /// Fits the depth of sections from root to tip to what was measured, and lets them have it; `None`, and
    /// nothing done, where too few were measured. Where a blade is but guided its depth stays. O(sections).
    pub(super) fn fit(sections: &mut [Section], camera: &CameraModel) -> Option<Self> {
        const LEAST: usize = 12;
        let guided = sections.iter().rposition(|s| s.guide_px.is_some()).map_or(0, |last| last + 1);
        let rays: Vec<DVec3> = sections.iter().map(|s| ray(camera, s.expected.mid)).collect();
        let alphas = turned(&rays);
        let readings = |s: &Section| if s.measured.depth_m.is_some() { s.measured.readings } else { 0 };
        let weights: Vec<f64> = sections[guided..].iter().map(|s| f64::from(readings(s))).collect();
        if weights.iter().filter(|weight| **weight > 0.0).count() < LEAST {
            return None;
        }
        let reach = |i: usize| {
            let depth_m = sections[i].measured.depth_m.unwrap_or(sections[i].expected.depth_m);
            f64::from(depth_m) / rays[i].z
        };
        let nodes = nodes((guided..sections.len()).map(|i| (alphas[i], reach(i), weights[i - guided])));
        let curve = Curve::fit(&nodes)?;
        let states = curve.along(nodes[0].alpha, &alphas);
        let curve_m = |i: usize| states[i].rho * rays[i].z;
        let left: Vec<f64> = (guided..sections.len())
            .map(|i| if weights[i - guided] > 0.0 { reach(i) * rays[i].z - curve_m(i) } else { 0.0 })
            .collect();
        let mean =
            weights.iter().sum::<f64>() / weights.iter().filter(|weight| **weight > 0.0).count() as f64;
        let weights: Vec<f64> = weights.iter().map(|weight| weight / mean).collect();
        let left = smooth::penalised(&left, &weights, LEFT_OVER_WAVELENGTH_PX);
        for (k, section) in sections[guided..].iter_mut().enumerate() {
            let before = f64::from(section.expected.depth_m);
            let share = if guided > 0 { (k as f64 / FADE).min(1.0) } else { 1.0 };
            section.expected.depth_m = (before + share * (curve_m(guided + k) + left[k] - before)) as f32;
        }
        let off_m =
            (0..sections.len()).map(|i| f64::from(sections[i].expected.depth_m) - curve_m(i)).collect();
        Some(Self { camera: *camera, curve, states, off_m })
    }

    /// Forgets so many sections at the root and at the tip.
    pub(super) fn cut(&mut self, at_root: usize, at_tip: usize) {
        let kept = at_root..self.states.len() - at_tip;
        self.states = self.states[kept.clone()].to_vec();
        self.off_m = self.off_m[kept].to_vec();
    }

    /// Depth at points that carry it on beyond its first section, from that one on, metres.
    pub(super) fn before(&self, points: impl Iterator<Item = Vec2>) -> Vec<f32> {
        self.onward(0, -1.0, points)
    }

    /// Depth at points that carry it on beyond its last section, from that one on, metres.
    pub(super) fn beyond(&self, points: impl Iterator<Item = Vec2>) -> Vec<f32> {
        self.onward(self.states.len() - 1, 1.0, points)
    }

    fn onward(&self, from: usize, way: f64, points: impl Iterator<Item = Vec2>) -> Vec<f32> {
        let rays: Vec<DVec3> = points.map(|point| ray(&self.camera, point)).collect();
        let mut state = self.states[from];
        let start = state.alpha;
        let alphas = turned(&rays);
        let depths = rays.iter().zip(alphas).map(|(ray, alpha)| {
            state = self.curve.step(state, start + way * alpha);
            (state.rho * ray.z + self.off_m[from]) as f32
        });
        depths.collect()
    }
}

/// Unit vector from the camera to what a point of the image shows.
fn ray(camera: &CameraModel, point: Vec2) -> DVec3 {
    let (x, y) = (f64::from(point.x) - camera.cx, f64::from(point.y) - camera.cy);
    DVec3::new(x / camera.fx, y / camera.fy, 1.0).normalize()
}

/// The angle swept by rays up to each of them, radians.
fn turned(rays: &[DVec3]) -> Vec<f64> {
    let mut angle = 0.0;
    let mut swept = Vec::with_capacity(rays.len());
    for (i, ray) in rays.iter().enumerate() {
        angle += if i > 0 { ray.distance(rays[i - 1]) } else { 0.0 };
        swept.push(angle);
    }
    swept
}

/// Readings of neighbouring sections taken together.
struct Node {
    /// Angle swept up to it, radians.
    alpha: f64,
    /// Distance from the camera, metres.
    rho: f64,
    weight: f64,
}

/// Nodes of a few sections each: angle, distance and weight.
fn nodes(sections: impl Iterator<Item = (f64, f64, f64)>) -> Vec<Node> {
    const TOGETHER: usize = 8;
    let sections: Vec<_> = sections.collect();
    let together = sections.chunks(TOGETHER).map(|group| {
        let sum = |of: fn(&(f64, f64, f64)) -> f64| group.iter().map(of).sum::<f64>();
        let weight = sum(|(_, _, weight)| *weight);
        let mean = |sum: f64| sum / weight.max(f64::MIN_POSITIVE);
        let (alpha, rho) = (sum(|(alpha, _, w)| alpha * w), sum(|(_, rho, w)| rho * w));
        Node { alpha: mean(alpha), rho: mean(rho), weight }
    });
    together.filter(|node| node.weight > 0.0).collect()
}

/// Where a curve is.
#[derive(Clone, Copy, Debug)]
struct State {
    /// Angle swept by its ray, radians.
    alpha: f64,
    /// Arc length, metres.
    sigma: f64,
    /// Distance from the camera, metres.
    rho: f64,
    /// Arc length that the last radian took, metres.
    pace: f64,
}

/// Distance at its first node, metres; there, how steeply it leads away less the angle swept so far, radians;
/// how that turns over [`UNIT_M`]; and over its square.
#[derive(Clone, Copy, Debug)]
struct Curve(DVec4);

impl Curve {
    /// Gauss–Newton from the straight line, as long as it gets better.
    fn fit(nodes: &[Node]) -> Option<Self> {
        const ROUNDS: usize = 8;
        let (first, last) = (nodes.first()?, nodes.last()?);
        let rising = (last.rho - first.rho) / (0.5 * (last.rho + first.rho) * (last.alpha - first.alpha));
        let swept = 0.5 * (first.alpha + last.alpha);
        let mut best = Self(DVec4::new(first.rho, rising.atan() - swept, 0.0, 0.0));
        let held = DVec4::new(0.0, 0.0, TURNING.powi(-2), TURNING_MORE.powi(-2));
        let weight = |node: &Node| node.weight * NEWS / (NOISE_M * NOISE_M);
        let left = |curve: &Self| -> Vec<f64> {
            curve.at(nodes).into_iter().zip(nodes).map(|(rho, node)| node.rho - rho).collect()
        };
        let cost = |curve: &Self, left: &[f64]| {
            let misses = nodes.iter().zip(left).map(|(node, left)| weight(node) * left * left);
            misses.sum::<f64>() + (held * curve.0 * curve.0).element_sum()
        };
        let mut missing = left(&best);
        let mut least = cost(&best, &missing);
        for _ in 0..ROUNDS {
            const SMALL: f64 = 1e-4;
            let columns =
                [DVec4::X, DVec4::Y, DVec4::Z, DVec4::W].map(|axis| left(&Self(best.0 + axis * SMALL)));
            let mut normal = [DVec4::ZERO; 4];
            let mut right = -held * best.0;
            for (i, node) in nodes.iter().enumerate() {
                let slope =
                    DVec4::from_array([0, 1, 2, 3].map(|k: usize| (missing[i] - columns[k][i]) / SMALL));
                let weighted = slope * weight(node);
                normal.iter_mut().zip(weighted.to_array()).for_each(|(row, factor)| *row += slope * factor);
                right += weighted * missing[i];
            }
            let [a, b, c, d] = normal;
            let matrix = DMat4::from_cols(a, b, c, d) + DMat4::from_diagonal(held);
            let step = matrix.inverse() * right;
            if !step.is_finite() {
                return None;
            }
            let shorter = [1.0, 0.5, 0.25].map(|share| Self(best.0 + step * share));
            let better = shorter.into_iter().find_map(|curve| {
                let missing = left(&curve);
                let cost = cost(&curve, &missing);
                (cost < least).then_some((curve, missing, cost))
            });
            let Some((curve, left, cost)) = better else { break };
            let gained = least - cost;
            (best, missing, least) = (curve, left, cost);
            if gained < 0.01 {
                break;
            }
        }
        Some(best)
    }

    /// Distance at each node, metres.
    fn at(&self, nodes: &[Node]) -> Vec<f64> {
        let mut state = self.start(nodes[0].alpha);
        let rho = |node: &Node| {
            state = self.step(state, node.alpha);
            state.rho
        };
        nodes.iter().map(rho).collect()
    }

    /// Where it is at angles that ascend, some of them before its first node's, `first`.
    fn along(&self, first: f64, alphas: &[f64]) -> Vec<State> {
        let split = alphas.partition_point(|alpha| *alpha < first);
        let walk = |alpha: &f64, state: &mut State| {
            *state = self.step(*state, *alpha);
            *state
        };
        let mut state = self.start(first);
        let mut states: Vec<State> = alphas[..split].iter().rev().map(|it| walk(it, &mut state)).collect();
        states.reverse();
        state = self.start(first);
        states.extend(alphas[split..].iter().map(|it| walk(it, &mut state)));
        states
    }

    fn start(&self, alpha: f64) -> State {
        let Self(DVec4 { x: rho, y: steep, .. }) = *self;
        State { alpha, sigma: 0.0, rho, pace: rho / (steep + alpha).clamp(-STEEPEST, STEEPEST).cos() }
    }

    /// Goes on to an angle, or back, by the midpoint rule.
    fn step(&self, from: State, alpha: f64) -> State {
        // About eleven pixels.
        const LONGEST: f64 = 0.02;
        let Self(DVec4 { y: steep, z: turning, w: more, .. }) = *self;
        let mut state = from;
        let count = ((alpha - from.alpha).abs() / LONGEST).ceil().max(1.0);
        let by = (alpha - from.alpha) / count;
        for k in 0..count as usize {
            let u = (state.sigma + 0.5 * by * state.pace) / UNIT_M;
            let swept = from.alpha + (k as f64 + 0.5) * by;
            let angle = steep + swept + (turning + more * u) * u;
            let tangent = angle.clamp(-STEEPEST, STEEPEST).tan();
            // ρ' = ρ tan: over the step it grows by that power.
            let rho = state.rho * (1.0 + by * tangent * (1.0 + 0.5 * by * tangent));
            let pace = 0.5 * (state.rho + rho) * (1.0 + tangent * tangent).sqrt();
            state = State { alpha: swept + 0.5 * by, sigma: state.sigma + by * pace, rho, pace };
        }
        state
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::stages::ribbon::ANCHOR;
    use crate::stages::section::{Expected, Fold, Measured, Middle};

    const CAMERA: CameraModel = CameraModel { fx: 570.0, fy: 570.0, cx: 319.5, cy: 239.5 };

    /// Points of the image a pixel apart, with their depths in metres, of a blade that leaves the camera at
    /// an angle of `steep` plus `turning` radians a metre, plus `more` a square metre.
    fn blade(steep: f64, turning: f64, more: f64) -> Vec<(Vec2, f32)> {
        const STEP_M: f64 = 2e-5;
        let (mut at, mut points) = (Vec3::new(0.03, 0.10, 0.55).as_dvec3(), Vec::new());
        for k in 0..7500 {
            let (u, v) = CAMERA.project(at.as_vec3());
            let pixel = Vec2::new(u as f32, v as f32);
            if points.last().is_none_or(|(last, _): &(Vec2, f32)| last.distance(pixel) >= 1.0) {
                points.push((pixel, at.z as f32));
            }
            let s = f64::from(k) * STEP_M;
            let (sin, cos) = (steep + (turning + more * s) * s).sin_cos();
            at += DVec3::new(0.2 * cos, -0.98 * cos, sin) * STEP_M;
        }
        points
    }

    fn section((mid, depth_m): (Vec2, f32), readings: u16) -> Section {
        let expected = Expected {
            mid,
            across: Vec2::X,
            half_px: 5.0,
            depth_m: 0.5,
            slope_m: 0.0,
            fold: Fold::default(),
            tolerance_m: 0.002,
            search_px: 2.0,
        };
        let measured = Measured { depth_m: Some(depth_m), readings, ..Measured::nothing(Middle::Blade) };
        Section { expected, measured, anchor: ANCHOR, guide_px: None }
    }

    /// The largest error of the depth along a blade and beyond both of its ends, where `unseen` points are
    /// not measured, metres.
    fn error_m(blade: &[(Vec2, f32)], unseen: usize) -> f32 {
        let seen = &blade[unseen..blade.len() - unseen];
        let mut sections: Vec<Section> = seen.iter().map(|point| section(*point, 8)).collect();
        let bend = Bend::fit(&mut sections, &CAMERA).expect("it is measured");
        let before = bend.before(blade[..=unseen].iter().rev().map(|point| point.0));
        let beyond = bend.beyond(blade[blade.len() - unseen - 1..].iter().map(|point| point.0));
        let inside = sections.iter().map(|section| section.expected.depth_m);
        let found = before.into_iter().rev().chain(inside.skip(1)).chain(beyond.into_iter().skip(1));
        assert_eq!(found.clone().count(), blade.len());
        found.zip(blade).map(|(found, (_, depth_m))| (found - depth_m).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn what_is_straight_in_space_goes_on_straight() {
        for steep in [-0.6, 0.0, 0.5, 1.0] {
            let error_m = error_m(&blade(steep, 0.0, 0.0), 15);
            assert!(error_m < 1.5e-4, "{steep}: {error_m}");
        }
    }

    #[test]
    fn what_bends_goes_on_as_it_bends() {
        for (steep, turning, more) in
            [(0.1, 4.0, 0.0), (-0.2, 2.0, 25.0), (0.2, -4.0, 0.0), (-0.3, 0.0, 50.0)]
        {
            let blade = blade(steep, turning, more);
            let error_m = error_m(&blade, 10);
            assert!(error_m < 5e-4, "{steep} {turning} {more}: {error_m}");
        }
    }

    #[test]
    fn depth_of_what_is_but_guided_stays() {
        let mut sections: Vec<Section> = blade(0.3, 2.0, 0.0).into_iter().map(|it| section(it, 8)).collect();
        sections[..40].iter_mut().for_each(|section| section.guide_px = Some(5.0));
        Bend::fit(&mut sections, &CAMERA).expect("it is measured");
        assert!(sections[..40].iter().all(|section| section.expected.depth_m == 0.5));
        assert!(sections[80..].iter().all(|section| section.expected.depth_m > 0.55));
    }

    #[test]
    fn a_few_readings_are_no_bend() {
        let blade = blade(0.3, 2.0, 0.0);
        let mut sections: Vec<Section> = blade.iter().map(|it| section(*it, 0)).collect();
        sections[..11].iter_mut().for_each(|section| section.measured.readings = 3);
        assert!(Bend::fit(&mut sections, &CAMERA).is_none());
        assert!(sections.iter().all(|section| section.expected.depth_m == 0.5));
    }
}
