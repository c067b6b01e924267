//! A blade pressed flat, as in a herbarium: bent straight out of its surface, but not within it.

use common::blade::Blade;
use glam::Vec2;

/// One cross-section of a pressed blade, metres, +y towards the tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pressed {
    /// On the midrib.
    pub(super) mid: Vec2,
    /// The left edge.
    pub(super) left: Vec2,
    /// The right edge.
    pub(super) right: Vec2,
}

/// Presses a blade: each stretch between two knots keeps its length, and its angles with the directions across at
/// both of them. The root comes to lie at the origin, the tip above it. O(knots).
pub(super) fn press(blade: &Blade) -> Vec<Pressed> {
    let knots = blade.knots();
    let mut across = Vec2::X;
    let mut mid = Vec2::ZERO;
    let mut flat = Vec::with_capacity(knots.len());
    for (k, knot) in knots.iter().enumerate() {
        flat.push((mid, across, knot));
        let Some(next) = knots.get(k + 1) else { break };
        let along = (next.position - knot.position).normalize_or_zero();
        let angle_at = |unit: glam::Vec3| unit.dot(along).clamp(-1.0, 1.0).acos();
        let ahead = Vec2::from_angle(angle_at(knot.across)).rotate(across);
        mid += ahead * next.position.distance(knot.position);
        across = Vec2::from_angle(-angle_at(next.across)).rotate(ahead);
    }
    // What turns the tip to lie above the root.
    let chord = mid.normalize_or(Vec2::Y);
    let upright = Vec2::new(chord.y, chord.x);
    flat.into_iter()
        .map(|(mid, across, knot)| Pressed {
            mid: upright.rotate(mid),
            left: upright.rotate(mid - across * knot.half_width_left),
            right: upright.rotate(mid + across * knot.half_width_right),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use common::blade::{BladeId, Knot};
    use glam::{Quat, Vec3};

    use super::*;

    fn blade(knots: Vec<Knot>) -> Blade {
        Blade::new(BladeId([1; 16]), "a", knots, [0.1, 0.01], 0, 1.0).expect("a blade")
    }

    #[test]
    fn what_bends_towards_the_camera_becomes_straight_and_keeps_its_length() {
        let knot = |k: usize| {
            let angle = k as f32 * 0.15;
            Knot {
                position: Vec3::new(0.0, angle.sin(), 1.0 - angle.cos()) * 0.1,
                half_width_left: 0.004,
                across: Vec3::X,
                half_width_right: 0.002,
            }
        };
        let flat = press(&blade((0..12).map(knot).collect()));
        assert!(flat.iter().all(|at| at.mid.x.abs() < 1e-6), "{flat:?}");
        let step = 2.0 * 0.1 * (0.075_f32).sin();
        assert!(flat.windows(2).all(|pair| (pair[1].mid.y - pair[0].mid.y - step).abs() < 1e-6));
        assert!(flat.iter().all(|at| (at.left.x + 0.004).abs() < 1e-6 && (at.right.x - 0.002).abs() < 1e-6));
    }

    #[test]
    fn what_bends_within_its_surface_stays_bent_however_it_hangs() {
        let hang = Quat::from_euler(glam::EulerRot::XYZ, 0.7, -1.1, 0.4);
        let knot = |k: usize| {
            let angle = k as f32 * 0.1;
            Knot {
                position: hang * Vec3::new(1.0 - angle.cos(), angle.sin(), 0.0) * 0.2,
                half_width_left: 0.003,
                across: hang * Vec3::new(angle.cos(), -angle.sin(), 0.0),
                half_width_right: 0.003,
            }
        };
        let knots: Vec<Knot> = (0..10).map(knot).collect();
        let flat = press(&blade(knots.clone()));
        for (a, b) in [(0, 9), (0, 5), (3, 9)] {
            let true_m = knots[a].position.distance(knots[b].position);
            assert!((flat[a].mid.distance(flat[b].mid) - true_m).abs() < 1e-5);
        }
        assert!(flat[9].mid.x.abs() < 1e-6 && flat[9].mid.y > 0.1, "{:?}", flat[9]);
        // It bends to the right, so its middle lies to the left of the line from root to tip.
        assert!(flat[5].mid.x < -0.01, "{:?}", flat[5]);
    }
}
