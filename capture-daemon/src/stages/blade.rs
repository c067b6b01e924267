//! Lifted skeleton → a blade of the library, or the reason why it is none.

use common::blade::{Blade, BladeId, Knot};
use common::refine::{RefineParams, Refined, refine};
use common::strand::motions_in_wind;
use glam::{Affine3A, Vec3};

use super::confidence::Evidence;
use super::lift::Lifted;
use super::margin::Margins;
use crate::frame::CameraPose;

/// Which blades are good enough to grow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AcceptParams {
    /// Shortest blade, metres.
    pub min_length_m: f32,
    /// Fewest pixels across the widest cross-section.
    pub min_pixels_across: f32,
    /// Lowest score, 0..=1.
    pub min_score: f32,
}

impl Default for AcceptParams {
    fn default() -> Self {
        Self { min_length_m: 0.03, min_pixels_across: 2.5, min_score: 0.05 }
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

/// An outline odder than this ([`Margins::oddity`]) is no blade's.
const MAX_ODDITY: f32 = 2.4;

/// How sure a blade is. Predictions are one standard deviation, calibrated against truth: see
/// [`super::confidence`].
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
    /// What both are told from.
    pub evidence: Evidence,
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

/// Why something that was seen is not a blade: a sentence that a visitor can act on. `docs/refusals.md`
/// lists all of them.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// So far off that a pixel spans too much of it.
    #[error("Please come closer: from so far away it cannot be measured.")]
    TooFar {
        /// Metres that a pixel spans.
        metres_per_px: f32,
    },
    /// Too few pixels across for a width.
    #[error("Please hold it a little closer: from here it looks too thin to be measured.")]
    TooNarrow {
        /// Pixels across.
        found: f32,
        /// Pixels needed.
        needed: f32,
    },
    /// Shorter than a blade may be.
    #[error("Please hold up a longer one: {:.0} mm can be seen of it, and {:.0} mm are needed.", found_m * 1e3, needed_m * 1e3)]
    TooShort {
        /// Length, metres.
        found_m: f32,
        /// Length needed, metres.
        needed_m: f32,
    },
    /// About as wide as it is long.
    #[error("Please hold up a single blade or leaf with its tip free: this is too broad for one.")]
    TooBroad,
    /// Its outline is that of a stretch of something larger: uneven, cut, or bent more tightly than it is
    /// wide.
    #[error("Please hold it clear of what is around it: its outline is not that of a single blade.")]
    Ragged {
        /// How odd its outline is, [`Margins::oddity`].
        oddity: f32,
    },
    /// Its midrib is not where anything was seen.
    #[error("Please spread the blades a little: too much of this one is hidden.")]
    Hidden,
    /// It runs straight away from the camera.
    #[error("Please turn it flat towards the camera: it points at the camera or away from it.")]
    TooSteep,
    /// It leaves the picture, or the region of interest.
    #[error("Please hold it nearer to the middle: a part of it is outside of the picture.")]
    Outside,
    /// Its errors would be too large.
    #[error(
        "Please hold it still, with the blades spread a little: it was not seen well enough to be measured."
    )]
    Unsure {
        /// Its score.
        score: f32,
        /// The score needed.
        needed: f32,
    },
    /// No midrib whose knots are a blade's.
    #[error("Please hold it up once more: its shape could not be followed.")]
    NoShape,
}

impl Refusal {
    /// A word for logs and programs, which stays when the sentence is put better.
    pub fn code(&self) -> &'static str {
        match self {
            Self::TooFar { .. } => "too_far",
            Self::TooNarrow { .. } => "too_narrow",
            Self::TooShort { .. } => "too_short",
            Self::TooBroad => "too_broad",
            Self::Ragged { .. } => "ragged",
            Self::Hidden => "hidden",
            Self::TooSteep => "too_steep",
            Self::Outside => "outside",
            Self::Unsure { .. } => "unsure",
            Self::NoShape => "no_shape",
        }
    }
}

/// Whether a lifted skeleton is good enough.
///
/// # Errors
/// The reason why it is not.
pub fn accept(
    lifted: &Lifted,
    margins: &Margins,
    evidence: &Evidence,
    params: &AcceptParams,
) -> Result<(), Refusal> {
    if lifted.metres_per_px > MAX_M_PER_PX {
        return Err(Refusal::TooFar { metres_per_px: lifted.metres_per_px });
    }
    if !lifted.within_region {
        return Err(Refusal::Outside);
    }
    if lifted.length_m > MAX_STEEPNESS * lifted.length_px * lifted.metres_per_px {
        return Err(Refusal::TooSteep);
    }
    if lifted.seen < MIN_SEEN {
        return Err(Refusal::Hidden);
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
    let oddity = margins.oddity(lifted.length_px, lifted.length_m / lifted.max_width_m());
    if oddity > MAX_ODDITY {
        return Err(Refusal::Ragged { oddity });
    }
    let score = score(lifted, evidence);
    if score < params.min_score {
        return Err(Refusal::Unsure { score, needed: params.min_score });
    }
    Ok(())
}

/// Refines skeletons in the blade frame and gives them their identities, in the capture that the frame at
/// `timestamp_ns` completed: the blades in the order of the skeletons, and why others are none, which is
/// [`Refusal::NoShape`] when the knots break an invariant of [`Blade`]. All at once, for their motions
/// are simulated side by side.
pub fn finish(
    accepted: &[(&Lifted, Evidence)],
    timestamp_ns: u64,
    pose: &CameraPose,
    params: &RefineParams,
) -> (Vec<CapturedBlade>, Vec<Refusal>) {
    let rotation = pose.blade_from_camera();
    let in_blade_frame = |lifted: &Lifted| {
        let root = lifted.knots_in_camera[0].position;
        let blade_from_camera = Affine3A::from_mat3_translation(rotation, -(rotation * root));
        (moved(&lifted.knots_in_camera, blade_from_camera), blade_from_camera.inverse())
    };
    let skeletons: Vec<_> = accepted.iter().map(|(lifted, _)| in_blade_frame(lifted)).collect();
    let midrib = |(knots, _): &(Vec<Knot>, Affine3A)| knots.iter().map(|knot| knot.position).collect();
    let midribs: Vec<Vec<Vec3>> = skeletons.iter().map(midrib).collect();
    let midribs: Vec<&[Vec3]> = midribs.iter().map(Vec::as_slice).collect();
    let motions = motions_in_wind(&midribs, MOTION_FRAMES);

    let (mut blades, mut refused) = (Vec::new(), Vec::new());
    for (((lifted, evidence), (skeleton, camera_from_blade)), motion) in
        accepted.iter().zip(skeletons).zip(&motions)
    {
        let Refined { knots, hausdorff_m } = refine(&skeleton, motion, params);
        let quality = quality(lifted, *evidence, hausdorff_m);
        let id = BladeId::of(timestamp_ns, blades.len() as u32, &knots);
        let name = format!("blade-{}", &id.to_string()[..8]);
        let knots_in_camera = moved(&knots, camera_from_blade);
        let size = [lifted.length_m, lifted.max_width_m()];
        match Blade::new(id, name, knots, size, timestamp_ns, quality.score) {
            Ok(blade) => blades.push(CapturedBlade { blade, knots_in_camera, quality }),
            Err(_) => refused.push(Refusal::NoShape),
        }
    }
    (blades, refused)
}

fn moved(knots: &[Knot], by: Affine3A) -> Vec<Knot> {
    let knot = |knot: &Knot| Knot {
        position: by.transform_point3(knot.position),
        across: by.transform_vector3(knot.across).normalize_or(Vec3::X),
        ..*knot
    };
    knots.iter().map(knot).collect()
}

fn quality(lifted: &Lifted, evidence: Evidence, hausdorff_m: f32) -> Quality {
    let [length_error_m, width_error_m] = evidence.errors_m();
    Quality {
        score: score(lifted, &evidence),
        pixels_across: lifted.pixels_across,
        hausdorff_m,
        length_error_m,
        width_error_m,
        evidence,
    }
}

/// 1 for a blade without error, ½ for one whose errors of length and width are 10 % together, one standard
/// deviation each; 0..=1.
fn score(lifted: &Lifted, evidence: &Evidence) -> f32 {
    const HALF: f32 = 0.1;
    let [length, width] = evidence.errors_m();
    let relative =
        length / lifted.length_m.max(f32::MIN_POSITIVE) + width / lifted.max_width_m().max(f32::MIN_POSITIVE);
    1.0 / (1.0 + relative / HALF)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::ribbon::End;

    /// A blade 0.15 m long and 9 mm wide that is seen well, half a metre away.
    fn good() -> (Lifted, Margins, Evidence) {
        let knot = |i: usize| Knot {
            position: Vec3::new(0.0, 0.15 * (0.5 - i as f32 / 127.0), 0.5),
            half_width_left: 0.0045 * (1.0 - i as f32 / 127.0),
            across: Vec3::X,
            half_width_right: 0.0045 * (1.0 - i as f32 / 127.0),
        };
        let lifted = Lifted {
            knots_in_camera: (0..128).map(knot).collect(),
            length_m: 0.15,
            pixels_across: 10.0,
            metres_per_px: 0.9e-3,
            length_px: 166.0,
            seen: 1.0,
            within_region: true,
        };
        let evidence = Evidence {
            metres_per_px: 0.9e-3,
            pixels_across: 10.0,
            length_px: 166.0,
            frames: 17,
            depth_noise_m: 2.1e-4,
            root: End::Free,
            tip: End::Free,
            root_blunt: 1.0,
            tip_blunt: 0.0,
            edges_seen: 1.0,
            hidden: 0.0,
            led: 0.0,
            steepness: 0.0,
        };
        let margins = Margins { both: 1.0, cut: 0.0, unseen: 0.0, waver_px: 0.15, turning: 0.01 };
        (lifted, margins, evidence)
    }

    /// What makes a blade worse.
    type Change = fn(&mut Lifted, &mut Margins, &mut Evidence);

    /// What becomes of the good blade after a change.
    fn verdict(change: Change) -> Result<(), Refusal> {
        let (mut lifted, mut margins, mut evidence) = good();
        change(&mut lifted, &mut margins, &mut evidence);
        accept(&lifted, &margins, &evidence, &AcceptParams::default())?;
        let accepted = [(&lifted, evidence)];
        let (_, refused) = finish(&accepted, 1, &CameraPose::default(), &RefineParams::default());
        refused.first().map_or(Ok(()), |refusal| Err(*refusal))
    }

    #[test]
    fn each_code_can_be_produced_and_is_documented() {
        assert_eq!(verdict(|_, _, _| ()), Ok(()));
        let document = include_str!("../../docs/refusals.md");
        let check = |code: &str, change: Change| {
            let refusal = verdict(change).expect_err("it is not good any more");
            assert_eq!(refusal.code(), code);
            assert!(refusal.to_string().starts_with("Please "), "{refusal}");
            let sentence = refusal.to_string();
            let advice = sentence.split(':').next().expect("a sentence has a beginning");
            let row = document.lines().find(|line| line.starts_with(&format!("| `{code}` |")));
            assert!(row.is_some_and(|row| row.contains(advice)), "{code} is not documented: {sentence}");
        };
        let checks: [(&str, Change); 10] = [
            ("too_far", |lifted, _, _| lifted.metres_per_px = 0.005),
            ("too_narrow", |lifted, _, _| lifted.pixels_across = 2.0),
            ("too_short", |lifted, _, _| (lifted.length_m, lifted.length_px) = (0.02, 22.0)),
            ("too_broad", |lifted, _, _| {
                lifted.knots_in_camera[3].half_width_left = 0.14;
            }),
            ("ragged", |_, margins, _| (margins.waver_px, margins.both) = (0.8, 0.3)),
            ("hidden", |lifted, _, _| lifted.seen = 0.3),
            ("too_steep", |lifted, _, _| lifted.length_px = 30.0),
            ("outside", |lifted, _, _| lifted.within_region = false),
            ("unsure", |_, _, evidence| {
                (evidence.edges_seen, evidence.hidden, evidence.depth_noise_m) = (0.0, 1.0, 3e-3);
                (evidence.tip_blunt, evidence.steepness) = (1.0, 2.0);
            }),
            ("no_shape", |lifted, _, _| lifted.knots_in_camera[0].position.x = f32::NAN),
        ];
        for (code, change) in checks {
            check(code, change);
        }
        let rows = document.lines().filter(|line| line.starts_with("| `")).count();
        assert_eq!(rows, checks.len(), "a code is documented that cannot be produced");
    }

    #[test]
    fn a_worse_view_gives_a_lower_score_and_larger_errors() {
        let (lifted, _, good) = good();
        let worse = Evidence { edges_seen: 0.4, root: End::Lost, ..good };
        let [before, after] = [good, worse].map(|evidence| quality(&lifted, evidence, 0.0));
        assert!(after.score < before.score, "{before:?} {after:?}");
        assert!(after.length_error_m > before.length_error_m, "{before:?} {after:?}");
        assert!((0.0..=1.0).contains(&after.score) && (0.5..=1.0).contains(&before.score), "{before:?}");
    }
}
