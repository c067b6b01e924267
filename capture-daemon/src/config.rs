//! The daemon's configuration: TOML, every key known, in its type and range.

use std::io::Read;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use common::refine::{RefineMethod, RefineParams};
use serde::{Deserialize, Serialize};

use crate::frame::{CameraModel, CameraPose};
use crate::pipeline::PipelineParams;
use crate::recording::{Distortion, DistortionError, GivenCamera, OpenOptions};
use crate::session::SessionParams;
use crate::stages::blade::AcceptParams;
use crate::stages::mask::MaskParams;
use crate::station::StationParams;

/// All keys, with their defaults. `capture-daemon.toml` documents each.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// `[source]`
    pub source: SourceConfig,
    /// `[camera]`
    pub camera: CameraConfig,
    /// `[mask]`
    pub mask: MaskConfig,
    /// `[capture]`
    pub capture: CaptureConfig,
    /// `[blade]`
    pub blade: BladeConfig,
    /// `[refine]`
    pub refine: RefineConfig,
    /// `[store]`
    pub store: StoreConfig,
    /// `[service]`
    pub service: ServiceConfig,
}

/// Where frames come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SourceConfig {
    /// A recording that `run` plays as its sensor.
    pub recording: Option<PathBuf>,
    /// Whether it begins again at its end.
    #[serde(rename = "loop")]
    pub looped: bool,
    /// Its speed, in times real time; 0 as fast as the stages are.
    pub rate: f64,
    /// The image topic to read, where an MCAP file has several.
    pub topic: Option<String>,
}

impl Default for SourceConfig {
    fn default() -> Self {
        Self { recording: None, looped: false, rate: 1.0, topic: None }
    }
}

/// The camera.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraConfig {
    /// Focal length along x, pixels; with `fy`, `cx`, `cy` for a recording that brings none.
    pub fx: Option<f64>,
    /// Focal length along y, pixels.
    pub fy: Option<f64>,
    /// Principal point, pixels.
    pub cx: Option<f64>,
    /// Principal point, pixels.
    pub cy: Option<f64>,
    /// Model of the lens's distortion, with `distortion`: `plumb_bob` or `rational_polynomial`.
    pub distortion_model: Option<String>,
    /// Its coefficients in OpenCV's order; for a recording that brings no intrinsics.
    pub distortion: Option<Vec<f64>>,
    /// How far it looks down, radians.
    pub tilt_rad: f32,
    /// How far it is turned clockwise about its axis, radians.
    pub roll_rad: f32,
}

/// What counts as held before the camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MaskConfig {
    /// Nearest depth, metres.
    pub near_m: f64,
    /// Farthest depth, metres.
    pub far_m: f64,
    /// `[x0, y0, x1, y1]`, pixels, half open.
    pub roi: Option<[usize; 4]>,
    /// Smaller blobs are specks, pixels.
    pub min_area_px: usize,
    /// Longest gap without readings that is bridged, pixels.
    pub bridge_px: usize,
}

impl Default for MaskConfig {
    fn default() -> Self {
        let MaskParams { near_m, far_m, roi, min_area_px, bridge_px } = MaskParams::default();
        Self { near_m, far_m, roi, min_area_px, bridge_px }
    }
}

/// When a capture happens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CaptureConfig {
    /// How long something must stand still, seconds.
    pub hold_s: f64,
    /// How far its centroid may move meanwhile, pixels.
    pub still_px: f64,
}

impl Default for CaptureConfig {
    fn default() -> Self {
        let StationParams { hold_s, still_px, .. } = StationParams::default();
        Self { hold_s, still_px }
    }
}

/// Which blades are good enough.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BladeConfig {
    /// Shortest blade, metres.
    pub min_length_m: f32,
    /// Fewest pixels across.
    pub min_pixels_across: f32,
    /// Lowest score.
    pub min_score: f32,
    /// Widest blade or leaf, metres.
    pub max_width_m: f32,
}

impl Default for BladeConfig {
    fn default() -> Self {
        let AcceptParams { min_length_m, min_pixels_across, min_score, max_width_m } =
            AcceptParams::default();
        Self { min_length_m, min_pixels_across, min_score, max_width_m }
    }
}

/// Refinement of the skeleton.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RefineConfig {
    /// Knots of a blade.
    pub knots: usize,
    /// μ of Fan & Sheng's Eq. 1.
    pub distance_weight: f32,
    /// How knots are chosen.
    pub method: RefineMethod,
}

impl Default for RefineConfig {
    fn default() -> Self {
        let RefineParams { knots, distance_weight, method } = RefineParams::default();
        Self { knots, distance_weight, method }
    }
}

/// Where blades are kept.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StoreConfig {
    /// The state directory; by default `$STATE_DIRECTORY`, which systemd sets, or else
    /// `/var/lib/sward`.
    pub directory: Option<PathBuf>,
}

/// The varlink service.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ServiceConfig {
    /// The socket it listens on.
    pub socket: PathBuf,
    /// The mode of the socket's file: who can connect.
    pub socket_mode: u32,
    /// Who may watch: `*`, users, `@groups`.
    pub watch: Vec<String>,
    /// Who may change.
    pub change: Vec<String>,
    /// Connections at once.
    pub max_connections: usize,
}

impl Default for ServiceConfig {
    fn default() -> Self {
        Self {
            socket: PathBuf::from("/run/sward/station.sock"),
            socket_mode: 0o660,
            watch: vec!["*".to_owned()],
            change: Vec::new(),
            max_connections: 256,
        }
    }
}

/// Why a configuration cannot be used. The message begins with where.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{path}: the configuration cannot be read: {reason}; check the path given with --config")]
    Unreadable {
        /// The file.
        path: String,
        /// What the system said.
        reason: String,
    },
    /// The text is not TOML, or a key is unknown or of another type.
    #[error("{place}: {reason}")]
    Invalid {
        /// File, line and column, or the `--set` argument.
        place: String,
        /// What is wrong and what was expected.
        reason: String,
    },
}

/// A configuration is no longer than this.
const MAX_BYTES: u64 = 1 << 20;

/// Reads a configuration: the file over the defaults, each `key=value` of `sets` over both.
///
/// # Errors
/// The first thing that is wrong, with file, line and column, or with the `--set` argument.
pub fn load(file: Option<&Path>, sets: &[String]) -> Result<Config, ConfigError> {
    let mut documents = Vec::new();
    if let Some(path) = file {
        let unreadable = |reason: std::io::Error| ConfigError::Unreadable {
            path: path.display().to_string(),
            reason: reason.to_string(),
        };
        let mut bytes = Vec::new();
        // Reading a pipe could take for ever, and gives nothing the second time, at a reload.
        if !std::fs::metadata(path).map_err(unreadable)?.is_file() {
            return Err(unreadable(std::io::Error::other("it is not a regular file")));
        }
        let file = std::fs::File::open(path).map_err(unreadable)?;
        file.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
        if bytes.len() as u64 > MAX_BYTES {
            return Err(ConfigError::Invalid {
                place: path.display().to_string(),
                reason: format!("it is larger than {MAX_BYTES} bytes, expected a TOML file"),
            });
        }
        let text = String::from_utf8(bytes).map_err(|_| ConfigError::Invalid {
            place: path.display().to_string(),
            reason: "it is not UTF-8 text, expected a TOML file".to_owned(),
        })?;
        documents.push(Document { origin: Origin::File(path.to_path_buf()), text });
    }
    for set in sets {
        documents.push(Document { origin: Origin::Set(set.clone()), text: set.clone() });
    }
    let mut merged = toml::Table::new();
    for document in &documents {
        // Alone, so that the error has the place in this document.
        toml::from_str::<Config>(&document.text).map_err(|error| document.error(&error))?;
        merge(&mut merged, toml::from_str(&document.text).map_err(|error| document.error(&error))?);
    }
    let config: Config = merged.try_into().map_err(|error: toml::de::Error| ConfigError::Invalid {
        place: "configuration".to_owned(),
        reason: error.message().to_owned(),
    })?;
    match out_of_range(&config) {
        None => Ok(config),
        Some((key, expected)) => {
            let place = documents.iter().rev().find_map(|document| document.place_of(key));
            let reason = format!("`{key}` is out of range, expected {expected}");
            Err(ConfigError::Invalid { place: place.unwrap_or_else(|| "configuration".to_owned()), reason })
        }
    }
}

enum Origin {
    File(PathBuf),
    Set(String),
}

struct Document {
    origin: Origin,
    text: String,
}

impl Document {
    fn place(&self, span: Option<std::ops::Range<usize>>) -> String {
        let before = &self.text[..span.map_or(0, |span| span.start).min(self.text.len())];
        let line = before.matches('\n').count() + 1;
        let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
        match &self.origin {
            Origin::File(path) => format!("{}:{line}:{column}", path.display()),
            Origin::Set(argument) => format!("--set '{}', column {column}", argument.escape_debug()),
        }
    }

    fn error(&self, error: &toml::de::Error) -> ConfigError {
        let message = error
            .message()
            .replace('\n', ", ")
            .replace("unknown field", "unknown key")
            .replace("expected f64", "expected a number")
            .replace("expected f32", "expected a number")
            .replace("expected usize", "expected a whole number, 0 or more")
            .replace("expected u32", "expected a whole number, 0 or more");
        let hint = match &self.origin {
            Origin::Set(_) if error.span().is_some() && !message.contains("unknown key") => {
                " (--set takes key=value as TOML; text needs quotes: --set 'service.socket=\"/tmp/s\"')"
            }
            _ => "",
        };
        ConfigError::Invalid { place: self.place(error.span()), reason: format!("{message}{hint}") }
    }

    /// Where this document sets `key` (a dotted path), if it does.
    fn place_of(&self, key: &str) -> Option<String> {
        let document = toml::de::DeTable::parse(&self.text).ok()?;
        let mut table = document.get_ref();
        let mut parts = key.split('.').peekable();
        while let Some(part) = parts.next() {
            let (name, value) = table.iter().find(|(name, _)| name.get_ref() == part)?;
            match (parts.peek(), value.get_ref()) {
                (None, _) => return Some(self.place(Some(name.span()))),
                (Some(_), toml::de::DeValue::Table(inner)) => table = inner,
                _ => return None,
            }
        }
        None
    }
}

fn merge(into: &mut toml::Table, from: toml::Table) {
    for (key, value) in from {
        match (into.get_mut(&key), value) {
            (Some(toml::Value::Table(mine)), toml::Value::Table(theirs)) => merge(mine, theirs),
            (_, value) => {
                into.insert(key, value);
            }
        }
    }
}

/// The first key whose value is out of its range, and the range.
fn out_of_range(config: &Config) -> Option<(&'static str, String)> {
    fn within(key: &'static str, value: f64, range: RangeInclusive<f64>) -> Option<(&'static str, String)> {
        (!range.contains(&value)).then(|| (key, format!("{} to {}", range.start(), range.end())))
    }
    let Config { source, camera, mask, capture, blade, refine, store, service } = config;
    let focal = |key, value: Option<f64>| value.and_then(|value| within(key, value, 1.0..=100_000.0));
    let centre = |key, value: Option<f64>| value.and_then(|value| within(key, value, -10_000.0..=10_000.0));
    let intrinsics = [camera.fx, camera.fy, camera.cx, camera.cy];
    let some_missing = intrinsics.iter().any(Option::is_some) && intrinsics.iter().any(Option::is_none);
    let half_camera = || Some(("camera", "all of fx, fy, cx and cy, or none of them".to_owned()));
    let lens = "the 4 or 5 coefficients of plumb_bob or the 8 of rational_polynomial".to_owned();
    let distortion = camera.distortion().err().map(|_| ("camera.distortion", lens));
    let lens_alone = || Some(("camera.distortion", "camera.fx, fy, cx and cy beside it".to_owned()));
    let lens_alone = (camera.distortion.is_some() && camera.fx.is_none()).then(lens_alone).flatten();
    let empty_region = mask.roi.is_some_and(|[x0, y0, x1, y1]| x0 >= x1 || y0 >= y1);
    let region = || Some(("mask.roi", "[x0, y0, x1, y1] with x0 < x1 and y0 < y1".to_owned()));
    let order = || Some(("mask.far_m", format!("more than mask.near_m ({})", mask.near_m)));
    let socket = || Some(("service.socket", "the path of a socket".to_owned()));
    let directory = || Some(("store.directory", "the path of a folder".to_owned()));
    let no_directory = store.directory.as_ref().is_some_and(|path| path.as_os_str().is_empty());
    let who = |key, list: &[String]| {
        let odd = list.iter().any(|entry| entry.is_empty() || entry == "@");
        odd.then(|| (key, "a list of \"*\", users, and groups with @ before them".to_owned()))
    };
    let mode = || Some(("service.socket_mode", "0o000 to 0o777".to_owned()));
    within("source.rate", source.rate, 0.0..=1000.0)
        .or_else(|| no_directory.then(directory).flatten())
        .or_else(|| (service.socket_mode > 0o777).then(mode).flatten())
        .or_else(|| who("service.watch", &service.watch))
        .or_else(|| who("service.change", &service.change))
        .or_else(|| within("service.max_connections", service.max_connections as f64, 2.0..=10_000.0))
        .or_else(|| service.socket.as_os_str().is_empty().then(socket).flatten())
        .or_else(|| focal("camera.fx", camera.fx))
        .or_else(|| focal("camera.fy", camera.fy))
        .or_else(|| centre("camera.cx", camera.cx))
        .or_else(|| centre("camera.cy", camera.cy))
        .or_else(|| some_missing.then(half_camera).flatten())
        .or(distortion)
        .or(lens_alone)
        .or_else(|| within("camera.tilt_rad", camera.tilt_rad.into(), -1.6..=1.6))
        .or_else(|| within("camera.roll_rad", camera.roll_rad.into(), -3.2..=3.2))
        .or_else(|| within("mask.near_m", mask.near_m, 0.0..=20.0))
        .or_else(|| within("mask.far_m", mask.far_m, 0.0..=20.0))
        .or_else(|| (mask.near_m >= mask.far_m).then(order).flatten())
        .or_else(|| empty_region.then(region).flatten())
        .or_else(|| within("mask.min_area_px", mask.min_area_px as f64, 1.0..=1e6))
        .or_else(|| within("mask.bridge_px", mask.bridge_px as f64, 0.0..=32.0))
        .or_else(|| within("capture.hold_s", capture.hold_s, 0.0..=60.0))
        .or_else(|| within("capture.still_px", capture.still_px, 0.1..=1000.0))
        .or_else(|| within("blade.min_length_m", blade.min_length_m.into(), 0.001..=10.0))
        .or_else(|| within("blade.min_pixels_across", blade.min_pixels_across.into(), 0.5..=100.0))
        .or_else(|| within("blade.min_score", blade.min_score.into(), 0.0..=1.0))
        .or_else(|| within("blade.max_width_m", blade.max_width_m.into(), 0.005..=10.0))
        .or_else(|| within("refine.knots", refine.knots as f64, 2.0..=64.0))
        .or_else(|| within("refine.distance_weight", refine.distance_weight.into(), 0.0..=1.0))
}

impl CameraConfig {
    fn distortion(&self) -> Result<Distortion, DistortionError> {
        let model = self.distortion_model.as_deref().unwrap_or("plumb_bob");
        Distortion::new(model, self.distortion.as_deref().unwrap_or_default())
    }
}

impl Config {
    /// The camera given by the configuration, where it gives one.
    pub fn camera_model(&self) -> Option<CameraModel> {
        let CameraConfig { fx, fy, cx, cy, .. } = self.camera;
        Some(CameraModel { fx: fx?, fy: fy?, cx: cx?, cy: cy? })
    }

    /// What a recording leaves open.
    pub fn open_options(&self) -> OpenOptions {
        // `load` has checked the distortion.
        let distortion = self.camera.distortion().unwrap_or_default();
        let camera = self.camera_model().map(|camera| GivenCamera { camera, distortion });
        OpenOptions { camera, topic: self.source.topic.clone() }
    }

    /// All keys that have a value, as TOML.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("numbers, texts and paths in UTF-8 can be written as TOML")
    }

    /// Hex of the first 8 bytes of BLAKE3 over the keys that a capture goes by: those of the camera, the
    /// mask, the hold, the blades and their refinement.
    pub fn capture_hash(&self) -> String {
        let Self { camera, mask, capture, blade, refine, .. } = self.clone();
        let relevant = Self { camera, mask, capture, blade, refine, ..Self::default() };
        blake3::hash(relevant.to_toml().as_bytes()).to_hex()[..16].to_owned()
    }

    /// Keys whose values differ between this configuration and `other`, as dotted paths in order.
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let [mine, theirs] = [self, other].map(|config| {
            let table: toml::Table = toml::from_str(&config.to_toml()).expect("it was written as TOML");
            let mut keys = std::collections::BTreeMap::new();
            for (name, section) in table {
                for (key, value) in section.as_table().into_iter().flatten() {
                    keys.insert(format!("{name}.{key}"), value.to_string());
                }
            }
            keys
        });
        let mut keys: Vec<String> = mine.keys().chain(theirs.keys()).cloned().collect();
        keys.sort();
        keys.dedup();
        keys.retain(|key| mine.get(key) != theirs.get(key));
        keys
    }

    /// Whether a running station can take another value of `key`.
    pub fn is_live(key: &str) -> bool {
        let live = ["camera.tilt_rad", "camera.roll_rad", "service.watch", "service.change"];
        let sections = ["mask.", "capture.", "blade.", "refine."];
        live.contains(&key) || sections.iter().any(|section| key.starts_with(section))
    }

    /// What a session is told.
    pub fn session_params(&self) -> SessionParams {
        let Self { camera, mask, capture, blade, refine, .. } = self;
        SessionParams {
            station: StationParams {
                hold_s: capture.hold_s,
                still_px: capture.still_px,
                min_area_px: mask.min_area_px,
            },
            pipeline: PipelineParams {
                mask: MaskParams {
                    near_m: mask.near_m,
                    far_m: mask.far_m,
                    roi: mask.roi,
                    min_area_px: mask.min_area_px,
                    bridge_px: mask.bridge_px,
                },
                refine: RefineParams {
                    knots: refine.knots,
                    distance_weight: refine.distance_weight,
                    method: refine.method,
                },
                accept: AcceptParams {
                    min_length_m: blade.min_length_m,
                    min_pixels_across: blade.min_pixels_across,
                    min_score: blade.min_score,
                    max_width_m: blade.max_width_m,
                },
                pose: CameraPose { tilt_rad: camera.tilt_rad, roll_rad: camera.roll_rad },
            },
        }
    }
}

#[cfg(test)]
mod tests;
