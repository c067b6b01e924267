//! Frames of an upright bar, for tests: one blade, seen head on.

use crate::frame::{CameraModel, DepthFrame};

/// Columns and rows.
pub(crate) const SIZE: [usize; 2] = [160, 120];

/// Frame `index` at 30 Hz, in millimetres: the bar at `bar_mm`, if it is held, wider from row to row, before what
/// is at `background_mm`.
pub(crate) fn frame(index: u64, bar_mm: Option<u16>, background_mm: u16) -> DepthFrame {
    let [width, height] = SIZE;
    let depth = (0..width * height).map(|at| {
        let (x, y) = (at % width, at / width);
        let half = 1 + y / 24;
        let is_bar = (80 - half..80 + half).contains(&x) && (20..100).contains(&y);
        bar_mm.filter(|_| is_bar).unwrap_or(background_mm)
    });
    DepthFrame {
        width,
        height,
        depth: depth.collect(),
        depth_unit_m: 0.001,
        camera: CameraModel { fx: 140.0, fy: 140.0, cx: 79.5, cy: 59.5 },
        timestamp_ns: 1_000_000_000 + index * 33_333_333,
    }
}
