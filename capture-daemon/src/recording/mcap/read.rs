//! Replays the depth images of the files of a recording.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use super::record::Record;
use super::records::{RecordError, RecordReader};
use super::survey::{Selection, survey};
use super::{AS_SEEN, CONFIG_KEY, DEPTH_UNIT_KEY, METADATA_NAME, NOTES_TOPIC, ORDER_KEY, Part};
use crate::frame::DepthFrame;
use crate::note::Note;
use crate::recording::distortion::Rectifier;
use crate::recording::in_order::InOrder;
use crate::recording::ros2::{self, Image};
use crate::recording::{Contents, OpenError, OpenOptions, Recording, ensure_one_frame};
use crate::source::{FrameSource, SourceError};

/// Opens a recording of one or more files, each of which begins with MCAP's magic if it is a whole one.
pub(in crate::recording) fn open(
    path: &Path,
    parts: Vec<Part>,
    options: &OpenOptions,
) -> Result<Recording, OpenError> {
    let selection = survey(path, &parts)?.select(path, options)?;
    let source = |quiet| McapSource::new(path, &parts, &selection, quiet);
    ensure_one_frame(path, &mut source(true))?;
    let info = &selection.info;
    let contents = Contents {
        format: "mcap",
        image_topic: Some(selection.image_topic.clone()),
        distortion: info.distortion.clone(),
        parts: parts.iter().map(|part| part.path.clone()).collect(),
    };
    let source = source(false);
    // Whatever the times: a replay sees what the station saw.
    if selection.is_as_seen {
        return Ok(Recording { contents, source: Box::new(source) });
    }
    Ok(Recording { contents, source: Box::new(InOrder::new(source)) })
}

/// The configuration that stands before the first message of a live run's recording.
pub(in crate::recording) fn recorded_config(part: &Part) -> Option<String> {
    let mut reader = part.reader().ok()?;
    loop {
        match reader.next() {
            Ok(Some(Record::Metadata { name: METADATA_NAME, entries })) => {
                let of_live_run = entries.contains(&(ORDER_KEY, AS_SEEN));
                let config = entries.iter().find(|(key, config)| *key == CONFIG_KEY && !config.is_empty());
                return config.filter(|_| of_live_run).map(|(_, config)| (*config).to_owned());
            }
            Ok(Some(Record::Message { .. }) | None) | Err(_) => return None,
            Ok(Some(_)) => {}
        }
    }
}

/// The files of a recording as a source of frames.
struct McapSource {
    name: String,
    parts: Vec<Part>,
    /// Index of the part to open next.
    next_part: usize,
    reader: Option<RecordReader<BufReader<File>>>,
    selection: Selection,
    depth_unit_m: f64,
    /// Channels of the selected topic in the part that is being read.
    channels: BTreeSet<u16>,
    /// The same of notes.
    note_channels: BTreeSet<u16>,
    rectifier: Option<Rectifier>,
    /// Does not warn: somebody reads it again who does.
    quiet: bool,
    /// Has warned of damage.
    warned: bool,
}

impl McapSource {
    fn new(path: &Path, parts: &[Part], selection: &Selection, quiet: bool) -> Self {
        Self {
            name: path.display().to_string(),
            parts: parts.to_vec(),
            next_part: 0,
            reader: None,
            selection: selection.clone(),
            depth_unit_m: selection.depth_unit_m,
            channels: BTreeSet::new(),
            note_channels: BTreeSet::new(),
            rectifier: None,
            quiet,
            warned: false,
        }
    }

    /// Warns once of what cannot be read.
    fn warn(&mut self, what: &str) {
        if !self.quiet && !self.warned {
            tracing::warn!("{}: {what}", self.name);
        }
        self.warned = true;
    }

    /// Opens the next part; `None` behind the last one.
    fn open_next(&mut self) -> Option<()> {
        let part = self.parts.get(self.next_part)?;
        self.channels = self.selection.channels.get(self.next_part).cloned().unwrap_or_default();
        self.note_channels = self.selection.note_channels.get(self.next_part).cloned().unwrap_or_default();
        self.next_part += 1;
        match part.reader() {
            Ok(mut reader) => {
                reader.expect_channels(self.channels.iter().chain(&self.note_channels).copied());
                self.reader = Some(reader);
            }
            Err(why) => {
                let what = format!("{} is {why}; it is left out", part.path.display());
                self.warn(&what);
            }
        }
        Some(())
    }

    /// The part that is being read, for a message: nothing if it is the only one.
    fn part(&self) -> String {
        match (self.parts.len(), self.next_part.checked_sub(1).and_then(|index| self.parts.get(index))) {
            (0 | 1, _) | (_, None) => String::new(),
            (_, Some(part)) => {
                part.path.file_name().map(|name| format!("in {}, ", name.display())).unwrap_or_default()
            }
        }
    }

    /// The frame of an image message.
    fn frame(&mut self, image: Result<DepthFrame, String>) -> Result<DepthFrame, String> {
        let mut frame = image?;
        let info = &self.selection.info;
        if !info.distortion.is_none() {
            let size = (frame.width, frame.height);
            let rectifier = match self.rectifier.take().filter(|rectifier| rectifier.fits(&frame)) {
                Some(rectifier) => rectifier,
                None => Rectifier::new(&info.distortion, &info.camera, size),
            };
            self.rectifier.insert(rectifier).rectify(&mut frame);
        }
        Ok(frame)
    }
}

/// The frame that a message shows, as it is.
fn decode(
    data: &[u8],
    log_time: u64,
    depth_unit_m: f64,
    selection: &Selection,
) -> Result<DepthFrame, String> {
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

impl FrameSource for McapSource {
    fn describe(&self) -> String {
        format!("{}, topic {}", self.name, self.selection.image_topic)
    }

    fn next_frame(&mut self) -> Result<DepthFrame, SourceError> {
        loop {
            let Some(reader) = &mut self.reader else {
                self.open_next().ok_or(SourceError::End)?;
                continue;
            };
            let found = match reader.next() {
                Ok(Some(Record::Channel { id, topic, .. })) => {
                    let wanted = [
                        (&mut self.channels, self.selection.image_topic.as_str()),
                        (&mut self.note_channels, NOTES_TOPIC),
                    ];
                    for (channels, name) in wanted {
                        if topic == name {
                            channels.insert(id);
                        } else {
                            channels.remove(&id);
                        }
                    }
                    continue;
                }
                Ok(Some(Record::Metadata { name: METADATA_NAME, entries })) => {
                    let unit = entries.iter().find(|(key, _)| *key == DEPTH_UNIT_KEY);
                    let unit = unit.and_then(|(_, unit)| unit.parse().ok());
                    self.depth_unit_m =
                        unit.filter(|unit| (1e-6..=0.1).contains(unit)).unwrap_or(self.depth_unit_m);
                    continue;
                }
                Ok(Some(Record::Message { channel, log_time, data, .. }))
                    if self.channels.contains(&channel) =>
                {
                    Ok(decode(data, log_time, self.depth_unit_m, &self.selection))
                }
                Ok(Some(Record::Message { channel, data, .. })) if self.note_channels.contains(&channel) => {
                    // One that is not understood was written by another version.
                    match ros2::decode_text(data).ok().and_then(Note::of_json) {
                        Some(note) => return Err(SourceError::Told(note)),
                        None => continue,
                    }
                }
                Ok(Some(_)) => continue,
                Ok(None) => {
                    self.reader = None;
                    continue;
                }
                Err(error) => Err(error),
            };
            match found {
                Ok(frame) => return self.frame(frame).map_err(SourceError::BadFrame),
                Err(error @ RecordError::CutShort(_)) => {
                    self.reader = None;
                    let part = self.part();
                    self.warn(&format!("{part}{error}; it is read to its last whole message"));
                }
                Err(error @ RecordError::Damaged { .. }) => {
                    let what = format!("{}{error}", self.part());
                    self.warn(&format!("{what}; what is behind it is read"));
                    return Err(SourceError::BadFrame(format!("{}: {what}", self.name)));
                }
                Err(RecordError::Io(error)) => {
                    self.reader = None;
                    self.next_part = self.parts.len();
                    return Err(SourceError::Failed(format!("{} cannot be read: {error}", self.name)));
                }
            }
        }
    }
}
