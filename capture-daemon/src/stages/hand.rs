//! The hand and forearm that hold the blades: told from them by their thickness and by their way to
//! the border of the picture.

use super::mask::Mask;

/// What is a hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandParams {
    /// Half of the width, metres, that a hand and its forearm have at least and a leaf has not.
    pub min_radius_m: f32,
    /// How far fingers stand out from what is that thick, metres.
    pub finger_m: f32,
    /// Width, metres, that a forearm has at least where it leaves the picture.
    pub min_border_m: f32,
}

impl Default for HandParams {
    fn default() -> Self {
        Self { min_radius_m: 0.021, finger_m: 0.010, min_border_m: 0.025 }
    }
}

/// Finds the pixels of hands: those near to where what is seen is thick, where that reaches the
/// border of the region. `body`: whether a pixel is of the piece that is looked at. All `false` where
/// there is no hand. O(pixels).
pub(super) fn find(
    mask: &Mask,
    body: impl Fn(usize) -> bool,
    focal_px: f32,
    params: &HandParams,
) -> Vec<bool> {
    let [x0, y0, x1, y1] = mask.region;
    let none = vec![false; mask.depth_m.len()];
    let px_per_m = |index: usize| focal_px / mask.depth_m[index].max(0.1);
    let inside = |index: usize| {
        let (x, y) = (index % mask.width, index / mask.width);
        (x0..x1).contains(&x) && (y0..y1).contains(&y)
    };
    // What is thick goes on beyond the border as far as we know.
    let depth_in = chamfer(mask, |index| inside(index) && !body(index));
    let thick = |index: usize| {
        inside(index) && body(index) && depth_in[index] as f32 >= 12.0 * params.min_radius_m * px_per_m(index)
    };
    if !(0..none.len()).any(thick) {
        return none;
    }
    let from_core = chamfer(mask, thick);
    let reach = |index: usize| {
        inside(index)
            && body(index)
            && from_core[index] as f32 <= 12.0 * params.min_radius_m * px_per_m(index)
    };
    // Each connected part of what is thick has to reach the border by itself.
    let mut hand = none.clone();
    let mut seen = none;
    for start in 0..hand.len() {
        if seen[start] || !reach(start) {
            continue;
        }
        seen[start] = true;
        let mut part = vec![start];
        let mut next = 0;
        let mut border_m = 0.0;
        while next < part.len() {
            let index = part[next];
            next += 1;
            let (x, y) = (index % mask.width, index / mask.width);
            if x == x0 || y == y0 || x + 1 == x1 || y + 1 == y1 {
                border_m += 1.0 / px_per_m(index);
            }
            for v in y.saturating_sub(1)..(y + 2).min(mask.height) {
                for u in x.saturating_sub(1)..(x + 2).min(mask.width) {
                    let other = v * mask.width + u;
                    if !seen[other] && reach(other) {
                        seen[other] = true;
                        part.push(other);
                    }
                }
            }
        }
        if border_m >= params.min_border_m {
            part.into_iter().for_each(|index| hand[index] = true);
        }
    }
    if !hand.contains(&true) {
        return hand;
    }
    let from_hand = chamfer(mask, |index| hand[index]);
    (0..hand.len())
        .map(|index| {
            inside(index)
                && body(index)
                && from_hand[index] as f32 <= 12.0 * params.finger_m * px_per_m(index)
        })
        .collect()
}

/// Distance of each pixel to the nearest one that is a `seed`, twelfths of a pixel (12 straight, 17
/// diagonal), in two passes.
pub(super) fn chamfer(mask: &Mask, seed: impl Fn(usize) -> bool) -> Vec<u32> {
    const FAR: u32 = u32::MAX / 2;
    let (width, height) = (mask.width, mask.height);
    let mut distance: Vec<u32> = (0..width * height).map(|index| if seed(index) { 0 } else { FAR }).collect();
    for y in 0..height {
        for x in 0..width {
            let index = y * width + x;
            let mut best = distance[index];
            if x > 0 {
                best = best.min(distance[index - 1] + 12);
            }
            if y > 0 {
                best = best.min(distance[index - width] + 12);
                if x > 0 {
                    best = best.min(distance[index - width - 1] + 17);
                }
                if x + 1 < width {
                    best = best.min(distance[index - width + 1] + 17);
                }
            }
            distance[index] = best;
        }
    }
    for y in (0..height).rev() {
        for x in (0..width).rev() {
            let index = y * width + x;
            let mut best = distance[index];
            if x + 1 < width {
                best = best.min(distance[index + 1] + 12);
            }
            if y + 1 < height {
                best = best.min(distance[index + width] + 12);
                if x + 1 < width {
                    best = best.min(distance[index + width + 1] + 17);
                }
                if x > 0 {
                    best = best.min(distance[index + width - 1] + 17);
                }
            }
            distance[index] = best;
        }
    }
    distance
}
