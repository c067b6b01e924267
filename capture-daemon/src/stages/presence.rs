//! Whether something is held before the camera, from one frame.

use super::mask::MaskParams;
use crate::frame::DepthFrame;

/// What one frame shows, in short: enough for the station to tell whether something is there and
/// whether it stands still.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Presence {
    /// Pixels within the depth window.
    pub area_px: usize,
    /// Their centroid, pixels; the origin if there are none.
    pub centroid_px: [f64; 2],
}

/// How many readings of a row lie within the window: most rows have none, and this is soon told.
pub(super) fn count(row: &[u16], window: &std::ops::RangeInclusive<u16>) -> usize {
    let (from, reach) = (*window.start(), window.end().saturating_sub(*window.start()));
    if window.is_empty() {
        return 0;
    }
    // Sums of 16 bits, 16 of them at a time, as the processor adds them.
    let inside = |counts: &u16| u16::from(counts.wrapping_sub(from) <= reach);
    row.chunks(usize::from(u16::MAX)).map(|part| usize::from(part.iter().map(inside).sum::<u16>())).sum()
}

/// Looks at one frame. O(pixels of the region).
pub fn presence(frame: &DepthFrame, params: &MaskParams) -> Presence {
    within(frame, params, &params.window(frame))
}

/// The same for readings within another window.
pub(super) fn within(
    frame: &DepthFrame,
    params: &MaskParams,
    window: &std::ops::RangeInclusive<u16>,
) -> Presence {
    let [x0, y0, x1, y1] = params.region(frame.width, frame.height);
    let (mut area, mut sum_x, mut sum_y) = (0, 0, 0);
    for y in y0..y1 {
        let row = &frame.depth[y * frame.width + x0..y * frame.width + x1];
        let in_row = count(row, window);
        if in_row == 0 {
            continue;
        }
        let places = row.iter().zip(x0 as u32..).filter(|(counts, _)| window.contains(counts));
        sum_x += places.map(|(_, x)| x as usize).sum::<usize>();
        area += in_row;
        sum_y += in_row * y;
    }
    let mean = |sum: usize| if area > 0 { sum as f64 / area as f64 } else { 0.0 };
    Presence { area_px: area, centroid_px: [mean(sum_x), mean(sum_y)] }
}

/// Whether each pixel of a frame lies within the depth window and the region of interest: row-major, 1 or 0.
/// O(pixels).
pub fn plane(frame: &DepthFrame, params: &MaskParams) -> Vec<u8> {
    let window = params.window(frame);
    let [x0, y0, x1, y1] = params.region(frame.width, frame.height);
    let mut plane = vec![0; frame.depth.len()];
    for row in (y0..y1).map(|y| y * frame.width + x0..y * frame.width + x1) {
        let pixels = plane[row.clone()].iter_mut().zip(&frame.depth[row]);
        pixels.for_each(|(inside, counts)| *inside = u8::from(window.contains(counts)));
    }
    plane
}
