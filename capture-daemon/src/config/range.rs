//! The range of each key.

use std::ops::RangeInclusive;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use super::Config;
use crate::source::profile::Profile;

/// Longest path of a socket, bytes: the system has no room for more.
const MAX_SOCKET_BYTES: usize = 107;

/// The first key whose value is out of its range, and the range.
pub(super) fn out_of_range(config: &Config) -> Option<(&'static str, String)> {
    fn within(key: &'static str, value: f64, range: RangeInclusive<f64>) -> Option<(&'static str, String)> {
        (!range.contains(&value)).then(|| (key, format!("{} to {}", range.start(), range.end())))
    }
    let Config { source, sensor, camera, mask, capture, blade, refine, store, record, service } = config;
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
    let socket =
        || Some(("service.socket", format!("the path of a socket, of 1 to {MAX_SOCKET_BYTES} bytes")));
    let directory = || Some(("store.directory", "the path of a folder".to_owned()));
    let is_none = |path: &Path| path.as_os_str().is_empty() || path.as_os_str().as_bytes().contains(&0);
    let no_directory = store.directory.as_deref().is_some_and(is_none);
    let recordings = || Some(("record.directory", "the path of a folder".to_owned()));
    let no_recordings = record.directory.as_deref().is_some_and(is_none);
    let no_socket = is_none(&service.socket) || service.socket.as_os_str().len() > MAX_SOCKET_BYTES;
    let who = |key, list: &[String]| {
        let odd = list.iter().any(|entry| entry.is_empty() || entry == "@");
        odd.then(|| (key, "a list of \"*\", users, and groups with @ before them".to_owned()))
    };
    let mode = || Some(("service.socket_mode", "0o000 to 0o777".to_owned()));
    let is_both = sensor.driver.is_some() && source.recording.is_some();
    let both =
        || Some(("sensor.driver", "no source.recording beside it: frames come from one of them".to_owned()));
    let size = || Some(("sensor.size", "[columns, rows] of 1 to 1280 and 1 to 1024 pixels".to_owned()));
    let bad_size = sensor.size.is_some_and(|[w, h]| !(1..=1280).contains(&w) || !(1..=1024).contains(&h));
    let no_profile = sensor.profile.as_deref().is_some_and(|name| Profile::named(name).is_none());
    let profiles = || Some(("sensor.profile", format!("one of {}", Profile::names())));
    let library = || Some(("sensor.openni2_library", "the name or path of a library".to_owned()));
    within("source.rate", source.rate, 0.0..=1000.0)
        .or_else(|| is_both.then(both).flatten())
        .or_else(|| bad_size.then(size).flatten())
        .or_else(|| sensor.fps.and_then(|fps| within("sensor.fps", fps.into(), 1.0..=1000.0)))
        .or_else(|| sensor.depth_unit_m.and_then(|unit| within("sensor.depth_unit_m", unit, 0.000_01..=0.01)))
        .or_else(|| no_profile.then(profiles).flatten())
        .or_else(|| within("sensor.deadline_s", sensor.deadline_s, 0.1..=600.0))
        .or_else(|| is_none(&sensor.openni2_library).then(library).flatten())
        .or_else(|| no_directory.then(directory).flatten())
        .or_else(|| within("store.archive_max", store.archive_max as f64, 0.0..=100_000.0))
        .or_else(|| no_recordings.then(recordings).flatten())
        .or_else(|| within("record.file_s", record.file_s, 10.0..=86_400.0))
        .or_else(|| within("record.ring_s", record.ring_s, 0.0..=600.0))
        .or_else(|| within("record.ring_max_mb", record.ring_max_mb, 1.0..=16_000.0))
        .or_else(|| within("record.reserve_mb", record.reserve_mb, 0.0..=10_000_000.0))
        .or_else(|| within("record.max_mb", record.max_mb, 0.0..=100_000_000.0))
        .or_else(|| within("record.max_age_days", record.max_age_days, 0.0..=36_500.0))
        .or_else(|| (service.socket_mode > 0o777).then(mode).flatten())
        .or_else(|| who("service.watch", &service.watch))
        .or_else(|| who("service.change", &service.change))
        .or_else(|| within("service.max_connections", service.max_connections as f64, 2.0..=10_000.0))
        .or_else(|| no_socket.then(socket).flatten())
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
