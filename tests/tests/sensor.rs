//! Does a live sensor come through its process into the station, and does the station outlive whatever it does: unplugged,
//! plugged in again as another, silent, hung, crashed? With a driver of our own in the real libOpenNI2.

use std::path::Path;
use std::time::Duration;

use capture_daemon::source::FrameSource;
use capture_daemon::source::host::SensorSource;
use capture_daemon::synth::{Clip, ClipParams, Family, Scene};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use tests::conformance::{self, Bench, first_frame, frames, number, until_interrupted};
use tests::daemon::Daemon;
use tests::oni::{OniParams, OniWriter};
use tests::openni2;
use tests::programs::{DEADLINE, Program, Running, wait_for};
use tests::sensors::{Sensors, picture};

/// Settings of a station on these sensors.
fn settings(sensors: &Sensors) -> Vec<(&'static str, String)> {
    vec![
        ("sensor.driver", "\"openni2\"".to_owned()),
        ("sensor.openni2_library", format!("{:?}", sensors.library())),
        ("sensor.deadline_s", "1.0".to_owned()),
    ]
}

/// A source on these sensors, each in a process of its own.
fn source(sensors: &Sensors, more: &[&str]) -> SensorSource {
    conformance::source(&settings(sensors), more)
}

#[test]
fn frames_come_in_order_with_every_pixel_and_the_sensor_s_own_time() {
    let Some(sensors) = Sensors::new() else { return };
    sensors.plug("1-2", "serial=A1 width=320 height=240 skip=20");
    let mut source = source(&sensors, &[]);
    let frames = frames(&mut source, 30);
    let first = number(&frames[0]);
    for (index, frame) in (0..).zip(&frames) {
        let k = first + index + u32::from(first + index >= 20);
        assert!(frame.depth == picture(k, 320, 240), "frame {k}");
        let elapsed_us = (frame.timestamp_ns - frames[0].timestamp_ns) / 1000;
        assert_eq!(elapsed_us, u64::from(k) * 1_000_000 / 30 - u64::from(first) * 1_000_000 / 30);
        assert_eq!((frame.camera.cx, frame.depth_unit_m), (159.5, 0.001));
    }
    let fares = source.health().expect("it is live").now();
    assert_eq!((fares.starts, fares.lost_frames), (1, 1), "{fares:?}");
    assert!(fares.name.expect("it is open").contains("A1"), "its serial number");
}

#[test]
fn what_looks_into_a_mirror_is_turned_and_an_own_camera_taken() {
    let Some(sensors) = Sensors::new() else { return };
    sensors.plug("1-2", "width=320 height=240 unit=101");
    let camera = ["camera.fx=290.5", "camera.fy=291.5", "camera.cx=150.25", "camera.cy=119.0"];
    let mut source = source(&sensors, &[&camera[..], &["sensor.mirror=true"]].concat());
    let mut frame = first_frame(&mut source);
    assert_eq!((frame.depth_unit_m, frame.camera.fx, frame.camera.cx), (0.0001, 290.5, 150.25));
    frame.depth.chunks_exact_mut(320).for_each(<[u16]>::reverse);
    number(&frame);
}

#[test]
fn two_sensors_are_told_apart_by_port_and_by_serial_number() {
    let Some(sensors) = Sensors::new() else { return };
    sensors.plug("1-2", "serial=A1 width=320 height=240");
    sensors.plug("1-3", "serial=B2 width=160 height=120");
    let width = |device: &str| first_frame(&mut source(&sensors, &[device])).width;
    assert_eq!(width("sensor.device=\"1-3\""), 160);
    assert_eq!(width("sensor.device=\"A1\""), 320);
    assert_eq!(width("sensor.device=\"B2\""), 160);
    assert_eq!(width("sensor.device=\"sward/0001@1-2\""), 320);
    // Both at once, each in its process.
    let [mut left, mut right] =
        ["A1", "B2"].map(|serial| source(&sensors, &[&format!("sensor.device={serial:?}")]));
    for _ in 0..10 {
        assert_eq!((first_frame(&mut left).width, first_frame(&mut right).width), (320, 160));
    }
    let library = format!("sensor.openni2_library={:?}", sensors.library());
    let listed = Program::Capture.run(["devices", "--json", "--set", &library]);
    assert_eq!(listed.code, Some(0), "{listed:?}");
    let listed: Value = serde_json::from_str(&listed.stdout).expect("JSON");
    let serials: Vec<&Value> =
        listed.as_array().expect("a list").iter().map(|device| &device["serial"]).collect();
    assert_eq!(serials, ["A1", "B2"], "{listed}");
    assert_eq!(listed[1]["modes"][0]["width"], 160, "{listed}");
}

#[test]
fn the_mode_is_chosen_by_size_rate_and_unit() {
    let Some(sensors) = Sensors::new() else { return };
    sensors.plug("1-2", "width=640 height=480 fps=30");
    assert_eq!(first_frame(&mut source(&sensors, &["sensor.fps=60"])).width, 320);
    let (_, reason) = until_interrupted(&mut source(&sensors, &["sensor.fps=25"]));
    assert!(reason.contains("640x480 30/s 1 mm") && reason.contains("[sensor]"), "{reason}");
}

/// Where they are plugged in.
struct OpenNi2(Sensors);

impl Bench for OpenNi2 {
    fn settings(&self) -> Vec<(&'static str, String)> {
        settings(&self.0)
    }

    fn plug(&mut self, [width, height]: [usize; 2]) {
        self.0.plug("1-2", &format!("width={width} height={height}"));
    }

    fn unplug(&mut self) {
        self.0.unplug("1-2");
    }
}

#[test]
fn it_does_what_every_sensor_does() {
    let Some(sensors) = Sensors::new() else { return };
    conformance::holds(&mut OpenNi2(sensors));
}

#[test]
fn one_that_falls_silent_hangs_or_crashes_is_killed_and_tried_again() {
    let Some(sensors) = Sensors::new() else { return };
    sensors.plug("1-2", "width=160 height=120 stall=10");
    let mut silent = source(&sensors, &[]);
    let (count, reason) = until_interrupted(&mut silent);
    assert!((1..=10).contains(&count) && reason.contains("gave no frame for 1 s"), "{count} {reason}");
    assert!(first_frame(&mut silent).width == 160, "the next one streams again");
    let fares = silent.health().expect("it is live").now();
    assert_eq!((fares.starts, fares.silences, fares.deaths), (2, 1, 0), "{fares:?}");
    drop(silent);

    sensors.unplug("1-2");
    sensors.plug("1-3", "width=160 height=120 crash=5");
    let mut dying = source(&sensors, &[]);
    let (count, reason) = until_interrupted(&mut dying);
    assert!(count <= 5 && reason.contains("crashed (signal 6)"), "{count} {reason}");
    assert!(first_frame(&mut dying).width == 160);
    assert_eq!(dying.health().expect("it is live").now().deaths, 1);
    drop(dying);

    sensors.unplug("1-3");
    sensors.plug("1-4", "hang=1");
    let mut hung = source(&sensors, &[]);
    let (count, reason) = until_interrupted(&mut hung);
    assert!(count == 0 && reason.contains("gave no frame"), "{count} {reason}");
    sensors.unplug("1-4");
    sensors.plug("1-5", "width=160 height=120");
    assert_eq!(first_frame(&mut hung).width, 160);
}

/// Sensor processes of a station.
fn children(of: u32) -> Vec<u32> {
    let of = of.to_string();
    let output = std::process::Command::new("pgrep").args(["-P", &of, "-f", "sensor-process"]).output();
    let output = output.expect("pgrep runs").stdout;
    String::from_utf8_lossy(&output).lines().map(|line| line.parse().expect("an id")).collect()
}

#[test]
fn the_station_outlives_its_sensor_and_says_how_it_fares() {
    let Some(sensors) = Sensors::new() else { return };
    let mut daemon = Daemon::start(&settings(&sensors));
    let mut station = daemon.connect();
    let mut wait_until = |what: &str, holds: &dyn Fn(&Value) -> bool| {
        let status = wait_for(DEADLINE, || Some(station.status()).filter(|status| holds(status)));
        status.unwrap_or_else(|| panic!("{what}"))
    };
    let is_missing =
        |status: &Value| status["sensor"].as_str().is_some_and(|said| said.contains("plugged in"));
    let absent = wait_until("it is up without a sensor", &is_missing);
    assert_eq!(absent["state"], "no_source", "{absent}");
    let said = daemon.client(&["preview"]);
    assert!(said.stdout.contains("reconnecting"), "{said:?}");

    sensors.plug("1-2", "serial=A1 width=320 height=240");
    let streams =
        wait_until("it streams", &|status| status["sensor"] == "ok" && status["frames"].as_i64() > Some(5));
    assert!(streams["source"].as_str().is_some_and(|name| name.contains("A1")), "{streams}");
    assert_eq!(streams["dropped_frames"], 0, "{streams}");

    // Whatever the process does, the station goes on.
    let process = *children(daemon.running().id()).first().expect("a sensor process");
    let process = Pid::from_raw(process.cast_signed()).expect("an id");
    kill_process(process, Signal::STOP).expect("it runs");
    let hung = wait_until("it is missed", &|status| status["sensor_silences"].as_i64() > Some(0));
    assert_eq!(hung["state"], "no_source", "{hung}");
    let before = hung["frames"].as_i64();
    wait_until("it streams again", &|status| status["sensor"] == "ok" && status["frames"].as_i64() > before);

    sensors.unplug("1-2");
    wait_until("it is gone", &is_missing);
    sensors.plug("1-2", "serial=A1 width=160 height=120");
    let back = wait_until("it is back", &|status| status["sensor"] == "ok");
    assert!(back["sensor_starts"].as_i64() >= Some(3) && back["sensor_failures"] == 1, "{back}");
    let shown = daemon.client(&["status"]).stdout;
    assert!(shown.contains("sensor    ok"), "{shown}");

    let process = *children(daemon.running().id()).first().expect("a sensor process");
    let _folder = daemon.kill();
    let is_gone = || (!Path::new(&format!("/proc/{process}/exe")).exists()).then_some(());
    wait_for(Duration::from_secs(5), is_gone).expect("no process outlives its station");
}

#[test]
fn a_blade_before_a_sensor_is_captured() {
    if !openni2::is_there() {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let params = ClipParams { frames: 45, ..ClipParams::default() };
    let clip = Clip::new(Scene::new(Family::Single, 3), params).expect("the parameters are in range");
    let camera = clip.frame(0).camera;
    let [across, down] =
        [(640.0, camera.fx), (480.0, camera.fy)].map(|(pixels, focal)| 2.0 * (pixels / 2.0 / focal).atan());
    let path = folder.path().join("blade.oni");
    let params = OniParams { field_of_view: [across, down], ..OniParams::default() };
    let mut writer = OniWriter::create(&path, &params);
    for (index, frame) in (0..).zip(clip.frames()) {
        writer.frame(index * 33_333, &frame.depth);
    }
    writer.finish();
    let replayed = Program::Capture.run([Path::new("replay"), &path, Path::new("--json")]).stdout;
    let replayed: Value = serde_json::from_str(replayed.lines().next().expect("a blade")).expect("JSON");
    let expected_m = replayed["length_m"].as_f64().expect("a length");

    let settings = [("sensor.driver", "\"openni2\"".to_owned()), ("sensor.device", format!("{path:?}"))];
    let daemon = Daemon::start(&settings);
    let library = daemon.connect().library_of_at_least(1);
    let lengths: Vec<f64> = library.blades().map(|blade| f64::from(blade.length_m())).collect();
    assert!((lengths[0] - expected_m).abs() < 0.03 * expected_m, "{lengths:?}, in a replay {expected_m}");
    let status = daemon.connect().status();
    assert_eq!((&status["sensor"], &status["skipped_frames"]), (&"ok".into(), &0.into()), "{status}");
}

#[test]
fn a_sensor_and_a_recording_exclude_each_other() {
    let arguments =
        ["check-config", "--set", "sensor.driver=\"openni2\"", "--set", "source.recording=\"a.mcap\""];
    let finished = Running::start(Program::Capture.command(arguments)).finish(DEADLINE);
    assert_eq!(finished.code, Some(2), "{finished:?}");
    assert!(
        finished.stderr.contains("`sensor.driver`") && finished.stderr.contains("source.recording"),
        "{finished:?}"
    );
}
