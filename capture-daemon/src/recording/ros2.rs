//! The two ROS 2 messages of a depth recording: `sensor_msgs/msg/Image` and
//! `sensor_msgs/msg/CameraInfo`.

use super::cdr::{CdrError, Decoder, Encoder};
use super::distortion::{Distortion, DistortionError};
use crate::frame::{CameraModel, DepthFrame, MAX_PIXELS};

/// Schema name of an image.
pub(super) const IMAGE: &str = "sensor_msgs/msg/Image";
/// Schema name of the intrinsics.
pub(super) const CAMERA_INFO: &str = "sensor_msgs/msg/CameraInfo";
/// Schema name of a text.
pub(super) const TEXT: &str = "std_msgs/msg/String";
/// Longest side of an image.
const MAX_SIDE: usize = 1280;
/// Metres of one count of a frame that was read from metres in floating point: fine enough to keep
/// what a sensor knows, and a range of 6.5 m.
pub const FLOAT_DEPTH_UNIT_M: f64 = 0.0001;

/// Why a message is not a usable depth image or camera.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MessageError {
    /// Its bytes are not the message.
    #[error(transparent)]
    Cdr(#[from] CdrError),
    /// An image of something else than depth.
    #[error("its encoding is {0:?}; expected 16UC1, mono16 or 32FC1")]
    Encoding(String),
    /// An image that is empty or too large.
    #[error("it has {width}x{height} pixels; expected at least 1x1 and at most 1280x1024")]
    Size {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// Rows longer apart than there is room, or shorter than their pixels.
    #[error(
        "it has {len} bytes with rows {step} bytes apart; {width}x{height} pixels of {encoding} need more"
    )]
    Data {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Encoding.
        encoding: String,
        /// Bytes from row to row.
        step: usize,
        /// Bytes of the whole image.
        len: usize,
    },
    /// A time before 1970 or a fraction of a second and more.
    #[error("its time stamp is {0} s and {1} ns; expected 1970 or later and less than 10^9 ns")]
    Stamp(i32, u32),
    /// Intrinsics that no camera has.
    #[error("the camera matrix says fx {fx}, fy {fy}, cx {cx}, cy {cy}; expected finite numbers and fx, fy > 0", fx = .0.fx, fy = .0.fy, cx = .0.cx, cy = .0.cy)]
    Camera(CameraModel),
    /// A distortion that cannot be undone.
    #[error(transparent)]
    Distortion(#[from] DistortionError),
    /// The intrinsics are those of the full sensor, the images are not.
    #[error("its camera is binned by {0}x{1}; expected images of the full resolution")]
    Binning(u32, u32),
}

/// `sensor_msgs/msg/Image`, borrowed from the bytes of its message.
pub(super) struct Image<'a> {
    /// Nanoseconds since 1970; 0: not stated.
    pub(super) stamp_ns: u64,
    height: usize,
    width: usize,
    /// What a pixel is, such as `16UC1`.
    pub(super) encoding: &'a str,
    big_endian: bool,
    step: usize,
    data: &'a [u8],
}

fn stamp_ns(decoder: &mut Decoder<'_>) -> Result<u64, MessageError> {
    let (sec, nanosec) = (decoder.i32("header.stamp.sec")?, decoder.u32("header.stamp.nanosec")?);
    match u64::try_from(sec) {
        Ok(seconds) if nanosec < 1_000_000_000 => Ok(seconds * 1_000_000_000 + u64::from(nanosec)),
        _ => Err(MessageError::Stamp(sec, nanosec)),
    }
}

fn put_header(encoder: &mut Encoder, timestamp_ns: u64) {
    // ROS 2 seconds end in 2038.
    encoder.i32(i32::try_from(timestamp_ns / 1_000_000_000).unwrap_or(i32::MAX));
    encoder.u32((timestamp_ns % 1_000_000_000) as u32);
    encoder.string(FRAME_ID);
}

/// Name of the camera frame: x right, y down, z forward.
const FRAME_ID: &str = "camera_depth_optical_frame";

impl<'a> Image<'a> {
    pub(super) fn decode(message: &'a [u8]) -> Result<Self, MessageError> {
        let mut decoder = Decoder::new(message)?;
        let stamp_ns = stamp_ns(&mut decoder)?;
        decoder.bytes("header.frame_id")?;
        Ok(Self {
            stamp_ns,
            height: decoder.u32("height")? as usize,
            width: decoder.u32("width")? as usize,
            encoding: decoder.string("encoding")?,
            big_endian: decoder.u8("is_bigendian")? != 0,
            step: decoder.u32("step")? as usize,
            data: decoder.bytes("data")?,
        })
    }

    /// The encoding of an image, even where the image itself is damaged.
    pub(super) fn encoding_of(message: &'a [u8]) -> Result<&'a str, CdrError> {
        let mut decoder = Decoder::new(message)?;
        decoder.i32("header.stamp.sec")?;
        decoder.u32("header.stamp.nanosec")?;
        decoder.bytes("header.frame_id")?;
        decoder.u32("height")?;
        decoder.u32("width")?;
        decoder.string("encoding")
    }

    /// Whether images of this encoding hold depth.
    pub(super) fn is_depth(encoding: &str) -> bool {
        matches!(encoding, "16UC1" | "mono16" | "32FC1")
    }

    /// The frame that it shows: whole numbers are counts of `depth_unit_m`, floating point numbers are
    /// metres. What is not finite, not above zero or beyond the range of the counts is no reading.
    pub(super) fn to_frame(
        &self,
        depth_unit_m: f64,
        camera: CameraModel,
    ) -> Result<DepthFrame, MessageError> {
        let (width, height) = (self.width, self.height);
        let pixel_len = match self.encoding {
            "16UC1" | "mono16" => 2,
            "32FC1" => 4,
            other => return Err(MessageError::Encoding(other.to_owned())),
        };
        let pixels = width.saturating_mul(height);
        if pixels == 0 || pixels > MAX_PIXELS || width > MAX_SIDE || height > MAX_SIDE {
            return Err(MessageError::Size { width, height });
        }
        // The last row need not be padded.
        let row_len = width * pixel_len;
        let needed = self.step.checked_mul(height - 1).and_then(|len| len.checked_add(row_len));
        if self.step < row_len || needed.is_none_or(|needed| self.data.len() < needed) {
            let (encoding, step, len) = (self.encoding.to_owned(), self.step, self.data.len());
            return Err(MessageError::Data { width, height, encoding, step, len });
        }
        let rows = (0..height).map(|row| &self.data[row * self.step..][..row_len]);
        let depth = if pixel_len == 2 {
            let from_bytes = if self.big_endian { u16::from_be_bytes } else { u16::from_le_bytes };
            rows.flat_map(|row| row.as_chunks::<2>().0).map(|&bytes| from_bytes(bytes)).collect()
        } else {
            let from_bytes = if self.big_endian { f32::from_be_bytes } else { f32::from_le_bytes };
            rows.flat_map(|row| row.as_chunks::<4>().0).map(|&bytes| counts(from_bytes(bytes))).collect()
        };
        let depth_unit_m = if pixel_len == 2 { depth_unit_m } else { FLOAT_DEPTH_UNIT_M };
        Ok(DepthFrame { width, height, depth, depth_unit_m, timestamp_ns: self.stamp_ns, camera })
    }
}

/// Metres as counts of [`FLOAT_DEPTH_UNIT_M`]; 0 for what is no reading.
fn counts(metres: f32) -> u16 {
    let counts = (f64::from(metres) / FLOAT_DEPTH_UNIT_M).round();
    if counts >= 1.0 && counts <= f64::from(u16::MAX) { counts as u16 } else { 0 }
}

/// The message of a frame: encoding 16UC1, little-endian, rows without padding.
pub(super) fn encode_image(frame: &DepthFrame) -> Vec<u8> {
    let mut encoder = Encoder::new();
    put_header(&mut encoder, frame.timestamp_ns);
    encoder.u32(frame.height as u32);
    encoder.u32(frame.width as u32);
    encoder.string("16UC1");
    encoder.u8(0);
    encoder.u32(2 * frame.width as u32);
    let data: Vec<u8> = frame.depth.iter().flat_map(|count| count.to_le_bytes()).collect();
    encoder.bytes(&data);
    encoder.finish()
}

/// `sensor_msgs/msg/CameraInfo`, as far as it matters here.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct CameraInfo {
    /// Columns and rows of the images that it is for; 0: not stated.
    pub(super) size: (usize, usize),
    /// The intrinsics.
    pub(super) camera: CameraModel,
    /// The lens.
    pub(super) distortion: Distortion,
}

impl CameraInfo {
    /// `None`: the camera is not calibrated, which a focal length of 0 says.
    pub(super) fn decode(message: &[u8]) -> Result<Option<Self>, MessageError> {
        let mut decoder = Decoder::new(message)?;
        // Intrinsics have no time that would matter.
        decoder.i32("header.stamp.sec")?;
        decoder.u32("header.stamp.nanosec")?;
        decoder.bytes("header.frame_id")?;
        let height = decoder.u32("height")? as usize;
        let width = decoder.u32("width")? as usize;
        let model = decoder.string("distortion_model")?;
        let coefficients = decoder.f64_sequence("d")?;
        let [fx, _, cx, _, fy, cy, ..] = decoder.f64_array::<9>("k")?;
        decoder.f64_array::<9>("r")?;
        decoder.f64_array::<12>("p")?;
        let binning = (decoder.u32("binning_x")?, decoder.u32("binning_y")?);
        let (left, top) = (decoder.u32("roi.x_offset")?, decoder.u32("roi.y_offset")?);
        let (roi_height, roi_width) =
            (decoder.u32("roi.height")? as usize, decoder.u32("roi.width")? as usize);
        if fx == 0.0 {
            return Ok(None);
        }
        // The intrinsics are those of the full sensor, the images show a part of it.
        let size = if (roi_width, roi_height) == (0, 0) { (width, height) } else { (roi_width, roi_height) };
        let camera = CameraModel { fx, fy, cx: cx - f64::from(left), cy: cy - f64::from(top) };
        if !camera.is_valid() {
            return Err(MessageError::Camera(camera));
        }
        if binning.0 > 1 || binning.1 > 1 {
            return Err(MessageError::Binning(binning.0, binning.1));
        }
        Ok(Some(Self { size, camera, distortion: Distortion::new(model, &coefficients)? }))
    }
}

/// The message with a frame's intrinsics: no distortion, no binning, no region of interest.
pub(super) fn encode_camera_info(frame: &DepthFrame) -> Vec<u8> {
    let CameraModel { fx, fy, cx, cy } = frame.camera;
    let mut encoder = Encoder::new();
    put_header(&mut encoder, frame.timestamp_ns);
    encoder.u32(frame.height as u32);
    encoder.u32(frame.width as u32);
    encoder.string("plumb_bob");
    encoder.u32(5);
    let k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
    let r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let p = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0];
    for number in [0.0; 5].into_iter().chain(k).chain(r).chain(p) {
        encoder.f64(number);
    }
    // binning_x, binning_y; roi: x_offset, y_offset, height, width, do_rectify.
    for _ in 0..6 {
        encoder.u32(0);
    }
    encoder.u8(0);
    encoder.finish()
}

/// The message `std_msgs/msg/String` with a text.
pub(super) fn encode_text(text: &str) -> Vec<u8> {
    let mut encoder = Encoder::new();
    encoder.string(text);
    encoder.finish()
}

/// Its text.
pub(super) fn decode_text(message: &[u8]) -> Result<&str, CdrError> {
    Decoder::new(message)?.string("data")
}

/// Definition of a text.
pub(super) const TEXT_DEFINITION: &str = "string data\n";

/// Definition of the image and of all that it is made of.
pub(super) const IMAGE_DEFINITION: &str = "\
std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

/// Definition of the intrinsics and of all that they are made of.
pub(super) const CAMERA_INFO_DEFINITION: &str = "\
std_msgs/Header header
uint32 height
uint32 width
string distortion_model
float64[] d
float64[9] k
float64[9] r
float64[12] p
uint32 binning_x
uint32 binning_y
sensor_msgs/RegionOfInterest roi
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: sensor_msgs/RegionOfInterest
uint32 x_offset
uint32 y_offset
uint32 height
uint32 width
bool do_rectify
";
