//! Where the log goes: into the journal, each value a field of its own, where stderr is the journal's; else to stderr
//! as text.
//!
//! Written here, since `tracing-journald` keeps values out of the message: `journalctl` would say that something
//! failed, and not why.

use std::fmt::{Debug, Write as _};
use std::io::{self, IsTerminal};
use std::os::fd::AsFd;
use std::os::unix::net::UnixDatagram;
use std::path::Path;

use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, fmt};

/// Where the journal takes entries.
const JOURNAL: &str = "/run/systemd/journal/socket";

/// Begins to log what the variable `SWARD_LOG` lets through; `info` and worse where it is not set.
pub fn start() {
    let filter = EnvFilter::try_from_env("SWARD_LOG").unwrap_or_else(|_| EnvFilter::new("info"));
    let stderr = io::stderr();
    let stream = std::env::var("JOURNAL_STREAM").unwrap_or_default();
    let journal = is_stream(&stderr, &stream).then(|| Journal::connect(Path::new(JOURNAL)).ok()).flatten();
    let text = journal.is_none().then(|| {
        let text = fmt::layer().with_writer(io::stderr).with_ansi(stderr.is_terminal());
        text.with_target(false)
    });
    tracing_subscriber::registry().with(filter).with(journal).with(text).init();
}

/// Whether `stream`, the value of `JOURNAL_STREAM`, means this descriptor: it stays in the environment of programs
/// whose stderr goes elsewhere.
fn is_stream(descriptor: impl AsFd, stream: &str) -> bool {
    let named = |of: rustix::fs::Stat| format!("{}:{}", of.st_dev, of.st_ino) == stream;
    rustix::fs::fstat(descriptor).is_ok_and(named)
}

/// Sends every event to the journal, in its native protocol (systemd.io/JOURNAL_NATIVE_PROTOCOL).
struct Journal(UnixDatagram);

impl Journal {
    fn connect(path: &Path) -> io::Result<Self> {
        let socket = UnixDatagram::unbound()?;
        socket.connect(path)?;
        // A journal that is stuck does not hold up the station.
        socket.set_nonblocking(true)?;
        Ok(Self(socket))
    }
}

impl<S: Subscriber> Layer<S> for Journal {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let metadata = event.metadata();
        let mut entry = Entry::default();
        event.record(&mut entry);
        let Entry { mut message, text, mut fields } = entry;
        message.push_str(&text);
        put(&mut fields, "MESSAGE", &message);
        put(&mut fields, "PRIORITY", priority(*metadata.level()));
        put(&mut fields, "SYSLOG_IDENTIFIER", "sward-capture");
        put(&mut fields, "TARGET", metadata.target());
        // Where the journal is gone or full there is nobody to tell.
        let _ = self.0.send(&fields);
    }
}

/// Severity as in syslog.
fn priority(level: Level) -> &'static str {
    match level {
        Level::ERROR => "3",
        Level::WARN => "4",
        Level::INFO => "6",
        _ => "7",
    }
}

/// What is gathered of an event.
#[derive(Default)]
struct Entry {
    message: String,
    /// The other values as text, as they stand in a terminal.
    text: String,
    fields: Vec<u8>,
}

impl Visit for Entry {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        let value = format!("{value:?}");
        if field.name() == "message" {
            self.message = value;
        } else {
            let _ = write!(self.text, " {}={value}", field.name());
            put(&mut self.fields, &name(field.name()), &value);
        }
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        self.record_debug(field, &format_args!("{value}"));
    }
}

/// A name that the journal takes and that is none of its own.
fn name(field: &str) -> String {
    let kept = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_uppercase() } else { '_' };
    let name: String = field.chars().map(kept).collect();
    format!("SWARD_{name}").chars().take(64).collect()
}

/// Appends a field with its length, since a value may hold line ends.
fn put(entry: &mut Vec<u8>, name: &str, value: &str) {
    entry.extend_from_slice(name.as_bytes());
    entry.push(b'\n');
    entry.extend_from_slice(&(value.len() as u64).to_le_bytes());
    entry.extend_from_slice(value.as_bytes());
    entry.push(b'\n');
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    /// The fields of an entry, as the protocol defines them.
    fn fields_of(mut entry: &[u8]) -> BTreeMap<String, String> {
        let mut fields = BTreeMap::new();
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).expect("UTF-8");
        while !entry.is_empty() {
            let end = entry.iter().position(|byte| *byte == b'\n').expect("a name ends");
            let (name, rest) = entry.split_at(end);
            let (length, rest) = rest[1..].split_first_chunk::<8>().expect("a length");
            let (value, rest) = rest.split_at(usize::try_from(u64::from_le_bytes(*length)).expect("small"));
            fields.insert(text(name), text(value));
            entry = rest.strip_prefix(b"\n").expect("a value ends");
        }
        fields
    }

    #[test]
    fn an_event_becomes_an_entry_with_fields_and_a_message_that_says_all() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal");
        let journal = UnixDatagram::bind(&path).expect("a free path");
        let layer = Journal::connect(&path).expect("it is there");
        let error = io::Error::other("no space\nleft");
        tracing::subscriber::with_default(tracing_subscriber::registry().with(layer), || {
            tracing::error!(%error, blades = 3, name = "fern", "the store cannot be written");
            tracing::info!("ready");
        });
        let mut entry = [0; 4096];
        let length = journal.recv(&mut entry).expect("an entry");
        let fields = fields_of(&entry[..length]);
        for (name, value) in [
            ("MESSAGE", "the store cannot be written error=no space\nleft blades=3 name=fern"),
            ("PRIORITY", "3"),
            ("SYSLOG_IDENTIFIER", "sward-capture"),
            ("SWARD_ERROR", "no space\nleft"),
            ("SWARD_BLADES", "3"),
            ("SWARD_NAME", "fern"),
        ] {
            assert_eq!(fields.get(name).map(String::as_str), Some(value), "{name} of {fields:?}");
        }
        let length = journal.recv(&mut entry).expect("an entry");
        let fields = fields_of(&entry[..length]);
        assert_eq!((&*fields["MESSAGE"], &*fields["PRIORITY"]), ("ready", "6"));
    }

    #[test]
    fn only_the_stream_that_is_named_is_the_journals() {
        let file = tempfile::tempfile().expect("a file");
        let stat = rustix::fs::fstat(&file).expect("it is open");
        let (device, node) = (stat.st_dev, stat.st_ino);
        assert!(is_stream(&file, &format!("{device}:{node}")));
        for other in [String::new(), format!("{device}:{}", node + 1), format!("{}:{node}", device + 1)] {
            assert!(!is_stream(&file, &other), "{other}");
        }
    }

    #[test]
    fn names_are_such_as_the_journal_takes() {
        assert_eq!(name("refused_files"), "SWARD_REFUSED_FILES");
        assert_eq!(name("log.line"), "SWARD_LOG_LINE");
        assert_eq!(name(&"a".repeat(100)).len(), 64);
    }
}
