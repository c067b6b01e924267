//! Blades of which one edge is hidden all along: strips beside what is before them.

use glam::Vec2;

use super::blob::Field;
use super::course::Course;
use super::join::bridge;
use super::mask::Mask;
use super::partition::Part;
use super::ribbon::{End, Ribbon, RibbonParams, Section, extend, fits, follow, reverse, unsure};
use super::section::Middle;
use super::seed::seed;
use super::settle::settle_roughly;

/// Shortest strip that is looked at, pixels.
const MIN_PX: usize = 20;
/// And in its widths: less is a crumb of an edge.
const MIN_SLENDERNESS: f32 = 2.5;
/// What is carried on by a strip goes on at least so many times as far as it goes aside.
const MAX_SLANT: f32 = 2.5;
/// Narrower ones are smeared edges, pixels.
const MIN_WIDTH_PX: f32 = 4.0;

/// The longest stretch of a part that shows one edge of a blade or both, if that is long enough to be followed.
fn of(mask: &Mask, part: &Part) -> Option<Ribbon> {
    let mut sections = seed(mask, part)?;
    settle_roughly(mask, &mut sections, 12.0);
    let shown = |section: &Section| section.measured.middle == Middle::Blade && section.edges_seen() > 0;
    let longest = sections
        .chunk_by(|a, b| shown(a) == shown(b))
        .filter(|run| shown(&run[0]))
        .max_by_key(|run| run.len())?;
    let width_px =
        2.0 * longest.iter().map(|section| section.expected.half_px).sum::<f32>() / longest.len() as f32;
    let is_long = longest.len() >= MIN_PX && longest.len() as f32 > MIN_SLENDERNESS * width_px;
    (is_long && width_px >= MIN_WIDTH_PX).then(|| Ribbon {
        sections: longest.to_vec(),
        root: End::Free,
        tip: End::Free,
        unsure: 0,
    })
}

/// Whether a ribbon passes a part in three places along it: most that look like strips are a stretch of one.
fn is_followed(mask: &Mask, ribbons: &[Ribbon], part: &Part) -> bool {
    const NEAR_M: f32 = 0.03;
    let along = |points: &[Vec2], quarters: usize| points[(points.len() - 1) * quarters / 4];
    let place = |quarters| along(&part.left.points, quarters).midpoint(along(&part.right.points, quarters));
    [1, 2, 3].map(place).into_iter().all(|place| {
        let Some(index) = mask.index_at(place) else { return false };
        let passes = |section: &Section| {
            let near_m = (section.expected.depth_m - mask.depth_m[index]).abs() < NEAR_M;
            section.expected.mid.distance(place) < section.expected.half_px && near_m
        };
        ribbons.iter().any(|ribbon| ribbon.sections.iter().any(passes))
    })
}

/// Adds the strips among `parts` that no ribbon has to ribbons that were followed, or joins them to these.
/// O(parts · sections).
pub(super) fn add(
    mask: &Mask,
    ribbons: &mut Vec<Ribbon>,
    parts: &[&Part],
    fields: &[Field],
    params: &RibbonParams,
) {
    let left: Vec<&Part> = parts.iter().copied().filter(|part| !is_followed(mask, ribbons, part)).collect();
    if left.is_empty() {
        return;
    }
    let mut added: Vec<Ribbon> = {
        let courses: Vec<Course> = ribbons.iter().map(|ribbon| Course::of(&ribbon.sections)).collect();
        let is_new = |strip: &Ribbon| {
            let course = Course::of(&strip.sections);
            !courses.iter().any(|longer| longer.covers(&course, mask))
        };
        left.into_iter().filter_map(|part| of(mask, part)).filter(is_new).collect()
    };
    if added.is_empty() {
        return;
    }
    for ribbon in ribbons.iter_mut() {
        follow_beside(mask, ribbon, &mut added, fields, params);
    }
    added.iter_mut().for_each(|strip| follow(mask, strip, fields, params));
    ribbons.append(&mut added);
}

/// Carries a ribbon whose root was lost behind something on by the strip that its edge leads along, which is
/// then no other's.
fn follow_beside(
    mask: &Mask,
    ribbon: &mut Ribbon,
    strips: &mut Vec<Ribbon>,
    fields: &[Field],
    params: &RibbonParams,
) {
    if ribbon.root != End::Lost {
        return;
    }
    let mut inward = ribbon.sections.clone();
    reverse(&mut inward);
    let mut led = inward.clone();
    extend(mask, &mut led, fields, params, |section| fits(section) || goes_on(section));
    let course = Course::of(&led);
    let end = inward[inward.len() - 1].expected;
    let out = Vec2::new(end.across.y, -end.across.x);
    let found = strips.iter().position(|strip| course.covers(&Course::of(&strip.sections), mask));
    let Some((found, mut strip)) = found.map(|found| (found, strips[found].sections.clone())) else { return };
    let away = |section: &Section| section.expected.mid.distance_squared(end.mid);
    if away(&strip[0]) > away(&strip[strip.len() - 1]) {
        reverse(&mut strip);
    }
    let ahead = |section: &Section| {
        let by = section.expected.mid - end.mid;
        by.dot(out) > MAX_SLANT * by.perp_dot(out).abs() + 1.0
    };
    let Some(first) = strip.iter().position(ahead) else { return };
    strips.remove(found);
    bridge(&mut inward, strip[first]);
    inward.extend_from_slice(&strip[first..]);
    ribbon.root = extend(mask, &mut inward, fields, params, fits);
    reverse(&mut inward);
    ribbon.unsure = unsure(&inward);
    ribbon.sections = inward;
}

/// Whether the one edge that is seen is where the blade's would be.
fn goes_on(section: &Section) -> bool {
    let half = section.expected.half_px;
    match (section.measured.left_px, section.measured.right_px) {
        (Some(left), None) => (left + half).abs() < 0.175 * half + 0.75,
        (None, Some(right)) => (right - half).abs() < 0.175 * half + 0.75,
        _ => false,
    }
}
