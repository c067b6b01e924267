//! A clip: an empty picture, a scene that stands still or is held up by hands, an empty picture again.

use std::borrow::Cow;
use std::ops::Range;

use super::motion::{Pose, VisitFrames};
use super::random::Random;
use super::scene::Scene;
use super::sensor::{DEPTH_UNIT_M, Sensor};
use super::surface::Surface;
use crate::frame::{CameraModel, DepthFrame, MAX_PIXELS};
use crate::recording::START_NS;

/// Focal length over the picture's width: 570 px of 640.
const FOCAL_OVER_WIDTH: f64 = 570.0 / 640.0;

/// How a scene is filmed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClipParams {
    /// Columns, 16..=1280.
    pub width: usize,
    /// Rows, 16..=1280.
    pub height: usize,
    /// Scale of the sensor's errors: 1 like a real one, 0 none; 0..=10.
    pub noise: f64,
    /// Frames, 1..=100 000, the empty ones before and after included.
    pub frames: usize,
    /// Frames each second, > 0.
    pub fps: f64,
}

impl Default for ClipParams {
    fn default() -> Self {
        Self { width: 640, height: 480, noise: 1.0, frames: 45, fps: 30.0 }
    }
}

/// A number of [`ClipParams`] is out of its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{what} is {found}; expected {expected}")]
pub struct ClipParamsError {
    pub(super) what: &'static str,
    pub(super) found: String,
    pub(super) expected: &'static str,
}

impl ClipParams {
    pub(super) fn check(&self) -> Result<(), ClipParamsError> {
        let error = |what, found: String, expected| Err(ClipParamsError { what, found, expected });
        let sides_fit = [self.width, self.height].iter().all(|side| (16..=1280).contains(side));
        if !sides_fit || self.width * self.height > MAX_PIXELS {
            let found = format!("{}x{}", self.width, self.height);
            return error(
                "the size",
                found,
                "sides of 16 to 1280 pixels, 1310720 pixels (1280x1024) at most",
            );
        }
        if !(0.0..=10.0).contains(&self.noise) {
            return error("the noise", self.noise.to_string(), "0 to 10");
        }
        if !(1..=100_000).contains(&self.frames) {
            return error("the number of frames", self.frames.to_string(), "1 to 100000");
        }
        if !(0.001..=1000.0).contains(&self.fps) {
            return error("the frame rate", self.fps.to_string(), "0.001 to 1000 frames a second");
        }
        Ok(())
    }

    /// The camera that takes such pictures: 58° wide, looking straight ahead.
    pub fn camera(&self) -> CameraModel {
        let focal = FOCAL_OVER_WIDTH * self.width as f64;
        let (cx, cy) = (0.5 * (self.width as f64 - 1.0), 0.5 * (self.height as f64 - 1.0));
        CameraModel { fx: focal, fy: focal, cx, cy }
    }
}

/// A scene, filmed. Frames are made when asked for, each the same however often and in whatever
/// order.
pub struct Clip {
    scene: Scene,
    params: ClipParams,
    sensor: Sensor,
    /// What stands still.
    surface: Surface,
}

impl Clip {
    /// Films a scene.
    ///
    /// # Errors
    /// When a parameter is out of its range.
    pub fn new(scene: Scene, params: ClipParams) -> Result<Self, ClipParamsError> {
        params.check()?;
        let camera = params.camera();
        let sensor = Sensor { width: params.width, height: params.height, camera, noise: params.noise };
        let still: &[_] = if scene.visits.is_empty() { &scene.blades } else { &[] };
        let surface = Surface::draw(still, &[], &camera, (params.width, params.height));
        Ok(Self { scene, params, sensor, surface })
    }

    /// What is filmed.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// How it is filmed.
    pub fn params(&self) -> &ClipParams {
        &self.params
    }

    /// The frames that show the scene. Where it stands still: all but up to 8 before it and up to 5
    /// after it. Of visits: from the first one's coming to the last one's leaving. None of an empty scene.
    pub fn visible(&self) -> Range<usize> {
        let frames = self.params.frames;
        match self.visits().as_slice() {
            [] if self.scene.blades.is_empty() => 0..0,
            [] => (frames / 8).min(8)..frames - (frames / 12).min(5),
            [first, .., last] => first.visible.start..last.visible.end,
            [only] => only.visible.clone(),
        }
    }

    /// The frames of each of the scene's visits, which share the clip evenly: up to 15 empty ones, up
    /// to 10 of coming, the hold, up to 10 of leaving, up to 5 empty ones.
    pub fn visits(&self) -> Vec<VisitFrames> {
        let count = self.scene.visits.len();
        (0..count).map(|index| VisitFrames::new(index, count, self.params.frames)).collect()
    }

    /// The pose of what a hand holds in a frame, from the one at the start of its hold; none while it is
    /// out of the picture.
    pub fn pose(&self, visit: usize, frame: usize) -> Option<Pose> {
        let frames = VisitFrames::new(visit, self.scene.visits.len(), self.params.frames);
        self.scene.visits.get(visit)?.motion.pose(&frames, frame)
    }

    /// The surface that a frame shows.
    fn surface(&self, frame: usize) -> Option<Cow<'_, Surface>> {
        if self.scene.visits.is_empty() {
            return self.visible().contains(&frame).then_some(Cow::Borrowed(&self.surface));
        }
        let mut visits = self.scene.visits.iter().enumerate();
        let (visit, pose) = visits.find_map(|(index, visit)| Some((visit, self.pose(index, frame)?)))?;
        let (blades, hand) = visit.posed(&pose);
        let size = (self.params.width, self.params.height);
        Some(Cow::Owned(Surface::draw(&blades, &hand, &self.sensor.camera, size)))
    }

    /// Frame `index`, from 0; those behind the last show the empty wall. Depth in millimetres;
    /// the first is taken at [`START_NS`].
    pub fn frame(&self, index: usize) -> DepthFrame {
        // Stream 0 is the scene's.
        let mut random = Random::new(self.scene.seed, index as u64 + 1);
        let surface = self.surface(index);
        DepthFrame {
            width: self.params.width,
            height: self.params.height,
            depth: self.sensor.take(surface.as_deref(), &mut random),
            depth_unit_m: DEPTH_UNIT_M,
            timestamp_ns: START_NS + index as u64 * (1e9 / self.params.fps) as u64,
            camera: self.sensor.camera,
        }
    }

    /// All frames in order.
    pub fn frames(&self) -> impl Iterator<Item = DepthFrame> + '_ {
        (0..self.params.frames).map(|index| self.frame(index))
    }
}
