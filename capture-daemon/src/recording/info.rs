//! What a recording holds, for people and programs that ask.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::mcap::{Part, Record, RecordError};
use super::recover::MAX_DAMAGE;
use super::{Distortion, OpenError, OpenOptions, Recording, open_recording};
use crate::frame::CameraModel;
use crate::source::SourceError;

/// Most metadata entries that are kept.
const MAX_METADATA: usize = 256;

/// A topic of an MCAP recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TopicInfo {
    /// Type of its messages, such as `sensor_msgs/msg/Image`.
    pub schema: String,
    /// Its messages that can be read.
    pub messages: u64,
}

/// What a recording holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Info {
    /// Where it is.
    pub path: PathBuf,
    /// `mcap`, `png` or `oni`.
    pub format: &'static str,
    /// The MCAP files that it consists of; none of others.
    pub files: Vec<PathBuf>,
    /// Its topics by their names; none but of MCAP files.
    pub topics: BTreeMap<String, TopicInfo>,
    /// Topic of the depth images that are replayed; none but of MCAP files.
    pub image_topic: Option<String>,
    /// Frames that can be used.
    pub frames: u64,
    /// Frames that cannot, and damaged places.
    pub skipped_frames: u64,
    /// Earliest and latest time of a frame, nanoseconds since 1970.
    pub times_ns: (u64, u64),
    /// Frames that were taken before the one that they follow: the clock was set back.
    pub steps_back: u64,
    /// Columns and rows of the first frame.
    pub size: (usize, usize),
    /// Metres of one count of the first frame.
    pub depth_unit_m: f64,
    /// The camera of the first frame, once its distortion is undone.
    pub camera: CameraModel,
    /// The distortion that is undone.
    pub distortion: Distortion,
    /// Metadata records by their names.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// What could not be read: the first reasons.
    pub damage: Vec<String>,
}

/// Reads a recording to its end. O(bytes).
///
/// # Errors
/// When it is missing, or not one frame of it can be read.
pub fn info(path: &Path, options: &OpenOptions) -> Result<Info, OpenError> {
    let Recording { contents, mut source } = open_recording(path, options)?;
    let mut info = Info {
        path: path.to_owned(),
        format: contents.format,
        files: contents.parts,
        topics: BTreeMap::new(),
        image_topic: contents.image_topic,
        frames: 0,
        skipped_frames: 0,
        times_ns: (u64::MAX, 0),
        steps_back: 0,
        size: (0, 0),
        depth_unit_m: 0.0,
        camera: CameraModel { fx: 0.0, fy: 0.0, cx: 0.0, cy: 0.0 },
        distortion: contents.distortion,
        metadata: BTreeMap::new(),
        damage: Vec::new(),
    };
    let mut before_ns = 0;
    loop {
        match source.next_frame() {
            Ok(frame) => {
                if info.frames == 0 {
                    info.size = (frame.width, frame.height);
                    (info.depth_unit_m, info.camera) = (frame.depth_unit_m, frame.camera);
                }
                info.frames += 1;
                info.steps_back += u64::from(frame.timestamp_ns < before_ns);
                before_ns = frame.timestamp_ns;
                let (first, last) = info.times_ns;
                info.times_ns = (first.min(frame.timestamp_ns), last.max(frame.timestamp_ns));
            }
            Err(SourceError::BadFrame(why) | SourceError::Interrupted(why)) => {
                info.skipped_frames += 1;
                info.note_damage(why);
            }
            Err(SourceError::Told(_)) => {}
            Err(SourceError::End) => break,
            Err(SourceError::Failed(why)) => {
                info.note_damage(why);
                break;
            }
        }
    }
    if info.frames == 0 {
        let reason = info.damage.first().map(|damage| format!("; {damage}")).unwrap_or_default();
        return Err(OpenError::NoFrames { path: path.to_owned(), reason });
    }
    for path in info.files.clone() {
        info.note_part(&Part { path });
    }
    Ok(info)
}

impl Info {
    fn note_damage(&mut self, what: String) {
        if self.damage.len() < MAX_DAMAGE && !self.damage.contains(&what) {
            self.damage.push(what);
        }
    }

    /// Counts the messages of a file and notes its metadata.
    fn note_part(&mut self, part: &Part) {
        let name = part.path.display();
        let mut reader = match part.reader() {
            Ok(reader) => reader,
            Err(why) => return self.note_damage(format!("{name} is {why}")),
        };
        let (mut schemas, mut channels) = (BTreeMap::new(), BTreeMap::new());
        // What a damaged chunk said of channels, the summary says again.
        let mut of_summary = reader.go_to_summary().unwrap_or(false);
        loop {
            match reader.next() {
                Ok(Some(Record::Schema { id, name, .. })) => {
                    schemas.insert(id, name.to_owned());
                }
                Ok(Some(Record::Channel { id, topic, schema, .. })) => {
                    let schema = schemas.get(&schema).cloned().unwrap_or_default();
                    self.topics.entry(topic.to_owned()).or_default().schema = schema;
                    channels.insert(id, topic.to_owned());
                }
                Ok(Some(Record::Message { channel, .. })) => {
                    if let Some(topic) = channels.get(&channel).and_then(|topic| self.topics.get_mut(topic)) {
                        topic.messages += 1;
                    }
                }
                Ok(Some(Record::Metadata { name, entries })) if self.metadata.len() < MAX_METADATA => {
                    let known = self.metadata.entry(name.to_owned()).or_default();
                    known.extend(entries.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())));
                }
                Ok(Some(_)) => {}
                Ok(None) if of_summary => {
                    of_summary = false;
                    if reader.go_to_start().is_err() {
                        return;
                    }
                }
                Ok(None) => return,
                Err(error @ RecordError::Damaged { .. }) => self.note_damage(format!("{name}: {error}")),
                Err(error) => return self.note_damage(format!("{name}: {error}")),
            }
        }
    }

    /// From the first frame to the last, seconds.
    pub fn duration_s(&self) -> f64 {
        self.times_ns.1.saturating_sub(self.times_ns.0) as f64 * 1e-9
    }

    /// Frames each second; none for a single frame.
    pub fn rate_hz(&self) -> Option<f64> {
        let duration = self.duration_s();
        (self.frames > 1 && duration > 0.0).then(|| (self.frames - 1) as f64 / duration)
    }

    /// All of it as JSON.
    pub fn to_json(&self) -> Value {
        let CameraModel { fx, fy, cx, cy } = self.camera;
        let topics: Vec<Value> = self
            .topics
            .iter()
            .map(|(name, topic)| json!({"topic": name, "type": topic.schema, "messages": topic.messages}))
            .collect();
        json!({
            "path": self.path.to_string_lossy(),
            "format": self.format,
            "files": self.files.iter().map(|path| path.to_string_lossy()).collect::<Vec<_>>(),
            "topics": topics,
            "image_topic": self.image_topic,
            "frames": self.frames,
            "skipped_frames": self.skipped_frames,
            "start_ns": self.times_ns.0,
            "end_ns": self.times_ns.1,
            "steps_back": self.steps_back,
            "duration_s": self.duration_s(),
            "rate_hz": self.rate_hz(),
            "width": self.size.0,
            "height": self.size.1,
            "depth_unit_m": self.depth_unit_m,
            "camera": {"fx": fx, "fy": fy, "cx": cx, "cy": cy},
            "distortion": {
                "model": self.distortion.model(),
                "coefficients": self.distortion.coefficients(),
            },
            "metadata": self.metadata,
            "damage": self.damage,
        })
    }
}

impl fmt::Display for Info {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let CameraModel { fx, fy, cx, cy } = self.camera;
        writeln!(to, "{}", self.path.display())?;
        if self.files.len() > 1 {
            for file in &self.files {
                writeln!(to, "  file        {}", file.display())?;
            }
        }
        for (name, topic) in &self.topics {
            let replayed = if self.image_topic.as_ref() == Some(name) { ", replayed" } else { "" };
            writeln!(to, "  topic       {name}  {}, {} messages{replayed}", topic.schema, topic.messages)?;
        }
        writeln!(to, "  frames      {}, and {} skipped", self.frames, self.skipped_frames)?;
        write!(to, "  duration    {:.3} s", self.duration_s())?;
        match self.rate_hz() {
            Some(rate) => writeln!(to, ", {rate:.2} frames/s")?,
            None => writeln!(to)?,
        }
        if self.steps_back > 0 {
            writeln!(to, "  clock       set back, {} times", self.steps_back)?;
        }
        writeln!(to, "  size        {}x{} px, {} m a count", self.size.0, self.size.1, self.depth_unit_m)?;
        writeln!(to, "  camera      fx {fx} px, fy {fy} px, cx {cx} px, cy {cy} px")?;
        if self.distortion.is_none() {
            writeln!(to, "  distortion  none")?;
        } else {
            let coefficients = self.distortion.coefficients();
            writeln!(to, "  distortion  {} {coefficients:?}, undone", self.distortion.model())?;
        }
        for (name, entries) in &self.metadata {
            for (key, value) in entries {
                // A value of many lines, such as a configuration, stays readable.
                writeln!(
                    to,
                    "  metadata    {name}.{key} = {}",
                    value.trim_end().replace('\n', "\n                ")
                )?;
            }
        }
        for damage in &self.damage {
            writeln!(to, "  damage      {damage}")?;
        }
        if self.damage.is_empty() {
            writeln!(to, "  damage      none")?;
        }
        Ok(())
    }
}
