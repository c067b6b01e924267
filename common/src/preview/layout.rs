//! The bytes of a preview, little-endian: header at 0, planes at 160, then polylines, their points, and the
//! words for the visitor. Nothing in it says where a part is: each begins where the one before it ends.

use bytemuck::{Pod, Zeroable};

/// The first eight bytes.
pub const MAGIC: [u8; 8] = *b"SWARDPRV";
/// Version of this layout.
pub const VERSION: u32 = 1;
/// Bytes of the header.
pub const HEADER_BYTES: usize = 160;
/// Bytes of a polyline's record.
pub const POLYLINE_BYTES: usize = 16;
/// Bytes of a point.
pub const POINT_BYTES: usize = 16;
/// Polylines begin at a multiple of so many bytes.
pub const ALIGNMENT: usize = 16;
/// Most pixels: 1280×1024.
pub const MAX_PIXELS: usize = 1280 * 1024;
/// Most polylines.
pub const MAX_POLYLINES: usize = 4096;
/// Most points of all polylines.
pub const MAX_POINTS: usize = 1 << 16;
/// Most bytes of the code.
pub const MAX_CODE_BYTES: usize = 24;
/// Most bytes of the words.
pub const MAX_WORDS_BYTES: usize = 512;
/// Largest preview that a receiver accepts.
pub const MAX_BYTES: u64 = (HEADER_BYTES
    + 4 * MAX_PIXELS
    + POLYLINE_BYTES * MAX_POLYLINES
    + POINT_BYTES * MAX_POINTS
    + MAX_WORDS_BYTES) as u64;

/// Bit of the mask: the pixel lies within the depth window and the region of interest.
pub const SEEN: u8 = 1;
/// Bit of the mask: the pixel is of the hand that holds the blades.
pub const HAND: u8 = 2;

/// Byte offsets of the header's fields.
pub mod header {
    /// `[u8; 8]` magic.
    pub const MAGIC: usize = 0;
    /// `u32` layout version.
    pub const VERSION: usize = 8;
    /// `u32` header size, 160.
    pub const HEADER_SIZE: usize = 12;
    /// `u64` total bytes.
    pub const TOTAL: usize = 16;
    /// `u64` sequence number of the preview.
    pub const SEQUENCE: usize = 24;
    /// `u64` index of the frame in its source.
    pub const FRAME: usize = 32;
    /// `u64` the sensor's timestamp, nanoseconds since 1970.
    pub const TIMESTAMP: usize = 40;
    /// `u32` columns.
    pub const WIDTH: usize = 48;
    /// `u32` rows.
    pub const HEIGHT: usize = 52;
    /// `f32×4` fx, fy, cx, cy, pixels.
    pub const CAMERA: usize = 56;
    /// `u16×2` depth window, millimetres.
    pub const WINDOW: usize = 72;
    /// `u32` state.
    pub const STATE: usize = 76;
    /// `f32` progress of the hold.
    pub const HOLD: usize = 80;
    /// `u32` whether there is a capture.
    pub const HAS_CAPTURE: usize = 84;
    /// `u64` index of the frame that completed the capture.
    pub const CAPTURE_FRAME: usize = 88;
    /// `u64` that frame's timestamp, nanoseconds since 1970.
    pub const CAPTURE_TIMESTAMP: usize = 96;
    /// `u32` blades of the capture.
    pub const CAPTURE_BLADES: usize = 104;
    /// `u32` number of polylines.
    pub const POLYLINES: usize = 108;
    /// `u32` number of points.
    pub const POINTS: usize = 112;
    /// `u32` bytes of the words.
    pub const WORDS: usize = 116;
    /// `[u8; 24]` code, zero padded.
    pub const CODE: usize = 120;
    /// `[u8; 16]` zero.
    pub const RESERVED: usize = 144;
}

/// Byte offsets of the fields of a polyline's record.
pub mod polyline {
    /// `u32` kind.
    pub const KIND: usize = 0;
    /// `u32` label.
    pub const LABEL: usize = 4;
    /// `u32` index of the first point.
    pub const FIRST: usize = 8;
    /// `u32` number of points.
    pub const COUNT: usize = 12;
}

/// What the station is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum State {
    /// No frames come.
    NoSource = 0,
    /// Nothing is held before the camera.
    Waiting = 1,
    /// Something is, and the hold runs.
    Settling = 2,
    /// What is there has been captured.
    Captured = 3,
}

impl State {
    /// All of them, by their number.
    pub const ALL: [Self; 4] = [Self::NoSource, Self::Waiting, Self::Settling, Self::Captured];

    /// Its name in the interface.
    pub fn name(self) -> &'static str {
        match self {
            Self::NoSource => "no_source",
            Self::Waiting => "waiting",
            Self::Settling => "settling",
            Self::Captured => "captured",
        }
    }
}

/// The capture that is still before the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CaptureNote {
    /// Index of the frame that completed it, from 0, as in `replay --json`.
    pub frame: u64,
    /// That frame's timestamp, nanoseconds since 1970.
    pub timestamp_ns: u64,
    /// Its blades.
    pub blades: u32,
}

/// What the header says beside sizes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Header {
    /// Number of the preview since the station started, from 1; one for each frame.
    pub sequence: u64,
    /// Index of the frame in its source, from 0, as in `replay --json`; a recording that begins again counts
    /// anew.
    pub frame: u64,
    /// The sensor's timestamp, nanoseconds since 1970.
    pub timestamp_ns: u64,
    /// Columns; 0 without a frame.
    pub width: u32,
    /// Rows; 0 without a frame.
    pub height: u32,
    /// Focal lengths fx, fy, above 0 where there is a frame, and principal point cx, cy; pixels, pixel centres
    /// at integers.
    pub camera_px: [f32; 4],
    /// What counts as held before the camera, nearest and farthest depth, millimetres.
    pub window_mm: [u16; 2],
    /// What the station is doing.
    pub state: State,
    /// How much of the hold is over, 0..=1.
    pub hold: f32,
    /// The capture that is still before the camera; labels and skeletons are of it.
    pub capture: Option<CaptureNote>,
}

/// A point of a polyline.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Point {
    /// Column, pixels, pixel centres at integers.
    pub x: f32,
    /// Row, pixels.
    pub y: f32,
    /// Half width to the left, seen from the root to the tip with the root down, pixels, ≥ 0; 0 in a contour.
    pub half_width_left: f32,
    /// Half width to the right, pixels, ≥ 0; 0 in a contour.
    pub half_width_right: f32,
}

/// What a polyline is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum PolylineKind {
    /// The outline of what is held before the camera: closed, the first point not repeated.
    Contour = 0,
    /// A midrib from root to tip.
    Skeleton = 1,
}

/// A line in the image.
#[derive(Clone, Debug, PartialEq)]
pub struct Polyline {
    /// What it is.
    pub kind: PolylineKind,
    /// Of a skeleton: the number of its blade in the capture, from 1; 0 for one that was refused. Of a contour:
    /// its own number from 1.
    pub label: u32,
    /// Its points, pixels; at least two.
    pub points: Vec<Point>,
}

/// What goes into a preview. Planes are row-major, `width × height`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Content<'a> {
    /// The header.
    pub header: Header,
    /// Depth, millimetres; 0: no reading.
    pub depth_mm: &'a [u16],
    /// [`SEEN`] and [`HAND`] of each pixel.
    pub mask: &'a [u8],
    /// The part of the capture that each pixel is of; 0: of none.
    pub labels: &'a [u8],
    /// Contours and skeletons.
    pub polylines: &'a [Polyline],
    /// What to tell the visitor, for programs: 1 to 24 of `a` to `z` and `_`.
    pub code: &'a str,
    /// The same in plain words.
    pub words: &'a str,
}

/// Why something cannot be written as a preview.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// A plane has another size than the image, or the image is too large.
    #[error("{plane}: {found} pixels, expected {expected}, at most {MAX_PIXELS}")]
    Plane {
        /// Which.
        plane: &'static str,
        /// Its pixels.
        found: usize,
        /// Width × height.
        expected: usize,
    },
    /// More of something than a preview holds.
    #[error("{found} {what}; a preview holds at most {most}")]
    TooMany {
        /// Of what.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there may be.
        most: usize,
    },
}

/// Where the parts of a preview begin and end, from their sizes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sections {
    pub(super) mask: usize,
    pub(super) labels: usize,
    /// End of the planes.
    pub(super) padding: usize,
    pub(super) polylines: usize,
    pub(super) points: usize,
    pub(super) words: usize,
    pub(super) total: usize,
}

impl Sections {
    /// For sizes within the limits, so that nothing overflows.
    pub(super) fn of(pixels: usize, polylines: usize, points: usize, words: usize) -> Self {
        let mask = HEADER_BYTES + 2 * pixels;
        let labels = mask + pixels;
        let padding = labels + pixels;
        let polylines_at = padding.next_multiple_of(ALIGNMENT);
        let points_at = polylines_at + POLYLINE_BYTES * polylines;
        let words_at = points_at + POINT_BYTES * points;
        Self {
            mask,
            labels,
            padding,
            polylines: polylines_at,
            points: points_at,
            words: words_at,
            total: words_at + words,
        }
    }
}

/// Writes a preview. O(bytes).
///
/// # Errors
/// Planes of another size than the image, or more of something than a preview holds.
pub fn encode(content: &Content<'_>) -> Result<Vec<u8>, EncodeError> {
    let Content { header: head, depth_mm, mask, labels, polylines, code, words } = content;
    let pixels = head.width as usize * head.height as usize;
    for (plane, found) in [("depth", depth_mm.len()), ("mask", mask.len()), ("labels", labels.len())] {
        if found != pixels || pixels > MAX_PIXELS {
            return Err(EncodeError::Plane { plane, found, expected: pixels });
        }
    }
    let points = polylines.iter().map(|line| line.points.len()).sum();
    for (what, found, most) in [
        ("polylines", polylines.len(), MAX_POLYLINES),
        ("points", points, MAX_POINTS),
        ("bytes of a code", code.len(), MAX_CODE_BYTES),
        ("bytes of words", words.len(), MAX_WORDS_BYTES),
    ] {
        if found > most {
            return Err(EncodeError::TooMany { what, found, most });
        }
    }
    let sections = Sections::of(pixels, polylines.len(), points, words.len());
    let mut bytes = Vec::with_capacity(sections.total);
    bytes.resize(HEADER_BYTES, 0);
    put_header(&mut bytes, head);
    put(&mut bytes, header::TOTAL, (sections.total as u64).to_le_bytes());
    put(&mut bytes, header::POLYLINES, (polylines.len() as u32).to_le_bytes());
    put(&mut bytes, header::POINTS, (points as u32).to_le_bytes());
    put(&mut bytes, header::WORDS, (words.len() as u32).to_le_bytes());
    bytes[header::CODE..][..code.len()].copy_from_slice(code.as_bytes());

    if cfg!(target_endian = "little") {
        bytes.extend_from_slice(bytemuck::cast_slice(depth_mm));
    } else {
        bytes.extend(depth_mm.iter().flat_map(|depth| depth.to_le_bytes()));
    }
    bytes.extend_from_slice(mask);
    bytes.extend_from_slice(labels);
    bytes.resize(sections.polylines, 0);
    let mut first = 0;
    for line in *polylines {
        let count = line.points.len() as u32;
        let record = [line.kind as u32, line.label, first, count];
        bytes.extend(record.into_iter().flat_map(u32::to_le_bytes));
        first += count;
    }
    for point in polylines.iter().flat_map(|line| &line.points) {
        let fields = [point.x, point.y, point.half_width_left, point.half_width_right];
        bytes.extend(fields.into_iter().flat_map(f32::to_le_bytes));
    }
    bytes.extend_from_slice(words.as_bytes());
    Ok(bytes)
}

fn put_header(bytes: &mut [u8], head: &Header) {
    put(bytes, header::MAGIC, MAGIC);
    put(bytes, header::VERSION, VERSION.to_le_bytes());
    put(bytes, header::HEADER_SIZE, (HEADER_BYTES as u32).to_le_bytes());
    put(bytes, header::SEQUENCE, head.sequence.to_le_bytes());
    put(bytes, header::FRAME, head.frame.to_le_bytes());
    put(bytes, header::TIMESTAMP, head.timestamp_ns.to_le_bytes());
    put(bytes, header::WIDTH, head.width.to_le_bytes());
    put(bytes, header::HEIGHT, head.height.to_le_bytes());
    for (index, value) in head.camera_px.into_iter().enumerate() {
        put(bytes, header::CAMERA + 4 * index, value.to_le_bytes());
    }
    for (index, value) in head.window_mm.into_iter().enumerate() {
        put(bytes, header::WINDOW + 2 * index, value.to_le_bytes());
    }
    put(bytes, header::STATE, (head.state as u32).to_le_bytes());
    put(bytes, header::HOLD, head.hold.to_le_bytes());
    if let Some(capture) = head.capture {
        put(bytes, header::HAS_CAPTURE, 1_u32.to_le_bytes());
        put(bytes, header::CAPTURE_FRAME, capture.frame.to_le_bytes());
        put(bytes, header::CAPTURE_TIMESTAMP, capture.timestamp_ns.to_le_bytes());
        put(bytes, header::CAPTURE_BLADES, capture.blades.to_le_bytes());
    }
}

fn put<const N: usize>(bytes: &mut [u8], at: usize, value: [u8; N]) {
    bytes[at..at + N].copy_from_slice(&value);
}
