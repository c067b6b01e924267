//! Small rigid motions, and finding one by least squares.

use glam::{Quat, Vec3};

/// How far a hand that holds still strays: one standard deviation, metres and radians.
const STRAY_M: f32 = 0.004;
const STRAY_RAD: f32 = 0.012;

/// A rigid motion about a pivot: a point goes to `rotation · (point − pivot) + pivot + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motion {
    rotation: Quat,
    pub(super) translation: Vec3,
    pivot: Vec3,
}

impl Motion {
    pub(super) fn none(pivot: Vec3) -> Self {
        Self { rotation: Quat::IDENTITY, translation: Vec3::ZERO, pivot }
    }

    pub(super) fn apply(&self, point: Vec3) -> Vec3 {
        self.rotation * (point - self.pivot) + self.pivot + self.translation
    }

    /// Turned by a small vector (its length: radians), then moved, metres.
    pub(super) fn then(&self, turn: Vec3, by: Vec3) -> Self {
        // Right to the second order, and without a sine, whose last bits differ between machines.
        let half = 0.5 * turn;
        let small = Quat::from_xyzw(half.x, half.y, half.z, 1.0).normalize();
        Self {
            rotation: (small * self.rotation).normalize(),
            translation: small * self.translation + by,
            pivot: self.pivot,
        }
    }

    /// Its turn as a vector, radians, for small ones.
    pub(super) fn turn(&self) -> Vec3 {
        2.0 * Vec3::new(self.rotation.x, self.rotation.y, self.rotation.z)
    }
}

/// Normal equations of a small turn and translation.
#[derive(Default)]
pub(super) struct Fit {
    matrix: [[f64; 6]; 6],
    right: [f64; 6],
    /// Weight of the edges that were found again.
    pub(super) matched: f32,
}

impl Fit {
    /// Adds a residual that changes by `change` as the point, `arm` from the pivot, moves.
    pub(super) fn add(&mut self, change: Vec3, arm: Vec3, residual: f32, weight: f32) {
        let turned = arm.cross(change);
        let row = [turned.x, turned.y, turned.z, change.x, change.y, change.z].map(f64::from);
        let (weight, residual) = (f64::from(weight), f64::from(residual));
        for (i, value) in row.iter().enumerate() {
            for (j, other) in row.iter().enumerate() {
                self.matrix[i][j] += weight * value * other;
            }
            self.right[i] += weight * value * residual;
        }
    }

    /// The turn and translation that are left to be done after `motion`.
    pub(super) fn solve(&self, motion: &Motion) -> Option<[Vec3; 2]> {
        let done = [motion.turn(), motion.translation];
        let mut rows = [[0.0; 7]; 6];
        for (i, row) in rows.iter_mut().enumerate() {
            row[..6].copy_from_slice(&self.matrix[i]);
            let stray = f64::from(if i < 3 { STRAY_RAD } else { STRAY_M });
            row[i] += 1.0 / (stray * stray);
            row[6] = self.right[i] - f64::from(done[i / 3][i % 3]) / (stray * stray);
        }
        // Positive definite by what was added to its diagonal: no pivoting.
        for pivot in 0..6 {
            let above = rows[pivot];
            for row in &mut rows[pivot + 1..] {
                let factor = row[pivot] / above[pivot];
                row.iter_mut().zip(above).for_each(|(value, above)| *value -= factor * above);
            }
        }
        let mut solution = [0.0; 6];
        for i in (0..6).rev() {
            let known: f64 = (i + 1..6).map(|j| rows[i][j] * solution[j]).sum();
            solution[i] = (rows[i][6] - known) / rows[i][i];
        }
        let [a, b, c, x, y, z] = solution.map(|value| value as f32);
        solution.iter().all(|value| value.is_finite()).then(|| [Vec3::new(a, b, c), Vec3::new(x, y, z)])
    }
}
