//! An outline → the blade that is most like it, among those of few knots.

use common::blade::Knot;
use common::geometry::polyline;
use common::refine::{RefineParams, refine};
use common::strand::motions_in_wind;
use glam::Vec2;

use super::likeness::{Likeness, Template};
use super::midrib;
use super::outline::Outline;
use super::section::{Section, sections, smoothed, to_the_outline};
use super::svg_import::ImportParams;
use crate::stages::blade::MOTION_FRAMES;
use crate::stages::skeleton::STATIONS;

/// What agrees less than this with its outline is no leaf.
const LEAST_AGREEMENT: f32 = 0.6;
/// A midrib that the capture stages find is good enough when the blade agrees so well with the outline.
const GOOD_AGREEMENT: f32 = 0.94;
/// What is farther from its outline than this share of its length has not the midrib of a blade.
const FARTHEST: f32 = 0.1;
/// Nor has one whose sections, each as long as the next is far, are so much more or less than the outline: they
/// lie on one another.
const MOST_MISSED: f32 = 0.06;
/// More knots are taken where they better the agreement by more than this.
const WORTHWHILE: f32 = 0.01;
/// What is tried where the knots that are asked for are too few for lobes: knots, and windows over which the
/// widths are evened out (0: not at all).
const FINER: [(usize, usize); 3] = [(32, 32), (64, 64), (64, 0)];

/// Where a midrib comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MidribOrigin {
    /// It is drawn.
    Drawn,
    /// It was found as that of a blade before the camera.
    Found,
    /// A straight line.
    Straight,
}

/// A blade made of an outline.
#[derive(Clone, Debug)]
pub(super) struct Fitted {
    /// From root to tip, 2 to 64: metres, flat, the root at the origin.
    pub(super) knots: Vec<Knot>,
    /// Length of its midrib and largest width before it was brought to these knots, metres.
    pub(super) size_m: [f32; 2],
    /// Its millimetres for one of the drawing.
    pub(super) scale: f32,
    /// How like it is to the outline.
    pub(super) likeness: Likeness,
    /// Its cross-sections, times the distance to the next, as a share of what the outline encloses.
    sections_cover: f32,
    /// Where its midrib comes from.
    pub(super) midrib: MidribOrigin,
}

/// The blade that is most like an outline, with its midrib where one is drawn. O(points · sections), and the
/// capture stages on a small picture where none is.
///
/// # Errors
/// When no blade is like it; no full stop.
pub(super) fn fit(
    outline: &Outline,
    drawn: Option<&[Vec2]>,
    params: &ImportParams,
) -> Result<Fitted, String> {
    let template = Template::new(outline);
    let along = |mids: &[Vec2], origin| along(outline, &template, (mids, origin), params);
    let best = match drawn {
        Some(drawn) => {
            let midrib = to_the_outline(outline, drawn).ok_or(
                "the midrib that is drawn with it lies beside it; expected one from its root to its tip: move it there, \
                 or take it away and have one found",
            )?;
            along(&midrib, MidribOrigin::Drawn)
        }
        None => {
            let found = midrib::found(outline).map(|found| along(&found, MidribOrigin::Found));
            let found = found.filter(|found| (found.sections_cover - 1.0).abs() <= MOST_MISSED);
            let is_good = |found: &Fitted| {
                let Likeness { agreement, farthest_mm } = found.likeness;
                agreement >= GOOD_AGREEMENT && farthest_mm <= FARTHEST * found.size_m[0] / found.scale * 1e3
            };
            found.filter(is_good).unwrap_or_else(|| along(&midrib::straight(outline), MidribOrigin::Straight))
        }
    };
    let Likeness { agreement, .. } = best.likeness;
    if agreement >= LEAST_AGREEMENT {
        return Ok(best);
    }
    let remedy = match best.midrib {
        MidribOrigin::Drawn => {
            "draw the midrib through the middle of it, or divide it into several closed paths"
        }
        _ => {
            "draw its midrib from root to tip, as an open path whose id begins with \"midrib\", or divide it into \
             several closed paths"
        }
    };
    Err(format!(
        "as a midrib with one width to each side it is {:.0} % alike, expected {:.0} % or more: a single blade or leaf, \
         whose lobes and teeth may be evened out; {remedy}",
        100.0 * agreement,
        100.0 * LEAST_AGREEMENT
    ))
}

/// The blade of an outline along a midrib.
fn along(
    outline: &Outline,
    template: &Template,
    (midrib, origin): (&[Vec2], MidribOrigin),
    params: &ImportParams,
) -> Fitted {
    let fine = sections(outline, midrib);
    // Between the legs of a star there is nothing to be seen.
    let fine = cropped(&fine).map_or(fine, |midrib| sections(outline, &midrib));
    let mids: Vec<Vec2> = fine.iter().map(|section| section.0).collect();
    let (root, length_mm) = (mids[0], polyline::length(&mids));
    let metres = params.length_m.map_or(1e-3, |wanted| wanted / length_mm);
    let knot = |(mid, across, [left, right]): &Section| Knot {
        position: ((*mid - root) * metres).extend(0.0),
        half_width_left: left * metres,
        across: across.extend(0.0),
        half_width_right: right * metres,
    };
    let as_drawn = |knot: &Knot| Knot {
        position: knot.position / metres + root.extend(0.0),
        half_width_left: knot.half_width_left / metres,
        half_width_right: knot.half_width_right / metres,
        ..*knot
    };
    let places: Vec<_> = smoothed(&fine, STATIONS, 0).iter().map(|section| knot(section).position).collect();
    let motion = &motions_in_wind(&[&places], MOTION_FRAMES)[0];
    let finer = FINER.into_iter().filter(|(knots, _)| *knots > params.refine.knots);
    let mut tried: Vec<(f32, Tried)> = Vec::new();
    for (count, windows) in std::iter::once((params.refine.knots, 0)).chain(finer) {
        let skeleton: Vec<Knot> = smoothed(&fine, STATIONS, windows).iter().map(knot).collect();
        let knots = refine(&skeleton, motion, &RefineParams { knots: count, ..params.refine }).knots;
        let drawn: Vec<Knot> = knots.iter().map(as_drawn).collect();
        let width_m = skeleton.iter().map(Knot::width).fold(0.0, f32::max);
        let agreement = template.agreement(&drawn);
        tried.push((agreement, Tried { knots, drawn, width_m }));
        // None is better by more than that.
        if agreement >= 1.0 - WORTHWHILE {
            break;
        }
    }
    let best = tried.iter().map(|(agreement, _)| *agreement).fold(0.0, f32::max);
    let enough = tried.into_iter().find(|(agreement, _)| *agreement >= best - WORTHWHILE);
    let (_, Tried { knots, drawn, width_m }) = enough.expect("the best of them is");
    let likeness = template.likeness(&drawn);
    let step = length_mm / (fine.len() - 1) as f32;
    let sections_cover =
        fine.iter().map(|(.., [left, right])| left + right).sum::<f32>() * step / outline.area();
    Fitted {
        knots,
        size_m: [length_mm * metres, width_m],
        scale: metres * 1e3,
        likeness,
        sections_cover,
        midrib: origin,
    }
}

/// The midrib without what has no width at its ends; `None` where that is all or nothing.
fn cropped(fine: &[Section]) -> Option<Vec<Vec2>> {
    let has_width = |section: &Section| section.2[0] + section.2[1] > 0.0;
    let (first, last) = (fine.iter().position(has_width)?, fine.iter().rposition(has_width)?);
    // A point has none, either.
    let (first, last) = (first.saturating_sub(1), (last + 1).min(fine.len() - 1));
    let is_cut = first > 0 || last + 1 < fine.len();
    is_cut.then(|| fine[first..=last].iter().map(|section| section.0).collect())
}

/// One of the ways to bring a blade to few knots.
struct Tried {
    /// Metres, the root at the origin.
    knots: Vec<Knot>,
    /// The same where it is drawn.
    drawn: Vec<Knot>,
    /// Largest width before.
    width_m: f32,
}
