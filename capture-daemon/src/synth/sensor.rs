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
        let steps = self.counts_of_steps();
        let mut counts = Vec::with_capacity(seen.len());
        for row in seen.chunks_exact(self.width) {
            for (x, &z) in row.iter().enumerate() {
                let right = &row[x + 1..(x + 1 + shadow_px).min(self.width)];
                let in_shadow = right.iter().any(|&other| other < z - SHADOW_STEP_M);
                // Drawn for every pixel, so that what one shows does not change the noise of the others.
                let (normal, lot) = (random.normal(), random.unit());
                let dropped = lot < DROP_OUTS * self.noise;
                counts.push(if in_shadow || dropped { 0 } else { self.measure(z, normal, &steps) });
            }
        }
        counts
    }

    /// The depth of the point that each pixel looks at, metres, row-major.
    fn look(&self, surface: Option<&Surface>, random: &mut Random) -> Vec<f64> {
        let mut seen = vec![BACKGROUND_M; self.width * self.height];
        let Some(surface) = surface else { return seen };
        let (columns, rows) = surface.near((self.width, self.height), 4.0 * JITTER_PX.0 * self.noise);
        for y in rows {
            for x in columns.clone() {
                let u = x as f64 + JITTER_PX.0 * self.noise * random.normal();
                let v = y as f64 + JITTER_PX.1 * self.noise * random.normal();
                seen[y * self.width + x] = surface.depth_at(u, v).min(BACKGROUND_M);
            }
        }
        seen
    }

    /// The reading at true depth `z` metres with a standard normal error `normal`; `steps` as
    /// [`Self::counts_of_steps`] gives them.
    fn measure(&self, z: f64, normal: f64, steps: &[u16]) -> u16 {
        let z = z + depth_sigma_m(z) * self.noise * normal;
        let step = self.disparity_step_px();
        if step > 0.0 {
            let step_count = round(self.reach() / z / step);
            // An index only where it is one of the table's, exactly.
            let in_table = step_count >= 0.0 && step_count < steps.len() as f64;
            if in_table { steps[step_count as usize] } else { self.counts_of_step(step_count) }
        } else {
            counts_of(z)
        }
    }

    /// Focal length times base line, pixels times metres.
    fn reach(&self) -> f64 {
        self.camera.fx * BASE_LINE_M
    }

    fn disparity_step_px(&self) -> f64 {
        DISPARITY_STEP_PX * self.noise
    }

    /// The reading at a disparity of that many steps.
    fn counts_of_step(&self, step_count: f64) -> u16 {
        counts_of(self.reach() / (step_count * self.disparity_step_px()))
    }

    /// The readings at disparities of 0, 1, … steps, nearly all that occur; none without steps.
    fn counts_of_steps(&self) -> Vec<u16> {
        const STEPS: usize = 2048;
        let count = if self.disparity_step_px() > 0.0 { STEPS } else { 0 };
        (0..count).map(|step_count| self.counts_of_step(step_count as f64)).collect()
    }
}

/// Depth in counts. The cast saturates; infinity and what is no number are no reading.
fn counts_of(z: f64) -> u16 {
    if z.is_finite() { round(z / DEPTH_UNIT_M) as u16 } else { 0 }
}

/// [`f64::round`], bit for bit; where the processor has no instruction for it, several times faster.
#[inline]
pub(super) fn round(value: f64) -> f64 {
    if (0.0..1e15).contains(&value) {
        let whole = value as i64 as f64;
        whole + if value - whole >= 0.5 { 1.0 } else { 0.0 }
    } else {
        value.round()
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
    fn rounding_is_that_of_the_standard_library() {
        let mut random = Random::new(3, 0);
        let edges = [0.0, 0.5, 1.5, 0.499_999_999_999_999_94, 1e15, 4.5e15, -0.5, -2.5, f64::INFINITY];
        for value in (0..10_000).map(|i| random.range(-1.0, f64::from(i))).chain(edges) {
            assert_eq!(round(value), value.round(), "{value}");
        }
        assert!(round(f64::NAN).is_nan());
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
