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
/// worst stretches. O(n²·frames / count) for each halving.
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
    motion: &'a Motion,
    /// Arc length from the root to each vertex.
    along: Vec<f32>,
    distance_weight: f32,
}

impl<'a> Deviation<'a> {
    fn new(skeleton: &'a [Knot], motion: &'a Motion, distance_weight: f32) -> Self {
        let midrib: Vec<Vec3> = skeleton.iter().map(|knot| knot.position).collect();
        Self { skeleton, motion, along: polyline::cumulative_length(&midrib), distance_weight }
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
            for frame in self.motion {
                moving = moving.max(frame[vertex].distance_squared(frame[from].lerp(frame[to], t)));
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
            let mut to = from + 1;
            while to < last && self.of(from, to + 1, bound) <= bound {
                to += 1;
            }
            kept.push(to);
            from = to;
        }
        Some(kept)
    }
}
