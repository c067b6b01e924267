//! Outline → single blades: each with its tip, its two sides and the cut at its base.

use common::geometry::polyline;
use glam::Vec2;

use super::blob::{Blob, Field, MIN_BORDER_PX, distances};
use super::contour::Outline;
use super::mask::{Labels, Mask};
use super::overhang;
use crate::frame::{CameraModel, CameraPose};

/// How outlines are divided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartitionParams {
    /// A tip stands out from the gaps beside it by at least this much, pixels along the blade.
    pub min_persistence_px: f32,
    /// And by at least this share of the farthest tip's distance.
    pub min_persistence: f32,
    /// The camera, by which pixels are points in space.
    pub camera: CameraModel,
    /// How it stands against gravity.
    pub pose: CameraPose,
}

impl Default for PartitionParams {
    fn default() -> Self {
        let camera = CameraModel { fx: 570.0, fy: 570.0, cx: 319.5, cy: 239.5 };
        Self { min_persistence_px: 8.0, min_persistence: 0.08, camera, pose: CameraPose::default() }
    }
}

/// One side of a blade: a stretch of the outline from its base to its tip.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Side {
    /// Image pixels.
    pub points: Vec<Vec2>,
    /// Distance of each point from the root, within the blob, pixels.
    pub flow_px: Vec<f32>,
}

/// A single blade's outline.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// The blob's label in the mask.
    pub label: u16,
    /// The side that is left when the root is down.
    pub left: Side,
    /// The side that is right when the root is down.
    pub right: Side,
    /// Whether the blade was cut from others at its base; else its base is the blob's own end.
    pub cut: bool,
    /// Of a leaf that falls out of the region: where it comes out before what it grows on, image pixels. Its
    /// sides lead from the border to there.
    pub base: Option<Vec2>,
}

impl Part {
    /// Where the two sides meet.
    pub fn tip(&self) -> Vec2 {
        *self.left.points.last().expect("a side has points")
    }
}

/// Cosine of the widest angle between two blades of one base. One blade that sags is seen at a wider
/// one from its lowest place.
const FORKED: f32 = -0.2;

/// Divides one outline into blades.
///
/// The distance from the root flows along the outline: its maxima are tips and the minima between
/// them the gaps between blades. The root is where a hand grips the blob, else where it leaves the region, else its
/// lower end.
/// Returns the blades in clockwise order from the root. O(pixels of the blob).
///
/// # Source
/// Fan & Sheng §4.2. Departures: distance is measured within the blob from the root rather than
/// straight from the contour's centre, which finds the right number of blades only where the centre
/// is the hub; extrema count by their persistence; a blade is cut at its inner gap, straight across.
pub fn flow(mask: &Mask, labels: &Labels, outline: &Outline, params: &PartitionParams) -> Vec<Part> {
    let Some(points) = evenly(outline) else { return Vec::new() };
    let Some(blob) = Blob::of(mask, labels, outline.label) else { return Vec::new() };
    let Some(Rooted { field, walked, border }) = walk(mask, &blob, &points, params) else {
        return Vec::new();
    };
    let label = outline.label;
    let base = border.and_then(|border| overhang::base(mask, &blob, label, &border, &field, params));
    let Walk { points, flow, mut tips } = walked.unwrap_or_else(|| Walk::from_root(&points, &field, params));
    if base.is_some() {
        // What looks like tips are corners of where it comes out.
        tips = persistent_maxima(&flow, f32::INFINITY);
    }
    let mut gaps = vec![0];
    gaps.extend(tips.windows(2).map(|pair| argmin(&flow, pair[0]..pair[1])));
    gaps.push(flow.len() - 1);
    let blade = |(index, tip): (usize, &usize)| {
        let (before, after) = cut(&points, &flow, gaps[index], *tip, gaps[index + 1]);
        let side = |range: std::ops::RangeInclusive<usize>| Side {
            points: points[range.clone()].to_vec(),
            flow_px: flow[range].to_vec(),
        };
        let mut right = side(*tip..=after);
        right.points.reverse();
        right.flow_px.reverse();
        Part { label, left: side(before..=*tip), right, cut: tips.len() > 1, base }
    };
    tips.iter().enumerate().map(blade).collect()
}

/// Distance from its root to each pixel of the region behind an outline.
pub fn root_distance(mask: &Mask, labels: &Labels, outline: &Outline, params: &PartitionParams) -> Field {
    let blob = Blob::of(mask, labels, outline.label);
    let walked = evenly(outline).zip(blob).and_then(|(points, blob)| walk(mask, &blob, &points, params));
    walked.map_or_else(Field::default, |rooted| rooted.field)
}

/// The outline at points one pixel apart; `None` if it is too short to be a blade's.
fn evenly(outline: &Outline) -> Option<Vec<Vec2>> {
    let mut closed = outline.points.clone();
    closed.push(closed[0]);
    let cumulative = polyline::cumulative_length(&closed);
    let count = cumulative.last()?.round() as usize;
    if count < 12 {
        return None;
    }
    let mut points = polyline::resample_along(&closed, &cumulative, count + 1);
    points.pop();
    Some(points)
}

/// Where an outline has its root.
struct Rooted {
    /// Distances from there.
    field: Field,
    /// The walk from there, where the root is not told without it.
    walked: Option<Walk>,
    /// The pixels of the region's border that the root is taken to be.
    border: Option<Vec<usize>>,
}

fn walk(mask: &Mask, blob: &Blob, points: &[Vec2], params: &PartitionParams) -> Option<Rooted> {
    let at = |field: Field| Some(Rooted { field, walked: None, border: None });
    if mask.has_hand() {
        let grip = blob.beside(|index| mask.is_hand(index), mask.width);
        if grip.len() >= MIN_BORDER_PX {
            return at(blob.distance_from(&grip));
        }
    }
    let down = params.pose.down_in_image();
    if let Some(border) = blob.border(mask.region, down) {
        if let Some(nearest) = towards_stem(mask, blob, &border, down) {
            return at(blob.distance_from(&[nearest]));
        }
        let field = blob.distance_from(&border);
        return Some(Rooted { field, walked: None, border: Some(border) });
    }
    // The end of a single blade need not be its lowest pixel: it can sag between its ends. The ends
    // of a tuft are two of its tips: its root is what is lowest.
    let lowest = blob.lowest(down)?;
    let from_lowest = blob.distance_from(&[lowest]);
    let tuft = Walk::from_root(points, &from_lowest, params);
    // One blade has two ends, wherever its lowest pixel is: the rest need not be looked at.
    if tuft.tips.len() > 2 {
        return Some(Rooted { field: from_lowest, walked: Some(tuft), border: None });
    }
    let from_end = blob.distance_from_lower_end(lowest, &from_lowest, down);
    let single = Walk::from_root(points, &from_end, params);
    let is_tuft = single.tips.len() > 1 || tuft.is_forked();
    let (field, walked) = if is_tuft { (from_lowest, tuft) } else { (from_end, single) };
    Some(Rooted { field, walked: Some(walked), border: None })
}

/// Of a piece that leaves the region elsewhere than the blob that it is a part of: the pixel nearest to
/// where the blob does. `None` for all others.
fn towards_stem(mask: &Mask, piece: &Blob, border: &[usize], down: Vec2) -> Option<usize> {
    let label = mask.blobs.of[piece.in_image(*border.first()?, mask.width)];
    let whole = Blob::of(mask, &mask.blobs, label)?;
    let root = whole.border(mask.region, down)?;
    let of_root: Vec<usize> = root.iter().map(|index| whole.in_image(*index, mask.width)).collect();
    if border.iter().any(|index| of_root.contains(&piece.in_image(*index, mask.width))) {
        return None;
    }
    let distance = distances(&whole.body, whole.width, &root);
    let to_root = |index: usize| {
        let (x, y) = (piece.bounds[0] + index % piece.width, piece.bounds[1] + index / piece.width);
        let inside =
            x >= whole.bounds[0] && y >= whole.bounds[1] && x < whole.bounds[2] && y < whole.bounds[3];
        if inside { distance[(y - whole.bounds[1]) * whole.width + x - whole.bounds[0]] } else { u32::MAX }
    };
    let body = (0..piece.body.len()).filter(|index| piece.body[*index]);
    body.min_by_key(|index| to_root(*index)).filter(|index| to_root(*index) != u32::MAX)
}

/// Moves the outer of the two gaps of a blade to where the cut from the inner one is shortest.
fn cut(points: &[Vec2], flow: &[f32], before: usize, tip: usize, after: usize) -> (usize, usize) {
    let nearest = |to: usize, range: std::ops::Range<usize>| {
        range.min_by(|a, b| {
            points[*a].distance_squared(points[to]).total_cmp(&points[*b].distance_squared(points[to]))
        })
    };
    // A side keeps a few points whatever the cut.
    if flow[before] > flow[after] {
        (before, nearest(before, tip + 4..after + 1).unwrap_or(after))
    } else if flow[after] > flow[before] {
        (nearest(after, before..tip.saturating_sub(3)).unwrap_or(before), after)
    } else {
        (before, after)
    }
}

/// The first index of `range` with the smallest value.
fn argmin(values: &[f32], range: std::ops::Range<usize>) -> usize {
    let start = range.start;
    range.reduce(|best, index| if values[index] < values[best] { index } else { best }).unwrap_or(start)
}

/// Circular Gaussian smoothing, σ = 1.5 samples.
fn smoothed(values: &[f32]) -> Vec<f32> {
    const HALF: usize = 5;
    let weights: [f32; 2 * HALF + 1] = std::array::from_fn(|k| {
        let away = k as isize - HALF as isize;
        (-(away * away) as f32 / (2.0 * 1.5 * 1.5)).exp()
    });
    let total: f32 = weights.iter().sum();
    let n = values.len();
    let before = (0..HALF).map(|i| values[(i + (n - 1) * HALF) % n]);
    let after = (0..HALF).map(|i| values[i % n]);
    let around: Vec<f32> = before.chain(values.iter().copied()).chain(after).collect();
    let mean = |window: &[f32]| {
        window.iter().zip(weights).map(|(value, weight)| weight * value).sum::<f32>() / total
    };
    around.windows(weights.len()).map(mean).collect()
}

/// Maxima of a sequence that rise by at least `threshold` above the higher of the two passes that
/// lead from them to a higher maximum, in order. The highest is always among them.
///
/// # Source
/// Zero-dimensional persistence of a function on a line (Edelsbrunner et al. 2002).
fn persistent_maxima(values: &[f32], threshold: f32) -> Vec<usize> {
    const NONE: usize = usize::MAX;
    // The first of equal values counts as the higher one. Nothing begins or ends but at maxima and minima.
    let above = |a: usize, b: usize| values[a].total_cmp(&values[b]).then(b.cmp(&a)).is_gt();
    let last = values.len().saturating_sub(1);
    let turns: Vec<usize> = (0..values.len())
        .filter(|index| {
            let falls_before = *index == 0 || above(*index, index - 1);
            let falls_after = *index == last || above(*index, index + 1);
            falls_before == falls_after
        })
        .collect();
    let mut order: Vec<usize> = (0..turns.len()).collect();
    order.sort_unstable_by(|a, b| {
        let (a, b) = (turns[*a], turns[*b]);
        values[b].total_cmp(&values[a]).then(a.cmp(&b))
    });
    // parent[i]: towards the component's highest turn.
    let mut parent = vec![NONE; turns.len()];
    let find = |parent: &mut Vec<usize>, mut index: usize| {
        while parent[index] != index {
            parent[index] = parent[parent[index]];
            index = parent[index];
        }
        index
    };
    let mut maxima = Vec::new();
    for index in order {
        parent[index] = index;
        let left = (index > 0 && parent[index - 1] != NONE).then(|| find(&mut parent, index - 1));
        let right =
            (index + 1 < turns.len() && parent[index + 1] != NONE).then(|| find(&mut parent, index + 1));
        let value = |turn: usize| values[turns[turn]];
        match (left, right) {
            (Some(a), Some(b)) => {
                let (higher, lower) = if value(a) >= value(b) { (a, b) } else { (b, a) };
                if value(lower) - value(index) >= threshold {
                    maxima.push(turns[lower]);
                }
                parent[lower] = higher;
                parent[index] = higher;
            }
            (Some(only), None) | (None, Some(only)) => parent[index] = only,
            (None, None) => {}
        }
    }
    maxima
        .extend(values.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(&a.0))).map(|m| m.0));
    maxima.sort_unstable();
    maxima
}

/// An outline walked from its root and back to it.
struct Walk {
    points: Vec<Vec2>,
    /// Distance from the root, pixels.
    flow: Vec<f32>,
    /// Indices of the tips.
    tips: Vec<usize>,
}

impl Walk {
    fn from_root(outline: &[Vec2], field: &Field, params: &PartitionParams) -> Self {
        let mut points = outline.to_vec();
        let mut flow = smoothed(&points.iter().map(|point| field.at(*point)).collect::<Vec<_>>());
        let root = argmin(&flow, 0..flow.len());
        points.rotate_left(root);
        flow.rotate_left(root);
        // The root ends the walk as it began it.
        points.push(points[0]);
        flow.push(flow[0]);
        let farthest = flow.iter().copied().fold(0.0, f32::max);
        let threshold = params.min_persistence_px.max(params.min_persistence * farthest);
        let tips = persistent_maxima(&flow, threshold);
        Self { points, flow, tips }
    }

    /// Whether it has two tips and leads to them in directions too different for the sag of one blade.
    fn is_forked(&self) -> bool {
        const FAR_PX: f32 = 50.0;
        let [first, second] = self.tips[..] else { return false };
        let far = FAR_PX.min(0.5 * self.flow[first].min(self.flow[second]));
        let gap = argmin(&self.flow, first..second);
        if far < 12.0 || self.flow[gap] > 0.5 * far {
            // What they share first leads nowhere.
            return self.flow[gap] > 0.5 * far;
        }
        // The middle between the sides that run out to a tip and back.
        let towards = |out: std::ops::Range<usize>, back: std::ops::Range<usize>| {
            let reached = |index: &usize| self.flow[*index] >= far;
            let (out, back) = (out.into_iter().find(reached), back.rev().find(reached));
            Some(self.points[out?].midpoint(self.points[back?]) - self.points[0])
        };
        let left = towards(0..first, first..gap);
        let right = towards(gap..second, second..self.flow.len());
        let Some((left, right)) = left.zip(right) else { return false };
        left.normalize_or_zero().dot(right.normalize_or_zero()) > FORKED
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::contour;
    use crate::stages::mask::Region;

    #[test]
    fn maxima_count_by_their_persistence() {
        let values = [0.0, 5.0, 4.5, 9.0, 2.0, 7.0, 0.0];
        assert_eq!(persistent_maxima(&values, 1.0), [3, 5]);
        assert_eq!(persistent_maxima(&values, 0.4), [1, 3, 5]);
        assert_eq!(persistent_maxima(&values, 6.0), [3]);
        assert_eq!(persistent_maxima(&[1.0, 1.0, 1.0], 0.5), [0]);
    }

    /// A mask where `inside` holds, within 120×160 pixels.
    fn mask(inside: impl Fn(f32, f32) -> bool) -> Mask {
        let (width, height) = (120, 160);
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x as f32, y as f32)));
        let occupancy: Vec<f32> = pixels.map(|(x, y)| f32::from(u8::from(inside(x, y)))).collect();
        Mask {
            width,
            height,
            region: [0, 0, width, height],
            seen: [0, 0, width, height],
            frames: 1,
            depth_m: vec![0.5; occupancy.len()],
            hand: vec![false; occupancy.len()],
            unseen: vec![false; occupancy.len()],
            outside_m: Vec::new(),
            depth_noise_m: 0.0,
            blobs: one_region(&occupancy, width, height),
            pieces: one_region(&occupancy, width, height),
            occupancy,
        }
    }

    fn one_region(occupancy: &[f32], width: usize, height: usize) -> Labels {
        let region = Region { label: 1, area_px: 1, bounds: [0, 0, width, height] };
        Labels { of: occupancy.iter().map(|o| *o as u16).collect(), regions: vec![region] }
    }

    fn parts(inside: impl Fn(f32, f32) -> bool) -> Vec<Part> {
        let mask = mask(inside);
        let outlines = contour::trace(&mask, &mask.blobs);
        flow(&mask, &mask.blobs, &outlines[0], &PartitionParams::default())
    }

    /// Whether a pixel lies within a straight blade of half width 5 from (60, 150).
    fn stroke(x: f32, y: f32, to: Vec2) -> bool {
        let (from, point) = (Vec2::new(60.0, 150.0), Vec2::new(x, y));
        let t = ((point - from).dot(to - from) / (to - from).length_squared()).clamp(0.0, 1.0);
        point.distance(from.lerp(to, t)) < 5.0 * (1.0 - 0.7 * t)
    }

    #[test]
    fn a_single_blade_has_its_tip_up_and_its_left_side_left() {
        let parts = parts(|x, y| stroke(x, y, Vec2::new(70.0, 20.0)));
        let [part] = parts.as_slice() else { panic!("{} parts", parts.len()) };
        assert!(part.tip().distance(Vec2::new(70.0, 20.0)) < 4.0, "{}", part.tip());
        let mean = |side: &Side| side.points.iter().map(|p| p.x).sum::<f32>() / side.points.len() as f32;
        assert!(mean(&part.left) + 4.0 < mean(&part.right));
        assert!(!part.cut);
    }

    #[test]
    fn a_tuft_of_three_gives_three_tips() {
        let tips = [Vec2::new(15.0, 40.0), Vec2::new(60.0, 15.0), Vec2::new(105.0, 35.0)];
        let parts = parts(|x, y| tips.iter().any(|tip| stroke(x, y, *tip)));
        assert_eq!(parts.len(), 3);
        for (part, tip) in parts.iter().zip(tips) {
            assert!(part.tip().distance(tip) < 4.0, "{} is not {tip}", part.tip());
            assert!(part.cut);
        }
    }

    #[test]
    fn the_root_is_where_the_blob_leaves_the_region() {
        // A blade that comes in from above and hangs down.
        let parts = parts(|x, y| y < 100.0 && (x - 60.0).abs() < 5.0 * (1.0 - y / 110.0));
        let [part] = parts.as_slice() else { panic!("{} parts", parts.len()) };
        assert!(part.tip().y > 95.0);
        // With the root down the picture stands on its head: left is right.
        assert!(part.left.points[part.left.points.len() / 2].x > 60.0);
    }
}
