//! The sensor: what a structured light camera makes of a surface.
//!
//! Its errors at noise 1: σ = 0.6·(1.2 + 1.9·(z−0.4)²) mm per pixel and frame, disparity in ⅛ px at a
//! 75 mm base line, edges jittered by σ 0.45 px across and 0.35 px down, a 3 px shadow band without
//! reading to the left of near edges, 0.2 % drop-outs. Each is scaled by the noise; 0 leaves the
//! surface at pixel centres, rounded to depth units.

use super::random::Random;
use super::surface::Surface;
use crate::frame::CameraModel;

/// Distance of the wall behind the blades, metres.
pub const BACKGROUND_M: f64 = 1.3;
/// Base line between projector and camera, metres.
const BASE_LINE_M: f64 = 0.075;
/// Steps of the disparity, pixels.
const DISPARITY_STEP_PX: f64 = 0.125;
/// Standard deviation of the place that a pixel looks at, across and down, pixels.
const JITTER_PX: (f64, f64) = (0.45, 0.35);
/// Width of the band beside a near edge that the projector does not reach, pixels.
const SHADOW_PX: f64 = 3.0;
/// A step in depth from which on an edge throws a shadow, metres.
const SHADOW_STEP_M: f64 = 0.03;
/// Part of the pixels that have no reading for no reason.
const DROP_OUTS: f64 = 0.002;
/// Metres of one count of depth.
pub const DEPTH_UNIT_M: f64 = 0.001;

/// Standard deviation of a reading at depth `z` metres, metres.
fn depth_sigma_m(z: f64) -> f64 {
    0.6e-3 * (1.2 + 1.9 * (z - 0.4) * (z - 0.4))
}

/// The sensor, before its wall.
pub(super) struct Sensor {
    /// Columns.
    pub(super) width: usize,
    /// Rows.
    pub(super) height: usize,
    /// Its optics.
    pub(super) camera: CameraModel,
    /// Scale of all its errors, ≥ 0.
    pub(super) noise: f64,
}

impl Sensor {
    /// Takes one picture: `width * height` counts of [`DEPTH_UNIT_M`], row-major, 0 without reading.
    pub(super) fn take(&self, surface: Option<&Surface>, random: &mut Random) -> Vec<u16> {
        let seen = self.look(surface, random);
        let shadow_px = (SHADOW_PX * self.noise).round() as usize;
        let mut counts = Vec::with_capacity(seen.len());
        for (i, &z) in seen.iter().enumerate() {
            let right = &seen[i + 1..(i + 1 + shadow_px).min(i - i % self.width + self.width)];
            let in_shadow = right.iter().any(|&other| other < z - SHADOW_STEP_M);
            // Drawn for every pixel, so that what one shows does not change the noise of the others.
            let (normal, lot) = (random.normal(), random.unit());
            let dropped = lot < DROP_OUTS * self.noise;
            counts.push(if in_shadow || dropped { 0 } else { self.measure(z, normal) });
        }
        counts
    }

    /// The depth of the point that each pixel looks at, metres, row-major.
    fn look(&self, surface: Option<&Surface>, random: &mut Random) -> Vec<f64> {
        let mut seen = vec![BACKGROUND_M; self.width * self.height];
        let Some(surface) = surface else { return seen };
        for y in 0..self.height {
            for x in 0..self.width {
                if surface.is_near(x, y, 4.0 * JITTER_PX.0 * self.noise) {
                    let u = x as f64 + JITTER_PX.0 * self.noise * random.normal();
                    let v = y as f64 + JITTER_PX.1 * self.noise * random.normal();
                    seen[y * self.width + x] = surface.depth_at(u, v).min(BACKGROUND_M);
                }
            }
        }
        seen
    }

    /// The reading at true depth `z` metres with a standard normal error `normal`.
    fn measure(&self, z: f64, normal: f64) -> u16 {
        let mut z = z + depth_sigma_m(z) * self.noise * normal;
        let step = DISPARITY_STEP_PX * self.noise;
        if step > 0.0 {
            let reach = self.camera.fx * BASE_LINE_M;
            z = reach / ((reach / z / step).round() * step);
        }
        // The cast saturates; infinity and what is no number are no reading.
        if z.is_finite() { (z / DEPTH_UNIT_M).round() as u16 } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor(noise: f64) -> Sensor {
        let camera = CameraModel { fx: 570.0, fy: 570.0, cx: 319.5, cy: 239.5 };
        Sensor { width: 640, height: 480, camera, noise }
    }

    #[test]
    fn without_noise_the_wall_is_flat() {
        let counts = sensor(0.0).take(None, &mut Random::new(1, 1));
        assert!(counts.iter().all(|&count| count == 1300));
    }

    #[test]
    fn the_wall_has_the_noise_and_drop_outs_of_the_model() {
        let counts = sensor(1.0).take(None, &mut Random::new(1, 1));
        let read: Vec<f64> =
            counts.iter().filter(|&&count| count > 0).map(|&count| f64::from(count)).collect();
        let dropped = 1.0 - read.len() as f64 / counts.len() as f64;
        assert!((dropped - 0.002).abs() < 0.0005, "{dropped}");
        let mean = read.iter().sum::<f64>() / read.len() as f64;
        let variance = read.iter().map(|z| (z - mean) * (z - mean)).sum::<f64>() / read.len() as f64;
        // The steps of the disparity are 4.9 mm there: a reading is off by σ and a third of a step.
        let step = 1.3 * 1.3 / (570.0 * 0.075) * 0.125 * 1000.0;
        let expected = (depth_sigma_m(1.3) * 1000.0).powi(2) + step * step / 12.0;
        assert!((mean - 1300.0).abs() < 1.5, "{mean}");
        assert!((variance / expected - 1.0).abs() < 0.5, "{variance} {expected}");
    }
}
