//! How what a hand holds moves: it comes in from the picture's border, is held with a tremor, leaves.

use std::ops::Range;

use glam::{DQuat, DVec3};

use super::random::Random;

/// Frames of a visit before anything is seen, at most.
const LEAD: usize = 15;
/// Frames of a visit after all has left, at most.
const TAIL: usize = 5;
/// Frames that coming in takes, and leaving, at most.
const TRAVEL: usize = 10;
/// The farthest that a tremor carries the hand, metres.
pub(super) const TREMOR_M: f64 = 0.003;
/// The farthest that a tremor turns the hand, radians: 0.5°.
pub(super) const TREMOR_RAD: f64 = 0.008_726_646;
/// Frames between two random places of a tremor.
const TREMOR_STEP: usize = 5;
/// Streams of random numbers for tremors: above those of the sensor's frames.
const TREMOR_STREAM: u64 = 1 << 40;

/// A rigid motion: a point goes to `rotation * point + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// A unit quaternion.
    pub rotation: DQuat,
    /// Metres.
    pub translation: DVec3,
}

impl Pose {
    /// Where everything is when the hold starts.
    pub(super) const START: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// A point moved with it.
    pub fn apply(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// A turn by a small vector (its length: radians) about `pivot`, then a translation, metres.
    fn about(pivot: DVec3, turn: DVec3, by: DVec3) -> Self {
        // Right to the second order; no sine or cosine, whose last bits differ between machines.
        let half = 0.5 * turn;
        let rotation = DQuat::from_xyzw(half.x, half.y, half.z, 1.0).normalize();
        Self { rotation, translation: pivot + by - rotation * pivot }
    }
}

/// The frames of one visit, counted from the clip's first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VisitFrames {
    /// Those that show something of it.
    pub visible: Range<usize>,
    /// Those in which it is held: without its coming and leaving.
    pub held: Range<usize>,
}

impl VisitFrames {
    /// Of visit `index` of `count`, which share a clip of `frames` evenly.
    pub(super) fn new(index: usize, count: usize, frames: usize) -> Self {
        let (start, end) = (frames * index / count, frames * (index + 1) / count);
        let (lead, tail) = (((end - start) / 6).min(LEAD), ((end - start) / 12).min(TAIL));
        let visible = start + lead..end - tail;
        let travel = (visible.len() / 4).min(TRAVEL);
        Self { held: visible.start + travel..visible.end - travel, visible }
    }
}

/// What moves a visit.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Motion {
    /// Seed and stream of the tremor.
    pub(super) seed: u64,
    /// Which visit of its scene.
    pub(super) visit: u64,
    /// The tremor turns about this: the fist's middle, camera frame.
    pub(super) pivot: DVec3,
    /// Translation to where nothing of it is in the picture, metres.
    pub(super) away: DVec3,
}

impl Motion {
    /// The pose in a frame; none where nothing is seen.
    pub(super) fn pose(&self, frames: &VisitFrames, index: usize) -> Option<Pose> {
        if !frames.visible.contains(&index) {
            return None;
        }
        // 0 in the picture, 1 out of it.
        let out = |step: usize, steps: usize| smooth(step as f64 / steps as f64);
        let (coming, leaving) =
            (frames.held.start - frames.visible.start + 1, frames.visible.end - frames.held.end + 1);
        let outside = if index < frames.held.start {
            out(frames.held.start - index, coming)
        } else if index >= frames.held.end {
            out(index + 1 - frames.held.end, leaving)
        } else {
            0.0
        };
        if index <= frames.held.start {
            return Some(Pose { translation: self.away * outside, ..Pose::START });
        }
        let (turn, by) = self.tremor(index - frames.held.start);
        Some(Pose::about(self.pivot, turn, by + self.away * outside))
    }

    /// The tremor `since` frames after the hold started, where it is zero: a turn vector of at most
    /// [`TREMOR_RAD`] and a translation of at most [`TREMOR_M`].
    fn tremor(&self, since: usize) -> (DVec3, DVec3) {
        let node = since / TREMOR_STEP;
        let (from, to) = (self.tremor_node(node), self.tremor_node(node + 1));
        let part = smooth((since % TREMOR_STEP) as f64 / TREMOR_STEP as f64);
        // Between two points of a ball lies the ball.
        (TREMOR_RAD * from.0.lerp(to.0, part), TREMOR_M * from.1.lerp(to.1, part))
    }

    /// Two points of the unit ball.
    fn tremor_node(&self, node: usize) -> (DVec3, DVec3) {
        if node == 0 {
            return (DVec3::ZERO, DVec3::ZERO);
        }
        let mut random = Random::new(self.seed, TREMOR_STREAM + (self.visit << 32) + node as u64);
        let mut point = || {
            let point = DVec3::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0));
            point / point.length().max(1.0)
        };
        (point(), point())
    }
}

/// From 0 to 1 for `t` from 0 to 1, level at both ends.
fn smooth(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_visit_of_60_frames_comes_holds_for_24_or_more_and_leaves() {
        for (count, frames) in [(1, 60), (5, 400), (3, 240)] {
            for index in 0..count {
                let visit = VisitFrames::new(index, count, frames);
                assert!(visit.held.len() >= 24, "{visit:?}");
                assert_eq!(visit.held.start - visit.visible.start, 10);
                assert_eq!(visit.visible.end - visit.held.end, 10);
            }
        }
        for frames in 1..60 {
            let visit = VisitFrames::new(0, 1, frames);
            assert!(visit.visible.end <= frames && !visit.held.is_empty(), "{visit:?}");
        }
    }

    #[test]
    fn a_tremor_stays_within_its_bounds_and_moves() {
        let pivot = DVec3::new(0.0, 0.05, 0.55);
        let motion = Motion { seed: 3, visit: 1, pivot, away: DVec3::Y };
        let frames = VisitFrames { visible: 0..400, held: 10..390 };
        let mut farthest = 0.0_f64;
        for index in frames.held.clone() {
            let pose = motion.pose(&frames, index).expect("held");
            let by = pose.apply(pivot).distance(pivot);
            assert!(by <= TREMOR_M + 1e-12, "{by} m");
            assert!(pose.rotation.to_axis_angle().1 <= TREMOR_RAD + 1e-9);
            let next = motion.pose(&frames, index + 1).expect("visible");
            if index + 1 < frames.held.end {
                assert!(next.apply(pivot).distance(pose.apply(pivot)) < 0.0025);
            }
            farthest = farthest.max(by);
        }
        assert!(farthest > 0.7 * TREMOR_M);
        assert_eq!(motion.pose(&frames, 10), Some(Pose::START));
    }
}
