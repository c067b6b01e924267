//! Blades drawn into a depth buffer that is finer than the sensor's pixels.

use glam::DVec3;

use super::blade::SyntheticBlade;
use crate::frame::CameraModel;

/// Samples along a pixel's side. One of them lies on the pixel's centre.
const SAMPLES_PER_PX: f64 = 4.0;

/// The nearest depth at every sample of a window of the picture.
pub(super) struct Surface {
    /// First column and row of the window, in samples from the centre of pixel (0, 0).
    origin: (i64, i64),
    width: usize,
    height: usize,
    /// Row-major, metres; infinity where no blade is.
    depth: Vec<f64>,
}

/// A corner of a triangle: position in samples, and one over its depth.
#[derive(Clone, Copy)]
struct Corner {
    x: f64,
    y: f64,
    inverse_depth: f64,
}

impl Surface {
    /// Draws blades, which lie before the camera (z > 0).
    pub(super) fn draw(blades: &[SyntheticBlade], camera: &CameraModel) -> Self {
        let corner = |point: DVec3| Corner {
            x: (camera.fx * point.x / point.z + camera.cx) * SAMPLES_PER_PX,
            y: (camera.fy * point.y / point.z + camera.cy) * SAMPLES_PER_PX,
            inverse_depth: 1.0 / point.z,
        };
        let ribbons: Vec<Vec<[Corner; 2]>> = blades
            .iter()
            .map(|blade| blade.sections.iter().map(|s| [corner(s.left()), corner(s.right())]).collect())
            .collect();
        let mut surface = Self::around(ribbons.iter().flatten().flatten());
        for ribbon in &ribbons {
            for pair in ribbon.windows(2) {
                surface.triangle(pair[0][0], pair[0][1], pair[1][0]);
                surface.triangle(pair[0][1], pair[1][1], pair[1][0]);
            }
        }
        surface
    }

    /// An empty window around corners.
    fn around<'a>(corners: impl Iterator<Item = &'a Corner>) -> Self {
        let none = (f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY);
        let (x0, y0, x1, y1) = corners.fold(none, |(x0, y0, x1, y1), corner| {
            (x0.min(corner.x), y0.min(corner.y), x1.max(corner.x), y1.max(corner.y))
        });
        if x0 > x1 {
            return Self { origin: (0, 0), width: 0, height: 0, depth: Vec::new() };
        }
        let origin = (x0.floor() as i64, y0.floor() as i64);
        let (width, height) =
            ((x1.ceil() as i64 - origin.0 + 1) as usize, (y1.ceil() as i64 - origin.1 + 1) as usize);
        Self { origin, width, height, depth: vec![f64::INFINITY; width * height] }
    }

    /// Draws one triangle, either way round; its rim belongs to it.
    fn triangle(&mut self, a: Corner, b: Corner, c: Corner) {
        let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        if area == 0.0 {
            return;
        }
        let column = |x: f64| (x as i64 - self.origin.0).clamp(0, self.width as i64 - 1) as usize;
        let row = |y: f64| (y as i64 - self.origin.1).clamp(0, self.height as i64 - 1) as usize;
        let columns = column(a.x.min(b.x).min(c.x).floor())..=column(a.x.max(b.x).max(c.x).ceil());
        let rows = row(a.y.min(b.y).min(c.y).floor())..=row(a.y.max(b.y).max(c.y).ceil());
        for j in rows {
            let y = (self.origin.1 + j as i64) as f64;
            for i in columns.clone() {
                let x = (self.origin.0 + i as i64) as f64;
                let of_b = ((x - a.x) * (c.y - a.y) - (y - a.y) * (c.x - a.x)) / area;
                let of_c = ((b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)) / area;
                let of_a = 1.0 - of_b - of_c;
                if of_a < 0.0 || of_b < 0.0 || of_c < 0.0 {
                    continue;
                }
                // One over depth is linear in the picture.
                let depth = 1.0 / (of_a * a.inverse_depth + of_b * b.inverse_depth + of_c * c.inverse_depth);
                let sample = &mut self.depth[j * self.width + i];
                *sample = sample.min(depth);
            }
        }
    }

    /// Depth at a place of the picture, pixels; metres, infinity where no blade is.
    pub(super) fn depth_at(&self, u: f64, v: f64) -> f64 {
        let i = (u * SAMPLES_PER_PX).round() as i64 - self.origin.0;
        let j = (v * SAMPLES_PER_PX).round() as i64 - self.origin.1;
        let inside = (0..self.width as i64).contains(&i) && (0..self.height as i64).contains(&j);
        if inside { self.depth[j as usize * self.width + i as usize] } else { f64::INFINITY }
    }

    /// Whether a blade may be within `margin` pixels of a pixel.
    pub(super) fn is_near(&self, x: usize, y: usize, margin: f64) -> bool {
        let near = |pixel: usize, origin: i64, extent: usize| {
            let low = origin as f64 / SAMPLES_PER_PX - margin;
            let high = (origin + extent as i64) as f64 / SAMPLES_PER_PX + margin;
            extent > 0 && (low..=high).contains(&(pixel as f64))
        };
        near(x, self.origin.0, self.width) && near(y, self.origin.1, self.height)
    }
}
