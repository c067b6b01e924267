//! How far a measured blade may be from the true one, told from how it was seen.
//!
//! What the pipeline knows of a blade goes into a few numbers ([`Evidence`]); the errors that are
//! expected of its length and its width are products of powers of them, with exponents fitted to
//! synthetic blades of known size, such that 95 % of the true values lie within 1.96 predicted standard
//! deviations: a quantile regression (Koenker & Bassett 1978) of the logarithm of the error. The
//! example `calibrate` fits the constants anew and checks them on blades it has not seen.

use common::blade::Knot;

use super::lift::Lifted;
use super::ribbon::{End, Ribbon};
use super::section::Middle;

/// Numbers that an error is told from.
pub const FEATURES: usize = 15;
/// Their names, in order.
pub const FEATURE_NAMES: [&str; FEATURES] = [
    "one",
    "ln metres per pixel",
    "ln pixels across",
    "ln pixels long",
    "ln frames",
    "ln depth noise over its usual value",
    "root shared",
    "root lost",
    "tip shared or lost",
    "root blunt",
    "tip blunt",
    "share without both edges",
    "share hidden or not seen",
    "share led to its base",
    "steepness",
];

/// How a blade was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// Metres that a pixel spans at its mean depth.
    pub metres_per_px: f32,
    /// Pixels across its widest cross-section.
    pub pixels_across: f32,
    /// Length of the midrib in the image, pixels.
    pub length_px: f32,
    /// Frames added up.
    pub frames: u32,
    /// Noise of the mean depth, metres, one standard deviation.
    pub depth_noise_m: f32,
    /// How it ends at its root.
    pub root: End,
    /// How it ends at its tip.
    pub tip: End,
    /// Width at its root over the largest one, 0..=1: 0 where it ends in a point.
    pub root_blunt: f32,
    /// Width at its tip over the largest one, 0..=1.
    pub tip_blunt: f32,
    /// Share of its cross-sections of which both edges are seen, 0..=1.
    pub edges_seen: f32,
    /// Share of its cross-sections whose middle is behind something or without a reading, 0..=1.
    pub hidden: f32,
    /// Share of its cross-sections that lie where it must pass rather than where it was seen, 0..=1.
    pub led: f32,
    /// Metres of midrib over metres across the picture, less one; ≥ 0 but for rounding.
    pub steepness: f32,
}

impl Evidence {
    /// What is known of a blade that was followed as `ribbon` and lifted, from `frames` frames with a mean
    /// depth of noise `depth_noise_m`. O(sections).
    pub fn of(ribbon: &Ribbon, lifted: &Lifted, frames: u32, depth_noise_m: f32) -> Self {
        let sections = ribbon.sections.len().max(1) as f32;
        let both =
            |s: &&super::ribbon::Section| s.measured.left_px.is_some() && s.measured.right_px.is_some();
        let hidden =
            |s: &&super::ribbon::Section| matches!(s.measured.middle, Middle::Hidden | Middle::Unseen);
        let widest = lifted.max_width_m().max(f32::MIN_POSITIVE);
        let blunt = |knot: Option<&Knot>| knot.map_or(0.0, |knot| (knot.width() / widest).clamp(0.0, 1.0));
        let in_picture_m = (lifted.length_px * lifted.metres_per_px).max(f32::MIN_POSITIVE);
        Self {
            metres_per_px: lifted.metres_per_px,
            pixels_across: lifted.pixels_across,
            length_px: lifted.length_px,
            frames,
            depth_noise_m,
            root: ribbon.root,
            tip: ribbon.tip,
            root_blunt: blunt(lifted.knots_in_camera.first()),
            tip_blunt: blunt(lifted.knots_in_camera.last()),
            edges_seen: ribbon.sections.iter().filter(both).count() as f32 / sections,
            hidden: ribbon.sections.iter().filter(hidden).count() as f32 / sections,
            led: ribbon.sections.iter().filter(|s| s.guide_px.is_some()).count() as f32 / sections,
            steepness: lifted.length_m / in_picture_m - 1.0,
        }
    }

    /// The numbers named in [`FEATURE_NAMES`], all finite.
    pub fn features(&self) -> [f32; FEATURES] {
        let ln = |value: f32, low: f32, high: f32| value.clamp(low, high).ln();
        let yes = |fact: bool| if fact { 1.0 } else { 0.0 };
        [
            1.0,
            ln(self.metres_per_px / 1e-3, 0.1, 10.0),
            ln(self.pixels_across / 10.0, 0.05, 20.0),
            ln(self.length_px / 150.0, 0.05, 20.0),
            ln(self.frames as f32 / 17.0, 0.05, 4.0),
            ln(self.depth_noise_m / 3e-4, 0.3, 2.0),
            yes(self.root == End::Shared),
            yes(self.root == End::Lost),
            yes(self.tip != End::Free),
            self.root_blunt,
            self.tip_blunt,
            1.0 - self.edges_seen,
            self.hidden,
            self.led,
            self.steepness.clamp(0.0, 2.0),
        ]
    }

    /// Predicted errors of length and largest width, metres, one standard deviation each.
    pub fn errors_m(&self) -> [f32; 2] {
        let features = self.features();
        let predicted = |exponents: &[f32; FEATURES], measure_m: f32| {
            let ln: f32 = exponents.iter().zip(features).map(|(exponent, feature)| exponent * feature).sum();
            // Between a hundredth of a pixel and the measure itself: beyond what blades were fitted on, no
            // prediction is nothing or more than not knowing.
            ln.exp().max(0.01 * self.metres_per_px).min(measure_m)
        };
        let length_m = self.length_px * self.metres_per_px * (1.0 + self.steepness.max(0.0));
        [predicted(&LENGTH, length_m), predicted(&WIDTH, self.pixels_across * self.metres_per_px)]
    }
}

// Printed by `cargo run --release -p capture-daemon --example calibrate 120`; the first of each then raised, by
// 0.05 and by 0.095, and by 0.07 for shared roots, for the families whose share was lowest.
const LENGTH: [f32; FEATURES] = [
    -7.022, // one
    0.541,  // ln metres per pixel
    -0.639, // ln pixels across
    0.485,  // ln pixels long
    -0.204, // ln frames
    0.466,  // ln depth noise over its usual value
    0.863,  // root shared
    -0.606, // root lost
    -0.524, // tip shared or lost
    1.073,  // root blunt
    3.547,  // tip blunt
    3.307,  // share without both edges
    0.065,  // share hidden or not seen
    -3.036, // share led to its base
    5.042,  // steepness
];
const WIDTH: [f32; FEATURES] = [
    -8.616, // one
    1.724,  // ln metres per pixel
    -0.075, // ln pixels across
    0.180,  // ln pixels long
    -0.258, // ln frames
    0.373,  // ln depth noise over its usual value
    0.294,  // root shared
    3.535,  // root lost
    -0.842, // tip shared or lost
    0.146,  // root blunt
    0.292,  // tip blunt
    3.157,  // share without both edges
    0.654,  // share hidden or not seen
    -0.056, // share led to its base
    -0.597, // steepness
];
