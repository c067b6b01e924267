//! How a ribbon that is followed goes on.

use common::geometry::fit::Parabola;
use glam::Vec2;

use super::ribbon::Section;
use super::section::{Expected, Fold};

/// Parabolas and lines through the sections so far, of which each counts less the farther it is back. What
/// comes next lies at 0 of them, the last section at −1.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Trend {
    x: Parabola,
    y: Parabola,
    half: Parabola,
    depth: Parabola,
    /// Σ of what the slope across is fitted to, as in [`super::section::Measured::slope_moments`], and its weight.
    slope: [f32; 2],
    /// Half of the width of the last section that says something about the midrib, pixels.
    known_px: f32,
}

/// How far back a section counts, pixels.
const MEMORY_PX: f64 = 24.0;
/// What is farther back than this is as good as forgotten.
const WINDOW: usize = 80;

/// Keeps the slope calm where there are but a few pixels, as in `settle::slopes`; more, as each section is
/// sought by the slope of those before it.
const SLOPE_RIDGE: f32 = 4.0;

impl Trend {
    /// Of the sections so far, about a pixel apart. O(1).
    pub(super) fn of(sections: &[Section]) -> Self {
        let recent = &sections[sections.len().saturating_sub(WINDOW)..];
        let known_px = recent.last().map_or(0.0, |last| last.expected.half_px);
        let mut trend = Self { known_px, ..Self::default() };
        recent.iter().for_each(|section| trend.push(section));
        trend
    }

    /// Goes on to the next section. O(1).
    pub(super) fn push(&mut self, section: &Section) {
        let weight = f64::from(section.weight());
        let mid = section.middle();
        self.x.add(0.0, mid.x.into(), weight);
        self.y.add(0.0, mid.y.into(), weight);
        if section.edges_seen() == 2 {
            self.half.add(0.0, section.expected.half_px.into(), weight);
        }
        if let Some(depth) = section.measured.depth_m {
            self.depth.add(0.0, depth.into(), f64::from(section.measured.readings));
        }
        let [moment, square] = section.measured.slope_moments;
        self.slope[0] += moment + section.expected.slope_m * square;
        self.slope[1] += square;
        if weight > 0.0 {
            self.known_px = section.expected.half_px;
        }
        let remembered = (-1.0 / MEMORY_PX).exp();
        for fit in [&mut self.x, &mut self.y, &mut self.half, &mut self.depth] {
            fit.scale(remembered);
            fit.shift(-1.0);
        }
        self.slope = self.slope.map(|sum| sum * remembered as f32);
    }

    /// What is expected a pixel beyond the `last` section. How far an edge and a reading may be off is taken
    /// over from it.
    pub(super) fn next(&self, last: &Expected) -> Expected {
        let along = Vec2::new(last.across.y, -last.across.x);
        // A curvature of 1/100 px has to be worth its readings.
        let curve = |fit: &Parabola| fit.solve(2, 200.0);
        let (mid, direction) = match (curve(&self.x), curve(&self.y)) {
            (Some(x), Some(y)) => (Vec2::new(x[0] as f32, y[0] as f32), Vec2::new(x[1] as f32, y[1] as f32)),
            _ => (last.mid + along, along),
        };
        let direction = direction.normalize_or(along);
        let value = |fit: Option<[f64; 3]>, fallback: f32| fit.map_or(fallback, |fit| fit[0] as f32);
        let half_px = value(self.half.solve(1, 0.0), self.known_px);
        let half_px = half_px.clamp(0.6 * self.known_px, 1.25 * self.known_px).max(0.5);
        Expected {
            mid,
            across: Vec2::new(-direction.y, direction.x),
            half_px,
            fold: Fold { at_px: last.fold.at_px * half_px / last.half_px, ..last.fold },
            depth_m: value(curve(&self.depth), last.depth_m),
            slope_m: self.slope[0] / (self.slope[1] + SLOPE_RIDGE),
            ..*last
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{CameraModel, DepthFrame};
    use crate::stages::accumulate::Accumulation;
    use crate::stages::mask::{self, Mask, MaskParams};
    use crate::stages::ribbon::{ANCHOR, RibbonParams, extend, fits};

    const MIDDLE: f32 = 40.0;
    const HALF_PX: f32 = 8.5;
    const FIRST: usize = 150;
    const TIP: usize = 20;

    /// Depth in the middle of a leaf that comes towards the camera, and its slope across, at a row.
    fn leaf(row: usize) -> (f32, f32) {
        let along = FIRST as f32 - row as f32;
        (0.60 - 8.0e-4 * along, 5.0e-6 * along)
    }

    /// A leaf up a column before a wall at 1.4 m.
    fn drawn() -> Mask {
        let (width, height) = (80, 200);
        let depth_m = |x: usize, y: usize| {
            let (middle_m, slope_m) = leaf(y);
            let aside = x as f32 - MIDDLE;
            if aside.abs() < HALF_PX && y >= TIP { middle_m + slope_m * aside } else { 1.4 }
        };
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let frame = DepthFrame {
            width,
            height,
            depth: pixels.map(|(x, y)| (1e4 * depth_m(x, y)).round() as u16).collect(),
            depth_unit_m: 1e-4,
            timestamp_ns: 0,
            camera: CameraModel { fx: 570.0, fy: 570.0, cx: 40.0, cy: 100.0 },
        };
        let params = MaskParams::default();
        let mut accumulation = Accumulation::like(&frame);
        accumulation.add(&frame, &params);
        mask::extract(&accumulation, &params)
    }

    #[test]
    fn a_leaf_whose_slope_across_grows_towards_the_camera_is_followed_to_its_tip() {
        let mask = drawn();
        let section = |row: usize| {
            let (depth_m, slope_m) = leaf(row);
            let expected = Expected {
                mid: Vec2::new(MIDDLE, row as f32),
                across: Vec2::X,
                half_px: HALF_PX,
                depth_m,
                slope_m,
                fold: Fold::default(),
                tolerance_m: 0.002,
                search_px: 2.0,
            };
            Section { expected, measured: expected.measure(&mask), anchor: ANCHOR, guide_px: None }
        };
        let mut sections: Vec<Section> = (FIRST - 30..=FIRST).rev().map(section).collect();
        extend(&mask, &mut sections, &[], &RibbonParams::default(), fits);
        let last = &sections[sections.len() - 1].expected;
        assert!(last.mid.y < TIP as f32 + 4.0, "it is lost at {}", last.mid);
        for Section { expected, .. } in sections.iter().filter(|it| it.expected.mid.y > TIP as f32 + 8.0) {
            let off = [(expected.mid.x - MIDDLE).abs(), (expected.half_px - HALF_PX).abs()];
            assert!(off.iter().all(|off| *off < 0.7), "off by {off:?} px at {}", expected.mid);
        }
    }
}
