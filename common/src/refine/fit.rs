//! Knots chosen so that the blade between them moves as nearly as can be in straight lines.

use glam::Vec3;

use crate::blade::Knot;
use crate::geometry::polyline;
use crate::strand::Motion;

/// Halvings of the bound on the deviation.
const HALVINGS: usize = 7;

/// Indices of `count` (≥ 2, fewer than the skeleton has) vertices to keep, ascending, first and last among
/// them: the largest deviation of the vertices left out is as small as can be, to one part in 2⁷ of what it
/// is with as many at even steps.
///
/// A bound on the deviation decides how many vertices are needed: each stretch goes on for as long as it
/// stays within. The bound is halved in until the count is met; vertices that are left over split the
/// worst stretches. O(n·log n·frames) for each halving.
pub(super) fn keep(skeleton: &[Knot], motion: &Motion, distance_weight: f32, count: usize) -> Vec<usize> {
    let deviation = Deviation::new(skeleton, motion, distance_weight);
    let last = skeleton.len() - 1;
    let mut kept: Vec<usize> = (0..count).map(|k| (k * last + (count - 1) / 2) / (count - 1)).collect();
    let stretches = kept.windows(2).map(|ends| deviation.of(ends[0], ends[1], f32::INFINITY));
    let (mut low, mut high) = (0.0, stretches.fold(0.0, f32::max));
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

/// The larger of two numbers: unlike `max`, a single instruction.
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// How far a blade deviates from straight stretches between its vertices.
struct Deviation {
    /// Left and right edge at rest.
    edges: Vec<[Vec3; 2]>,
    /// Each vertex's positions over time, one vertex after the other, [`LANES`] moments together; the last
    /// moment fills up what is over.
    tracks: Vec<Moments>,
    /// Elements of `tracks` for a vertex.
    stride: usize,
    /// Arc length from the root to each vertex.
    along: Vec<f32>,
    distance_weight: f32,
}

/// As many as every processor reckons with at a time.
const LANES: usize = 4;

/// x, y and z of a vertex at some moments.
type Moments = [[f32; LANES]; 3];

impl Deviation {
    fn new(skeleton: &[Knot], motion: &Motion, distance_weight: f32) -> Self {
        let midrib: Vec<Vec3> = skeleton.iter().map(|knot| knot.position).collect();
        let stride = motion.len().div_ceil(LANES);
        let mut tracks = Vec::with_capacity(stride * skeleton.len());
        for vertex in 0..skeleton.len() {
            tracks.extend(motion.chunks(LANES).map(|frames| {
                let at = |lane: usize| frames[lane.min(frames.len() - 1)][vertex];
                [0, 1, 2].map(|axis| std::array::from_fn(|lane| at(lane)[axis]))
            }));
        }
        Self {
            edges: skeleton.iter().map(|knot| [knot.left(), knot.right()]).collect(),
            tracks,
            stride,
            along: polyline::cumulative_length(&midrib),
            distance_weight,
        }
    }

    fn track(&self, vertex: usize) -> &[Moments] {
        &self.tracks[vertex * self.stride..(vertex + 1) * self.stride]
    }

    /// Of the vertices between `from` and `to`, metres: μ times the farthest that an edge at rest is from
    /// where the stretch puts it, and 1 − μ times the farthest that a vertex ever is. Some value above
    /// `bound` if it is above that.
    fn of(&self, from: usize, to: usize, bound: f32) -> f32 {
        let span = (self.along[to] - self.along[from]).max(f32::MIN_POSITIVE);
        let ([a_left, a_right], [b_left, b_right]) = (self.edges[from], self.edges[to]);
        let (mut rest, mut farthest) = (0.0_f32, [0.0_f32; LANES]);
        let weighed = |rest: f32, farthest: [f32; LANES]| {
            self.weighed(rest, farthest.into_iter().reduce(larger).unwrap_or(0.0))
        };
        // The middle is the likeliest to be far off: what is too much is soon told.
        let middle = from.midpoint(to).max(from + 1);
        for (nth, vertex) in (middle..to).chain(from + 1..middle).enumerate() {
            let t = (self.along[vertex] - self.along[from]) / span;
            let [left, right] = self.edges[vertex];
            let off_left = left.distance_squared(a_left.lerp(b_left, t));
            let off_right = right.distance_squared(a_right.lerp(b_right, t));
            rest = larger(larger(off_left, off_right), rest);
            let ends = self.track(from).iter().zip(self.track(to));
            for (position, (a, b)) in self.track(vertex).iter().zip(ends) {
                for (lane, farthest) in farthest.iter_mut().enumerate() {
                    let off = [0, 1, 2].map(|axis| {
                        position[axis][lane] - (a[axis][lane] + (b[axis][lane] - a[axis][lane]) * t)
                    });
                    let squared = off[0] * off[0] + off[1] * off[1] + off[2] * off[2];
                    *farthest = larger(squared, *farthest);
                }
            }
            // To look takes as long as a vertex.
            if nth % 4 == 0 && weighed(rest, farthest) > bound {
                break;
            }
        }
        weighed(rest, farthest)
    }

    fn weighed(&self, rest: f32, moving: f32) -> f32 {
        rest.sqrt() * self.distance_weight + moving.sqrt() * (1.0 - self.distance_weight)
    }

    /// The ends of the longest stretches from the root on that stay within `bound`; none if that takes
    /// more than `count` vertices.
    fn stretches(&self, bound: f32, count: usize) -> Option<Vec<usize>> {
        let last = self.edges.len() - 1;
        let mut kept = vec![0];
        let mut from = 0;
        while from < last {
            if kept.len() == count {
                return None;
            }
            // Stretches one after the other are about as long.
            let like = from - kept.iter().rev().nth(1).copied().unwrap_or(from);
            from = self.farthest_within(from, like.max(1), bound);
            kept.push(from);
        }
        Some(kept)
    }

    /// The end of the longest stretch from `from` on that stays within `bound`, by doubling and halving around
    /// the length that is likely: a longer one is taken to deviate more.
    fn farthest_within(&self, from: usize, likely: usize, bound: f32) -> usize {
        let last = self.edges.len() - 1;
        let fits = |to: usize| self.of(from, to, bound) <= bound;
        let (mut within, mut beyond) = (from + 1, last + 1);
        let mut step = 1;
        let guess = (from + likely).clamp(within, last);
        if guess == within || fits(guess) {
            within = guess;
            while within < last && fits((within + step).min(last)) {
                within = (within + step).min(last);
                step *= 2;
            }
            beyond = beyond.min(within + step);
        } else {
            beyond = guess;
            while beyond - within > step && !fits(beyond - step) {
                beyond -= step;
                step *= 2;
            }
            within = within.max(beyond.saturating_sub(step));
        }
        while beyond - within > 1 {
            let middle = within.midpoint(beyond);
            if fits(middle) { within = middle } else { beyond = middle }
        }
        within
    }
}
