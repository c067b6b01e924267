//! Depth frames → what is held before the camera: occupancy and depth of each pixel, and the
//! connected blobs in it.

use std::ops::Range;

use super::accumulate::Accumulation;
use super::components::{self, Component};
use super::hand::{self, HandParams};
use crate::frame::DepthFrame;

/// What counts as held before the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct MaskParams {
    /// Nearest depth that counts, metres.
    pub near_m: f64,
    /// Farthest depth that counts, metres.
    pub far_m: f64,
    /// Region of interest `[x0, y0, x1, y1]`, pixels, half open; `None`: the whole image.
    pub roi: Option<[usize; 4]>,
    /// Smaller blobs are specks, pixels.
    pub min_area_px: usize,
    /// Longest gap without readings that is bridged inside a blade, pixels.
    pub bridge_px: usize,
}

impl Default for MaskParams {
    fn default() -> Self {
        Self { near_m: 0.3, far_m: 0.9, roi: None, min_area_px: 40, bridge_px: 4 }
    }
}

impl MaskParams {
    /// The region of interest within an image of that size: `[x0, y0, x1, y1]`, half open.
    pub fn region(&self, width: usize, height: usize) -> [usize; 4] {
        let [x0, y0, x1, y1] = self.roi.unwrap_or([0, 0, width, height]);
        let (x1, y1) = (x1.min(width), y1.min(height));
        [x0.min(x1), y0.min(y1), x1, y1]
    }

    /// The readings of `frame` that count: 1 for the nearest to `counts` for the farthest.
    pub(super) fn window(&self, frame: &DepthFrame) -> std::ops::RangeInclusive<u16> {
        let counts = |metres: f64| metres / frame.depth_unit_m;
        // `as` saturates; 0 is no reading and never counts.
        (counts(self.near_m).ceil() as u16).max(1)..=counts(self.far_m).floor() as u16
    }
}

/// Which region each pixel belongs to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Labels {
    /// Row-major like the mask; 0 for none.
    pub of: Vec<u16>,
    /// The regions.
    pub regions: Vec<Region>,
}

impl Labels {
    fn none(pixels: usize) -> Self {
        Self { of: vec![0; pixels], regions: Vec::new() }
    }

    /// Gives the pixels of each component the next label; components beyond the last label go.
    fn number(&mut self, components: &mut Vec<Component>, width: usize) {
        components.truncate(usize::from(u16::MAX));
        for (component, label) in components.iter().zip(1..) {
            let mut bounds = [usize::MAX, usize::MAX, 0, 0];
            for run in component.runs() {
                let (x, y) = (run.start % width, run.start / width);
                bounds = spanning(bounds, [x, y, x + run.len(), y + 1]);
                self.of[run].fill(label);
            }
            self.regions.push(Region { label, area_px: component.area_px(), bounds });
        }
    }

    /// Lets the regions grow into neighbours that are seldom occupied, from the pixels of theirs that have some.
    fn grow(
        &mut self,
        rims: Vec<usize>,
        width: usize,
        region: [usize; 4],
        occupancy: &[f32],
        depth_m: &[f32],
    ) {
        let mut front = rims;
        let mut next = 0;
        while next < front.len() {
            let index = front[next];
            next += 1;
            let label = self.of[index];
            for other in neighbours(index, width, region) {
                // Most are of a region; seldom occupied ones are by chance.
                if self.of[other] != 0 {
                    continue;
                }
                if is_seldom(occupancy[other]) && agree(depth_m[index], depth_m[other]) {
                    self.of[other] = label;
                    let (x, y) = (other % width, other / width);
                    let bounds = &mut self.regions[usize::from(label) - 1].bounds;
                    *bounds = spanning(*bounds, [x, y, x + 1, y + 1]);
                    front.push(other);
                }
            }
        }
    }
}

/// Lets blobs and pieces grow into neighbours that are seldom occupied.
fn grow_fringes(mask: &mut Mask) {
    let [of_blobs, of_pieces] = rims(mask);
    let Mask { width, seen, occupancy, depth_m, blobs, pieces, .. } = mask;
    blobs.grow(of_blobs, *width, *seen, occupancy, depth_m);
    pieces.grow(of_pieces, *width, *seen, occupancy, depth_m);
}

/// The pixels of blobs, and those of pieces, that have a neighbour that is seldom occupied, row by row.
fn rims(mask: &Mask) -> [Vec<usize>; 2] {
    let Mask { width, seen: [x0, y0, x1, y1], .. } = *mask;
    let columns = x1 - x0;
    // Whole rows are told several pixels at a time: whether they are seldom occupied in the row above, this one
    // and the one below; and whether any of the three is, with a margin to both sides that is not.
    let mut seldom = [(); 3].map(|()| vec![false; columns]);
    let mut upright = vec![false; columns + 2];
    let mut is_rim = vec![false; columns];
    let mut rims = [Vec::new(), Vec::new()];
    for y in y0..=y1 {
        // The row below is looked at as it comes, and none but `y1` has none.
        seldom.rotate_left(1);
        if y < y1 {
            let occupancy = &mask.occupancy[y * width + x0..y * width + x1];
            seldom[2].iter_mut().zip(occupancy).for_each(|(seldom, it)| *seldom = is_seldom(*it));
        } else {
            seldom[2].fill(false);
        }
        if y == y0 {
            continue;
        }
        let here = (y - 1) * width + x0;
        let [above, own, below] = &seldom;
        for (upright, ((a, b), c)) in upright[1..].iter_mut().zip(above.iter().zip(own).zip(below)) {
            *upright = a | b | c;
        }
        for (rims, labels) in rims.iter_mut().zip([&mask.blobs.of, &mask.pieces.of]) {
            let around = upright.iter().zip(&upright[1..]).zip(&upright[2..]);
            let labels = &labels[here..here + columns];
            for ((is_rim, label), ((left, middle), right)) in is_rim.iter_mut().zip(labels).zip(around) {
                *is_rim = (*label != 0) & (left | middle | right);
            }
            rims.extend(few(&is_rim).map(|column| here + column));
        }
    }
    rims
}

/// Whether a pixel can only be of a fringe.
fn is_seldom(occupancy: f32) -> bool {
    (FRINGE_OCCUPANCY..BODY_OCCUPANCY).contains(&occupancy)
}

/// Where something holds, ascending: fast where that is seldom.
pub(super) fn few(holds: &[bool]) -> impl Iterator<Item = usize> + '_ {
    const CHUNK: usize = 16;
    let chunks = holds.chunks(CHUNK).zip((0..).step_by(CHUNK));
    let some = chunks.filter(|(chunk, _)| chunk.iter().fold(false, |any, holds| any | holds));
    some.flat_map(|(chunk, start)| (start..).zip(chunk).filter_map(|(at, holds)| holds.then_some(at)))
}

/// The smallest bounding box of two, `[x0, y0, x1, y1]`, half open.
fn spanning(a: [usize; 4], b: [usize; 4]) -> [usize; 4] {
    [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
}

/// A connected region of the mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// Its value in [`Labels::of`], from 1.
    pub label: u16,
    /// Pixels that are occupied at least half of the time.
    pub area_px: usize,
    /// Bounding box `[x0, y0, x1, y1]` of all its pixels, half open.
    pub bounds: [usize; 4],
}

/// What is held before the camera. All images are row-major, `width × height`.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Region of interest, `[x0, y0, x1, y1]`, half open.
    pub region: [usize; 4],
    /// Bounding box of all that was ever within the window, `[x0, y0, x1, y1]`, half open.
    pub seen: [usize; 4],
    /// Frames behind it.
    pub frames: u32,
    /// Share of the frames in which the pixel was within the window, 0..=1; 1 where bridged.
    pub occupancy: Vec<f32>,
    /// Whether nothing could be seen there in most of the frames.
    pub unseen: Vec<bool>,
    /// Mean depth, metres; 0 where there is none.
    pub depth_m: Vec<f32>,
    /// What the first frame read outside of the window, metres; 0 within it and where there is no reading, or none
    /// at all where that is not known.
    pub outside_m: Vec<f32>,
    /// Noise of that mean, metres, one standard deviation.
    pub depth_noise_m: f32,
    /// The hand and forearm that hold the blades; they are in no region. Empty where there is none.
    pub hand: Vec<bool>,
    /// Connected regions, from the largest to the smallest.
    pub blobs: Labels,
    /// Parts of blobs without a step in depth.
    pub pieces: Labels,
}

impl Mask {
    /// The pixel that holds a point; `None` outside of the image.
    pub fn index_at(&self, point: glam::Vec2) -> Option<usize> {
        // Where it lies inside, the casts round down; those to signed numbers are the fastest.
        let (x, y) = (point.x + 0.5, point.y + 0.5);
        let [width, height] = [self.width, self.height].map(|size| size as i32 as f32);
        let inside = x >= 0.0 && y >= 0.0 && x < width && y < height;
        inside.then(|| y as i32 as usize * self.width + x as i32 as usize)
    }

    /// Whether a hand holds the blades.
    pub(super) fn has_hand(&self) -> bool {
        self.hand.contains(&true)
    }

    /// Whether a pixel is of a hand.
    pub(super) fn is_hand(&self, index: usize) -> bool {
        self.hand.get(index) == Some(&true)
    }

    /// The rows of the pixels within [`Self::seen`].
    pub(super) fn rows_seen(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let ([x0, y0, x1, y1], width) = (self.seen, self.width);
        (y0..y1).map(move |y| y * width + x0..y * width + x1)
    }

    /// The pixels within [`Self::seen`], row by row.
    pub(super) fn pixels_seen(&self) -> impl Iterator<Item = usize> + use<> {
        self.rows_seen().flatten()
    }

    /// The centre of a pixel.
    pub fn pixel(&self, index: usize) -> glam::Vec2 {
        glam::Vec2::new((index % self.width) as f32, (index / self.width) as f32)
    }
}

/// A pixel at least this often occupied is part of a blob's body.
pub(super) const BODY_OCCUPANCY: f32 = 0.5;
/// A pixel at least this often occupied can belong to a blob's fringe: a tip thinner than a pixel is
/// seen in a few frames only.
const FRINGE_OCCUPANCY: f32 = 0.1;

/// Finds the blobs in what was added up. O(pixels of the region).
///
/// Readings on both sides of a gap without readings agree when they differ by less than sensor noise
/// lets them ([`depth_step_m`]); such gaps of up to `bridge_px` are filled along rows, columns and
/// diagonals. Neighbours whose depths differ by more are not connected, so that one blade before
/// another is a blob of its own. No frames give an empty mask.
pub fn extract(accumulation: &Accumulation, params: &MaskParams) -> Mask {
    let (width, height) = (accumulation.width, accumulation.height);
    let frames = accumulation.frames.max(1) as f32;
    let half_of_them = (accumulation.frames.max(1) / 2) as u16;
    let unseen = accumulation.silent.iter().map(|silent| *silent > half_of_them).collect();
    let region = params.region(width, height);
    let mut mask = Mask {
        width,
        height,
        region,
        seen: accumulation.bounds(region),
        frames: accumulation.frames,
        occupancy: vec![0.0; width * height],
        unseen,
        depth_m: vec![0.0; width * height],
        outside_m: outside_m(accumulation, params),
        depth_noise_m: 0.0,
        hand: Vec::new(),
        blobs: Labels::none(width * height),
        pieces: Labels::none(width * height),
    };
    let shares: Vec<f32> = (0..=accumulation.frames.max(1)).map(|hits| hits as f32 / frames).collect();
    let means_m = accumulation.means_m();
    for row in mask.rows_seen() {
        for (index, hits) in row.clone().zip(&accumulation.hits[row]).filter(|(_, hits)| **hits > 0) {
            mask.occupancy[index] = shares[usize::from(*hits)];
            mask.depth_m[index] = accumulation.mean_m(index, &means_m);
        }
    }
    bridge_gaps(&mut mask, params.bridge_px);
    let mut bodies = label_bodies(&mut mask, params.min_area_px);
    mask.depth_noise_m = depth_noise_m(&mask);
    label_pieces(&mut mask, &bodies, accumulation);
    mask.hand = hand::find(&mask, accumulation.focal_px, &HandParams::default());
    if mask.has_hand() {
        mask.blobs = Labels::none(width * height);
        mask.pieces = Labels::none(width * height);
        bodies = label_bodies(&mut mask, params.min_area_px);
        label_pieces(&mut mask, &bodies, accumulation);
    }
    grow_fringes(&mut mask);
    mask
}

/// [`Mask::outside_m`].
fn outside_m(accumulation: &Accumulation, params: &MaskParams) -> Vec<f32> {
    let unit_m = accumulation.depth_unit_m;
    let outside = |counts: &u16| {
        let metres = f64::from(*counts) * unit_m;
        if (params.near_m..=params.far_m).contains(&metres) { 0.0 } else { metres as f32 }
    };
    accumulation.readings.iter().map(outside).collect()
}

/// Largest depth difference between neighbours of one surface at depth `z_m`, metres: noise grows
/// with the square of depth.
pub fn depth_step_m(z_m: f32) -> f32 {
    (0.030 * z_m * z_m).max(0.012)
}

fn agree(a: f32, b: f32) -> bool {
    (a - b).abs() <= depth_step_m(a.min(b))
}

fn bridge_gaps(mask: &mut Mask, longest: usize) {
    let [x0, y0, x1, y1] = mask.seen;
    let width = mask.width;
    let occupied = |index: usize| mask.occupancy[index] >= BODY_OCCUPANCY;
    let unseen = |index: usize| mask.unseen[index] && !occupied(index);
    let directions = [(1_isize, 0_isize), (0, 1), (1, 1), (-1, 1)];
    let onward = |start: usize, (dx, dy): (isize, isize), k: usize| {
        let (x, y) = ((start % width) as isize + dx * k as isize, (start / width) as isize + dy * k as isize);
        let inside = x >= x0 as isize && x < x1 as isize && y >= y0 as isize && y < y1 as isize;
        inside.then(|| y as usize * width + x as usize)
    };
    // Where a gap begins, for each direction.
    let mut starts: [Vec<usize>; 4] = Default::default();
    let mut begins = Vec::new();
    for row in mask.rows_seen() {
        begins.clear();
        begins.extend(mask.occupancy[row.clone()].iter().map(|occupancy| *occupancy >= BODY_OCCUPANCY));
        // What no gap can begin at is told several pixels at a time.
        let below = mask.unseen.get(row.start + width - 1..row.end + width + 1);
        if let Some((right, below)) = mask.unseen.get(row.start + 1..row.end + 1).zip(below) {
            let below = below.iter().zip(&below[1..]).zip(&below[2..]);
            for ((begins, right), ((a, b), c)) in begins.iter_mut().zip(right).zip(below) {
                *begins &= right | a | b | c;
            }
        }
        for start in few(&begins).map(|column| row.start + column) {
            for (direction, starts) in directions.into_iter().zip(&mut starts) {
                let next = start.wrapping_add_signed(direction.0 + direction.1 * width as isize);
                if mask.unseen.get(next) == Some(&true) {
                    starts.push(start);
                }
            }
        }
    }
    let mut filled = Vec::new();
    for (direction, starts) in directions.into_iter().zip(starts) {
        for start in starts {
            let step = |k: usize| onward(start, direction, k);
            let gap = (1..=longest).take_while(|k| step(*k).is_some_and(unseen)).count();
            let Some(end) = step(gap + 1).filter(|end| gap > 0 && occupied(*end)) else { continue };
            let (near, far) = (mask.depth_m[start], mask.depth_m[end]);
            if agree(near, far) {
                let at = |k: usize| near + (far - near) * k as f32 / (gap + 1) as f32;
                filled.extend((1..=gap).filter_map(|k| Some((step(k)?, at(k)))));
            }
        }
    }
    for (index, depth) in filled {
        mask.occupancy[index] = 1.0;
        mask.depth_m[index] = depth;
    }
}

/// The up to eight neighbours of a pixel that lie within a region, row by row.
pub(super) fn neighbours(index: usize, width: usize, region: [usize; 4]) -> impl Iterator<Item = usize> {
    let [x0, y0, x1, y1] = region;
    // 32 bits divide faster.
    let (x, y) = ((index as u32 % width as u32) as usize, (index as u32 / width as u32) as usize);
    let (mut found, mut count) = ([0; 8], 0);
    if x > x0 && y > y0 && x + 1 < x1 && y + 1 < y1 {
        let (above, below) = (index - width, index + width);
        found = [above - 1, above, above + 1, index - 1, index + 1, below - 1, below, below + 1];
        count = 8;
    } else {
        for v in y.saturating_sub(1).max(y0)..(y + 2).min(y1) {
            for u in x.saturating_sub(1).max(x0)..(x + 2).min(x1) {
                if (u, v) != (x, y) {
                    found[count] = v * width + u;
                    count += 1;
                }
            }
        }
    }
    found.into_iter().take(count)
}

fn label_bodies(mask: &mut Mask, min_area_px: usize) -> Vec<Component> {
    let body = |index: usize| mask.occupancy[index] >= BODY_OCCUPANCY && !mask.is_hand(index);
    let surface = |a: usize, b: usize| agree(mask.depth_m[a], mask.depth_m[b]);
    let mut found = components::find(mask, body, surface);
    found.retain(|component| component.area_px() >= min_area_px);
    // In the order of their first pixels they are already.
    found.sort_by_key(|component| std::cmp::Reverse(component.area_px()));
    // Knuckles stand out from the hand, but not far.
    if mask.has_hand() {
        let from_hand = hand::chamfer(mask, |index| mask.is_hand(index));
        found.retain(|component| {
            let far = component.pixels().map(|index| from_hand[index]).max().unwrap_or(0);
            let near = component.pixels().map(|index| from_hand[index]).min().unwrap_or(u32::MAX);
            near > 48 || far > 12 * 28
        });
    }
    mask.blobs.number(&mut found, mask.width);
    found
}

/// Noise of the mean depth, metres: from the bend of depth over three neighbouring pixels, whose
/// variance is 1.5 times that of one pixel. A surface's own curvature is far smaller.
fn depth_noise_m(mask: &Mask) -> f32 {
    // The bits of numbers that are not negative rise with them, and are the faster to compare.
    let mut bends: Vec<u32> = Vec::new();
    for row in mask.rows_seen() {
        let labels = mask.blobs.of[row.clone()].windows(3);
        let alike = labels
            .zip(mask.depth_m[row].windows(3))
            .filter(|(of, _)| of[1] != 0 && of[0] == of[1] && of[1] == of[2]);
        bends.extend(alike.map(|(_, depth)| (depth[1] - 0.5 * (depth[0] + depth[2])).abs().to_bits()));
    }
    if bends.is_empty() {
        return 0.0;
    }
    let middle = bends.len() / 2;
    let (_, median, _) = bends.select_nth_unstable(middle);
    f32::from_bits(*median) / 0.6745 / 1.5_f32.sqrt()
}

/// Smallest step in depth that divides a blob, metres.
pub fn fine_step_m(noise_m: f32) -> f32 {
    (6.0 * noise_m).clamp(0.0025, 0.012)
}

/// Pieces smaller than this are the crumbs of an edge, pixels.
const MIN_PIECE_PX: usize = 24;

fn label_pieces(mask: &mut Mask, bodies: &[Component], accumulation: &Accumulation) {
    let step = fine_step_m(mask.depth_noise_m);
    // A pixel that showed one surface in some frames and another in others has a mean between both.
    // It is farther from its mean than this many times what pixels mostly are.
    const MOST: f32 = 2.2;
    let on_blob = || bodies.iter().flat_map(Component::runs);
    let variances: Vec<f32> = on_blob().flatten().map(|index| accumulation.variance(index)).collect();
    // As in `depth_noise_m`.
    let above_none = variances.iter().filter(|variance| **variance > 0.0);
    let mut typical: Vec<u32> = above_none.map(|variance| variance.to_bits()).collect();
    let middle = typical.len() / 2;
    let limit = if mask.frames >= 4 && !typical.is_empty() {
        MOST * MOST * f32::from_bits(*typical.select_nth_unstable(middle).1)
    } else {
        f32::INFINITY
    };
    let clean_end = mask.seen[3] * mask.width;
    let mut clean = vec![false; clean_end];
    // What lies beside a step is of no piece, so that outlines run along steps that end within a piece. In
    // a single frame noise and folds make slighter ones too.
    const SURE: f32 = 3.0;
    let sure = if mask.frames < 4 { SURE * step } else { step };
    let level = |index: usize, next: usize| {
        let apart = next >= clean_end || mask.blobs.of[next] != mask.blobs.of[index];
        apart || (mask.depth_m[index] - mask.depth_m[next]).abs() <= sure
    };
    let mut variances = variances.iter();
    for run in on_blob() {
        for (index, variance) in run.zip(&mut variances) {
            clean[index] = *variance <= limit && level(index, index + 1) && level(index, index + mask.width);
        }
    }
    let clean = |index: usize| clean[index];
    let same = |a: usize, b: usize| {
        mask.blobs.of[a] == mask.blobs.of[b] && (mask.depth_m[a] - mask.depth_m[b]).abs() <= step
    };
    let mut found = components::find(mask, clean, same);
    found.retain(|component| component.area_px() >= MIN_PIECE_PX);
    mask.pieces.number(&mut found, mask.width);
}

#[cfg(test)]
mod tests;
