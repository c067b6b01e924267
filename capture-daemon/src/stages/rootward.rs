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

impl Rootward {
    /// Of sections from the lowest one that is seen towards the tip, `length_px` from the root; `None` where
    /// there are too few.
    pub(super) fn of(sections: &[Section], length_px: f32) -> Option<Self> {
        let (mut places, mut depths) = (Fit::default(), Fit::default());
        let mut s = f64::from(length_px);
        for (i, section) in sections.iter().enumerate() {
            let mid = section.middle();
            if i > 0 {
                s += f64::from(mid.distance(sections[i - 1].middle()));
            }
            let memory = (-(s - f64::from(length_px)) / MEMORY_PX).exp();
            let u = s / UNIT_PX;
            let basis = DVec3::new(1.0, u, u * u * u);
            places.add(basis, [mid.x.into(), mid.y.into()], memory * f64::from(section.weight()));
            if let Some(depth) = section.measured.depth_m {
                depths.add(basis, [depth.into(), 0.0], memory * f64::from(section.measured.readings.min(20)));
            }
        }
        let astray = (f64::from(length_px) / UNIT_PX).powi(2);
        let ([x, y], variance_px) = places.solve(NOISE_PX / BEND_PX)?;
        let ([depth, _], variance_m) = depths.solve(NOISE_M / BEND_M)?;
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

/// Weighted least squares of two quantities over the same basis.
#[derive(Default)]
struct Fit {
    normal: [DVec3; 3],
    values: [DVec3; 2],
}

impl Fit {
    fn add(&mut self, basis: DVec3, values: [f64; 2], weight: f64) {
        let weighted = basis * weight;
        for (row, factor) in self.normal.iter_mut().zip(weighted.to_array()) {
            *row += basis * factor;
        }
        for (sum, value) in self.values.iter_mut().zip(values) {
            *sum += weighted * value;
        }
    }

    /// The coefficients, and the variance of the first one in variances of a sample. `expected`: the noise
    /// of a sample over how large the last coefficient may be.
    fn solve(&self, expected: f64) -> Option<([DVec3; 2], f64)> {
        let [a, b, mut c] = self.normal;
        c.z += expected * expected;
        // Symmetric: rows or columns.
        let matrix = DMat3::from_cols(a, b, c);
        if matrix.determinant().abs() < 1e-9 {
            return None;
        }
        let inverse = matrix.inverse();
        Some((self.values.map(|values| inverse * values), inverse.x_axis.x.max(0.0)))
    }
}
