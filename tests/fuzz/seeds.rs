//! Whole recordings to start from, small enough to be read in less than a millisecond.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::LazyLock;

use capture_daemon::recording::{McapWriter, RecordingParams};
use capture_daemon::synth::{Clip, ClipParams, Family, Scene};
use mcap::records::{MessageHeader, Metadata};
use tests::root;

/// A message with all that says what it is.
pub(crate) struct Message {
    pub(crate) topic: &'static str,
    pub(crate) schema: &'static str,
    pub(crate) log_time: u64,
    pub(crate) data: Vec<u8>,
}

pub(crate) const IMAGE: &str = "sensor_msgs/msg/Image";
pub(crate) const CAMERA_INFO: &str = "sensor_msgs/msg/CameraInfo";

/// Frames of a synthetic clip, as our own writer writes them.
fn synthetic(width: usize, height: usize, frames: usize) -> Vec<u8> {
    let params = ClipParams { width, height, frames, fps: 4.0, ..ClipParams::default() };
    let clip = Clip::new(Scene::new(Family::Single, 3), params).expect("the parameters are in range");
    let mut writer = McapWriter::new(Cursor::new(Vec::new()), RecordingParams::default()).expect("in memory");
    clip.frames().for_each(|frame| writer.write(&frame).expect("in memory"));
    writer.finish().expect("in memory").into_inner()
}

/// The messages of a recording of this project.
fn messages_of(bytes: &[u8]) -> Vec<Message> {
    let messages = mcap::MessageStream::new(bytes).expect("an MCAP file");
    let messages = messages.map(|message| {
        let message = message.expect("a whole message");
        let is_image = message.channel.schema.as_ref().is_some_and(|schema| schema.name == IMAGE);
        Message {
            topic: if is_image { "/camera/depth/image" } else { "/camera/depth/camera_info" },
            schema: if is_image { IMAGE } else { CAMERA_INFO },
            log_time: message.log_time,
            data: message.data.into_owned(),
        }
    });
    messages.collect()
}

/// How to write a recording.
pub(crate) fn forms() -> Vec<fn() -> mcap::WriteOptions> {
    vec![
        || mcap::WriteOptions::new().compression(None),
        || mcap::WriteOptions::new().compression(None).chunk_size(Some(600)),
        || mcap::WriteOptions::new().compression(Some(mcap::Compression::Zstd)).chunk_size(Some(600)),
        || mcap::WriteOptions::new().compression(Some(mcap::Compression::Lz4)).chunk_size(Some(600)),
        || mcap::WriteOptions::new().use_chunks(false),
        || mcap::WriteOptions::new().use_chunks(false).emit_summary_records(false),
        || mcap::WriteOptions::new().compression(None).emit_summary_records(false),
    ]
}

/// Messages as a recording.
pub(crate) fn recording(messages: &[Message], options: mcap::WriteOptions) -> Vec<u8> {
    let mut writer = options.profile("ros2").create(Cursor::new(Vec::new())).expect("in memory");
    let metadata = BTreeMap::from([("depth_unit_m".to_owned(), "0.001".to_owned())]);
    writer.write_metadata(&Metadata { name: "sward".to_owned(), metadata }).expect("in memory");
    for (sequence, message) in messages.iter().enumerate() {
        let schema = writer.add_schema(message.schema, "ros2msg", b"").expect("in memory");
        let channel = writer.add_channel(schema, message.topic, "cdr", &BTreeMap::new()).expect("in memory");
        let log_time = message.log_time;
        let header = MessageHeader {
            channel_id: channel,
            sequence: sequence as u32,
            log_time,
            publish_time: log_time,
        };
        writer.write_to_known_channel(&header, &message.data).expect("in memory");
    }
    writer.finish().expect("in memory");
    writer.into_inner().into_inner()
}

/// Messages to damage: six of them.
pub(crate) fn messages() -> Vec<Message> {
    static BYTES: LazyLock<Vec<u8>> = LazyLock::new(|| synthetic(16, 16, 3));
    messages_of(&BYTES)
}

/// Recordings to damage: our own, one as it is shipped, and their messages in every form.
pub(crate) static RECORDINGS: LazyLock<Vec<Vec<u8>>> = LazyLock::new(|| {
    let shipped = std::fs::read(root().join("recordings/single-5.mcap")).expect("a shipped recording");
    let mut recordings = vec![synthetic(24, 16, 8), shipped];
    recordings.extend(forms().into_iter().map(|form| recording(&messages(), form())));
    recordings
});
