//! One cross-section of a blade: where its edges are and how deep it lies, told from what is before
//! it, behind it and beside it.

use glam::Vec2;

use super::mask::Mask;

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
    /// Offset of the left edge along `across`, pixels; `None` where something hides it or it runs
    /// into another blade.
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

/// What a cross-section shows at multiples of [`STEP_PX`], each looked up once.
struct Sights<'a> {
    expected: &'a Expected,
    mask: &'a Mask,
    known: [Option<Sight>; 2 * KEPT_STEPS + 1],
}

/// Steps to either side that are kept.
const KEPT_STEPS: usize = 160;

impl Sights<'_> {
    fn at(&mut self, step: i32) -> Sight {
        let t = step as f32 * STEP_PX;
        let Some(known) = self.known.get_mut((step + KEPT_STEPS as i32) as usize) else {
            return self.expected.sight(self.mask, t);
        };
        *known.get_or_insert_with(|| self.expected.sight(self.mask, t))
    }
}

impl Expected {
    /// Depth at an offset along `across`, metres.
    pub(super) fn depth_at(&self, t: f32) -> f32 {
        let Fold { at_px, slope_m } = self.fold;
        self.depth_m + self.slope_m * t + slope_m * ((t - at_px).abs() - at_px.abs())
    }

    fn sight(&self, mask: &Mask, t: f32) -> Sight {
        let Some(index) = mask.index_at(self.mid + self.across * t) else { return Sight::Empty };
        let depth = mask.depth_m[index];
        if depth <= 0.0 || mask.occupancy[index] < 0.08 {
            return if mask.unseen[index] { Sight::Unseen } else { Sight::Empty };
        }
        let away = depth - self.depth_at(t);
        if away < -self.tolerance_m {
            Sight::Nearer
        } else if away > self.tolerance_m {
            Sight::Farther
        } else {
            Sight::Blade
        }
    }

    /// Measures the cross-section. O(width).
    pub fn measure(&self, mask: &Mask) -> Measured {
        let mut sights = Sights { expected: self, mask, known: [None; 2 * KEPT_STEPS + 1] };
        let middle = self.middle(&mut sights);
        if middle != Middle::Blade {
            return Measured::nothing(middle);
        }
        let left = self.edge(&mut sights, -1);
        let right = self.edge(&mut sights, 1);
        let inner = (
            left.map_or(-0.6 * self.half_px, |l| l + RIM_PX).min(0.0),
            right.map_or(0.6 * self.half_px, |r| r - RIM_PX).max(0.0),
        );
        // The casts round towards the middle.
        let (first, last) = (inner.0 as i32, inner.1 as i32);
        let mut aways: Vec<f32> = Vec::with_capacity((last - first + 1) as usize);
        let mut moments = [0.0; 2];
        let mut before = usize::MAX;
        for k in first..=last {
            let point = self.mid + self.across * k as f32;
            let Some(index) = mask.index_at(point) else { continue };
            if index == before || mask.occupancy[index] <= 0.85 {
                continue;
            }
            let pixel = Vec2::new((point.x + 0.5) as i32 as f32, (point.y + 0.5) as i32 as f32);
            let t = (pixel - self.mid).dot(self.across);
            let away = mask.depth_m[index] - self.depth_at(t);
            if away.abs() <= self.tolerance_m {
                aways.push(away);
                moments = [moments[0] + t * away, moments[1] + t * t];
                before = index;
            }
        }
        aways.sort_unstable_by(f32::total_cmp);
        let n = aways.len();
        let median = (n > 0).then(|| 0.5 * (aways[(n - 1) / 2] + aways[n / 2]));
        Measured {
            middle,
            left_px: left,
            right_px: right,
            depth_m: median.map(|away| self.depth_m + away),
            readings: n as u16,
            slope_moments: moments,
        }
    }

    fn middle(&self, sights: &mut Sights) -> Middle {
        match sights.at(0) {
            Sight::Blade => return Middle::Blade,
            Sight::Nearer => return Middle::Hidden,
            Sight::Farther | Sight::Unseen | Sight::Empty => {}
        }
        // The blade counts wherever it is seen near the middle: its midrib may be off a little.
        let reach = (0.5 * self.half_px).max(self.search_px.min(self.half_px + 1.0)).max(0.75);
        let count = (reach / STEP_PX) as i32;
        let mut has = |sight| (-count..=count).any(|step| sights.at(step) == sight);
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

    /// Where the blade ends to one side (−1 left, 1 right), as an offset along `across`.
    fn edge(&self, sights: &mut Sights, side: i32) -> Option<f32> {
        let limit = self.half_px + self.search_px;
        // From the blade's pixel nearest to the middle outward to the last one.
        let mut k = 0;
        while sights.at(side * k) != Sight::Blade {
            k += 1;
            if k as f32 * STEP_PX > limit {
                // All of it lies to the other side.
                return self.far_edge(sights, side);
            }
        }
        let start = k;
        // A gap of 1.5 px is missed by no stride of 1.5 px.
        const STRIDE: i32 = 3;
        let stride_limit = limit + SMEAR_PX - STRIDE as f32 * STEP_PX;
        while k as f32 * STEP_PX <= stride_limit && sights.at(side * (k + STRIDE)) == Sight::Blade {
            k += STRIDE;
        }
        let mut last = k;
        while (k as f32) * STEP_PX <= limit + SMEAR_PX {
            match sights.at(side * k) {
                Sight::Blade => last = k,
                _ if (k - last) as f32 * STEP_PX > 1.5 => break,
                _ => {}
            }
            k += 1;
        }
        if last as f32 * STEP_PX > limit {
            return None;
        }
        let mut beyond = |steps: i32| sights.at(side * (last + steps));
        const SHADOW: i32 = ((1.5 + SHADOW_PX) / STEP_PX) as i32;
        // What is nearer is no narrower than a pixel.
        let every_other = (0..(SHADOW + 1) / 2).map(|k| 2 * k + 1);
        if let Some(nearer) = every_other.into_iter().find(|j| beyond(*j) == Sight::Nearer) {
            // Hidden, unless what is nearer begins only behind a stretch of plain background.
            let background = (1..=8).find(|j| beyond(*j) == Sight::Empty);
            if background.is_none_or(|b| nearer < b + 2) {
                return None;
            }
        }
        // A shadow that what is nearer throws on the blade can be long at a slant.
        let shadowed = (2..=40).map(&mut beyond).find(|sight| !matches!(sight, Sight::Unseen | Sight::Blade));
        if shadowed == Some(Sight::Nearer) {
            return None;
        }
        // Beyond the smear of the edge stands what it is seen against.
        let mask = sights.mask;
        let against = (4..=8).find_map(|j| {
            let step = side * (last + j);
            if sights.at(step) != Sight::Farther {
                return None;
            }
            let index = mask.index_at(self.mid + self.across * (step as f32 * STEP_PX))?;
            (mask.occupancy[index] > 0.85).then(|| mask.depth_m[index])
        });
        let from = start as f32 * STEP_PX;
        let steps = last - start + (SMEAR_PX / STEP_PX) as i32;
        // Its bilinear course summed at every pixel is all of it, where it runs along rows or columns, and
        // nearly so where it does not.
        let covered: f32 = (0..(steps + 1) / 2)
            .map(|j| self.coverage(mask, side as f32 * (from + (j as f32 + 0.5)), against))
            .sum();
        Some(side as f32 * (from + covered))
    }

    /// The edge to one side of a blade that lies wholly to the other side of the middle.
    fn far_edge(&self, sights: &mut Sights, side: i32) -> Option<f32> {
        let limit = self.half_px + self.search_px;
        let steps = (limit / STEP_PX) as i32;
        let first = (1..=steps).find(|k| sights.at(-side * k) == Sight::Blade)?;
        // It begins there, unless something nearer hides what is before.
        let before = (first - 10..first).rev().map(|k| sights.at(-side * k));
        let hidden = before.into_iter().find(|sight| *sight != Sight::Unseen) == Some(Sight::Nearer);
        (!hidden).then_some(-side as f32 * (first as f32 - 0.5) * STEP_PX)
    }

    /// Share of a point that is of the blade, bilinear; `against`: depth of what is behind its edge.
    fn coverage(&self, mask: &Mask, t: f32, against: Option<f32>) -> f32 {
        let point = self.mid + self.across * t;
        // From and to signed numbers the casts are the fastest.
        let inside = |at: f32, size: usize| at >= 0.0 && at <= (size as i32 - 1) as f32;
        if !(inside(point.x, mask.width) && inside(point.y, mask.height)) {
            return 0.0;
        }
        // The casts round down.
        let (x0, y0) = (point.x as i32, point.y as i32);
        let (fx, fy) = (point.x - x0 as f32, point.y - y0 as f32);
        let (x0, y0) = (x0 as usize, y0 as usize);
        let here = self.depth_at(t);
        let upper = y0 * mask.width + x0;
        let right = usize::from(x0 + 1 < mask.width);
        let lower = if y0 + 1 < mask.height { upper + mask.width } else { upper };
        // The four pixels around are reckoned with together.
        let around = |of: &[f32]| [of[upper], of[upper + right], of[lower], of[lower + right]];
        let (occupancy, depth) = (around(&mask.occupancy), around(&mask.depth_m));
        let shares: [f32; 4] = match against {
            Some(behind) => {
                let per_m = 1.0 / (behind - here).max(1e-4);
                std::array::from_fn(|k| occupancy[k] * ((behind - depth[k]) * per_m).clamp(0.0, 1.0))
            }
            None => {
                let reach = 2.0 * self.tolerance_m;
                std::array::from_fn(|k| if (depth[k] - here).abs() <= reach { occupancy[k] } else { 0.0 })
            }
        };
        let [upper_left, upper_right, lower_left, lower_right] = shares;
        (upper_left * (1.0 - fx) + upper_right * fx) * (1.0 - fy)
            + (lower_left * (1.0 - fx) + lower_right * fx) * fy
    }

    /// ∫ coverage over the whole cross-section to the left of its middle and to the right, pixels: its half
    /// widths, however thin.
    pub(super) fn covered_px(&self, mask: &Mask) -> [f32; 2] {
        let reach = self.half_px + SMEAR_PX;
        let steps = (reach / 0.25).ceil() as i32;
        [-0.25, 0.25].map(|step| {
            (0..steps).map(|j| self.coverage(mask, (j as f32 + 0.5) * step, None)).sum::<f32>() * 0.25
        })
    }
}
