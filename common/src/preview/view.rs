//! A validated view of a preview's bytes: after [`Preview::validate`] every part is in bounds, every number
//! within its range, and every text is text.

use super::layout::{
    CaptureNote, HAND, HEADER_BYTES, Header, MAGIC, MAX_CODE_BYTES, MAX_PIXELS, MAX_POINTS, MAX_POLYLINES,
    MAX_WORDS_BYTES, POINT_BYTES, POLYLINE_BYTES, Point, PolylineKind, SEEN, Sections, State, VERSION,
    header, polyline,
};
use crate::head::{Head, HeadError, array, f32_at, u32_at, u64_at};

/// How it begins.
const HEAD: Head = Head {
    of: "a preview",
    magic: MAGIC,
    version: (header::VERSION, VERSION),
    size: (header::HEADER_SIZE, HEADER_BYTES),
};

/// Why some bytes are not a preview.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PreviewError {
    /// It does not begin as it should.
    #[error(transparent)]
    Head(#[from] HeadError),
    /// The image is too large, or has no columns or no rows, but not both.
    #[error("{width}×{height} pixels; expected none at all, or at most {MAX_PIXELS}")]
    Image {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// More of something than a preview holds.
    #[error("{found} {what}; a preview holds at most {most}")]
    TooMany {
        /// Of what.
        what: &'static str,
        /// How many there are.
        found: u32,
        /// How many there may be.
        most: usize,
    },
    /// Sizes, the stated total and the bytes there do not agree.
    #[error("its parts take {expected} bytes, the header says {stated}, there are {found}")]
    Size {
        /// Bytes that the parts take.
        expected: u64,
        /// Bytes by the header.
        stated: u64,
        /// Bytes there.
        found: u64,
    },
    /// A number is out of its range.
    #[error("{field} is {value}, out of range")]
    Number {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// Bytes that must be zero are not.
    #[error("reserved bytes {0} are not zero")]
    Reserved(&'static str),
    /// A text is none, or not of the letters it is to be of.
    #[error("the {0} is no text")]
    Text(&'static str),
    /// A pixel of the mask has a bit that means nothing.
    #[error("pixel {0}: the mask has bits beside seen and hand")]
    Mask(usize),
    /// A polyline is of no kind.
    #[error("polyline {0}: kind {1}, expected 0 or 1")]
    Kind(u32, u32),
    /// A polyline's points are not those behind the points of the one before.
    #[error(
        "polyline {line}: points {first}..{first}+{count} of {of}, expected at least 2 from {expected} on"
    )]
    PointRange {
        /// Index of the polyline.
        line: u32,
        /// Its first point.
        first: u32,
        /// Its number of points.
        count: u32,
        /// The first point that no polyline before it has.
        expected: u32,
        /// Points in the preview.
        of: u32,
    },
    /// A point is nowhere, or has a half width below zero.
    #[error("point {0}: expected finite numbers and half widths of 0 or more")]
    Point(usize),
}

/// A validated preview over bytes `B` (a mapping, a vector). `B` must give the same bytes at each call, as a
/// sealed mapping does.
#[derive(Debug)]
pub struct Preview<B> {
    bytes: B,
    header: Header,
    sections: Sections,
}

impl<B: AsRef<[u8]>> Preview<B> {
    /// Checks every byte once. O(total); allocates nothing that the bytes could make large.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn validate(bytes: B) -> Result<Self, PreviewError> {
        let all = bytes.as_ref();
        HEAD.check(all)?;
        let sections = sections(all)?;
        let header = read_header(all)?;
        let preview = Self { header, sections, bytes };
        preview.validate_parts()?;
        Ok(preview)
    }

    fn validate_parts(&self) -> Result<(), PreviewError> {
        let all = self.bytes.as_ref();
        let code = &all[header::CODE..header::CODE + MAX_CODE_BYTES];
        let used = used(code);
        let letters = code[..used].iter().all(|byte| byte.is_ascii_lowercase() || *byte == b'_');
        if used == 0 || !letters || code[used..].iter().any(|byte| *byte != 0) {
            return Err(PreviewError::Text("code"));
        }
        if std::str::from_utf8(&all[self.sections.words..]).is_err() {
            return Err(PreviewError::Text("words"));
        }
        // Most have no such bit at all, which is told many pixels at a time.
        let strange = |bits: &u8| bits & !(SEEN | HAND) != 0;
        if self.mask().iter().fold(0, |all, bits| all | bits) & !(SEEN | HAND) != 0 {
            return Err(PreviewError::Mask(self.mask().iter().position(strange).unwrap_or(0)));
        }
        let (mut next, of) = (0, ((self.sections.words - self.sections.points) / POINT_BYTES) as u32);
        for (line, record) in (0..).zip(self.records()) {
            let [kind, first, count] =
                [polyline::KIND, polyline::FIRST, polyline::COUNT].map(|at| u32_at(record, at));
            if kind > 1 {
                return Err(PreviewError::Kind(line, kind));
            }
            if first != next || count < 2 || count > of - next {
                return Err(PreviewError::PointRange { line, first, count, expected: next, of });
            }
            next += count;
        }
        if next != of {
            return Err(PreviewError::PointRange {
                line: self.polylines().len() as u32,
                first: next,
                count: 0,
                expected: next,
                of,
            });
        }
        let is_point = |point: Point| {
            let Point { x, y, half_width_left, half_width_right } = point;
            let finite = [x, y, half_width_left, half_width_right].iter().all(|number| number.is_finite());
            finite && half_width_left >= 0.0 && half_width_right >= 0.0
        };
        let points = &all[self.sections.points..self.sections.words];
        match points.chunks_exact(POINT_BYTES).position(|bytes| !is_point(point(bytes))) {
            Some(index) => Err(PreviewError::Point(index)),
            None => Ok(()),
        }
    }

    /// What the header says.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Depth, row-major, millimetres; 0: no reading.
    pub fn depth_mm(&self) -> impl ExactSizeIterator<Item = u16> {
        let plane = &self.bytes.as_ref()[HEADER_BYTES..self.sections.mask];
        plane.chunks_exact(2).map(|bytes| u16::from_le_bytes(array(bytes, 0)))
    }

    /// [`SEEN`] and [`HAND`] of each pixel, row-major.
    pub fn mask(&self) -> &[u8] {
        &self.bytes.as_ref()[self.sections.mask..self.sections.labels]
    }

    /// The part of the capture that each pixel is of, row-major; 0: of none.
    pub fn labels(&self) -> &[u8] {
        &self.bytes.as_ref()[self.sections.labels..self.sections.padding]
    }

    /// Contours and skeletons.
    pub fn polylines(&self) -> impl ExactSizeIterator<Item = PolylineView<'_>> {
        let points = &self.bytes.as_ref()[self.sections.points..self.sections.words];
        self.records().map(move |record| {
            let first = u32_at(record, polyline::FIRST) as usize;
            let end = first + u32_at(record, polyline::COUNT) as usize;
            PolylineView { record, points: &points[POINT_BYTES * first..POINT_BYTES * end] }
        })
    }

    /// What to tell the visitor, for programs.
    pub fn code(&self) -> &str {
        let code = &self.bytes.as_ref()[header::CODE..header::CODE + MAX_CODE_BYTES];
        std::str::from_utf8(&code[..used(code)]).expect("validated")
    }

    /// The same in plain words.
    pub fn words(&self) -> &str {
        std::str::from_utf8(&self.bytes.as_ref()[self.sections.words..]).expect("validated")
    }

    /// All bytes.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.as_ref()
    }

    fn records(&self) -> impl ExactSizeIterator<Item = &[u8]> {
        self.bytes.as_ref()[self.sections.polylines..self.sections.points].chunks_exact(POLYLINE_BYTES)
    }
}

/// One polyline of a validated preview.
#[derive(Clone, Copy, Debug)]
pub struct PolylineView<'a> {
    record: &'a [u8],
    points: &'a [u8],
}

impl PolylineView<'_> {
    /// Contour or skeleton.
    pub fn kind(&self) -> PolylineKind {
        if u32_at(self.record, polyline::KIND) == 0 { PolylineKind::Contour } else { PolylineKind::Skeleton }
    }

    /// Of a skeleton: the number of its blade in the capture, from 1; 0 for one that was refused. Of a contour:
    /// its own number.
    pub fn label(&self) -> u32 {
        u32_at(self.record, polyline::LABEL)
    }

    /// Its points, pixels; a skeleton's from root to tip.
    pub fn points(&self) -> impl ExactSizeIterator<Item = Point> {
        self.points.chunks_exact(POINT_BYTES).map(point)
    }
}

/// Where the parts are, by sizes that are within the limits and add up to what is there.
fn sections(all: &[u8]) -> Result<Sections, PreviewError> {
    let [width, height] = [header::WIDTH, header::HEIGHT].map(|at| u32_at(all, at));
    let pixels = u64::from(width) * u64::from(height);
    if pixels > MAX_PIXELS as u64 || (width == 0) != (height == 0) {
        return Err(PreviewError::Image { width, height });
    }
    let [polylines, points, words] =
        [header::POLYLINES, header::POINTS, header::WORDS].map(|at| u32_at(all, at));
    for (what, found, most) in [
        ("polylines", polylines, MAX_POLYLINES),
        ("points", points, MAX_POINTS),
        ("bytes of words", words, MAX_WORDS_BYTES),
    ] {
        if found as usize > most {
            return Err(PreviewError::TooMany { what, found, most });
        }
    }
    let sections = Sections::of(pixels as usize, polylines as usize, points as usize, words as usize);
    let (expected, stated) = (sections.total as u64, u64_at(all, header::TOTAL));
    let found = all.len() as u64;
    if stated != expected || found != expected {
        return Err(PreviewError::Size { expected, stated, found });
    }
    for (place, bytes) in [
        ("of the header", &all[header::RESERVED..HEADER_BYTES]),
        ("behind the planes", &all[sections.padding..sections.polylines]),
    ] {
        if bytes.iter().any(|byte| *byte != 0) {
            return Err(PreviewError::Reserved(place));
        }
    }
    Ok(sections)
}

fn read_header(all: &[u8]) -> Result<Header, PreviewError> {
    let number = |field, value: f64, valid: bool| {
        if value.is_finite() && valid { Ok(()) } else { Err(PreviewError::Number { field, value }) }
    };
    let [width, height, state, has_capture, blades] =
        [header::WIDTH, header::HEIGHT, header::STATE, header::HAS_CAPTURE, header::CAPTURE_BLADES]
            .map(|at| u32_at(all, at));
    let camera_px = [0, 1, 2, 3].map(|index| f32_at(all, header::CAMERA + 4 * index));
    let names = ["camera fx", "camera fy", "camera cx", "camera cy"];
    for (index, (field, value)) in names.into_iter().zip(camera_px).enumerate() {
        number(field, f64::from(value), index >= 2 || value > 0.0 || (width == 0 && value == 0.0))?;
    }
    let hold = f32_at(all, header::HOLD);
    number("progress of the hold", f64::from(hold), (0.0..=1.0).contains(&hold))?;
    let known = State::ALL.get(state as usize).copied();
    let state = known.ok_or(PreviewError::Number { field: "state", value: f64::from(state) })?;
    let note = CaptureNote {
        frame: u64_at(all, header::CAPTURE_FRAME),
        timestamp_ns: u64_at(all, header::CAPTURE_TIMESTAMP),
        blades,
    };
    let none = CaptureNote { frame: 0, timestamp_ns: 0, blades: 0 };
    number("whether there is a capture", f64::from(has_capture), has_capture < 2)?;
    if has_capture == 0 && note != none {
        return Err(PreviewError::Reserved("of a capture that is not there"));
    }
    Ok(Header {
        sequence: u64_at(all, header::SEQUENCE),
        frame: u64_at(all, header::FRAME),
        timestamp_ns: u64_at(all, header::TIMESTAMP),
        width,
        height,
        camera_px,
        window_mm: [0, 2].map(|at| u16::from_le_bytes(array(all, header::WINDOW + at))),
        state,
        hold,
        capture: (has_capture == 1).then_some(note),
    })
}

/// How many bytes of a field are before its padding.
fn used(field: &[u8]) -> usize {
    field.iter().position(|byte| *byte == 0).unwrap_or(field.len())
}

fn point(bytes: &[u8]) -> Point {
    let [x, y, half_width_left, half_width_right] = [0, 4, 8, 12].map(|at| f32_at(bytes, at));
    Point { x, y, half_width_left, half_width_right }
}
