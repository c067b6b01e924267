//! The daemon's configuration: TOML, every key known, in its type and range.
//!
//! Goals: one file documents all keys (`capture-daemon.toml`), and its own text is the manual's; a mistake has
//! its file, line and column. Non-goals: keys that a program finds elsewhere, such as in the environment.

mod load;
pub mod manual;
mod range;
mod record;

use std::path::PathBuf;

use common::refine::{RefineMethod, RefineParams};
use serde::{Deserialize, Serialize};

use crate::frame::{CameraModel, CameraPose};
use crate::pipeline::PipelineParams;
use crate::recording::{Distortion, DistortionError, GivenCamera, OpenOptions};
use crate::session::SessionParams;
use crate::source::pixels::PixelFormat;
use crate::stages::blade::AcceptParams;
use crate::stages::mask::MaskParams;
use crate::station::StationParams;

pub(crate) use load::is_known;
pub use load::{ConfigError, check, load, load_recorded};
pub use record::RecordConfig;

/// All keys, with their defaults. `capture-daemon.toml` documents each.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// `[source]`
    pub source: SourceConfig,
    /// `[sensor]`
    pub sensor: SensorConfig,
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
    /// `[record]`
    pub record: RecordConfig,
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

/// A live sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorConfig {
    /// What reads it; none where frames come from a recording.
    pub driver: Option<SensorDriver>,
    /// Which one: a serial number, a URI, a node, a link to one, a port, or the path of an `.oni` file that stands in for
    /// one.
    pub device: Option<String>,
    /// Columns and rows.
    pub size: Option<[usize; 2]>,
    /// Frames each second.
    pub fps: Option<u32>,
    /// Metres of one count.
    pub depth_unit_m: Option<f64>,
    /// V4L2's pixels.
    pub format: Option<PixelFormat>,
    /// The kind of sensor, by the name of its profile.
    pub profile: Option<String>,
    /// Whether left and right are exchanged.
    pub mirror: bool,
    /// How long it may give no frame, seconds.
    pub deadline_s: f64,
    /// OpenNI2's library.
    pub openni2_library: PathBuf,
}

impl Default for SensorConfig {
    fn default() -> Self {
        Self {
            driver: None,
            device: None,
            size: None,
            fps: None,
            depth_unit_m: None,
            format: None,
            profile: None,
            mirror: false,
            deadline_s: 5.0,
            openni2_library: PathBuf::from("libOpenNI2.so.0"),
        }
    }
}

/// What reads a live sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SensorDriver {
    /// OpenNI2.
    OpenNi2,
    /// The kernel.
    V4l2,
    /// A recording with the faults of a script.
    Faulty,
}

impl SensorDriver {
    /// Its name, for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::OpenNi2 => "OpenNI2",
            Self::V4l2 => "V4L2",
            Self::Faulty => "faulty",
        }
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
    /// How far its centroid may move meanwhile, pixels at a focal length of 570 px; as many more at a longer one.
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StoreConfig {
    /// The state directory; by default `$STATE_DIRECTORY`, which systemd sets, or else
    /// `/var/lib/sward`.
    pub directory: Option<PathBuf>,
    /// Blades that the archive holds at most.
    pub archive_max: usize,
}

impl Default for StoreConfig {
    fn default() -> Self {
        Self { directory: None, archive_max: 10_000 }
    }
}

impl StoreConfig {
    /// The state directory where nothing says otherwise.
    const DIRECTORY: &str = "/var/lib/sward";

    /// The state directory: the key's, else systemd's (`given`: `$STATE_DIRECTORY`, a list of which the first is
    /// the service's own), else the usual one.
    pub fn folder(&self, given: Option<&str>) -> PathBuf {
        let given = given.and_then(|list| list.split(':').next()).filter(|first| !first.is_empty());
        self.directory.clone().unwrap_or_else(|| given.unwrap_or(Self::DIRECTORY).into())
    }
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
        let (topic, sensor) = (self.source.topic.clone(), self.sensor.clone());
        OpenOptions { camera, topic, sensor, program: None }
    }

    /// All keys that have a value, as TOML.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("numbers, texts and paths in UTF-8 can be written as TOML")
    }

    /// The sections that a capture goes by, as TOML: what a recording of a live run is made under.
    pub fn capture_toml(&self) -> String {
        let mut table: toml::Table = toml::from_str(&self.to_toml()).expect("it was written as TOML");
        table.retain(|section, _| ["camera", "mask", "capture", "blade", "refine"].contains(&section));
        toml::to_string(&table).expect("it was TOML")
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
