//! OpenNI2: its sensors, and its recordings through its own file device. Runs in the sensor process.

mod handles;

use std::fmt;
use std::path::Path;
use std::time::Duration;

use self::handles::{Context, Device, Frame, Stream};
use super::access;
use super::clock::{SensorClock, unix_ns};
use super::host::{Closed, Link, Message, Order};
use super::listed::{Listed, ListedMode};
use crate::config::SensorConfig;
use crate::frame::{CameraModel, DepthFrame};
use crate::recording::START_NS;

/// How often it is looked whether a device is still there, and whether one came.
const TICK: Duration = Duration::from_millis(100);
/// Speed of a file device at which each frame is given as it is read.
const AS_READ: f32 = -1.0;

/// A mode of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Frames each second.
    pub fps: u32,
    /// Metres of one count.
    pub depth_unit_m: f64,
}

impl From<Mode> for ListedMode {
    fn from(Mode { width, height, fps, depth_unit_m }: Mode) -> Self {
        Self { width, height, fps: Some(fps), format: None, depth_unit_m: Some(depth_unit_m) }
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        ListedMode::from(*self).fmt(f)
    }
}

/// Why a device cannot be opened. OpenNI2 does not say when it is the right to: then `reason` is replaced.
fn with_access(reason: String) -> String {
    access::denied_to_openni2().unwrap_or(reason)
}

/// The devices that are plugged in.
///
/// # Errors
/// When OpenNI2 is not there or refuses.
pub(super) fn list(library: &Path) -> Result<Vec<Listed>, String> {
    let context = Context::open(library).map_err(|error| error.to_string())?;
    let devices = context.devices().map_err(|error| error.to_string())?;
    let listed = devices.into_iter().map(|info| {
        let opened = context.open_device(&info.uri);
        let (serial, modes, trouble) = match &opened {
            Ok(device) => (device.serial(), device.depth_modes(), None),
            Err(error) => (None, Vec::new(), Some(with_access(error.to_string()))),
        };
        let usb = (info.usb != (0, 0)).then(|| format!("{:04x}:{:04x}", info.usb.0, info.usb.1));
        let (uri, vendor, name) = (info.uri, info.vendor, info.name);
        let modes = modes.into_iter().map(ListedMode::from).collect();
        let driver = "openni2".to_owned();
        Listed { driver, uri, serial, vendor, name, usb, modes, trouble, ..Listed::default() }
    });
    Ok(listed.collect())
}

/// Whether `wanted` names a device: its URI, or what stands in it behind the `@`, bus and port.
fn is_named(wanted: &str, uri: &str) -> bool {
    uri == wanted || uri.split_once('@').is_some_and(|(_, port)| port == wanted)
}

/// The device that is wanted, if it is there: by URI, port or serial number, else the first; a path is a recording that
/// stands in for a sensor. Of a device that cannot be opened, why.
fn find<'c>(context: &'c Context, wanted: Option<&str>) -> Result<Option<Device<'c>>, String> {
    let told = |error: handles::OpenNiError| error.to_string();
    if let Some(path) = wanted.filter(|wanted| is_recording(wanted)) {
        return context.open_device(path).map(Some).map_err(told);
    }
    let devices = context.devices().map_err(told)?;
    let named = |uri: &str| wanted.is_none_or(|wanted| is_named(wanted, uri));
    if let Some(info) = devices.iter().find(|info| named(&info.uri)) {
        return context.open_device(&info.uri).map(Some).map_err(|error| with_access(told(error)));
    }
    // Their serial numbers are told by those that are open alone.
    let opened = devices.iter().filter_map(|info| context.open_device(&info.uri).ok());
    let mut opened =
        opened.filter(|device| device.serial().is_some() && device.serial().as_deref() == wanted);
    Ok(opened.next())
}

/// Whether it is the path of a recording.
fn is_recording(device: &str) -> bool {
    Path::new(device).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("oni"))
}

/// The mode that fits what is wanted: of several the one nearest to 640×480 at 30 a second in millimetres, which each
/// sensor of this kind has.
fn choose(modes: &[Mode], wanted: &SensorConfig) -> Option<Mode> {
    let fits = |mode: &&Mode| {
        wanted.size.is_none_or(|size| size == [mode.width, mode.height])
            && wanted.fps.is_none_or(|fps| fps == mode.fps)
            && wanted.depth_unit_m.is_none_or(|unit| unit == mode.depth_unit_m)
    };
    let distance = |mode: &&Mode| {
        let pixels = (mode.width * mode.height).abs_diff(640 * 480);
        (pixels, mode.fps.abs_diff(30), u8::from(mode.depth_unit_m != 0.001))
    };
    modes.iter().filter(fits).min_by_key(distance).copied()
}

/// The camera of a whole picture by the angles that it sees, radians: the principal point is the middle of the picture,
/// between the two middle pixels.
fn camera_of(mode: &Mode, field_of_view: [f64; 2]) -> Option<CameraModel> {
    let [fx, fy] = [(mode.width, field_of_view[0]), (mode.height, field_of_view[1])]
        .map(|(pixels, angle)| pixels as f64 / 2.0 / (angle / 2.0).tan());
    let [cx, cy] = [mode.width, mode.height].map(|pixels| (pixels as f64 - 1.0) / 2.0);
    let camera = CameraModel { fx, fy, cx, cy };
    let is_possible = field_of_view.iter().all(|angle| (0.01..3.1).contains(angle));
    (is_possible && camera.is_valid()).then_some(camera)
}

/// What turns frames of the library into ours.
struct Developer {
    given: Option<CameraModel>,
    field_of_view: Option<[f64; 2]>,
    /// Left and right are to be exchanged.
    is_flipped: bool,
}

impl Developer {
    fn new(stream: &Stream<'_>, order: &Order) -> Self {
        let is_mirrored = stream.is_mirrored().unwrap_or(false);
        Self {
            given: order.camera(),
            field_of_view: stream.field_of_view(),
            is_flipped: is_mirrored != order.sensor.mirror,
        }
    }

    /// The camera of frames of a mode.
    fn camera(&self, mode: &Mode) -> Result<CameraModel, String> {
        let told = || self.field_of_view.and_then(|angles| camera_of(mode, angles));
        self.given.or_else(told).ok_or_else(|| {
            "the sensor does not say what angle it sees; give camera.fx, camera.fy, camera.cx and camera.cy".to_owned()
        })
    }

    fn develop(&self, frame: &Frame<'_>, timestamp_ns: u64) -> Result<DepthFrame, String> {
        let mode = frame.mode().ok_or("a frame whose pixels are no depth in 1 mm or 0.1 mm")?;
        let mut camera = self.camera(&mode)?;
        let mut depth = frame.pixels()?;
        let [width, height] = frame.size().unwrap_or_default();
        let [left, top] = frame.origin();
        (camera.cx, camera.cy) = (camera.cx - left as f64, camera.cy - top as f64);
        if self.is_flipped {
            depth.chunks_exact_mut(width).for_each(<[u16]>::reverse);
            if self.given.is_none() {
                camera.cx = (width as f64 - 1.0) - camera.cx;
            }
        }
        if depth.iter().all(|pixel| *pixel == 0) {
            return Err("a frame without a single reading".to_owned());
        }
        Ok(DepthFrame { width, height, depth, depth_unit_m: mode.depth_unit_m, timestamp_ns, camera })
    }
}

/// Streams the sensor that is wanted until it is gone; waits for it if it is not there.
///
/// # Errors
/// Why it cannot go on.
pub(super) fn stream(order: &Order, link: &mut Link) -> Result<Result<(), Closed>, String> {
    let context = Context::open(&order.sensor.openni2_library).map_err(|error| error.to_string())?;
    let wanted = order.sensor.device.as_deref();
    let device = loop {
        if let Some(device) = find(&context, wanted)? {
            break device;
        }
        let which = wanted.map_or_else(String::new, |wanted| format!(" {wanted}"));
        if link.missing(&format!("no OpenNI2 sensor{which} is plugged in")).is_err() {
            return Ok(Err(Closed));
        }
        context.wait_for_change(TICK);
    };
    stream_device(&device, order, link)
}

fn stream_device(device: &Device<'_>, order: &Order, link: &mut Link) -> Result<Result<(), Closed>, String> {
    let told = |error: handles::OpenNiError| error.to_string();
    let SensorConfig { device: wanted, mirror, .. } = &order.sensor;
    let mut stream = device.depth_stream().map_err(told)?;
    if wanted.as_deref().is_some_and(is_recording) {
        device.set_playback(1.0, true).map_err(told)?;
    } else {
        let modes = device.depth_modes();
        let mode = choose(&modes, &order.sensor).ok_or_else(|| {
            let modes: Vec<String> = modes.iter().map(Mode::to_string).collect();
            format!("the sensor has no such mode, but {}; see the keys of [sensor]", modes.join(", "))
        })?;
        stream.set_mode(&mode).map_err(told)?;
        // Where it cannot be set, the pictures are turned here.
        if let Err(error) = stream.set_mirrored(*mirror) {
            tracing::debug!(%error, "the sensor is not told how to mirror");
        }
    }
    let developer = Developer::new(&stream, order);
    let mode = stream.mode().ok_or("the sensor's pixels are no depth in 1 mm or 0.1 mm")?;
    developer.camera(&mode)?;
    stream.start().map_err(told)?;
    let serial = device.serial().map_or(Ok(()), |serial| link.say(&Message::Serial(serial)));
    if serial.and_then(|()| link.say(&Message::Opened(description(device, &mode)))).is_err() {
        return Ok(Err(Closed));
    }
    let mut clock = SensorClock::default();
    let mut before = None;
    loop {
        if device.is_gone() {
            return Err("the sensor was unplugged".to_owned());
        }
        let Some(frame) = stream.next(TICK).map_err(told)? else { continue };
        let lost = before.map_or(0, |before| frame.index().saturating_sub(before).saturating_sub(1));
        before = Some(frame.index());
        let timestamp_ns = clock.time(i128::from(frame.timestamp_us()) * 1000, unix_ns);
        let mut sent = Ok(());
        if lost > 0 {
            sent = link.say(&Message::Lost(lost.cast_unsigned()));
        }
        let sent = sent.and_then(|()| match developer.develop(&frame, timestamp_ns) {
            Ok(frame) => link.frame(frame),
            Err(reason) => link.say(&Message::Bad(reason)),
        });
        if sent.is_err() {
            return Ok(Err(Closed));
        }
    }
}

/// Model, serial number and mode.
fn description(device: &Device<'_>, mode: &Mode) -> String {
    let info = device.info().ok();
    let model =
        info.map_or_else(String::new, |info| format!("{} {}", info.vendor, info.name).trim().to_owned());
    let serial = device.serial().map_or_else(String::new, |serial| format!(" {serial}"));
    format!("{model}{serial}, {mode}")
}

/// Plays a recording, each frame once. `frames`: how many it has, where it does not say so: of one that was never finished
/// the library tells no end.
///
/// # Errors
/// Why it cannot be played, or not further.
pub(super) fn play(
    path: &Path,
    frames: Option<u64>,
    order: &Order,
    link: &mut Link,
) -> Result<Result<(), Closed>, String> {
    let told = |error: handles::OpenNiError| error.to_string();
    let context = Context::open(&order.sensor.openni2_library).map_err(told)?;
    let uri = path.to_str().ok_or("OpenNI2 opens only what has a name in UTF-8")?;
    let device = context.open_device(uri).map_err(told)?;
    let mut stream = device.depth_stream().map_err(told)?;
    device.set_playback(AS_READ, false).map_err(told)?;
    let developer = Developer::new(&stream, order);
    let frames = frames.or_else(|| stream.frames());
    stream.start().map_err(told)?;
    let mode = stream.mode().map_or_else(String::new, |mode| mode.to_string());
    if link.say(&Message::Opened(mode)).is_err() {
        return Ok(Err(Closed));
    }
    let mut got = 0;
    while frames.is_none_or(|frames| got < frames) {
        let Some(frame) = stream.next(TICK).map_err(told)? else {
            if device.is_over() {
                break;
            }
            continue;
        };
        got += 1;
        let timestamp_ns = START_NS.saturating_add(frame.timestamp_us().saturating_mul(1000));
        let sent = match developer.develop(&frame, timestamp_ns) {
            Ok(frame) => link.frame(frame),
            Err(reason) => link.say(&Message::Bad(format!("frame {}: {reason}", frame.index()))),
        };
        if sent.is_err() {
            return Ok(Err(Closed));
        }
    }
    Ok(link.say(&Message::End))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODES: [Mode; 4] = [
        Mode { width: 320, height: 240, fps: 30, depth_unit_m: 0.001 },
        Mode { width: 640, height: 480, fps: 30, depth_unit_m: 0.0001 },
        Mode { width: 640, height: 480, fps: 30, depth_unit_m: 0.001 },
        Mode { width: 320, height: 240, fps: 60, depth_unit_m: 0.001 },
    ];

    fn chosen(wanted: SensorConfig) -> Option<usize> {
        choose(&MODES, &wanted).and_then(|mode| MODES.iter().position(|other| *other == mode))
    }

    #[test]
    fn the_mode_that_is_wanted_is_chosen_and_else_the_usual_one() {
        let any = SensorConfig::default;
        assert_eq!(chosen(any()), Some(2));
        assert_eq!(chosen(SensorConfig { size: Some([320, 240]), ..any() }), Some(0));
        assert_eq!(chosen(SensorConfig { fps: Some(60), ..any() }), Some(3));
        assert_eq!(chosen(SensorConfig { depth_unit_m: Some(0.0001), ..any() }), Some(1));
        assert_eq!(chosen(SensorConfig { fps: Some(90), ..any() }), None);
    }

    #[test]
    fn a_port_or_a_uri_names_a_device() {
        let uri = "1d27/0601@1/7";
        assert!(is_named(uri, uri) && is_named("1/7", uri));
        assert!(!is_named("1/8", uri) && !is_named("7", uri) && !is_named("", uri));
    }

    #[test]
    fn the_angle_seen_gives_the_focal_length() {
        let camera = camera_of(&MODES[2], [1.0225999, 0.796_615_66]).expect("a camera");
        assert!((camera.fx - 570.34).abs() < 0.01 && (camera.fy - 570.34).abs() < 0.01, "{camera:?}");
        assert_eq!((camera.cx, camera.cy), (319.5, 239.5));
        // The edge of the picture is seen at half of the angle.
        let edge = camera.deproject(-0.5, 239.5, 1.0);
        assert!((f64::from(-edge.x).atan() - 1.0225999 / 2.0).abs() < 1e-6);
        assert_eq!(camera_of(&MODES[2], [0.0, 0.0]), None);
        assert_eq!(camera_of(&MODES[2], [f64::NAN, 0.8]), None);
    }
}
