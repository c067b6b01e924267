//! A ribbon → the skeleton of a blade: its midrib and its width to both sides, in image pixels, at
//! evenly spaced stations from root to tip.

use common::geometry::{polyline, smooth};
use glam::Vec2;

use super::mask::Mask;
use super::ribbon::{End, Ribbon, Section};
use super::section::Expected;

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
pub fn trace(mask: &Mask, ribbon: &Ribbon) -> Option<Skeleton> {
    let mut sections = ribbon.sections.clone();
    if sections.len() < 8 {
        return None;
    }
    let last = sections.len() - 1;
    let tip = (ribbon.tip == End::Free).then(|| end(mask, &sections, last, -1));
    let root = (ribbon.root == End::Free).then(|| end(mask, &sections, 0, 1));
    // Beside a blunt end the cross-sections lean into its corners: it is carried on straight.
    if let Some(tip) = tip.as_ref().filter(|tip| !tip.pointed) {
        sections.truncate(sections.len() - tip.back);
    }
    if let Some(root) = root.as_ref().filter(|root| !root.pointed) {
        sections.drain(..root.back);
    }
    let beyond = |end: &Found| if end.pointed { end.length - end.back as f32 } else { end.length };
    let ends = Ends {
        root: root.as_ref().map_or(0.0, |end| -beyond(end)),
        tip: (sections.len() - 1) as f32 + tip.as_ref().map_or(0.0, beyond),
        pointed_root: root.is_some_and(|end| end.pointed),
        pointed_tip: tip.is_some_and(|end| end.pointed),
    };
    (sections.len() >= 8).then(|| finished(&sections, &ends))
}

/// Where root and tip are, in sections from the first, which may lie outside of them.
struct Ends {
    root: f32,
    tip: f32,
    /// Whether the blade narrows to a point there.
    pointed_root: bool,
    pointed_tip: bool,
}

struct Found {
    /// The section that it was looked for from, counted from the last one inward.
    back: usize,
    /// How far the end lies beyond that one, pixels.
    length: f32,
    /// Whether the blade narrows to a point there; else it ends across.
    pointed: bool,
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
    let back = BACK.max(wide as usize).min((sections.len() - 1) / 4);
    // The straight line through the last sound sections; the very last ones lean.
    let base = at(back);
    let outward = (base.mid - at(back * 3).mid).normalize_or(base.mid - at(back + 1).mid);
    let right = Vec2::new(-outward.y, outward.x);
    let across = if base.across.dot(right) < 0.0 { -right } else { right };
    let climb = (base.depth_m - at(back * 3).depth_m) / (base.mid.distance(at(back * 3).mid)).max(1.0);
    let mut widths = Vec::with_capacity(back + FORWARD);
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
        let width = section.covered_px(mask);
        if width < 0.05 {
            break;
        }
        widths.push(width);
    }
    let area: f32 = widths.iter().sum();
    let width = (2.0 * base.half_px).max(0.1);
    // Were it blunt, its last reading would lie no farther than the edge is smeared.
    let blunt = area / width;
    let pointed = widths.len() as f32 - blunt > (0.4 * blunt).max(2.2);
    let outer = if pointed { 0.0 } else { widths.iter().rev().nth(3).copied().unwrap_or(width) };
    let length = 2.0 * area / (width + outer);
    // No end lies far beyond the last reading of it.
    Found { back, length: length.min(widths.len() as f32 + 0.4 * width), pointed }
}

fn finished(sections: &[Section], ends: &Ends) -> Skeleton {
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
    let profile = |side: fn(&Section) -> Option<f32>| {
        let (mut values, mut weights) = (Vec::new(), Vec::new());
        for i in first..=last {
            let section = usize::try_from(i).ok().and_then(|i| Some((i, sections.get(i)?)));
            let beyond =
                i as f32 >= ends.tip && ends.pointed_tip || i as f32 <= ends.root && ends.pointed_root;
            let (value, weight) = match section {
                _ if beyond => (0.0, 1.0),
                Some((i, section)) => {
                    let seen = side(section).filter(|_| trusted(i));
                    (seen.unwrap_or(section.expected.half_px), if seen.is_some() { 1.0 } else { 0.01 })
                }
                None => (0.0, 0.0),
            };
            values.push(f64::from(value));
            weights.push(weight);
        }
        smooth::penalised(&values, &weights, WIDTH_WAVELENGTH_PX)
    };
    let left = profile(|section| section.measured.left_px.map(|edge| -edge));
    let right = profile(|section| section.measured.right_px);
    let straight = |from: usize, to: usize| {
        (sections[from].expected.mid - sections[to].expected.mid) / (from as f32 - to as f32).abs()
    };
    let (root_step, tip_step) = (straight(0, 4), straight(n - 1, n - 5));
    let climb = |from: usize, to: usize| {
        (sections[from].expected.depth_m - sections[to].expected.depth_m) / (from as f32 - to as f32).abs()
    };
    let (root_climb, tip_climb) = (climb(0, 8.min(n - 1)), climb(n - 1, n.saturating_sub(9)));
    let place = |i: f32| {
        let (first, last) = (&sections[0].expected, &sections[n - 1].expected);
        let beyond = i - (n - 1) as f32;
        if i < 0.0 {
            (first.mid - root_step * i, first.depth_m - root_climb * i, first.slope_m)
        } else if beyond > 0.0 {
            (last.mid + tip_step * beyond, last.depth_m + tip_climb * beyond, last.slope_m)
        } else {
            let k = (i as usize).min(n - 2);
            let (a, b, t) = (&sections[k].expected, &sections[k + 1].expected, i - k as f32);
            let between = |a: f32, b: f32| a + (b - a) * t;
            (a.mid.lerp(b.mid, t), between(a.depth_m, b.depth_m), between(a.slope_m, b.slope_m))
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
    let path: Vec<Vec2> = fine.iter().map(|i| place(*i).0).collect();
    let cumulative = polyline::cumulative_length(&path);
    let length_px = cumulative[cumulative.len() - 1];
    let positions = (0..STATIONS).map(|k| {
        let (segment, t) = polyline::locate(&cumulative, length_px * k as f32 / (STATIONS - 1) as f32);
        fine[segment] + (fine[segment + 1] - fine[segment]) * t
    });
    let mut stations: Vec<Station> = positions
        .map(|i| {
            let (mid, depth_m, slope_m) = place(i);
            let (left_px, right_px) = (sample(&left, i), sample(&right, i));
            Station { mid, across: Vec2::X, left_px, right_px, depth_m, slope_m }
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
