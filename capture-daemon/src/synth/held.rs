//! Blades in a hand, and hands without: what a visitor holds up to the camera.

use std::ops::Range;

use glam::DVec3;

use super::arrange;
use super::blade::SyntheticBlade;
use super::hand::{Border, Hand, Triangle};
use super::motion::{Motion, Pose};
use super::random::Random;
use super::surface::Surface;
use crate::frame::CameraModel;

/// Least length of what is seen of a blade, metres.
const SEEN_M: f64 = 0.11;
/// The camera by which the hand's silhouette is judged.
const JUDGE: CameraModel = CameraModel { fx: 570.0, fy: 570.0, cx: 319.5, cy: 239.5 };
/// Its columns and rows.
const JUDGE_SIZE: (usize, usize) = (640, 480);
/// Half the picture's width and height over the focal length, at most: of 4:3 and of 512×424.
const BORDER: (f64, f64) = (0.57, 0.48);

/// A hand that comes, holds still and leaves.
#[derive(Clone, Debug, PartialEq)]
pub struct Visit {
    /// Its blades among the scene's.
    pub blades: Range<usize>,
    /// The blades with what the hand hides of them, in the pose at the hold's start.
    whole: Vec<SyntheticBlade>,
    /// The hand in that pose.
    hand: Vec<Triangle>,
    pub(super) motion: Motion,
}

impl Visit {
    /// What of it is before the camera in a pose.
    pub(super) fn posed(&self, pose: &Pose) -> (Vec<SyntheticBlade>, Vec<Triangle>) {
        let blades = self.whole.iter().map(|blade| blade.posed(pose)).collect();
        (blades, self.hand.iter().map(|triangle| triangle.map(|point| pose.apply(point))).collect())
    }
}

/// Blades gripped in a hand, after those that a scene has already: the visit, and what is seen of its
/// blades above the hand at the hold's start, from left to right.
pub(super) fn held(
    seed: u64,
    visit: usize,
    before: usize,
    random: &mut Random,
) -> (Visit, Vec<SyntheticBlade>) {
    let count = random.integer(1, 5);
    loop {
        let hand = Hand::random(random);
        let whole = arrange::handful(count, random);
        let middle = DVec3::new(random.range(-0.04, 0.04), 0.0, random.range(0.53, 0.62));
        let whole: Vec<SyntheticBlade> =
            whole.into_iter().map(|blade| blade.moved(middle + hand.grip())).collect();
        // The highest tip some way below the picture's upper border.
        let top = arrange::bounds_of_all(&whole).0.y;
        let down = DVec3::Y * (-random.range(0.21, 0.28) * middle.z - top);
        let whole: Vec<SyntheticBlade> = whole.into_iter().map(|blade| blade.moved(down)).collect();
        let surface = hand.surface(middle + down);
        let Some(seen) = above(&surface, &whole) else { continue };
        if !arrange::in_view(&seen) || !arrange::is_clear(&seen, &surface) {
            continue;
        }
        let motion = Motion {
            seed,
            visit: visit as u64,
            pivot: middle + down,
            away: away(&hand, &surface, &whole, random),
        };
        return (Visit { blades: before..before + count, whole, hand: surface, motion }, seen);
    }
}

/// A hand that holds nothing.
pub(super) fn empty_hand(seed: u64, random: &mut Random) -> Visit {
    let hand = Hand::random(random);
    let middle = DVec3::new(random.range(-0.06, 0.06), random.range(-0.06, 0.04), random.range(0.52, 0.62));
    let surface = hand.surface(middle);
    let motion = Motion { seed, visit: 0, pivot: middle, away: away(&hand, &surface, &[], random) };
    Visit { blades: 0..0, whole: Vec::new(), hand: surface, motion }
}

/// The translation that takes all of it out of the picture, across the border that the forearm crosses.
fn away(hand: &Hand, surface: &[Triangle], blades: &[SyntheticBlade], random: &mut Random) -> DVec3 {
    let points = surface.iter().flatten().copied();
    let edges = blades.iter().flat_map(|blade| &blade.sections).map(|section| section.center);
    let aside = random.range(-0.05, 0.05);
    // Reaches of all points into the picture from the border, with a centimetre of air.
    let farthest = |reach: &dyn Fn(DVec3) -> f64| {
        points.clone().chain(edges.clone()).map(reach).fold(0.0, f64::max) + 0.01
    };
    match hand.border {
        Border::Bottom => DVec3::new(aside, farthest(&|p| BORDER.1 * p.z - p.y), 0.0),
        Border::Left => DVec3::new(-farthest(&|p| BORDER.0 * p.z + p.x), aside, 0.0),
        Border::Right => DVec3::new(farthest(&|p| BORDER.0 * p.z - p.x), aside, 0.0),
    }
}

/// What is seen of blades whose lower ends a hand holds: each from where its midrib leaves the hand's
/// silhouette. None if one is too short, or comes back before the hand or behind it.
fn above(hand: &[Triangle], blades: &[SyntheticBlade]) -> Option<Vec<SyntheticBlade>> {
    let surface = Surface::draw(&[], hand, &JUDGE, JUDGE_SIZE);
    let outside = |point: DVec3| {
        let (u, v) = (JUDGE.fx * point.x / point.z + JUDGE.cx, JUDGE.fy * point.y / point.z + JUDGE.cy);
        surface.depth_at(u, v).is_infinite()
    };
    let cut = |blade: &SyntheticBlade| {
        let first = blade.sections.iter().position(|section| outside(section.center))?;
        if first == 0 || !blade.sections[first..].iter().all(|section| outside(section.center)) {
            return None;
        }
        let (mut inner, mut outer) = (first as f64 - 1.0, first as f64);
        for _ in 0..6 {
            let between = 0.5 * (inner + outer);
            let at = blade.section_at(between).center;
            if outside(at) { outer = between } else { inner = between }
        }
        Some(blade.cut_from(outer)).filter(|seen| seen.length_m >= SEEN_M)
    };
    blades.iter().map(cut).collect()
}

#[cfg(test)]
mod tests {
    use super::super::scene::{Family, Scene};
    use super::*;

    #[test]
    fn blades_leave_the_hand_on_top() {
        for seed in 0..12 {
            let scene = Scene::new(Family::Held, seed);
            assert_eq!(scene.visits.len(), 1);
            let visit = &scene.visits[0];
            assert_eq!(visit.blades, 0..scene.blades.len());
            assert!((1..=5).contains(&scene.blades.len()));
            for (seen, whole) in scene.blades.iter().zip(&visit.whole) {
                assert!(seen.length_m >= SEEN_M && seen.length_m < whole.length_m - 0.015);
                assert!(seen.sections[0].center.y < visit.motion.pivot.y);
                let tips = [seen, whole].map(|blade| blade.sections[blade.sections.len() - 1].center);
                assert!(tips[0].distance(tips[1]) < 1e-9);
                let length: f64 =
                    seen.sections.windows(2).map(|pair| pair[0].center.distance(pair[1].center)).sum();
                assert!((length - seen.length_m).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn nothing_of_a_visit_is_in_the_picture_when_it_is_away() {
        for seed in 0..12 {
            for family in [Family::Held, Family::Hand] {
                let visit = &Scene::new(family, seed).visits[0];
                let away = Pose { translation: visit.motion.away, ..Pose::START };
                let (blades, hand) = visit.posed(&away);
                let ribs = blades.iter().flat_map(|blade| &blade.sections).map(|section| section.center);
                for point in hand.into_iter().flatten().chain(ribs) {
                    let (x, y) = ((point.x / point.z).abs(), point.y / point.z);
                    assert!(x > 0.56 || y > 0.47, "{family:?} {seed}: {point}");
                }
            }
        }
    }
}
