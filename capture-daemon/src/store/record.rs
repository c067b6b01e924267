//! A blade as a file: TOML that people can read and write.
//!
//! The smallest file that is a blade has its format and its knots:
//!
//! ```toml
//! format = 1
//! knots = [
//!   { position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004] },
//!   { position_m = [0.0, 0.2, 0.0], half_width_m = [0.0, 0.0] },
//! ]
//! ```

use std::fmt::Write;
use std::ops::Range;

use common::blade::{Blade, BladeError, BladeId, Knot, KnotError, MAX_NAME_BYTES, check_knots};
use glam::Vec3;
use serde::Deserialize;
use toml::Spanned;

use crate::mistake;

/// The format that is written, and the only one that is read.
pub const FORMAT: i64 = 1;
/// How far a written `across` may be from unit length; it is made exact when it is read.
const ACROSS_TOLERANCE: f32 = 0.02;
/// How long a blade may be, metres.
const LENGTH_M: std::ops::RangeInclusive<f32> = 0.001..=10.0;

/// A blade and what is known of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// The blade.
    pub blade: Blade,
    /// Never goes to the archive by itself.
    pub pinned: bool,
    /// Its place in the library's order: captures are counted. Blades without one come last.
    pub sequence: Option<u64>,
    /// How well it was measured, where it was.
    pub measured: Option<Measured>,
    /// Where it comes from.
    pub provenance: Provenance,
}

/// How well a captured blade was measured.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// Pixels across its widest part.
    pub pixels_across: f32,
    /// Hausdorff distance of the refined midrib to the raw one, metres.
    pub hausdorff_m: f32,
    /// Predicted error of the length, metres.
    pub length_error_m: f32,
    /// Predicted error of the width, metres.
    pub width_error_m: f32,
}

/// Where a blade comes from; what is not known is left out.
#[derive(Clone, Debug, PartialEq, Eq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The recording, or the sensor and its serial.
    pub source: Option<String>,
    /// Index of the frame that completed the capture, since the source was opened.
    pub frame: Option<u64>,
    /// Frames that were added up.
    pub frames: Option<u64>,
    /// Its place in the capture, from the left.
    pub index: Option<u64>,
    /// Hex of the first 8 bytes of BLAKE3 over the configuration.
    pub config: Option<String>,
}

/// Why a text is no blade.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{line}:{column}: {reason}")]
pub struct RecordError {
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// What is wrong and what was expected; no full stop.
    pub reason: String,
}

/// Whether a blade in the store may have this name: it is the name of a file.
///
/// # Errors
/// What is wrong with it and what was expected; no full stop.
pub fn check_name(name: &str) -> Result<(), String> {
    let wrong = if name.is_empty() || name.len() > MAX_NAME_BYTES {
        format!("has {} bytes", name.len())
    } else if name.contains('/') || name.chars().any(|c| c.is_control() || is_invisible(c)) {
        "holds a slash, or a character that controls or is not seen".to_owned()
    } else if name.starts_with('.') || name.trim() != name {
        "begins with a dot or a space, or ends with a space".to_owned()
    } else {
        return Ok(());
    };
    // One may be as long as a file's.
    let shown: String = name.chars().take(MAX_NAME_BYTES).collect();
    let more = if shown.len() < name.len() { "..." } else { "" };
    Err(format!(
        "the name {shown:?}{more} {wrong}, expected 1 to {MAX_NAME_BYTES} bytes without slash, control character, leading dot, or space at either end"
    ))
}

/// Whether a character turns the direction of a line around or takes no room in it: a name would not read as it
/// is (Unicode's bidirectional controls, separators and zero-width characters).
fn is_invisible(c: char) -> bool {
    matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{61c}' | '\u{feff}')
}

/// A file with every key that there is.
const EXAMPLE: &str = r#"format = 1
id = "0123456789abcdef0123456789abcdef"
sequence = 1
pinned = false
mix = 1.0
length_m = 0.2
max_width_m = 0.008
shape = "0123456789abcdef"
quality = 1.0
captured_unix_ns = 1700000000000000000
knots = [
  { position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004], across = [1.0, 0.0, 0.0] },
  { position_m = [0.0, 0.2, 0.0], half_width_m = [0.0, 0.0], across = [1.0, 0.0, 0.0] },
]

[measured]
pixels_across = 8.0
hausdorff_m = 0.0001
length_error_m = 0.001
width_error_m = 0.0001

[provenance]
source = "fern.svg"
frame = 31
frames = 15
index = 0
config = "0123456789abcdef"
"#;

#[derive(Deserialize)]
struct Version {
    format: Spanned<i64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(rename = "format")]
    _format: i64,
    id: Option<Spanned<String>>,
    sequence: Option<u64>,
    #[serde(default)]
    pinned: bool,
    mix: Option<Spanned<f32>>,
    length_m: Option<Spanned<f32>>,
    max_width_m: Option<Spanned<f32>>,
    shape: Option<String>,
    quality: Option<Spanned<f32>>,
    captured_unix_ns: Option<u64>,
    knots: Spanned<Vec<Spanned<FileKnot>>>,
    measured: Option<Measured>,
    #[serde(default)]
    provenance: Provenance,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileKnot {
    position_m: [f32; 3],
    half_width_m: [f32; 2],
    across: Option<[f32; 3]>,
}

/// Line and column of a byte of `text`, both from 1, columns in characters.
pub(crate) fn place(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset.min(text.len())).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    (line, before.chars().rev().take_while(|c| *c != '\n').count() + 1)
}

impl Record {
    /// Reads the blade of this `name` from its file's `text`. `modified_unix_ns`: when the file was
    /// last changed, the time of a blade that does not say when it was captured.
    ///
    /// Without `id`, it is made of the name and the knots; without `length_m` and `max_width_m`, or where
    /// `shape` says that the knots have been changed since, they are measured on the knots, and what was known
    /// of how well they were measured is void; `mix` and `quality` are 1 where they are not given.
    ///
    /// # Errors
    /// The first thing that is wrong, with line and column.
    pub fn parse(name: &str, text: &str, modified_unix_ns: u64) -> Result<Self, RecordError> {
        let at = |span: Range<usize>, reason: String| {
            let (line, column) = place(text, span.start);
            RecordError { line, column, reason }
        };
        let toml = |error: toml::de::Error| {
            at(error.span().unwrap_or_default(), mistake::reason(&error, text, EXAMPLE))
        };
        check_name(name).map_err(|reason| at(0..0, reason))?;
        let version: Version = toml::from_str(text).map_err(toml)?;
        if *version.format.get_ref() != FORMAT {
            let found = version.format.get_ref();
            let reason = format!("`format` is {found}, expected {FORMAT}: this program reads no other");
            return Err(at(version.format.span(), reason));
        }
        let file: File = toml::from_str(text).map_err(toml)?;
        let knots: Vec<Knot> = file.knots.get_ref().iter().map(|knot| knot.get_ref().knot()).collect();
        check_knots(&knots).map_err(|error| {
            let index = match error {
                KnotError::Count(_) => None,
                KnotError::NotFinite(index)
                | KnotError::NegativeWidth(index)
                | KnotError::AcrossNotUnit(index, _)
                | KnotError::ArcLengthStalls(index) => Some(index),
            };
            let spanned = index.and_then(|index| file.knots.get_ref().get(index));
            at(spanned.map_or_else(|| file.knots.span(), Spanned::span), error.to_string())
        })?;
        let id = match &file.id {
            None => made_id(name, 0, &knots),
            Some(id) => parse_id(id.get_ref()).ok_or_else(|| {
                at(
                    id.span(),
                    "`id` is not 32 hexadecimal digits; leave the line out to have one made".to_owned(),
                )
            })?,
        };
        let number = |given: &Option<Spanned<f32>>, otherwise: f32| {
            given.as_ref().map_or(otherwise, |value| *value.get_ref())
        };
        if !LENGTH_M.contains(&length_m(&knots)) {
            let reason = format!(
                "the blade is {} m long along its `knots`, expected {} to {} m",
                length_m(&knots),
                LENGTH_M.start(),
                LENGTH_M.end()
            );
            return Err(at(file.knots.span(), reason));
        }
        let is_edited = file.shape.as_ref().is_some_and(|shape| *shape != shape_of(&knots));
        let size = [(&file.length_m, length_m(&knots)), (&file.max_width_m, max_width_m(&knots))]
            .map(|(given, of_knots)| if is_edited { of_knots } else { number(given, of_knots) });
        let captured = file.captured_unix_ns.unwrap_or(modified_unix_ns);
        let blade = Blade::new(id, name, knots, size, captured, number(&file.quality, 1.0))
            .and_then(|blade| blade.with_mix(number(&file.mix, 1.0)))
            .map_err(|error| {
                let value = match &error {
                    BladeError::Range { what: "length_m", .. } => &file.length_m,
                    BladeError::Range { what: "max_width_m", .. } => &file.max_width_m,
                    BladeError::Range { what: "quality", .. } => &file.quality,
                    BladeError::Range { what: "mix", .. } => &file.mix,
                    _ => &None,
                };
                at(value.as_ref().map_or(0..0, Spanned::span), error.to_string())
            })?;
        let File { pinned, sequence, measured, provenance, .. } = file;
        let measured = measured.filter(|_| !is_edited);
        Ok(Self { blade, pinned, sequence, measured, provenance })
    }

    /// The blade as a file; [`Self::parse`] gives the very same record back, bit for bit, as long as
    /// the file keeps its name.
    pub fn to_toml(&self) -> String {
        let blade = &self.blade;
        let mut text = String::from(
            "# A blade of Sward. Its name is the file's. What is changed here goes live at once; a mistake is\n\
             # refused with its line, and the blade stays as it was until it is mended.\n",
        );
        let mut line = |key: &str, value: String| writeln!(text, "{key} = {value}").expect("memory is there");
        line("format", FORMAT.to_string());
        line("id", format!("\"{}\"", blade.id()));
        if let Some(sequence) = self.sequence {
            line("sequence", sequence.to_string());
        }
        line("captured_unix_ns", blade.captured_unix_ns().min(i64::MAX as u64).to_string());
        line("mix", number(blade.mix()));
        line("pinned", self.pinned.to_string());
        line("quality", number(blade.quality()));
        line("length_m", number(blade.length_m()));
        line("max_width_m", number(blade.max_width_m()));
        line("shape", format!("\"{}\"", shape_of(blade.knots())));
        text.push_str(
            "# `shape` stands for the knots as they were written: once they are edited, length and width are measured\n\
             # on them. From root to tip: x right, y up, z towards the camera, metres; half widths left and right;\n\
             # across points from the left edge to the right one.\nknots = [\n",
        );
        for knot in blade.knots() {
            let [px, py, pz] = knot.position.to_array().map(number);
            let [ax, ay, az] = knot.across.to_array().map(number);
            let [left, right] = [knot.half_width_left, knot.half_width_right].map(number);
            writeln!(
                text,
                "  {{ position_m = [{px}, {py}, {pz}], half_width_m = [{left}, {right}], across = [{ax}, {ay}, {az}] }},"
            )
            .expect("memory is there");
        }
        text.push_str("]\n");
        if let Some(measured) = &self.measured {
            text.push_str("\n[measured]\n");
            for (key, value) in [
                ("pixels_across", measured.pixels_across),
                ("hausdorff_m", measured.hausdorff_m),
                ("length_error_m", measured.length_error_m),
                ("width_error_m", measured.width_error_m),
            ] {
                writeln!(text, "{key} = {}", number(value)).expect("memory is there");
            }
        }
        let Provenance { source, frame, frames, index, config } = &self.provenance;
        let quoted = |text: &String| toml::Value::String(text.clone()).to_string();
        let whole = |number: &u64| number.to_string();
        let rows = [
            ("source", source.as_ref().map(quoted)),
            ("frame", frame.as_ref().map(whole)),
            ("frames", frames.as_ref().map(whole)),
            ("index", index.as_ref().map(whole)),
            ("config", config.as_ref().map(quoted)),
        ];
        if rows.iter().any(|(_, value)| value.is_some()) {
            text.push_str("\n[provenance]\n");
        }
        for (key, value) in rows {
            if let Some(value) = value {
                writeln!(text, "{key} = {value}").expect("memory is there");
            }
        }
        text
    }

    /// Whether it is the same blade to whoever looks at it: shape, size, weight, quality and whether it is pinned.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        let seen = |record: &Self| {
            let blade = &record.blade;
            ([blade.length_m(), blade.max_width_m(), blade.mix(), blade.quality()], record.pinned)
        };
        self.blade.knots() == other.blade.knots() && seen(self) == seen(other)
    }

    /// What the library's order goes by: captures in their order, then what was made by hand.
    pub(crate) fn order(&self) -> (u64, u64, &str) {
        let blade = &self.blade;
        (self.sequence.unwrap_or(u64::MAX), blade.captured_unix_ns(), blade.name())
    }
}

impl FileKnot {
    fn knot(&self) -> Knot {
        let across = self.across.map_or(Vec3::X, Vec3::from_array);
        let length = across.length();
        // Exactly what was written where that is a unit vector as the library wants it; what people
        // write with two digits is made one.
        let written_exactly = (length - 1.0).abs() <= common::blade::UNIT_TOLERANCE;
        let across = if !written_exactly && (length - 1.0).abs() <= ACROSS_TOLERANCE {
            across / length
        } else {
            across
        };
        let [half_width_left, half_width_right] = self.half_width_m;
        Knot { position: Vec3::from_array(self.position_m), half_width_left, across, half_width_right }
    }
}

/// The shortest text that is read back as this very number.
fn number(value: f32) -> String {
    if value.is_nan() {
        // As TOML writes it.
        return "nan".to_owned();
    }
    let short = format!("{value:?}");
    let same = short.parse::<f64>().is_ok_and(|read| (read as f32).to_bits() == value.to_bits());
    // Rounded to f64 on its way, a short text may come to lie between two f32.
    if same { short } else { format!("{:?}", f64::from(value)) }
}

/// An id as a file has it.
pub(super) fn parse_id(text: &str) -> Option<BladeId> {
    if text.len() != 32 || !text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return None;
    }
    let mut id = [0; 16];
    for (byte, at) in id.iter_mut().zip((0..).step_by(2)) {
        *byte = u8::from_str_radix(&text[at..at + 2], 16).ok()?;
    }
    Some(BladeId(id))
}

/// An id for a blade that has none, of its name and its knots; `number`: another for each.
pub(super) fn made_id(name: &str, number: u32, knots: &[Knot]) -> BladeId {
    let mut named = blake3::Hasher::new();
    named.update(name.as_bytes());
    let stamp = u64::from_le_bytes(named.finalize().as_bytes()[..8].try_into().expect("8 of 32 bytes"));
    BladeId::of(stamp, number, knots)
}

/// By which an edit of the knots is told: 16 hexadecimal digits that stand for them.
fn shape_of(knots: &[Knot]) -> String {
    let mut shape = BladeId::of(0, 0, knots).to_string();
    shape.truncate(16);
    shape
}

fn length_m(knots: &[Knot]) -> f32 {
    knots.windows(2).map(|pair| pair[0].position.distance(pair[1].position)).sum()
}

fn max_width_m(knots: &[Knot]) -> f32 {
    knots.iter().map(Knot::width).fold(0.0, f32::max)
}

#[cfg(test)]
mod tests;
