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

mod lanes;

use glam::{Mat3, Quat, Vec3};
use multiversion::multiversion;

use self::lanes::{LANES, Numbers, Vectors};
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

/// A few chains of equally many vertices at rest or in motion, metres. They know nothing of each other:
/// side by side they cost hardly more than one.
#[derive(Clone, Debug)]
pub struct Strands {
    positions: Vec<Vectors>,
    previous: Vec<Vectors>,
    /// Edge i in the frame of edge i − 1 (of the root frame for i = 0).
    rest_edges: Vec<[Numbers; 3]>,
    rest_lengths: Vec<Numbers>,
    root_frame: Frame,
}

impl Strands {
    /// How many there can be.
    pub const MOST: usize = LANES;

    /// Strands at rest along `rest`: 1 to [`Self::MOST`] of equally many points, ≥ 2, successive ones
    /// distinct.
    ///
    /// # Panics
    /// Without a strand, or when one has fewer points than the first.
    pub fn at_rest(rest: &[Vec<Vec3>]) -> Self {
        // Lanes that are left over do what the last strand does.
        let point = |lane: usize, i: usize| rest[lane.min(rest.len() - 1)][i];
        let vertices = rest[0].len();
        let positions: Vec<Vectors> =
            (0..vertices).map(|i| Vectors::from_lanes(|lane| point(lane, i))).collect();
        let edge = |i: usize| positions[i + 1] - positions[i];
        let roots: [Mat3; LANES] = std::array::from_fn(|lane| {
            let edge = point(lane, 1) - point(lane, 0);
            Mat3::from_quat(Quat::from_rotation_arc(Vec3::X, edge.normalize_or(Vec3::X)))
        });
        let axis = |of: fn(&Mat3) -> Vec3| Vectors::from_lanes(|lane| of(&roots[lane]));
        let root_frame = Frame { x: axis(|m| m.x_axis), y: axis(|m| m.y_axis), z: axis(|m| m.z_axis) };
        let mut frame = root_frame;
        let mut rest_edges = Vec::with_capacity(vertices - 1);
        for i in 0..vertices - 1 {
            rest_edges.push(frame.inwards(edge(i)));
            frame.turn_to(edge(i));
        }
        let rest_lengths = (0..vertices - 1).map(|i| edge(i).length()).collect();
        Self { previous: positions.clone(), positions, rest_edges, rest_lengths, root_frame }
    }

    /// Vertices of one of them from root to tip.
    pub fn positions(&self, strand: usize) -> Vec<Vec3> {
        self.positions.iter().map(|vertex| vertex.lane(strand)).collect()
    }

    /// Moves on by `dt` seconds under `wind`, an acceleration in m/s² of which each edge feels the
    /// part across it. O(vertices).
    pub fn step(&mut self, dt: f32, wind: Vec3, params: &StrandParams) {
        step(self, dt, wind, params);
    }

    #[inline(always)]
    fn move_on(&mut self, dt: f32, wind: Vec3, params: &StrandParams) {
        let keep = Numbers::all((-params.damping_per_s * dt).exp());
        let (wind, squared) = (Vectors::all(wind), Numbers::all(dt * dt));
        for i in 2..self.positions.len() {
            let along = (self.positions[i] - self.positions[i - 1]).unit_or(Vectors::all(Vec3::ZERO));
            let push = (wind - along * wind.dot(along)) * squared;
            let moved = self.positions[i] + (self.positions[i] - self.previous[i]) * keep + push;
            self.previous[i] = self.positions[i];
            self.positions[i] = moved;
        }
        self.pull_to_rest_shape(0.5 * params.stiffness.min(0.95), params.shape_iterations as usize);
        for _ in 0..params.length_iterations {
            self.restore_lengths();
        }
        self.restore_lengths_exactly();
    }

    /// So many passes from root to tip. A pass follows the one before it two edges behind, where that one
    /// touches nothing any more: it comes out to the bit as if one ran after the other, but each edge of a pass
    /// waits for the edge before it, and meanwhile the processor reckons with the other passes.
    #[inline(always)]
    fn pull_to_rest_shape(&mut self, share: f32, passes: usize) {
        const BEHIND: usize = 2;
        let edges = self.rest_edges.len();
        let mut frames = vec![self.root_frame; passes];
        for first in 0..edges + BEHIND * passes.saturating_sub(1) {
            for (pass, frame) in frames.iter_mut().enumerate() {
                let Some(i) = first.checked_sub(BEHIND * pass) else { break };
                if i < edges {
                    Self::pull_edge(&mut self.positions, self.rest_edges[i], i, frame, share);
                }
            }
        }
    }

    /// Pulls edge `i` to where it is at rest in the frame of the edge before it, and turns that frame to it.
    #[inline(always)]
    fn pull_edge(positions: &mut [Vectors], rest: [Numbers; 3], i: usize, frame: &mut Frame, share: f32) {
        let (mut from, mut to) = (positions[i], positions[i + 1]);
        let pull = (from + frame.outwards(rest) - to) * Numbers::all(share);
        if i >= 2 {
            from = from - pull;
        }
        if i >= 1 {
            to = to + pull;
        }
        (positions[i], positions[i + 1]) = (from, to);
        frame.turn_to(to - from);
    }

    #[inline(always)]
    fn restore_lengths(&mut self) {
        for parity in 0..2 {
            for i in (1 + parity..self.rest_lengths.len()).step_by(2) {
                let edge = self.positions[i + 1] - self.positions[i];
                let length = edge.length();
                let excess = edge * (Numbers::all(1.0) - self.rest_lengths[i] / length);
                // An edge without length has no direction to be stretched in.
                let excess = excess.or_where_not(length.above(Numbers::all(0.0)), Vectors::all(Vec3::ZERO));
                if i >= 2 {
                    let half = excess * Numbers::all(0.5);
                    self.positions[i] = self.positions[i] + half;
                    self.positions[i + 1] = self.positions[i + 1] - half;
                } else {
                    self.positions[i + 1] = self.positions[i + 1] - excess;
                }
            }
        }
    }

    #[inline(always)]
    fn restore_lengths_exactly(&mut self) {
        for i in 1..self.rest_lengths.len() {
            let edge = self.positions[i + 1] - self.positions[i];
            let direction = edge
                .unit_or_else(|| (self.positions[i] - self.positions[i - 1]).unit_or(Vectors::all(Vec3::Y)));
            self.positions[i + 1] = self.positions[i] + direction * self.rest_lengths[i];
        }
    }
}

/// [`Strands::step`]: where the processor's registers hold all lanes, to the same bits in half as many steps.
#[multiversion(targets("x86_64+avx2"))]
fn step(strands: &mut Strands, dt: f32, wind: Vec3, params: &StrandParams) {
    strands.move_on(dt, wind, params);
}

/// Axes of unit length at right angles to each other, for each strand.
#[derive(Clone, Copy, Debug)]
struct Frame {
    x: Vectors,
    y: Vectors,
    z: Vectors,
}

impl Frame {
    /// A vector given along the axes.
    #[inline(always)]
    fn outwards(&self, [x, y, z]: [Numbers; 3]) -> Vectors {
        self.x * x + self.y * y + self.z * z
    }

    /// How far a vector goes along each axis.
    fn inwards(&self, vector: Vectors) -> [Numbers; 3] {
        [self.x.dot(vector), self.y.dot(vector), self.z.dot(vector)]
    }

    /// Turns it by the shortest way such that its x axis points along `edge`.
    #[inline(always)]
    fn turn_to(&mut self, edge: Vectors) {
        let length = edge.length();
        let direction = edge * (Numbers::all(1.0) / length);
        // Half turns have no shortest way: they keep the y axis.
        let beyond = length + self.x.dot(edge);
        let y = self.y - (self.x + direction) * (edge.dot(self.y) / beyond);
        let y = y.or_where_not(beyond.above(Numbers::all(1e-6) * length), self.y);
        let has_length = length.above(Numbers::all(1e-12));
        self.z = direction.cross(y).or_where_not(has_length, self.z);
        self.y = y.or_where_not(has_length, self.y);
        self.x = direction.or_where_not(has_length, self.x);
    }
}

/// A strand's vertices at successive moments: `frames[f][v]`.
pub type Motion = Vec<Vec<Vec3>>;

/// How a blade with this midrib (≥ 2 points) moves in a gusty wind: see [`motions_in_wind`].
pub fn motion_in_wind(midrib: &[Vec3], frames: usize) -> Motion {
    motions_in_wind(&[midrib], frames).swap_remove(0)
}

/// How blades with these midribs (≥ 2 points) move in a gusty wind: `frames` samples, evenly over two
/// seconds from rest, of each. Two winds at right angles with their own rhythms, so that bending in both
/// directions takes part. See [`motions_under`].
pub fn motions_in_wind(midribs: &[&[Vec3]], frames: usize) -> Vec<Motion> {
    // Bends a blade of 0.2 m by up to 0.4 of its length.
    const STRENGTH: f32 = 1.5;
    let wind = |t: f32| Vec3::new((3.1 * t).sin() + 0.4 * (11.3 * t).sin(), 0.0, 0.7 * (2.3 * t + 1.0).sin());
    motions_under(midribs, frames, |t| wind(t) * STRENGTH)
}

/// How blades with these midribs (≥ 2 points) move under `wind`, an acceleration in m/s² at a time in
/// seconds: `frames` samples, evenly over two seconds from rest, of each.
///
/// The stiffness of a chain depends on its number of links, so each midrib is simulated with 16
/// links whatever its own number, and its vertices are carried along by cubic interpolation.
/// O(blades · (frames · vertices + 120 · 16)).
pub fn motions_under(midribs: &[&[Vec3]], frames: usize, wind: impl Fn(f32) -> Vec3) -> Vec<Motion> {
    const LINKS: usize = 16;
    const STEPS: usize = 120;
    const DT: f32 = 1.0 / 60.0;
    let params = StrandParams::default();
    let mut motions = Vec::with_capacity(midribs.len());
    for midribs in midribs.chunks(Strands::MOST) {
        let rest: Vec<Vec<Vec3>> =
            midribs.iter().map(|midrib| polyline::resample(midrib, LINKS + 1)).collect();
        // Where each vertex is on the chain, in links from the root.
        let places: Vec<Vec<Place>> = midribs
            .iter()
            .map(|midrib| {
                let cumulative = polyline::cumulative_length(midrib);
                let total = cumulative.last().copied().unwrap_or(0.0).max(f32::MIN_POSITIVE);
                cumulative.iter().map(|s| Place::new(s / total * LINKS as f32, LINKS)).collect()
            })
            .collect();
        let mut strands = Strands::at_rest(&rest);
        let first = motions.len();
        motions.extend(midribs.iter().map(|_| Motion::with_capacity(frames)));
        for step in 1..=STEPS {
            strands.step(DT, wind(step as f32 * DT), &params);
            if step * frames / STEPS > (step - 1) * frames / STEPS {
                for (strand, (motion, places)) in motions[first..].iter_mut().zip(&places).enumerate() {
                    let positions = strands.positions(strand);
                    motion.push(along(&positions, places));
                }
            }
        }
    }
    motions
}

/// A place on a chain: after so many links, and what the points and slopes at the ends of the next one count
/// there.
struct Place {
    link: usize,
    weights: [f32; 4],
}

impl Place {
    /// `t` links from the first point of a chain of so many links, ≥ 1.
    fn new(t: f32, links: usize) -> Self {
        let link = (t as usize).min(links - 1);
        let t = t - link as f32;
        let (t2, t3) = (t * t, t * t * t);
        let weights = [2.0 * t3 - 3.0 * t2 + 1.0, t3 - 2.0 * t2 + t, 3.0 * t2 - 2.0 * t3, t3 - t2];
        Self { link, weights }
    }
}

/// The Catmull–Rom curve through `points` (≥ 2) at some places.
fn along(points: &[Vec3], places: &[Place]) -> Vec<Vec3> {
    let last = points.len() - 1;
    let slope = |i: usize| {
        let before = if i > 0 { points[i - 1] } else { 2.0 * points[0] - points[1] };
        let after = if i < last { points[i + 1] } else { 2.0 * points[last] - points[last - 1] };
        (after - before) * 0.5
    };
    let slopes: Vec<Vec3> = (0..=last).map(slope).collect();
    let at = |Place { link, weights: [p1, m1, p2, m2] }: &Place| {
        let next = link + 1;
        points[*link] * *p1 + slopes[*link] * *m1 + points[next] * *p2 + slopes[next] * *m2
    };
    places.iter().map(at).collect()
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
        let mut strand = Strands::at_rest(std::slice::from_ref(&rest));
        for _ in 0..600 {
            strand.step(1.0 / 60.0, Vec3::ZERO, &StrandParams::default());
        }
        let positions = strand.positions(0);
        let moved = positions.iter().zip(&rest).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
        assert!(moved < 2e-4, "{moved}");
    }

    #[test]
    fn strands_side_by_side_move_as_each_alone() {
        let shapes: Vec<Vec<Vec3>> =
            (0..11).map(|k| arc(40 + k).iter().map(|p| *p * (1.0 + 0.1 * k as f32)).collect()).collect();
        let midribs: Vec<&[Vec3]> = shapes.iter().map(Vec::as_slice).collect();
        let together = motions_in_wind(&midribs, 5);
        let alone: Vec<Motion> = midribs.iter().map(|midrib| motion_in_wind(midrib, 5)).collect();
        assert_eq!(together, alone);
    }

    #[test]
    fn wind_bends_it_keeps_its_length_and_it_comes_back() {
        let rest = arc(33);
        let mut strand = Strands::at_rest(std::slice::from_ref(&rest));
        for _ in 0..60 {
            strand.step(1.0 / 60.0, Vec3::Z * 12.0, &StrandParams::default());
        }
        let tip = strand.positions(0)[32];
        assert!(tip.z > rest[32].z + 0.01, "the tip goes with the wind: {tip}");
        assert!((polyline::length(&strand.positions(0)) / polyline::length(&rest) - 1.0).abs() < 1e-4);
        assert_eq!(strand.positions(0)[..2], rest[..2]);
        for _ in 0..1200 {
            strand.step(1.0 / 60.0, Vec3::ZERO, &StrandParams::default());
        }
        assert!(strand.positions(0)[32].distance(rest[32]) < 0.01 * 0.2);
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
