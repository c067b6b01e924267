//! Something to draw on in image pixels, drawn large.

use glam::Vec2;
use tiny_skia::{Color, LineCap, LineJoin, Paint, PathBuilder, Pixmap, Stroke, Transform};

use crate::stages::mask::Mask;

/// An image region drawn large.
pub(crate) struct Picture {
    pub(crate) pixmap: Pixmap,
    /// Picture pixels of an image pixel.
    pub(crate) zoom: f32,
    /// The image pixel at the picture's upper left corner.
    pub(crate) origin: Vec2,
}

/// Well apart from each other and from grey.
const HUES: [[u8; 3]; 8] = [
    [230, 159, 0],
    [86, 180, 233],
    [0, 190, 120],
    [240, 228, 66],
    [120, 140, 255],
    [235, 94, 40],
    [224, 121, 190],
    [160, 220, 80],
];

/// One of [`HUES`].
pub(crate) fn hue(index: usize) -> Color {
    let [r, g, b] = HUES[index % HUES.len()];
    Color::from_rgba8(r, g, b, 255)
}

pub(crate) const WHITE: Color = Color::WHITE;

impl Picture {
    pub(crate) fn blank(width: u32, height: u32) -> Self {
        let mut pixmap = Pixmap::new(width.max(1), height.max(1)).expect("the size is above zero and small");
        pixmap.fill(Color::from_rgba8(16, 18, 20, 255));
        Self { pixmap, zoom: 1.0, origin: Vec2::ZERO }
    }

    /// What the capture shows, with a margin, as grey depth.
    pub(crate) fn of_depth(mask: &Mask) -> Self {
        let bounds = mask.blobs.regions.iter().map(|blob| blob.bounds);
        let union =
            |a: [usize; 4], b: [usize; 4]| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])];
        let [x0, y0, x1, y1] = bounds.reduce(union).unwrap_or(mask.region);
        let (x0, y0) = (x0.saturating_sub(16), y0.saturating_sub(16));
        let (x1, y1) = ((x1 + 16).min(mask.width).max(x0 + 1), (y1 + 16).min(mask.height).max(y0 + 1));
        let zoom = (1400.0 / (x1 - x0).max(y1 - y0) as f32).floor().clamp(1.0, 8.0);
        let mut picture = Self::blank(((x1 - x0) as f32 * zoom) as u32, ((y1 - y0) as f32 * zoom) as u32);
        (picture.zoom, picture.origin) = (zoom, Vec2::new(x0 as f32 - 0.5, y0 as f32 - 0.5));
        let readings = mask.depth_m.iter().copied().filter(|z| *z > 0.0);
        let (near, far) = readings.fold((f32::INFINITY, 0.0_f32), |(a, b), z| (a.min(z), b.max(z)));
        for (y, x) in (y0..y1).flat_map(|y| (x0..x1).map(move |x| (y, x))) {
            let z = mask.depth_m[y * mask.width + x];
            if z > 0.0 {
                let grey = 70.0 + 90.0 * (far - z) / (far - near).max(1e-3);
                let strength = mask.occupancy[y * mask.width + x];
                picture.pixel(
                    x,
                    y,
                    Color::from_rgba8(grey as u8, grey as u8, grey as u8, (255.0 * strength) as u8),
                );
            }
        }
        picture
    }

    fn at(&self, point: Vec2) -> Vec2 {
        (point - self.origin) * self.zoom
    }

    pub(crate) fn pixel(&mut self, x: usize, y: usize, color: Color) {
        let corner = self.at(Vec2::new(x as f32 - 0.5, y as f32 - 0.5));
        if let Some(rect) = tiny_skia::Rect::from_xywh(corner.x, corner.y, self.zoom, self.zoom) {
            self.pixmap.fill_rect(rect, &paint(color), Transform::identity(), None);
        }
    }

    pub(crate) fn line(&mut self, points: impl IntoIterator<Item = Vec2>, color: Color, width: f32) {
        let mut path = PathBuilder::new();
        for point in points.into_iter().filter(|point| point.is_finite()) {
            let p = self.at(point);
            if path.is_empty() { path.move_to(p.x, p.y) } else { path.line_to(p.x, p.y) }
        }
        let stroke =
            Stroke { width, line_cap: LineCap::Round, line_join: LineJoin::Round, ..Stroke::default() };
        if let Some(path) = path.finish() {
            self.pixmap.stroke_path(&path, &paint(color), &stroke, Transform::identity(), None);
        }
    }

    pub(crate) fn dot(&mut self, point: Vec2, color: Color, radius: f32) {
        let p = self.at(point);
        if let Some(path) = PathBuilder::from_circle(p.x, p.y, radius) {
            let paint = paint(color);
            self.pixmap.fill_path(&path, &paint, tiny_skia::FillRule::Winding, Transform::identity(), None);
        }
    }
}

fn paint(color: Color) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color(color);
    paint
}
