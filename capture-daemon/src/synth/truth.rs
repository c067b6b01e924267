//! What is true of a clip, as the JSON file beside it.

use serde::{Deserialize, Serialize};

use super::blade::{SECTIONS, Shape, SyntheticBlade};
use super::clip::Clip;
use super::motion::VisitFrames;
use super::scene::Family;
use super::sensor::{BACKGROUND_M, DEPTH_UNIT_M};

/// Points of a blade's midrib in the truth.
pub const TRUTH_KNOTS: usize = 64;

/// What is true of a clip. Lengths are metres, camera frame; numbers are rounded to 10⁻⁷.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Family of the scene.
    pub family: Family,
    /// Seed of scene and noise.
    pub seed: u64,
    /// Scale of the sensor's errors.
    pub noise: f64,
    /// Frames of the clip.
    pub frames: usize,
    /// Frames each second.
    pub fps: f64,
    /// First frame that shows the blades, and the first after it that does not.
    pub visible_frames: [usize; 2],
    /// Columns and rows.
    pub size: [usize; 2],
    /// The camera.
    pub camera: TruthCamera,
    /// Metres of one count of depth.
    pub depth_unit_m: f64,
    /// Distance of the wall behind the blades.
    pub background_m: f64,
    /// The blades, in a row from left to right; of those in a hand what is seen above it, in the pose at
    /// the hold's start.
    pub blades: Vec<TruthBlade>,
    /// The hands that come and leave, in turn; none where the blades stand by themselves.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub visits: Vec<TruthVisit>,
}

/// A hand that comes, holds still and leaves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruthVisit {
    /// First frame that shows it, and the first after it that does not.
    pub visible_frames: [usize; 2],
    /// First frame of the hold, and the first of leaving.
    pub held_frames: [usize; 2],
    /// Its first blade among all, and the first behind them that is not its own.
    pub blades: [usize; 2],
    /// Its pose in each of the visible frames.
    pub poses: Vec<TruthPose>,
}

/// Where a hand is in a frame: a point p of the pose at the hold's start is at rotation·p + translation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruthPose {
    /// Unit quaternion, x y z w.
    pub rotation: [f64; 4],
    /// Metres.
    pub translation_m: [f64; 3],
}

/// A pinhole camera, pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruthCamera {
    /// Focal length along x.
    pub fx: f64,
    /// Focal length along y.
    pub fy: f64,
    /// Principal point, from the first column's centre.
    pub cx: f64,
    /// Principal point, from the first row's centre.
    pub cy: f64,
}

/// A blade as it really is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruthBlade {
    /// Its outline.
    pub shape: Shape,
    /// Arc length of its midrib.
    pub length_m: f64,
    /// Its greatest width, both half widths together.
    pub max_width_m: f64,
    /// Slope of a folded blade's halves: an edge lies `fold` times its half width behind the line along
    /// `across`, at right angles to it and the midrib; before it where negative. 0 for a flat blade.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub fold: f64,
    /// [`TRUTH_KNOTS`] knots from root to tip at equal steps of arc length.
    pub knots: Vec<TruthKnot>,
}

/// A cross-section; the fields that `replay --json` prints too have the same names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruthKnot {
    /// On the midrib.
    pub camera_m: [f64; 3],
    /// Unit vector from the left edge to the right edge, but for the fold.
    pub across: [f64; 3],
    /// From the midrib to the left and the right edge, along `across`.
    pub half_width_m: [f64; 2],
}

impl Truth {
    /// The truth of a clip.
    pub fn of(clip: &Clip) -> Self {
        let (scene, params, camera) = (clip.scene(), clip.params(), clip.params().camera());
        Self {
            family: scene.family,
            seed: scene.seed,
            noise: params.noise,
            frames: params.frames,
            fps: params.fps,
            visible_frames: [clip.visible().start, clip.visible().end],
            size: [params.width, params.height],
            camera: TruthCamera { fx: camera.fx, fy: camera.fy, cx: camera.cx, cy: camera.cy },
            depth_unit_m: DEPTH_UNIT_M,
            background_m: BACKGROUND_M,
            blades: scene.blades.iter().map(TruthBlade::of).collect(),
            visits: clip
                .visits()
                .into_iter()
                .enumerate()
                .map(|(i, it)| TruthVisit::of(clip, i, &it))
                .collect(),
        }
    }
}

impl TruthVisit {
    fn of(clip: &Clip, index: usize, frames: &VisitFrames) -> Self {
        let blades = &clip.scene().visits[index].blades;
        let poses = frames.visible.clone().filter_map(|frame| clip.pose(index, frame));
        Self {
            visible_frames: [frames.visible.start, frames.visible.end],
            held_frames: [frames.held.start, frames.held.end],
            blades: [blades.start, blades.end],
            poses: poses
                .map(|pose| TruthPose {
                    rotation: pose.rotation.to_array().map(rounded),
                    translation_m: pose.translation.to_array().map(rounded),
                })
                .collect(),
        }
    }
}

impl TruthBlade {
    fn of(blade: &SyntheticBlade) -> Self {
        let knots = blade.sections.iter().step_by((SECTIONS - 1) / (TRUTH_KNOTS - 1));
        let knots = knots.map(|section| TruthKnot {
            camera_m: section.center.to_array().map(rounded),
            across: section.across.to_array().map(rounded),
            half_width_m: [section.half_width_left, section.half_width_right].map(rounded),
        });
        Self {
            shape: blade.shape,
            length_m: rounded(blade.length_m),
            max_width_m: rounded(blade.max_width_m),
            fold: rounded(blade.fold),
            knots: knots.collect(),
        }
    }
}

fn is_zero(number: &f64) -> bool {
    *number == 0.0
}

/// To 10⁻⁷, so that the file stays short.
fn rounded(number: f64) -> f64 {
    (number * 1e7).round() / 1e7
}
