//! Ribbons → where blades are folded along their midrib.
//!
//! The midrib of many blades is a crease that their halves fall away from, and it need not run down the
//! middle between the edges. Where depth shows one, it is the midrib, and what is expected of every
//! cross-section is folded there: else edges that lie far behind the crease would be told to be of
//! something else.

use common::geometry::smooth::Penalised;
use glam::Vec2;

use super::mask::Mask;
use super::ribbon::{Ribbon, Section, tolerance_m};
use super::section::{Expected, Fold, Middle};
use super::settle::settle;

/// Half-height wavelength of the smoothing of midribs, as where ribbons are grown, pixels.
const MIDRIB_WAVELENGTH_PX: f64 = 28.0;
/// Half-height wavelength of the smoothing of the edges between which a crease is looked for, pixels.
const EDGE_WAVELENGTH_PX: f64 = 16.0;
/// Folded cross-sections that are looked at, at least.
const MIN_ROWS: usize = 20;
/// Where a crease may lie between the middle (0) and an edge (1).
const MAX_PLACE: f64 = 0.8;
/// Places to either side of the middle on the grid on which a crease is looked for.
const GRID: i32 = 8;
/// What a crease must explain of the sum of squares, in variances of a reading: flat blades reach 60.
const MIN_GAIN: f64 = 120.0;
/// What it must explain more than an even bend, in the same measure.
const MIN_LEAD: f64 = 25.0;
/// Tangent of the angle by which both halves slope, at least: 7°. Blades that bend show slighter ones where
/// they are looked at aslant.
const MIN_SLOPE: f64 = 0.12;
/// σ of the window along the ribbon in which a crease's place and sharpness are fitted, sections.
const WINDOW: f64 = 24.0;
/// How far place (in half widths) and sharpness (relative) vary along a blade, one standard deviation.
const PLACE_SPREAD: f64 = 0.15;
const SLOPE_SPREAD: f64 = 0.3;
/// Over how many pixels a crease is rounded by the sensor.
const ROUNDING_PX: f64 = 0.45;

/// A pixel at least this often occupied has a depth that is of the blade alone.
const INNER_OCCUPANCY: f32 = 0.85;
/// From the last such pixel on nothing is seen any more, pixels.
const RIM: i32 = 4;
/// By how much neighbouring readings of a blade differ at most, but for the noise, metres.
const STEP_M: f32 = 1e-3;
/// Fewest readings of a cross-section that tell of a crease.
const MIN_READINGS: usize = 5;

/// Finds the crease of each ribbon that has one, and measures these ribbons anew; all others stay as they
/// are. O(ribbons · length · width).
///
/// A section's depth is taken to be a + b·t + f·|t − c|, with a and b of its own, and f and c/half width
/// that vary slowly along the blade. There is a crease only where that leaves much less of the depth
/// unexplained than a plain section does, and less than a parabola, given the noise.
pub fn find(mask: &Mask, ribbons: &mut [Ribbon], focal_px: f32) {
    for ribbon in ribbons {
        let sections = &mut ribbon.sections;
        if !expect(mask, sections, focal_px) {
            // What looked like one before all of the blade was followed is none.
            let folds = sections.iter_mut().map(|section| &mut section.expected.fold);
            let before = folds.map(std::mem::take).filter(|fold| fold.slope_m != 0.0).count();
            if before == 0 {
                continue;
            }
        }
        for _ in 0..2 {
            settle(mask, sections, MIDRIB_WAVELENGTH_PX);
        }
    }
}

/// Expects sections to be folded, and measures them anew, if they have a crease; returns whether they
/// have.
fn expect(mask: &Mask, sections: &mut [Section], focal_px: f32) -> bool {
    let crease = Crease::search(mask, sections, focal_px);
    if let Some(crease) = &crease {
        crease.expect(mask, sections);
    }
    crease.is_some()
}

/// The same where the fold takes edges out of the depths that are tolerated; else they are found without,
/// and a leaf that is folded only in part is not lost where it is flat.
pub(super) fn expect_if_deep(mask: &Mask, sections: &mut [Section], focal_px: f32) {
    if let Some(crease) = Crease::search(mask, sections, focal_px)
        && crease.depth_m() > f64::from(tolerance_m(mask))
    {
        crease.expect(mask, sections);
    }
}

/// The readings of one cross-section.
struct Row {
    /// Which section.
    index: usize,
    /// Offsets from its middle to the right over its half width, and depths, metres.
    readings: Vec<(f64, f64)>,
    /// Half of its width, pixels.
    half_px: f64,
}

/// A crease all along a ribbon, one entry a section.
struct Crease {
    /// From its expected midrib to the middle between its edges, pixels.
    middle_px: Vec<f64>,
    /// Half of the width, pixels.
    half_px: Vec<f64>,
    /// Place of the crease from that middle to the right, half widths.
    place: Vec<f64>,
    /// As in [`Fold`], metres a pixel.
    slope_m: Vec<f64>,
    /// Depth in that middle, metres, and its slope across but for the fold, metres a pixel; `None` where it
    /// was not read.
    depths: Vec<Option<[f64; 2]>>,
}

impl Crease {
    /// The crease of a ribbon, if it has one.
    fn search(mask: &Mask, sections: &[Section], focal_px: f32) -> Option<Self> {
        let extents: Vec<Option<[f32; 2]>> = sections.iter().map(|section| extent(mask, section)).collect();
        if extents.iter().flatten().count() < MIN_ROWS {
            return None;
        }
        // Where they are not seen they are about where they were expected.
        let weights = extents.iter().map(|extent| [if extent.is_some() { 1.0 } else { 0.02 }; 2]).collect();
        let expected = |section: &Section| [-section.expected.half_px, section.expected.half_px];
        let edges = extents.iter().zip(sections);
        let edges = edges.map(|(extent, section)| extent.unwrap_or(expected(section)).map(f64::from));
        let edges = Penalised::new(weights, [EDGE_WAVELENGTH_PX; 2]).smooth(edges.collect());
        let middle_px: Vec<f64> = edges.iter().map(|[left, right]| 0.5 * (left + right)).collect();
        let half_px: Vec<f64> = edges.iter().map(|[left, right]| (0.5 * (right - left)).max(0.3)).collect();
        let row = |i: usize| Row::read(mask, sections, i, extents[i]?, middle_px[i], half_px[i]);
        let rows: Vec<Row> = (0..sections.len()).filter_map(row).collect();
        let depths = sections.iter().map(|section| f64::from(section.expected.depth_m));
        let metres_per_px = depths.sum::<f64>() / sections.len() as f64 / f64::from(focal_px);
        let (place, slope_m) = fit(&rows, sections.len(), MIN_SLOPE * metres_per_px)?;
        Some(Self { middle_px, half_px, place, slope_m, depths: Vec::new() }.with_depths(&rows))
    }

    /// Fits what the fold leaves of the depth: a plain section each.
    fn with_depths(mut self, rows: &[Row]) -> Self {
        // As in `settle`.
        let window = Window::new(9.0);
        let flat: Vec<(usize, Moments)> = rows
            .iter()
            .map(|row| {
                let fold =
                    |u: f64| self.slope_m[row.index] * rounded(row.half_px * (u - self.place[row.index])).0;
                (row.index, Moments::of(row.readings.iter().map(|&(u, z)| (row.half_px * u, z - fold(u)))))
            })
            .collect();
        self.depths = (0..self.place.len())
            .map(|i| {
                let here = flat.binary_search_by_key(&i, |(index, _)| *index).ok()?;
                let near = window.around(&flat, i);
                let (tz, tt) = near.fold((0.0, 0.0), |(tz, tt), (w, m)| (tz + w * m.tz, tt + w * m.tt));
                let (slope, Moments { t, z, .. }) = (tz / tt.max(1e-9), flat[here].1);
                // The fold's own share, at the middle.
                let fold = self.slope_m[i] * (self.place[i] * self.half_px[i]).abs();
                Some([z - slope * t + fold, slope])
            })
            .collect();
        self
    }

    /// How far an edge lies off what is expected of a flat section amid its readings, at most, metres.
    fn depth_m(&self) -> f64 {
        let edges = self.slope_m.iter().zip(&self.half_px).map(|(slope, half)| (0.7 * slope * half).abs());
        edges.fold(0.0, f64::max)
    }

    /// Where the fold of a section is, as seen from its expected midrib.
    fn fold(&self, i: usize) -> Fold {
        let at_px = self.middle_px[i] + self.place[i] * self.half_px[i];
        Fold { at_px: at_px as f32, slope_m: self.slope_m[i] as f32 }
    }

    /// Expects sections to be folded, and as wide as what hangs together, and measures them.
    fn expect(&self, mask: &Mask, sections: &mut [Section]) {
        for (i, section) in sections.iter_mut().enumerate() {
            let (by, half_px) = (self.middle_px[i] as f32, self.half_px[i] as f32);
            let Expected { mid, across, .. } = section.expected;
            let known = self.depths[i].map(|[depth, slope]| (depth as f32, slope as f32));
            let (depth_m, slope_m) =
                known.unwrap_or((section.expected.depth_at(by), section.expected.slope_m));
            let fold = Fold { at_px: self.fold(i).at_px - by, ..self.fold(i) };
            let expected =
                Expected { mid: mid + across * by, half_px, depth_m, slope_m, fold, ..section.expected };
            section.expected = expected;
            section.measured = expected.measure(mask);
            section.doubt();
        }
    }
}

/// From a section's middle to the last readings to both sides that hang together with it, pixels; `None`
/// unless both sides end before what lies farther off.
fn extent(mask: &Mask, section: &Section) -> Option<[f32; 2]> {
    let Expected { mid, across, half_px, .. } = section.expected;
    if section.measured.middle != Middle::Blade || section.guide_px.is_some() {
        return None;
    }
    let step_m = STEP_M + 4.0 * mask.depth_noise_m;
    let limit = (1.6 * half_px + 4.0) as i32;
    let start = mask.index_at(mid).filter(|index| mask.occupancy[*index] > INNER_OCCUPANCY)?;
    let mut ends = [0.0; 2];
    for (side, end) in [-1, 1].into_iter().zip(&mut ends) {
        let mut before = mask.depth_m[start];
        let mut free = false;
        for k in 1..=limit {
            let index = mask.index_at(mid + across * (side * k) as f32)?;
            let depth = mask.depth_m[index];
            if depth <= 0.0 || mask.occupancy[index] <= INNER_OCCUPANCY {
                // The rim that is seen in some of the frames is half of it.
                let next = mask.index_at(mid + across * (side * (k + RIM)) as f32);
                free = next.is_none_or(|index| mask.occupancy[index] < INNER_OCCUPANCY);
                *end = (side * k) as f32;
                break;
            }
            if (depth - before).abs() > step_m {
                return None;
            }
            before = depth;
        }
        if !free {
            return None;
        }
    }
    Some(ends)
}

impl Row {
    /// The inner readings of section `i`; `None` where they are too few.
    fn read(
        mask: &Mask,
        sections: &[Section],
        i: usize,
        [left, right]: [f32; 2],
        middle_px: f64,
        half_px: f64,
    ) -> Option<Self> {
        let Expected { mid, across, .. } = sections[i].expected;
        let along = Vec2::new(across.y, -across.x);
        let (before, after) = (i.saturating_sub(2), (i + 2).min(sections.len() - 1));
        let climb =
            (sections[after].expected.depth_m - sections[before].expected.depth_m) / (after - before) as f32;
        let mut readings = Vec::with_capacity((right - left) as usize);
        let mut last = usize::MAX;
        for k in left as i32 + 1..=right as i32 - 1 {
            let point = mid + across * k as f32;
            let Some(index) = mask.index_at(point) else { continue };
            if index == last || mask.occupancy[index] <= INNER_OCCUPANCY {
                continue;
            }
            last = index;
            // The pixel, as `index_at` finds it.
            let pixel = Vec2::new((point.x + 0.5) as i32 as f32, (point.y + 0.5) as i32 as f32);
            let away = pixel - mid;
            let depth = mask.depth_m[index] - climb * away.dot(along);
            readings.push(((f64::from(away.dot(across)) - middle_px) / half_px, f64::from(depth)));
        }
        (readings.len() >= MIN_READINGS).then_some(Self { index: i, readings, half_px })
    }

    /// What is left of two functions of the place across and of the depth once a plain section has taken its
    /// share: sums of the squares and products of φ φ, φ χ, χ χ, φ z, χ z, z z.
    fn gram(&self, functions: impl Fn(f64) -> [f64; 2]) -> [f64; 6] {
        let n = self.readings.len() as f64;
        let (mut sums, mut slopes) = ([0.0; 4], [0.0; 4]);
        let values = || {
            self.readings.iter().map(|&(u, z)| {
                let [a, b] = functions(u);
                [a, b, z - self.readings[0].1, u]
            })
        };
        for v in values() {
            for k in 0..4 {
                sums[k] += v[k];
                slopes[k] += v[3] * v[k];
            }
        }
        let mean_u = sums[3] / n;
        let spread = slopes[3] - mean_u * sums[3];
        let with_u: [f64; 3] = std::array::from_fn(|k| slopes[k] - mean_u * sums[k]);
        let mut gram = [0.0; 6];
        for v in values() {
            for (entry, (a, b)) in gram.iter_mut().zip(PAIRS) {
                *entry += v[a] * v[b];
            }
        }
        for (entry, (a, b)) in gram.iter_mut().zip(PAIRS) {
            *entry -= sums[a] * sums[b] / n + with_u[a] * with_u[b] / spread.max(1e-12);
        }
        gram
    }
}

const PAIRS: [(usize, usize); 6] = [(0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)];

/// Mean place and depth of some readings, and their second moments about them.
#[derive(Clone, Copy)]
struct Moments {
    t: f64,
    z: f64,
    tt: f64,
    tz: f64,
}

impl Moments {
    fn of(readings: impl Iterator<Item = (f64, f64)> + Clone) -> Self {
        let (n, t, z) = readings.clone().fold((0.0, 0.0, 0.0), |(n, a, b), (t, z)| (n + 1.0, a + t, b + z));
        let (t, z) = (t / n, z / n);
        let (tt, tz) =
            readings.fold((0.0, 0.0), |(tt, tz), (u, v)| (tt + (u - t) * (u - t), tz + (u - t) * (v - z)));
        Self { t, z, tt, tz }
    }
}

/// What two functions together explain of the depth, by their [`Row::gram`].
fn explained(&[pp, px, xx, pz, xz, _]: &[f64; 6]) -> f64 {
    let determinant = pp * xx - px * px;
    if determinant <= 1e-12 * pp * xx {
        return 0.0;
    }
    (pz * (pz * xx - xz * px) + xz * (xz * pp - pz * px)) / determinant
}

/// |t| as the sensor sees it, and its slope.
fn rounded(t: f64) -> (f64, f64) {
    let value = (t * t + ROUNDING_PX * ROUNDING_PX).sqrt();
    (value, t / value)
}

/// Weights of what is some sections away: a normal distribution, cut off at 3 σ.
struct Window(Vec<f64>);

impl Window {
    fn new(sigma: f64) -> Self {
        let away = |away: usize| (-0.5 * (away as f64 / sigma).powi(2)).exp();
        Self((0..(3.0 * sigma) as usize).map(away).collect())
    }

    /// Those of `entries`, in the order of their sections, that are near section `i`, and what each counts.
    fn around<'a, T>(&'a self, entries: &'a [(usize, T)], i: usize) -> impl Iterator<Item = (f64, &'a T)> {
        let first = entries.partition_point(|(index, _)| index + self.0.len() <= i);
        let near = entries[first..].iter().map(move |(index, entry)| (index.abs_diff(i), entry));
        near.map_while(|(away, entry)| Some((*self.0.get(away)?, entry)))
    }
}

/// Place (half widths) and sharpness (metres a pixel) of the crease at each of so many sections; `None` if
/// there is none.
fn fit(rows: &[Row], sections: usize, min_slope_m: f64) -> Option<(Vec<f64>, Vec<f64>)> {
    if rows.len() < MIN_ROWS {
        return None;
    }
    let total_of = |every: usize, functions: &dyn Fn(&Row, f64) -> [f64; 2]| {
        let grams = rows.iter().step_by(every).map(|row| row.gram(|u| functions(row, u)));
        grams.fold([0.0; 6], |sum, gram| std::array::from_fn(|k| sum[k] + gram[k]))
    };
    let total = |functions: &dyn Fn(&Row, f64) -> [f64; 2]| total_of(1, functions);
    let folded = |place: f64| {
        move |row: &Row, u: f64| {
            let (fold, slope) = rounded(row.half_px * (u - place));
            [fold, -row.half_px * slope]
        }
    };
    // What a function alone explains of the depth.
    let gain = |[square, _, _, product, ..]: [f64; 6]| product * product / square.max(1e-12);
    let freedom = rows.iter().map(|row| row.readings.len() - 2).sum::<usize>() as f64;
    // Most blades are flat: a crease that is to be found shows in a cubic too.
    let bent = total(&|row, u| {
        let t = row.half_px * u;
        [t * t, t * t * t]
    });
    let cubic = explained(&bent);
    if cubic < 0.5 * MIN_GAIN * (bent[5] - cubic).max(1e-12) / freedom {
        return None;
    }
    let places = (-GRID..=GRID).map(|k| MAX_PLACE * f64::from(k) / f64::from(GRID));
    let best = |a: &(f64, [f64; 6]), b: &(f64, [f64; 6])| gain(a.1).total_cmp(&gain(b.1));
    let (mut place, _) = places.map(|place| (place, total_of(3, &folded(place)))).max_by(best)?;
    let mut gram = total(&folded(place));
    for _ in 0..3 {
        let [pp, px, xx, pz, xz, _] = gram;
        let determinant = pp * xx - px * px;
        if determinant <= 0.0 {
            break;
        }
        let (slope, shift) = ((pz * xx - xz * px) / determinant, (xz * pp - pz * px) / determinant);
        let next = (place + (shift / slope).clamp(-0.1, 0.1)).clamp(-MAX_PLACE, MAX_PLACE);
        let next_gram = total(&folded(next));
        if gain(next_gram) <= gain(gram) {
            break;
        }
        (place, gram) = (next, next_gram);
    }
    let variance = (gram[5] - gain(gram)).max(1e-12) / freedom;
    let slope = gram[3] / gram[0];
    let leads = gain(gram) - gain(bent) > MIN_LEAD * variance;
    // A cubic has as much to fit with: what it explains better is curved across, and not folded.
    let is_sharp = gain(gram) > cubic;
    if gain(gram) < MIN_GAIN * variance || !leads || !is_sharp || slope.abs() < min_slope_m {
        return None;
    }
    Some(vary(rows, sections, place, slope, variance))
}

/// Lets place and sharpness vary along the blade about those of all of it, as far as the readings are worth.
fn vary(rows: &[Row], sections: usize, place: f64, slope: f64, variance: f64) -> (Vec<f64>, Vec<f64>) {
    let (mut places, mut slopes) = (vec![place; sections], vec![slope; sections]);
    let window = Window::new(WINDOW);
    for _ in 0..2 {
        let grams: Vec<(usize, [f64; 6])> = rows
            .iter()
            .map(|row| {
                let gram = row.gram(|u| {
                    let (fold, slope) = rounded(row.half_px * (u - places[row.index]));
                    [fold, -row.half_px * slope]
                });
                (row.index, gram)
            })
            .collect();
        let fitted: Vec<(f64, f64)> = (0..sections)
            .map(|i| {
                // What is known of all of the blade: sharpness, and sharpness times the way from here to there.
                let (of_slope, of_place) =
                    ((SLOPE_SPREAD * slope).powi(-2) * variance, (PLACE_SPREAD * slope).powi(-2) * variance);
                let known = (place - places[i]) * slope;
                let mut sums = [of_slope, 0.0, of_place, of_slope * slope, of_place * known];
                for (weight, gram) in window.around(&grams, i) {
                    sums.iter_mut().zip(gram).for_each(|(sum, entry)| *sum += weight * entry);
                }
                let [pp, px, xx, pz, xz] = sums;
                let determinant = pp * xx - px * px;
                let (sharp, shift) = ((pz * xx - xz * px) / determinant, (xz * pp - pz * px) / determinant);
                let sharp = (sharp / slope).clamp(0.3, 3.0) * slope;
                ((places[i] + (shift / sharp).clamp(-0.1, 0.1)).clamp(-MAX_PLACE, MAX_PLACE), sharp)
            })
            .collect();
        (places, slopes) = fitted.into_iter().unzip();
    }
    (places, slopes)
}

#[cfg(test)]
mod tests;
