//! One cross-section of a blade: where its edges are and how deep it lies, told from what is before
//! it, behind it and beside it.

use glam::{Vec2, Vec4};

use super::mask::Mask;
use super::rank::{self, Few};

/// What is expected of a cross-section before it is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// On the midrib, image pixels.
    pub mid: Vec2,
    /// Unit vector to the right, across the midrib.
    pub across: Vec2,
    /// Half of the width from edge to edge, pixels.
    pub half_px: f32,
    /// Depth on the midrib, metres.
    pub depth_m: f32,
    /// Slope of depth across, metres a pixel.
    pub slope_m: f32,
    /// Where it is folded, and how sharply.
    pub fold: Fold,
    /// How far a reading may lie from that and still be of the blade, metres.
    pub tolerance_m: f32,
    /// How far an edge may lie from where it is expected, pixels.
    pub search_px: f32,
}

/// A fold in a cross-section: both halves slope away from it.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Fold {
    /// Offset along `across`, pixels.
    pub at_px: f32,
    /// What both halves slope more than the whole of it, metres a pixel away from the fold: positive where
    /// the fold is nearest, 0 for a flat section.
    pub slope_m: f32,
}

/// What lies at the middle of a cross-section.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Middle {
    /// The blade.
    Blade,
    /// Something before it.
    Hidden,
    /// Nothing can be seen.
    Unseen,
    /// Something behind it, or nothing within the window.
    Gone,
}

/// A measured cross-section.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// What lies at its middle.
    pub middle: Middle,
    /// Offset of the left edge along `across`, pixels; `None` where something hides it, it runs into another blade,
    /// or it lies beyond the border of the region.
    pub left_px: Option<f32>,
    /// Offset of the right edge.
    pub right_px: Option<f32>,
    /// Median depth of its inner readings, metres.
    pub depth_m: Option<f32>,
    /// Number of these readings.
    pub readings: u16,
    /// Σ t·(z − expected) and Σ t² over them: what the slope is fitted to.
    pub slope_moments: [f32; 2],
}

impl Measured {
    /// Of a section that nothing is known of but its middle.
    pub(super) fn nothing(middle: Middle) -> Self {
        Self { middle, left_px: None, right_px: None, depth_m: None, readings: 0, slope_moments: [0.0; 2] }
    }
}

const STEP_PX: f32 = 0.5;
/// Readings nearer to an edge than this are mixed with what is beside it.
const RIM_PX: f32 = 1.2;
/// A shadow without readings beside a nearer edge is no wider.
const SHADOW_PX: f32 = 5.0;
/// What ends nearer to the border of the region goes on beyond it, steps.
const BORDER: i32 = (1.5 / STEP_PX) as i32;
/// How far an edge that jitters from frame to frame is smeared.
const SMEAR_PX: f32 = 2.5;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Sight {
    Blade,
    Nearer,
    Farther,
    Unseen,
    Empty,
}

/// A cross-section laid over the mask, in steps of [`STEP_PX`] from its middle.
struct Line<'a> {
    expected: &'a Expected,
    mask: &'a Mask,
    /// Where the middle lies in the image, from the corner of the first pixel, and how far the next step is: x and
    /// y, in pixels times 2¹⁶. Whole numbers are the fastest to find a pixel by.
    from: [i32; 2],
    step: [i32; 2],
    /// What it shows at each step, looked up once.
    known: [Option<Sight>; 2 * KEPT_STEPS + 1],
}

/// Steps to either side that are kept.
const KEPT_STEPS: usize = 160;
/// Bits of [`Line`]'s numbers below a pixel.
const FRACTION: u32 = 16;

impl<'a> Line<'a> {
    fn new(expected: &'a Expected, mask: &'a Mask) -> Self {
        // Far outside of the image the cast saturates, and is far outside all the same.
        let fixed = |px: f32| (px * (1 << FRACTION) as f32) as i32;
        let Expected { mid, across, .. } = expected;
        Self {
            expected,
            mask,
            from: [fixed(mid.x + 0.5), fixed(mid.y + 0.5)],
            step: [fixed(across.x * STEP_PX), fixed(across.y * STEP_PX)],
            known: [None; 2 * KEPT_STEPS + 1],
        }
    }

    /// Where a step lies, as [`Self::from`].
    fn place(&self, step: i32) -> [i32; 2] {
        [0, 1].map(|axis| self.from[axis].wrapping_add(step.wrapping_mul(self.step[axis])))
    }

    /// The pixel at a step.
    fn index(&self, step: i32) -> Option<usize> {
        // What is negative is far too large as an unsigned number.
        let [x, y] = self.place(step).map(|at| (at >> FRACTION) as usize);
        (x < self.mask.width && y < self.mask.height).then(|| y * self.mask.width + x)
    }

    /// Whether a step lies within the region of interest.
    fn is_within_region(&self, step: i32) -> bool {
        let [x, y] = self.place(step).map(|at| (at >> FRACTION) as usize);
        let [x0, y0, x1, y1] = self.mask.region;
        x >= x0 && y >= y0 && x < x1 && y < y1
    }

    fn at(&mut self, step: i32) -> Sight {
        match self.known.get((step + KEPT_STEPS as i32) as usize) {
            Some(Some(known)) => *known,
            Some(None) => {
                let sight = self.look(step);
                self.known[(step + KEPT_STEPS as i32) as usize] = Some(sight);
                sight
            }
            None => self.look(step),
        }
    }

    fn look(&self, step: i32) -> Sight {
        let (mask, expected) = (self.mask, self.expected);
        let Some(index) = self.index(step) else { return Sight::Empty };
        let depth = mask.depth_m[index];
        if depth <= 0.0 || mask.occupancy[index] < 0.08 {
            return if mask.unseen[index] { Sight::Unseen } else { Sight::Empty };
        }
        let away = depth - expected.depth_at(step as f32 * STEP_PX);
        if away < -expected.tolerance_m {
            Sight::Nearer
        } else if away > expected.tolerance_m {
            Sight::Farther
        } else {
            Sight::Blade
        }
    }

    /// Share of the point at a step that is of the blade, bilinear; `against`: depth of what is behind its edge.
    fn coverage(&self, step: i32, against: Option<f32>) -> f32 {
        const HALF: i32 = 1 << (FRACTION - 1);
        let [x, y] = self.place(step).map(|at| at.wrapping_sub(HALF));
        let [column, row] = [x, y].map(|at| (at >> FRACTION) as usize);
        let below = |at: i32| (at & ((1 << FRACTION) - 1)) as f32 * (1.0 / (1 << FRACTION) as f32);
        let here = self.expected.depth_at(step as f32 * STEP_PX);
        self.expected.covered(self.mask, [column, row], [below(x), below(y)], here, against)
    }
}

impl Expected {
    /// Unit vector along the midrib, onward.
    pub(super) fn along(&self) -> Vec2 {
        Vec2::new(self.across.y, -self.across.x)
    }

    /// Depth at an offset along `across`, metres.
    pub(super) fn depth_at(&self, t: f32) -> f32 {
        let Fold { at_px, slope_m } = self.fold;
        self.depth_m + self.slope_m * t + slope_m * ((t - at_px).abs() - at_px.abs())
    }

    /// Measures the cross-section. O(width).
    pub fn measure(&self, mask: &Mask) -> Measured {
        let mut line = Line::new(self, mask);
        let middle = self.middle(&mut line);
        if middle != Middle::Blade {
            return Measured::nothing(middle);
        }
        let [left, right] = [-1, 1].map(|side| self.edge(&mut line, side));
        let inner = (
            left.map_or(-0.6 * self.half_px, |l| l + RIM_PX).min(0.0),
            right.map_or(0.6 * self.half_px, |r| r - RIM_PX).max(0.0),
        );
        // The casts round towards the middle.
        let (first, last) = (inner.0 as i32, inner.1 as i32);
        let mut few = Few::default();
        let mut many: Vec<f32> = Vec::new();
        let is_few = ((last - first) as usize) < rank::MOST;
        let mut moments = [0.0; 2];
        let mut before = usize::MAX;
        const STEPS_PER_PX: i32 = (1.0 / STEP_PX) as i32;
        for step in (first..=last).map(|k| k * STEPS_PER_PX) {
            let Some(index) = line.index(step) else { continue };
            if index == before || mask.occupancy[index] <= 0.85 {
                continue;
            }
            let [x, y] = line.place(step).map(|at| (at >> FRACTION) as f32);
            let t = (Vec2::new(x, y) - self.mid).dot(self.across);
            let away = mask.depth_m[index] - self.depth_at(t);
            if away.abs() <= self.tolerance_m {
                if is_few {
                    few.push(away);
                } else {
                    many.push(away);
                }
                moments = [moments[0] + t * away, moments[1] + t * t];
                before = index;
            }
        }
        many.sort_unstable_by(f32::total_cmp);
        let n = if is_few { few.len() } else { many.len() };
        let median = (n > 0).then(|| {
            let ranks = [(n - 1) / 2, n / 2];
            let [below, above] = if is_few { few.ranked(ranks) } else { ranks.map(|rank| many[rank]) };
            0.5 * (below + above)
        });
        Measured {
            middle,
            left_px: left,
            right_px: right,
            depth_m: median.map(|away| self.depth_m + away),
            readings: n as u16,
            slope_moments: moments,
        }
    }

    fn middle(&self, line: &mut Line) -> Middle {
        match line.at(0) {
            Sight::Blade => return Middle::Blade,
            Sight::Nearer => return Middle::Hidden,
            Sight::Farther | Sight::Unseen | Sight::Empty => {}
        }
        // The blade counts wherever it is seen near the middle: its midrib may be off a little.
        let reach = (0.5 * self.half_px).max(self.search_px.min(self.half_px + 1.0)).max(0.75);
        let count = (reach / STEP_PX) as i32;
        let mut has = |sight| (-count..=count).any(|step| line.at(step) == sight);
        if has(Sight::Blade) {
            Middle::Blade
        } else if has(Sight::Nearer) {
            Middle::Hidden
        } else if has(Sight::Unseen) {
            Middle::Unseen
        } else {
            Middle::Gone
        }
    }

    /// How far from the middle an edge may be, steps.
    fn search_limit(&self) -> i32 {
        ((self.half_px + self.search_px) / STEP_PX) as i32
    }

    /// Where the blade ends to one side (−1 left, 1 right), as an offset along `across`.
    fn edge(&self, line: &mut Line, side: i32) -> Option<f32> {
        const SMEAR: i32 = (SMEAR_PX / STEP_PX) as i32;
        let limit = self.search_limit();
        // From the blade's pixel nearest to the middle outward to the last one.
        let mut k = 0;
        while line.at(side * k) != Sight::Blade {
            k += 1;
            if k > limit {
                // All of it lies to the other side.
                return self.far_edge(line, side);
            }
        }
        let start = k;
        // A gap of 1.5 px is missed by no stride of 1.5 px.
        const GAP: i32 = (1.5 / STEP_PX) as i32;
        while k + GAP <= limit + SMEAR && line.at(side * (k + GAP)) == Sight::Blade {
            k += GAP;
        }
        let mut last = k;
        while k <= limit + SMEAR {
            match line.at(side * k) {
                Sight::Blade => last = k,
                _ if k - last > GAP => break,
                _ => {}
            }
            k += 1;
        }
        if last > limit || !line.is_within_region(side * (last + BORDER)) {
            return None;
        }
        let mut beyond = |steps: i32| line.at(side * (last + steps));
        const SHADOW: i32 = ((1.5 + SHADOW_PX) / STEP_PX) as i32;
        // Hidden, unless what is nearer begins only behind a stretch of plain background. It is no narrower than
        // a pixel.
        let background = (1..=8).find(|j| beyond(*j) == Sight::Empty);
        let mut hiding = (1..=background.map_or(SHADOW, |b| SHADOW.min(b + 1))).step_by(2);
        if hiding.any(|j| beyond(j) == Sight::Nearer) {
            return None;
        }
        // A shadow that what is nearer throws on the blade can be long at a slant.
        let shadowed = (2..=40).map(&mut beyond).find(|sight| !matches!(sight, Sight::Unseen | Sight::Blade));
        if shadowed == Some(Sight::Nearer) {
            return None;
        }
        // Beyond the smear of the edge stands what it is seen against.
        let mask = line.mask;
        let against = (4..=8).find_map(|j| {
            let step = side * (last + j);
            if line.at(step) != Sight::Farther {
                return None;
            }
            let index = line.index(step)?;
            (mask.occupancy[index] > 0.85).then(|| mask.depth_m[index])
        });
        // Its bilinear course summed at every pixel is all of it, where it runs along rows or columns, and
        // nearly so where it does not.
        let covered: f32 =
            (start + 1..=last + SMEAR).step_by(2).map(|k| line.coverage(side * k, against)).sum();
        Some(side as f32 * (start as f32 * STEP_PX + covered))
    }

    /// The edge to one side of a blade that lies wholly to the other side of the middle.
    fn far_edge(&self, line: &mut Line, side: i32) -> Option<f32> {
        let first = (1..=self.search_limit()).find(|k| line.at(-side * k) == Sight::Blade)?;
        // It begins there, unless something nearer hides what is before.
        let before = (first - 10..first).rev().map(|k| line.at(-side * k));
        let hidden = before.into_iter().find(|sight| *sight != Sight::Unseen) == Some(Sight::Nearer);
        (!hidden).then_some(-side as f32 * (first as f32 - 0.5) * STEP_PX)
    }

    /// Share of a point that is of the blade, bilinear between the pixel at column and row `[x, y]` and its
    /// neighbours to the right and below, for a point so far beyond its centre; `here`: depth expected there,
    /// `against`: depth of what is behind its edge.
    #[inline]
    fn covered(
        &self,
        mask: &Mask,
        [x, y]: [usize; 2],
        [fx, fy]: [f32; 2],
        here: f32,
        against: Option<f32>,
    ) -> f32 {
        let [columns, rows] = [mask.width, mask.height].map(|size| size.saturating_sub(1));
        if x >= columns || y >= rows {
            return 0.0;
        }
        let upper = y * mask.width + x;
        let lower = upper + mask.width;
        // The four pixels around are reckoned with together.
        let around = |of: &[f32]| {
            let (upper, lower) = (&of[upper..upper + 2], &of[lower..lower + 2]);
            Vec4::new(upper[0], upper[1], lower[0], lower[1])
        };
        let (occupancy, depth) = (around(&mask.occupancy), around(&mask.depth_m));
        let shares = match against {
            Some(behind) => {
                let per_m = 1.0 / (behind - here).max(1e-4);
                occupancy * ((Vec4::splat(behind) - depth) * per_m).max(Vec4::ZERO).min(Vec4::ONE)
            }
            None => {
                let near = (depth - here).abs().cmple(Vec4::splat(2.0 * self.tolerance_m));
                Vec4::select(near, occupancy, Vec4::ZERO)
            }
        };
        let (left, above) = (1.0 - fx, 1.0 - fy);
        shares.dot(Vec4::new(left * above, fx * above, left * fy, fx * fy))
    }

    /// ∫ coverage over the whole cross-section to the left of its middle and to the right, pixels: its half
    /// widths, however thin.
    pub(super) fn covered_px(&self, mask: &Mask) -> [f32; 2] {
        let reach = self.half_px + SMEAR_PX;
        let steps = (reach / 0.25).ceil() as i32;
        let coverage = |t: f32| {
            let point = self.mid + self.across * t;
            let corner = point.floor();
            // What is negative is far too large as an unsigned number.
            let pixel = corner.to_array().map(|at| at as i32 as usize);
            self.covered(mask, pixel, (point - corner).to_array(), self.depth_at(t), None)
        };
        [-0.25, 0.25].map(|step| (0..steps).map(|j| coverage((j as f32 + 0.5) * step)).sum::<f32>() * 0.25)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::drawn::{mask_of, section_along_row};

    #[test]
    fn an_edge_beyond_the_border_of_the_region_is_not_known() {
        let cases = [(40.0, [true; 2]), (7.6, [true; 2]), (6.0, [false, true]), (74.0, [true, false])];
        for (middle, known) in cases {
            let mask = mask_of((80, 40), |x, _| if (x as f32 - middle).abs() < 5.5 { 0.5 } else { 1.5 });
            let measured = section_along_row(&mask, Vec2::new(middle, 20.0), 5.5).measured;
            let edges = [measured.left_px, measured.right_px].map(|edge| edge.is_some());
            assert_eq!(edges, known, "at column {middle}");
        }
    }
}
