//! How true refined blades are, at rest and in motion, beside other ways to choose as few knots.
//!
//! The honest question is what a viewer sees of the few knots: where is each point of the moving blade,
//! and where does the ribbon through the few knots put it? So every blade is simulated with all its
//! vertices in a gust that refinement has not seen, the knots are carried along by it, and points
//! at equal shares of the arc length are compared. Simulating the few knots by themselves
//! mixes in how well a chain of few links imitates the stiffness of one of many, which is the
//! simulation's affair; with the links evened out, as [`motions_under`] does, it is measured too.

use common::blade::Knot;
use common::geometry::{distance, polyline};
use common::refine::{RefineMethod, RefineParams, refine};
use common::strand::{Motion, motion_in_wind, motions_under};
use glam::{DVec3, Vec3};

use super::blade::{Section, Shape, SyntheticBlade};
use super::scene::{Family, Scene};
use crate::stages::blade::MOTION_FRAMES;
use crate::stages::skeleton::STATIONS;

/// Frames of the motion that are compared.
const FRAMES: usize = 60;

/// A way to come from many knots to few.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// [`RefineMethod::Fit`].
    Fit,
    /// [`RefineMethod::Merge`].
    Merge,
    /// Douglas & Peucker 1973, splitting the worst stretch until the count is met.
    DouglasPeucker,
    /// Equal arc length between knots.
    Uniform,
}

/// All ways.
pub const WAYS: [Way; 4] = [Way::Fit, Way::Merge, Way::DouglasPeucker, Way::Uniform];

impl Way {
    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fit => "fit (default)",
            Self::Merge => "merge (Fan & Sheng)",
            Self::DouglasPeucker => "Douglas–Peucker",
            Self::Uniform => "uniform",
        }
    }

    /// `count` knots (≥ 2) of a skeleton of more.
    pub fn refine(self, skeleton: &[Knot], count: usize) -> Vec<Knot> {
        let fitted = |method| {
            let motion = motion_in_wind(&midrib(skeleton), MOTION_FRAMES);
            refine(skeleton, &motion, &RefineParams { knots: count, method, ..RefineParams::default() }).knots
        };
        match self {
            Self::Fit => fitted(RefineMethod::Fit),
            Self::Merge => fitted(RefineMethod::Merge),
            Self::DouglasPeucker => douglas_peucker(skeleton, count),
            Self::Uniform => resampled(skeleton, count),
        }
    }
}

/// How far a refined blade is from the one with all its knots, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fidelity {
    /// Hausdorff distance of the midribs at rest (Fan & Sheng, Eq. 4).
    pub hausdorff_m: f32,
    /// Farthest that a point ever is from its place, the knots carried along by the full motion.
    pub carried_m: f32,
    /// The same, the knots simulated by themselves in the same wind.
    pub simulated_m: f32,
}

/// Compares `few` knots with the skeleton that they were made from.
pub fn fidelity(skeleton: &[Knot], few: &[Knot]) -> Fidelity {
    let (full, few) = (midrib(skeleton), midrib(few));
    let motions = motions_under(&[&full, &few], FRAMES, gust);
    let (motion, of_few) = (&motions[0], &motions[1]);
    Fidelity {
        hausdorff_m: distance::hausdorff(&full, &few),
        carried_m: farthest_apart(&full, motion, &few, &carried(&full, motion, &few)),
        simulated_m: farthest_apart(&full, motion, &few, of_few),
    }
}

/// A wind with other rhythms and directions than that of [`motion_in_wind`], m/s² at a time in seconds.
fn gust(t: f32) -> Vec3 {
    Vec3::new(0.9 * (2.1 * t + 0.7).sin(), 0.0, (4.3 * t).sin() + 0.4 * (9.1 * t + 0.3).cos()) * 1.6
}

/// The few vertices at every moment: each moves with the nearest point of the full midrib.
fn carried(full: &[Vec3], motion: &Motion, few: &[Vec3]) -> Motion {
    let nearest = |point: &Vec3| {
        let on = |i: usize| {
            let edge = full[i + 1] - full[i];
            let t = ((*point - full[i]).dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
            (i, t, *point - full[i].lerp(full[i + 1], t))
        };
        (0..full.len() - 1)
            .map(on)
            .min_by(|a, b| a.2.length_squared().total_cmp(&b.2.length_squared()))
            .expect("a midrib has two points")
    };
    let places: Vec<(usize, f32, Vec3)> = few.iter().map(nearest).collect();
    let at = |frame: &Vec<Vec3>| {
        places.iter().map(|(i, t, offset)| frame[*i].lerp(frame[i + 1], *t) + *offset).collect()
    };
    motion.iter().map(at).collect()
}

/// The largest distance, over all moments, between points at equal shares of the arc length at rest.
fn farthest_apart(full: &[Vec3], motion: &Motion, few: &[Vec3], of_few: &Motion) -> f32 {
    let [of_full, along] = [full, few].map(polyline::cumulative_length);
    let scale = along[along.len() - 1] / of_full[of_full.len() - 1];
    let places: Vec<(usize, f32)> = of_full.iter().map(|s| polyline::locate(&along, s * scale)).collect();
    let apart = |(all, few): (&Vec<Vec3>, &Vec<Vec3>)| {
        let pairs = all.iter().zip(&places);
        pairs.map(|(point, (i, t))| point.distance(few[*i].lerp(few[i + 1], *t))).fold(0.0, f32::max)
    };
    motion.iter().zip(of_few).map(apart).fold(0.0, f32::max)
}

fn douglas_peucker(skeleton: &[Knot], count: usize) -> Vec<Knot> {
    let points = midrib(skeleton);
    let mut kept = vec![0, points.len() - 1];
    while kept.len() < count.min(points.len()) {
        let off =
            |i: usize, pair: &[usize]| distance::point_segment(points[i], points[pair[0]], points[pair[1]]);
        let farthest = kept
            .windows(2)
            .flat_map(|pair| (pair[0] + 1..pair[1]).map(move |i| (i, off(i, pair))))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .expect("there are more vertices than are kept");
        kept.insert(kept.partition_point(|i| *i < farthest.0), farthest.0);
    }
    kept.into_iter().map(|i| skeleton[i]).collect()
}

/// `count` knots at equal arc length.
fn resampled(knots: &[Knot], count: usize) -> Vec<Knot> {
    let along = polyline::cumulative_length(&midrib(knots));
    let total = along[along.len() - 1];
    let knot = |k: usize| {
        let (i, t) = polyline::locate(&along, total * k as f32 / (count - 1) as f32);
        let (a, b) = (&knots[i], &knots[i + 1]);
        Knot {
            position: a.position.lerp(b.position, t),
            half_width_left: a.half_width_left + (b.half_width_left - a.half_width_left) * t,
            across: a.across.lerp(b.across, t).normalize_or(a.across),
            half_width_right: a.half_width_right + (b.half_width_right - a.half_width_right) * t,
        }
    };
    (0..count).map(knot).collect()
}

fn midrib(knots: &[Knot]) -> Vec<Vec3> {
    knots.iter().map(|knot| knot.position).collect()
}

/// Raw skeletons (128 knots, blade frame) of true blades of one shape, `count` of them: as they stand by
/// themselves and as they bend strongly towards the camera, in turn.
pub fn skeletons(shape: Shape, count: usize) -> Vec<Vec<Knot>> {
    let scenes =
        (0..).flat_map(|seed| [Family::Single, Family::Toward].map(|family| Scene::new(family, seed)));
    let blades = scenes.map(|scene| scene.blades[0].clone()).filter(|blade| blade.shape == shape);
    blades.take(count).map(|blade| skeleton(&blade)).collect()
}

fn skeleton(blade: &SyntheticBlade) -> Vec<Knot> {
    let root = blade.sections[0].center;
    // Camera frame to blade frame of a level camera.
    let turned = |v: DVec3| DVec3::new(v.x, -v.y, -v.z).as_vec3();
    let knot = |section: &Section| Knot {
        position: turned(section.center - root),
        half_width_left: section.half_width_left as f32,
        across: turned(section.across),
        half_width_right: section.half_width_right as f32,
    };
    resampled(&blade.sections.iter().map(knot).collect::<Vec<Knot>>(), STATIONS)
}
