//! A writer of `.oni` recordings, OpenNI2's own, for tests: one stream of depth without compression. Format 1.0.1.0, as
//! the library's file device reads it; little-endian, positions in bytes from the file's start.
//!
//! ```text
//!  header   "NI10", version, latest time, highest node
//!  record*  magic, type, node, bytes of its fields with this head, bytes of its payload, position to go back to
//!           added · properties · ready · begin · frame … frame · removed · seek table · end
//! ```

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

/// Each record begins with it.
const RECORD_MAGIC: u32 = 0x0052_494E;
/// Bytes of a record before its fields.
const RECORD_HEAD: usize = 28;
/// The only node.
const NODE: u32 = 1;
/// What is not known before the end.
const UNKNOWN: u64 = u64::MAX;

/// Types of records.
#[derive(Clone, Copy)]
enum Kind {
    Int = 0x03,
    General = 0x06,
    Removed = 0x07,
    Begin = 0x08,
    Ready = 0x09,
    Data = 0x0A,
    End = 0x0B,
    Added = 0x0D,
    SeekTable = 0x0E,
}

/// What a recording is of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OniParams {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Frames each second.
    pub fps: u32,
    /// Counts are of 0.1 mm, else of 1 mm.
    pub is_fine: bool,
    /// It says that left and right are exchanged.
    pub is_mirrored: bool,
    /// Angles that are seen, across and down, radians.
    pub field_of_view: [f64; 2],
}

impl Default for OniParams {
    fn default() -> Self {
        Self {
            width: 640,
            height: 480,
            fps: 30,
            is_fine: false,
            is_mirrored: false,
            field_of_view: [1.022_599_9, 0.796_615_66],
        }
    }
}

/// A recording that is being written. One that is dropped and not finished is as a crash would leave it.
#[derive(Debug)]
pub struct OniWriter {
    file: File,
    added_at: u64,
    /// Time and position of each frame.
    frames: Vec<(u64, u64)>,
}

impl OniWriter {
    /// Begins a recording.
    ///
    /// # Panics
    /// If it cannot be written.
    pub fn create(path: &Path, params: &OniParams) -> Self {
        let mut file = File::create(path).expect("the folder is ours");
        file.write_all(&header()).expect("room");
        let mut writer = Self { file, added_at: header().len() as u64, frames: Vec::new() };
        writer.added(u32::MAX, UNKNOWN, 0);
        let OniParams { width, height, fps, .. } = *params;
        let mode: Vec<u8> = [width, height, fps].iter().flat_map(|number| number.to_le_bytes()).collect();
        let field_of_view = params.field_of_view.iter().flat_map(|angle| angle.to_le_bytes()).collect();
        writer.int("oniRequiredFrameSize", (2 * width * height).into());
        writer.int("xnIsGenerating", 1);
        writer.int("xnDeviceMaxDepth", if params.is_fine { 65_535 } else { 10_000 });
        writer.int("xnSupportedMapOutputModesCount", 1);
        writer.general("xnSupportedMapOutputModes", mode.clone());
        // The formats of pixels are of the mode that was read last.
        writer.general("xnMapOutputMode", mode);
        writer.general("xnSupportedPixelFormats", 8u32.to_le_bytes().to_vec());
        writer.int("xnPixelFormat", 4);
        writer.int("oniPixelFormat", if params.is_fine { 101 } else { 100 });
        writer.general("xnFOV", field_of_view);
        writer.int("Cropping", 1);
        // Without it the library gives no frame, and no error.
        writer.general("xnCropping", vec![0; 12]);
        writer.int("Mirror", 1);
        writer.int("xnMirror", params.is_mirrored.into());
        writer.record(Kind::Ready, &[], &[], 0);
        let begin = [u32::MAX.to_le_bytes().to_vec(), UNKNOWN.to_le_bytes().to_vec()].concat();
        writer.record(Kind::Begin, &begin, &[], 0);
        writer
    }

    /// Writes a frame.
    ///
    /// # Panics
    /// If there is no room.
    pub fn frame(&mut self, timestamp_us: u64, depth: &[u16]) {
        let before = self.frames.last().map_or(0, |(_, position)| *position);
        let position = self.file.stream_position().expect("a file");
        self.frames.push((timestamp_us, position));
        let number = self.frames.len() as u32;
        let fields = [timestamp_us.to_le_bytes().to_vec(), number.to_le_bytes().to_vec()].concat();
        let payload: Vec<u8> = depth.iter().flat_map(|pixel| pixel.to_le_bytes()).collect();
        self.record(Kind::Data, &fields, &payload, before);
    }

    /// Finishes it: what comes at the end is written, and what was not known before.
    ///
    /// # Panics
    /// If there is no room.
    pub fn finish(mut self) {
        self.record(Kind::Removed, &[], &[], self.added_at);
        let table_at = self.file.stream_position().expect("a file");
        let entry = |(time, position): &(u64, u64)| {
            [time.to_le_bytes().to_vec(), 0u32.to_le_bytes().to_vec(), position.to_le_bytes().to_vec()]
                .concat()
        };
        let table: Vec<u8> = std::iter::once(&(0, 0)).chain(&self.frames).flat_map(entry).collect();
        self.record(Kind::SeekTable, &[], &table, 0);
        self.file.write_all(&record(Kind::End, 0, &[], &[], 0)).expect("room");
        self.file.seek(SeekFrom::Start(self.added_at)).expect("a file");
        let (frames, last) = (self.frames.len() as u32, self.frames.last().map_or(0, |(time, _)| *time));
        self.added(frames, last, table_at);
    }

    fn record(&mut self, kind: Kind, fields: &[u8], payload: &[u8], undo: u64) {
        self.file.write_all(&record(kind, NODE, fields, payload, undo)).expect("room");
    }

    fn general(&mut self, name: &str, value: Vec<u8>) {
        self.property(Kind::General, name, &value);
    }

    fn int(&mut self, name: &str, value: u64) {
        self.property(Kind::Int, name, &value.to_le_bytes());
    }

    fn property(&mut self, kind: Kind, name: &str, value: &[u8]) {
        let fields = [text(name), (value.len() as u32).to_le_bytes().to_vec(), value.to_vec()].concat();
        self.record(kind, &fields, &[], 0);
    }

    fn added(&mut self, frames: u32, last_us: u64, table_at: u64) {
        let mut fields = text("Depth");
        // Depth, without compression.
        fields.extend(2u32.to_le_bytes());
        fields.extend(b"NONE");
        fields.extend(frames.to_le_bytes());
        fields.extend([0, last_us, table_at].iter().flat_map(|number: &u64| number.to_le_bytes()));
        self.record(Kind::Added, &fields, &[], 0);
    }
}

fn header() -> Vec<u8> {
    let mut header = b"NI10".to_vec();
    header.extend([1, 0]);
    header.extend(1u16.to_le_bytes());
    header.extend(0u32.to_le_bytes());
    header.extend(UNKNOWN.to_le_bytes());
    header.extend(NODE.to_le_bytes());
    header
}

/// A text with its length and a zero.
fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32 + 1).to_le_bytes()[..], text.as_bytes(), &[0]].concat()
}

fn record(kind: Kind, node: u32, fields: &[u8], payload: &[u8], undo: u64) -> Vec<u8> {
    let sizes = [RECORD_HEAD + fields.len(), payload.len()].map(|bytes| bytes as u32);
    let numbers = [RECORD_MAGIC, kind as u32, node, sizes[0], sizes[1]];
    let mut record: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    record.extend(undo.to_le_bytes());
    record.extend(fields);
    record.extend(payload);
    record
}
