//! Writes frames as ROS 2 messages into an MCAP file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::Path;

use mcap::records::{MessageHeader, Metadata};

use super::{AS_SEEN, CONFIG_KEY, DEPTH_UNIT_KEY, METADATA_NAME, ORDER_KEY};
use crate::frame::DepthFrame;
use crate::note::Note;
use crate::recording::{WriteError, ros2};

/// Topic of the depth images.
pub const IMAGE_TOPIC: &str = "/camera/depth/image_rect_raw";
/// Topic of their intrinsics.
pub const CAMERA_INFO_TOPIC: &str = "/camera/depth/camera_info";
/// Topic of what the session was told, one line of JSON each: [`Note`].
pub const NOTES_TOPIC: &str = "/sward/notes";
/// Longest recording time within one chunk: what a power failure can take.
const CHUNK_NS: u64 = 1_000_000_000;
/// Bytes, before compression, after which a chunk ends anyway.
const CHUNK_BYTES: u64 = 4 << 20;

/// How every recording is written, of a profile and at a level of zstd's compression, 0 for its default.
pub(in crate::recording) fn write_options(profile: &str, compression_level: u32) -> mcap::WriteOptions {
    mcap::WriteOptions::new()
        .profile(profile)
        .library(concat!("sward ", env!("CARGO_PKG_VERSION")))
        .compression(Some(mcap::Compression::Zstd))
        .compression_level(compression_level)
        .chunk_size(Some(CHUNK_BYTES))
}

/// The recording time that the messages of the chunk being written span, nanoseconds.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::recording) struct ChunkSpan(Option<(u64, u64)>);

impl ChunkSpan {
    /// Takes the next message's time. Whether the chunk must end before it, for no chunk is to span
    /// [`CHUNK_NS`]; the message is then the first of the next one.
    pub(in crate::recording) fn ends_before(&mut self, time: u64) -> bool {
        let (first, last) = self.0.unwrap_or((time, time));
        let (first, last) = (first.min(time), last.max(time));
        let ends = last - first >= CHUNK_NS;
        self.0 = Some(if ends { (time, time) } else { (first, last) });
        ends
    }
}

/// What a recording says about itself, in its metadata, and how hard it is compressed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RecordingParams {
    /// Model of the sensor.
    pub sensor: String,
    /// Its serial number; empty: unknown.
    pub serial: String,
    /// The configuration that it was made under, TOML; empty: unknown.
    pub config: String,
    /// Level of the zstd compression: 1 to 22, 0 for its default, which keeps pace with a sensor.
    pub compression_level: u32,
    /// It is of a live run: its frames stand in the order in which the station saw them, and its file only grows, so that
    /// whatever was written before a power failure is whole.
    pub is_live: bool,
}

/// A recording that is being written.
pub struct McapWriter<W: Write + Seek> {
    writer: mcap::Writer<W>,
    image_channel: u16,
    info_channel: u16,
    notes_channel: Option<u16>,
    params: RecordingParams,
    depth_unit_m: Option<f64>,
    sequence: u32,
    span: ChunkSpan,
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
        let mut options = write_options("ros2", params.compression_level);
        if params.is_live {
            // A chunk is written once it is whole, and compressed by the thread that writes it.
            options = options.disable_seeking(true).compression_threads(0);
        }
        let mut writer = options.create(output)?;
        let image = writer.add_schema(ros2::IMAGE, "ros2msg", ros2::IMAGE_DEFINITION.as_bytes())?;
        let camera =
            writer.add_schema(ros2::CAMERA_INFO, "ros2msg", ros2::CAMERA_INFO_DEFINITION.as_bytes())?;
        // ROS looks for the key, whatever its value.
        let qos = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
        let image_channel = writer.add_channel(image, IMAGE_TOPIC, "cdr", &qos)?;
        let info_channel = writer.add_channel(camera, CAMERA_INFO_TOPIC, "cdr", &qos)?;
        let mut notes_channel = None;
        if params.is_live {
            let text = writer.add_schema(ros2::TEXT, "ros2msg", ros2::TEXT_DEFINITION.as_bytes())?;
            notes_channel = Some(writer.add_channel(text, NOTES_TOPIC, "cdr", &qos)?);
        }
        let (span, sequence, depth_unit_m) = (ChunkSpan::default(), 0, None);
        Ok(Self { writer, image_channel, info_channel, notes_channel, params, depth_unit_m, sequence, span })
    }

    /// Adds a frame and its camera.
    ///
    /// # Errors
    /// When it cannot be written, or its depth unit is not that of the frames before.
    pub fn write(&mut self, frame: &DepthFrame) -> Result<(), WriteError> {
        self.write_noted(&[], frame)
    }

    /// Adds what the session was told before a frame, of a live run's recording, and the frame.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn write_noted(&mut self, notes: &[Note], frame: &DepthFrame) -> Result<(), WriteError> {
        match self.depth_unit_m {
            None => self.begin(frame)?,
            Some(unit) if unit == frame.depth_unit_m => {}
            Some(expected) => return Err(WriteError::DepthUnit { expected, found: frame.depth_unit_m }),
        }
        let time = frame.timestamp_ns;
        if self.span.ends_before(time) {
            self.writer.flush()?;
        }
        let header = |channel_id| MessageHeader {
            channel_id,
            sequence: self.sequence,
            log_time: time,
            publish_time: time,
        };
        let (info, image) = (header(self.info_channel), header(self.image_channel));
        for (note, channel) in notes.iter().filter_map(|note| Some((note, self.notes_channel?))) {
            self.writer.write_to_known_channel(&header(channel), &ros2::encode_text(&note.to_json()))?;
        }
        self.writer.write_to_known_channel(&info, &ros2::encode_camera_info(frame))?;
        self.writer.write_to_known_channel(&image, &ros2::encode_image(frame))?;
        self.sequence = self.sequence.wrapping_add(1);
        Ok(())
    }

    /// Ends the chunk, if one was begun, and hands all that was written to the output.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn end_chunk(&mut self) -> Result<(), WriteError> {
        self.span = ChunkSpan::default();
        Ok(self.writer.flush()?)
    }

    /// Gives the output back as it is, without the end of a recording.
    pub fn abandon(self) -> W {
        self.writer.into_inner()
    }

    /// Writes the metadata, which only the first frame completes.
    fn begin(&mut self, frame: &DepthFrame) -> Result<(), WriteError> {
        let mut metadata = BTreeMap::from([
            ("sensor".to_owned(), self.params.sensor.clone()),
            ("serial".to_owned(), self.params.serial.clone()),
            (CONFIG_KEY.to_owned(), self.params.config.clone()),
            (DEPTH_UNIT_KEY.to_owned(), frame.depth_unit_m.to_string()),
        ]);
        if self.params.is_live {
            metadata.insert(ORDER_KEY.to_owned(), AS_SEEN.to_owned());
        }
        self.writer.write_metadata(&Metadata { name: METADATA_NAME.to_owned(), metadata })?;
        self.depth_unit_m = Some(frame.depth_unit_m);
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
