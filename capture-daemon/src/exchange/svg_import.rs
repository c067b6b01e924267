//! SVG outlines, drawn by an artist or written by [`super::svg_export`], → blades.
//!
//! Each closed path is a blade. Its midrib is the open path inside of it whose id begins with `midrib`; without
//! one it is found (`exchange/midrib.rs`). A blade has one width to each side of its midrib at every place: of what is
//! toothed or lobed it is the nearest that such a blade can be (`exchange/section.rs`), and how near is said with it.
//! Widths are those of the drawn curves, not of pixels. What a blade is called: `exchange/labels.rs`.

use common::blade::{Blade, BladeId, MAX_NAME_BYTES};
use common::geometry::polyline;
use common::library::layout::MAX_BLADES as MAX_LIBRARY_BLADES;
use common::refine::RefineParams;
use glam::Vec2;
use usvg::roxmltree;
use usvg::tiny_skia_path::{PathSegment, Point};

pub use super::fit::MidribOrigin;
use super::fit::{Fitted, fit};
use super::labels::Labels;
pub use super::likeness::Likeness;
use super::outline::Outline;

/// Longest file that is read, bytes: a full library as it is exported is no longer.
pub const MAX_BYTES: usize = 64 << 20;
/// Most blades in one file: as many as a library holds.
pub const MAX_BLADES: usize = MAX_LIBRARY_BLADES;
/// Points that an outline has at most, its curves divided: what follows takes time by their number. One that has more
/// gets as many, at equal distances along it.
const MAX_POINTS: usize = 6_000;
/// Straight pieces of a curve segment, at most.
const MAX_PIECES: f32 = 24.0;
/// As far as this share of its path's size, a curve may be from its pieces.
const FLATNESS: f32 = 5e-5;
/// Points nearer to the last one than this share of an outline's size are left out.
const THINNED: f32 = 1.25e-4;

const CROSSES: &str =
    "its outline crosses itself; expected a single curve around the blade: take the loop out of it";

const FLAT: &str = "it is closed and has no area; expected a curve around the blade";

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
    #[error("{0}; expected an SVG drawing of at most 64 MiB")]
    NotSvg(String),
    /// Nothing closed in it.
    #[error(
        "there is no closed path in the drawing; expected one for each blade (shapes count; text, pictures, what is \
         hidden, has no size or cannot be read as a path does not)"
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

/// A blade of a drawing, and what became of it on the way.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnBlade {
    /// It is flat: z is 0, x to the right as drawn, the root at the origin.
    pub blade: Blade,
    /// What its path is called, or the group around it; empty where it is called nothing.
    pub label: String,
    /// How like it is to its outline.
    pub likeness: Likeness,
    /// Where its midrib comes from.
    pub midrib: MidribOrigin,
    /// Its millimetres for one of the drawing.
    pub scale: f32,
}

/// The blades of a drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// In the order of its paths.
    pub blades: Vec<DrawnBlade>,
    /// What the midribs are called that lie in no outline, or in one that has another.
    pub unused_midribs: Vec<String>,
    /// What the closed paths are called that have no area, and are no blades.
    pub flat: Vec<String>,
}

/// The blades of a drawing, each with the name of its path (or of the group around it) as far as it has one.
///
/// # Errors
/// When the text is no SVG, holds no closed path, or one of them is no blade; all or none.
pub fn read(svg: &[u8], params: &ImportParams) -> Result<Drawing, ImportError> {
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
    let mut paths = Paths { labels: Labels::of(&elements), ..Paths::default() };
    paths.collect(tree.root(), "");
    if paths.outlines.is_empty() {
        return Err(match paths.flat.into_iter().next() {
            Some(name) => ImportError::Outline { name, reason: FLAT.to_owned() },
            None => ImportError::NoOutline,
        });
    }
    if paths.outlines.len() > MAX_BLADES {
        return Err(ImportError::TooMany(paths.outlines.len()));
    }
    let mut is_used = vec![false; paths.midribs.len()];
    let mut blades = Vec::with_capacity(paths.outlines.len());
    for (index, (name, contours)) in paths.outlines.iter().enumerate() {
        let shown = if name.is_empty() { (index + 1).to_string() } else { name.clone() };
        let wrong = |reason: String| ImportError::Outline { name: shown.clone(), reason };
        let outline = &only(contours).map_err(wrong)?;
        let midrib = paths.midrib_in(outline);
        midrib.into_iter().for_each(|used| is_used[used] = true);
        let midrib = midrib.map(|index| paths.midribs[index].points.as_slice());
        let reasoned = |reason: String| wrong(if outline.crosses_itself() { CROSSES.into() } else { reason });
        let fitted = fit(outline, midrib, params).map_err(reasoned)?;
        let id = BladeId::of(params.unix_ns, index as u32, &fitted.knots);
        let called = named(name).unwrap_or_else(|| format!("drawn-{}", &id.to_string()[..8]));
        let blade = Blade::new(id, called, fitted.knots.clone(), fitted.size_m, params.unix_ns, 1.0);
        let blade = blade.map_err(|error| wrong(error.to_string()))?;
        let Fitted { likeness, midrib, scale, .. } = fitted;
        blades.push(DrawnBlade { blade, label: name.clone(), likeness, midrib, scale });
    }
    let unused = paths.midribs.into_iter().zip(is_used).filter(|(_, is_used)| !is_used);
    let unused_midribs = unused.map(|(midrib, _)| midrib.name).collect();
    Ok(Drawing { blades, unused_midribs, flat: paths.flat })
}

/// What a drawing holds, in its own pixels, y upwards.
#[derive(Default)]
struct Paths {
    outlines: Vec<(String, Vec<Outline>)>,
    midribs: Vec<Midrib>,
    flat: Vec<String>,
    labels: Labels,
}

/// A midrib as it is drawn.
struct Midrib {
    name: String,
    points: Vec<Vec2>,
    /// At equal distances, for where it lies.
    places: Vec<Vec2>,
    /// Lower and upper corner of the box around it.
    bounds: [Vec2; 2],
}

impl Midrib {
    /// `points`: 2 or more.
    fn new(name: &str, points: Vec<Vec2>) -> Self {
        const PLACES: usize = 33;
        let around = Outline { points };
        let bounds = around.bounds();
        let points = around.points;
        Self { name: name.to_owned(), places: polyline::resample(&points, PLACES), points, bounds }
    }
}

impl Paths {
    /// The midrib of which the most lies in an outline. O(midribs + points · midribs near it).
    fn midrib_in(&self, outline: &Outline) -> Option<usize> {
        let [low, high] = outline.bounds();
        let is_near = |place: &&Vec2| place.cmpge(low).all() && place.cmple(high).all();
        let within = |midrib: &Midrib| {
            midrib.places.iter().filter(is_near).filter(|place| outline.contains(**place)).count()
        };
        let is_beside =
            |midrib: &Midrib| midrib.bounds[0].cmple(high).all() && midrib.bounds[1].cmpge(low).all();
        let beside = self.midribs.iter().enumerate().filter(|(_, midrib)| is_beside(midrib));
        let counted = beside.map(|(index, midrib)| (within(midrib), index));
        // Of two that are there equally, the first.
        let most =
            counted.filter(|(count, _)| *count > 0).max_by_key(|(count, index)| (*count, usize::MAX - index));
        most.map(|(_, index)| index)
    }

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
            let lines = contours.into_iter().map(|(points, _)| points).filter(|it| it.len() >= 2);
            self.midribs.extend(lines.map(|points| Midrib::new(name, points)));
            return;
        }
        let is_nameless = name.is_empty() || name.starts_with("outline-");
        let name = if is_nameless { group } else { name };
        let mut closed = contours.into_iter().filter(|(_, closed)| *closed).peekable();
        let is_closed = closed.peek().is_some();
        let outlines =
            closed.map(|(points, _)| Outline { points }).filter(|outline| outline.points.len() >= 3);
        let outlines: Vec<Outline> = outlines.collect();
        if !outlines.is_empty() {
            self.outlines.push((name.to_owned(), outlines));
        } else if is_closed {
            self.flat.push(name.to_owned());
        }
    }
}

/// The contours of a path, in millimetres, y upwards, each with whether it is closed.
fn contours(path: &usvg::Path) -> Vec<(Vec<Vec2>, bool)> {
    const MM_PER_PX: f32 = 25.4 / 96.0;
    let Some(data) = path.data().clone().transform(path.abs_transform()) else { return Vec::new() };
    let mm = |point: Point| Vec2::new(point.x, -point.y) * MM_PER_PX;
    let bounds = data.bounds();
    let flat = FLATNESS * bounds.width().max(bounds.height()) * MM_PER_PX;
    // A parabola with this second difference is so far from its pieces.
    let pieces = |bend: Vec2| {
        (0.25 * bend.length() / flat.max(f32::MIN_POSITIVE)).sqrt().ceil().clamp(1.0, MAX_PIECES)
    };
    let mut found: Vec<(Vec<Vec2>, bool)> = Vec::new();
    for segment in data.segments() {
        if let PathSegment::MoveTo(to) = segment {
            found.push((vec![mm(to)], false));
            continue;
        }
        let Some((points, closed)) = found.last_mut() else { continue };
        let from = *points.last().expect("begun by a point");
        match segment {
            PathSegment::MoveTo(_) => {}
            PathSegment::LineTo(to) => points.push(mm(to)),
            PathSegment::QuadTo(a, to) => {
                let (a, to) = (mm(a), mm(to));
                let at = |t: f32| from.lerp(a, t).lerp(a.lerp(to, t), t);
                let pieces = pieces(from - 2.0 * a + to);
                points.extend((1..=pieces as usize).map(|k| at(k as f32 / pieces)));
            }
            PathSegment::CubicTo(a, b, to) => {
                let (a, b, to) = (mm(a), mm(b), mm(to));
                let at = |t: f32| {
                    let (first, middle, last) = (from.lerp(a, t), a.lerp(b, t), b.lerp(to, t));
                    first.lerp(middle, t).lerp(middle.lerp(last, t), t)
                };
                let bends = [from - 2.0 * a + b, a - 2.0 * b + to].map(Vec2::abs);
                let pieces = pieces(3.0 * bends[0].max(bends[1]));
                points.extend((1..=pieces as usize).map(|k| at(k as f32 / pieces)));
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
fn only(contours: &[Outline]) -> Result<Outline, String> {
    let largest = contours.iter().max_by(|a, b| a.area().total_cmp(&b.area())).expect("a path has contours");
    let second =
        contours.iter().filter(|it| !std::ptr::eq(*it, largest)).map(Outline::area).fold(0.0, f32::max);
    if second > 0.01 * largest.area() {
        return Err(
            "it has holes or several contours; expected one closed curve for one blade: take them apart"
                .into(),
        );
    }
    let [low, high] = largest.bounds();
    let size = high - low;
    if !(size.is_finite() && size.max_element() > 1e-3 && size.max_element() < 1e5) {
        return Err(format!("it is {} mm by {} mm; expected 0.001 mm to 100 m", size.x, size.y));
    }
    let mut thinned = largest.thinned(THINNED * size.max_element());
    if thinned.points.len() > MAX_POINTS {
        thinned.points.extend(thinned.points.first().copied());
        thinned.points = polyline::resample(&thinned.points, MAX_POINTS + 1);
        thinned.points.pop();
    }
    Ok(if thinned.points.len() < 3 { largest.clone() } else { thinned })
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
