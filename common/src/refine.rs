//! Skeleton refinement by movement similarity: a skeleton of many vertices to one of few.
//!
//! Two methods. [`RefineMethod::Merge`] is the paper's: it merges the two neighbours that move most
//! alike until few enough are left. [`RefineMethod::Fit`] keeps the vertices between which the blade,
//! as it moves, stays closest to straight stretches, and is what is used by default.
//!
//! Why not the paper's: its difference of two neighbours is their distance and how much that
//! distance varies. A blade hardly stretches, so the distance of neighbours hardly varies, however
//! much they swing; what is left is their distance, and merging the closest pairs is an even
//! resampling, with the bends cut by midpoints. It buys even arc length between knots, as a simulation with one
//! stiffness for all links likes it. What a viewer sees is how far the few knots are from the many in
//! motion, and that is what the other method bounds.
//!
//! # Source
//! Fan & Sheng §4.4, Eq. 1–3 and Algorithm 1, mended: the variance is one (E\[d²\] − E\[d\]²) and enters
//! by its square root, so that both terms are lengths, divided by the blade's; the vertices are
//! replaced in the skeleton, not in the array of differences; root and tip stay where they are;
//! widths and cross directions are merged with the positions. The fit keeps Eq. 1's balance of distance
//! and movement by μ, taken over the stretches between knots instead of neighbours.

mod fit;

use glam::Vec3;

use crate::blade::Knot;
use crate::geometry::{distance, polyline};
use crate::strand::Motion;

/// How vertices are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RefineMethod {
    /// Keeps the vertices between which the moving blade is straightest.
    #[default]
    Fit,
    /// Merges neighbours that move alike (Fan & Sheng, Algorithm 1).
    Merge,
}

/// What to refine to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineParams {
    /// Knots to keep, ≥ 2.
    pub knots: usize,
    /// μ of Eq. 1, 0..=1: how much distance counts against movement. [`RefineMethod::Merge`]: neighbours'
    /// distance against its spread over time; [`RefineMethod::Fit`]: the deviation of the edges at rest
    /// against that of the midrib in motion.
    pub distance_weight: f32,
    /// How vertices are chosen.
    pub method: RefineMethod,
}

impl Default for RefineParams {
    fn default() -> Self {
        Self { knots: 16, distance_weight: 0.5, method: RefineMethod::Fit }
    }
}

/// A refined skeleton.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// Its knots, root and tip as before.
    pub knots: Vec<Knot>,
    /// Hausdorff distance of its midrib to the one before, metres (Eq. 4).
    pub hausdorff_m: f32,
}

/// Brings a skeleton to `params.knots` knots, root and tip as they are. Skeletons that have no more
/// come back unchanged.
///
/// `skeleton`: ≥ 2 knots from root to tip; `motion`: the same vertices at some moments, as
/// [`crate::strand::motion_in_wind`] gives them. Merging: O(n² + n·frames); fitting:
/// O(n·log n·frames).
///
/// # Panics
/// When a frame of `motion` has another number of vertices than the skeleton.
pub fn refine(skeleton: &[Knot], motion: &Motion, params: &RefineParams) -> Refined {
    assert!(motion.iter().all(|frame| frame.len() == skeleton.len()), "each frame shows every vertex");
    let count = params.knots.max(2);
    let knots = if skeleton.len() <= count {
        skeleton.to_vec()
    } else {
        match params.method {
            RefineMethod::Merge => merge(skeleton, motion, params.distance_weight, count),
            RefineMethod::Fit => fit::keep(skeleton, motion, params.distance_weight, count)
                .into_iter()
                .map(|kept| skeleton[kept])
                .collect(),
        }
    };
    let [midrib, refined] =
        [skeleton, &knots].map(|knots| knots.iter().map(|knot| knot.position).collect::<Vec<Vec3>>());
    Refined { hausdorff_m: distance::hausdorff(&midrib, &refined), knots }
}

/// A blade at a level of detail: some of its knots, root and tip among them.
pub type Level = Vec<usize>;

/// The levels of detail of a blade, fine to coarse: for each of `counts` (falling, ≥ 2) the indices, ascending,
/// of the knots of `skeleton` (≥ 2) that stay, each level's among those of the level before, so that one turns
/// into the next by knots that move onto the straight line between their neighbours. A level that asks for no
/// fewer knots than there are has them all.
///
/// `motion` and `distance_weight` as for [`refine`]; knots are kept as [`RefineMethod::Fit`] does. Each level is
/// measured against the whole skeleton's motion at the knots that the level before has kept.
/// O(levels · n·log n·frames).
///
/// # Panics
/// When a frame of `motion` has another number of vertices than the skeleton.
pub fn levels(skeleton: &[Knot], motion: &Motion, distance_weight: f32, counts: &[usize]) -> Vec<Level> {
    assert!(motion.iter().all(|frame| frame.len() == skeleton.len()), "each frame shows every vertex");
    let mut finer: Level = (0..skeleton.len()).collect();
    counts
        .iter()
        .map(|count| {
            let count = (*count).max(2);
            if count < finer.len() {
                let knots: Vec<Knot> = finer.iter().map(|index| skeleton[*index]).collect();
                let motion: Motion =
                    motion.iter().map(|frame| finer.iter().map(|index| frame[*index]).collect()).collect();
                let kept = fit::keep(&knots, &motion, distance_weight, count);
                finer = kept.into_iter().map(|index| finer[index]).collect();
            }
            finer.clone()
        })
        .collect()
}

/// Algorithm 1: merges neighbours until `count` are left.
fn merge(skeleton: &[Knot], motion: &Motion, distance_weight: f32, count: usize) -> Vec<Knot> {
    let midrib: Vec<Vec3> = skeleton.iter().map(|knot| knot.position).collect();
    let length = polyline::length(&midrib).max(f32::MIN_POSITIVE);
    let mut knots = skeleton.to_vec();
    let mut tracks: Vec<Vec<Vec3>> =
        (0..knots.len()).map(|vertex| motion.iter().map(|frame| frame[vertex]).collect()).collect();
    let difference = |a: &[Vec3], b: &[Vec3]| movement_difference(a, b, length, distance_weight);
    let mut differences: Vec<f32> = tracks.windows(2).map(|pair| difference(&pair[0], &pair[1])).collect();
    while knots.len() > count {
        let at = differences
            .iter()
            .enumerate()
            .min_by(|a, b| a.1.total_cmp(b.1))
            .map(|(index, _)| index)
            .expect("more than two knots have a difference");
        if at == 0 {
            knots.remove(1);
            tracks.remove(1);
        } else if at + 2 == knots.len() {
            knots.remove(at);
            tracks.remove(at);
        } else {
            knots[at] = merged(&knots[at], &knots[at + 1]);
            let other = tracks.remove(at + 1);
            for (mine, theirs) in tracks[at].iter_mut().zip(other) {
                *mine = mine.midpoint(theirs);
            }
            knots.remove(at + 1);
        }
        differences.remove(at);
        for pair in at.saturating_sub(1)..(at + 1).min(differences.len()) {
            differences[pair] = difference(&tracks[pair], &tracks[pair + 1]);
        }
    }
    knots
}

/// D of Eq. 1 for two vertices' positions over time, as a share of the blade's length.
fn movement_difference(a: &[Vec3], b: &[Vec3], length: f32, distance_weight: f32) -> f32 {
    let n = a.len().max(1) as f32;
    let (mut sum, mut squares) = (0.0, 0.0);
    for (a, b) in a.iter().zip(b) {
        let squared = a.distance_squared(*b);
        sum += squared.sqrt();
        squares += squared;
    }
    let mean = sum / n;
    let spread = (squares / n - mean * mean).max(0.0).sqrt();
    (mean * distance_weight + spread * (1.0 - distance_weight)) / length
}

fn merged(a: &Knot, b: &Knot) -> Knot {
    Knot {
        position: a.position.midpoint(b.position),
        half_width_left: 0.5 * (a.half_width_left + b.half_width_left),
        across: (a.across + b.across).normalize_or(a.across),
        half_width_right: 0.5 * (a.half_width_right + b.half_width_right),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blade::check_knots;
    use crate::strand::motion_in_wind;

    fn skeleton(n: usize) -> Vec<Knot> {
        (0..n)
            .map(|i| {
                let t = i as f32 / (n - 1) as f32;
                let a = 1.4 * t * t;
                Knot {
                    position: Vec3::new(1.0 - a.cos(), t, a.sin() * 0.3) * 0.2,
                    half_width_left: 0.005 * (1.0 - t),
                    across: Vec3::X,
                    half_width_right: 0.006 * (1.0 - t),
                }
            })
            .collect()
    }

    const METHODS: [RefineMethod; 2] = [RefineMethod::Fit, RefineMethod::Merge];

    fn refined(n: usize, knots: usize, distance_weight: f32, method: RefineMethod) -> Refined {
        let skeleton = skeleton(n);
        let midrib: Vec<Vec3> = skeleton.iter().map(|knot| knot.position).collect();
        let motion = motion_in_wind(&midrib, 16);
        refine(&skeleton, &motion, &RefineParams { knots, distance_weight, method })
    }

    #[test]
    fn root_and_tip_stay_and_the_knots_stay_valid() {
        for knots in [64, 32, 16, 8, 2] {
            for (weight, method) in [0.0, 0.5, 1.0].into_iter().flat_map(|w| METHODS.map(|m| (w, m))) {
                let refined = refined(128, knots, weight, method);
                assert_eq!(refined.knots.len(), knots);
                assert_eq!(check_knots(&refined.knots), Ok(()));
                assert_eq!(refined.knots[0], skeleton(128)[0]);
                assert_eq!(refined.knots[knots - 1], skeleton(128)[127]);
            }
        }
    }

    #[test]
    fn fewer_knots_are_farther_from_the_skeleton() {
        for method in METHODS {
            let far = |knots| refined(128, knots, 0.5, method).hausdorff_m;
            assert!(far(64) < far(16) && far(16) < far(4), "{} {} {}", far(64), far(16), far(4));
            assert!(far(16) < 0.002, "{}", far(16));
        }
    }

    #[test]
    fn a_skeleton_that_is_small_enough_is_left_alone() {
        for method in METHODS {
            let refined = refined(16, 16, 0.5, method);
            assert_eq!(refined.knots, skeleton(16));
            assert_eq!(refined.hausdorff_m, 0.0);
        }
    }

    #[test]
    fn the_fit_puts_its_knots_where_the_blade_bends() {
        // Straight, but for a right angle at vertex 20.
        let mut skeleton = skeleton(33);
        for (i, knot) in skeleton.iter_mut().enumerate() {
            let (up, aside) = (i.min(20) as f32, i.saturating_sub(20) as f32);
            knot.position = Vec3::new(aside, up, 0.0) * 0.005;
            (knot.half_width_left, knot.half_width_right) = (0.003, 0.003);
        }
        let motion = vec![skeleton.iter().map(|knot| knot.position).collect::<Vec<Vec3>>()];
        let fitted = refine(
            &skeleton,
            &motion,
            &RefineParams { knots: 3, distance_weight: 0.0, ..Default::default() },
        );
        assert_eq!(fitted.knots[1], skeleton[20]);
        assert!(fitted.hausdorff_m < 1e-6, "{}", fitted.hausdorff_m);
    }

    #[test]
    fn each_level_keeps_some_of_the_knots_of_the_level_before() {
        let skeleton = skeleton(40);
        let midrib: Vec<Vec3> = skeleton.iter().map(|knot| knot.position).collect();
        let levels = levels(&skeleton, &motion_in_wind(&midrib, 8), 0.5, &[64, 16, 8, 4, 2]);
        assert_eq!(levels.iter().map(Vec::len).collect::<Vec<_>>(), [40, 16, 8, 4, 2]);
        for pair in levels.windows(2) {
            assert!(pair[1].iter().all(|index| pair[0].contains(index)), "{pair:?}");
            assert!(pair[1].is_sorted() && pair[1][0] == 0 && pair[1].ends_with(&[39]), "{pair:?}");
        }
    }

    #[test]
    fn merging_keeps_vertices_that_move_apart() {
        let skeleton = skeleton(9);
        let rest: Vec<Vec3> = skeleton.iter().map(|knot| knot.position).collect();
        // The chain is rigid but between vertices 3 and 4, which come and go.
        let motion: Motion = (0..8)
            .map(|frame| {
                let gap = Vec3::Y * 0.05 * (frame % 2) as f32;
                rest.iter().enumerate().map(|(i, p)| if i > 3 { *p + gap } else { *p }).collect()
            })
            .collect();
        let refined = refine(
            &skeleton,
            &motion,
            &RefineParams { knots: 8, distance_weight: 0.0, method: RefineMethod::Merge },
        );
        let kept = |knot: &Knot| refined.knots.contains(knot);
        assert!(kept(&skeleton[3]) && kept(&skeleton[4]), "{refined:?}");
    }
}
