//! The stages in order, from frames added up to blades. Every result is kept in [`Steps`], so that
//! `--explain` can draw any of them.

use common::refine::RefineParams;

use crate::frame::{CameraModel, CameraPose};
use crate::stages::accumulate::Accumulation;
use crate::stages::blade::{self, AcceptParams, CapturedBlade, Refusal};
use crate::stages::blob::Field;
use crate::stages::confidence::Evidence;
use crate::stages::contour::{self, Outline};
use crate::stages::crease;
use crate::stages::lift::{self, Lifted};
use crate::stages::margin;
use crate::stages::mask::{self, Mask, MaskParams};
use crate::stages::partition::{self, Part, PartitionParams};
use crate::stages::ribbon::{self, Ribbon, RibbonParams};
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

/// What each stage made of one capture.
#[derive(Clone, Debug, PartialEq)]
pub struct Steps {
    /// What is held before the camera.
    pub mask: Mask,
    /// Outlines of the blobs.
    pub outlines: Vec<Outline>,
    /// Single blades' outlines.
    pub parts: Vec<Part>,
    /// Each blade, followed from end to end.
    pub ribbons: Vec<Ribbon>,
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
    let down = params.pose.down_in_image();
    let partition = PartitionParams { camera: *camera, pose: params.pose, ..PartitionParams::default() };

    let mask = mask::extract(frames, &params.mask);
    let outlines = contour::trace(&mask, &mask.pieces);
    let parts: Vec<Part> = outlines
        .iter()
        .flat_map(|outline| partition::flow(&mask, &mask.pieces, outline, &partition))
        .collect();
    let fields: Vec<Field> = contour::trace(&mask, &mask.blobs)
        .iter()
        .map(|outline| partition::root_distance(&mask, &mask.blobs, outline, &partition))
        .collect();
    let focal_px = camera.fx as f32;
    let following = RibbonParams { down, focal_px, ..RibbonParams::default() };
    let mut ribbons = ribbon::grow(&mask, &parts, &fields, &following);
    crease::find(&mask, &mut ribbons, focal_px);
    let (traced, skeletons): (Vec<&Ribbon>, Vec<Skeleton>) =
        ribbons.iter().filter_map(|ribbon| Some((ribbon, skeleton::trace(&mask, ribbon, camera)?))).unzip();
    let lifted: Vec<Lifted> = skeletons.iter().map(|skeleton| lift::lift(&mask, skeleton, camera)).collect();

    let window_m = [params.mask.near_m as f32, params.mask.far_m as f32];
    let (mut accepted, mut followed, mut refused) = (Vec::new(), Vec::new(), Vec::new());
    for (lifted, ribbon) in lifted.iter().zip(traced) {
        let margins = margin::look(&mask, ribbon, window_m);
        let evidence = Evidence::of(ribbon, lifted, &margins, mask.frames, mask.depth_noise_m);
        match blade::accept(lifted, &margins, &evidence, &params.accept) {
            Ok(()) => {
                accepted.push((lifted, evidence));
                followed.push(ribbon);
            }
            Err(reason) => refused.push((lifted, ribbon, reason)),
        }
    }
    let steep = blade::steep_blobs(&mask, &followed, camera);
    let mut refused = blade::worth_saying(&mask, &accepted, &refused, &steep);
    refused.extend((0..blade::cut_off_blobs(&mask, &ribbons)).map(|_| Refusal::Outside));
    accepted.sort_by(|a, b| a.0.root_x_m().total_cmp(&b.0.root_x_m()));
    let (blades, shapeless) = blade::finish(&accepted, timestamp_ns, &params.pose, &params.refine);
    refused.extend(shapeless);
    Steps { mask, outlines, parts, ribbons, skeletons, lifted, blades, refused }
}
