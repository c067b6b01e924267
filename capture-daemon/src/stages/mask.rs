//! Depth frames → what is held before the camera: occupancy and depth of each pixel, and the
//! connected blobs in it.

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
        Self { near_m: 0.3, far_m: 0.9, roi: None, min_area_px: 60, bridge_px: 4 }
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
    fn window(&self, frame: &DepthFrame) -> std::ops::RangeInclusive<u16> {
        let counts = |metres: f64| metres / frame.depth_unit_m;
        // `as` saturates; 0 is no reading and never counts.
        (counts(self.near_m).ceil() as u16).max(1)..=counts(self.far_m).floor() as u16
    }
}

/// What one frame shows, in short: enough for the station to tell whether something is there and
/// whether it stands still.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Presence {
    /// Pixels within the depth window.
    pub area_px: usize,
    /// Their centroid, pixels; the origin if there are none.
    pub centroid_px: [f64; 2],
}

/// Looks at one frame. O(pixels of the region).
pub fn presence(frame: &DepthFrame, params: &MaskParams) -> Presence {
    let window = params.window(frame);
    let [x0, y0, x1, y1] = params.region(frame.width, frame.height);
    let (mut area, mut sum_x, mut sum_y) = (0, 0, 0);
    for y in y0..y1 {
        let row = &frame.depth[y * frame.width + x0..y * frame.width + x1];
        let (mut in_row, mut row_x) = (0, 0);
        for (x, counts) in row.iter().enumerate() {
            let inside = usize::from(window.contains(counts));
            in_row += inside;
            row_x += inside * x;
        }
        area += in_row;
        sum_x += row_x + in_row * x0;
        sum_y += in_row * y;
    }
    let mean = |sum: usize| if area > 0 { sum as f64 / area as f64 } else { 0.0 };
    Presence { area_px: area, centroid_px: [mean(sum_x), mean(sum_y)] }
}

/// Frames added up while what is held stands still.
#[derive(Clone, Debug, PartialEq)]
pub struct Accumulation {
    width: usize,
    height: usize,
    frames: u32,
    /// Frames in which the pixel was within the window.
    hits: Vec<u16>,
    /// Frames in which the pixel had no reading.
    silent: Vec<u16>,
    /// Sum of the depths within the window, metres.
    depth_sum_m: Vec<f32>,
}

impl Accumulation {
    /// Nothing yet, for frames of the size of `frame`.
    pub fn like(frame: &DepthFrame) -> Self {
        let pixels = frame.width * frame.height;
        Self {
            width: frame.width,
            height: frame.height,
            frames: 0,
            hits: vec![0; pixels],
            silent: vec![0; pixels],
            depth_sum_m: vec![0.0; pixels],
        }
    }

    /// Forgets all frames but keeps the memory.
    pub fn clear(&mut self) {
        self.frames = 0;
        self.hits.fill(0);
        self.silent.fill(0);
        self.depth_sum_m.fill(0.0);
    }

    /// Whether `frame` has the size of the frames before it.
    pub fn fits(&self, frame: &DepthFrame) -> bool {
        (self.width, self.height) == (frame.width, frame.height)
    }

    /// Frames added so far.
    pub fn frames(&self) -> u32 {
        self.frames
    }

    /// Adds a frame of the same size. After 65,535 frames further ones are left out. O(pixels of the
    /// region).
    pub fn add(&mut self, frame: &DepthFrame, params: &MaskParams) {
        if self.frames == u32::from(u16::MAX) {
            return;
        }
        self.frames += 1;
        let window = params.window(frame);
        let unit = frame.depth_unit_m as f32;
        let [x0, y0, x1, y1] = params.region(self.width, self.height);
        for y in y0..y1 {
            let row = y * self.width + x0..y * self.width + x1;
            let counters = self.hits[row.clone()].iter_mut().zip(&mut self.silent[row.clone()]);
            let sums = self.depth_sum_m[row.clone()].iter_mut();
            for ((counts, (hits, silent)), sum) in frame.depth[row].iter().zip(counters).zip(sums) {
                if window.contains(counts) {
                    *hits += 1;
                    *sum += f32::from(*counts) * unit;
                } else if *counts == 0 {
                    *silent += 1;
                }
            }
        }
    }
}

/// A connected region of the mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blob {
    /// Its value in [`Mask::labels`], from 1.
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
    /// Frames behind it.
    pub frames: u32,
    /// Share of the frames in which the pixel was within the window, 0..=1; 1 where bridged.
    pub occupancy: Vec<f32>,
    /// Mean depth, metres; 0 where there is none.
    pub depth_m: Vec<f32>,
    /// The blob that the pixel belongs to; 0 for none.
    pub labels: Vec<u16>,
    /// The blobs, from the largest to the smallest.
    pub blobs: Vec<Blob>,
}

impl Mask {
    /// Occupancy of blob `label` at a point between pixel centres, bilinear; 0 outside of the image
    /// and on other blobs.
    pub fn occupancy_at(&self, label: u16, point: glam::Vec2) -> f32 {
        let (x0, y0) = (point.x.floor(), point.y.floor());
        let (fx, fy) = (point.x - x0, point.y - y0);
        let at = |x: f32, y: f32| {
            let inside = x >= 0.0 && y >= 0.0 && x < self.width as f32 && y < self.height as f32;
            let index = if inside { y as usize * self.width + x as usize } else { return 0.0 };
            if self.labels[index] == label { self.occupancy[index] } else { 0.0 }
        };
        let upper = at(x0, y0) * (1.0 - fx) + at(x0 + 1.0, y0) * fx;
        let lower = at(x0, y0 + 1.0) * (1.0 - fx) + at(x0 + 1.0, y0 + 1.0) * fx;
        upper * (1.0 - fy) + lower * fy
    }
}

/// A pixel at least this often occupied is part of a blob's body.
const BODY_OCCUPANCY: f32 = 0.5;
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
    let occupancy: Vec<f32> = accumulation.hits.iter().map(|hits| f32::from(*hits) / frames).collect();
    let mean = |(sum, hits): (&f32, &u16)| if *hits > 0 { sum / f32::from(*hits) } else { 0.0 };
    let depth_m = accumulation.depth_sum_m.iter().zip(&accumulation.hits).map(mean).collect();
    let mut mask = Mask {
        width,
        height,
        region: params.region(width, height),
        frames: accumulation.frames,
        occupancy,
        depth_m,
        labels: vec![0; width * height],
        blobs: Vec::new(),
    };
    bridge_gaps(&mut mask, &accumulation.silent, params.bridge_px);
    label_bodies(&mut mask, params.min_area_px);
    grow_fringes(&mut mask);
    mask
}

/// Largest depth difference between neighbours of one surface at depth `z_m`, metres: noise grows
/// with the square of depth.
pub fn depth_step_m(z_m: f32) -> f32 {
    (0.030 * z_m * z_m).max(0.012)
}

fn agree(a: f32, b: f32) -> bool {
    (a - b).abs() <= depth_step_m(a.min(b))
}

fn bridge_gaps(mask: &mut Mask, silent: &[u16], longest: usize) {
    let [x0, y0, x1, y1] = mask.region;
    let (width, frames) = (mask.width, mask.frames as f32);
    let occupied = |index: usize| mask.occupancy[index] >= BODY_OCCUPANCY;
    // Silent in so many frames that it cannot be seen whether something is there.
    let unseen = |index: usize| f32::from(silent[index]) > 0.5 * frames && !occupied(index);
    let mut filled = Vec::new();
    for (dx, dy) in [(1_isize, 0_isize), (0, 1), (1, 1), (-1, 1)] {
        for y in y0..y1 {
            for x in x0..x1 {
                let start = y * width + x;
                if !occupied(start) {
                    continue;
                }
                let step = |k: usize| {
                    let (u, v) = (x as isize + dx * k as isize, y as isize + dy * k as isize);
                    let inside = u >= x0 as isize && u < x1 as isize && v >= y0 as isize && v < y1 as isize;
                    inside.then(|| v as usize * width + u as usize)
                };
                let gap = (1..=longest).take_while(|k| step(*k).is_some_and(unseen)).count();
                let Some(end) = step(gap + 1).filter(|end| gap > 0 && occupied(*end)) else { continue };
                let (near, far) = (mask.depth_m[start], mask.depth_m[end]);
                if agree(near, far) {
                    let at = |k: usize| near + (far - near) * k as f32 / (gap + 1) as f32;
                    filled.extend((1..=gap).filter_map(|k| Some((step(k)?, at(k)))));
                }
            }
        }
    }
    for (index, depth) in filled {
        mask.occupancy[index] = 1.0;
        mask.depth_m[index] = depth;
    }
}

fn neighbours(index: usize, width: usize, region: [usize; 4]) -> impl Iterator<Item = usize> {
    let [x0, y0, x1, y1] = region;
    let (x, y) = (index % width, index / width);
    let rows = y.saturating_sub(1).max(y0)..(y + 2).min(y1);
    rows.flat_map(move |v| (x.saturating_sub(1).max(x0)..(x + 2).min(x1)).map(move |u| v * width + u))
        .filter(move |other| *other != index)
}

fn label_bodies(mask: &mut Mask, min_area_px: usize) {
    let [x0, y0, x1, y1] = mask.region;
    let mut found: Vec<Vec<u32>> = Vec::new();
    let mut visited = vec![false; mask.labels.len()];
    for start in (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y))).map(|(x, y)| y * mask.width + x) {
        if visited[start] || mask.occupancy[start] < BODY_OCCUPANCY {
            continue;
        }
        visited[start] = true;
        let mut pixels = vec![start as u32];
        let mut next = 0;
        while next < pixels.len() {
            let index = pixels[next] as usize;
            next += 1;
            for other in neighbours(index, mask.width, mask.region) {
                let body = !visited[other] && mask.occupancy[other] >= BODY_OCCUPANCY;
                if body && agree(mask.depth_m[index], mask.depth_m[other]) {
                    visited[other] = true;
                    pixels.push(other as u32);
                }
            }
        }
        if pixels.len() >= min_area_px {
            found.push(pixels);
        }
    }
    found.sort_by_key(|pixels| (std::cmp::Reverse(pixels.len()), pixels[0]));
    found.truncate(usize::from(u16::MAX));
    for (pixels, label) in found.iter().zip(1..) {
        for index in pixels {
            mask.labels[*index as usize] = label;
        }
        mask.blobs.push(Blob { label, area_px: pixels.len(), bounds: [usize::MAX, usize::MAX, 0, 0] });
    }
}

fn grow_fringes(mask: &mut Mask) {
    let [x0, y0, x1, y1] = mask.region;
    let inside = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y))).map(|(x, y)| y * mask.width + x);
    let mut front: Vec<usize> = inside.filter(|index| mask.labels[*index] != 0).collect();
    let mut next = 0;
    while next < front.len() {
        let index = front[next];
        next += 1;
        let label = mask.labels[index];
        let bounds = &mut mask.blobs[usize::from(label) - 1].bounds;
        let (x, y) = (index % mask.width, index / mask.width);
        *bounds = [bounds[0].min(x), bounds[1].min(y), bounds[2].max(x + 1), bounds[3].max(y + 1)];
        for other in neighbours(index, mask.width, mask.region) {
            let occupancy = mask.occupancy[other];
            let fringe = mask.labels[other] == 0 && (FRINGE_OCCUPANCY..BODY_OCCUPANCY).contains(&occupancy);
            if fringe && agree(mask.depth_m[index], mask.depth_m[other]) {
                mask.labels[other] = label;
                front.push(other);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CameraModel;

    /// A frame from rows of digits: each digit a depth in decimetres, `.` for no reading.
    fn frame(rows: &[&str]) -> DepthFrame {
        let depth = rows.iter().flat_map(|row| row.bytes());
        DepthFrame {
            width: rows[0].len(),
            height: rows.len(),
            depth: depth.map(|b| if b == b'.' { 0 } else { u16::from(b - b'0') * 100 }).collect(),
            depth_unit_m: 0.001,
            timestamp_ns: 0,
            camera: CameraModel { fx: 100.0, fy: 100.0, cx: 0.0, cy: 0.0 },
        }
    }

    fn mask(rows: &[&str], min_area_px: usize, bridge_px: usize) -> Mask {
        let params = MaskParams { min_area_px, bridge_px, ..MaskParams::default() };
        let frame = frame(rows);
        let mut accumulation = Accumulation::like(&frame);
        accumulation.add(&frame, &params);
        extract(&accumulation, &params)
    }

    fn check(rows: &[&str], min_area_px: usize, bridge_px: usize, expected: &[&str]) {
        let mask = mask(rows, min_area_px, bridge_px);
        let drawn: Vec<String> = mask
            .labels
            .chunks(mask.width)
            .map(|row| row.iter().map(|label| char::from(b'0' + *label as u8)).collect())
            .collect();
        assert_eq!(drawn, expected);
    }

    #[test]
    fn only_the_depth_window_counts() {
        check(&["2444", "9.44"], 1, 0, &["0111", "2011"]);
    }

    #[test]
    fn a_depth_jump_separates_neighbours() {
        check(&["4455"], 1, 0, &["1122"]);
    }

    #[test]
    fn specks_go() {
        check(&["4....", "...44"], 2, 0, &["00000", "00011"]);
    }

    #[test]
    fn a_gap_without_readings_is_bridged_where_both_sides_agree() {
        check(&["44..44"], 1, 2, &["111111"]);
        check(&["44..44"], 1, 1, &["110022"]);
        check(&["44..55"], 1, 2, &["110022"]);
        check(&["442244"], 1, 2, &["110022"]);
        check(&["4..", "...", "..4"], 1, 2, &["100", "010", "001"]);
    }

    #[test]
    fn the_region_is_half_open_and_cut_to_the_image() {
        let params = MaskParams { roi: Some([1, 0, 3, 9]), ..MaskParams::default() };
        assert_eq!(params.region(4, 2), [1, 0, 3, 2]);
        let presence = presence(&frame(&["4444", "4444"]), &params);
        assert_eq!(presence, Presence { area_px: 4, centroid_px: [1.5, 0.5] });
    }

    #[test]
    fn depth_is_the_mean_and_occupancy_the_share_over_the_frames() {
        let params = MaskParams { min_area_px: 1, ..MaskParams::default() };
        let mut accumulation = Accumulation::like(&frame(&["4"]));
        for row in ["4", "5", "1", "."] {
            accumulation.add(&frame(&[row]), &params);
        }
        let mask = extract(&accumulation, &params);
        assert_eq!(mask.occupancy, [0.5]);
        assert!((mask.depth_m[0] - 0.45).abs() < 1e-6);
        assert_eq!(mask.blobs, [Blob { label: 1, area_px: 1, bounds: [0, 0, 1, 1] }]);
    }

    #[test]
    fn no_frames_give_an_empty_mask() {
        let params = MaskParams::default();
        let empty = extract(&Accumulation::like(&frame(&["44"])), &params);
        assert!(empty.blobs.is_empty());
    }
}
