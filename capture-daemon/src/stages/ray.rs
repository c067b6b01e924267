//! The end of a stretch of ribbon: where it leads.

use common::geometry::fit::Parabola;
use glam::Vec2;

use super::ribbon::Section;

/// How a ribbon goes on beyond one of its ends, fitted to the sections there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    /// The end, image pixels.
    pub(super) from: Vec2,
    /// Unit vector onward.
    pub(super) along: Vec2,
    /// Depth at the end, metres.
    pub(super) depth_m: f32,
    /// What it gains each pixel on, metres.
    pub(super) climb_m: f32,
    /// Half of the width at the end, pixels.
    pub(super) half_px: f32,
    /// What that gains each pixel on.
    pub(super) taper: f32,
    /// The same two of a parabola over a longer stretch: towards its tip a blade narrows faster and faster.
    pub(super) curved_half_px: f32,
    pub(super) curved_taper: f32,
    /// Sections of the stretch.
    pub(super) length: usize,
}

impl Ray {
    /// Of the sections from an end on inward; `None` where there are too few.
    pub(super) fn of<'a>(inward: impl ExactSizeIterator<Item = &'a Section>) -> Option<Self> {
        Self::fit(inward, 0.0)
    }

    /// The same of sections none of which need show both edges.
    pub(super) fn guessed<'a>(inward: impl ExactSizeIterator<Item = &'a Section>) -> Option<Self> {
        Self::fit(inward, 0.01)
    }

    /// `one_edge`: what the width of a section without both edges counts.
    fn fit<'a>(inward: impl ExactSizeIterator<Item = &'a Section>, one_edge: f64) -> Option<Self> {
        const WINDOW: usize = 50;
        const WIDTH_WINDOW: usize = 30;
        const CURVED_WINDOW: usize = 40;
        let length = inward.len();
        if length < 16 {
            return None;
        }
        let [mut x, mut y, mut z, mut half, mut curved] = [Parabola::default(); 5];
        for (i, section) in inward.take(WINDOW).enumerate() {
            let (s, mid) = (-(i as f64), section.middle());
            let weight = f64::from(section.weight());
            x.add(s, mid.x.into(), weight);
            y.add(s, mid.y.into(), weight);
            if let Some(depth) = section.measured.depth_m {
                z.add(s, depth.into(), f64::from(section.measured.readings));
            }
            let weight = if section.edges_seen() == 2 { 1.0 } else { one_edge };
            if weight > 0.0 && i < WIDTH_WINDOW {
                half.add(s, section.expected.half_px.into(), weight);
            }
            if weight > 0.0 && i < CURVED_WINDOW {
                curved.add(s, section.expected.half_px.into(), weight);
            }
        }
        // A curvature of 1/100 px has to be worth its readings.
        let curve = |fit: &Parabola| fit.solve(2, 2000.0);
        let (x, y, z, half) = (curve(&x)?, curve(&y)?, curve(&z)?, half.solve(1, 0.0)?);
        let curved = curved.solve(2, 400.0)?;
        Some(Self {
            from: Vec2::new(x[0] as f32, y[0] as f32),
            along: Vec2::new(x[1] as f32, y[1] as f32).try_normalize()?,
            depth_m: z[0] as f32,
            climb_m: z[1] as f32,
            half_px: half[0].max(0.5) as f32,
            taper: half[1] as f32,
            curved_half_px: curved[0].max(0.5) as f32,
            curved_taper: curved[1] as f32,
            length,
        })
    }

    /// How far along it and how far beside it a point lies, pixels.
    pub(super) fn to(&self, point: Vec2) -> (f32, f32) {
        let by = point - self.from;
        (by.dot(self.along), by.perp_dot(self.along).abs())
    }

    /// Depth that it leads to, metres.
    pub(super) fn depth_at(&self, point: Vec2) -> f32 {
        self.depth_m + self.climb_m * self.to(point).0
    }
}
