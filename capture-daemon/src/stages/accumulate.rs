//! Frames of something that stands still, added up pixel by pixel: in which share of them a pixel is
//! occupied tells where an edge runs below a pixel.

use std::ops::RangeInclusive;

use glam::Vec3;

use super::mask::MaskParams;
use super::motion::Motion;
use super::presence;
use super::register::Reference;
use crate::frame::DepthFrame;

/// Parts of a count in which depths are added up: what moved by less than a count did move.
const PARTS: f32 = 16.0;
/// The sum of so many readings fits.
const MAX_FRAMES: u32 = 4095;

/// Frames added up while what is held stands still.
#[derive(Clone, Debug, PartialEq)]
pub struct Accumulation {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) frames: u32,
    /// Frames in which the pixel was within the window.
    pub(super) hits: Vec<u16>,
    /// Frames in which the pixel had no reading.
    pub(super) silent: Vec<u16>,
    /// Sum of the readings within the window, in [`PARTS`].
    sum: Vec<u32>,
    /// Sum of their squares.
    squares: Vec<u64>,
    /// Metres of one count of the last frame.
    pub(super) depth_unit_m: f64,
    /// Focal length of the camera, pixels.
    pub(super) focal_px: f32,
    first: First,
    /// What the first frame read, counts; empty before it.
    pub(super) readings: Vec<u16>,
}

/// What later frames are brought into line with.
#[derive(Clone, Debug, PartialEq)]
enum First {
    /// There is no frame yet.
    None,
    /// The first frame.
    Frame(DepthFrame),
    /// What is needed of it.
    Reference(Box<Reference>),
    /// It shows too little to tell how it moves.
    Vague,
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
            sum: vec![0; pixels],
            squares: vec![0; pixels],
            depth_unit_m: frame.depth_unit_m,
            focal_px: frame.camera.fx as f32,
            first: First::None,
            readings: Vec::new(),
        }
    }

    /// Forgets all frames but keeps the memory.
    pub fn clear(&mut self) {
        self.frames = 0;
        self.first = First::None;
        self.readings.clear();
        self.hits.fill(0);
        self.silent.fill(0);
        self.sum.fill(0);
        self.squares.fill(0);
    }

    /// Whether `frame` has the size of the frames before it.
    pub fn fits(&self, frame: &DepthFrame) -> bool {
        (self.width, self.height) == (frame.width, frame.height)
    }

    /// Frames added so far.
    pub fn frames(&self) -> u32 {
        self.frames
    }

    /// Adds a frame of the same size, after undoing how what it shows has moved since the first one; a
    /// frame that shows something else is left out, and so are all after 4,095. O(pixels of the region).
    pub fn add(&mut self, frame: &DepthFrame, params: &MaskParams) {
        if self.frames == MAX_FRAMES {
            return;
        }
        let window = params.window(frame);
        let region = params.region(self.width, self.height);
        if let First::Frame(first) = &self.first {
            let reference = Reference::of(first, region, &params.window(first));
            self.first = reference.map_or(First::Vague, |reference| First::Reference(Box::new(reference)));
        }
        self.depth_unit_m = frame.depth_unit_m;
        match &mut self.first {
            First::None => {
                self.first = First::Frame(frame.clone());
                self.readings.clone_from(&frame.depth);
                self.add_still(frame, &window, region);
            }
            First::Frame(_) | First::Vague => self.add_still(frame, &window, region),
            First::Reference(reference) => match reference.motion_to(frame, region, &window) {
                None => {}
                Some(motion) if reference.is_still(&motion) => {
                    self.add_still(frame, &window, region);
                }
                Some(motion) => self.add_moved(frame, &window, region, &motion),
            },
        }
    }

    fn add_still(&mut self, frame: &DepthFrame, window: &RangeInclusive<u16>, region: [usize; 4]) {
        self.frames += 1;
        let [x0, y0, x1, y1] = region;
        for y in y0..y1 {
            let row = y * self.width + x0..y * self.width + x1;
            let readings = &frame.depth[row.clone()];
            for (silent, counts) in self.silent[row.clone()].iter_mut().zip(readings) {
                *silent += u16::from(*counts == 0);
            }
            if presence::count(readings, window) == 0 {
                continue;
            }
            let sums = self.sum[row.clone()].iter_mut().zip(&mut self.squares[row.clone()]);
            for ((counts, hits), (sum, squares)) in readings.iter().zip(&mut self.hits[row.clone()]).zip(sums)
            {
                if window.contains(counts) {
                    let parts = u32::from(*counts) * PARTS as u32;
                    *hits += 1;
                    *sum += parts;
                    *squares += u64::from(parts) * u64::from(parts);
                }
            }
        }
    }

    /// Adds to each pixel what has moved away from it.
    fn add_moved(
        &mut self,
        frame: &DepthFrame,
        window: &RangeInclusive<u16>,
        region: [usize; 4],
        motion: &Motion,
    ) {
        let First::Reference(reference) = &self.first else { return };
        self.frames += 1;
        let [x0, y0, x1, y1] = region;
        let camera = &frame.camera;
        let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(|value| value as f32);
        let parts_per_m = (f64::from(PARTS) / frame.depth_unit_m) as f32;
        for y in y0..y1 {
            for x in reference.spans[y].clone() {
                let index = y * self.width + x;
                let z = reference.depth_m[index];
                if z <= 0.0 {
                    continue;
                }
                let here = Vec3::new((x as f32 - cx) / fx, (y as f32 - cy) / fy, 1.0) * z;
                let there = motion.apply(here);
                // What the border cuts off goes on beyond it as far as we know.
                let u = (fx * there.x / there.z + cx + 0.5).floor().clamp(x0 as f32, x1 as f32 - 1.0);
                let v = (fy * there.y / there.z + cy + 0.5).floor().clamp(y0 as f32, y1 as f32 - 1.0);
                let counts = frame.depth[v as usize * self.width + u as usize];
                if window.contains(&counts) {
                    let parts = f32::from(counts) * PARTS - (there.z - here.z) * parts_per_m;
                    let parts = (parts + 0.5) as u32;
                    self.hits[index] += 1;
                    self.sum[index] += parts;
                    self.squares[index] += u64::from(parts) * u64::from(parts);
                } else if counts == 0 {
                    self.silent[index] += 1;
                }
            }
        }
    }

    /// Bounding box of all pixels of a region that were ever within the window, `[x0, y0, x1, y1]`, half
    /// open.
    pub(super) fn bounds(&self, [x0, y0, x1, y1]: [usize; 4]) -> [usize; 4] {
        let mut bounds: Option<[usize; 4]> = None;
        for y in y0..y1 {
            let row = &self.hits[y * self.width + x0..y * self.width + x1];
            // Most rows are empty, and hardly any reaches beyond those above it: this tells it fastest.
            let is_empty = |part: &[u16]| part.iter().fold(0, |all, hits| all | hits) == 0;
            if is_empty(row) {
                continue;
            }
            let [mut left, top, mut right, _] = bounds.unwrap_or([x1, y, x0, y]);
            if !is_empty(&row[..left - x0]) {
                left = x0 + row.iter().position(|hits| *hits > 0).unwrap_or(0);
            }
            if !is_empty(&row[right - x0..]) {
                right = x0 + row.iter().rposition(|hits| *hits > 0).map_or(0, |last| last + 1);
            }
            bounds = Some([left, top, right, y + 1]);
        }
        bounds.unwrap_or([x0, y0, x0, y0])
    }

    /// Mean depth of the pixels that were within the window in so many frames, metres over the sum of their
    /// readings, by number of frames.
    pub(super) fn means_m(&self) -> Vec<f64> {
        let per_part_m = self.depth_unit_m / f64::from(PARTS);
        (0..=self.frames).map(|hits| per_part_m / f64::from(hits.max(1))).collect()
    }

    /// Mean depth of a pixel, metres, by [`Self::means_m`]; 0 where it was never within the window.
    pub(super) fn mean_m(&self, index: usize, means_m: &[f64]) -> f32 {
        (f64::from(self.sum[index]) * means_m[usize::from(self.hits[index])]) as f32
    }

    /// Variance of a pixel's depth over the frames, in squares of [`PARTS`].
    pub(super) fn variance(&self, index: usize) -> f32 {
        let per_hit = 1.0 / f64::from(self.hits[index].max(1));
        let mean = f64::from(self.sum[index]) * per_hit;
        (self.squares[index] as f64 * per_hit - mean * mean).max(0.0) as f32
    }
}
