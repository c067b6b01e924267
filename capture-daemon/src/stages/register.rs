//! How what a visitor holds has moved since the first frame of a hold: a hand trembles, and frames can
//! only be added up where they show the same thing at the same place.
//!
//! What is held moves as one rigid body. Its motion is found from its silhouette, which tells how it
//! moved across the picture, and from its depth, which tells the rest.

use std::ops::RangeInclusive;

use glam::{Vec2, Vec3};

use super::motion::{Fit, Motion};
use crate::frame::{CameraModel, DepthFrame};

/// Two edges per row of a picture would be more than are needed.
const MAX_EDGES: usize = 700;
const MAX_SURFACE: usize = 500;
/// Parts wider than this are a hand, or nothing that tells how blades move, metres.
const THIN_M: f32 = 0.040;
/// What an edge of such a part counts.
const THICK_WEIGHT: f32 = 0.1;
/// Noise of the place of an edge, pixels, and of a reading, metres.
const EDGE_PX: f32 = 0.6;
const READING_M: f32 = 0.0015;
/// What moves less than this across its edges (root mean square), pixels, and in depth, metres, is still.
const STILL_PX: f32 = 0.15;
/// Sum of the squares of what edges seem to have moved while all is still: it does not grow with their
/// number, for a motion has six parts.
const NOISE_PX2: f32 = 30.0;
const STILL_M: f32 = 0.0005;
/// A reading farther off than this is of something else, metres.
const OTHER_M: f32 = 0.015;
/// Where depth is not known beside what is held, that of the nearest pixel this far off counts.
const MARGIN_PX: usize = 8;

/// A place where what is held ends, seen along a row or a column.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Edge {
    /// In space, camera frame.
    point: Vec3,
    /// Across the edge in the image, out of what is held; unit vector.
    normal: Vec2,
    weight: f32,
}

/// The first frame of a hold, as what later ones are compared with.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Reference {
    camera: CameraModel,
    edges: Vec<Edge>,
    surface: Vec<(Vec3, f32)>,
    pivot: Vec3,
    /// Depth of what is held and, around it, of its nearest pixel, metres; 0 elsewhere.
    pub(super) depth_m: Vec<f32>,
    /// Columns of each row that have such a depth.
    pub(super) spans: Vec<std::ops::Range<usize>>,
    last: Motion,
}

impl Reference {
    /// Takes a frame's region and depth window; `None` if too little is there to tell a motion.
    pub(super) fn of(frame: &DepthFrame, region: [usize; 4], window: &RangeInclusive<u16>) -> Option<Self> {
        let view = View { frame, region, window };
        let mut edges = view.edges();
        let mut surface = view.surface();
        if edges.len() < 24 || surface.len() < 12 {
            return None;
        }
        thin_out(&mut edges, MAX_EDGES);
        thin_out(&mut surface, MAX_SURFACE);
        let pivot = surface.iter().map(|(point, _)| *point).sum::<Vec3>() / surface.len() as f32;
        let (depth_m, spans) = view.surroundings();
        let last = Motion::none(pivot);
        Some(Self { camera: frame.camera, edges, surface, pivot, depth_m, spans, last })
    }

    /// The motion from the first frame to `frame`; `None` if it shows something else, or nothing that
    /// fits. O(edges).
    ///
    /// Gauss–Newton on the distances of edges across themselves and on depth, robust against what does
    /// not move along; starts from the motion of the frame before.
    pub(super) fn motion_to(
        &mut self,
        frame: &DepthFrame,
        region: [usize; 4],
        window: &RangeInclusive<u16>,
    ) -> Option<Motion> {
        const REACHES_PX: [i32; 6] = [7, 5, 4, 3, 3, 3];
        let view = View { frame, region, window };
        let mut motion = self.last;
        let mut fit = Fit::default();
        for reach in REACHES_PX {
            fit = Fit::default();
            for edge in &self.edges {
                self.add_edge(&mut fit, &view, &motion, edge, reach);
            }
            for (point, weight) in &self.surface {
                self.add_reading(&mut fit, &view, &motion, *point, *weight);
            }
            let [turn, by] = fit.solve(&motion)?;
            motion = motion.then(turn, by);
            if turn.length() < 1e-4 && by.length() < 2e-5 {
                break;
            }
        }
        let total: f32 = self.edges.iter().map(|edge| edge.weight).sum();
        let found = fit.matched > 0.4 * total;
        let small = motion.translation.length() < 0.03 && motion.turn().length() < 0.15;
        if !(found && small) {
            return None;
        }
        self.last = motion;
        Some(motion)
    }

    /// Whether a motion is so small that it is but the noise of finding one. How far it carries a blade
    /// along itself does not count: of a still one that cannot be told.
    pub(super) fn is_still(&self, motion: &Motion) -> bool {
        let (mut across, mut deep, mut total) = (0.0, 0.0, 0.0);
        for edge in &self.edges {
            let point = motion.apply(edge.point);
            let shift = edge.normal.dot(self.project(point) - self.project(edge.point));
            across += edge.weight * shift * shift;
            deep += edge.weight * (point.z - edge.point.z).powi(2);
            total += edge.weight;
        }
        across < (total * STILL_PX * STILL_PX).max(NOISE_PX2) && deep < total * STILL_M * STILL_M
    }

    fn project(&self, point: Vec3) -> Vec2 {
        let CameraModel { fx, fy, cx, cy } = self.camera;
        Vec2::new(fx as f32 * point.x / point.z + cx as f32, fy as f32 * point.y / point.z + cy as f32)
    }

    fn add_edge(&self, fit: &mut Fit, view: &View<'_>, motion: &Motion, edge: &Edge, reach: i32) {
        let point = motion.apply(edge.point);
        let at = self.project(point);
        let Some(found) = view.nearest_edge(at, edge.normal, reach) else { return };
        let residual = edge.normal.dot(found - at);
        let robust = 1.0 / (1.0 + (residual / 1.2).powi(2));
        let (fx, fy) = (self.camera.fx as f32, self.camera.fy as f32);
        let n = edge.normal;
        // How the place across the edge changes with the point.
        let change = Vec3::new(
            n.x * fx / point.z,
            n.y * fy / point.z,
            -(n.x * fx * point.x + n.y * fy * point.y) / (point.z * point.z),
        );
        fit.add(change, point - self.pivot, residual, edge.weight * robust / (EDGE_PX * EDGE_PX));
        fit.matched += edge.weight;
    }

    fn add_reading(&self, fit: &mut Fit, view: &View<'_>, motion: &Motion, point: Vec3, weight: f32) {
        let point = motion.apply(point);
        let at = self.project(point);
        let Some(z) = view.reading_at(at) else { return };
        let residual = z - point.z;
        if residual.abs() < OTHER_M {
            let robust = 1.0 / (1.0 + (residual / (3.0 * READING_M)).powi(2));
            let weight = weight * robust / (READING_M * READING_M);
            fit.add(Vec3::Z, point - self.pivot, residual, weight);
        }
    }
}

/// Every n-th, so that at most `most` are left.
fn thin_out<T: Copy>(items: &mut Vec<T>, most: usize) {
    let step = items.len().div_ceil(most).max(1);
    *items = items.iter().copied().step_by(step).collect();
}

/// The part of a frame that counts.
struct View<'a> {
    frame: &'a DepthFrame,
    region: [usize; 4],
    window: &'a RangeInclusive<u16>,
}

impl View<'_> {
    fn held(&self, x: i32, y: i32) -> bool {
        let [x0, y0, x1, y1] = self.region.map(|edge| edge as i32);
        let inside = x >= x0 && y >= y0 && x < x1 && y < y1;
        inside && self.window.contains(&self.frame.depth[y as usize * self.frame.width + x as usize])
    }

    fn reading_at(&self, at: Vec2) -> Option<f32> {
        let (x, y) = ((at.x + 0.5).floor() as i32, (at.y + 0.5).floor() as i32);
        self.held(x, y).then(|| self.metres(x as usize, y as usize))
    }

    fn metres(&self, x: usize, y: usize) -> f32 {
        (f64::from(self.frame.depth[y * self.frame.width + x]) * self.frame.depth_unit_m) as f32
    }

    /// Runs of two pixels or more that are held, within a row (`down`: within a column).
    fn runs(&self, line: usize, down: bool) -> Vec<(usize, usize)> {
        let [x0, y0, x1, y1] = self.region;
        let (from, to) = if down { (y0, y1) } else { (x0, x1) };
        let held = |k: usize| {
            let (x, y) = if down { (line, k) } else { (k, line) };
            self.window.contains(&self.frame.depth[y * self.frame.width + x])
        };
        let mut runs = Vec::new();
        let mut start = None;
        for k in from..=to {
            let now = k < to && held(k);
            match (start, now) {
                (None, true) => start = Some(k),
                (Some(first), false) => {
                    if k - first >= 2 {
                        runs.push((first, k));
                    }
                    start = None;
                }
                _ => {}
            }
        }
        runs
    }

    /// What an edge or a reading of a run counts: how wide the run is in space.
    fn weight(&self, width_px: usize, z: f32) -> f32 {
        let width = width_px as f32 / self.frame.camera.fx as f32 * z;
        if width < THIN_M { 1.0 } else { THICK_WEIGHT }
    }

    /// The edges of what is held, each along the axis that it lies across most.
    fn edges(&self) -> Vec<Edge> {
        let [x0, y0, x1, y1] = self.region;
        let mut edges = Vec::new();
        for (down, lines, border) in [(false, y0..y1, (x0, x1)), (true, x0..x1, (y0, y1))] {
            for line in lines {
                for (first, end) in self.runs(line, down) {
                    // The second pixel inward is not mixed with what is behind.
                    for (out, inner, beyond) in [
                        (first, (first + 1).min(end - 1), first == border.0),
                        (end, end.saturating_sub(2).max(first), end == border.1),
                    ] {
                        if beyond {
                            continue;
                        }
                        let place = out as f32 - 0.5;
                        let (u, v) = if down { (line as f32, place) } else { (place, line as f32) };
                        let Some(normal) = self.outward(u, v) else { continue };
                        let leans = if down {
                            normal.y.abs() > normal.x.abs()
                        } else {
                            normal.x.abs() >= normal.y.abs()
                        };
                        let outward =
                            if down { normal.y } else { normal.x } * if out == first { -1.0 } else { 1.0 };
                        if !leans || outward < 0.0 {
                            continue;
                        }
                        let z = if down { self.metres(line, inner) } else { self.metres(inner, line) };
                        let point = self.frame.camera.deproject(u.into(), v.into(), z.into());
                        edges.push(Edge { point, normal, weight: self.weight(end - first, z) });
                    }
                }
            }
        }
        edges
    }

    /// Out of what is held, from how much of it lies around an edge.
    fn outward(&self, u: f32, v: f32) -> Option<Vec2> {
        const HALF: i32 = 3;
        let (x, y) = (u.round() as i32, v.round() as i32);
        let mut sum = Vec2::ZERO;
        for dy in -HALF..=HALF {
            for dx in -HALF..=HALF {
                if self.held(x + dx, y + dy) {
                    sum -= Vec2::new((x + dx) as f32 - u, (y + dy) as f32 - v);
                }
            }
        }
        // Of a blade thinner than the window the sum shrinks, but keeps its direction.
        (sum.length() > 1.0).then(|| sum.normalize())
    }

    /// Points of the surface, from the middle of each run of a row.
    fn surface(&self) -> Vec<(Vec3, f32)> {
        let mut points = Vec::new();
        for y in self.region[1]..self.region[3] {
            for (first, end) in self.runs(y, false) {
                if end - first < 4 {
                    continue;
                }
                let x = (first + end) / 2;
                let z = self.metres(x, y);
                points.push((
                    self.frame.camera.deproject(x as f64, y as f64, z.into()),
                    self.weight(end - first, z),
                ));
            }
        }
        points
    }

    /// The edge nearest to a place whose outward normal points the same way along the main axis.
    fn nearest_edge(&self, at: Vec2, normal: Vec2, reach: i32) -> Option<Vec2> {
        if !(at.is_finite() && at.abs().max_element() < 1e5) {
            return None;
        }
        let down = normal.y.abs() > normal.x.abs();
        let (along, line) = if down { (at.y, at.x) } else { (at.x, at.y) };
        let line = line.round() as i32;
        let held = |k: i32| if down { self.held(line, k) } else { self.held(k, line) };
        let outward = if (if down { normal.y } else { normal.x }) > 0.0 { 1 } else { -1 };
        // `k` is held, and so is its neighbour inward; its neighbour outward is not.
        let is_edge = |k: i32| held(k) && !held(k + outward) && held(k - outward);
        let place = |k: i32| k as f32 + 0.5 * outward as f32;
        let middle = along.round() as i32;
        let found = (-reach..=reach)
            .map(|d| middle + d)
            .filter(|k| is_edge(*k))
            .min_by(|a, b| (place(*a) - along).abs().total_cmp(&(place(*b) - along).abs()))?;
        // What is cut off by the border is no edge.
        let [x0, y0, x1, y1] = self.region.map(|edge| edge as i32);
        let out = found + outward;
        let inside = if down { out >= y0 && out < y1 } else { out >= x0 && out < x1 };
        inside.then(|| {
            if down { Vec2::new(line as f32, place(found)) } else { Vec2::new(place(found), line as f32) }
        })
    }

    /// Depth of what is held, spread over [`MARGIN_PX`] around it, and where in each row that is.
    fn surroundings(&self) -> (Vec<f32>, Vec<std::ops::Range<usize>>) {
        let (width, height) = (self.frame.width, self.frame.height);
        let [x0, y0, x1, y1] = self.region;
        let mut depth = vec![0.0_f32; width * height];
        for y in y0..y1 {
            for x in x0..x1 {
                if self.window.contains(&self.frame.depth[y * width + x]) {
                    depth[y * width + x] = self.metres(x, y);
                }
            }
        }
        // Along rows, then along columns: the nearest one within the margin.
        let mut spread = |from: usize, count: usize, stride: usize| {
            let source: Vec<f32> = (0..count).map(|k| depth[from + k * stride]).collect();
            let mut known: Option<usize> = None;
            for k in 0..count {
                if source[k] > 0.0 {
                    known = Some(k);
                } else if let Some(before) = known.filter(|before| k - before <= MARGIN_PX) {
                    depth[from + k * stride] = source[before];
                }
            }
            let mut known: Option<usize> = None;
            for k in (0..count).rev() {
                if source[k] > 0.0 {
                    known = Some(k);
                } else if let Some(after) = known.filter(|after| after - k <= MARGIN_PX) {
                    let before = (1..=after - k).any(|d| k >= d && source[k - d] > 0.0);
                    if !before {
                        depth[from + k * stride] = source[after];
                    }
                }
            }
        };
        for y in y0..y1 {
            spread(y * width + x0, x1 - x0, 1);
        }
        for x in x0..x1 {
            spread(y0 * width + x, y1 - y0, width);
        }
        let span = |y: usize| {
            let row = &depth[y * width..(y + 1) * width];
            let first = row.iter().position(|z| *z > 0.0);
            let last = row.iter().rposition(|z| *z > 0.0);
            first.zip(last).map_or(0..0, |(first, last)| first..last + 1)
        };
        let spans = (0..height).map(span).collect();
        (depth, spans)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::mask::MaskParams;
    use crate::synth::{Clip, ClipParams, Family, Scene};

    /// Frame by frame of the hold, how far off its motion takes the blades of a held tuft at most, metres.
    fn errors(seed: u64) -> Vec<f32> {
        let clip = ClipParams { frames: 60, ..ClipParams::default() };
        let clip = Clip::new(Scene::new(Family::Held, seed), clip).expect("valid");
        let held = clip.visits()[0].held.clone();
        let params = MaskParams::default();
        let first = clip.frame(held.start);
        let (region, window) = (params.region(first.width, first.height), params.window(&first));
        let mut reference = Reference::of(&first, region, &window).expect("something is held");
        let error = |index: usize| {
            let found = reference.motion_to(&clip.frame(index), region, &window).expect("the same");
            let truth = clip.pose(0, index).expect("it is there");
            let points = clip.scene().blades.iter().flat_map(|blade| &blade.sections);
            let off = points.map(|section| {
                truth.apply(section.center).as_vec3().distance(found.apply(section.center.as_vec3()))
            });
            off.fold(0.0, f32::max)
        };
        (held.start + 1..held.end).map(error).collect()
    }

    #[test]
    fn the_tremor_of_a_hand_is_found() {
        for seed in [1, 2, 3] {
            let mut errors = errors(seed);
            errors.sort_by(f32::total_cmp);
            let (middle, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
            // Turning and moving take their tips up to 5 mm off. A pixel is a millimetre.
            assert!(middle < 0.0010 && worst < 0.0020, "seed {seed}: {middle} {worst} m");
        }
    }

    #[test]
    fn nothing_and_something_else_have_no_motion() {
        let clip = |family| Clip::new(Scene::new(family, 4), ClipParams::default()).expect("valid");
        let (empty, single) = (clip(Family::Empty).frame(20), clip(Family::Single).frame(20));
        let params = MaskParams::default();
        let (region, window) = (params.region(single.width, single.height), params.window(&single));
        assert_eq!(Reference::of(&empty, region, &window), None);
        let mut reference = Reference::of(&single, region, &window).expect("a blade");
        assert_eq!(reference.motion_to(&empty, region, &window), None);
        let still = clip(Family::Single).frame(25);
        let motion = reference.motion_to(&still, region, &window).expect("the same blade");
        assert!(reference.is_still(&motion));
    }
}
