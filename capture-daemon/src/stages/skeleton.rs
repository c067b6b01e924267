//! A single blade's outline → its midrib and its width to both sides, in image pixels.

use common::geometry::{polyline, smooth};
use glam::Vec2;

use super::mask::Mask;
use super::partition::{Part, Side};

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
}

/// A blade's midrib from root to tip, at [`STATIONS`] stations evenly along it.
#[derive(Clone, Debug, PartialEq)]
pub struct Skeleton {
    /// The blob's label in the mask.
    pub label: u16,
    /// From root to tip.
    pub stations: Vec<Station>,
    /// Length of the midrib in the image, pixels.
    pub length_px: f32,
}

/// Half-height wavelength of the smoothing along the midrib, pixels: twists and bends of a blade are
/// longer, the jitter of edges is shorter.
const MIDRIB_WAVELENGTH_PX: f64 = 36.0;
/// The same for widths.
const WIDTH_WAVELENGTH_PX: f64 = 16.0;
/// Rounds of cross-sections. The midrib moves by less than 0.05 px after the third.
const ROUNDS: usize = 4;
/// Step of the sum across, pixels.
const ACROSS_STEP_PX: f32 = 0.25;
/// How far past its side an edge is looked for: the fringe of a jittering edge.
const FRINGE_PX: f32 = 2.5;

/// Finds midrib and half widths of one blade; `None` when it is too small to have any.
///
/// Points of both sides at the same distance from the root are matched; then true cross-sections of
/// the midrib so far are taken, in which the occupied length to each side is the half width, and the
/// midrib moves to their middle, until it rests. Where the tip is thinner than a pixel it is carried
/// on by its taper. O(stations · (outline + width)).
///
/// # Source
/// Fan & Sheng §4.3 (matching symmetric points). Departures: matching by distance from the root
/// rather than by index, cross-sections, widths as summed occupancy, which is right below a pixel.
pub fn trace(mask: &Mask, part: &Part) -> Option<Skeleton> {
    let mut midrib = matched_sides(part)?;
    let count = (polyline::length(&midrib).round() as usize).max(8);
    midrib = polyline::resample(&midrib, count);
    for _ in 0..ROUNDS {
        let (mids, weights) = middles(&cross_sections(mask, part, &midrib));
        midrib = polyline::resample(&smoothed(&mids, &weights), count);
    }
    let sections = cross_sections(mask, part, &midrib);
    let ends = find_ends(mask, part, &sections)?;
    Some(finished(part.label, &sections, ends))
}

/// Midpoints of the points on both sides at equal distance from the root.
fn matched_sides(part: &Part) -> Option<Vec<Vec2>> {
    let lowest = |side: &Side| side.flow_px.first().copied();
    let from = lowest(&part.left)?.max(lowest(&part.right)?);
    let to = part.left.flow_px.last().copied()?;
    let levels = ((to - from) as usize).max(1);
    if to - from < 6.0 {
        return None;
    }
    let at = |side: &Side, level: f32| {
        // Flow can waver; the first point that reaches the level is the one that counts.
        let index = side.flow_px.iter().position(|flow| *flow >= level).unwrap_or(side.points.len() - 1);
        let before = index.saturating_sub(1);
        let (low, high) = (side.flow_px[before], side.flow_px[index]);
        let t = if high > low { ((level - low) / (high - low)).clamp(0.0, 1.0) } else { 1.0 };
        side.points[before].lerp(side.points[index], t)
    };
    let middle = |level: f32| at(&part.left, level).midpoint(at(&part.right, level));
    let mut midrib: Vec<Vec2> =
        (0..=levels).map(|k| middle(from + (to - from) * k as f32 / levels as f32)).collect();
    if part.cut {
        midrib[0] = part.left.points[0].midpoint(part.right.points[0]);
    }
    midrib.dedup_by(|a, b| a.distance(*b) < 1e-3);
    (midrib.len() >= 2).then_some(midrib)
}

/// A cross-section before it is smoothed.
#[derive(Clone, Copy, Debug)]
struct Section {
    origin: Vec2,
    across: Vec2,
    /// Where the edges are, along `across` from `origin`.
    left: f32,
    right: f32,
}

impl Section {
    fn width(&self) -> f32 {
        self.right - self.left
    }
}

fn tangents(points: &[Vec2]) -> Vec<Vec2> {
    let n = points.len();
    (0..n)
        .map(|i| (points[(i + 1).min(n - 1)] - points[i.saturating_sub(1)]).normalize_or(Vec2::NEG_Y))
        .collect()
}

/// The right-hand normal of a direction in the image (y down).
fn right_of(direction: Vec2) -> Vec2 {
    Vec2::new(-direction.y, direction.x)
}

fn cross_sections(mask: &Mask, part: &Part, midrib: &[Vec2]) -> Vec<Section> {
    let across = tangents(midrib).into_iter().map(right_of);
    midrib.iter().zip(across).map(|(origin, across)| cross_section(mask, part, *origin, across)).collect()
}

fn cross_section(mask: &Mask, part: &Part, origin: Vec2, across: Vec2) -> Section {
    let reach = |side: &Side, direction: Vec2| {
        let hit = nearest_hit(origin, direction, &side.points);
        let fringe = if part.cut { 1.0 } else { FRINGE_PX };
        occupied_length(mask, part.label, origin, direction, hit.unwrap_or(0.0) + fringe)
    };
    Section { origin, across, left: -reach(&part.left, -across), right: reach(&part.right, across) }
}

/// How far along `direction` from `origin` the polyline is first met.
fn nearest_hit(origin: Vec2, direction: Vec2, points: &[Vec2]) -> Option<f32> {
    let hit = |pair: &[Vec2]| {
        let (a, edge) = (pair[0] - origin, pair[1] - pair[0]);
        let parallel = direction.perp_dot(edge);
        let along = a.perp_dot(edge) / parallel;
        let t = a.perp_dot(direction) / parallel;
        (parallel != 0.0 && along > 0.0 && (0.0..=1.0).contains(&t)).then_some(along)
    };
    points.windows(2).filter_map(hit).min_by(f32::total_cmp)
}

/// ∫ occupancy from `origin` along `direction`, pixels.
fn occupied_length(mask: &Mask, label: u16, origin: Vec2, direction: Vec2, limit: f32) -> f32 {
    let steps = (limit / ACROSS_STEP_PX).ceil() as usize;
    let at = |k: usize| mask.occupancy_at(label, origin + direction * ((k as f32 + 0.5) * ACROSS_STEP_PX));
    (0..steps).map(at).sum::<f32>() * ACROSS_STEP_PX
}

/// The middles of the sections, with weights for smoothing: narrow sections say little.
fn middles(sections: &[Section]) -> (Vec<Vec2>, Vec<f64>) {
    sections
        .iter()
        .map(|section| {
            let weight = f64::from((section.width() / 2.0).clamp(0.0, 1.0));
            (section.origin + section.across * (0.5 * (section.left + section.right)), weight)
        })
        .unzip()
}

fn smoothed(points: &[Vec2], weights: &[f64]) -> Vec<Vec2> {
    let axis = |of: fn(&Vec2) -> f32| {
        let values: Vec<f64> = points.iter().map(|p| f64::from(of(p))).collect();
        smooth::penalised(&values, weights, MIDRIB_WAVELENGTH_PX)
    };
    axis(|p| p.x).into_iter().zip(axis(|p| p.y)).map(|(x, y)| Vec2::new(x as f32, y as f32)).collect()
}

/// Where root and tip are, in stations of `sections` from its first, which may lie outside of them.
struct Ends {
    root: f32,
    tip: f32,
    /// Whether the blade narrows to a point at its root too.
    pointed_root: bool,
}

fn find_ends(mask: &Mask, part: &Part, sections: &[Section]) -> Option<Ends> {
    let n = sections.len();
    let spacing = sections[0].origin.distance(sections[n - 1].origin) / (n - 1) as f32;
    if spacing <= 0.0 {
        return None;
    }
    let tip = end(mask, part, sections, n - 1, -1);
    let root = if part.cut { None } else { Some(end(mask, part, sections, 0, 1)) };
    Some(Ends {
        root: root.as_ref().map_or(0.0, |end| -end.beyond),
        tip: (n - 1) as f32 + tip.beyond,
        pointed_root: root.is_some_and(|end| end.pointed),
    })
}

struct End {
    /// How far the end lies beyond the last section, in sections (pixels); below 0 if before it.
    beyond: f32,
    pointed: bool,
}

/// Carries a blade on past section `last` (whose neighbours lie in direction `inward`), straight, and
/// finds where it ends: of a blade that narrows evenly to a point the area beyond a section is half
/// its width times the length that is left.
fn end(mask: &Mask, part: &Part, sections: &[Section], last: usize, inward: isize) -> End {
    const BACK: usize = 6;
    const FORWARD: usize = 16;
    let at = |k: usize| &sections[last.saturating_add_signed(inward * k as isize).min(sections.len() - 1)];
    let back = BACK.min(sections.len() - 1);
    // The straight line through the last sound sections; the very last ones lean.
    let base = at(back);
    let outward = (base.origin - at(back * 3).origin).normalize_or(base.origin - at(back + 1).origin);
    let across =
        if base.across.dot(right_of(outward)) < 0.0 { -right_of(outward) } else { right_of(outward) };
    let mut areas = Vec::with_capacity(back + FORWARD);
    for k in 0..back + FORWARD {
        let origin = base.origin + outward * (k as f32 + 0.5);
        let half = 0.5 * base.width().max(1.0) + 1.5;
        let width = occupied_length(mask, part.label, origin, -across, half)
            + occupied_length(mask, part.label, origin, across, half);
        if width < 0.05 {
            break;
        }
        areas.push(width);
    }
    let area: f32 = areas.iter().sum();
    let width = base.width().max(0.1);
    // A blunt end keeps its width to the last pixel; a pointed one has lost most of it by then.
    let outer = areas.iter().rev().nth(1).copied().unwrap_or(0.0);
    let pointed = outer < 0.55 * width;
    let length = if pointed { 2.0 * area / width } else { area / width };
    End { beyond: length - back as f32, pointed }
}

fn finished(label: u16, sections: &[Section], ends: Ends) -> Skeleton {
    let n = sections.len();
    let spacing =
        (1..n).map(|i| sections[i].origin.distance(sections[i - 1].origin)).sum::<f32>() / (n - 1) as f32;
    // Sections within this many of an end are cut off by it and say little about the width.
    let lean = 2.0;
    let trust = |i: usize| {
        let from_root = i as f32 - ends.root;
        let to_tip = ends.tip - i as f32;
        f64::from(u8::from((from_root >= lean || !ends.pointed_root && from_root >= 1.0) && to_tip >= lean))
    };
    let weights: Vec<f64> = (0..n).map(trust).collect();
    // One sample a pixel over the whole length, the ends pinned where they are points.
    let first = ends.root.floor().min(0.0) as isize;
    let last = ends.tip.ceil().max((n - 1) as f32) as isize;
    let wavelength = WIDTH_WAVELENGTH_PX / f64::from(spacing.max(0.1));
    let profile = |of: fn(&Section) -> f32| {
        let (mut values, mut weight) = (Vec::new(), Vec::new());
        for i in first..=last {
            let known = usize::try_from(i).ok().filter(|i| *i < n);
            let is_point = i as f32 >= ends.tip || ends.pointed_root && i as f32 <= ends.root;
            let value = known.map_or(0.0, |i| of(&sections[i]));
            values.push(if is_point { 0.0 } else { f64::from(value) });
            weight.push(if is_point { 1.0 } else { known.map_or(0.0, |i| weights[i]) });
        }
        smooth::penalised(&values, &weight, wavelength)
    };
    let (left, right) = (profile(|s| -s.left), profile(|s| s.right));
    let straight =
        |from: usize, to: usize| (sections[from].origin - sections[to].origin).normalize_or_zero() * spacing;
    let (root_step, tip_step) = (straight(0, 3.min(n - 1)), straight(n - 1, n.saturating_sub(4)));
    let place = |i: f32| {
        if i < 0.0 {
            sections[0].origin - root_step * i
        } else if i > (n - 1) as f32 {
            sections[n - 1].origin + tip_step * (i - (n - 1) as f32)
        } else {
            let (k, t) = ((i as usize).min(n - 2), i - (i as usize).min(n - 2) as f32);
            sections[k].origin.lerp(sections[k + 1].origin, t)
        }
    };
    let sample = |profile: &[f64], i: f32| {
        let at = (i - first as f32).clamp(0.0, (profile.len() - 1) as f32);
        let k = (at as usize).min(profile.len() - 2);
        let t = f64::from(at - k as f32);
        ((profile[k] * (1.0 - t) + profile[k + 1] * t) as f32).max(0.0)
    };
    let positions: Vec<f32> = (0..STATIONS)
        .map(|k| ends.root + (ends.tip - ends.root) * k as f32 / (STATIONS - 1) as f32)
        .collect();
    let mids: Vec<Vec2> = positions.iter().map(|i| place(*i)).collect();
    let length_px = polyline::length(&mids);
    let across = tangents(&mids).into_iter().map(right_of);
    let station = |((i, mid), across): ((&f32, &Vec2), Vec2)| Station {
        mid: *mid,
        across,
        left_px: sample(&left, *i),
        right_px: sample(&right, *i),
    };
    let mut stations: Vec<Station> = positions.iter().zip(&mids).zip(across).map(station).collect();
    let tip = &mut stations[STATIONS - 1];
    (tip.left_px, tip.right_px) = (0.0, 0.0);
    Skeleton { label, stations, length_px }
}
