//! Pieces that fall out of the region in front of what they grow on: leaves, whose border is not their root.

use glam::{Vec2, Vec3};

use super::blob::{Blob, Field};
use super::mask::{Mask, fine_step_m};
use super::partition::PartitionParams;
use super::ribbon::{Section, reverse};
use super::section::Expected;

/// What stands is steeper than this: cosine of its angle to the upright.
const UPRIGHT: f32 = 0.77;
/// From this share of its length on a piece is near its end.
const END: f32 = 0.7;
/// An end narrower than this share of the whole piece is a tip.
const TIP: f32 = 0.6;
/// Share of a piece's width along which others must be seen behind its end.
const BEFORE: f32 = 0.5;
/// An edge is smeared over no more than this, pixels.
const SMEAR_PX: usize = 6;
/// What the way to the base counts beside an edge that is seen.
const WEIGHT: f32 = 0.05;

/// The base of a leaf that falls out of the region in front of the plant that it grows on: the middle of
/// where `piece`, whose label that is, comes out before others, image pixels. `None` for what comes in
/// from the border: for what is upright, ends in a tip or before nothing, or before what comes in from there
/// itself. `border`: where it leaves the region; `field`: distances from there. O(pixels of the piece).
///
/// # Source
/// Ours: a stem stands, and is not what hides where its leaves begin.
pub(super) fn base(
    mask: &Mask,
    piece: &Blob,
    label: u16,
    border: &[usize],
    field: &Field,
    params: &PartitionParams,
) -> Option<Vec2> {
    let in_image = |index: usize| piece.in_image(index, mask.width);
    let body: Vec<usize> = (0..piece.body.len()).filter(|index| piece.body[*index]).collect();
    let far = |index: usize| field.of_pixel(index);
    let length_px = body.iter().map(|index| far(*index)).filter(|far| far.is_finite()).fold(0.0, f32::max);
    let end: Vec<usize> = body.iter().copied().filter(|index| far(*index) > END * length_px).collect();
    if (end.len() as f32) < TIP * (1.0 - END) * body.len() as f32 {
        return None;
    }
    let middle = |pixels: &[usize]| {
        let point = |index: &usize| {
            let Vec2 { x, y } = mask.pixel(in_image(*index));
            params.camera.deproject(x.into(), y.into(), mask.depth_m[in_image(*index)].into())
        };
        pixels.iter().map(point).sum::<Vec3>() / pixels.len().max(1) as f32
    };
    let way = middle(&end) - middle(border);
    let up = params.pose.blade_from_camera().transpose() * Vec3::Y;
    if way.normalize_or_zero().dot(up).abs() > UPRIGHT {
        return None;
    }
    let behind_m = 3.0 * fine_step_m(mask.depth_noise_m)..way.length();
    let mut blobs: Vec<u16> = Vec::new();
    let mut is_before = |index: &&usize| {
        let at = in_image(**index);
        let around =
            |middle: usize, size: usize| middle.saturating_sub(SMEAR_PX)..(middle + SMEAR_PX + 1).min(size);
        let (columns, rows) = (around(at % mask.width, mask.width), around(at / mask.width, mask.height));
        let near = rows.flat_map(|v| columns.clone().map(move |u| v * mask.width + u));
        let other = |near: &usize| {
            let other = mask.pieces.of[*near] != 0 && mask.pieces.of[*near] != label;
            other && behind_m.contains(&(mask.depth_m[*near] - mask.depth_m[at]))
        };
        let found = near.into_iter().find(other);
        blobs.extend(found.map(|near| mask.blobs.of[near]));
        found.is_some()
    };
    let before: Vec<usize> =
        end.iter().filter(|index| piece.is_rim(**index)).filter(&mut is_before).copied().collect();
    let width_px = body.len() as f32 / length_px.max(1.0);
    if (before.len() as f32) < BEFORE * width_px {
        return None;
    }
    blobs.sort_unstable();
    blobs.dedup();
    let leaves_region = |label: &u16| {
        let region = mask.blobs.regions.iter().find(|region| region.label == *label);
        let [x0, y0, x1, y1] = mask.region;
        region.is_none_or(|region| {
            let [u0, v0, u1, v1] = region.bounds;
            u0 <= x0 || v0 <= y0 || u1 >= x1 || v1 >= y1
        })
    };
    let middle = before.iter().map(|index| mask.pixel(in_image(*index))).sum::<Vec2>() / before.len() as f32;
    (!blobs.iter().any(leaves_region)).then_some(middle)
}

/// Sections of a leaf from the border to its base → from its base to the border: as far as they run along it,
/// and led on from there, for beside the base they turn into its corners.
pub(super) fn turned(mask: &Mask, mut sections: Vec<Section>, base: Vec2) -> Vec<Section> {
    const APART: usize = 4;
    /// Turn over half of the width, radians ([`super::margin::Margins::turning`]).
    const TIGHT: f32 = 0.2;
    let leans = |i: usize| {
        let (from, to) = (&sections[i.saturating_sub(APART)].expected, &sections[i].expected);
        let near = to.mid.distance(base) < to.half_px;
        near || from.across.angle_to(to.across).abs() / APART as f32 * from.half_px > TIGHT
    };
    let sound = (sections.len() / 3..sections.len()).find(|i| leans(*i)).unwrap_or(sections.len());
    sections.truncate(sound);
    reverse(&mut sections);
    let Some(first) = sections.first().copied() else { return sections };
    let depth_m = mask.index_at(base).map(|index| mask.depth_m[index]).filter(|depth_m| *depth_m > 0.0);
    let base_m = depth_m.unwrap_or(first.expected.depth_m);
    let gap = first.expected.mid - base;
    let steps = gap.length().ceil() as usize;
    let across = Vec2::new(-gap.y, gap.x).normalize_or(first.expected.across);
    let label = mask.index_at(first.expected.mid).map_or(0, |index| mask.pieces.of[index]);
    let mut led: Vec<Section> = (0..steps)
        .map(|k| {
            let t = k as f32 / steps as f32;
            let straight = base + gap * t;
            let depth_m = base_m + (first.expected.depth_m - base_m) * t;
            // It leaves the base somewhere, and is seen from there on.
            let seen = extent(mask, label, straight, across, 1.5 * first.expected.half_px);
            let seen_px = seen.map_or(f32::INFINITY, |[from, to]| 0.5 * (to - from));
            let aside = seen.map_or(0.0, |[from, to]| 0.5 * (from + to));
            let expected = Expected {
                mid: straight + across * if k == 0 { 0.0 } else { aside },
                across,
                depth_m,
                half_px: first.expected.half_px.min(seen_px),
                ..first.expected
            };
            let anchor = if k == 0 { 1.0 } else { WEIGHT };
            Section::led(mask, expected, anchor)
        })
        .collect();
    led.append(&mut sections);
    led
}

/// From a point to the outermost pixels of a piece to both sides of it, pixels along `across`, as far as `reach_px`;
/// `None` where it is not there.
fn extent(mask: &Mask, label: u16, point: Vec2, across: Vec2, reach_px: f32) -> Option<[f32; 2]> {
    let reach = reach_px as i32;
    let of_it = |t: &i32| {
        let index = mask.index_at(point + across * *t as f32);
        index.is_some_and(|index| label != 0 && mask.pieces.of[index] == label)
    };
    let (first, last) = ((-reach..=reach).find(of_it)?, (-reach..=reach).rev().find(of_it)?);
    Some([first as f32 - 0.5, last as f32 + 0.5])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::drawn::{mask_of, section_along_row};

    #[test]
    fn the_way_to_the_base_is_as_wide_as_what_is_seen_there() {
        // Narrow down to row 60, and a little to the right there; broad from there on.
        let on_leaf = |x: i32, y: i32| {
            let (middle, half) = if y < 60 { (42, 4) } else { (40, 12) };
            y >= 20 && (x - middle).abs() <= half
        };
        let mask = mask_of((80, 120), |x, y| if on_leaf(x, y) { 0.5 } else { 1.5 });
        let section = |y: i32| section_along_row(&mask, Vec2::new(40.0, y as f32), 12.5);
        let seen: Vec<Section> = (66..119).rev().map(section).collect();
        let sections = turned(&mask, seen, Vec2::new(40.0, 22.0));
        let led = sections.iter().filter(|section| (26.0..54.0).contains(&section.expected.mid.y));
        let led: Vec<&Expected> = led.map(|section| &section.expected).collect();
        assert!(led.len() > 20, "{} sections", led.len());
        for expected in led {
            let off = [(expected.half_px - 4.5).abs(), (expected.mid.x - 42.0).abs()];
            assert!(off.iter().all(|off| *off < 1.0), "off by {off:?} px at {}", expected.mid);
        }
    }
}
