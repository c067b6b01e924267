//! A folder of 16-bit PNGs, in name order, with `camera.toml` beside them:
//!
//! ```toml
//! fx = 570.0            # focal lengths, pixels
//! fy = 570.0
//! cx = 319.5            # principal point, pixels
//! cy = 239.5
//! depth_unit_m = 0.001  # metres of one count
//! fps = 30.0            # frames each second; this is the default
//! ```
//!
//! Frame n of the folder, from 0 and counting those that cannot be used, was taken n/fps seconds
//! after [`START_NS`].

use std::fs::{self, File};
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use image::codecs::png::{PngDecoder, PngEncoder};
use image::{ColorType, ExtendedColorType, ImageDecoder, ImageEncoder, Limits};
use serde::{Deserialize, Serialize};

use super::{Contents, Distortion, OpenError, Recording, START_NS, WriteError, ensure_one_frame, open_file};
use crate::frame::{CameraModel, DepthFrame, MAX_PIXELS};
use crate::source::{FrameSource, SourceError};

/// Name of the file with the intrinsics.
const CAMERA_FILE: &str = "camera.toml";
/// It is no longer than this: it has six numbers.
const MAX_CAMERA_BYTES: u64 = 64 << 10;
/// Longest side of a picture.
const MAX_SIDE: u32 = 1280;
/// Memory that decoding one picture may take.
const MAX_DECODER_BYTES: u64 = 64 << 20;

/// `camera.toml`.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    depth_unit_m: f64,
    #[serde(default = "default_fps")]
    fps: f64,
}

fn default_fps() -> f64 {
    30.0
}

impl CameraFile {
    fn read(path: &Path) -> Result<Self, OpenError> {
        let mut text = String::new();
        let read = open_file(path).and_then(|file| file.take(MAX_CAMERA_BYTES).read_to_string(&mut text));
        match read {
            Ok(_) => {}
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Err(OpenError::NoCameraFile { path: path.to_owned() });
            }
            Err(source) => return Err(OpenError::Io { path: path.to_owned(), source }),
        }
        let error = |at: usize, reason: String| {
            let before = &text[..at];
            let line = before.matches('\n').count() + 1;
            let column = before.chars().rev().take_while(|&letter| letter != '\n').count() + 1;
            OpenError::CameraFile { path: path.to_owned(), line, column, reason }
        };
        let file: Self = toml::from_str(&text).map_err(|toml| {
            let at = toml.span().map_or(0, |span| span.start).min(text.len());
            error(at, toml.message().replace('\n', ", "))
        })?;
        let values = [
            ("fx", file.fx, (1e-3, 1e6), "a focal length above 0 in pixels"),
            ("fy", file.fy, (1e-3, 1e6), "a focal length above 0 in pixels"),
            ("cx", file.cx, (-1e6, 1e6), "a place in pixels"),
            ("cy", file.cy, (-1e6, 1e6), "a place in pixels"),
            ("depth_unit_m", file.depth_unit_m, (1e-6, 0.1), "1e-6 to 0.1, such as 0.001 for millimetres"),
            ("fps", file.fps, (1e-3, 1e3), "0.001 to 1000 frames a second"),
        ];
        for (key, value, (low, high), expected) in values {
            if !(low..=high).contains(&value) {
                let lines = text.split_inclusive('\n').scan(0, |at, line| {
                    *at += line.len();
                    Some((*at - line.len(), line))
                });
                let at =
                    lines.filter(|(_, line)| line.trim_start().starts_with(key)).map(|(at, _)| at).next();
                return Err(error(at.unwrap_or(0), format!("{key} is {value}; expected {expected}")));
            }
        }
        Ok(file)
    }

    fn camera(&self) -> CameraModel {
        CameraModel { fx: self.fx, fy: self.fy, cx: self.cx, cy: self.cy }
    }
}

/// Opens a folder.
pub(super) fn open(path: &Path) -> Result<Recording, OpenError> {
    let pictures = pictures(path).map_err(|source| OpenError::Io { path: path.to_owned(), source })?;
    if pictures.is_empty() {
        let found = "a folder without PNGs".to_owned();
        return Err(OpenError::NotARecording { path: path.to_owned(), found });
    }
    let camera = CameraFile::read(&path.join(CAMERA_FILE))?;
    let mut source = PngSource { path: path.to_owned(), pictures, camera, size: None, next: 0 };
    ensure_one_frame(path, &mut source)?;
    source.next = 0;
    let contents =
        Contents { format: "png", image_topic: None, distortion: Distortion::default(), parts: Vec::new() };
    Ok(Recording { contents, source: Box::new(source) })
}

/// The PNGs of a folder in name order, hidden ones left out.
pub(super) fn pictures(path: &Path) -> Result<Vec<PathBuf>, std::io::Error> {
    let mut pictures = Vec::new();
    for entry in fs::read_dir(path)? {
        let path = entry?.path();
        let is_png = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
        let is_hidden = path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        if is_png && !is_hidden {
            pictures.push(path);
        }
    }
    pictures.sort();
    Ok(pictures)
}

/// A folder of PNGs as a source of frames.
struct PngSource {
    path: PathBuf,
    pictures: Vec<PathBuf>,
    camera: CameraFile,
    /// Columns and rows of the first usable picture: those of all.
    size: Option<(u32, u32)>,
    next: usize,
}

impl FrameSource for PngSource {
    fn describe(&self) -> String {
        format!("{}, {} pictures", self.path.display(), self.pictures.len())
    }

    fn next_frame(&mut self) -> Result<DepthFrame, SourceError> {
        let Some(picture) = self.pictures.get(self.next) else { return Err(SourceError::End) };
        let index = self.next as u64;
        self.next += 1;
        let bad = |why: String| SourceError::BadFrame(format!("{}: {why}", picture.display()));
        let (size, depth) = read_picture(picture).map_err(bad)?;
        let expected = *self.size.get_or_insert(size);
        if size != expected {
            let why = format!(
                "it has {}x{} pixels, the pictures before it {}x{}",
                size.0, size.1, expected.0, expected.1
            );
            return Err(bad(why));
        }
        Ok(DepthFrame {
            width: size.0 as usize,
            height: size.1 as usize,
            depth,
            depth_unit_m: self.camera.depth_unit_m,
            timestamp_ns: START_NS + index * (1e9 / self.camera.fps) as u64,
            camera: self.camera.camera(),
        })
    }
}

/// Size and counts of a picture.
fn read_picture(path: &Path) -> Result<((u32, u32), Vec<u16>), String> {
    let file = BufReader::new(open_file(path).map_err(|error| format!("it cannot be read ({error})"))?);
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_DECODER_BYTES);
    let damaged = |error| format!("it is not a whole PNG ({error})");
    let decoder = PngDecoder::with_limits(file, limits).map_err(damaged)?;
    let (width, height) = decoder.dimensions();
    if width > MAX_SIDE || height > MAX_SIDE || (width * height) as usize > MAX_PIXELS {
        return Err(format!("it has {width}x{height} pixels; expected at most 1280x1024"));
    }
    if decoder.color_type() != ColorType::L16 {
        return Err(format!("it has {:?} pixels; expected 16-bit grey", decoder.original_color_type()));
    }
    let mut bytes = vec![0; decoder.total_bytes() as usize];
    decoder.read_image(&mut bytes).map_err(damaged)?;
    // The decoder gives samples in the machine's own order.
    let depth = bytes.as_chunks::<2>().0.iter().map(|&bytes| u16::from_ne_bytes(bytes)).collect();
    Ok(((width, height), depth))
}

/// A folder that is being written.
pub struct PngWriter {
    path: PathBuf,
    fps: f64,
    depth_unit_m: Option<f64>,
    next: usize,
}

impl PngWriter {
    /// Starts a recording of `fps` frames each second in a folder that is empty or yet to be made.
    ///
    /// # Errors
    /// When the folder cannot be made, or holds something.
    pub fn create(path: &Path, fps: f64) -> Result<Self, WriteError> {
        let io = |source| WriteError::Io { path: path.to_owned(), source };
        fs::create_dir_all(path).map_err(io)?;
        if fs::read_dir(path).map_err(io)?.next().is_some() {
            return Err(WriteError::NotEmpty { path: path.to_owned() });
        }
        Ok(Self { path: path.to_owned(), fps, depth_unit_m: None, next: 0 })
    }

    /// Adds a frame. Its time is not kept; the first one's camera becomes that of all.
    ///
    /// # Errors
    /// When it cannot be written, or its depth unit is not that of the frames before.
    pub fn write(&mut self, frame: &DepthFrame) -> Result<(), WriteError> {
        match self.depth_unit_m {
            None => self.begin(frame)?,
            Some(unit) if unit == frame.depth_unit_m => {}
            Some(expected) => return Err(WriteError::DepthUnit { expected, found: frame.depth_unit_m }),
        }
        let path = self.path.join(format!("frame_{:06}.png", self.next));
        let io = |source| WriteError::Io { path: path.clone(), source };
        let mut file = BufWriter::new(File::create(&path).map_err(io)?);
        let bytes: Vec<u8> = frame.depth.iter().flat_map(|count| count.to_ne_bytes()).collect();
        let (width, height) = (frame.width as u32, frame.height as u32);
        PngEncoder::new(&mut file)
            .write_image(&bytes, width, height, ExtendedColorType::L16)
            .map_err(|source| WriteError::Png { path: path.clone(), source })?;
        file.flush().map_err(io)?;
        self.next += 1;
        Ok(())
    }

    fn begin(&mut self, frame: &DepthFrame) -> Result<(), WriteError> {
        let CameraModel { fx, fy, cx, cy } = frame.camera;
        let camera = CameraFile { fx, fy, cx, cy, depth_unit_m: frame.depth_unit_m, fps: self.fps };
        let text = toml::to_string(&camera).expect("six numbers can be written as TOML");
        let path = self.path.join(CAMERA_FILE);
        fs::write(&path, text).map_err(|source| WriteError::Io { path, source })?;
        self.depth_unit_m = Some(frame.depth_unit_m);
        Ok(())
    }
}
