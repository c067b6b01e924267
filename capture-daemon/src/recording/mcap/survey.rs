//! Finds out what a recording holds, and which of it to replay.

use std::collections::BTreeMap;
use std::io::{Read, Seek};
use std::path::Path;

use super::records::{Record, RecordError, RecordReader};
use crate::frame::CameraModel;
use crate::recording::ros2::{self, CameraInfo, Image, MessageError};
use crate::recording::{OpenError, OpenOptions};

/// Most topics that are looked at: what a survey remembers is bounded, whatever the file says.
const MAX_TOPICS: usize = 4096;
/// Longest name of a topic, bytes.
const MAX_TOPIC_LEN: usize = 1024;

/// What to replay.
pub(super) struct Selection {
    /// Topic of the depth images.
    pub(super) image_topic: String,
    /// Their intrinsics; of size 0×0 when they come from the options.
    pub(super) info: CameraInfo,
}

/// What is known of one topic.
#[derive(Default)]
struct Topic {
    schema: String,
    /// Whether its messages are ROS 2 ones.
    is_ros2: bool,
    /// Messages on it, where the file has statistics.
    messages: Option<u64>,
    /// Encoding of its first image.
    encoding: Option<String>,
    /// Its first intrinsics.
    info: Option<Result<CameraInfo, MessageError>>,
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
        match (&self.encoding, self.is_ros2) {
            (Some(encoding), _) => format!("{name} ({encoding})"),
            (None, true) => format!("{name} ({})", self.schema),
            (None, false) => format!("{name} ({}, not a ROS 2 message)", self.schema),
        }
    }
}

/// The topics of a recording, by channel while it is read.
#[derive(Default)]
struct Survey {
    schemas: BTreeMap<u16, (String, bool)>,
    channels: BTreeMap<u16, String>,
    topics: BTreeMap<String, Topic>,
    /// The first part of the file that could not be read.
    damage: Option<String>,
}

impl Survey {
    fn note(&mut self, record: Record<'_>) {
        match record {
            Record::Schema { id, name, encoding } => {
                self.schemas.insert(id, (name.to_owned(), encoding == "ros2msg"));
            }
            Record::Channel { topic, .. }
                if topic.len() > MAX_TOPIC_LEN
                    || self.topics.len() >= MAX_TOPICS && !self.topics.contains_key(topic) => {}
            Record::Channel { id, schema, topic, message_encoding } => {
                let (schema, ros2msg) = self.schemas.get(&schema).cloned().unwrap_or_default();
                let known = self.topics.entry(topic.to_owned()).or_default();
                known.schema = schema;
                known.is_ros2 = ros2msg && message_encoding == "cdr";
                self.channels.insert(id, topic.to_owned());
            }
            Record::Message { channel, data, .. } => {
                let topic = self.channels.get(&channel).and_then(|topic| self.topics.get_mut(topic));
                let Some(topic) = topic else { return };
                if topic.is_images() && topic.encoding.is_none() {
                    topic.encoding = Image::encoding_of(data).map(str::to_owned);
                }
                if topic.is_intrinsics() && topic.info.is_none() {
                    topic.info = Some(CameraInfo::decode(data));
                }
            }
            Record::Statistics { message_counts } => {
                let topics: Vec<String> = self.channels.values().cloned().collect();
                for topic in topics {
                    self.topics.entry(topic).or_default().messages = Some(0);
                }
                for (channel, count) in message_counts {
                    if let Some(topic) = self.channels.get(&channel) {
                        let messages = &mut self.topics.entry(topic.clone()).or_default().messages;
                        *messages = Some(messages.unwrap_or(0).saturating_add(count));
                    }
                }
            }
            Record::Metadata { .. } => {}
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
                Ok(None) | Err(RecordError::CutShort(_)) => break,
                Err(error @ RecordError::Damaged { .. }) => {
                    self.damage.get_or_insert(error.to_string());
                }
                Err(RecordError::Io(error)) => return Err(error),
            }
        }
        Ok(())
    }

    /// What there is, for a message.
    fn listed(&self) -> String {
        let topics: Vec<String> = self.topics.iter().map(|(name, topic)| topic.describe(name)).collect();
        let damage = self.damage.as_deref().map(|damage| format!(", and {damage}")).unwrap_or_default();
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
        otherwise: Option<CameraModel>,
    ) -> Result<CameraInfo, OpenError> {
        let beside = image_topic
            .rsplit_once('/')
            .map_or("camera_info".into(), |(parent, _)| format!("{parent}/camera_info"));
        let all: Vec<(&String, &Topic)> =
            self.topics.iter().filter(|(_, topic)| topic.info.is_some()).collect();
        let chosen = match (all.iter().find(|(name, _)| **name == beside), all.as_slice()) {
            (Some(chosen), _) => Some(chosen),
            (None, [only]) => Some(only),
            (None, _) => None,
        };
        let info = chosen.and_then(|(name, topic)| topic.info.clone().map(|info| (name, info)));
        match (info, otherwise) {
            (Some((topic, Err(error))), _) => {
                Err(OpenError::Intrinsics { path: path.to_owned(), topic: (*topic).clone(), error })
            }
            (Some((_, Ok(info))), _) => Ok(info),
            (None, Some(camera)) => Ok(CameraInfo { size: (0, 0), camera }),
            (None, None) => Err(OpenError::NoIntrinsics {
                path: path.to_owned(),
                image_topic: image_topic.to_owned(),
                beside,
            }),
        }
    }
}

/// Selects the depth images of a recording and their intrinsics.
///
/// A whole file is read to the first message of each topic that matters, one without a summary to
/// its end.
pub(super) fn select<R: Read + Seek>(
    path: &Path,
    reader: &mut RecordReader<R>,
    options: &OpenOptions,
) -> Result<Selection, OpenError> {
    let mut survey = Survey::default();
    let io = |source| OpenError::Io { path: path.to_owned(), source };
    let whole = reader.go_to_summary().map_err(io)?;
    if whole {
        survey.read(reader, |_| false).map_err(io)?;
        reader.go_to_start().map_err(io)?;
    }
    // A summary without channels promises nothing.
    let whole = whole && !survey.topics.is_empty();
    survey.read(reader, |survey| whole && survey.topics.values().all(Topic::is_known)).map_err(io)?;
    let image_topic = survey.select_images(path, options.topic.as_deref())?;
    let info = survey.select_info(path, &image_topic, options.camera)?;
    Ok(Selection { image_topic, info })
}
