//! Replays the depth images of an MCAP file.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use super::records::{Record, RecordError, RecordReader};
use super::survey::{Selection, select};
use super::{DEPTH_UNIT_KEY, METADATA_NAME};
use crate::frame::DepthFrame;
use crate::recording::ros2::Image;
use crate::recording::{OpenError, OpenOptions, ensure_one_frame};
use crate::source::{FrameSource, SourceError};

/// Metres of one count where the recording does not say: millimetres.
const DEFAULT_DEPTH_UNIT_M: f64 = 0.001;

/// Opens a file that begins with MCAP's magic.
pub(in crate::recording) fn open(
    path: &Path,
    file_len: u64,
    options: &OpenOptions,
) -> Result<Box<dyn FrameSource + Send>, OpenError> {
    let io = |source| OpenError::Io { path: path.to_owned(), source };
    let reader = || {
        let file = BufReader::new(File::open(path)?);
        RecordReader::new(file, file_len)
    };
    let selection = select(path, &mut reader().map_err(io)?, options)?;
    let source = |quiet| -> Result<_, std::io::Error> {
        Ok(McapSource::new(path.display().to_string(), reader()?, &selection, quiet))
    };
    ensure_one_frame(path, &mut source(true).map_err(io)?)?;
    Ok(Box::new(source(false).map_err(io)?))
}

/// An MCAP file as a source of frames.
struct McapSource<R> {
    name: String,
    reader: RecordReader<R>,
    selection: Selection,
    depth_unit_m: f64,
    /// Channels of the selected topic.
    channels: BTreeSet<u16>,
    /// Does not warn of a file cut short: somebody reads it again who does.
    quiet: bool,
    /// Nothing more can be read.
    ended: bool,
}

impl<R: Read + Seek> McapSource<R> {
    fn new(name: String, reader: RecordReader<R>, selection: &Selection, quiet: bool) -> Self {
        let selection = Selection { image_topic: selection.image_topic.clone(), info: selection.info };
        let (channels, depth_unit_m) = (BTreeSet::new(), DEFAULT_DEPTH_UNIT_M);
        Self { name, reader, selection, depth_unit_m, channels, quiet, ended: false }
    }

    /// Notes a record; the frame, if it is one.
    fn take(
        record: Record<'_>,
        selection: &Selection,
        channels: &mut BTreeSet<u16>,
        depth_unit_m: &mut f64,
    ) -> Option<Result<DepthFrame, String>> {
        match record {
            Record::Channel { id, topic, .. } => {
                if topic == selection.image_topic {
                    channels.insert(id);
                } else {
                    channels.remove(&id);
                }
                None
            }
            Record::Metadata { name: METADATA_NAME, entries } => {
                let unit = entries.iter().find(|(key, _)| *key == DEPTH_UNIT_KEY)?.1;
                match unit.parse() {
                    Ok(unit) if (1e-6..=0.1).contains(&unit) => *depth_unit_m = unit,
                    _ => {
                        return Some(Err(format!(
                            "the metadata say a depth unit of {unit:?} m; expected 1e-6 to 0.1"
                        )));
                    }
                }
                None
            }
            Record::Message { channel, log_time, data } if channels.contains(&channel) => {
                Some(frame(data, log_time, *depth_unit_m, selection))
            }
            _ => None,
        }
    }
}

/// The frame of an image message.
fn frame(data: &[u8], log_time: u64, depth_unit_m: f64, selection: &Selection) -> Result<DepthFrame, String> {
    let bad = |error| format!("the image logged at {log_time} ns cannot be used: {error}");
    let image = Image::decode(data).map_err(bad)?;
    let mut frame = image.to_frame(depth_unit_m, selection.info.camera).map_err(bad)?;
    let (width, height) = selection.info.size;
    if (width, height) != (0, 0) && (width, height) != (frame.width, frame.height) {
        return Err(format!(
            "the image logged at {log_time} ns has {}x{} pixels; its intrinsics are for {width}x{height}",
            frame.width, frame.height
        ));
    }
    if frame.timestamp_ns == 0 {
        frame.timestamp_ns = log_time;
    }
    Ok(frame)
}

impl<R: Read + Seek> FrameSource for McapSource<R> {
    fn describe(&self) -> String {
        format!("{}, topic {}", self.name, self.selection.image_topic)
    }

    fn next_frame(&mut self) -> Result<DepthFrame, SourceError> {
        while !self.ended {
            match self.reader.next() {
                Ok(Some(record)) => {
                    let frame =
                        Self::take(record, &self.selection, &mut self.channels, &mut self.depth_unit_m);
                    if let Some(frame) = frame {
                        return frame.map_err(SourceError::BadFrame);
                    }
                }
                Ok(None) => self.ended = true,
                Err(error @ RecordError::CutShort(_)) => {
                    self.ended = true;
                    if !self.quiet {
                        tracing::warn!(
                            "{} is cut short: {error}; it is read to its last whole message",
                            self.name
                        );
                    }
                }
                Err(error @ RecordError::Damaged { .. }) => {
                    return Err(SourceError::BadFrame(format!("{}: {error}", self.name)));
                }
                Err(RecordError::Io(error)) => {
                    self.ended = true;
                    return Err(SourceError::Failed(format!("{} cannot be read: {error}", self.name)));
                }
            }
        }
        Err(SourceError::End)
    }
}
