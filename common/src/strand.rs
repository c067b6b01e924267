//! One strand's dynamics on the CPU: the motion that [`crate::refine`] measures, and the reference
//! that a GPU version is held against.
//!
//! A strand is a chain of vertices whose first two stand still. Each step integrates, pulls every
//! edge back to its rest direction relative to the edge before it, blows wind on it and restores
//! the lengths.
//!
//! # Source
//! Han & Harada 2012 as in TressFX 3.1 (local frames carried down the strand). Departures: wind
//! keeps its sign and is not scaled by the edge's length, so that it does not depend on the number
//! of vertices; damping is per second; there is no global shape (grass stands by its own
//! stiffness); lengths end with an exact pass from root to tip.

use glam::{Mat3, Quat, Vec3};

use crate::geometry::polyline;

/// How a strand moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrandParams {
    /// Velocity lost, per second, ≥ 0: v falls by e^(−damping·t).
    pub damping_per_s: f32,
    /// Pull to the rest shape, 0..=0.95.
    pub stiffness: f32,
    /// Passes of that pull a step.
    pub shape_iterations: u32,
    /// Passes of the length constraint a step, before the exact one.
    pub length_iterations: u32,
}

impl Default for StrandParams {
    fn default() -> Self {
        Self { damping_per_s: 4.0, stiffness: 0.9, shape_iterations: 4, length_iterations: 2 }
    }
}

/// A chain of vertices at rest or in motion, metres.
#[derive(Clone, Debug)]
pub struct Strand {
    positions: Vec<Vec3>,
    previous: Vec<Vec3>,
    /// Edge i in the frame of edge i − 1 (of the root frame for i = 0).
    rest_edges: Vec<Vec3>,
    rest_lengths: Vec<f32>,
    root_frame: Mat3,
}

impl Strand {
    /// A strand at rest along `rest` (≥ 2 distinct successive points).
    pub fn at_rest(rest: &[Vec3]) -> Self {
        let edge = |i: usize| rest[i + 1] - rest[i];
        let edges = rest.len() - 1;
        let root_frame = Quat::from_rotation_arc(Vec3::X, edge(0).normalize_or(Vec3::X));
        let root_frame = Mat3::from_quat(root_frame);
        let mut frame = root_frame;
        let mut rest_edges = Vec::with_capacity(edges);
        for i in 0..edges {
            rest_edges.push(frame.transpose_mul_vec3(edge(i)));
            turn_to(&mut frame, edge(i));
        }
        Self {
            positions: rest.to_vec(),
            previous: rest.to_vec(),
            rest_lengths: (0..edges).map(|i| edge(i).length()).collect(),
            rest_edges,
            root_frame,
        }
    }

    /// Vertices from root to tip.
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Moves on by `dt` seconds under `wind`, an acceleration in m/s² of which each edge feels the
    /// part across it. O(vertices).
    pub fn step(&mut self, dt: f32, wind: Vec3, params: &StrandParams) {
        let keep = (-params.damping_per_s * dt).exp();
        for i in 2..self.positions.len() {
            let along = (self.positions[i] - self.positions[i - 1]).normalize_or_zero();
            let push = (wind - along * wind.dot(along)) * (dt * dt);
            let moved = self.positions[i] + (self.positions[i] - self.previous[i]) * keep + push;
            self.previous[i] = self.positions[i];
            self.positions[i] = moved;
        }
        for _ in 0..params.shape_iterations {
            self.pull_to_rest_shape(0.5 * params.stiffness.min(0.95));
        }
        for _ in 0..params.length_iterations {
            self.restore_lengths();
        }
        self.restore_lengths_exactly();
    }

    fn pull_to_rest_shape(&mut self, share: f32) {
        let mut frame = self.root_frame;
        for i in 0..self.rest_edges.len() {
            let pull = (self.positions[i] + frame * self.rest_edges[i] - self.positions[i + 1]) * share;
            if i >= 2 {
                self.positions[i] -= pull;
            }
            if i >= 1 {
                self.positions[i + 1] += pull;
            }
            turn_to(&mut frame, self.positions[i + 1] - self.positions[i]);
        }
    }

    fn restore_lengths(&mut self) {
        for parity in 0..2 {
            for i in (1 + parity..self.rest_lengths.len()).step_by(2) {
                let edge = self.positions[i + 1] - self.positions[i];
                let length = edge.length();
                if length <= 0.0 {
                    continue;
                }
                let excess = edge * (1.0 - self.rest_lengths[i] / length);
                if i >= 2 {
                    self.positions[i] += excess * 0.5;
                    self.positions[i + 1] -= excess * 0.5;
                } else {
                    self.positions[i + 1] -= excess;
                }
            }
        }
    }

    fn restore_lengths_exactly(&mut self) {
        for i in 1..self.rest_lengths.len() {
            let edge = self.positions[i + 1] - self.positions[i];
            let direction = edge
                .try_normalize()
                .unwrap_or_else(|| (self.positions[i] - self.positions[i - 1]).normalize_or(Vec3::Y));
            self.positions[i + 1] = self.positions[i] + direction * self.rest_lengths[i];
        }
    }
}

/// Turns a frame of unit vectors by the shortest way such that its x axis points along `edge`.
fn turn_to(frame: &mut Mat3, edge: Vec3) {
    let length = edge.length();
    if length < 1e-12 {
        return;
    }
    let direction = edge * (1.0 / length);
    let along = frame.x_axis;
    // Half turns have no shortest way: this one keeps the y axis.
    let beyond = length + along.dot(edge);
    if beyond > 1e-6 * length {
        frame.y_axis -= (along + direction) * (edge.dot(frame.y_axis) / beyond);
    }
    frame.x_axis = direction;
    frame.z_axis = direction.cross(frame.y_axis);
}

/// A strand's vertices at successive moments: `frames[f][v]`.
pub type Motion = Vec<Vec<Vec3>>;

/// How a blade with this midrib (≥ 2 points) moves in a gusty wind: `frames` samples, evenly over two
/// seconds from rest. Two winds at right angles with their own rhythms, so that bending in both
/// directions takes part. See [`motion_under`].
pub fn motion_in_wind(midrib: &[Vec3], frames: usize) -> Motion {
    // Bends a blade of 0.2 m by up to 0.4 of its length.
    const STRENGTH: f32 = 1.5;
    let wind = |t: f32| Vec3::new((3.1 * t).sin() + 0.4 * (11.3 * t).sin(), 0.0, 0.7 * (2.3 * t + 1.0).sin());
    motion_under(midrib, frames, |t| wind(t) * STRENGTH)
}

/// How a blade with this midrib (≥ 2 points) moves under `wind`, an acceleration in m/s² at a time in
/// seconds: `frames` samples, evenly over two seconds from rest.
///
/// The stiffness of a chain depends on its number of links, so the midrib is simulated with 16
/// links whatever its own number, and its vertices are carried along by cubic interpolation.
/// O(frames · vertices + 120 · 16).
pub fn motion_under(midrib: &[Vec3], frames: usize, wind: impl Fn(f32) -> Vec3) -> Motion {
    const LINKS: usize = 16;
    const STEPS: usize = 120;
    const DT: f32 = 1.0 / 60.0;
    let params = StrandParams::default();
    let cumulative = polyline::cumulative_length(midrib);
    let total = cumulative.last().copied().unwrap_or(0.0).max(f32::MIN_POSITIVE);
    let mut strand = Strand::at_rest(&polyline::resample(midrib, LINKS + 1));
    let mut motion = Vec::with_capacity(frames);
    for step in 1..=STEPS {
        strand.step(DT, wind(step as f32 * DT), &params);
        if step * frames / STEPS > (step - 1) * frames / STEPS {
            let at = |s: &f32| cubic(strand.positions(), s / total * LINKS as f32);
            motion.push(cumulative.iter().map(at).collect());
        }
    }
    motion
}

/// The Catmull–Rom curve through `points` (≥ 2) at `t` links from the first.
fn cubic(points: &[Vec3], t: f32) -> Vec3 {
    let last = points.len() - 1;
    let i = (t as usize).min(last - 1);
    let t = t - i as f32;
    let (p1, p2) = (points[i], points[i + 1]);
    let before = if i > 0 { points[i - 1] } else { 2.0 * p1 - p2 };
    let after = if i + 2 <= last { points[i + 2] } else { 2.0 * p2 - p1 };
    let (m1, m2) = ((p2 - before) * 0.5, (after - p1) * 0.5);
    let (t2, t3) = (t * t, t * t * t);
    p1 * (2.0 * t3 - 3.0 * t2 + 1.0) + m1 * (t3 - 2.0 * t2 + t) + p2 * (3.0 * t2 - 2.0 * t3) + m2 * (t3 - t2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::polyline;

    fn arc(n: usize) -> Vec<Vec3> {
        (0..n)
            .map(|i| {
                let a = 1.2 * i as f32 / (n - 1) as f32;
                Vec3::new(1.0 - a.cos(), a.sin(), 0.1 * a * a) * 0.17
            })
            .collect()
    }

    #[test]
    fn a_strand_at_rest_without_wind_stays_at_rest() {
        let rest = arc(33);
        let mut strand = Strand::at_rest(&rest);
        for _ in 0..600 {
            strand.step(1.0 / 60.0, Vec3::ZERO, &StrandParams::default());
        }
        let moved = strand.positions().iter().zip(&rest).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
        assert!(moved < 2e-4, "{moved}");
    }

    #[test]
    fn wind_bends_it_keeps_its_length_and_it_comes_back() {
        let rest = arc(33);
        let mut strand = Strand::at_rest(&rest);
        for _ in 0..60 {
            strand.step(1.0 / 60.0, Vec3::Z * 12.0, &StrandParams::default());
        }
        let tip = strand.positions()[32];
        assert!(tip.z > rest[32].z + 0.01, "the tip goes with the wind: {tip}");
        assert!((polyline::length(strand.positions()) / polyline::length(&rest) - 1.0).abs() < 1e-4);
        assert_eq!(strand.positions()[..2], rest[..2]);
        for _ in 0..1200 {
            strand.step(1.0 / 60.0, Vec3::ZERO, &StrandParams::default());
        }
        assert!(strand.positions()[32].distance(rest[32]) < 0.01 * 0.2);
    }

    #[test]
    fn motion_has_the_frames_asked_for_and_bends_by_a_good_part_of_its_length() {
        let rest = arc(128);
        let motion = motion_in_wind(&rest, 24);
        assert_eq!(motion.len(), 24);
        let reach = motion.iter().map(|frame| frame[127].distance(rest[127])).fold(0.0, f32::max);
        assert!(reach > 0.03 && reach < 0.12, "{reach}");
    }
}
