//! Lifted skeleton → a blade of the library, or the reason why it is none.

use common::blade::{Blade, BladeId, Knot};
use common::refine::{RefineParams, Refined, refine};
use common::strand::motions_in_wind;
use glam::{Affine3A, Vec3};

use super::confidence::Evidence;
use super::lift::Lifted;
use super::margin::{Margins, SHOWN_PX};
use super::mask::{Mask, Region};
use super::ribbon::{End, Ribbon};
use crate::frame::{CameraModel, CameraPose};

/// Which blades are good enough to grow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AcceptParams {
    /// Shortest blade, metres.
    pub min_length_m: f32,
    /// Fewest pixels across the widest cross-section.
    pub min_pixels_across: f32,
    /// Lowest score, 0..=1.
    pub min_score: f32,
    /// Widest blade or leaf, metres.
    pub max_width_m: f32,
}

impl Default for AcceptParams {
    fn default() -> Self {
        Self { min_length_m: 0.03, min_pixels_across: 2.5, min_score: 0.05, max_width_m: 0.16 }
    }
}

/// Moments of a blade's motion in wind that its refinement looks at.
pub const MOTION_FRAMES: usize = 8;
/// A blade is at least this many times as long as it is wide.
const MIN_ASPECT: f32 = 1.2;
/// The midrib of a blade that was followed rightly lies on it but for gaps and what hides it.
const MIN_SEEN: f32 = 0.5;
/// Of one whose second edge is hidden nearly all along the width is not known: least share of its cross-sections
/// that show both.
const MIN_EDGES_SEEN: f32 = 0.1;
/// Coarsest picture that a blade is measured in, metres a pixel.
const MAX_M_PER_PX: f32 = 0.004;
/// A blade that runs more steeply away from the camera than this, on average, cannot be measured:
/// metres of midrib for a metre across the picture.
const MAX_STEEPNESS: f32 = 4.0;

/// Broader than blades of grass: a leaf, or a hand, a box, a sheet. A leaf narrows to its tip, and without
/// a step, metres.
const BROAD_M: f32 = 0.045;
/// How much its width changes at most over a metre of its midrib, but for the ends: a circle's by 2.7.
const MAX_FLANK: f32 = 3.0;
/// Width at a tip over the largest one from which on it is no tip.
const BLUNT: f32 = 0.75;
/// Share of its edges that may lie at the border of the region: more are where it goes on beyond it.
const MAX_AT_BORDER: f32 = 0.35;
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
    /// So far off that a pixel spans too much of it, or beyond the depth window or at its end.
    #[error("Please come closer: from so far away it cannot be measured.")]
    TooFar,
    /// Nearer than the depth window, or at its beginning.
    #[error("Please hold it farther away: so close to the camera it cannot be measured.")]
    TooNear,
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
    /// About as wide as it is long, wider than any leaf, or broad and not of a leaf's shape.
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
    /// No midrib whose knots are a blade's, or one that comes back over its own blade.
    #[error("Please hold it up once more: its shape could not be followed.")]
    NoShape,
}

impl Refusal {
    /// A word for logs and programs, which stays when the sentence is put better.
    pub fn code(&self) -> &'static str {
        match self {
            Self::TooFar => "too_far",
            Self::TooNear => "too_near",
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

    /// Whether what is refused looks like a blade, only not well enough.
    pub fn is_of_a_blade(&self) -> bool {
        match self {
            Self::TooFar
            | Self::TooNear
            | Self::TooNarrow { .. }
            | Self::TooShort { .. }
            | Self::TooSteep
            | Self::Unsure { .. } => true,
            Self::TooBroad | Self::Ragged { .. } | Self::Hidden | Self::Outside | Self::NoShape => false,
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
        return Err(Refusal::TooFar);
    }
    // What comes in from the border and ends as broad as it is anywhere is a piece of something longer.
    let shows_its_end = lifted.pixels_across >= SHOWN_PX;
    let is_piece = margins.from_border && shows_its_end && evidence.tip_blunt > BLUNT;
    if !lifted.within_region || margins.at_border > MAX_AT_BORDER || is_piece {
        return Err(Refusal::Outside);
    }
    if lifted.length_m > MAX_STEEPNESS * lifted.length_px * lifted.metres_per_px {
        return Err(Refusal::TooSteep);
    }
    if lifted.seen < MIN_SEEN || evidence.edges_seen < MIN_EDGES_SEEN {
        return Err(Refusal::Hidden);
    }
    if lifted.pixels_across < params.min_pixels_across {
        return Err(Refusal::TooNarrow { found: lifted.pixels_across, needed: params.min_pixels_across });
    }
    if lifted.length_m < params.min_length_m {
        return Err(Refusal::TooShort { found_m: lifted.length_m, needed_m: params.min_length_m });
    }
    let (width_m, aspect) = (lifted.max_width_m(), lifted.length_m / lifted.max_width_m());
    // Of what the border cuts off the tip is not known.
    let may_narrow = evidence.tip == End::Shared || evidence.tip_blunt < BLUNT;
    let is_leaf = || may_narrow && lifted.steepest_flank() < MAX_FLANK;
    if aspect < MIN_ASPECT || width_m > params.max_width_m || width_m > BROAD_M && !is_leaf() {
        return Err(Refusal::TooBroad);
    }
    if lifted.doubles_back() {
        return Err(Refusal::NoShape);
    }
    match margins.odd_at_window(MAX_ODDITY, evidence) {
        Some(0) => return Err(Refusal::TooNear),
        Some(_) => return Err(Refusal::TooFar),
        None => {}
    }
    if evidence.oddity > MAX_ODDITY {
        return Err(Refusal::Ragged { oddity: evidence.oddity });
    }
    let score = score(evidence);
    if score < params.min_score {
        return Err(Refusal::Unsure { score, needed: params.min_score });
    }
    Ok(())
}

/// Labels of the blobs that no blade was `followed` on and that run away from the camera so steeply that each
/// row of them lies at a depth of its own. O(pixels of the blobs without a blade).
pub fn steep_blobs(mask: &Mask, followed: &[&Ribbon], camera: &CameraModel) -> Vec<u16> {
    /// Metres of depth for a metre across the picture.
    const STEEP: f32 = 1.5;
    const DEEP_M: f32 = 0.03;
    let mut passed = vec![false; mask.blobs.regions.len() + 1];
    for ribbon in followed {
        blobs_of(mask, ribbon).for_each(|label| passed[usize::from(label)] = true);
    }
    let is_steep = |blob: &&Region| {
        let [x0, y0, x1, y1] = blob.bounds;
        let pixels = (y0..y1).flat_map(|y| y * mask.width + x0..y * mask.width + x1);
        let of_it = pixels.filter(|index| mask.blobs.of[*index] == blob.label);
        let mut depths: Vec<f32> = of_it.map(|index| mask.depth_m[index]).collect();
        depths.sort_unstable_by(f32::total_cmp);
        let at = |share: f32| depths[(share * (depths.len() - 1) as f32) as usize];
        let across_m = ((x1 - x0) as f32).hypot((y1 - y0) as f32) * at(0.5) / camera.fx as f32;
        let deep_m = at(0.95) - at(0.05);
        deep_m > DEEP_M && deep_m > STEEP * across_m
    };
    let alone = mask.blobs.regions.iter().filter(|blob| !passed[usize::from(blob.label)]);
    alone.filter(is_steep).map(|blob| blob.label).collect()
}

/// How many blobs nothing was followed on because the border of the region cuts them off nearly all along.
/// O(pixels of the region).
pub fn cut_off_blobs(mask: &Mask, ribbons: &[Ribbon]) -> usize {
    let passed: Vec<u16> = ribbons.iter().flat_map(|ribbon| blobs_of(mask, ribbon)).collect();
    let [x0, y0, x1, y1] = mask.region;
    let is_cut_off = |blob: &&Region| {
        let [u0, v0, u1, v1] = blob.bounds;
        let column = |x: usize| (v0..v1).filter(move |y| mask.blobs.of[y * mask.width + x] == blob.label);
        let row = |y: usize| (u0..u1).filter(move |x| mask.blobs.of[y * mask.width + x] == blob.label);
        let at_border = [
            (u0 == x0, column(u0).count()),
            (u1 == x1, column(u1 - 1).count()),
            (v0 == y0, row(v0).count()),
            (v1 == y1, row(v1 - 1).count()),
        ];
        let cut: usize =
            at_border.into_iter().filter(|(is_there, _)| *is_there).map(|(_, count)| count).sum();
        cut as f32 > MAX_AT_BORDER * (u1 - u0).max(v1 - v0) as f32
    };
    mask.blobs.regions.iter().filter(|blob| !passed.contains(&blob.label)).filter(is_cut_off).count()
}

/// The blobs that a ribbon passes, 0 for none, section by section.
fn blobs_of<'a>(mask: &'a Mask, ribbon: &'a Ribbon) -> impl Iterator<Item = u16> + 'a {
    let places = ribbon.sections.iter().filter_map(|section| mask.index_at(section.expected.mid));
    places.map(|index| mask.blobs.of[index])
}

/// What a visitor can do something about. Of the crumbs of `steep` blobs it is said once that these are
/// steep; and beside blades that were captured, what is more than twice as broad as all of them and no blade
/// is what holds them.
pub fn worth_saying(
    mask: &Mask,
    accepted: &[(&Lifted, Evidence)],
    refused: &[(&Lifted, &Ribbon, Refusal)],
    steep: &[u16],
) -> Vec<Refusal> {
    let widest = accepted.iter().map(|(lifted, _)| lifted.max_width_m()).reduce(f32::max);
    let holds = |lifted: &Lifted, reason: &Refusal| {
        !reason.is_of_a_blade() && widest.is_some_and(|widest| lifted.max_width_m() > 2.0 * widest)
    };
    let is_crumb = |ribbon: &Ribbon| blobs_of(mask, ribbon).any(|label| steep.contains(&label));
    let worth = refused.iter().filter(|(lifted, ribbon, reason)| !holds(lifted, reason) && !is_crumb(ribbon));
    steep.iter().map(|_| Refusal::TooSteep).chain(worth.map(|(_, _, reason)| *reason)).collect()
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
        score: score(&evidence),
        pixels_across: lifted.pixels_across,
        hausdorff_m,
        length_error_m,
        width_error_m,
        evidence,
    }
}

/// 1 for a blade without error and with an outline like no other thing's, ½ for such a one whose errors of
/// length and width are 10 % together, one standard deviation each, or whose outline's oddity is 1; 0..=1.
fn score(evidence: &Evidence) -> f32 {
    const HALF: f32 = 0.1;
    let [length, width] = evidence.errors_m();
    let relative = length / evidence.length_m.max(f32::MIN_POSITIVE)
        + width / evidence.max_width_m.max(f32::MIN_POSITIVE);
    1.0 / (1.0 + relative / HALF + evidence.oddity.powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let evidence = Evidence::good();
        let margins = Margins {
            tip_unseen: false,
            both: 1.0,
            cut: 0.0,
            at_window: [0.0; 2],
            at_border: 0.0,
            from_border: false,
            unseen: 0.0,
            waver_px: 0.15,
            turning: 0.01,
            turned: 0.2,
        };
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
        let checks: [(&str, Change); 11] = [
            ("too_far", |lifted, _, _| lifted.metres_per_px = 0.005),
            ("too_near", |_, margins, _| (margins.cut, margins.at_window) = (0.9, [0.8, 0.0])),
            ("too_narrow", |lifted, _, _| lifted.pixels_across = 2.0),
            ("too_short", |lifted, _, _| (lifted.length_m, lifted.length_px) = (0.02, 22.0)),
            ("too_broad", |lifted, _, _| {
                lifted.knots_in_camera[3].half_width_left = 0.14;
            }),
            ("ragged", |_, margins, evidence| {
                (margins.waver_px, margins.both) = (0.8, 0.3);
                evidence.oddity = margins.oddity(evidence);
            }),
            ("hidden", |lifted, _, _| lifted.seen = 0.3),
            ("too_steep", |lifted, _, _| lifted.length_px = 30.0),
            ("outside", |lifted, _, _| lifted.within_region = false),
            ("unsure", |_, _, evidence| {
                (evidence.max_width_m, evidence.tip_blunt) = (0.04, 1.0);
                (evidence.waver_px, evidence.oddity) = (20.0, 2.3);
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

    #[test]
    fn a_midrib_that_comes_back_over_its_own_blade_is_no_blade() {
        /// Up, and down again so far to the right, metres.
        fn hairpin(lifted: &mut Lifted, apart_m: f32) {
            for (i, knot) in lifted.knots_in_camera.iter_mut().enumerate() {
                let along_m = 0.15 * i as f32 / 127.0;
                let (x, y) = if along_m < 0.075 { (0.0, along_m) } else { (apart_m, 0.15 - along_m) };
                knot.position = Vec3::new(x, -y, 0.5);
            }
        }
        assert_eq!(verdict(|lifted, _, _| hairpin(lifted, 0.002)), Err(Refusal::NoShape));
        assert_eq!(verdict(|lifted, _, _| hairpin(lifted, 0.03)), Ok(()));
    }
}
