//! Sensors that the kernel reads: V4L2. Runs in the sensor process.
//!
//! Depth's unit is not in the pixel format, and V4L2 knows nothing of lenses: both come from the configuration or from what
//! is known of sensors of a kind ([`Profile`]).

mod camera;
mod nodes;
mod plan;
mod stamp;

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::io::Errno;

use self::camera::Camera;
use self::nodes::{Node, nodes};
use self::plan::Plan;
use super::access;
use super::clock::SensorClock;
use super::host::{Closed, Link, Message, Order};
use super::listed::{Listed, ListedMode};
use super::profile::Profile;
use crate::config::SensorConfig;

/// How often it is looked whether a sensor came.
const TICK: Duration = Duration::from_millis(100);
/// How long udev may take to give a new node to its group.
const UDEV_PATIENCE: Duration = Duration::from_secs(2);

fn all_nodes() -> Vec<Node> {
    nodes(Path::new("/sys"), Path::new("/dev"))
}

/// What is known of a node's sensor by its kind: of the kind that the configuration names, else of its USB device's.
fn profile_of(node: &Node, sensor: &SensorConfig) -> Option<&'static Profile> {
    match &sensor.profile {
        Some(name) => Profile::named(name),
        None => node.usb.as_ref().and_then(|usb| Profile::of_usb(usb.id.0, usb.id.1)),
    }
}

/// The nodes that may give depth.
pub(super) fn list(sensor: &SensorConfig) -> Vec<Listed> {
    all_nodes().iter().filter_map(|node| listed(node, sensor)).collect()
}

fn listed(node: &Node, sensor: &SensorConfig) -> Option<Listed> {
    let profile = profile_of(node, sensor);
    let opened = Camera::open(&node.path);
    let modes = opened.as_ref().map(Camera::modes).unwrap_or_default();
    // Most nodes are of other cameras. Of one that cannot be opened that is not known.
    if opened.is_ok() && modes.is_empty() {
        return None;
    }
    let unit_m = sensor.depth_unit_m.or(profile.map(|profile| profile.counts.unit_m()));
    let shown = |mode: plan::Mode| ListedMode {
        width: mode.size[0],
        height: mode.size[1],
        fps: mode.fps,
        format: Some(mode.format.to_string()),
        depth_unit_m: unit_m,
    };
    let (vendor, name) = node.vendor_and_model();
    let port = node.usb.iter().map(|usb| usb.port.clone());
    Some(Listed {
        driver: "v4l2".to_owned(),
        uri: node.path.display().to_string(),
        names: node.links.iter().map(|link| link.display().to_string()).chain(port).collect(),
        serial: node.usb.as_ref().and_then(|usb| usb.serial.clone()),
        vendor,
        name,
        usb: node.usb.as_ref().map(super::usb::UsbDevice::id_text),
        profile: profile.map(|profile| profile.name.to_owned()),
        modes: modes.into_iter().map(shown).collect(),
        trouble: opened.err().map(|error| refusal(&node.path, &error)),
    })
}

/// Why a node cannot be opened.
fn refusal(node: &Path, error: &io::Error) -> String {
    let denied = (error.kind() == io::ErrorKind::PermissionDenied).then(|| access::denied(node)).flatten();
    denied.unwrap_or_else(|| format!("{} cannot be opened: {error}", node.display()))
}

/// Looks for the sensor that is wanted, again and again; a node that was looked at and is not it is not opened each time,
/// since that wakes a camera up.
#[derive(Default)]
struct Search {
    passed: BTreeSet<PathBuf>,
    closed_since: Option<Instant>,
}

impl Search {
    /// The sensor, if it is there.
    ///
    /// # Errors
    /// When what is wanted is there and cannot be used.
    fn find(&mut self, order: &Order) -> Result<Option<(Node, Camera, Plan)>, String> {
        let wanted = order.sensor.device.as_deref();
        let nodes = all_nodes();
        self.passed.retain(|path| nodes.iter().any(|node| node.path == *path));
        let (mut closed, mut unfit) = (None, None);
        for node in nodes {
            let is_named = wanted.is_none_or(|wanted| node.is_named(wanted));
            if !is_named || self.passed.contains(&node.path) {
                continue;
            }
            let camera = match Camera::open(&node.path) {
                Ok(camera) => camera,
                Err(error) => {
                    // It may have gone meanwhile.
                    let is_there = ![Errno::NOENT, Errno::NODEV, Errno::NXIO].contains(&errno(&error));
                    closed = closed.or_else(|| is_there.then(|| refusal(&node.path, &error)));
                    continue;
                }
            };
            let modes = camera.modes();
            match Plan::new(&modes, profile_of(&node, &order.sensor), order) {
                Ok(plan) => return Ok(Some((node, camera, plan))),
                // Some other camera, or another node of this one.
                Err(_) if modes.is_empty() => _ = self.passed.insert(node.path),
                Err(reason) => unfit = unfit.or_else(|| Some(format!("{}: {reason}", node.path.display()))),
            }
        }
        if let Some(reason) = unfit {
            return Err(reason);
        }
        let Some(reason) = closed else {
            self.closed_since = None;
            return Ok(None);
        };
        let since = *self.closed_since.get_or_insert_with(Instant::now);
        if since.elapsed() < UDEV_PATIENCE { Ok(None) } else { Err(reason) }
    }
}

fn errno(error: &io::Error) -> Errno {
    Errno::from_io_error(error).unwrap_or(Errno::IO)
}

/// Streams the sensor that is wanted until it is gone; waits for it if it is not there.
///
/// # Errors
/// Why it cannot go on.
pub(super) fn stream(order: &Order, link: &mut Link) -> Result<Result<(), Closed>, String> {
    let mut search = Search::default();
    let (node, camera, plan) = loop {
        if let Some(found) = search.find(order)? {
            break found;
        }
        let which = order.sensor.device.as_ref().map_or_else(String::new, |device| format!(" {device}"));
        if link.missing(&format!("no V4L2 sensor{which} that gives depth is plugged in")).is_err() {
            return Ok(Err(Closed));
        }
        std::thread::sleep(TICK);
    };
    let told = |error: io::Error| match errno(&error) {
        Errno::NODEV => "the sensor was unplugged".to_owned(),
        Errno::BUSY => format!("another program streams {}; end it", node.path.display()),
        _ => format!("{}: the driver gives no frames: {error}", node.path.display()),
    };
    let mut stream = camera.start(&plan.mode).map_err(told)?;
    if let Some(approximate) = plan.approximate {
        tracing::warn!(
            profile = approximate.name,
            "the camera's intrinsics are those of its kind, up to {} % off, and so are lengths and widths; give its own as \
             camera.fx, camera.fy, camera.cx and camera.cy",
            (approximate.nominal.tolerance * 100.0).round()
        );
    }
    let serial = node.usb.as_ref().and_then(|usb| usb.serial.clone());
    let told_serial = serial.map_or(Ok(()), |serial| link.say(&Message::Serial(serial)));
    if told_serial.and_then(|()| link.say(&Message::Opened(description(&node, &plan)))).is_err() {
        return Ok(Err(Closed));
    }
    let mut clock = SensorClock::default();
    let mut before: Option<u32> = None;
    loop {
        let frame = stream.next().map_err(told)?;
        let stamp = frame.stamp;
        if before.is_none() {
            tracing::info!(node = %node.path.display(), "time stamps of frames are {stamp}");
        }
        // Numbers begin anew after the highest; a step back is no loss.
        let lost = before.map_or(0, |before| frame.sequence.wrapping_sub(before).wrapping_sub(1));
        before = Some(frame.sequence);
        let mut sent = Ok(());
        if (1..u32::MAX / 2).contains(&lost) {
            sent = link.say(&Message::Lost(lost.into()));
        }
        // Of a sensor that was unplugged, the driver hands back what it could not fill.
        if frame.bytes.is_empty() {
            continue;
        }
        let timestamp_ns = clock.time(stamp.sensor_ns, || stamp.unix_ns());
        let damaged = || "a frame that the driver calls damaged".to_owned();
        let developed = plan.develop(frame.bytes, frame.stride, timestamp_ns);
        let whole = developed.and_then(|whole| if frame.is_damaged { Err(damaged()) } else { Ok(whole) });
        let sent = sent.and_then(|()| match whole {
            Ok(frame) => link.frame(frame),
            Err(reason) => link.say(&Message::Bad(reason)),
        });
        if sent.is_err() {
            return Ok(Err(Closed));
        }
    }
}

/// Model, serial number, mode, and what is known by its kind alone.
fn description(node: &Node, plan: &Plan) -> String {
    let (vendor, model) = node.vendor_and_model();
    let serial = node.usb.as_ref().and_then(|usb| usb.serial.as_ref());
    let serial = serial.map_or_else(String::new, |serial| format!(" {serial}"));
    let named = format!("{vendor} {model}{serial}");
    let unit_mm = plan.unit_m() * 1e3;
    let kind = plan
        .approximate
        .map_or_else(String::new, |profile| format!(", camera about that of {}", profile.name));
    format!("{}, {} {unit_mm} mm{kind}", named.trim(), plan.mode)
}
