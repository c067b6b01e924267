//! Rewrites a recording that was cut short, message by message, into a whole one.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::path::{Path, PathBuf};

use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::{Attachment, McapError};

use super::mcap::{ChunkSpan, Part, Record, RecordError, RecordReader, write_options};
use super::{Kind, OpenError, kind, not_a_recording, png_sequence, ros2};

/// Most schemas, channels or metadata records that are kept: what is remembered is bounded, whatever
/// the file says.
const MAX_KINDS: usize = 4096;

/// Why a recording cannot be rewritten.
#[derive(Debug, thiserror::Error)]
pub enum RecoverError {
    /// The recording cannot be opened, or holds not one image.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Something is at the place to write to.
    #[error("{path}: exists already; give a path where nothing is yet")]
    Exists {
        /// Where.
        path: PathBuf,
    },
    /// The recording cannot be read to its end, for another reason than its bytes.
    #[error("{path}: cannot be read ({source}); check the disk")]
    Read {
        /// Where.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The new recording cannot be written.
    #[error(
        "{path}: cannot be written ({reason}); check the folder, its permissions and the room on the disk"
    )]
    Write {
        /// Where.
        path: PathBuf,
        /// Why.
        reason: String,
    },
}

/// What a rewritten recording holds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recovered {
    /// Messages.
    pub messages: u64,
    /// Images among them.
    pub images: u64,
    /// What could not be read, in the order of the recording; at most 16 of them.
    pub damage: Vec<String>,
    /// All that could not be read.
    pub damaged_places: u64,
}

/// Most descriptions of damage that are kept.
pub(super) const MAX_DAMAGE: usize = 16;

/// Rewrites all whole messages of an MCAP file or rosbag2 folder at `from` into one MCAP file at `to`:
/// their bytes, times, topics, definitions, and the metadata and attachments. `to` is there once it is
/// whole, and nothing is overwritten.
///
/// # Errors
/// When `from` cannot be read or holds not one image, when `to` exists, when it cannot be written.
pub fn recover(from: &Path, to: &Path) -> Result<Recovered, RecoverError> {
    let kind = kind(from)?;
    if matches!(kind, Kind::Oni) {
        return Err(RecoverError::Open(OpenError::Unsupported {
            path: from.to_owned(),
            found: "a recording of OpenNI2".to_owned(),
            remedy: "replay and info read what is whole of it as it is",
        }));
    }
    let Kind::Mcap(parts) = kind else {
        let io = |source| OpenError::Io { path: from.to_owned(), source };
        if png_sequence::pictures(from).map_err(io)?.is_empty() {
            return Err(RecoverError::Open(not_a_recording(from, "a folder without MCAP files")));
        }
        return Err(RecoverError::Open(OpenError::Unsupported {
            path: from.to_owned(),
            found: "a folder of pictures".to_owned(),
            remedy: "there is nothing in it to rewrite: replay it as it is",
        }));
    };
    let exists = || RecoverError::Exists { path: to.to_owned() };
    let refused = |reason: String| RecoverError::Write { path: to.to_owned(), reason };
    if to.symlink_metadata().is_ok() {
        return Err(exists());
    }
    let folder = to.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(".recover-").suffix(".part");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // What other new files get: the umask takes its part.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let part = builder.tempfile_in(folder).map_err(|error| refused(error.to_string()))?;

    let options = write_options(profile(&parts).as_deref().unwrap_or("ros2"), 0);
    let writer = options.create(BufWriter::new(part)).map_err(|error| refused(error.to_string()))?;
    let mut rewriter = Rewriter::new(writer);
    for part in &parts {
        rewriter.take_part(part, parts.len() > 1).map_err(|error| match error {
            TakeError::Read(source) => RecoverError::Read { path: part.path.clone(), source },
            TakeError::Write(error) => refused(with_sources(&error)),
        })?;
    }
    let Rewriter { mut writer, recovered, .. } = rewriter;
    if recovered.images == 0 {
        let first = recovered.damage.first();
        let reason = first.map(|damage| format!("; {damage}, before its first image")).unwrap_or_default();
        return Err(RecoverError::Open(OpenError::NoFrames { path: from.to_owned(), reason }));
    }
    writer.finish().map_err(|error| refused(with_sources(&error)))?;
    let part = writer.into_inner().into_inner().map_err(|error| refused(error.to_string()))?;
    part.as_file().sync_all().map_err(|error| refused(error.to_string()))?;
    part.persist_noclobber(to).map_err(|error| match error.error.kind() {
        std::io::ErrorKind::AlreadyExists => exists(),
        _ => refused(error.error.to_string()),
    })?;
    Ok(recovered)
}

/// An error and what caused it, in which the system's reason stands.
fn with_sources(error: &dyn std::error::Error) -> String {
    let source = error.source().map(|source| format!(": {}", with_sources(source)));
    format!("{error}{}", source.unwrap_or_default())
}

/// What the recording says of the conventions that it follows.
fn profile(parts: &[Part]) -> Option<String> {
    let mut reader = parts.iter().find_map(|part| part.reader().ok())?;
    match reader.next() {
        Ok(Some(Record::Header { profile })) => Some(profile.to_owned()),
        _ => None,
    }
}

enum TakeError {
    Read(std::io::Error),
    Write(McapError),
}

impl From<McapError> for TakeError {
    fn from(error: McapError) -> Self {
        Self::Write(error)
    }
}

/// A schema of the part that is being read.
struct Schema {
    name: String,
    encoding: String,
    data: Vec<u8>,
}

/// A channel of the part that is being read.
struct Channel {
    schema: u16,
    topic: String,
    message_encoding: String,
    metadata: BTreeMap<String, String>,
    /// Its number in what is written, once it has a message there, and whether these are images.
    written: Option<(u16, bool)>,
}

struct Rewriter<W: std::io::Write + std::io::Seek> {
    writer: ::mcap::Writer<W>,
    span: ChunkSpan,
    schemas: BTreeMap<u16, Schema>,
    channels: BTreeMap<u16, Channel>,
    /// The metadata that were written: files of one folder may repeat them.
    metadata: BTreeSet<(String, BTreeMap<String, String>)>,
    recovered: Recovered,
}

fn owned(entries: &[(&str, &str)]) -> BTreeMap<String, String> {
    entries.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect()
}

impl<W: std::io::Write + std::io::Seek> Rewriter<W> {
    fn new(writer: ::mcap::Writer<W>) -> Self {
        Self {
            writer,
            span: ChunkSpan::default(),
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            metadata: BTreeSet::new(),
            recovered: Recovered::default(),
        }
    }

    fn damage(&mut self, what: String) {
        self.recovered.damaged_places += 1;
        if self.recovered.damage.len() < MAX_DAMAGE {
            self.recovered.damage.push(what);
        }
    }

    fn take_part(&mut self, part: &Part, named: bool) -> Result<(), TakeError> {
        self.schemas.clear();
        self.channels.clear();
        let name = if named { format!("{}: ", part.path.display()) } else { String::new() };
        let mut reader = match part.reader() {
            Ok(reader) => reader,
            Err(why) => {
                self.damage(format!("{} is {why}", part.path.display()));
                return Ok(());
            }
        };
        // What a damaged chunk said of channels, the summary says again.
        if reader.go_to_summary().map_err(TakeError::Read)? {
            self.take_records(&mut reader, &name, true)?;
            reader.go_to_start().map_err(TakeError::Read)?;
        }
        self.take_records(&mut reader, &name, false)
    }

    fn take_records(
        &mut self,
        reader: &mut RecordReader<BufReader<File>>,
        name: &str,
        of_summary: bool,
    ) -> Result<(), TakeError> {
        loop {
            match reader.next() {
                Ok(Some(record)) if of_summary => self.learn(&record),
                Ok(Some(record)) => {
                    self.learn(&record);
                    self.write(record)?;
                }
                Ok(None) => return Ok(()),
                Err(RecordError::Io(error)) => return Err(TakeError::Read(error)),
                Err(error @ RecordError::CutShort(_)) => {
                    self.damage(format!("{name}{error}"));
                    return Ok(());
                }
                Err(error @ RecordError::Damaged { .. }) => self.damage(format!("{name}{error}")),
            }
        }
    }

    /// Notes what later messages need.
    fn learn(&mut self, record: &Record<'_>) {
        match record {
            Record::Schema { id, name, encoding, data } if self.schemas.len() < MAX_KINDS => {
                let (name, encoding) = ((*name).to_owned(), (*encoding).to_owned());
                self.schemas.insert(*id, Schema { name, encoding, data: data.to_vec() });
            }
            Record::Channel { id, schema, topic, message_encoding, metadata }
                if self.channels.len() < MAX_KINDS =>
            {
                let (topic, message_encoding) = ((*topic).to_owned(), (*message_encoding).to_owned());
                let (schema, metadata) = (*schema, owned(metadata));
                let channel = Channel { schema, topic, message_encoding, metadata, written: None };
                // Said again, as in each chunk: the number that it has stays.
                let known = self.channels.entry(*id).or_insert(channel);
                known.schema = schema;
            }
            _ => {}
        }
    }

    fn write(&mut self, record: Record<'_>) -> Result<(), TakeError> {
        match record {
            Record::Message { channel, sequence, log_time, publish_time, data } => {
                let Some((channel_id, is_image)) = self.channel(channel)? else { return Ok(()) };
                if self.span.ends_before(log_time) {
                    self.writer.flush()?;
                }
                let header = MessageHeader { channel_id, sequence, log_time, publish_time };
                self.writer.write_to_known_channel(&header, data)?;
                self.recovered.messages += 1;
                self.recovered.images += u64::from(is_image);
            }
            Record::Metadata { name, entries } => {
                let metadata = Metadata { name: name.to_owned(), metadata: owned(&entries) };
                let known = (metadata.name.clone(), metadata.metadata.clone());
                if self.metadata.len() < MAX_KINDS && self.metadata.insert(known) {
                    self.writer.write_metadata(&metadata)?;
                }
            }
            Record::Attachment { log_time, create_time, name, media_type, data } => {
                let (name, media_type, data) = (name.to_owned(), media_type.to_owned(), data.into());
                self.writer.attach(&Attachment { log_time, create_time, name, media_type, data })?;
            }
            _ => {}
        }
        Ok(())
    }

    /// The number of a channel in what is written, and whether its messages are images.
    fn channel(&mut self, id: u16) -> Result<Option<(u16, bool)>, TakeError> {
        let Some(channel) = self.channels.get_mut(&id) else { return Ok(None) };
        if channel.written.is_none() {
            let schema = self.schemas.get(&channel.schema);
            let schema_id = match schema {
                Some(Schema { name, encoding, data }) => self.writer.add_schema(name, encoding, data)?,
                None => 0,
            };
            let Channel { topic, message_encoding, metadata, .. } = &*channel;
            let written = self.writer.add_channel(schema_id, topic, message_encoding, metadata)?;
            channel.written = Some((written, schema.is_some_and(|schema| schema.name == ros2::IMAGE)));
        }
        Ok(channel.written)
    }
}
