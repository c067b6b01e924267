//! The stages in order, from frames added up to blades. Every result is kept in [`Steps`], so that
//! `--explain` can draw any of them.

use common::blade::{Blade, BladeId, Knot};
use common::refine::{RefineParams, Refined, refine};
use common::strand::motion_in_wind;
use glam::{Affine3A, Mat3, Vec2, Vec3};

use crate::frame::CameraModel;
use crate::stages::contour::{self, Outline};
use crate::stages::lift::{self, Lifted};
use crate::stages::mask::{self, Accumulation, Mask, MaskParams};
use crate::stages::partition::{self, Part, PartitionParams};
use crate::stages::skeleton::{self, Skeleton};

/// What the stages can be told.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct PipelineParams {
    /// Mask.
    pub mask: MaskParams,
    /// Refinement.
    pub refine: RefineParams,
    /// Which blades are good enough.
    pub accept: AcceptParams,
    /// How the camera hangs.
    pub pose: CameraPose,
}

/// How the camera stands against gravity.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct CameraPose {
    /// How far it looks down, radians.
    pub tilt_rad: f32,
    /// How far it is turned clockwise about its own axis, radians.
    pub roll_rad: f32,
}

impl CameraPose {
    /// Rotation from the camera frame to the blade frame: +y up, +z horizontally towards the camera.
    pub fn blade_from_camera(&self) -> Mat3 {
        let level_from_camera = Mat3::from_rotation_x(-self.tilt_rad) * Mat3::from_rotation_z(self.roll_rad);
        Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0)) * level_from_camera
    }

    /// Where gravity points in the image; unit vector (straight down for a camera that looks along
    /// gravity).
    pub fn down_in_image(&self) -> Vec2 {
        (self.blade_from_camera().transpose() * Vec3::NEG_Y).truncate().normalize_or(Vec2::Y)
    }
}

/// Which blades are good enough to grow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AcceptParams {
    /// Shortest blade, metres.
    pub min_length_m: f32,
    /// Fewest pixels across the widest cross-section.
    pub min_pixels_across: f32,
}

impl Default for AcceptParams {
    fn default() -> Self {
        Self { min_length_m: 0.03, min_pixels_across: 2.5 }
    }
}

/// How sure a blade is. Predictions are one standard deviation, from the jitter of single edges; they
/// are not calibrated against truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// 0 to 1.
    pub score: f32,
    /// Image pixels across the widest cross-section.
    pub pixels_across: f32,
    /// Hausdorff distance of the refined midrib to the raw one, metres.
    pub hausdorff_m: f32,
    /// Predicted error of the length, metres.
    pub length_error_m: f32,
    /// Predicted error of the largest width, metres.
    pub width_error_m: f32,
}

/// A blade as it was captured.
#[derive(Clone, Debug, PartialEq)]
pub struct CapturedBlade {
    /// As the library holds it, in the blade frame.
    pub blade: Blade,
    /// Its refined knots in the camera frame, metres.
    pub knots_in_camera: Vec<Knot>,
    /// How sure it is.
    pub quality: Quality,
}

/// Why something that was seen is not a blade.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// Too few pixels across for a width.
    #[error("it is only {found:.1} pixels wide where {needed:.1} are needed: please hold it closer")]
    TooNarrow {
        /// Pixels across.
        found: f32,
        /// Pixels needed.
        needed: f32,
    },
    /// Shorter than a blade may be.
    #[error("it is only {:.0} mm long where {:.0} are needed: please hold a longer one", found_m * 1e3, needed_m * 1e3)]
    TooShort {
        /// Length, metres.
        found_m: f32,
        /// Length needed, metres.
        needed_m: f32,
    },
    /// No midrib, depth or valid knots could be had.
    #[error("its shape could not be followed: please hold it still and flat towards the camera")]
    NoShape,
}

impl Refusal {
    /// A word for logs and programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::TooNarrow { .. } => "too_narrow",
            Self::TooShort { .. } => "too_short",
            Self::NoShape => "no_shape",
        }
    }
}

/// What each stage made of one capture.
#[derive(Clone, Debug, PartialEq)]
pub struct Steps {
    /// What is held before the camera.
    pub mask: Mask,
    /// Outlines of the blobs.
    pub outlines: Vec<Outline>,
    /// Single blades' outlines.
    pub parts: Vec<Part>,
    /// Their midribs in the image.
    pub skeletons: Vec<Skeleton>,
    /// The same in space.
    pub lifted: Vec<Lifted>,
    /// The blades, from left to right by their roots.
    pub blades: Vec<CapturedBlade>,
    /// What was seen and refused.
    pub refused: Vec<Refusal>,
}

/// Runs all stages over what was added up until the frame at `timestamp_ns`.
pub fn capture(
    frames: &Accumulation,
    camera: &CameraModel,
    timestamp_ns: u64,
    params: &PipelineParams,
) -> Steps {
    let partition = PartitionParams { down: params.pose.down_in_image(), ..PartitionParams::default() };
    let mut refused = Vec::new();

    let mask = mask::extract(frames, &params.mask);
    let outlines = contour::trace(&mask);
    let parts: Vec<Part> =
        outlines.iter().flat_map(|outline| partition::flow(&mask, outline, &partition)).collect();
    let skeletons: Vec<Skeleton> = parts.iter().filter_map(|part| skeleton::trace(&mask, part)).collect();
    let lifted: Vec<Lifted> = skeletons.iter().filter_map(|bones| lift::lift(&mask, bones, camera)).collect();
    refused.extend((lifted.len()..parts.len()).map(|_| Refusal::NoShape));
    let mut accepted = Vec::new();
    for blade in &lifted {
        match check(blade, &params.accept) {
            Ok(()) => accepted.push(blade),
            Err(reason) => refused.push(reason),
        }
    }
    accepted.sort_by(|a, b| a.knots_in_camera[0].position.x.total_cmp(&b.knots_in_camera[0].position.x));
    let mut blades = Vec::new();
    for blade in accepted {
        match finish(blade, frames.frames(), timestamp_ns, blades.len() as u32, params) {
            Some(captured) => blades.push(captured),
            None => refused.push(Refusal::NoShape),
        }
    }
    Steps { mask, outlines, parts, skeletons, lifted, blades, refused }
}

fn check(blade: &Lifted, accept: &AcceptParams) -> Result<(), Refusal> {
    if blade.pixels_across < accept.min_pixels_across {
        return Err(Refusal::TooNarrow { found: blade.pixels_across, needed: accept.min_pixels_across });
    }
    if blade.length_m < accept.min_length_m {
        return Err(Refusal::TooShort { found_m: blade.length_m, needed_m: accept.min_length_m });
    }
    Ok(())
}

fn finish(
    lifted: &Lifted,
    frames: u32,
    timestamp_ns: u64,
    index: u32,
    params: &PipelineParams,
) -> Option<CapturedBlade> {
    let rotation = params.pose.blade_from_camera();
    let root = lifted.knots_in_camera[0].position;
    let blade_from_camera = Affine3A::from_mat3_translation(rotation, -(rotation * root));
    let skeleton = moved(&lifted.knots_in_camera, blade_from_camera);
    let midrib: Vec<Vec3> = skeleton.iter().map(|knot| knot.position).collect();
    let Refined { knots, hausdorff_m } = refine(&skeleton, &motion_in_wind(&midrib, 24), &params.refine);
    let quality = quality(lifted, frames, hausdorff_m);
    let id = BladeId::of(timestamp_ns, index, &knots);
    let name = format!("blade-{}", &id.to_string()[..8]);
    let knots_in_camera = moved(&knots, blade_from_camera.inverse());
    let blade = Blade::new(id, name, knots, lifted.length_m, timestamp_ns, quality.score).ok()?;
    Some(CapturedBlade { blade, knots_in_camera, quality })
}

fn moved(knots: &[Knot], by: Affine3A) -> Vec<Knot> {
    let knot = |knot: &Knot| Knot {
        position: by.transform_point3(knot.position),
        across: by.transform_vector3(knot.across).normalize_or(Vec3::X),
        ..*knot
    };
    knots.iter().map(knot).collect()
}

fn quality(lifted: &Lifted, frames: u32, hausdorff_m: f32) -> Quality {
    // σ of one edge in one row of one frame, pixels (DESIGN.md section 10), and the rows that the
    // smoothing of the widths averages over.
    const EDGE_PX: f32 = 0.45;
    const ROWS: f32 = 8.0;
    let readings = frames.max(1) as f32 * ROWS;
    let width_error_px = EDGE_PX * (2.0 / readings).sqrt();
    // Root and tip are each known to about a pixel, less for pointed ones than for blunt ones.
    let length_error_px = (2.0 * (0.8 * 0.8 + EDGE_PX * EDGE_PX / frames.max(1) as f32)).sqrt();
    let relative_error = width_error_px / lifted.pixels_across.max(1.0);
    Quality {
        score: (1.0 - 4.0 * relative_error).clamp(0.0, 1.0) * (lifted.pixels_across / 6.0).min(1.0),
        pixels_across: lifted.pixels_across,
        hausdorff_m,
        length_error_m: length_error_px * lifted.metres_per_px,
        width_error_m: width_error_px * lifted.metres_per_px,
    }
}
