//! Parts → ribbons: each blade followed from the stretch that its outline shows into both directions,
//! behind what hides it, across gaps without readings and into the base that it shares with others.

use common::geometry::fit::Parabola;
use glam::Vec2;

use super::behind;
use super::blob::Field;
use super::course::Course;
use super::crease;
use super::crossing;
use super::hook::{doubled_back, unhook, way};
use super::join::join;
use super::margin;
use super::mask::Mask;
use super::overhang;
use super::partition::Part;
use super::section::{Expected, Measured, Middle};
use super::seed::seed;
use super::settle::{moved, settle, settle_roughly};
use super::splice;
use super::stem;
use super::strip;
use super::trail;
use super::trend::Trend;
use super::tuft::{self, Ground};

/// A cross-section of a ribbon, about a pixel from the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// Where it is taken to be.
    pub expected: Expected,
    /// What was measured there.
    pub measured: Measured,
    /// What the expected place counts beside measured ones, whose weight is 1.
    pub anchor: f32,
    /// Of a section that lies where its blade must pass rather than where it was seen: half of the
    /// width that the blade has there, pixels.
    pub guide_px: Option<f32>,
}

/// What an expected place counts where nothing is known of it.
pub(super) const ANCHOR: f32 = 0.004;

/// How a ribbon ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Before what is behind it: the blade's own end.
    Free,
    /// In something that it shares with others, or at the border of the region.
    Shared,
    /// Behind something, or where nothing can be seen.
    Lost,
}

/// One blade, followed from end to end.
#[derive(Clone, Debug, PartialEq)]
pub struct Ribbon {
    /// From root to tip.
    pub sections: Vec<Section>,
    /// How it ends at its root.
    pub root: End,
    /// How it ends at its tip.
    pub tip: End,
    /// Sections at its root whose blade is not sure to be its own.
    pub(super) unsure: usize,
}

/// How far a blade is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RibbonParams {
    /// Longest stretch that is followed behind something nearer, pixels.
    pub hidden_px: usize,
    /// Longest stretch that is followed where nothing can be seen, pixels.
    pub unseen_px: usize,
    /// Where gravity points in the image; unit vector.
    pub down: Vec2,
    /// Focal length, pixels.
    pub focal_px: f32,
}

impl Default for RibbonParams {
    fn default() -> Self {
        Self { hidden_px: 70, unseen_px: 24, down: Vec2::Y, focal_px: 570.0 }
    }
}

/// Half-height wavelength of the smoothing of midribs along a ribbon, pixels.
const MIDRIB_WAVELENGTH_PX: f64 = 28.0;
/// Shortest stretch that a blade can be followed from, pixels.
pub(super) const MIN_SEED_PX: usize = 8;

/// Follows every part and keeps each blade once, the longest first. `fields`: distance from its root
/// for each blob, by label. O(parts · length · width).
pub fn grow(mask: &Mask, parts: &[Part], fields: &[Field], params: &RibbonParams) -> Vec<Ribbon> {
    let mut strips = Vec::new();
    let mut ribbons: Vec<Ribbon> =
        parts.iter().filter_map(|part| visible_stretch(mask, part, params.focal_px, &mut strips)).collect();
    let longest_first = |ribbons: &mut Vec<Ribbon>| {
        ribbons.sort_by_key(|ribbon| std::cmp::Reverse(ribbon.sections.len()));
    };
    longest_first(&mut ribbons);
    join(mask, &mut ribbons, params);
    crossing::join(mask, &mut ribbons);
    ribbons.iter_mut().for_each(|ribbon| follow(mask, ribbon, fields, params));
    strip::add(mask, &mut ribbons, &strips, fields, params);
    let ground = Ground::of(mask, params.down);
    let attached = stem::attach(mask, &mut ribbons, fields, &ground, params);
    tuft::gather(mask, &mut ribbons, &ground, params);
    behind::lead(mask, &mut ribbons, &attached, params);
    ribbons.extend(attached);
    splice::join(mask, &mut ribbons);
    trail::follow(mask, &mut ribbons, params);
    for ribbon in &mut ribbons {
        for wavelength_px in [24.0, MIDRIB_WAVELENGTH_PX] {
            settle(mask, &mut ribbon.sections, wavelength_px);
        }
        end_at_border(mask, ribbon);
    }
    longest_first(&mut ribbons);
    let mut kept: Vec<Course> = Vec::new();
    let is_kept: Vec<bool> = ribbons
        .iter()
        .map(|ribbon| {
            let course = Course::of(&ribbon.sections);
            let is_new = !kept.iter().any(|longer| longer.covers(&course, mask));
            kept.extend(is_new.then_some(course));
            is_new
        })
        .collect();
    ribbons.into_iter().zip(is_kept).filter_map(|(ribbon, is_kept)| is_kept.then_some(ribbon)).collect()
}

/// Forgets the sections at both ends that smoothing has put beyond the region.
fn end_at_border(mask: &Mask, Ribbon { sections, unsure, .. }: &mut Ribbon) {
    let [x0, y0, x1, y1] = mask.region.map(|edge| edge as f32 - 0.5);
    let within = |section: &Section| {
        let Vec2 { x, y } = section.expected.mid;
        x >= x0 && y >= y0 && x <= x1 && y <= y1
    };
    let ends = sections.iter().position(within).zip(sections.iter().rposition(within));
    let Some((first, last)) = ends else { return };
    sections.truncate(last + 1);
    sections.drain(..first);
    *unsure = unsure.saturating_sub(first);
}

/// Largest distance of a reading from where its blade is expected, metres.
pub(super) fn tolerance_m(mask: &Mask) -> f32 {
    // A single frame's noise is not all of it: real leaves are curled.
    let factor = if mask.frames >= 4 { 5.0 } else { 10.0 };
    (factor * mask.depth_noise_m).clamp(0.002, 0.020)
}

/// What the outline shows of a blade; where it shows but one edge of it, that goes to `strips`.
fn visible_stretch<'a>(
    mask: &Mask,
    part: &'a Part,
    focal_px: f32,
    strips: &mut Vec<&'a Part>,
) -> Option<Ribbon> {
    let mut sections = seed(mask, part)?;
    crease::expect_if_deep(mask, &mut sections, focal_px);
    settle_roughly(mask, &mut sections, 12.0);
    settle(mask, &mut sections, 12.0);
    // Beside what hides it the stretch narrows to a wedge that says nothing about the blade.
    let clear = |section: &Section| section.measured.middle == Middle::Blade && section.edges_seen() == 2;
    let (first, last) = (sections.iter().position(clear), sections.iter().rposition(clear));
    let Some((first, last)) = first.zip(last).filter(|(first, last)| last - first + 1 >= MIN_SEED_PX) else {
        strips.push(part);
        return None;
    };
    if 2 * (last - first + 1) < sections.len() {
        strips.push(part);
    }
    sections.truncate(last + 1);
    sections.drain(..first);
    if let Some(base) = part.base {
        sections = overhang::turned(mask, sections, base);
    }
    let root = if part.cut || part.base.is_some() { End::Shared } else { End::Free };
    (sections.len() >= MIN_SEED_PX).then_some(Ribbon { sections, root, tip: End::Free, unsure: 0 })
}

/// Follows a ribbon on at both ends and finds out which one is the root.
pub(super) fn follow(mask: &Mask, ribbon: &mut Ribbon, fields: &[Field], params: &RibbonParams) {
    let cut = ribbon.root == End::Shared;
    let sections = &mut ribbon.sections;
    // Only the end that is nearer to the root of its blob can lead there.
    let turned = !cut && leads_back(mask, sections, fields);
    let (to_last, to_first): (&[Field], &[Field]) = if turned { (fields, &[]) } else { (&[], fields) };
    ribbon.tip = extend(mask, sections, to_last, params, fits);
    // What is led to its base is there.
    if sections[0].guide_px.is_none() {
        reverse(sections);
        ribbon.root = extend(mask, sections, to_first, params, fits);
        reverse(sections);
    }
    let first_is_root = match (ribbon.root, ribbon.tip) {
        _ if cut => true,
        (End::Shared, End::Shared) | (End::Free | End::Lost, End::Free | End::Lost) => {
            let height = |i: usize| ribbon.sections[i].expected.mid.dot(params.down);
            height(0) >= height(ribbon.sections.len() - 1)
        }
        (first, _) => first == End::Shared,
    };
    if !first_is_root {
        reverse(&mut ribbon.sections);
        std::mem::swap(&mut ribbon.root, &mut ribbon.tip);
    }
    ribbon.unsure = unsure(&ribbon.sections);
}

/// Sections at the root that come after a stretch too long without both edges, as seen from the tip,
/// or after a jump of the width.
pub(super) fn unsure(sections: &[Section]) -> usize {
    let (mut last, mut unclear, mut half) = (sections.len(), 0.0, None::<f32>);
    for (i, section) in sections.iter().enumerate().rev() {
        if section.guide_px.is_some() {
            (unclear, half) = (0.0, None);
            continue;
        }
        let seen = section.expected.half_px;
        let both = section.edges_seen() == 2 && section.measured.middle == Middle::Blade;
        let alike = half.is_none_or(|half| (seen - half).abs() < 0.15 * half + 1.0);
        if both && alike {
            (last, unclear) = (i, 0.0);
            half = Some(half.map_or(seen, |half| 0.8 * half + 0.2 * seen));
        } else if let Some(clear) = half {
            unclear += 1.0;
            if unclear > 0.8 * clear + 6.0 {
                // A thin tip is seldom seen as a whole.
                if sections.len() - last > 40 {
                    break;
                }
                (unclear, half) = (0.0, None);
            }
        }
    }
    if last == 0 || last == sections.len() { 0 } else { last + crotch(&sections[last..]) }
}

/// Sections at the lower end of a stretch that swell into what the blade shares with its neighbour: wider
/// than those above them lead to.
fn crotch(sections: &[Section]) -> usize {
    const SWELLING: usize = 24;
    const ABOVE: usize = 40;
    if sections.len() < SWELLING + ABOVE {
        return 4.min(sections.len() / 8);
    }
    let mut above = Parabola::default();
    for (i, section) in sections.iter().enumerate().skip(SWELLING).take(ABOVE) {
        let weight = if section.edges_seen() == 2 { 1.0 } else { 0.0 };
        above.add(i as f64, section.expected.half_px.into(), weight);
    }
    let Some([half, taper, _]) = above.solve(1, 0.0) else { return 4 };
    let swells = |i: &usize| {
        let led = (half + taper * *i as f64) as f32;
        sections[*i].expected.half_px > 1.06 * led + 0.3
    };
    4 + (0..SWELLING).rev().find(swells).map_or(0, |i| i + 1)
}

pub(super) fn reverse(sections: &mut [Section]) {
    sections.reverse();
    for Section { expected, measured, .. } in sections {
        expected.across = -expected.across;
        expected.slope_m = -expected.slope_m;
        expected.fold.at_px = -expected.fold.at_px;
        (measured.left_px, measured.right_px) = (measured.right_px.map(|e| -e), measured.left_px.map(|e| -e));
        measured.slope_moments[0] = -measured.slope_moments[0];
    }
}

impl Section {
    pub(super) fn edges_seen(&self) -> usize {
        usize::from(self.measured.left_px.is_some()) + usize::from(self.measured.right_px.is_some())
    }

    /// One where its blade must pass rather than where it was seen.
    pub(super) fn led(mask: &Mask, expected: Expected, anchor: f32) -> Self {
        let guide_px = Some(expected.half_px);
        let mut section = Self { expected, measured: expected.measure(mask), anchor, guide_px };
        section.doubt();
        section
    }

    /// Forgets edges that are not where a blade that passes here has them.
    pub(super) fn doubt(&mut self) {
        let Some(half) = self.guide_px else { return };
        let Measured { left_px, right_px, .. } = &mut self.measured;
        let off = match (*left_px, *right_px) {
            (Some(left), Some(right)) => (right - left - 2.0 * half).abs().max((right + left).abs()),
            (Some(left), None) => 2.0 * (left + half).abs(),
            (None, Some(right)) => 2.0 * (right - half).abs(),
            (None, None) => 0.0,
        };
        if off > 0.1 * half + 1.0 {
            (*left_px, *right_px) = (None, None);
        }
    }

    /// How much its middle says about the midrib.
    pub(super) fn weight(&self) -> f32 {
        let narrow = (self.expected.half_px / 1.0).clamp(0.05, 1.0);
        match (self.measured.middle, self.edges_seen()) {
            (Middle::Blade, 2) => narrow,
            (Middle::Blade, 1) => 0.25 * narrow,
            _ => 0.0,
        }
    }

    /// The middle between its edges, as far as they are seen.
    pub(super) fn middle(&self) -> Vec2 {
        let Expected { mid, across, half_px, .. } = self.expected;
        let offset = match (self.measured.left_px, self.measured.right_px) {
            (Some(left), Some(right)) => 0.5 * (left + right),
            (Some(left), None) => left + half_px,
            (None, Some(right)) => right - half_px,
            (None, None) => 0.0,
        };
        mid + across * offset
    }
}

/// Follows the blade on from the last section. `fits`: whether what comes out from behind something is it.
pub(super) fn extend(
    mask: &Mask,
    sections: &mut Vec<Section>,
    fields: &[Field],
    params: &RibbonParams,
    fits: impl Fn(&Section) -> bool,
) -> End {
    unhook(sections);
    let mut seen = sections.len();
    let (mut hidden, mut unseen, mut gone) = (0, 0, 0);
    // The last section that stood clear of all others, and how far it is back.
    let (mut clear, mut unclear) = (sections.len(), 0.0);
    let mut trend = Trend::of(sections);
    let outward = way(sections, sections.len() - 1, 24);
    let end = loop {
        let coasted = sections.len() - seen;
        let search_px = 1.8 + 0.12 * coasted as f32;
        let tolerance_m = tolerance_m(mask) + 1.0e-4 * coasted as f32;
        let last = &sections[sections.len() - 1].expected;
        let expected = Expected { search_px, tolerance_m, ..trend.next(last) };
        let [x0, y0, x1, y1] = mask.region.map(|edge| edge as f32);
        let Vec2 { x, y } = expected.mid;
        if !(x >= x0 && y >= y0 && x <= x1 - 1.0 && y <= y1 - 1.0) {
            break End::Shared;
        }
        if mask.index_at(expected.mid).is_some_and(|index| mask.is_hand(index)) {
            break End::Shared;
        }
        let mut section =
            Section { expected, measured: expected.measure(mask), anchor: ANCHOR, guide_px: None };
        if margin::is_cut_off(mask, &expected) {
            // What is left of it by the border would lead aside.
            (section.measured.left_px, section.measured.right_px) = (None, None);
        }
        match section.measured.middle {
            Middle::Blade if coasted >= 4 && !fits(&section) => hidden += 1,
            Middle::Blade => {
                let mut found = Expected { mid: section.middle(), ..expected };
                if let (Some(left), Some(right)) = (section.measured.left_px, section.measured.right_px) {
                    found.half_px = 0.5 * (right - left);
                }
                section.measured = moved(&section, &found).unwrap_or_else(|| found.measure(mask));
                section.expected = found;
                (hidden, unseen, gone) = (0, 0, 0);
                seen = sections.len() + 1;
                if fits(&section) {
                    (clear, unclear) = (seen, 0.0);
                }
            }
            Middle::Hidden => hidden += 1,
            Middle::Unseen => unseen += 1,
            Middle::Gone => gone += 1,
        }
        unclear += [1.0, 0.3, 0.0][section.edges_seen()];
        sections.push(section);
        trend.push(&section);
        let width = 2.0 * section.expected.half_px;
        let merged = section.measured.middle == Middle::Blade && unclear > 1.5 * width + 8.0;
        if merged && root_is_far(mask, &section, fields) {
            sections.truncate(clear);
            return End::Shared;
        }
        if gone >= 3 && root_is_far(mask, &sections[seen - 1], fields) {
            // Out on the far side of a stem.
            sections.truncate(clear);
            return End::Shared;
        }
        if gone >= 3 {
            // Hidden by something before it, it may end there.
            break if hidden > 3 { End::Lost } else { End::Free };
        }
        let turned = seen == sections.len()
            && seen.is_multiple_of(4)
            && way(sections, seen - 1, 4).dot(outward) < -0.5;
        if let Some(before) = turned.then(|| doubled_back(sections)).flatten() {
            let turn = (before + seen) / 2;
            sections.truncate(turn);
            // A tip tapers towards it.
            let half_px = |section: usize| sections[section].expected.half_px;
            let is_tip = half_px(turn - 1) < 0.8 * half_px(before.saturating_sub(seen - before));
            return if is_tip { End::Free } else { End::Lost };
        }
        if hidden > params.hidden_px || unseen > params.unseen_px || sections.len() > 2000 {
            break End::Lost;
        }
    };
    sections.truncate(seen);
    end
}

/// Whether what comes out from behind something looks like the blade that went in.
pub(super) fn fits(section: &Section) -> bool {
    let expected = 2.0 * section.expected.half_px;
    match (section.measured.left_px, section.measured.right_px) {
        (Some(left), Some(right)) => ((right - left) - expected).abs() < 0.35 * expected + 1.5,
        _ => false,
    }
}

/// Whether the root of the blob that a section lies on is farther off than a blade's base can reach:
/// then what the blade has run into is a stem.
fn root_is_far(mask: &Mask, section: &Section, fields: &[Field]) -> bool {
    let Expected { mid, half_px, .. } = section.expected;
    let label = mask.index_at(mid).map_or(0, |index| usize::from(mask.blobs.of[index]));
    let field = label.checked_sub(1).and_then(|blob| fields.get(blob));
    field.is_some_and(|field| field.at(mid) > 5.0 * half_px + 10.0)
}

/// Whether the last one of some sections is nearer to the root of the blob that they lie on than the first one.
fn leads_back(mask: &Mask, sections: &[Section], fields: &[Field]) -> bool {
    let on_blob = |section: &Section| {
        let label = mask.index_at(section.expected.mid).map_or(0, |index| mask.blobs.of[index]);
        (label > 0).then_some((label, section.expected.mid))
    };
    let mut places = sections.iter().filter_map(on_blob);
    let Some(((label, first), (other, last))) = places.next().zip(places.next_back()) else { return false };
    let field = fields.get(usize::from(label) - 1);
    label == other && field.is_some_and(|field| field.at(last) < field.at(first))
}
