//! Frames of something that stands still, added up pixel by pixel: in which share of them a pixel is
//! occupied tells where an edge runs below a pixel.

use super::mask::MaskParams;
use crate::frame::DepthFrame;

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
    /// Sum of the readings within the window.
    sum: Vec<u32>,
    /// Sum of their squares.
    squares: Vec<u64>,
    /// Metres of one count of the last frame.
    depth_unit_m: f64,
    /// Focal length of the camera, pixels.
    pub(super) focal_px: f32,
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
        }
    }

    /// Forgets all frames but keeps the memory.
    pub fn clear(&mut self) {
        self.frames = 0;
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

    /// Adds a frame of the same size. After 65,535 frames further ones are left out. O(pixels of the
    /// region).
    pub fn add(&mut self, frame: &DepthFrame, params: &MaskParams) {
        if self.frames == u32::from(u16::MAX) {
            return;
        }
        self.frames += 1;
        self.depth_unit_m = frame.depth_unit_m;
        let window = params.window(frame);
        let [x0, y0, x1, y1] = params.region(self.width, self.height);
        for y in y0..y1 {
            let row = y * self.width + x0..y * self.width + x1;
            let counters = self.hits[row.clone()].iter_mut().zip(&mut self.silent[row.clone()]);
            let sums = self.sum[row.clone()].iter_mut().zip(&mut self.squares[row.clone()]);
            for ((counts, (hits, silent)), (sum, squares)) in frame.depth[row].iter().zip(counters).zip(sums)
            {
                if window.contains(counts) {
                    *hits += 1;
                    *sum += u32::from(*counts);
                    *squares += u64::from(*counts) * u64::from(*counts);
                } else if *counts == 0 {
                    *silent += 1;
                }
            }
        }
    }

    /// Mean depth of a pixel, metres; 0 where it was never within the window.
    pub(super) fn mean_m(&self, index: usize) -> f32 {
        let hits = f64::from(self.hits[index].max(1));
        (f64::from(self.sum[index]) / hits * self.depth_unit_m) as f32
    }

    /// Standard deviation of a pixel's depth over the frames, metres.
    pub(super) fn spread_m(&self, index: usize) -> f32 {
        let hits = f64::from(self.hits[index].max(1));
        let mean = f64::from(self.sum[index]) / hits;
        let variance = self.squares[index] as f64 / hits - mean * mean;
        (variance.max(0.0).sqrt() * self.depth_unit_m) as f32
    }
}
