//! Finds out what a recording holds, and which of it to replay.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read, Seek};
use std::path::Path;

use super::record::Record;
use super::records::{RecordError, RecordReader};
use super::{AS_SEEN, DEPTH_UNIT_KEY, METADATA_NAME, NOTES_TOPIC, ORDER_KEY, Part};
use crate::recording::cdr::CdrError;
use crate::recording::ros2::{self, CameraInfo, Image, MessageError};
use crate::recording::{GivenCamera, OpenError, OpenOptions};

/// Most topics that are looked at: what a survey remembers is bounded, whatever the file says.
const MAX_TOPICS: usize = 4096;
/// Longest name of a topic, bytes.
const MAX_TOPIC_LEN: usize = 1024;

/// Metres of one count where the recording does not say: millimetres.
const DEFAULT_DEPTH_UNIT_M: f64 = 0.001;

/// What to replay.
#[derive(Clone, Debug)]
pub(super) struct Selection {
    /// Topic of the depth images.
    pub(super) image_topic: String,
    /// Their intrinsics; of size 0×0 when they come from the options.
    pub(super) info: CameraInfo,
    /// Metres of one count of images of whole numbers.
    pub(super) depth_unit_m: f64,
    /// The frames stand in the order in which a station saw them.
    pub(super) is_as_seen: bool,
    /// Channels of the topic in each part, as far as they are known.
    pub(super) channels: Vec<BTreeSet<u16>>,
    /// The same of notes.
    pub(super) note_channels: Vec<BTreeSet<u16>>,
}

/// What is known of one topic.
#[derive(Default)]
struct Topic {
    schema: String,
    /// Whether its messages are ROS 2 ones.
    is_ros2: bool,
    /// Messages on it, where the file has statistics.
    messages: Option<u64>,
    /// Encoding of its first image that has one.
    encoding: Option<String>,
    /// Why its first image has none.
    refusal: Option<CdrError>,
    /// Its first intrinsics; `None` in there: not calibrated.
    info: Option<Result<Option<CameraInfo>, MessageError>>,
}

impl Topic {
    fn is_images(&self) -> bool {
        self.is_ros2 && self.schema == ros2::IMAGE && self.messages != Some(0)
    }

    fn is_intrinsics(&self) -> bool {
        self.is_ros2 && self.schema == ros2::CAMERA_INFO && self.messages != Some(0)
    }

    /// Whether nothing more needs to be read of it.
    fn is_known(&self) -> bool {
        (!self.is_images() || self.encoding.is_some()) && (!self.is_intrinsics() || self.info.is_some())
    }

    /// What it is, for a message.
    fn describe(&self, name: &str) -> String {
        match (&self.encoding, self.refusal, self.is_ros2) {
            (Some(encoding), ..) => format!("{name} ({encoding})"),
            (None, Some(refusal), _) => format!("{name} ({}: {refusal})", self.schema),
            (None, None, true) => format!("{name} ({})", self.schema),
            (None, None, false) => format!("{name} ({}, not a ROS 2 message)", self.schema),
        }
    }
}

/// The topics of a recording.
#[derive(Default)]
pub(super) struct Survey {
    /// Of the part that is being read: name and whether it is a ROS 2 one.
    schemas: BTreeMap<u16, (String, bool)>,
    /// Topics of the channels of the part that is being read.
    channels: BTreeMap<u16, String>,
    /// The same of the parts that were read.
    parts: Vec<BTreeMap<u16, String>>,
    topics: BTreeMap<String, Topic>,
    /// Where the metadata of Sward's own recordings stand in the part that is being read.
    metadata_at: Option<u64>,
    /// What they say of the depth unit.
    depth_unit: Option<String>,
    /// They say that the frames stand in the order in which a station saw them.
    is_as_seen: bool,
    /// The first part of the file that could not be read.
    damage: Option<String>,
    /// Where the first file that is cut short ends.
    cut_short: Option<String>,
}

impl Survey {
    fn note(&mut self, record: Record<'_>) {
        match record {
            Record::Schema { id, name, encoding, .. } => {
                self.schemas.insert(id, (name.to_owned(), encoding == "ros2msg"));
            }
            Record::Channel { topic, .. }
                if topic.len() > MAX_TOPIC_LEN
                    || self.topics.len() >= MAX_TOPICS && !self.topics.contains_key(topic) => {}
            Record::Channel { id, schema, topic, message_encoding, .. } => {
                let (schema, ros2msg) = self.schemas.get(&schema).cloned().unwrap_or_default();
                let known = self.topics.entry(topic.to_owned()).or_default();
                known.schema = schema;
                known.is_ros2 = ros2msg && message_encoding == "cdr";
                self.channels.insert(id, topic.to_owned());
            }
            Record::Message { channel, data, .. } => {
                let topic = self.channels.get(&channel).and_then(|topic| self.topics.get_mut(topic));
                let Some(topic) = topic else { return };
                // Other parts' statistics know nothing of this one's messages.
                topic.messages = topic.messages.map(|messages| messages.max(1));
                if topic.is_images() && topic.encoding.is_none() {
                    match Image::encoding_of(data) {
                        Ok(encoding) => topic.encoding = Some(encoding.to_owned()),
                        Err(error) => topic.refusal = topic.refusal.or(Some(error)),
                    }
                }
                if topic.is_intrinsics() && topic.info.is_none() {
                    topic.info = Some(CameraInfo::decode(data));
                }
            }
            Record::Statistics { message_counts } => {
                for topic in self.channels.values() {
                    self.topics.entry(topic.clone()).or_default().messages.get_or_insert(0);
                }
                for (channel, count) in message_counts {
                    if let Some(topic) = self.channels.get(&channel) {
                        let messages =
                            self.topics.entry(topic.clone()).or_default().messages.get_or_insert(0);
                        *messages = messages.saturating_add(count);
                    }
                }
            }
            Record::Metadata { name: METADATA_NAME, entries } => {
                let unit = entries.iter().find(|(key, _)| *key == DEPTH_UNIT_KEY);
                self.depth_unit = unit.map(|(_, unit)| (*unit).to_owned());
                self.is_as_seen = entries.contains(&(ORDER_KEY, AS_SEEN));
            }
            Record::MetadataIndex { offset, name: METADATA_NAME } => self.metadata_at = Some(offset),
            Record::Header { .. }
            | Record::Attachment { .. }
            | Record::Metadata { .. }
            | Record::MetadataIndex { .. } => {}
        }
    }

    /// Reads on until `enough`, or to the end of what can be read.
    fn read<R: Read + Seek>(
        &mut self,
        reader: &mut RecordReader<R>,
        enough: impl Fn(&Self) -> bool,
    ) -> Result<(), std::io::Error> {
        while !enough(self) {
            match reader.next() {
                Ok(Some(record)) => self.note(record),
                Ok(None) => break,
                Err(error @ RecordError::CutShort(_)) => {
                    self.cut_short.get_or_insert(error.to_string());
                    break;
                }
                Err(error @ RecordError::Damaged { .. }) => {
                    self.damage.get_or_insert(error.to_string());
                }
                Err(RecordError::Io(error)) => return Err(error),
            }
        }
        Ok(())
    }

    /// Reads a part: a whole file to the first message of each topic that matters, one without a
    /// summary to its end.
    pub(super) fn read_part<R: Read + Seek>(
        &mut self,
        reader: &mut RecordReader<R>,
    ) -> Result<(), std::io::Error> {
        self.schemas.clear();
        self.metadata_at = None;
        let mut whole = reader.go_to_summary()?;
        if whole {
            self.read(reader, |_| false)?;
            if let Some(at) = self.metadata_at {
                reader.go_to(at)?;
                // What cannot be read there is found again on the way through the file.
                if let Ok(Some(record @ Record::Metadata { .. })) = reader.next() {
                    self.note(record);
                }
            }
            reader.go_to_start()?;
            // A summary without channels promises nothing, nor does a damaged one.
            whole = !self.channels.is_empty() && self.damage.is_none();
        }
        self.read(reader, |survey| whole && survey.topics.values().all(Topic::is_known))?;
        self.parts.push(std::mem::take(&mut self.channels));
        Ok(())
    }

    /// Notes a part that cannot be read.
    pub(super) fn skip_part(&mut self, why: String) {
        self.damage.get_or_insert(why);
        self.parts.push(BTreeMap::new());
    }

    /// What there is, for a message.
    fn listed(&self) -> String {
        let topics: Vec<String> = self.topics.iter().map(|(name, topic)| topic.describe(name)).collect();
        let unread = [&self.damage, &self.cut_short].into_iter().flatten();
        let damage: String = unread.map(|unread| format!(", and {unread}")).collect();
        if topics.is_empty() {
            format!("it has no topics{damage}")
        } else {
            format!("it has {}{damage}", topics.join(", "))
        }
    }

    fn select_images(&self, path: &Path, wanted: Option<&str>) -> Result<String, OpenError> {
        let path = path.to_owned();
        if let Some(wanted) = wanted {
            return match self.topics.get(wanted) {
                Some(topic) if topic.is_images() => Ok(wanted.to_owned()),
                _ => Err(OpenError::NoSuchTopic { path, wanted: wanted.to_owned(), found: self.listed() }),
            };
        }
        let is_depth = |topic: &Topic| topic.encoding.as_deref().is_some_and(Image::is_depth);
        let fitting: Vec<(&String, &Topic)> =
            self.topics.iter().filter(|(_, topic)| topic.is_images() && is_depth(topic)).collect();
        let named: Vec<&String> = fitting
            .iter()
            .map(|(name, _)| *name)
            .filter(|name| name.to_lowercase().contains("depth"))
            .collect();
        match (fitting.as_slice(), named.as_slice()) {
            ([(only, _)], _) | (_, [only]) => Ok((*only).clone()),
            ([], _) => Err(OpenError::NoDepthTopic { path, found: self.listed() }),
            _ => {
                let found: Vec<String> = fitting.iter().map(|(name, topic)| topic.describe(name)).collect();
                Err(OpenError::SeveralTopics { path, found: found.join(", ") })
            }
        }
    }

    /// The intrinsics of an image topic: beside it, or the only ones there are.
    fn select_info(
        &self,
        path: &Path,
        image_topic: &str,
        otherwise: Option<&GivenCamera>,
    ) -> Result<CameraInfo, OpenError> {
        let beside = image_topic
            .rsplit_once('/')
            .map_or("camera_info".into(), |(parent, _)| format!("{parent}/camera_info"));
        // Those of a camera that is not calibrated are none.
        let all: Vec<(&String, Result<&CameraInfo, &MessageError>)> = self
            .topics
            .iter()
            .filter_map(|(name, topic)| Some((name, topic.info.as_ref()?.as_ref())))
            .filter_map(|(name, info)| Some((name, info.map(Option::as_ref).transpose()?)))
            .collect();
        let chosen = match (all.iter().find(|(name, _)| **name == beside), all.as_slice()) {
            (Some(chosen), _) => Some(chosen),
            (None, [only]) => Some(only),
            (None, _) => None,
        };
        match (chosen, otherwise) {
            (Some((topic, Err(error))), _) => Err(OpenError::Intrinsics {
                path: path.to_owned(),
                topic: (*topic).clone(),
                error: (*error).clone(),
            }),
            (Some((_, Ok(info))), _) => Ok((*info).clone()),
            (None, Some(given)) => {
                Ok(CameraInfo { size: (0, 0), camera: given.camera, distortion: given.distortion.clone() })
            }
            (None, None) => Err(OpenError::NoIntrinsics {
                path: path.to_owned(),
                image_topic: image_topic.to_owned(),
                beside,
            }),
        }
    }

    fn select_depth_unit(&self, path: &Path) -> Result<f64, OpenError> {
        let Some(text) = &self.depth_unit else { return Ok(DEFAULT_DEPTH_UNIT_M) };
        match text.parse() {
            Ok(unit) if (1e-6..=0.1).contains(&unit) => Ok(unit),
            _ => Err(OpenError::DepthUnit { path: path.to_owned(), found: text.clone() }),
        }
    }

    /// Selects the depth images and their intrinsics.
    pub(super) fn select(&self, path: &Path, options: &OpenOptions) -> Result<Selection, OpenError> {
        // Of a file that ends before its first image nobody knows what it would have held.
        if let Some(cut_short) = &self.cut_short
            && self.topics.values().all(|topic| topic.encoding.is_none() && topic.refusal.is_none())
        {
            let reason = format!("; {cut_short}, before its first image");
            return Err(OpenError::NoFrames { path: path.to_owned(), reason });
        }
        let image_topic = self.select_images(path, options.topic.as_deref())?;
        let info = self.select_info(path, &image_topic, options.camera.as_ref())?;
        let depth_unit_m = self.select_depth_unit(path)?;
        let of_topic = |wanted: &str| {
            let of_part = |channels: &BTreeMap<u16, String>| {
                channels.iter().filter(|(_, topic)| *topic == wanted).map(|(&id, _)| id).collect()
            };
            self.parts.iter().map(of_part).collect()
        };
        let (channels, note_channels) = (of_topic(&image_topic), of_topic(NOTES_TOPIC));
        let is_as_seen = self.is_as_seen;
        Ok(Selection { image_topic, info, depth_unit_m, is_as_seen, channels, note_channels })
    }
}

/// Surveys the parts of a recording in their order.
pub(super) fn survey(path: &Path, parts: &[Part]) -> Result<Survey, OpenError> {
    let mut survey = Survey::default();
    for part in parts {
        match part.reader() {
            Ok(mut reader) => survey
                .read_part(&mut reader)
                .map_err(|source| OpenError::Io { path: part.path.clone(), source })?,
            Err(why) if parts.len() > 1 => survey.skip_part(format!("{}: {why}", part.path.display())),
            Err(why) => {
                return Err(OpenError::NotARecording { path: path.to_owned(), found: why.to_string() });
            }
        }
    }
    Ok(survey)
}
