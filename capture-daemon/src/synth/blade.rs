//! A synthetic blade: an outline after Fan & Sheng's five species, on a midrib that bends.
//!
//! Everything is arithmetic that IEEE 754 defines to the last bit, so that a seed gives the same
//! blade on every machine.

use glam::DVec3;

use super::motion::Pose;
use super::random::Random;

/// Cross-sections of the ribbon that is drawn: a multiple of the truth's intervals, plus one.
pub const SECTIONS: usize = 4 * 63 + 1;

/// The outline of a blade, after the species of Fan & Sheng, figure 10.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// Linear: nearly one width for most of its length.
    Slim,
    /// Widest in its lower third, tapering to the tip.
    Lanceolate,
    /// Leaf-like: widest in the middle.
    Elliptic,
    /// Wide and flat in the middle, narrowing fast to both ends.
    Bamboo,
    /// Ends in a long, narrow, sharp tip.
    Sharp,
}

/// All shapes.
pub const SHAPES: [Shape; 5] = [Shape::Slim, Shape::Lanceolate, Shape::Elliptic, Shape::Bamboo, Shape::Sharp];

impl Shape {
    /// Its name as in the truth file.
    pub fn name(self) -> &'static str {
        match self {
            Shape::Slim => "slim",
            Shape::Lanceolate => "lanceolate",
            Shape::Elliptic => "elliptic",
            Shape::Bamboo => "bamboo",
            Shape::Sharp => "sharp",
        }
    }

    /// The outline: (part of the length from the root, part of the greatest width), both 0..=1.
    fn outline(self) -> &'static [(f64, f64)] {
        match self {
            Shape::Slim => &[(0.0, 0.62), (0.2, 0.92), (0.4, 1.0), (0.65, 0.9), (0.85, 0.55), (1.0, 0.0)],
            Shape::Lanceolate => {
                &[(0.0, 0.3), (0.12, 0.72), (0.3, 1.0), (0.5, 0.86), (0.75, 0.45), (1.0, 0.0)]
            }
            Shape::Elliptic => {
                &[(0.0, 0.18), (0.08, 0.38), (0.25, 0.83), (0.5, 1.0), (0.75, 0.8), (0.92, 0.4), (1.0, 0.0)]
            }
            Shape::Bamboo => {
                &[(0.0, 0.16), (0.07, 0.5), (0.2, 0.92), (0.35, 1.0), (0.6, 0.96), (0.8, 0.62), (1.0, 0.0)]
            }
            Shape::Sharp => {
                &[(0.0, 0.7), (0.15, 0.95), (0.3, 1.0), (0.55, 0.72), (0.75, 0.32), (0.9, 0.1), (1.0, 0.0)]
            }
        }
    }

    /// Greatest width over length: the range that a random blade is drawn from.
    fn aspect_range(self) -> (f64, f64) {
        match self {
            Shape::Slim => (0.04, 0.07),
            Shape::Lanceolate => (0.07, 0.11),
            Shape::Elliptic => (0.10, 0.14),
            Shape::Bamboo => (0.08, 0.13),
            Shape::Sharp => (0.05, 0.09),
        }
    }

    /// Width at a part of the length from the root, over the greatest width.
    ///
    /// `along` and the result are 0..=1. Monotone between the points of the outline (Fritsch &
    /// Carlson 1980, with the harmonic mean of the neighbouring slopes).
    pub fn relative_width(self, along: f64) -> f64 {
        let outline = self.outline();
        let chord = |i: usize| (outline[i + 1].1 - outline[i].1) / (outline[i + 1].0 - outline[i].0);
        let last = outline.len() - 1;
        let slope = |i: usize| {
            let (before, after) = (chord(i.saturating_sub(1).min(last - 1)), chord(i.min(last - 1)));
            if before * after <= 0.0 { 0.0 } else { 2.0 * before * after / (before + after) }
        };
        let along = along.clamp(0.0, 1.0);
        let i = outline.iter().rposition(|&(position, _)| position <= along).unwrap_or(0).min(last - 1);
        let ((x0, y0), (x1, y1)) = (outline[i], outline[i + 1]);
        let (span, t) = (x1 - x0, (along - x0) / (x1 - x0));
        let (t2, t3) = (t * t, t * t * t);
        let value = (2.0 * t3 - 3.0 * t2 + 1.0) * y0
            + (t3 - 2.0 * t2 + t) * span * slope(i)
            + (3.0 * t2 - 2.0 * t3) * y1
            + (t3 - t2) * span * slope(i + 1);
        value.clamp(0.0, 1.0)
    }
}

/// One cross-section of a synthetic blade, camera frame, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// On the midrib.
    pub center: DVec3,
    /// Unit vector from the left edge to the right edge, as seen with the root below.
    pub across: DVec3,
    /// From the midrib to the left edge, along `across`, ≥ 0.
    pub half_width_left: f64,
    /// From the midrib to the right edge, along `across`, ≥ 0.
    pub half_width_right: f64,
    /// How far an edge lies off the line along `across` for each metre of its half width, at right angles
    /// to midrib and `across`: zero for a flat blade.
    pub fold: DVec3,
}

impl Section {
    /// The left edge.
    pub fn left(&self) -> DVec3 {
        self.center - (self.across - self.fold) * self.half_width_left
    }

    /// The right edge.
    pub fn right(&self) -> DVec3 {
        self.center + (self.across + self.fold) * self.half_width_right
    }
}

/// A blade whose every measure is known.
#[derive(Clone, Debug, PartialEq)]
pub struct SyntheticBlade {
    /// Its outline.
    pub shape: Shape,
    /// Arc length of the midrib, metres.
    pub length_m: f64,
    /// Greatest width, both half widths together, metres.
    pub max_width_m: f64,
    /// Slope of both halves, which fall away from the midrib to the edges: positive away from the camera,
    /// 0 for a flat blade, ±0.47 (25°) at most.
    pub fold: f64,
    /// [`SECTIONS`] cross-sections, root to tip, at equal steps of arc length.
    pub sections: Vec<Section>,
}

/// How a blade bends, as its midrib is followed from the root: angles in radians, as the tangent of
/// half the angle where they are large.
pub(super) struct Growth {
    /// Outline.
    pub(super) shape: Shape,
    /// Arc length, metres.
    pub(super) length_m: f64,
    /// Greatest width, metres.
    pub(super) max_width_m: f64,
    /// Lean of the root to the right, radians.
    pub(super) lean: f64,
    /// Lean of the root towards the camera, radians.
    pub(super) tilt: f64,
    /// Turn of the blade's face about its own axis at the root, radians.
    pub(super) yaw: f64,
    /// Total bend within the blade's face, to its right, radians.
    pub(super) bend_across: f64,
    /// Total bend out of the blade's face, to the side that faces the camera, radians.
    pub(super) bend_out: f64,
    /// Total twist about the midrib, radians.
    pub(super) twist: f64,
    /// Part of the width that lies left of the midrib, 0..=1.
    pub(super) left_share: f64,
    /// As in [`SyntheticBlade`].
    pub(super) fold: f64,
}

impl Growth {
    /// A random blade of a shape: 0.12 to 0.26 m long, moderately leaning, bent and twisted, symmetric and
    /// flat. Both bends grow towards the tip.
    pub(super) fn random(shape: Shape, random: &mut Random) -> Self {
        let length_m = random.range(0.12, 0.26);
        let (narrow, wide) = shape.aspect_range();
        Self {
            shape,
            length_m,
            max_width_m: length_m * random.range(narrow, wide),
            lean: random.range(-0.2, 0.2),
            tilt: random.range(-0.2, 0.2),
            yaw: random.range(-0.45, 0.45),
            bend_across: random.range(-0.5, 0.5),
            bend_out: random.range(-0.6, 0.6),
            twist: random.range(-0.3, 0.3),
            left_share: 0.5,
            fold: 0.0,
        }
    }

    /// The blade with its root at the camera frame's origin.
    pub(super) fn grow(&self) -> SyntheticBlade {
        let mut tangent = DVec3::NEG_Y;
        let mut across = DVec3::X;
        // Face normal, towards the camera.
        let mut normal = DVec3::NEG_Z;
        turn(&mut tangent, &mut across, self.lean);
        turn(&mut tangent, &mut normal, self.tilt);
        turn(&mut across, &mut normal, self.yaw);
        let steps = SECTIONS - 1;
        let step_m = self.length_m / steps as f64;
        let mut center = DVec3::ZERO;
        let sections = (0..SECTIONS)
            .map(|i| {
                let along = i as f64 / steps as f64;
                let relative = self.shape.relative_width(along);
                let section = Section {
                    center,
                    across,
                    half_width_left: self.left_share * self.max_width_m * relative,
                    half_width_right: (1.0 - self.left_share) * self.max_width_m * relative,
                    fold: -self.fold * normal,
                };
                // The weights 2·along add up to one over the blade.
                let share = 2.0 * (along + 0.5 / steps as f64) / steps as f64;
                turn(&mut tangent, &mut across, self.bend_across * share);
                turn(&mut tangent, &mut normal, self.bend_out * share);
                turn(&mut across, &mut normal, self.twist / steps as f64);
                center += tangent * step_m;
                section
            })
            .collect();
        SyntheticBlade {
            shape: self.shape,
            length_m: self.length_m,
            max_width_m: self.max_width_m,
            fold: self.fold,
            sections,
        }
    }
}

/// Turns `from` towards `to` (both unit, at right angles) by `angle` radians, |angle| < 1.2, and `to`
/// with it. The rotation is exact; its angle is right to the fifth order.
pub(super) fn turn(from: &mut DVec3, to: &mut DVec3, angle: f64) {
    let h = 0.5 * angle;
    // tan h, to h⁵: rational, so the same bits everywhere.
    let tan_half = h * (15.0 - h * h) / (15.0 - 6.0 * h * h);
    let scale = 1.0 / (1.0 + tan_half * tan_half);
    let (cos, sin) = ((1.0 - tan_half * tan_half) * scale, 2.0 * tan_half * scale);
    (*from, *to) = ((*from * cos + *to * sin).normalize(), (*to * cos - *from * sin).normalize());
}

impl SyntheticBlade {
    /// The cross-section at a place counted in steps from the root, 0..=[`SECTIONS`]−1, between two of
    /// those drawn.
    pub(super) fn section_at(&self, place: f64) -> Section {
        let i = (place as usize).min(SECTIONS - 2);
        let (a, b, t) = (&self.sections[i], &self.sections[i + 1], place - i as f64);
        let between = |a: f64, b: f64| a + (b - a) * t;
        Section {
            center: a.center.lerp(b.center, t),
            across: a.across.lerp(b.across, t).normalize(),
            half_width_left: between(a.half_width_left, b.half_width_left),
            half_width_right: between(a.half_width_right, b.half_width_right),
            fold: a.fold.lerp(b.fold, t),
        }
    }

    /// The part of it from a place, counted in steps from the root, to the tip.
    pub(super) fn cut_from(&self, place: f64) -> Self {
        let last = (SECTIONS - 1) as f64;
        let share = (last - place) / last;
        let at = |i: usize| (place + share * i as f64).min(last);
        let sections: Vec<Section> = (0..SECTIONS).map(|i| self.section_at(at(i))).collect();
        let widths = sections.iter().map(|section| section.half_width_left + section.half_width_right);
        let max_width_m = widths.fold(0.0, f64::max);
        Self { shape: self.shape, length_m: self.length_m * share, max_width_m, fold: self.fold, sections }
    }

    /// The same blade in a pose.
    pub(super) fn posed(&self, pose: &Pose) -> Self {
        let mut blade = self.clone();
        for section in &mut blade.sections {
            section.center = pose.apply(section.center);
            section.across = pose.rotation * section.across;
            section.fold = pose.rotation * section.fold;
        }
        blade
    }

    /// The same blade, moved.
    pub(super) fn moved(mut self, by: DVec3) -> Self {
        for section in &mut self.sections {
            section.center += by;
        }
        self
    }

    /// The smallest box that holds its edges: least and greatest corner, camera frame, metres.
    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        let edges = self.sections.iter().flat_map(|section| [section.left(), section.right()]);
        edges.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), point| {
            (low.min(point), high.max(point))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_outline_reaches_its_full_width_and_ends_in_a_point() {
        for shape in SHAPES {
            let widths: Vec<f64> = (0..=1000).map(|i| shape.relative_width(f64::from(i) / 1000.0)).collect();
            assert_eq!(widths.iter().copied().fold(0.0, f64::max), 1.0, "{shape:?}");
            assert_eq!(widths[1000], 0.0, "{shape:?}");
            assert!(widths[..950].iter().all(|&width| width > 0.02), "{shape:?}");
        }
    }

    #[test]
    fn a_grown_blade_has_its_length_and_unit_frames_at_right_angles() {
        for seed in 0..20 {
            let mut random = Random::new(seed, 0);
            let blade = Growth::random(SHAPES[seed as usize % 5], &mut random).grow();
            let steps = blade.sections.windows(2).map(|pair| pair[0].center.distance(pair[1].center));
            assert!((steps.sum::<f64>() - blade.length_m).abs() < 1e-9);
            for pair in blade.sections.windows(2) {
                let tangent = (pair[1].center - pair[0].center).normalize();
                assert!((pair[1].across.length() - 1.0).abs() < 1e-9);
                assert!(tangent.dot(pair[1].across).abs() < 1e-6);
                // Seen with the root below, left is left.
                assert!(pair[1].across.x > 0.0);
            }
        }
    }

    #[test]
    fn a_turn_is_by_its_angle() {
        for angle in [-0.6, -0.1, 0.0, 0.3, 0.6_f64] {
            let (mut from, mut to) = (DVec3::X, DVec3::Y);
            turn(&mut from, &mut to, angle);
            assert!((from - DVec3::new(angle.cos(), angle.sin(), 0.0)).length() < 1e-4, "{angle}");
            assert!(from.dot(to).abs() < 1e-15);
        }
    }
}
