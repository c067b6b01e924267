//! Lifted skeleton → a blade of the library, or the reason why it is none.

use common::blade::{Blade, BladeId, Knot};
use common::refine::{RefineParams, Refined, refine};
use common::strand::motion_in_wind;
use glam::{Affine3A, Vec3};

use super::lift::Lifted;
use crate::frame::CameraPose;

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

/// Moments of a blade's motion in wind that its refinement looks at.
pub const MOTION_FRAMES: usize = 12;
/// A blade is at least this many times as long as it is wide.
const MIN_ASPECT: f32 = 1.2;
/// The midrib of a blade that was followed rightly lies on it but for gaps and what hides it.
const MIN_SEEN: f32 = 0.5;
/// Coarsest picture that a blade is measured in, metres a pixel.
const MAX_M_PER_PX: f32 = 0.004;
/// A blade that runs more steeply away from the camera than this, on average, cannot be measured:
/// metres of midrib for a metre across the picture.
const MAX_STEEPNESS: f32 = 4.0;

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
    /// So far off that a pixel spans too much of it.
    #[error("it is too far away, a pixel spans {:.1} mm of it: please come closer", metres_per_px * 1e3)]
    TooFar {
        /// Metres that a pixel spans.
        metres_per_px: f32,
    },
    /// Shorter than a blade may be.
    #[error("it is only {:.0} mm long where {:.0} are needed: please hold a longer one", found_m * 1e3, needed_m * 1e3)]
    TooShort {
        /// Length, metres.
        found_m: f32,
        /// Length needed, metres.
        needed_m: f32,
    },
    /// About as wide as it is long.
    #[error("it is too broad for a blade or a leaf: please hold up a single one, with the tip free")]
    TooBroad,
    /// No midrib that stays on it, or one that runs straight away from the camera.
    #[error("its shape could not be followed: please hold it still and flat towards the camera")]
    NoShape,
}

impl Refusal {
    /// A word for logs and programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::TooFar { .. } => "too_far",
            Self::TooNarrow { .. } => "too_narrow",
            Self::TooShort { .. } => "too_short",
            Self::TooBroad => "too_broad",
            Self::NoShape => "no_shape",
        }
    }
}

/// Whether a lifted skeleton is good enough.
///
/// # Errors
/// The reason why it is not.
pub fn accept(lifted: &Lifted, params: &AcceptParams) -> Result<(), Refusal> {
    if lifted.metres_per_px > MAX_M_PER_PX {
        return Err(Refusal::TooFar { metres_per_px: lifted.metres_per_px });
    }
    let steep = lifted.length_m > MAX_STEEPNESS * lifted.length_px * lifted.metres_per_px;
    if lifted.seen < MIN_SEEN || steep || !lifted.within_region {
        return Err(Refusal::NoShape);
    }
    if lifted.pixels_across < params.min_pixels_across {
        return Err(Refusal::TooNarrow { found: lifted.pixels_across, needed: params.min_pixels_across });
    }
    if lifted.length_m < params.min_length_m {
        return Err(Refusal::TooShort { found_m: lifted.length_m, needed_m: params.min_length_m });
    }
    if lifted.length_m < MIN_ASPECT * lifted.max_width_m() {
        return Err(Refusal::TooBroad);
    }
    Ok(())
}

/// Refines a skeleton in the blade frame and gives it its identity: `index` in the capture that the
/// frame at `timestamp_ns` completed, from `frames` frames.
///
/// # Errors
/// [`Refusal::NoShape`] when its knots break an invariant of [`Blade`].
pub fn finish(
    lifted: &Lifted,
    frames: u32,
    timestamp_ns: u64,
    index: u32,
    pose: &CameraPose,
    params: &RefineParams,
) -> Result<CapturedBlade, Refusal> {
    let rotation = pose.blade_from_camera();
    let root = lifted.knots_in_camera[0].position;
    let blade_from_camera = Affine3A::from_mat3_translation(rotation, -(rotation * root));
    let skeleton = moved(&lifted.knots_in_camera, blade_from_camera);
    let midrib: Vec<Vec3> = skeleton.iter().map(|knot| knot.position).collect();
    let Refined { knots, hausdorff_m } = refine(&skeleton, &motion_in_wind(&midrib, MOTION_FRAMES), params);
    let quality = quality(lifted, frames, hausdorff_m);
    let id = BladeId::of(timestamp_ns, index, &knots);
    let name = format!("blade-{}", &id.to_string()[..8]);
    let knots_in_camera = moved(&knots, blade_from_camera.inverse());
    let size = [lifted.length_m, lifted.max_width_m()];
    let blade =
        Blade::new(id, name, knots, size, timestamp_ns, quality.score).map_err(|_| Refusal::NoShape)?;
    Ok(CapturedBlade { blade, knots_in_camera, quality })
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
    // Root and tip are each known to about a pixel.
    let length_error_px = (2.0 * (0.8 * 0.8 + EDGE_PX * EDGE_PX / frames.max(1) as f32)).sqrt();
    let relative_error = width_error_px / lifted.pixels_across.max(1.0);
    let sharp = (1.0 - 4.0 * relative_error).clamp(0.0, 1.0) * (lifted.pixels_across / 6.0).min(1.0);
    Quality {
        score: sharp * lifted.seen.clamp(0.0, 1.0),
        pixels_across: lifted.pixels_across,
        hausdorff_m,
        length_error_m: length_error_px * lifted.metres_per_px,
        width_error_m: width_error_px * lifted.metres_per_px,
    }
}
