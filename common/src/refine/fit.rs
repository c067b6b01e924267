//! Knots chosen so that the blade between them moves as nearly as can be in straight lines.

use glam::Vec3;

use crate::blade::Knot;
use crate::geometry::polyline;
use crate::strand::Motion;

/// Halvings of the bound on the deviation.
const HALVINGS: usize = 12;

/// Indices of `count` (≥ 2, fewer than the skeleton has) vertices to keep, ascending, first and last among
/// them: the largest deviation of the vertices left out is as small as can be, to one part in 2¹².
///
/// A bound on the deviation decides how many vertices are needed: each stretch goes on for as long as it
/// stays within. The bound is halved in until the count is met; vertices that are left over split the
/// worst stretches. O(n·log n·frames) for each halving.
pub(super) fn keep(skeleton: &[Knot], motion: &Motion, distance_weight: f32, count: usize) -> Vec<usize> {
    let deviation = Deviation::new(skeleton, motion, distance_weight);
    let last = skeleton.len() - 1;
    let (mut low, mut high) = (0.0, deviation.of(0, last, f32::INFINITY));
    let mut kept = vec![0, last];
    for _ in 0..HALVINGS {
        let bound = 0.5 * (low + high);
        match deviation.stretches(bound, count) {
            Some(fewer) => (kept, high) = (fewer, bound),
            None => low = bound,
        }
    }
    while kept.len() < count {
        let stretch = |at: &usize| deviation.of(kept[*at], kept[at + 1], f32::INFINITY);
        let splittable = (0..kept.len() - 1).filter(|at| kept[at + 1] - kept[*at] > 1);
        let Some(worst) = splittable.max_by(|a, b| stretch(a).total_cmp(&stretch(b))) else { break };
        let (from, to) = (kept[worst], kept[worst + 1]);
        let halves =
            |at: &usize| deviation.of(from, *at, f32::INFINITY).max(deviation.of(*at, to, f32::INFINITY));
        let middle_first = (from + 1..to).min_by(|a, b| halves(a).total_cmp(&halves(b)));
        kept.insert(worst + 1, middle_first.unwrap_or(from + 1));
    }
    kept
}

/// How far a blade deviates from straight stretches between its vertices.
struct Deviation<'a> {
    skeleton: &'a [Knot],
    /// Each vertex's positions over time, one vertex after the other.
    tracks: Vec<Vec3>,
    frames: usize,
    /// Arc length from the root to each vertex.
    along: Vec<f32>,
    distance_weight: f32,
}

impl<'a> Deviation<'a> {
    fn new(skeleton: &'a [Knot], motion: &Motion, distance_weight: f32) -> Self {
        let midrib: Vec<Vec3> = skeleton.iter().map(|knot| knot.position).collect();
        let tracks = (0..skeleton.len()).flat_map(|vertex| motion.iter().map(move |frame| frame[vertex]));
        Self {
            skeleton,
            tracks: tracks.collect(),
            frames: motion.len(),
            along: polyline::cumulative_length(&midrib),
            distance_weight,
        }
    }

    fn track(&self, vertex: usize) -> &[Vec3] {
        &self.tracks[vertex * self.frames..(vertex + 1) * self.frames]
    }

    /// Of the vertices between `from` and `to`, metres: μ times the farthest that an edge at rest is from
    /// where the stretch puts it, and 1 − μ times the farthest that a vertex ever is. Some value above
    /// `bound` if it is above that.
    fn of(&self, from: usize, to: usize, bound: f32) -> f32 {
        let span = (self.along[to] - self.along[from]).max(f32::MIN_POSITIVE);
        let (a, b) = (&self.skeleton[from], &self.skeleton[to]);
        let (mut rest, mut moving) = (0.0_f32, 0.0_f32);
        for vertex in from + 1..to {
            let t = (self.along[vertex] - self.along[from]) / span;
            let knot = &self.skeleton[vertex];
            rest = rest
                .max(knot.left().distance_squared(a.left().lerp(b.left(), t)))
                .max(knot.right().distance_squared(a.right().lerp(b.right(), t)));
            let ends = self.track(from).iter().zip(self.track(to));
            for (position, (a, b)) in self.track(vertex).iter().zip(ends) {
                moving = moving.max(position.distance_squared(*a + (*b - *a) * t));
            }
            if self.weighed(rest, moving) > bound {
                break;
            }
        }
        self.weighed(rest, moving)
    }

    fn weighed(&self, rest: f32, moving: f32) -> f32 {
        rest.sqrt() * self.distance_weight + moving.sqrt() * (1.0 - self.distance_weight)
    }

    /// The ends of the longest stretches from the root on that stay within `bound`; none if that takes
    /// more than `count` vertices.
    fn stretches(&self, bound: f32, count: usize) -> Option<Vec<usize>> {
        let last = self.skeleton.len() - 1;
        let mut kept = vec![0];
        let mut from = 0;
        while from < last {
            if kept.len() == count {
                return None;
            }
            from = self.farthest_within(from, bound);
            kept.push(from);
        }
        Some(kept)
    }

    /// The end of the longest stretch from `from` on that stays within `bound`, by doubling and halving: a
    /// longer one is taken to deviate more.
    fn farthest_within(&self, from: usize, bound: f32) -> usize {
        let last = self.skeleton.len() - 1;
        let fits = |to: usize| self.of(from, to, bound) <= bound;
        let (mut within, mut step) = (from + 1, 1);
        while within < last && fits((within + step).min(last)) {
            within = (within + step).min(last);
            step *= 2;
        }
        let mut beyond = (within + step).min(last + 1);
        while beyond - within > 1 {
            let middle = within.midpoint(beyond);
            if fits(middle) { within = middle } else { beyond = middle }
        }
        within
    }
}
