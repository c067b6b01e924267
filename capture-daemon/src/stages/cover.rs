//! Parts → which part each pixel is of. Nothing of a capture needs it: pictures and laws do.

use glam::Vec2;

use super::mask::{Mask, neighbours};
use super::partition::Part;

/// The part of each pixel, row-major like the mask: its index in `parts` and 1 more, 0 for none.
///
/// What lies between the sides of a part is of it. Cuts leave out what blades share at their base, and edges
/// and crumbs are of no part: these go to the part that is the fewest steps away, within their piece as far as
/// it has one, else within their blob. So every pixel of a blob that has a part is of exactly one.
/// O(pixels seen + parts · their area).
pub fn cover(mask: &Mask, parts: &[Part]) -> Vec<u32> {
    let mut of = vec![0; mask.depth_m.len()];
    let mut front = Vec::new();
    for (part, number) in parts.iter().zip(1..) {
        let mut take = |index: usize| {
            if mask.pieces.of[index] == part.label && of[index] == 0 {
                of[index] = number;
                front.push(index);
            }
        };
        let outline: Vec<Vec2> =
            part.left.points.iter().chain(part.right.points.iter().rev()).copied().collect();
        between(mask, &outline, &mut take);
        // Of a part thinner than a pixel no pixel's centre lies between its sides.
        outline.iter().filter_map(|point| mask.index_at(*point)).for_each(take);
    }
    front.sort_unstable();
    for labels in [&mask.pieces.of, &mask.blobs.of] {
        let mut next = 0;
        while next < front.len() {
            let index = front[next];
            next += 1;
            for other in neighbours(index, mask.width, mask.seen) {
                if of[other] == 0 && labels[other] != 0 && labels[other] == labels[index] {
                    of[other] = of[index];
                    front.push(other);
                }
            }
        }
    }
    of
}

/// Every pixel whose centre lies within a polygon, by the even–odd rule.
fn between(mask: &Mask, outline: &[Vec2], mut take: impl FnMut(usize)) {
    let rows = outline.iter().fold([f32::MAX, f32::MIN], |[low, high], p| [low.min(p.y), high.max(p.y)]);
    // The casts saturate.
    let rows = rows[0].ceil() as usize..(rows[1].floor().max(-1.0) + 1.0) as usize;
    for y in rows.start..rows.end.min(mask.height) {
        let row = y as f32;
        let edges = outline.iter().zip(outline.iter().cycle().skip(1));
        let crossed = edges.filter(|(a, b)| (a.y > row) != (b.y > row));
        let mut crossings: Vec<f32> =
            crossed.map(|(a, b)| a.x + (b.x - a.x) * (row - a.y) / (b.y - a.y)).collect();
        crossings.sort_unstable_by(f32::total_cmp);
        for pair in crossings.chunks_exact(2) {
            let (first, end) =
                (pair[0].ceil().max(0.0) as usize, (pair[1].ceil().max(0.0) as usize).min(mask.width));
            (first..end).for_each(|x| take(y * mask.width + x));
        }
    }
}
