//! The many forms that a ROS 2 recording may have: which are read, and how the others are refused.

mod reading;

use std::collections::BTreeMap;
use std::io::Cursor;

use capture_daemon::frame::{CameraModel, DepthFrame};
use capture_daemon::recording::{self, Distortion, GivenCamera, OpenOptions};
use mcap::records::MessageHeader;

/// A message in the making, in either byte order.
struct Cdr {
    bytes: Vec<u8>,
    big_endian: bool,
}

impl Cdr {
    fn new(big_endian: bool) -> Self {
        Self { bytes: vec![0, u8::from(!big_endian), 0, 0], big_endian }
    }

    fn number<const N: usize>(mut self, little: [u8; N]) -> Self {
        self.bytes.resize(4 + (self.bytes.len() - 4).next_multiple_of(N), 0);
        if self.big_endian {
            self.bytes.extend(little.iter().rev());
        } else {
            self.bytes.extend(little);
        }
        self
    }

    fn u32(self, number: u32) -> Self {
        self.number(number.to_le_bytes())
    }

    fn f64(self, number: f64) -> Self {
        self.number(number.to_le_bytes())
    }

    fn raw(mut self, bytes: &[u8]) -> Self {
        self = self.u32(bytes.len() as u32);
        self.bytes.extend(bytes);
        self
    }

    fn string(self, text: &str) -> Self {
        self.raw(format!("{text}\0").as_bytes())
    }

    fn header(self, stamp_ns: u64) -> Self {
        let seconds = stamp_ns / 1_000_000_000;
        self.u32(seconds as u32).u32((stamp_ns % 1_000_000_000) as u32).string("camera")
    }
}

/// An image, and how it is written.
#[derive(Clone)]
struct Picture {
    stamp_ns: u64,
    width: u32,
    height: u32,
    encoding: &'static str,
    big_endian: bool,
    step: u32,
    data: Vec<u8>,
}

impl Picture {
    /// 3×2 pixels of millimetres: 501 to 506.
    fn plain() -> Self {
        let data = (501..507_u16).flat_map(u16::to_le_bytes).collect();
        Self { stamp_ns: STAMP_NS, width: 3, height: 2, encoding: "16UC1", big_endian: false, step: 6, data }
    }

    fn message(&self, cdr_big_endian: bool) -> Vec<u8> {
        let cdr = Cdr::new(cdr_big_endian).header(self.stamp_ns).u32(self.height).u32(self.width);
        let cdr = cdr.string(self.encoding).number([u8::from(self.big_endian)]).u32(self.step);
        cdr.raw(&self.data).bytes
    }
}

fn camera_info(size: (u32, u32), distortion: &[f64], binning: u32, big_endian: bool) -> Vec<u8> {
    let mut cdr = Cdr::new(big_endian).header(STAMP_NS).u32(size.1).u32(size.0).string("plumb_bob");
    cdr = cdr.u32(distortion.len() as u32);
    let CameraModel { fx, fy, cx, cy } = CAMERA;
    let k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
    for number in distortion.iter().copied().chain(k).chain([0.0; 9 + 12]) {
        cdr = cdr.f64(number);
    }
    cdr.u32(binning).u32(binning).u32(0).u32(0).u32(0).u32(0).number([0]).bytes
}

const CAMERA: CameraModel = CameraModel { fx: 5.0, fy: 6.0, cx: 1.0, cy: 0.5 };
const STAMP_NS: u64 = 1_700_000_000_500_000_000;
const LOG_NS: u64 = 1_800_000_000_000_000_000;

/// A recording of messages: topic, schema name, bytes.
fn recording(messages: &[(&str, &str, Vec<u8>)], options: mcap::WriteOptions) -> Vec<u8> {
    let mut writer = options.create(Cursor::new(Vec::new())).expect("in memory");
    for (i, (topic, schema, data)) in messages.iter().enumerate() {
        let schema = writer.add_schema(schema, "ros2msg", b"").expect("in memory");
        let channel_id = writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).expect("in memory");
        let log_time = LOG_NS + i as u64;
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, data).expect("in memory");
    }
    writer.finish().expect("in memory");
    writer.into_inner().into_inner()
}

const IMAGE: &str = "sensor_msgs/msg/Image";
const INFO: &str = "sensor_msgs/msg/CameraInfo";

fn info() -> (&'static str, &'static str, Vec<u8>) {
    ("/depth/camera_info", INFO, camera_info((3, 2), &[0.0; 5], 0, false))
}

/// What happens to a recording: its frames and the reasons for skipping others, or why it is refused.
fn read_with(bytes: &[u8], options: &OpenOptions) -> Result<(Vec<DepthFrame>, Vec<String>), String> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("it.mcap");
    std::fs::write(&path, bytes).expect("written");
    reading::to_its_end(&path, options)
}

fn read(messages: &[(&str, &str, Vec<u8>)]) -> Result<(Vec<DepthFrame>, Vec<String>), String> {
    read_with(&recording(messages, mcap::WriteOptions::new()), &OpenOptions::default())
}

/// The one frame of a recording with one picture.
fn frame_of(picture: &Picture) -> DepthFrame {
    let (mut frames, skipped) =
        read(&[("/depth/image", IMAGE, picture.message(false)), info()]).expect("a recording");
    assert_eq!((frames.len(), skipped), (1, Vec::new()));
    frames.remove(0)
}

fn refusal(messages: &[(&str, &str, Vec<u8>)]) -> String {
    read(messages).expect_err("refused")
}

#[test]
fn a_plain_image_is_read() {
    let frame = frame_of(&Picture::plain());
    assert_eq!((frame.width, frame.height), (3, 2));
    assert_eq!(frame.depth, [501, 502, 503, 504, 505, 506]);
    assert_eq!((frame.depth_unit_m, frame.timestamp_ns, frame.camera), (0.001, STAMP_NS, CAMERA));
}

#[test]
fn padded_rows_and_both_byte_orders_are_read() {
    let expected = frame_of(&Picture::plain());
    let padded = |count: u16| [count, count + 1, count + 2, 9].into_iter().flat_map(u16::to_le_bytes);
    let data: Vec<u8> = padded(501).chain(padded(504)).collect();
    let padded = Picture { step: 8, data: data.clone(), ..Picture::plain() };
    assert_eq!(frame_of(&padded), expected);
    // The last row may end with its last pixel.
    assert_eq!(frame_of(&Picture { data: data[..14].to_vec(), ..padded }), expected);
    let data = (501..507_u16).flat_map(u16::to_be_bytes).collect();
    assert_eq!(
        frame_of(&Picture { big_endian: true, data, encoding: "mono16", ..Picture::plain() }),
        expected
    );
    let big_info = ("/depth/camera_info", INFO, camera_info((3, 2), &[], 1, true));
    let frames = read(&[("/depth/image", IMAGE, Picture::plain().message(true)), big_info]).expect("read").0;
    assert_eq!(frames, [expected]);
}

#[test]
fn metres_in_floating_point_become_counts() {
    let metres = [0.5_f32, 0.612_34, f32::NAN, -1.0, f32::INFINITY, 7.0];
    let data = metres.iter().flat_map(|metres| metres.to_le_bytes()).collect();
    let frame = frame_of(&Picture { encoding: "32FC1", step: 12, data, ..Picture::plain() });
    assert_eq!(frame.depth, [5000, 6123, 0, 0, 0, 0]);
    assert_eq!(frame.depth_unit_m, recording::FLOAT_DEPTH_UNIT_M);
    let data = metres.iter().flat_map(|metres| metres.to_be_bytes()).collect();
    let picture = Picture { encoding: "32FC1", step: 12, big_endian: true, data, ..Picture::plain() };
    assert_eq!(frame_of(&picture), frame);
}

#[test]
fn without_a_stamp_the_log_time_is_taken() {
    let frame = frame_of(&Picture { stamp_ns: 0, ..Picture::plain() });
    assert_eq!(frame.timestamp_ns, LOG_NS);
}

#[test]
fn bad_images_are_skipped_and_named() {
    let good = Picture::plain();
    let bad = [
        (Picture { width: 1281, height: 1, ..good.clone() }, "1281x1 pixels"),
        (Picture { width: u32::MAX, height: u32::MAX, ..good.clone() }, "at most 1280x1024"),
        (Picture { height: 0, ..good.clone() }, "3x0 pixels"),
        (Picture { step: 5, ..good.clone() }, "rows 5 bytes apart"),
        (Picture { step: u32::MAX, ..good.clone() }, "need more"),
        (Picture { data: vec![0; 11], ..good.clone() }, "it has 11 bytes"),
        (Picture { encoding: "rgb8", ..good.clone() }, "\"rgb8\"; expected 16UC1"),
        (Picture { width: 2, height: 3, step: 4, ..good.clone() }, "its intrinsics are for 3x2"),
    ];
    let mut messages = vec![info(), ("/depth/image", IMAGE, good.message(false))];
    messages.extend(bad.iter().map(|(picture, _)| ("/depth/image", IMAGE, picture.message(false))));
    let cut = good.message(false);
    messages.push(("/depth/image", IMAGE, cut[..cut.len() - 1].to_vec()));
    messages.push(("/depth/image", IMAGE, good.message(false)));
    let (frames, skipped) = read(&messages).expect("a recording");
    assert_eq!(frames.len(), 2);
    let expected = bad.iter().map(|(_, expected)| *expected).chain(["ends within its field `data`"]);
    for (why, expected) in skipped.iter().zip(expected) {
        assert!(why.contains(expected), "{why}");
    }
    assert_eq!(skipped.len(), bad.len() + 1);
}

#[test]
fn the_depth_topic_is_found_among_others() {
    let depth = Picture::plain().message(false);
    let mut other = Picture::plain();
    other.data[0] = 99;
    let other = other.message(false);
    let color = Picture { encoding: "rgb8", ..Picture::plain() }.message(false);
    let first = |messages: &[(&str, &str, Vec<u8>)]| read(messages).expect("read").0[0].depth[0];
    // By what it holds.
    assert_eq!(first(&[("/color", IMAGE, color.clone()), info(), ("/a", IMAGE, depth.clone())]), 501);
    // By its name.
    let named = [("/infrared", IMAGE, other.clone()), info(), ("/depth/image", IMAGE, depth.clone())];
    assert_eq!(first(&named), 501);
    // By the option.
    let options = OpenOptions { topic: Some("/infrared".into()), ..OpenOptions::default() };
    let bytes = recording(&named, mcap::WriteOptions::new());
    assert_eq!(read_with(&bytes, &options).expect("read").0[0].depth[0], (501 & 0xff00) + 99);
    // Not at all.
    let why = refusal(&[info(), ("/depth/a", IMAGE, depth.clone()), ("/depth/b", IMAGE, depth.clone())]);
    assert!(why.contains("/depth/a (16UC1), /depth/b (16UC1); name one with `source.topic`"), "{why}");
    let why = refusal(&[info(), ("/depth/image", IMAGE, color)]);
    assert!(why.contains("has no depth images: it has /depth/camera_info"), "{why}");
    let options = OpenOptions { topic: Some("/depth".into()), ..OpenOptions::default() };
    let why = read_with(&bytes, &options).expect_err("refused");
    assert!(why.contains("no images on the topic /depth that `source.topic` names"), "{why}");
}

#[test]
fn intrinsics_come_from_beside_or_from_the_options() {
    let image = || ("/depth/image", IMAGE, Picture::plain().message(false));
    let why = refusal(&[image()]);
    assert!(why.contains("camera.fx, camera.fy, camera.cx and camera.cy"), "{why}");
    let given = GivenCamera { camera: CAMERA, distortion: Distortion::default() };
    let options = OpenOptions { camera: Some(given), ..OpenOptions::default() };
    let bytes = recording(&[image()], mcap::WriteOptions::new());
    assert_eq!(read_with(&bytes, &options).expect("read").0[0].camera, CAMERA);
    // The only ones there are; of two, those beside; of two elsewhere, none.
    let info_on = |topic| (topic, INFO, camera_info((3, 2), &[0.0], 0, false));
    assert_eq!(read(&[info_on("/camera_info"), image()]).expect("read").0[0].camera, CAMERA);
    let color = ("/color/camera_info", INFO, camera_info((9, 9), &[0.5], 0, false));
    assert_eq!(read(&[color.clone(), image(), info()]).expect("read").0[0].camera, CAMERA);
    assert!(refusal(&[color, image(), info_on("/camera_info")]).contains("no camera intrinsics"));
    let refused = |info| refusal(&[("/depth/camera_info", INFO, info), image()]);
    let why = refused(camera_info((3, 2), &[0.1, 0.0], 0, false));
    assert!(why.contains("the distortion model plumb_bob has 2 coefficients"), "{why}");
    assert!(refused(camera_info((3, 2), &[], 2, false)).contains("binned by 2x2"));
    let mut info = camera_info((3, 2), &[], 0, false);
    info.truncate(60);
    assert!(refused(info).contains("ends within its field"));
}

#[test]
fn a_camera_that_is_not_calibrated_has_no_intrinsics() {
    let image = || ("/depth/image", IMAGE, Picture::plain().message(false));
    let mut info = camera_info((3, 2), &[], 0, false);
    // Representation, stamp, frame_id, size, model, number of coefficients, padding: K's first entry.
    let fx = info.windows(8).position(|window| window == CAMERA.fx.to_le_bytes()).expect("K is there");
    info[fx..fx + 8].fill(0);
    let messages = [("/depth/camera_info", INFO, info), image()];
    assert!(refusal(&messages).contains("camera.fx, camera.fy"));
    let given = GivenCamera { camera: CAMERA, distortion: Distortion::default() };
    let options = OpenOptions { camera: Some(given), ..OpenOptions::default() };
    let bytes = recording(&messages, mcap::WriteOptions::new());
    assert_eq!(read_with(&bytes, &options).expect("read").0[0].camera, CAMERA);
}

#[test]
fn a_part_of_the_sensor_has_its_principal_point_there() {
    let mut info = camera_info((640, 480), &[], 0, false);
    // x_offset, y_offset, height, width, and one byte.
    let roi = info.len() - 17;
    for (field, number) in [7_u32, 9, 2, 3].into_iter().enumerate() {
        info[roi + 4 * field..][..4].copy_from_slice(&number.to_le_bytes());
    }
    let image = ("/depth/image", IMAGE, Picture::plain().message(false));
    let frames = read(&[("/depth/camera_info", INFO, info), image]).expect("read").0;
    assert_eq!(frames[0].camera, CameraModel { cx: CAMERA.cx - 7.0, cy: CAMERA.cy - 9.0, ..CAMERA });
}

#[test]
fn a_given_lens_is_undone() {
    let lens = Distortion::new("plumb_bob", &[0.4, 0.0, 0.0, 0.0]).expect("known");
    let bytes =
        recording(&[("/depth/image", IMAGE, Picture::plain().message(false))], mcap::WriteOptions::new());
    let read = |camera: CameraModel| {
        let given = GivenCamera { camera, distortion: lens.clone() };
        let options = OpenOptions { camera: Some(given), ..OpenOptions::default() };
        read_with(&bytes, &options).expect("read").0.remove(0).depth
    };
    assert_eq!(read(CAMERA), [501, 502, 503, 504, 505, 506], "less than half a pixel");
    // A pincushion: what is far from the middle falls outside.
    let wide = CameraModel { fx: 0.6, fy: 0.6, cx: 1.0, cy: 0.0 };
    assert_eq!(read(wide), [0, 502, 0, 0, 0, 0]);
}

#[test]
fn parameter_lists_are_refused_by_name() {
    let mut image = Picture::plain().message(false);
    image[1] = 3;
    let why = refusal(&[info(), ("/depth/image", IMAGE, image)]);
    assert!(why.contains("0x0003 (PL_CDR, a parameter list); expected plain CDR"), "{why}");
}

#[test]
fn what_is_not_chunked_or_has_no_summary_is_read() {
    let messages = [("/depth/image", IMAGE, Picture::plain().message(false)), info()];
    let expected = read(&messages).expect("a recording");
    let plain = || mcap::WriteOptions::new().compression(None);
    let forms =
        [plain(), plain().use_chunks(false), plain().disable_seeking(true).emit_summary_records(false)];
    for form in forms {
        assert_eq!(read_with(&recording(&messages, form), &OpenOptions::default()).as_ref(), Ok(&expected));
    }
}

#[test]
fn a_hostile_length_neither_allocates_nor_panics() {
    let messages = [info(), ("/depth/image", IMAGE, Picture::plain().message(false))];
    for compression in [None, Some(mcap::Compression::Zstd)] {
        let bytes = recording(&messages, mcap::WriteOptions::new().compression(compression));
        for at in (8..bytes.len() - 8).step_by(7) {
            let mut bytes = bytes.clone();
            bytes[at..at + 8].fill(0xff);
            let _ = read_with(&bytes, &OpenOptions::default());
            bytes[at..at + 8].copy_from_slice(&(1_u64 << 40).to_le_bytes());
            let _ = read_with(&bytes, &OpenOptions::default());
        }
    }
}

#[test]
fn another_compression_is_named() {
    let messages = [info(), ("/depth/image", IMAGE, Picture::plain().message(false))];
    let mut bytes = recording(&messages, mcap::WriteOptions::new());
    while let Some(at) = bytes.windows(4).position(|window| window == b"zstd") {
        bytes[at..at + 4].copy_from_slice(b"abcd");
    }
    let why = read_with(&bytes, &OpenOptions::default()).expect_err("refused");
    assert!(why.contains("abcd"), "{why}");
}
