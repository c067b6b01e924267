//! Does a depth camera that the kernel reads come through its process into the station? The kernel's own `uvcvideo` streams an
//! emulated camera in a small machine, where each of these tests runs (`tests/src/vm.rs`); here it is looked what came of it.

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use capture_daemon::config::Config;
use capture_daemon::frame::DepthFrame;
use capture_daemon::recording;
use capture_daemon::source::host::SensorSource;
use capture_daemon::source::{FrameSource, SourceError};
use common::library::Snapshot;
use common::sealed::SealedBytes;
use serde_json::Value;
use tests::conformance::{self, Bench, first_frame, frames, number, until_interrupted};
use tests::daemon::Daemon;
use tests::programs::{DEADLINE, Program, Running, wait_for};
use tests::uvc::{Camera, CameraParams, Fault, Pixels};
use tests::vm;

/// The group that owns cameras, and a user who is in no group but his own: as the machine's `/etc/group` has them.
const VIDEO: u32 = 44;
const VISITOR: u32 = 1000;

/// Defines tests that run in the small machine.
macro_rules! in_the_machine {
    ($(fn $name:ident() $body:block)*) => {
        $(#[test] fn $name() { vm::test(stringify!($name), || $body); })*
    };
}

/// Settings for a camera of no known kind.
fn settings() -> Vec<(&'static str, String)> {
    let settings = [
        ("sensor.driver", "\"v4l2\""),
        ("sensor.depth_unit_m", "0.001"),
        ("sensor.deadline_s", "3.0"),
        ("camera.fx", "290.5"),
        ("camera.fy", "291.5"),
        ("camera.cx", "160.25"),
        ("camera.cy", "119.0"),
    ];
    settings.map(|(key, value)| (key, value.to_owned())).to_vec()
}

/// A port that cameras are plugged into.
#[derive(Default)]
struct Uvc(Option<Camera>);

impl Bench for Uvc {
    fn settings(&self) -> Vec<(&'static str, String)> {
        settings()
    }

    fn plug(&mut self, size: [usize; 2]) {
        self.0 = Some(Camera::plug(CameraParams { sizes: vec![size], ..CameraParams::default() }));
    }

    fn unplug(&mut self) {
        self.0 = None;
    }
}

/// Frames in a row, until the source says something else; and that.
fn frames_until_said(source: &mut dyn FrameSource) -> (Vec<DepthFrame>, SourceError) {
    let mut frames = Vec::new();
    loop {
        match source.next_frame() {
            Ok(frame) => frames.push(frame),
            Err(error) => return (frames, error),
        }
        assert!(frames.len() < 200, "it goes on");
    }
}

/// Why a camera that is there is not streamed; the kernel may not have found it yet.
fn refusal(source: &mut SensorSource) -> String {
    let said = wait_for(DEADLINE, || {
        let (_, reason) = until_interrupted(source);
        (!reason.contains("plugged in")).then_some(reason)
    });
    said.expect("it says why")
}

/// Whether the driver hands on frames that it knows to be torn, from the next camera on.
fn hand_on_torn_frames(whether: &str) {
    fs::write("/sys/module/uvcvideo/parameters/nodrop", whether).expect("the driver takes it");
}

/// What `devices` lists once udev has named so many of them, run as this user and group.
fn devices(count: usize, id: u32, group: u32, more: &[&str]) -> Vec<Value> {
    let listed = wait_for(DEADLINE, || {
        let mut command = Program::Capture.command([&["devices", "--json"], more].concat());
        command.uid(id).gid(group).env("SWARD_LOG", "off");
        let finished = Running::start(command).finish(DEADLINE);
        assert_eq!(finished.code, Some(0), "{finished:?}");
        let listed: Vec<Value> = serde_json::from_str(&finished.stdout).expect("JSON");
        let is_named = |device: &&Value| device["names"].as_array().is_some_and(|names| names.len() == 3);
        (listed.iter().filter(is_named).count() >= count).then_some(listed)
    });
    listed.expect("they are listed with their names")
}

/// The node of the USB device of a vendor.
fn usb_node(vendor: &str) -> Option<PathBuf> {
    let read = |path: PathBuf| fs::read_to_string(path).ok().map(|text| text.trim().to_owned());
    let folders = fs::read_dir("/sys/bus/usb/devices").ok()?.flatten().map(|entry| entry.path());
    let mut folders = folders.filter(|folder| read(folder.join("idVendor")).as_deref() == Some(vendor));
    let folder = folders.next()?;
    let number = |name| read(folder.join(name))?.parse::<u16>().ok();
    Some(format!("/dev/bus/usb/{:03}/{:03}", number("busnum")?, number("devnum")?).into())
}

/// Mode and group of a node.
fn owned(node: &Path) -> Option<(u32, u32)> {
    let metadata = fs::metadata(node).ok()?;
    Some((metadata.permissions().mode() & 0o777, metadata.gid()))
}

/// The knots of each blade of a library, bit for bit, in an order that does not depend on names and times.
fn knots(library: &Snapshot<SealedBytes>) -> Vec<Vec<u8>> {
    let all = library.knot_bytes();
    let of_blade = |range: std::ops::Range<usize>| all[32 * range.start..32 * range.end].to_vec();
    let mut knots: Vec<Vec<u8>> = library.blades().map(|blade| of_blade(blade.knot_range())).collect();
    knots.sort();
    knots
}

in_the_machine! {
    fn it_does_what_every_sensor_does() {
        conformance::holds(&mut Uvc::default());
    }

    fn every_format_of_depth_comes_pixel_for_pixel() {
        for (pixels, more) in [
            (Pixels::Z16, &[][..]),
            (Pixels::Invz, &[]),
            (Pixels::Inzi, &[]),
            (Pixels::Y16, &["sensor.format=\"Y16\""]),
            (Pixels::Y10, &["sensor.format=\"Y10\""]),
        ] {
            let camera = Camera::plug(CameraParams { pixels, ..CameraParams::default() });
            let mut source = conformance::source(&settings(), more);
            let first = first_frame(&mut source);
            let next = &frames(&mut source, 1)[0];
            assert!(number(&first) < number(next), "{pixels:?}");
            assert_eq!((first.camera.fx, first.camera.cy, first.depth_unit_m), (290.5, 119.0, 0.001), "{pixels:?}");
            drop(source);
            camera.unplug();
        }
    }

    fn what_may_be_infrared_is_not_taken_for_depth() {
        let _camera = Camera::plug(CameraParams { pixels: Pixels::Y16, ..CameraParams::default() });
        let said = refusal(&mut conformance::source(&settings(), &[]));
        assert!(said.contains("Y16") && said.contains("sensor.format") && said.contains("/dev/video"), "{said}");
    }

    fn frames_are_stamped_when_they_were_taken_and_lost_ones_are_counted() {
        let _camera = Camera::plug(CameraParams { fps: 10, ..CameraParams::default() });
        let mut source = conformance::source(&settings(), &[]);
        let mut all = vec![first_frame(&mut source)];
        all.extend(frames(&mut source, 10));
        let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).expect("after 1970");
        let age_s = now.as_secs_f64() - all[10].timestamp_ns as f64 * 1e-9;
        // A machine that is emulated on a busy one may be slow.
        assert!((0.0..30.0).contains(&age_s), "the last was taken {age_s} s ago");
        let numbers = [&all[0], &all[10]].map(number);
        let seconds = (all[10].timestamp_ns - all[0].timestamp_ns) as f64 * 1e-9;
        let expected_s = f64::from(numbers[1] - numbers[0]) / 10.0;
        assert!((0.5..10.0).contains(&(seconds / expected_s)), "{seconds} s for {numbers:?}");
        let fares = source.health().expect("it is live").now();
        assert_eq!(u64::from(numbers[1] - numbers[0]) - 10, fares.lost_frames, "{numbers:?}");
    }

    fn a_frame_that_is_torn_or_blank_is_skipped_and_said() {
        // Torn frames are left out by this driver, unless it is told to hand them on: then their size tells.
        for (hands_on, fault, words) in [
            ("1", Fault::Short(4), "a frame of 76799 bytes, expected 153600 for 320x240 Z16"),
            ("0", Fault::Blank(4), "without a single reading"),
        ] {
            hand_on_torn_frames(hands_on);
            let camera = Camera::plug(CameraParams { fault: Some(fault), ..CameraParams::default() });
            let mut source = conformance::source(&settings(), &[]);
            first_frame(&mut source);
            let (before, said) = frames_until_said(&mut source);
            assert!(before.iter().all(|frame| number(frame) < 4), "{fault:?}");
            assert!(matches!(&said, SourceError::BadFrame(reason) if reason.contains(words)), "{said:?}");
            let after: Vec<u32> = frames(&mut source, 3).iter().map(number).collect();
            assert!(after[0] > 4 && after.is_sorted(), "{after:?}");
            let fares = source.health().expect("it is live").now();
            assert_eq!((fares.failures, fares.deaths, fares.silences), (0, 0, 0), "{fares:?}");
            drop(source);
            camera.unplug();
        }
    }

    fn a_torn_frame_that_the_driver_leaves_out_is_lost() {
        hand_on_torn_frames("0");
        let fault = Some(Fault::Short(4));
        let _camera = Camera::plug(CameraParams { fault, ..CameraParams::default() });
        let mut source = conformance::source(&settings(), &[]);
        let mut numbers = vec![number(&first_frame(&mut source))];
        numbers.extend(frames(&mut source, 8).iter().map(number));
        assert!(!numbers.contains(&4) && numbers.is_sorted_by(|a, b| a < b), "{numbers:?}");
        let lost = u64::from(numbers[8] - numbers[0]) - 8;
        let fares = source.health().expect("it is live").now();
        assert_eq!((fares.lost_frames, lost > 0), (lost, true), "{numbers:?}");
    }

    fn a_size_that_it_has_not_is_refused_with_those_that_it_has() {
        let sizes = vec![[320, 240], [160, 120]];
        let _camera = Camera::plug(CameraParams { sizes, ..CameraParams::default() });
        let mut source = conformance::source(&settings(), &["sensor.size=[160, 120]"]);
        assert_eq!(first_frame(&mut source).width, 160);
        drop(source);
        let mut source = conformance::source(&settings(), &["sensor.size=[400, 300]"]);
        let reason = refusal(&mut source);
        assert!(reason.contains("320x240 15/s Z16, 160x120 15/s Z16") && reason.contains("[sensor]"), "{reason}");
    }

    fn unplugged_within_its_frames_it_says_so() {
        let fault = Some(Fault::Unplug(7));
        let _camera = Camera::plug(CameraParams { fault, ..CameraParams::default() });
        let mut source = conformance::source(&settings(), &[]);
        first_frame(&mut source);
        let (count, reason) = until_interrupted(&mut source);
        assert!(count < 7 && reason.contains("unplugged"), "{count} {reason}");
        let fares = source.health().expect("it is live").now();
        assert_eq!((fares.failures, fares.deaths, fares.silences), (1, 0, 0), "{fares:?}");
    }

    fn one_that_falls_silent_is_killed_and_tried_again() {
        let fault = Some(Fault::Stall(5));
        let _camera = Camera::plug(CameraParams { fault, ..CameraParams::default() });
        let mut source = conformance::source(&settings(), &[]);
        first_frame(&mut source);
        let (count, reason) = until_interrupted(&mut source);
        assert!(count < 5 && reason.contains("gave no frame for 3 s"), "{count} {reason}");
        number(&first_frame(&mut source));
        let fares = source.health().expect("it is live").now();
        assert_eq!((fares.silences, fares.deaths), (1, 0), "{fares:?}");
    }

    fn two_cameras_are_told_apart_by_each_of_their_names() {
        let size = |size, serial, port| CameraParams { sizes: vec![size], serial, port, ..CameraParams::default() };
        let _cameras = [size([320, 240], "A1", 0), size([160, 120], "B2", 1)].map(Camera::plug);
        let listed = devices(2, 0, 0, &[]);
        assert_eq!(listed.len(), 2, "{listed:?}");
        for device in &listed {
            let width = device["modes"][0]["width"].as_u64().expect("a width") as usize;
            let serial = if width == 320 { "A1" } else { "B2" };
            assert_eq!((&device["serial"], &device["driver"]), (&serial.into(), &"v4l2".into()), "{device}");
            assert_eq!((&device["modes"][0]["format"], &device["usb"]), (&"Z16".into(), &"1234:0001".into()));
            let names: Vec<&str> = device["names"].as_array().expect("a list").iter().filter_map(Value::as_str).collect();
            let by_id = format!("/dev/v4l/by-id/usb-Sward_Emulated_Depth_{serial}-video-index0");
            assert!(names.contains(&&*by_id) && names[1].starts_with("/dev/v4l/by-path/"), "{names:?}");
            let node = device["uri"].as_str().expect("a node");
            let link = by_id.rsplit('/').next().expect("a name");
            for name in names.iter().copied().chain([serial, node, link]) {
                let mut source = conformance::source(&settings(), &[&format!("sensor.device={name:?}")]);
                assert_eq!(first_frame(&mut source).width, width, "{name}");
                let open = source.health().expect("it is live").now().name.expect("it is open");
                assert!(open.contains(serial), "{open}");
            }
        }
    }

    fn a_user_who_may_not_is_told_the_node_its_group_and_the_command() {
        let _camera = Camera::plug(CameraParams::default());
        let listed = devices(1, 0, 0, &[]);
        let node = listed[0]["uri"].as_str().expect("a node");
        assert_eq!(owned(Path::new(node)), Some((0o660, VIDEO)), "udev gave it to the group");
        let denied = devices(1, VISITOR, VISITOR, &[]);
        let trouble = denied[0]["trouble"].as_str().expect("he may not");
        for words in [node, "root:video 0660", "`sudo usermod --append --groups video visitor`"] {
            assert!(trouble.contains(words), "{trouble}");
        }
        let may = devices(1, VISITOR, VIDEO, &[]);
        assert_eq!((&may[0]["trouble"], &may[0]["modes"][0]["width"]), (&Value::Null, &320.into()), "{may:?}");
    }

    fn the_rules_give_sensors_to_a_group_and_to_nobody_else() {
        for (id, vendor, expected) in
            [((0x1d27, 0x0601), "1d27", (0o660, VIDEO)), ((0x1234, 1), "1234", (0o664, 0))]
        {
            let camera = Camera::plug(CameraParams { id, ..CameraParams::default() });
            let reached = wait_for(DEADLINE, || (owned(&usb_node(vendor)?)? == expected).then_some(()));
            assert!(reached.is_some(), "{vendor}: {:?}", usb_node(vendor).map(|node| owned(&node)));
            camera.unplug();
        }
    }

    fn a_kind_that_is_known_needs_neither_unit_nor_camera() {
        let sizes = vec![[640, 480]];
        let params = CameraParams { id: (0x8086, 0x0b07), sizes, fps: 5, ..CameraParams::default() };
        let camera = Camera::plug(params.clone());
        let bare = [("sensor.driver", "\"v4l2\"".to_owned())];
        let mut source = conformance::source(&bare, &[]);
        let frame = first_frame(&mut source);
        assert!((frame.camera.fx - 384.6).abs() < 0.01 && frame.depth_unit_m == 0.001, "{:?}", frame.camera);
        let open = source.health().expect("it is live").now().name.expect("it is open");
        assert!(open.contains("realsense-d435"), "{open}");
        drop(source);
        camera.unplug();

        let _camera = Camera::plug(CameraParams { id: (0x1234, 1), ..params });
        let missing = |more: &[&str]| refusal(&mut conformance::source(&bare, more));
        let unit = missing(&[]);
        assert!(unit.contains("sensor.depth_unit_m") && unit.contains("sensor.profile"), "{unit}");
        let camera = missing(&["sensor.depth_unit_m=0.001"]);
        assert!(camera.contains("camera.fx, camera.fy, camera.cx and camera.cy"), "{camera}");
    }

    fn a_blade_before_it_is_captured_as_from_its_recording_bit_for_bit() {
        let path = vm::recording();
        let mut recorded = recording::open(&path, &Config::default().open_options()).expect("a recording");
        let (seen, _) = frames_until_said(&mut *recorded);
        let (first, stamps) = (seen[0].clone(), seen.iter().map(|frame| frame.timestamp_ns).collect::<Vec<_>>());
        let every_s = (stamps[1] - stamps[0]) as f64 * 1e-9;
        // Held for so many frames.
        let mut held = 14.5;
        let fps = 2;
        let picture = move |k: u64, _: [usize; 2]| seen[(k as usize).min(seen.len() - 1)].depth.clone();
        let camera = Camera::plug(CameraParams {
            sizes: vec![[first.width, first.height]],
            fps,
            picture: Arc::new(picture),
            ..CameraParams::default()
        });
        let model = first.camera;
        let station = Daemon::start(&[
            ("capture.hold_s", format!("{:?}", held / f64::from(fps))),
            ("sensor.driver", "\"v4l2\"".to_owned()),
            ("sensor.depth_unit_m", format!("{:?}", first.depth_unit_m)),
            ("sensor.deadline_s", "30.0".to_owned()),
            ("camera.fx", format!("{:?}", model.fx)),
            ("camera.fy", format!("{:?}", model.fy)),
            ("camera.cx", format!("{:?}", model.cx)),
            ("camera.cy", format!("{:?}", model.cy)),
        ]);
        let captured = station.connect().library_of_at_least(1);
        let status = station.connect().status();
        for key in ["lost_frames", "dropped_frames", "skipped_frames", "sensor_failures", "sensor_silences"] {
            assert_eq!(status[key], 0, "{key}: {status}");
        }
        let captured_ns = captured.blades().next().expect("a blade").captured_unix_ns();
        let frame = camera.newest_frame(captured_ns).expect("it was sent");
        drop(station);

        // On a slow machine a frame comes late: then the hold ends at another one, and so it does in the replay.
        for _ in 0..3 {
            let replay = Daemon::start(&[
                ("source.recording", format!("{path:?}")),
                ("capture.hold_s", format!("{:?}", held * every_s)),
            ]);
            let expected = replay.connect().library_of_at_least(1);
            let of_replay_ns = expected.blades().next().expect("a blade").captured_unix_ns();
            let of_replay = stamps.iter().position(|stamp| *stamp == of_replay_ns).expect("a frame's time") as u64;
            if of_replay == frame {
                assert_eq!(expected.len(), captured.len());
                assert!(knots(&expected) == knots(&captured), "another blade than from the recording: {status}");
                return;
            }
            held += frame as f64 - of_replay as f64;
        }
        panic!("the replay is never captured at frame {frame}");
    }
}
