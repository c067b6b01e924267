//! Writes frames as ROS 2 messages into an MCAP file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::Path;

use mcap::records::{MessageHeader, Metadata};

use super::{DEPTH_UNIT_KEY, METADATA_NAME};
use crate::frame::DepthFrame;
use crate::recording::{WriteError, ros2};

/// Topic of the depth images.
pub const IMAGE_TOPIC: &str = "/camera/depth/image_rect_raw";
/// Topic of their intrinsics.
pub const CAMERA_INFO_TOPIC: &str = "/camera/depth/camera_info";
/// Longest recording time within one chunk: what a power failure can take.
const CHUNK_NS: u64 = 1_000_000_000;
/// Bytes, before compression, after which a chunk ends anyway.
const CHUNK_BYTES: u64 = 4 << 20;

/// What a recording says about itself, in its metadata, and how hard it is compressed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RecordingParams {
    /// Model of the sensor.
    pub sensor: String,
    /// Its serial number; empty: unknown.
    pub serial: String,
    /// Level of the zstd compression: 1 to 22, 0 for its default, which keeps pace with a sensor.
    pub compression_level: u32,
}

/// A recording that is being written.
pub struct McapWriter<W: Write + Seek> {
    writer: mcap::Writer<W>,
    image_channel: u16,
    info_channel: u16,
    params: RecordingParams,
    depth_unit_m: Option<f64>,
    sequence: u32,
    chunk_start_ns: u64,
}

impl McapWriter<BufWriter<File>> {
    /// Starts a recording at `path`, in place of what is there.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn create(path: &Path, params: RecordingParams) -> Result<Self, WriteError> {
        let file = File::create(path).map_err(|source| WriteError::Io { path: path.to_owned(), source })?;
        Self::new(BufWriter::new(file), params)
    }
}

impl<W: Write + Seek> McapWriter<W> {
    /// Starts a recording into `output`.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn new(output: W, params: RecordingParams) -> Result<Self, WriteError> {
        let mut writer = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("sward ", env!("CARGO_PKG_VERSION")))
            .compression(Some(mcap::Compression::Zstd))
            .compression_level(params.compression_level)
            .chunk_size(Some(CHUNK_BYTES))
            .create(output)?;
        let image = writer.add_schema(ros2::IMAGE, "ros2msg", ros2::IMAGE_DEFINITION.as_bytes())?;
        let camera =
            writer.add_schema(ros2::CAMERA_INFO, "ros2msg", ros2::CAMERA_INFO_DEFINITION.as_bytes())?;
        // ROS looks for the key, whatever its value.
        let qos = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
        let image_channel = writer.add_channel(image, IMAGE_TOPIC, "cdr", &qos)?;
        let info_channel = writer.add_channel(camera, CAMERA_INFO_TOPIC, "cdr", &qos)?;
        let (sequence, chunk_start_ns) = (0, 0);
        Ok(Self { writer, image_channel, info_channel, params, depth_unit_m: None, sequence, chunk_start_ns })
    }

    /// Adds a frame and its camera.
    ///
    /// # Errors
    /// When it cannot be written, or its depth unit is not that of the frames before.
    pub fn write(&mut self, frame: &DepthFrame) -> Result<(), WriteError> {
        match self.depth_unit_m {
            None => self.begin(frame)?,
            Some(unit) if unit == frame.depth_unit_m => {}
            Some(expected) => return Err(WriteError::DepthUnit { expected, found: frame.depth_unit_m }),
        }
        let time = frame.timestamp_ns;
        if time.abs_diff(self.chunk_start_ns) >= CHUNK_NS {
            self.writer.flush()?;
            self.chunk_start_ns = time;
        }
        let header = |channel_id| MessageHeader {
            channel_id,
            sequence: self.sequence,
            log_time: time,
            publish_time: time,
        };
        let (info, image) = (header(self.info_channel), header(self.image_channel));
        self.writer.write_to_known_channel(&info, &ros2::encode_camera_info(frame))?;
        self.writer.write_to_known_channel(&image, &ros2::encode_image(frame))?;
        self.sequence += 1;
        Ok(())
    }

    /// Writes the metadata, which only the first frame completes.
    fn begin(&mut self, frame: &DepthFrame) -> Result<(), WriteError> {
        let metadata = BTreeMap::from([
            ("sensor".to_owned(), self.params.sensor.clone()),
            ("serial".to_owned(), self.params.serial.clone()),
            (DEPTH_UNIT_KEY.to_owned(), frame.depth_unit_m.to_string()),
        ]);
        self.writer.write_metadata(&Metadata { name: METADATA_NAME.to_owned(), metadata })?;
        self.depth_unit_m = Some(frame.depth_unit_m);
        self.chunk_start_ns = frame.timestamp_ns;
        Ok(())
    }

    /// Ends the recording and gives its output back. A recording that is dropped instead is ended
    /// too, but nobody learns whether that went well.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(mut self) -> Result<W, WriteError> {
        self.writer.finish()?;
        let mut output = self.writer.into_inner();
        output.flush().map_err(mcap::McapError::Io)?;
        Ok(output)
    }
}
