//! A hand that makes a fist, with its forearm, built of round lumps: what it holds comes out on top.

use glam::{DMat3, DVec3};

use super::blade::turn;
use super::random::Random;

/// A triangle of a closed body, camera frame, metres: its corners run clockwise as seen from
/// outside.
pub(super) type Triangle = [DVec3; 3];

/// Steps of a lump's surface from pole to pole, and half of those around it.
const STEPS: usize = 24;
/// Length of the forearm, metres: it reaches beyond the picture's border.
const FOREARM_M: f64 = 0.45;

/// Where the forearm leaves the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Border {
    Bottom,
    Left,
    Right,
}

/// The measures of a hand. Its own frame: origin in the middle of the fist, the camera's axes.
pub(super) struct Hand {
    /// Width, height and depth of the fist without the fingers' bulge: 70–90, 65–85, 40–50 mm.
    fist: DVec3,
    /// Radius of a finger, 9–11 mm.
    finger: f64,
    /// 1 if the thumb is at the right in the picture, −1 if at the left.
    side: f64,
    /// From the fist to the elbow, a unit vector.
    arm: DVec3,
    /// Radii of the wrist, 25–30 mm, and of the forearm's other end, 33–40 mm.
    arm_radii: (f64, f64),
    /// Where the forearm leaves the picture.
    pub(super) border: Border,
}

impl Hand {
    /// A random hand: its forearm leaves at the bottom mostly, else to the left or right.
    pub(super) fn random(random: &mut Random) -> Self {
        let fist =
            DVec3::new(random.range(0.070, 0.090), random.range(0.065, 0.085), random.range(0.040, 0.050));
        let (border, arm) = match random.unit() {
            lot if lot < 0.64 => (Border::Bottom, DVec3::new(random.range(-0.45, 0.45), 1.0, 0.0)),
            lot if lot < 0.82 => (Border::Left, DVec3::new(-1.0, random.range(0.1, 0.6), 0.0)),
            _ => (Border::Right, DVec3::new(1.0, random.range(0.1, 0.6), 0.0)),
        };
        Self {
            fist,
            finger: random.range(0.009, 0.011),
            side: if random.unit() < 0.5 { -1.0 } else { 1.0 },
            arm: (arm + DVec3::Z * random.range(-0.2, 0.2)).normalize(),
            arm_radii: (random.range(0.025, 0.030), random.range(0.033, 0.040)),
            border,
        }
    }

    /// The lower ends of what it holds are around here: 35 mm below its top.
    pub(super) fn grip(&self) -> DVec3 {
        DVec3::new(0.0, -0.5 * self.fist.y + 0.035, 0.0)
    }

    /// Its surface, moved by `at`.
    pub(super) fn surface(&self, at: DVec3) -> Vec<Triangle> {
        let (fist, finger) = (self.fist, self.finger);
        let point = |x: f64, y: f64, z: f64| at + DVec3::new(self.side * x * fist.x, y * fist.y, z);
        let mut triangles = Vec::new();
        // The palm, and the ball of the thumb.
        ellipsoid(&mut triangles, point(0.0, 0.0, 0.006), 0.5 * fist);
        ellipsoid(&mut triangles, point(0.22, 0.05, -0.004), DVec3::new(0.024, 0.034, 0.020));
        // Four fingers one below the other, bent at a knuckle, the lowest shortest.
        for (i, y) in [-0.35, -0.12, 0.11, 0.33].into_iter().enumerate() {
            let (thick, far) = (finger * [1.0, 1.05, 1.0, 0.88][i], 0.30 - 0.03 * i as f64);
            let [root, knuckle, tip] =
                [point(-0.40, y, 0.004), point(-0.20, y + 0.01, -0.022), point(far, y + 0.03, -0.020)];
            capsule(&mut triangles, (root, thick * 1.1), (knuckle, thick));
            capsule(&mut triangles, (knuckle, thick), (tip, thick * 0.85));
        }
        // The thumb, across the first finger.
        let [root, knuckle, tip] =
            [point(0.38, 0.10, -0.004), point(0.30, -0.28, -0.020), point(-0.02, -0.42, -0.032)];
        capsule(&mut triangles, (root, finger * 1.3), (knuckle, finger * 1.15));
        capsule(&mut triangles, (knuckle, finger * 1.15), (tip, finger * 0.9));
        // The forearm.
        let wrist = at + self.arm * 0.25 * fist.y + DVec3::Z * 0.006;
        let elbow = wrist + self.arm * FOREARM_M;
        capsule(&mut triangles, (wrist, self.arm_radii.0), (elbow, self.arm_radii.1));
        triangles
    }
}

fn ellipsoid(triangles: &mut Vec<Triangle>, center: DVec3, half_axes: DVec3) {
    mesh(triangles, DVec3::Y, |direction| center + half_axes * direction);
}

/// The hull of two balls, each a middle and a radius.
fn capsule(triangles: &mut Vec<Triangle>, a: (DVec3, f64), b: (DVec3, f64)) {
    let support = |ball: (DVec3, f64), direction: DVec3| ball.0 + ball.1 * direction;
    mesh(triangles, (b.0 - a.0).normalize(), |direction| {
        let (of_a, of_b) = (support(a, direction), support(b, direction));
        if of_a.dot(direction) > of_b.dot(direction) { of_a } else { of_b }
    });
}

/// A closed surface: a point for every direction, poles along `axis` (unit).
fn mesh(triangles: &mut Vec<Triangle>, axis: DVec3, point: impl Fn(DVec3) -> DVec3) {
    let side = axis.any_orthonormal_vector();
    let frame = DMat3::from_cols(side, axis.cross(side), axis);
    let step = std::f64::consts::PI / STEPS as f64;
    let circle = |count: usize| {
        let (mut x, mut y) = (DVec3::X, DVec3::Y);
        let points = (0..count).map(move |_| {
            let point = x;
            turn(&mut x, &mut y, step);
            point
        });
        points.collect::<Vec<DVec3>>()
    };
    let (meridian, parallel) = (circle(STEPS + 1), circle(2 * STEPS));
    let grid: Vec<Vec<DVec3>> = meridian
        .iter()
        .map(|m| {
            let direction = |p: &DVec3| frame * DVec3::new(m.y * p.x, m.y * p.y, m.x);
            parallel.iter().map(|p| point(direction(p))).collect()
        })
        .collect();
    for rows in grid.windows(2) {
        for i in 0..parallel.len() {
            let j = (i + 1) % parallel.len();
            triangles.push([rows[0][i], rows[0][j], rows[1][i]]);
            triangles.push([rows[0][j], rows[1][j], rows[1][i]]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_capsule_is_the_hull_of_its_balls() {
        let (a, b) = ((DVec3::ZERO, 0.02), (DVec3::new(0.1, 0.05, 0.0), 0.03));
        let mut triangles = Vec::new();
        capsule(&mut triangles, a, b);
        for point in triangles.iter().flatten() {
            let out = |ball: (DVec3, f64)| point.distance(ball.0) - ball.1;
            assert!(out(a) > -1e-6 && out(b) > -1e-6 && out(a).min(out(b)) < 1e-6);
        }
    }

    #[test]
    fn a_fist_has_the_size_of_one() {
        for seed in 0..50 {
            let hand = Hand::random(&mut Random::new(seed, 0));
            let points = hand.surface(DVec3::ZERO);
            // Without the forearm, the last lump.
            let points = points[..points.len() - 4 * STEPS * STEPS].iter().flatten();
            let (low, high) = points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), point| {
                (low.min(*point), high.max(*point))
            });
            let size = (high - low) * 1000.0;
            assert!((70.0..100.0).contains(&size.x), "{size} mm");
            assert!((60.0..90.0).contains(&size.y), "{size} mm");
            assert!((40.0..80.0).contains(&size.z), "{size} mm");
        }
    }
}
