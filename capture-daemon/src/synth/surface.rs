//! Blades and hands drawn into a depth buffer that is finer than the sensor's pixels.

use std::ops::Range;

use glam::DVec3;

use super::blade::{Section, SyntheticBlade};
use super::hand::Triangle;
use super::sensor::round;
use crate::frame::CameraModel;

/// Samples along a pixel's side. One of them lies on the pixel's centre.
const SAMPLES_PER_PX: f64 = 4.0;

/// What lies this far beyond the picture's border still shows in it: the sensor's pixels look that far,
/// pixels.
const BEYOND_PX: f64 = 32.0;

/// The nearest depth at every sample of a window of the picture.
#[derive(Clone)]
pub(super) struct Surface {
    /// First column and row of the window, in samples from the centre of pixel (0, 0).
    origin: (i64, i64),
    width: usize,
    height: usize,
    /// Row-major, metres; infinity where nothing is.
    depth: Vec<f64>,
}

/// A corner of a triangle: position in samples, and one over its depth.
#[derive(Clone, Copy)]
struct Corner {
    x: f64,
    y: f64,
    inverse_depth: f64,
}

/// Twice a triangle's area in the picture, square samples: negative if its corners run anticlockwise, as
/// seen.
fn doubled_area(a: Corner, b: Corner, c: Corner) -> f64 {
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}

/// Where in the row `y` a triangle can be, first and last place, with more than a sample to spare on both
/// sides: `edges` from corner to corner, `area` as [`doubled_area`] gives it. May be infinite, or
/// empty (first > last).
fn span(edges: &[(Corner, Corner); 3], area: f64, y: f64) -> (f64, f64) {
    // What is nearly level, less than this down, crosses the row nowhere for certain, samples.
    const LEVEL: f64 = 1e-4;
    const SPARE: f64 = 1.5;
    let (mut first, mut last) = (f64::NEG_INFINITY, f64::INFINITY);
    for (from, to) in edges {
        let down = to.y - from.y;
        if down.abs() < LEVEL {
            continue;
        }
        let crossing = from.x + (y - from.y) * (to.x - from.x) / down;
        // The inside of an edge that runs up is to its right if the triangle's area is positive.
        if (down > 0.0) == (area > 0.0) {
            last = last.min(crossing + SPARE);
        } else {
            first = first.max(crossing - SPARE);
        }
    }
    (first, last)
}

impl Surface {
    /// Draws blades and closed bodies made of triangles, which lie before the camera (z > 0): what a
    /// picture of `size` (columns, rows) shows of them.
    pub(super) fn draw(
        blades: &[SyntheticBlade],
        triangles: &[Triangle],
        camera: &CameraModel,
        size: (usize, usize),
    ) -> Self {
        let corner = |point: DVec3| Corner {
            x: (camera.fx * point.x / point.z + camera.cx) * SAMPLES_PER_PX,
            y: (camera.fy * point.y / point.z + camera.cy) * SAMPLES_PER_PX,
            inverse_depth: 1.0 / point.z,
        };
        let ribbon = |blade: &SyntheticBlade, left: fn(&Section) -> DVec3, right: fn(&Section) -> DVec3| {
            blade.sections.iter().map(|s| [corner(left(s)), corner(right(s))]).collect::<Vec<_>>()
        };
        // A folded blade is two ribbons that meet at the midrib.
        let ribbons = blades.iter().flat_map(|blade| {
            if blade.fold == 0.0 {
                vec![ribbon(blade, Section::left, Section::right)]
            } else {
                let midrib = |section: &Section| section.center;
                vec![ribbon(blade, Section::left, midrib), ribbon(blade, midrib, Section::right)]
            }
        });
        let ribbons: Vec<Vec<[Corner; 2]>> = ribbons.collect();
        let triangles: Vec<[Corner; 3]> = triangles.iter().map(|triangle| triangle.map(corner)).collect();
        let corners = ribbons.iter().flatten().flatten().chain(triangles.iter().flatten());
        let mut surface = Self::around(corners, size);
        for [a, b, c] in triangles {
            // Of closed bodies, the far side is never seen.
            if doubled_area(a, b, c) > 0.0 {
                surface.triangle(a, b, c);
            }
        }
        for ribbon in &ribbons {
            for pair in ribbon.windows(2) {
                surface.triangle(pair[0][0], pair[0][1], pair[1][0]);
                surface.triangle(pair[0][1], pair[1][1], pair[1][0]);
            }
        }
        surface
    }

    /// An empty window around corners, no larger than a picture of `size` and what may show in it.
    fn around<'a>(corners: impl Iterator<Item = &'a Corner>, size: (usize, usize)) -> Self {
        let none = (f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY);
        let (x0, y0, x1, y1) = corners.fold(none, |(x0, y0, x1, y1), corner| {
            (x0.min(corner.x), y0.min(corner.y), x1.max(corner.x), y1.max(corner.y))
        });
        let low = -BEYOND_PX * SAMPLES_PER_PX;
        let [right, bottom] = [size.0, size.1].map(|side| (side as f64 + BEYOND_PX) * SAMPLES_PER_PX);
        let (x0, y0, x1, y1) = (x0.max(low), y0.max(low), x1.min(right), y1.min(bottom));
        if x0 > x1 || y0 > y1 {
            return Self { origin: (0, 0), width: 0, height: 0, depth: Vec::new() };
        }
        let origin = (x0.floor() as i64, y0.floor() as i64);
        let (width, height) =
            ((x1.ceil() as i64 - origin.0 + 1) as usize, (y1.ceil() as i64 - origin.1 + 1) as usize);
        Self { origin, width, height, depth: vec![f64::INFINITY; width * height] }
    }

    /// Draws one triangle, either way round; its rim belongs to it.
    fn triangle(&mut self, a: Corner, b: Corner, c: Corner) {
        let area = doubled_area(a, b, c);
        if area == 0.0 {
            return;
        }
        let (right, bottom) =
            (self.origin.0 as f64 + self.width as f64, self.origin.1 as f64 + self.height as f64);
        let beyond = |a: f64, b: f64, c: f64, low: i64, high: f64| {
            a.max(b).max(c) < low as f64 || a.min(b).min(c) > high
        };
        if beyond(a.x, b.x, c.x, self.origin.0, right) || beyond(a.y, b.y, c.y, self.origin.1, bottom) {
            return;
        }
        let column = |x: f64| (x as i64 - self.origin.0).clamp(0, self.width as i64 - 1) as usize;
        let row = |y: f64| (y as i64 - self.origin.1).clamp(0, self.height as i64 - 1) as usize;
        let columns = column(a.x.min(b.x).min(c.x).floor())..=column(a.x.max(b.x).max(c.x).ceil());
        let rows = row(a.y.min(b.y).min(c.y).floor())..=row(a.y.max(b.y).max(c.y).ceil());
        let sign = area.signum();
        let edges = [(a, b), (b, c), (c, a)];
        for j in rows {
            let y = (self.origin.1 + j as i64) as f64;
            let (first, last) = span(&edges, area, y);
            let (first, last) = (first - self.origin.0 as f64, last - self.origin.0 as f64);
            // The casts saturate; no sample of an empty span is looked at.
            let columns =
                (*columns.start()).max(first as usize)..=(*columns.end()).min(last.max(-1.0) as usize);
            if last < 0.0 {
                continue;
            }
            for i in columns {
                let x = (self.origin.0 + i as i64) as f64;
                let of_b = (x - a.x) * (c.y - a.y) - (y - a.y) * (c.x - a.x);
                let of_c = (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
                // Beyond an edge, which most samples are: no need to divide.
                if of_b * sign < 0.0 || of_c * sign < 0.0 {
                    continue;
                }
                let (of_b, of_c) = (of_b / area, of_c / area);
                let of_a = 1.0 - of_b - of_c;
                if of_a < 0.0 {
                    continue;
                }
                // One over depth is linear in the picture.
                let depth = 1.0 / (of_a * a.inverse_depth + of_b * b.inverse_depth + of_c * c.inverse_depth);
                let sample = &mut self.depth[j * self.width + i];
                *sample = sample.min(depth);
            }
        }
    }

    /// Depth at a place of the picture, pixels; metres, infinity where nothing is.
    pub(super) fn depth_at(&self, u: f64, v: f64) -> f64 {
        let i = round(u * SAMPLES_PER_PX) as i64 - self.origin.0;
        let j = round(v * SAMPLES_PER_PX) as i64 - self.origin.1;
        let inside = (0..self.width as i64).contains(&i) && (0..self.height as i64).contains(&j);
        if inside { self.depth[j as usize * self.width + i as usize] } else { f64::INFINITY }
    }

    /// The columns and rows of a picture of `size` that something may be within `margin` pixels of.
    pub(super) fn near(&self, size: (usize, usize), margin: f64) -> (Range<usize>, Range<usize>) {
        let near = |pixels: usize, origin: i64, extent: usize| {
            let low = origin as f64 / SAMPLES_PER_PX - margin;
            let high = (origin + extent as i64) as f64 / SAMPLES_PER_PX + margin;
            if extent == 0 || high < 0.0 {
                return 0..0;
            }
            // The casts saturate.
            low.max(0.0).ceil() as usize..pixels.min(high.floor() as usize + 1)
        };
        (near(size.0, self.origin.0, self.width), near(size.1, self.origin.1, self.height))
    }
}
