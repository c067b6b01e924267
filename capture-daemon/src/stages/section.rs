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
    /// How far a reading may lie from that and still be of the blade, metres.
    pub tolerance_m: f32,
    /// How far an edge may lie from where it is expected, pixels.
    pub search_px: f32,
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

impl Expected {
    fn depth_at(&self, t: f32) -> f32 {
        self.depth_m + self.slope_m * t
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
        let middle = self.middle(mask);
        let nothing = Measured {
            middle,
            left_px: None,
            right_px: None,
            depth_m: None,
            readings: 0,
            slope_moments: [0.0; 2],
        };
        if middle != Middle::Blade {
            return nothing;
        }
        let left = self.edge(mask, -1.0);
        let right = self.edge(mask, 1.0);
        let inner = (
            left.map_or(-0.6 * self.half_px, |l| l + RIM_PX).min(0.0),
            right.map_or(0.6 * self.half_px, |r| r - RIM_PX).max(0.0),
        );
        let mut readings: Vec<(f32, f32)> = Vec::new();
        let mut before = usize::MAX;
        for k in inner.0.ceil() as i32..=inner.1.floor() as i32 {
            let Some(index) = mask.index_at(self.mid + self.across * k as f32) else { continue };
            let t = (mask.pixel(index) - self.mid).dot(self.across);
            let away = mask.depth_m[index] - self.depth_at(t);
            if index != before && mask.occupancy[index] > 0.85 && away.abs() <= self.tolerance_m {
                readings.push((t, away));
                before = index;
            }
        }
        let moments = readings.iter().fold([0.0; 2], |[ta, tt], (t, away)| [ta + t * away, tt + t * t]);
        let mut aways: Vec<f32> = readings.iter().map(|(_, away)| *away).collect();
        aways.sort_by(f32::total_cmp);
        let n = aways.len();
        let median = (n > 0).then(|| 0.5 * (aways[(n - 1) / 2] + aways[n / 2]));
        Measured {
            left_px: left,
            right_px: right,
            depth_m: median.map(|away| self.depth_m + away),
            readings: n as u16,
            slope_moments: moments,
            ..nothing
        }
    }

    fn middle(&self, mask: &Mask) -> Middle {
        // The blade counts wherever it is seen near the middle: its midrib may be off a little.
        let reach = (0.5 * self.half_px).max(self.search_px.min(self.half_px + 1.0)).max(0.75);
        let count = (reach / STEP_PX) as i32;
        let sights: Vec<Sight> = (-count..=count).map(|k| self.sight(mask, k as f32 * STEP_PX)).collect();
        let has = |sight| sights.contains(&sight);
        let at_middle = sights[count as usize];
        if at_middle == Sight::Blade {
            Middle::Blade
        } else if at_middle == Sight::Nearer {
            Middle::Hidden
        } else if has(Sight::Blade) {
            Middle::Blade
        } else if has(Sight::Nearer) {
            Middle::Hidden
        } else if has(Sight::Unseen) {
            Middle::Unseen
        } else {
            Middle::Gone
        }
    }

    /// Where the blade ends to one side, as an offset along `across`.
    fn edge(&self, mask: &Mask, side: f32) -> Option<f32> {
        let limit = self.half_px + self.search_px;
        // From the blade's pixel nearest to the middle outward to the last one.
        let mut k = 0;
        while self.sight(mask, side * k as f32 * STEP_PX) != Sight::Blade {
            k += 1;
            if k as f32 * STEP_PX > limit {
                // All of it lies to the other side.
                return self.far_edge(mask, side);
            }
        }
        let start = k;
        let mut last = k;
        while (k as f32) * STEP_PX <= limit + SMEAR_PX {
            match self.sight(mask, side * k as f32 * STEP_PX) {
                Sight::Blade => last = k,
                _ if (k - last) as f32 * STEP_PX > 1.5 => break,
                _ => {}
            }
            k += 1;
        }
        let reach = last as f32 * STEP_PX;
        if reach > limit {
            return None;
        }
        let beyond = |from: f32, to: f32, sight: Sight| {
            let steps = ((to - from) / STEP_PX) as i32;
            (0..=steps).any(|j| self.sight(mask, side * (reach + from + j as f32 * STEP_PX)) == sight)
        };
        if beyond(STEP_PX, 1.5 + SHADOW_PX, Sight::Nearer) {
            // Hidden, unless what is nearer begins only behind a stretch of plain background.
            let background =
                (1..=8).find(|j| self.sight(mask, side * (reach + *j as f32 * STEP_PX)) == Sight::Empty);
            let nearer =
                (1..=13).find(|j| self.sight(mask, side * (reach + *j as f32 * STEP_PX)) == Sight::Nearer);
            if background.is_none_or(|b| nearer.is_some_and(|n| n < b + 2)) {
                return None;
            }
        }
        // A shadow that what is nearer throws on the blade can be long at a slant.
        let shadowed = (2..=40)
            .map(|j| self.sight(mask, side * (reach + j as f32 * STEP_PX)))
            .find(|sight| !matches!(sight, Sight::Unseen | Sight::Blade));
        if shadowed == Some(Sight::Nearer) {
            return None;
        }
        // Beyond the smear of the edge stands what it is seen against.
        let against = (4..=8).find_map(|j| {
            let t = side * (reach + j as f32 * STEP_PX);
            let index = mask.index_at(self.mid + self.across * t)?;
            (self.sight(mask, t) == Sight::Farther && mask.occupancy[index] > 0.85)
                .then(|| mask.depth_m[index])
        });
        let from = start as f32 * STEP_PX;
        let steps = ((reach + SMEAR_PX - from) / 0.25).ceil() as i32;
        let covered = (0..steps)
            .map(|j| self.coverage(mask, side * (from + (j as f32 + 0.5) * 0.25), against))
            .sum::<f32>();
        Some(side * (from + 0.25 * covered))
    }

    /// The edge to one side of a blade that lies wholly to the other side of the middle.
    fn far_edge(&self, mask: &Mask, side: f32) -> Option<f32> {
        let limit = self.half_px + self.search_px;
        let steps = (limit / STEP_PX) as i32;
        let first = (1..=steps).find(|k| self.sight(mask, -side * *k as f32 * STEP_PX) == Sight::Blade)?;
        // It begins there, unless something nearer hides what is before.
        let before = (first - 10..first).map(|k| self.sight(mask, -side * k as f32 * STEP_PX));
        let hidden = before.rev().find(|sight| *sight != Sight::Unseen) == Some(Sight::Nearer);
        (!hidden).then_some(-side * (first as f32 - 0.5) * STEP_PX)
    }

    /// Share of a point that is of the blade, bilinear; `against`: depth of what is behind its edge.
    fn coverage(&self, mask: &Mask, t: f32, against: Option<f32>) -> f32 {
        let point = self.mid + self.across * t;
        let (x0, y0) = (point.x.floor(), point.y.floor());
        let (fx, fy) = (point.x - x0, point.y - y0);
        let here = self.depth_at(t);
        let at = |x: f32, y: f32| {
            let Some(index) = mask.index_at(Vec2::new(x, y)) else { return 0.0 };
            let (occupancy, depth) = (mask.occupancy[index], mask.depth_m[index]);
            if occupancy <= 0.0 {
                return 0.0;
            }
            match against {
                Some(behind) => occupancy * ((behind - depth) / (behind - here).max(1e-4)).clamp(0.0, 1.0),
                None if (depth - here).abs() <= 2.0 * self.tolerance_m => occupancy,
                None => 0.0,
            }
        };
        let upper = at(x0, y0) * (1.0 - fx) + at(x0 + 1.0, y0) * fx;
        let lower = at(x0, y0 + 1.0) * (1.0 - fx) + at(x0 + 1.0, y0 + 1.0) * fx;
        upper * (1.0 - fy) + lower * fy
    }

    /// ∫ coverage over the whole cross-section, pixels: its width, however thin.
    pub fn covered_px(&self, mask: &Mask) -> f32 {
        let reach = self.half_px + SMEAR_PX;
        let steps = (2.0 * reach / 0.25).ceil() as i32;
        (0..steps).map(|j| self.coverage(mask, -reach + (j as f32 + 0.5) * 0.25, None)).sum::<f32>() * 0.25
    }
}
