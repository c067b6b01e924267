//! A ribbon → the skeleton of a blade: its midrib and its width to both sides, in image pixels, at
//! evenly spaced stations from root to tip.

use common::geometry::{polyline, smooth};
use glam::Vec2;

use super::bend::Bend;
use super::mask::Mask;
use super::ribbon::{End, Ribbon, Section};
use super::section::Expected;
use crate::frame::CameraModel;

/// Stations of a skeleton: the raw skeleton that refinement starts from.
pub const STATIONS: usize = 128;

/// One cross-section.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Station {
    /// On the midrib, image pixels.
    pub mid: Vec2,
    /// Unit vector from the left edge to the right edge, across the midrib.
    pub across: Vec2,
    /// From the midrib to the left edge, pixels, ≥ 0.
    pub left_px: f32,
    /// From the midrib to the right edge, pixels, ≥ 0.
    pub right_px: f32,
    /// Depth on the midrib, metres.
    pub depth_m: f32,
    /// Slope of depth across, metres a pixel to the right.
    pub slope_m: f32,
    /// What the halves of a folded blade slope more, metres a pixel away from the midrib; 0 for a flat one.
    pub fold_m: f32,
}

/// A blade's midrib from root to tip, at [`STATIONS`] stations evenly along it.
#[derive(Clone, Debug, PartialEq)]
pub struct Skeleton {
    /// From root to tip.
    pub stations: Vec<Station>,
    /// Length of the midrib in the image, pixels.
    pub length_px: f32,
}

/// Half-height wavelength of the smoothing of widths along the midrib, pixels.
const WIDTH_WAVELENGTH_PX: f64 = 16.0;

/// Finds the ends of a ribbon and samples it evenly; `None` when it is too short.
///
/// Where an end is thinner than a pixel the blade is carried on by its taper. O(length · width).
///
/// # Source
/// Fan & Sheng §4.3 (matching symmetric points). Departures: true cross-sections of a midrib that
/// was fitted to them, widths as summed occupancy, which is right below a pixel.
pub fn trace(mask: &Mask, ribbon: &Ribbon, camera: &CameraModel) -> Option<Skeleton> {
    let mut sections = ribbon.sections.clone();
    if sections.len() < 8 {
        return None;
    }
    let mut bend = Bend::fit(&mut sections, camera);
    let last = sections.len() - 1;
    let tip = (ribbon.tip == End::Free).then(|| end(mask, &sections, last, -1));
    let root = (ribbon.root == End::Free).then(|| end(mask, &sections, 0, 1));
    // Beside a blunt end the cross-sections lean into its corners: it is carried on straight.
    let back = |end: &Option<Found>| end.as_ref().filter(|end| !end.pointed).map_or(0, |end| end.back);
    // One that the border cuts off has corners too, and nothing is known of what is beyond.
    let cut = || {
        let at = |k: usize| &sections[last.saturating_sub(k)].expected;
        curl(&at, sections.len()).min(at(sections.len() / 8).half_px as usize)
    };
    let (at_root, at_tip) = (back(&root), if ribbon.tip == End::Shared { cut() } else { back(&tip) });
    if let Some(bend) = &mut bend {
        bend.cut(at_root, at_tip);
    }
    sections.truncate(sections.len() - at_tip);
    sections.drain(..at_root);
    let beyond = |end: &Found| if end.pointed { end.length - end.back as f32 } else { end.length };
    let ends = Ends {
        root: root.as_ref().map_or(0.0, |end| -beyond(end)),
        tip: (sections.len() - 1) as f32 + tip.as_ref().map_or(0.0, beyond),
        pointed_root: root.as_ref().is_some_and(|end| end.pointed),
        pointed_tip: tip.as_ref().is_some_and(|end| end.pointed),
        widths_to_root: root.map_or_else(Vec::new, |end| end.widths),
        widths_to_tip: tip.map_or_else(Vec::new, |end| end.widths),
    };
    (sections.len() >= 8).then(|| finished(&sections, &ends, bend.as_ref()))
}

/// Where root and tip are, in sections from the first, which may lie outside of them.
struct Ends {
    root: f32,
    tip: f32,
    /// Whether the blade narrows to a point there.
    pointed_root: bool,
    pointed_tip: bool,
    /// Widths beyond the sections, [`Found::widths`].
    widths_to_root: Vec<f32>,
    widths_to_tip: Vec<f32>,
}

impl Ends {
    /// The width measured beyond the first or the last of `n` sections, where section `i` would be, and what
    /// it counts: where the end takes a part of it, it goes on about as it was.
    fn width_beyond(&self, i: isize, n: usize) -> Option<(f32, f64)> {
        let (widths, away) =
            if i < 0 { (&self.widths_to_root, -i) } else { (&self.widths_to_tip, i - (n as isize - 1)) };
        let after = usize::try_from(away).ok().filter(|after| *after > 0)?;
        let last = *widths.last()?;
        Some(widths.get(after + 1).map_or((last, 0.1), |width| (0.5 * (widths[after] + width), 1.0)))
    }
}

struct Found {
    /// The section that it was looked for from, counted from the last one inward.
    back: usize,
    /// How far the end lies beyond that one, pixels.
    length: f32,
    /// Whether the blade narrows to a point there; else it ends across.
    pointed: bool,
    /// Of an end across: its width at that section, half a pixel beyond it and then a pixel apart, up to where
    /// the end takes a part of it; pixels.
    widths: Vec<f32>,
}

/// Carries a blade on past section `last` (whose neighbours lie in direction `inward`), straight, and
/// finds where it ends: of a blade that narrows evenly to a point the area beyond a section is half
/// its width times the length that is left.
fn end(mask: &Mask, sections: &[Section], last: usize, inward: isize) -> Found {
    const BACK: usize = 6;
    const FORWARD: usize = 16;
    let at = |k: usize| {
        &sections[last.saturating_add_signed(inward * k as isize).min(sections.len() - 1)].expected
    };
    let wide = at(BACK).half_px + 3.0;
    let back = BACK.max(wide as usize).max(curl(&at, sections.len())).min((sections.len() - 1) / 4);
    // The straight line through the last sound sections; the very last ones lean.
    let base = at(back);
    let outward = (base.mid - at(back * 3).mid).normalize_or(base.mid - at(back + 1).mid);
    let right = Vec2::new(-outward.y, outward.x);
    let across = if base.across.dot(right) < 0.0 { -right } else { right };
    let climb = (base.depth_m - at(back * 3).depth_m) / (base.mid.distance(at(back * 3).mid)).max(1.0);
    // The width that the sections further in lead to.
    let taper = 2.0 * (base.half_px - at(2 * back).half_px) / back.max(1) as f32;
    let width = (2.0 * base.half_px).max(0.1);
    let led = |away: f32| (width + taper.clamp(-0.7, 0.1) * away).max(0.0);
    let mut widths = Vec::with_capacity(back + FORWARD);
    // Sums over the rows: of the share of that width that is covered, of what is lost of it, of what the
    // right side keeps more of than the left one.
    let (mut shares, mut lost, mut skew) = (Vec::with_capacity(back + FORWARD), 0.0, 0.0_f32);
    for k in 0..back + FORWARD {
        let away = k as f32 + 0.5;
        let section = Expected {
            mid: base.mid + outward * away,
            across,
            half_px: base.half_px.max(0.5),
            depth_m: base.depth_m + climb * away,
            tolerance_m: 2.0 * base.tolerance_m,
            ..*base
        };
        let [left, right] = section.covered_px(mask);
        let covered = left + right;
        if covered < 0.05 {
            break;
        }
        widths.push(covered);
        shares.push((covered / led(away).max(0.1)).min(1.0));
        lost += (led(away) - covered).min(covered).max(0.0);
        skew += right - left;
    }
    let area: f32 = widths.iter().sum();
    // Were it blunt, its last reading would lie no farther than the edge is smeared.
    let even = area / width;
    let long = widths.len() as f32 - even > (0.4 * even).max(2.2);
    // What ends across loses all of its width within that smear; what is cut aslant, one side of it first.
    let length: f32 = shares.iter().sum();
    let falling = shares.iter().filter(|share| (0.15..0.85).contains(*share)).count();
    let across_it = falling <= 3 || skew.abs() > 0.5 * lost;
    let blunt = !long || (led(length) > (0.4 * width).max(2.0) && across_it);
    let length = if blunt { length } else { 2.0 * even };
    // No end lies far beyond the last reading of it.
    let length = length.min(widths.len() as f32 + 0.4 * width);
    // What is wider has run into something else.
    let alone =
        widths.iter().enumerate().take_while(|(k, it)| **it < 1.1 * led(*k as f32 + 0.5) + 1.0).count();
    let whole = shares.iter().take(alone).take_while(|share| **share > 0.93).count().saturating_sub(2);
    widths.truncate(whole);
    if blunt {
        widths.insert(0, width)
    } else {
        widths.clear()
    }
    Found { back, length, pointed: !blunt, widths }
}

/// Sections at an end that turn into its corner more tightly than a blade bends. `at`: sections from the
/// end inward, of which there are `count`.
pub(super) fn curl<'a>(at: &impl Fn(usize) -> &'a Expected, count: usize) -> usize {
    const APART: usize = 4;
    /// Turn over half of the width, radians ([`super::margin::Margins::turning`]).
    const TIGHT: f32 = 0.2;
    /// Half widths from the end within which it does.
    const REACH: f32 = 2.5;
    let tight = |k: &usize| {
        let turn = at(*k).across.angle_to(at(k + APART).across).abs() / APART as f32;
        let half_px = at(k + APART).half_px;
        turn * half_px > TIGHT && (*k as f32) < REACH * half_px
    };
    (0..count / 4).rev().find(tight).map_or(0, |k| k + APART)
}

/// Sections whose direction is that of what is carried on beyond a blunt end.
const BLUNT_REACH: usize = 12;

fn finished(sections: &[Section], ends: &Ends, bend: Option<&Bend>) -> Skeleton {
    let n = sections.len();
    // Sections within this many of an end are cut off by it and say little about the width.
    let lean = 2.0;
    let trusted = |i: usize| {
        let (from_root, to_tip) = (i as f32 - ends.root, ends.tip - i as f32);
        (from_root >= lean || !ends.pointed_root) && (to_tip >= lean || !ends.pointed_tip)
    };
    // One sample a pixel over the whole length, the ends pinned where they are points.
    let first = ends.root.floor().min(0.0) as isize;
    let last = ends.tip.ceil().max((n - 1) as f32) as isize;
    // A crease to the right leaves more of the width to the left.
    let profile = |side: &dyn Fn(&Section) -> Option<f32>, crease: f32| {
        let (mut values, mut weights) = (Vec::new(), Vec::new());
        for i in first..=last {
            let section = usize::try_from(i).ok().and_then(|i| Some((i, sections.get(i)?)));
            let beyond =
                i as f32 >= ends.tip && ends.pointed_tip || i as f32 <= ends.root && ends.pointed_root;
            let (value, weight) = match section {
                _ if beyond => (0.0, 1.0),
                Some((i, section)) => {
                    let seen = side(section).filter(|_| trusted(i));
                    let value =
                        seen.unwrap_or(section.expected.half_px) + crease * section.expected.fold.at_px;
                    (value, if seen.is_some() { 1.0 } else { 0.01 })
                }
                None => ends.width_beyond(i, n).map_or((0.0, 0.0), |(width, weight)| {
                    let nearest = &sections[if i < 0 { 0 } else { n - 1 }].expected;
                    (0.5 * width + crease * nearest.fold.at_px, weight)
                }),
            };
            values.push(f64::from(value));
            weights.push(weight);
        }
        smooth::penalised(&values, &weights, WIDTH_WAVELENGTH_PX)
    };
    let left = profile(&|section| section.measured.left_px.map(|edge| -edge), 1.0);
    let right = profile(&|section| section.measured.right_px, -1.0);
    // On the midrib: the crease, where there is one.
    let places: Vec<Place> = sections.iter().map(|section| Place::of(&section.expected)).collect();
    let step = |from: usize, to: usize| places[from].steps_from(&places[to], (from as f32 - to as f32).abs());
    // What is carried on beyond a blunt end goes far: its direction is that of a longer stretch.
    let reach = |pointed: bool| if pointed { 4 } else { BLUNT_REACH.min(n - 1) };
    let (near_root, near_tip) = (reach(ends.pointed_root), reach(ends.pointed_tip));
    let root_step = Place { mid: step(0, near_root).mid, ..step(0, 8.min(n - 1)) };
    let tip_step = Place { mid: step(n - 1, n - 1 - near_tip).mid, ..step(n - 1, n.saturating_sub(9)) };
    // Where it was fitted, depth goes on beyond an end as it bends.
    let way = |from: Place, step: Place, count: f32| {
        (0..=count.max(0.0).ceil() as usize + 1).map(move |k| from.carried_on(&step, k as f32).mid)
    };
    let before = bend.map(|bend| bend.before(way(places[0], root_step, -ends.root)));
    let beyond = bend.map(|bend| bend.beyond(way(places[n - 1], tip_step, ends.tip - (n - 1) as f32)));
    let carried = |from: &Place, step: &Place, depths: &Option<Vec<f32>>, count: f32| {
        let mut place = from.carried_on(step, count);
        if let Some(depths) = depths {
            let k = (count as usize).min(depths.len() - 2);
            let deeper = depths[k] + (depths[k + 1] - depths[k]) * (count - k as f32) - depths[0];
            place.depth_m = from.depth_m + deeper;
        }
        place
    };
    let place = |i: f32| {
        let (first, last) = (&places[0], &places[n - 1]);
        let on = i - (n - 1) as f32;
        if i < 0.0 {
            carried(first, &root_step, &before, -i)
        } else if on > 0.0 {
            carried(last, &tip_step, &beyond, on)
        } else {
            let k = (i as usize).min(n - 2);
            places[k].between(&places[k + 1], i - k as f32)
        }
    };
    let sample = |profile: &[f64], i: f32| {
        let at = (i - first as f32).clamp(0.0, (profile.len() - 1) as f32);
        let k = (at as usize).min(profile.len() - 2);
        let t = f64::from(at - k as f32);
        ((profile[k] * (1.0 - t) + profile[k + 1] * t) as f32).max(0.0)
    };
    let fine: Vec<f32> = (0..4 * STATIONS)
        .map(|k| ends.root + (ends.tip - ends.root) * k as f32 / (4 * STATIONS - 1) as f32)
        .collect();
    let path: Vec<Vec2> = fine.iter().map(|i| place(*i).mid).collect();
    let cumulative = polyline::cumulative_length(&path);
    let length_px = cumulative[cumulative.len() - 1];
    let positions = (0..STATIONS).map(|k| {
        let (segment, t) = polyline::locate(&cumulative, length_px * k as f32 / (STATIONS - 1) as f32);
        fine[segment] + (fine[segment + 1] - fine[segment]) * t
    });
    let mut stations: Vec<Station> = positions
        .map(|i| {
            let Place { mid, depth_m, slope_m, fold_m } = place(i);
            let (left_px, right_px) = (sample(&left, i), sample(&right, i));
            Station { mid, across: Vec2::X, left_px, right_px, depth_m, slope_m, fold_m }
        })
        .collect();
    for k in 0..STATIONS {
        let along = stations[(k + 1).min(STATIONS - 1)].mid - stations[k.saturating_sub(1)].mid;
        let along = along.normalize_or(Vec2::NEG_Y);
        stations[k].across = Vec2::new(-along.y, along.x);
    }
    if ends.pointed_tip {
        let tip = &mut stations[STATIONS - 1];
        (tip.left_px, tip.right_px) = (0.0, 0.0);
    }
    Skeleton { stations, length_px }
}

/// Where a midrib passes, as in [`Station`].
#[derive(Clone, Copy)]
struct Place {
    mid: Vec2,
    depth_m: f32,
    slope_m: f32,
    fold_m: f32,
}

impl Place {
    fn of(expected: &Expected) -> Self {
        let at_px = expected.fold.at_px;
        Self {
            mid: expected.mid + expected.across * at_px,
            depth_m: expected.depth_at(at_px),
            slope_m: expected.slope_m,
            fold_m: expected.fold.slope_m,
        }
    }

    /// The way from `other` over so many steps, for one of them: slopes stay.
    fn steps_from(&self, other: &Self, count: f32) -> Self {
        let (mid, depth_m) = ((self.mid - other.mid) / count, (self.depth_m - other.depth_m) / count);
        Self { mid, depth_m, slope_m: 0.0, fold_m: 0.0 }
    }

    fn carried_on(&self, step: &Self, count: f32) -> Self {
        Self { mid: self.mid + step.mid * count, depth_m: self.depth_m + step.depth_m * count, ..*self }
    }

    fn between(&self, other: &Self, t: f32) -> Self {
        let between = |a: f32, b: f32| a + (b - a) * t;
        Self {
            mid: self.mid.lerp(other.mid, t),
            depth_m: between(self.depth_m, other.depth_m),
            slope_m: between(self.slope_m, other.slope_m),
            fold_m: between(self.fold_m, other.fold_m),
        }
    }
}
