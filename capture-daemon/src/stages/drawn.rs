//! Drawn depth for the tests of single stages.

use glam::Vec2;

use super::accumulate::Accumulation;
use super::mask::{self, Mask, MaskParams};
use super::ribbon::{ANCHOR, Section};
use super::section::{Expected, Fold};
use crate::frame::{CameraModel, DepthFrame};

/// The mask of one frame of `width` × `height` pixels, `depth_m` metres away at each column and row, which a
/// camera of 570 pixels focal length sees in its middle.
pub(super) fn mask_of((width, height): (usize, usize), depth_m: impl Fn(i32, i32) -> f32) -> Mask {
    let counts =
        |index: usize| (1e4 * depth_m((index % width) as i32, (index / width) as i32)).round() as u16;
    let (cx, cy) = (0.5 * width as f64, 0.5 * height as f64);
    let frame = DepthFrame {
        width,
        height,
        depth: (0..width * height).map(counts).collect(),
        depth_unit_m: 1e-4,
        timestamp_ns: 0,
        camera: CameraModel { fx: 570.0, fy: 570.0, cx, cy },
    };
    let params = MaskParams::default();
    let mut accumulation = Accumulation::like(&frame);
    accumulation.add(&frame, &params);
    mask::extract(&accumulation, &params)
}

/// The cross-section along a row of what is half a metre away and so wide there.
pub(super) fn section_along_row(mask: &Mask, mid: Vec2, half_px: f32) -> Section {
    let expected = Expected {
        mid,
        across: Vec2::X,
        half_px,
        depth_m: 0.5,
        slope_m: 0.0,
        fold: Fold::default(),
        tolerance_m: 0.004,
        search_px: 4.0,
    };
    Section { expected, measured: expected.measure(mask), anchor: ANCHOR, guide_px: None }
}
