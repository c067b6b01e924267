//! How a blade goes on from its lowest section that is seen down to its root.

use glam::{DMat3, DVec3, Vec2};

use super::ribbon::Section;

/// A blade's way to its root, fitted to what is seen above.
///
/// A blade of grass is stiffest at its base: its curvature grows from nothing at the root about evenly
/// towards the tip. Then each coordinate is a + b·s + c·s³ of the distance s from the root.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rootward {
    /// Coefficients of 1, s and s³ for x and y, in pixels, and the depth, in metres.
    x: DVec3,
    y: DVec3,
    depth: DVec3,
    /// How far off to the side and in depth it may be at the root, one standard deviation, pixels and
    /// metres.
    pub(super) sigma_px: f32,
    pub(super) sigma_m: f32,
}

/// s is counted in these, pixels, which keeps the equations well conditioned.
const UNIT_PX: f64 = 100.0;
/// What is nearer to the root says more about it: how far that reaches, pixels.
const MEMORY_PX: f64 = 60.0;
/// Noise of a single section.
const NOISE_PX: f64 = 0.4;
const NOISE_M: f64 = 4.0e-4;
/// How large c may be, pixels and metres over [`UNIT_PX`] cubed: it bends by half a radian in 200 pixels.
const BEND_PX: f64 = 4.0;
const BEND_M: f64 = 4.0e-3;
/// What growth departs from the model: over [`UNIT_PX`] squared, pixels and metres.
const ASTRAY_PX: f64 = 1.3;
const ASTRAY_M: f64 = 2.7e-3;

/// The sections of a blade from the lowest one that is seen towards the tip, as far as its way to the root is
/// told from them: the same whatever its length.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Course {
    places: Powers<2>,
    depths: Powers<1>,
}

impl Course {
    pub(super) fn of(sections: &[Section]) -> Self {
        let mut course = Self::default();
        let mut away = 0.0;
        let mut before: Option<Vec2> = None;
        for section in sections {
            let mid = section.middle();
            away += before.map_or(0.0, |before| f64::from(mid.distance(before)));
            before = Some(mid);
            let memory = (-away / MEMORY_PX).exp();
            let u = away / UNIT_PX;
            course.places.add(u, [mid.x.into(), mid.y.into()], memory * f64::from(section.weight()));
            if let Some(depth) = section.measured.depth_m {
                course.depths.add(u, [depth.into()], memory * f64::from(section.measured.readings.min(20)));
            }
        }
        course
    }
}

impl Rootward {
    /// Of the course that is seen, whose lowest section is `length_px` from the root; `None` where there are too
    /// few sections. O(1).
    pub(super) fn of(course: &Course, length_px: f32) -> Option<Self> {
        let from_root = f64::from(length_px) / UNIT_PX;
        let astray = from_root.powi(2);
        let ([x, y], variance_px) = course.places.solve(from_root, NOISE_PX / BEND_PX)?;
        let ([depth], variance_m) = course.depths.solve(from_root, NOISE_M / BEND_M)?;
        Some(Self {
            x,
            y,
            depth,
            sigma_px: (NOISE_PX * variance_px.sqrt()).hypot(ASTRAY_PX * astray) as f32,
            sigma_m: (NOISE_M * variance_m.sqrt()).hypot(ASTRAY_M * astray) as f32,
        })
    }

    /// Where it is at a distance from its root, pixels, and how deep, metres.
    pub(super) fn at(&self, from_root_px: f32) -> (Vec2, f32) {
        let u = f64::from(from_root_px) / UNIT_PX;
        let basis = DVec3::new(1.0, u, u * u * u);
        let mid = Vec2::new(self.x.dot(basis) as f32, self.y.dot(basis) as f32);
        (mid, self.depth.dot(basis) as f32)
    }

    /// Unit vector along it at its root, away from the tip.
    pub(super) fn along(&self) -> Vec2 {
        -Vec2::new(self.x.y as f32, self.y.y as f32).normalize_or(Vec2::NEG_Y)
    }
}

/// Sums over samples at `u`, of which weighted least squares of `N` quantities over 1, u and u³ is made, wherever
/// u is counted from.
#[derive(Clone, Copy, Debug)]
struct Powers<const N: usize> {
    /// Σ w·uᵏ.
    weights: [f64; 7],
    /// Σ w·v·uᵏ.
    values: [[f64; 4]; N],
}

impl<const N: usize> Default for Powers<N> {
    fn default() -> Self {
        Self { weights: [0.0; 7], values: [[0.0; 4]; N] }
    }
}

impl<const N: usize> Powers<N> {
    fn add(&mut self, u: f64, values: [f64; N], weight: f64) {
        let mut power = weight;
        for k in 0..self.weights.len() {
            self.weights[k] += power;
            for (sums, value) in self.values.iter_mut().zip(values) {
                if let Some(sum) = sums.get_mut(k) {
                    *sum += power * value;
                }
            }
            power *= u;
        }
    }

    /// The coefficients where all samples lie `by` farther on, and the variance of the first one in variances of
    /// a sample. `expected`: the noise of a sample over how large the last coefficient may be.
    fn solve(&self, by: f64, expected: f64) -> Option<([DVec3; N], f64)> {
        let weights = shifted(self.weights, by);
        // Symmetric: rows or columns.
        let column = |powers: [usize; 3]| DVec3::from_array(powers.map(|power| weights[power]));
        let mut matrix = DMat3::from_cols(column([0, 1, 3]), column([1, 2, 4]), column([3, 4, 6]));
        matrix.z_axis.z += expected * expected;
        if matrix.determinant().abs() < 1e-9 {
            return None;
        }
        let inverse = matrix.inverse();
        let coefficients = self.values.map(|values| {
            let [one, first, _, third] = shifted(values, by);
            inverse * DVec3::new(one, first, third)
        });
        Some((coefficients, inverse.x_axis.x.max(0.0)))
    }
}

/// Sums of the powers of u as those of u + `by`: binomial sums, as Pascal's triangle makes them.
fn shifted<const N: usize>(mut sums: [f64; N], by: f64) -> [f64; N] {
    for first in 1..N {
        for k in (first..N).rev() {
            sums[k] += by * sums[k - 1];
        }
    }
    sums
}
