//! SVG outlines, drawn by an artist or written by [`super::svg_export`], → blades.
//!
//! Each closed path is a blade. Its midrib is the open path inside of it whose id begins with `midrib`; without
//! one it is found as that of a blade before the camera: the outline is drawn as a depth image and goes through the
//! capture stages. Widths are those of the drawn curves, not of pixels. What a blade is called: `exchange/labels.rs`.

use common::blade::{Blade, BladeError, BladeId, Knot, MAX_NAME_BYTES};
use common::geometry::polyline;
use common::refine::{RefineParams, refine};
use common::strand::motions_in_wind;
use glam::{Vec2, Vec3};
use usvg::roxmltree;
use usvg::tiny_skia_path::{PathSegment, Point};

use super::labels::Labels;
use super::outline::Outline;
use crate::frame::{CameraModel, DepthFrame};
use crate::pipeline::{self, PipelineParams};
use crate::stages::accumulate::Accumulation;
use crate::stages::blade::MOTION_FRAMES;
use crate::stages::skeleton::STATIONS;

/// Longest file that is read, bytes.
pub const MAX_BYTES: usize = 4 << 20;
/// Most blades in one file.
pub const MAX_BLADES: usize = 256;
/// Most points of an outline, with its curves divided.
const MAX_POINTS: usize = 100_000;
/// Straight pieces of a curve segment.
const PIECES: usize = 24;
/// Pixels of the picture in which a midrib is looked for, along the longer side of the outline.
const PICTURE_PX: f32 = 900.0;
/// A width drawn by the midrib may miss this share of the outline's area: at its ends.
const MAX_MISSED: f32 = 0.06;
/// A half width changes by no more than this share of the largest from one cross-section to the next.
const MAX_JUMP: f32 = 0.25;
const EXPECTED: &str = "expected a single blade or leaf without lobes, upright with its root at the bottom, or its \
                        midrib drawn with it, as a path whose id begins with \"midrib\"";

const CROSSES: &str =
    "its outline crosses itself; expected a single curve around the blade: take the loop out of it";

/// How blades are made of outlines.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ImportParams {
    /// Length of each midrib, metres; `None`: as drawn, by the drawing's own units (96 pixels an inch).
    pub length_m: Option<f32>,
    /// How the drawn shape is brought to few knots.
    pub refine: RefineParams,
    /// When this is, nanoseconds since 1970.
    pub unix_ns: u64,
}

/// Why a drawing gives no blades.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ImportError {
    /// Not SVG, or too large.
    #[error("{0}; expected an SVG drawing of at most 4 MB")]
    NotSvg(String),
    /// Nothing closed in it.
    #[error(
        "there is no closed path in the drawing; expected one for each blade (shapes count, text, pictures and \
         groups that are hidden do not)"
    )]
    NoOutline,
    /// Too many.
    #[error("there are {0} closed paths in the drawing; expected at most {MAX_BLADES}")]
    TooMany(usize),
    /// One outline is no blade.
    #[error("path {name:?}: {reason}")]
    Outline {
        /// The path's id, or its number from 1 on.
        name: String,
        /// What is wrong, what was expected, what to do.
        reason: String,
    },
}

/// The blades of a drawing, in the order of its paths, each with the name of its path (or of the group around it)
/// as far as it has one. They are flat: z is 0, x to the right as drawn, the root at the origin.
///
/// # Errors
/// When the text is no SVG, holds no closed path, or one of them is no blade; all or none.
pub fn read(svg: &[u8], params: &ImportParams) -> Result<Vec<Blade>, ImportError> {
    if svg.len() > MAX_BYTES {
        return Err(ImportError::NotSvg(format!("it has {} bytes", svg.len())));
    }
    // A drawing says nothing about other files.
    let image_href_resolver = usvg::ImageHrefResolver {
        resolve_data: Box::new(|_, _, _| None),
        resolve_string: Box::new(|_, _| None),
    };
    let options = usvg::Options { image_href_resolver, ..usvg::Options::default() };
    let not_svg = |error: &dyn std::fmt::Display| ImportError::NotSvg(error.to_string());
    let text = std::str::from_utf8(svg).map_err(|_| ImportError::NotSvg("it is no UTF-8 text".to_owned()))?;
    let parsing = roxmltree::ParsingOptions { allow_dtd: true, ..roxmltree::ParsingOptions::default() };
    let elements = roxmltree::Document::parse_with_options(text, parsing).map_err(|error| not_svg(&error))?;
    let tree = usvg::Tree::from_xmltree(&elements, &options).map_err(|error| not_svg(&error))?;
    let mut drawing = Drawing { labels: Labels::of(&elements), ..Drawing::default() };
    drawing.collect(tree.root(), "");
    if drawing.outlines.is_empty() {
        return Err(ImportError::NoOutline);
    }
    if drawing.outlines.len() > MAX_BLADES {
        return Err(ImportError::TooMany(drawing.outlines.len()));
    }
    let midrib = |outline: &Outline| {
        drawing.midribs.iter().find(|midrib| outline.contains(polyline::resample(midrib, 3)[1]))
    };
    let blade = |(index, (name, contours)): (usize, &(String, Vec<Outline>))| {
        let shown = if name.is_empty() { (index + 1).to_string() } else { name.clone() };
        let wrong = |reason: String| ImportError::Outline { name: shown.clone(), reason };
        let outline = only(contours).map_err(wrong)?;
        let reasoned = |reason: String| wrong(if outline.crosses_itself() { CROSSES.into() } else { reason });
        let stations = stations(outline, midrib(outline)).map_err(reasoned)?;
        finished(&stations, index, name, params).map_err(|error| wrong(error.to_string()))
    };
    drawing.outlines.iter().enumerate().map(blade).collect()
}

/// What a drawing holds, in its own pixels, y upwards.
#[derive(Default)]
struct Drawing {
    outlines: Vec<(String, Vec<Outline>)>,
    midribs: Vec<Vec<Vec2>>,
    labels: Labels,
}

impl Drawing {
    fn collect(&mut self, group: &usvg::Group, named: &str) {
        for node in group.children() {
            match node {
                usvg::Node::Group(group) => {
                    let own = self.labels.name(group.id()).to_owned();
                    self.collect(group, if own.is_empty() { named } else { &own });
                }
                usvg::Node::Path(path) if path.is_visible() => self.add(path, named),
                _ => {}
            }
        }
    }

    fn add(&mut self, path: &usvg::Path, group: &str) {
        let name = self.labels.name(path.id());
        let contours = contours(path);
        if path.id().starts_with("midrib") || name.starts_with("midrib") {
            self.midribs.extend(contours.into_iter().map(|(points, _)| points).filter(|it| it.len() >= 2));
            return;
        }
        let closed = contours.into_iter().filter(|(points, closed)| *closed && points.len() >= 3);
        let outlines: Vec<Outline> = closed.map(|(points, _)| Outline { points }).collect();
        if !outlines.is_empty() {
            let is_nameless = name.is_empty() || name.starts_with("outline-");
            self.outlines.push((if is_nameless { group.to_owned() } else { name.to_owned() }, outlines));
        }
    }
}

/// The contours of a path, in millimetres, y upwards, each with whether it is closed.
fn contours(path: &usvg::Path) -> Vec<(Vec<Vec2>, bool)> {
    const MM_PER_PX: f32 = 25.4 / 96.0;
    let Some(data) = path.data().clone().transform(path.abs_transform()) else { return Vec::new() };
    let mm = |point: Point| Vec2::new(point.x, -point.y) * MM_PER_PX;
    let mut found: Vec<(Vec<Vec2>, bool)> = Vec::new();
    for segment in data.segments() {
        if let PathSegment::MoveTo(to) = segment {
            found.push((vec![mm(to)], false));
            continue;
        }
        let Some((points, closed)) = found.last_mut() else { continue };
        let from = *points.last().expect("begun by a point");
        let part = |k: usize| k as f32 / PIECES as f32;
        match segment {
            PathSegment::MoveTo(_) => {}
            PathSegment::LineTo(to) => points.push(mm(to)),
            PathSegment::QuadTo(a, to) => {
                let (a, to) = (mm(a), mm(to));
                let at = |t: f32| from.lerp(a, t).lerp(a.lerp(to, t), t);
                points.extend((1..=PIECES).map(|k| at(part(k))));
            }
            PathSegment::CubicTo(a, b, to) => {
                let (a, b, to) = (mm(a), mm(b), mm(to));
                let at = |t: f32| {
                    let (first, middle, last) = (from.lerp(a, t), a.lerp(b, t), b.lerp(to, t));
                    first.lerp(middle, t).lerp(middle.lerp(last, t), t)
                };
                points.extend((1..=PIECES).map(|k| at(part(k))));
            }
            PathSegment::Close => *closed = true,
        }
    }
    for (points, closed) in &mut found {
        points.dedup_by(|b, a| a.distance(*b) < 1e-5);
        // Drawn back to where it began it is closed as well.
        if points.len() > 2 && points[0].distance(points[points.len() - 1]) < 1e-3 {
            points.pop();
            *closed = true;
        }
    }
    found
}

/// The one contour of a path.
fn only(contours: &[Outline]) -> Result<&Outline, String> {
    let largest = contours.iter().max_by(|a, b| a.area().total_cmp(&b.area())).expect("a path has contours");
    let second =
        contours.iter().filter(|it| !std::ptr::eq(*it, largest)).map(Outline::area).fold(0.0, f32::max);
    if second > 0.01 * largest.area() {
        return Err(
            "it has holes or several contours; expected one closed curve for one blade: take them apart"
                .into(),
        );
    }
    if largest.points.len() > MAX_POINTS {
        return Err(format!(
            "it has {} points; expected at most {MAX_POINTS}: simplify it",
            largest.points.len()
        ));
    }
    let [low, high] = largest.bounds();
    let size = high - low;
    if !(size.is_finite() && size.max_element() > 1e-3 && size.max_element() < 1e5) {
        return Err(format!("it is {} mm by {} mm; expected 0.001 mm to 100 m", size.x, size.y));
    }
    Ok(largest)
}

/// A cross-section as drawn: the midrib, the unit vector to the right, half of the width to both sides; millimetres.
type Drawn = (Vec2, Vec2, [f32; 2]);

/// Cross-sections from root to tip.
fn stations(outline: &Outline, midrib: Option<&Vec<Vec2>>) -> Result<Vec<Drawn>, String> {
    let mids = match midrib {
        Some(midrib) => polyline::resample(midrib, STATIONS),
        None => found(outline)?,
    };
    let length = polyline::length(&mids);
    let n = mids.len();
    let mut drawn: Vec<Drawn> = Vec::with_capacity(n);
    for k in 0..n {
        let along = (mids[(k + 2).min(n - 1)] - mids[k.saturating_sub(2)]).normalize_or(Vec2::Y);
        let across = Vec2::new(along.y, -along.x);
        // The very ends lie on the outline, and just beside it.
        let inward = [0, n - 1].iter().position(|end| *end == k).map_or(0.0, |end| [1e-4, -1e-4][end]);
        let from = mids[k] + along * inward * length;
        let sides = [-across, across].map(|way| outline.reach(from, way));
        let inside = outline.contains(from);
        drawn.push((mids[k], across, sides.map(|side| side.filter(|_| inside).unwrap_or(0.0))));
    }
    let half_widths = |pair: &[Drawn], side: usize| [0, 1].map(|k| pair[k].2[side]);
    let widest = drawn.iter().flat_map(|it| it.2).fold(0.0, f32::max);
    let jump = |pair: &[Drawn]| {
        let steps = [0, 1].map(|side| half_widths(pair, side)).map(|[a, b]| (b - a).abs());
        steps[0].max(steps[1]) > MAX_JUMP * widest
    };
    // At its ends a blade may be cut off.
    if drawn[2..n - 2].windows(2).any(jump) {
        return Err(format!("its width leaps along its midrib; {EXPECTED}"));
    }
    let area: f32 = drawn
        .windows(2)
        .map(|pair| 0.5 * pair[0].0.distance(pair[1].0) * pair.iter().flat_map(|it| it.2).sum::<f32>())
        .sum();
    let whole = outline.area();
    if (area - whole).abs() > MAX_MISSED * whole {
        return Err(format!(
            "cross-sections of its midrib cover {:.0} % of it; {EXPECTED}",
            100.0 * area / whole
        ));
    }
    Ok(drawn)
}

/// The midrib of an outline, as if it were held before the camera.
fn found(outline: &Outline) -> Result<Vec<Vec2>, String> {
    const BORDER_PX: usize = 40;
    const DEPTH: u16 = 500;
    let [low, high] = outline.bounds();
    let mm_per_px = (high - low).max_element() / PICTURE_PX;
    let size = ((high - low) / mm_per_px).ceil();
    let (width, height) = (size.x as usize + 2 * BORDER_PX, size.y as usize + 2 * BORDER_PX);
    let border = Vec2::splat(BORDER_PX as f32);
    let to_px = |point: Vec2| Vec2::new(point.x - low.x, high.y - point.y) / mm_per_px + border;
    let from_px = |pixel: Vec2| {
        let at = (pixel - border) * mm_per_px;
        Vec2::new(low.x + at.x, high.y - at.y)
    };
    let in_px = Outline { points: outline.points.iter().map(|point| to_px(*point)).collect() };
    let mut depth = vec![2 * DEPTH; width * height];
    for (y, row) in depth.chunks_mut(width).enumerate() {
        for stretch in in_px.stretches(y as f32).chunks_exact(2) {
            let (from, to) = (stretch[0].ceil().max(0.0) as usize, stretch[1].ceil().max(0.0) as usize);
            row[from.min(width)..to.min(width)].fill(DEPTH);
        }
    }
    // As large as blades are before the camera: 200 mm.
    let focal = f64::from(PICTURE_PX) * 0.5 / 0.2;
    let camera = CameraModel { fx: focal, fy: focal, cx: width as f64 / 2.0, cy: height as f64 / 2.0 };
    let frame = DepthFrame { width, height, depth, depth_unit_m: 0.001, timestamp_ns: 0, camera };
    let params = PipelineParams::default();
    let mut frames = Accumulation::like(&frame);
    frames.add(&frame, &params.mask);
    let steps = pipeline::capture(&frames, &camera, 0, &params);
    let longest = steps.skeletons.iter().max_by(|a, b| a.length_px.total_cmp(&b.length_px));
    let skeleton = longest.ok_or_else(|| format!("no midrib was found in it; {EXPECTED}"))?;
    let mids: Vec<Vec2> = skeleton.stations.iter().map(|station| from_px(station.mid)).collect();
    // Of what was found in pixels the sides are more exact, and tell better where the ends are.
    let centred_once = centred(outline, &mids);
    Ok(centred(outline, &to_the_ends(outline, centred(outline, &centred_once))))
}

/// Brings a midrib to the middle between the drawn sides.
fn centred(outline: &Outline, mids: &[Vec2]) -> Vec<Vec2> {
    const WINDOW: usize = 4;
    let n = mids.len();
    let middle = |k: usize| {
        if k == 0 || k + 1 == n {
            return mids[k];
        }
        let along = (mids[(k + WINDOW).min(n - 1)] - mids[k.saturating_sub(WINDOW)]).normalize_or(Vec2::Y);
        let reach = |way: Vec2| outline.reach(mids[k], way).filter(|_| outline.contains(mids[k]));
        let across = Vec2::new(along.y, -along.x);
        let aside = reach(across).unwrap_or(0.0) - reach(-across).unwrap_or(0.0);
        mids[k] + across * 0.5 * aside
    };
    (0..n).map(middle).collect()
}

/// Carries both ends of a midrib on to the outline as it bends before, instead of what leans into a corner there.
fn to_the_ends(outline: &Outline, mut mids: Vec<Vec2>) -> Vec<Vec2> {
    let step = polyline::length(&mids) / mids.len() as f32;
    let longest = mids.len() / 3;
    for _ in 0..2 {
        mids.reverse();
        let inner = mids.len() * 9 / 10;
        let along = (mids[inner] - mids[inner - 3]).normalize_or(Vec2::Y);
        let reach = |way: Vec2| outline.reach(mids[inner], way).unwrap_or(0.0);
        let width = reach(along.perp()) + reach(-along.perp());
        let doubtful = ((0.8 * width / step) as usize).clamp(2, mids.len() / 6);
        mids.truncate(mids.len() - doubtful);

        let trusted = mids.len();
        let (last, stretch) = (trusted - 1, trusted / 8);
        let chord = |from: usize| (mids[from + stretch] - mids[from]).normalize_or(along);
        let (before, after) = (chord(last - 2 * stretch), chord(last - stretch));
        let turn = before.angle_to(after) / stretch as f32;
        let mut ahead = Vec2::from_angle(0.5 * turn * stretch as f32).rotate(after);
        for _ in 0..longest {
            ahead = Vec2::from_angle(turn).rotate(ahead);
            let last = mids[mids.len() - 1];
            let left = outline.reach(last, ahead).filter(|left| *left < step);
            mids.push(last + ahead * left.unwrap_or(step));
            if left.is_some() {
                break;
            }
        }
        // It may pass beside a point that lies farther ahead.
        let end = mids[mids.len() - 1];
        let off = |point: &Vec2| ((*point - end).dot(ahead), (*point - end).dot(ahead.perp()).abs());
        let near = outline.points.iter().filter(|point| point.distance(end) < 0.6 * width);
        let point = near.max_by(|a, b| off(a).0.total_cmp(&off(b).0));
        if let Some(point) = point.filter(|point| off(point).0 > 0.7 * off(point).1) {
            mids.truncate(trusted);
            mids.push(*point);
        }
    }
    polyline::resample(&mids, STATIONS)
}

/// Metres, few knots, a name.
fn finished(drawn: &[Drawn], index: usize, name: &str, params: &ImportParams) -> Result<Blade, BladeError> {
    let mids: Vec<Vec2> = drawn.iter().map(|(mid, ..)| *mid).collect();
    let length = polyline::length(&mids);
    let metres = params.length_m.map_or(1e-3, |wanted| wanted / length);
    let root = mids[0];
    let knot = |(mid, across, [left, right]): &Drawn| Knot {
        position: ((*mid - root) * metres).extend(0.0),
        half_width_left: left * metres,
        across: across.extend(0.0),
        half_width_right: right * metres,
    };
    let skeleton: Vec<Knot> = drawn.iter().map(knot).collect();
    let midrib: Vec<Vec3> = skeleton.iter().map(|knot| knot.position).collect();
    let motion = &motions_in_wind(&[&midrib], MOTION_FRAMES)[0];
    let knots = refine(&skeleton, motion, &params.refine).knots;
    let widest = skeleton.iter().map(Knot::width).fold(0.0, f32::max);
    let id = BladeId::of(params.unix_ns, index as u32, &knots);
    let name = named(name).unwrap_or_else(|| format!("drawn-{}", &id.to_string()[..8]));
    Blade::new(id, name, knots, [length * metres, widest], params.unix_ns, 1.0)
}

/// A path's name as a blade can have it.
fn named(name: &str) -> Option<String> {
    let clean: String = name.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let mut clean = clean.trim().to_owned();
    while clean.len() > MAX_NAME_BYTES {
        clean.pop();
    }
    (!clean.is_empty()).then_some(clean)
}
