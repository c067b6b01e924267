//! Reading a configuration: its documents one over the other, and where in them a mistake is.

use std::io::Read;
use std::path::{Path, PathBuf};

use nix::unistd::{Group, User};

use super::range::out_of_range;
use super::{Config, manual};
use crate::mistake;
use crate::store::file::{TextError, utf8};

/// Why a configuration cannot be used. The message begins with where.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{path}: the configuration cannot be read: {reason}; check the path given with --config")]
    Unreadable {
        /// The file.
        path: String,
        /// What the system said.
        reason: String,
    },
    /// The text is not TOML, or a key is unknown or of another type.
    #[error("{place}: {reason}")]
    Invalid {
        /// File, line and column, or the `--set` argument.
        place: String,
        /// What is wrong and what was expected.
        reason: String,
    },
}

/// A configuration is no longer than this.
const MAX_BYTES: u64 = 1 << 20;

/// Reads a configuration: the file over the defaults, each `key=value` of `sets` over both.
///
/// # Errors
/// The first thing that is wrong, with file, line and column, or with the `--set` argument.
pub fn load(file: Option<&Path>, sets: &[String]) -> Result<Config, ConfigError> {
    read(file, sets).map(|(config, _)| config)
}

/// The same over the configuration that a recording of a live run was made under, where no file is given.
///
/// # Errors
/// As [`load`].
pub fn load_recorded(
    recorded: Option<&str>,
    file: Option<&Path>,
    sets: &[String],
) -> Result<Config, ConfigError> {
    let recorded = recorded.filter(|_| file.is_none());
    let document = recorded.map(|text| Document { origin: Origin::Recording, text: text.to_owned() });
    read_over(document, file, sets).map(|(config, _)| config)
}

/// The same, and what is odd in it on this machine, with file, line and column: users and groups in `service.watch` and
/// `service.change` that there are not. They are no errors, since the machine that it is for may have them.
///
/// # Errors
/// As [`load`].
pub fn check(file: Option<&Path>, sets: &[String]) -> Result<(Config, Vec<String>), ConfigError> {
    let (config, documents) = read(file, sets)?;
    let lists = [("service.watch", &config.service.watch), ("service.change", &config.service.change)];
    let entries = lists.into_iter().flat_map(|(key, list)| list.iter().map(move |entry| (key, entry)));
    let unknown = entries.filter(|(_, entry)| *entry != "*" && !is_known(entry)).map(|(key, entry)| {
        // The last document that gives a key has the word.
        let place = documents.iter().rev().find(|document| document.place_of(key).is_some());
        let place = place.map_or_else(|| "configuration".to_owned(), |document| document.place_of_item(key, entry));
        let kind = if entry.starts_with('@') { "group" } else { "user" };
        format!(
            "{place}: `{key}` names {entry:?}, and this machine has no such {kind}: nobody is meant by it here; expected \
             \"*\", users, and groups with @ before them, by name or number"
        )
    });
    let warnings = unknown.collect();
    Ok((config, warnings))
}

fn read(file: Option<&Path>, sets: &[String]) -> Result<(Config, Vec<Document>), ConfigError> {
    read_over(None, file, sets)
}

/// `first`: below all others.
fn read_over(
    first: Option<Document>,
    file: Option<&Path>,
    sets: &[String],
) -> Result<(Config, Vec<Document>), ConfigError> {
    let mut documents: Vec<Document> = first.into_iter().collect();
    if let Some(path) = file {
        let unreadable = |reason: std::io::Error| ConfigError::Unreadable {
            path: path.display().to_string(),
            reason: reason.to_string(),
        };
        let mut bytes = Vec::new();
        // Reading a pipe could take for ever, and gives nothing the second time, at a reload.
        if !std::fs::metadata(path).map_err(unreadable)?.is_file() {
            return Err(unreadable(std::io::Error::other("it is not a regular file")));
        }
        let file = std::fs::File::open(path).map_err(unreadable)?;
        file.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
        if bytes.len() as u64 > MAX_BYTES {
            return Err(ConfigError::Invalid {
                place: path.display().to_string(),
                reason: format!("it is larger than {MAX_BYTES} bytes, expected a TOML file"),
            });
        }
        let text = utf8(bytes).map_err(|TextError { place, reason }| ConfigError::Invalid {
            place: place.map_or(path.display().to_string(), |(line, column)| {
                format!("{}:{line}:{column}", path.display())
            }),
            reason: format!("{reason}, expected a TOML file"),
        })?;
        documents.push(Document { origin: Origin::File(path.to_path_buf()), text });
    }
    for set in sets {
        documents.push(Document { origin: Origin::Set(set.clone()), text: set.clone() });
    }
    let mut merged = toml::Table::new();
    for document in &documents {
        // Alone, so that the error has the place in this document.
        toml::from_str::<Config>(&document.text).map_err(|error| document.error(&error))?;
        let table: toml::Table = toml::from_str(&document.text).map_err(|error| document.error(&error))?;
        if table.is_empty() && matches!(document.origin, Origin::Set(_)) {
            let reason = "it sets nothing, expected key=value, such as mask.far_m=0.8".to_owned();
            return Err(ConfigError::Invalid { place: document.place(None), reason });
        }
        merge(&mut merged, table);
    }
    let config: Config = merged.try_into().map_err(|error: toml::de::Error| ConfigError::Invalid {
        place: "configuration".to_owned(),
        reason: error.message().to_owned(),
    })?;
    match out_of_range(&config) {
        None => Ok((config, documents)),
        Some((key, expected)) => Err(refused(&documents, key, &expected)),
    }
}

/// An argument as it was typed, on one line.
fn shown(argument: &str) -> String {
    argument
        .chars()
        .map(|c| if c.is_control() { c.escape_default().to_string() } else { c.to_string() })
        .collect()
}

/// Keys whose range is that of another one, which may be the one that is given.
const BESIDE: [(&str, &str); 2] =
    [("mask.far_m", "mask.near_m"), ("camera.distortion", "camera.distortion_model")];

/// Why the value of a key cannot be used, by the last document that gives it.
fn refused(documents: &[Document], key: &str, expected: &str) -> ConfigError {
    let place_of = |key: &str| documents.iter().rev().find_map(|document| document.place_of(key));
    let own = place_of(key);
    let shown = own.as_ref().filter(|_| key.contains('.')).map(|(_, shown)| format!(" = {shown}"));
    let beside = || BESIDE.iter().find(|(of, _)| *of == key).and_then(|(_, other)| place_of(other));
    let place = own.or_else(beside).map_or_else(|| "configuration".to_owned(), |(place, _)| place);
    let wrong = if key.contains('.') { "out of range" } else { "incomplete" };
    let reason = format!("`{key}`{} is {wrong}, expected {expected}", shown.unwrap_or_default());
    ConfigError::Invalid { place, reason }
}

enum Origin {
    Recording,
    File(PathBuf),
    Set(String),
}

struct Document {
    origin: Origin,
    text: String,
}

impl Document {
    fn place(&self, span: Option<std::ops::Range<usize>>) -> String {
        let before = &self.text[..span.map_or(0, |span| span.start).min(self.text.len())];
        let line = before.matches('\n').count() + 1;
        let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
        match &self.origin {
            Origin::Recording => format!("the configuration in the recording:{line}:{column}"),
            Origin::File(path) => format!("{}:{line}:{column}", path.display()),
            Origin::Set(argument) => format!("--set '{}', column {column}", shown(argument)),
        }
    }

    fn error(&self, error: &toml::de::Error) -> ConfigError {
        let reason = mistake::reason(error, &self.text, &manual::example());
        let hint = match &self.origin {
            // Where it may be for want of quotes.
            Origin::Set(_) if reason.contains("text in quotes") || !reason.starts_with(['`', 'u']) => {
                " (--set takes key=value as TOML; text needs quotes: --set 'service.socket=\"/tmp/s\"')"
            }
            _ => "",
        };
        ConfigError::Invalid { place: self.place(error.span()), reason: format!("{reason}{hint}") }
    }

    /// Where an item stands in the list that `key` is; where that list begins, if it does not.
    fn place_of_item(&self, key: &str, item: &str) -> String {
        self.place(
            mistake::place_of_item(key, item, &self.text).or_else(|| mistake::place_of(key, &self.text)),
        )
    }

    /// Where this document gives `key` its value, and that value as it stands there, if it does.
    fn place_of(&self, key: &str) -> Option<(String, String)> {
        let span = mistake::place_of(key, &self.text)?;
        let shown = mistake::echo(self.text.get(span.clone()).unwrap_or_default());
        Some((self.place(Some(span)), shown))
    }
}

/// Whether this machine knows a user, or a group with `@` before it, by name; a number is one always.
pub(crate) fn is_known(entry: &str) -> bool {
    let group = entry.strip_prefix('@');
    let is_number = group.unwrap_or(entry).parse::<u32>().is_ok();
    is_number
        || match group {
            Some(group) => Group::from_name(group).is_ok_and(|group| group.is_some()),
            None => User::from_name(entry).is_ok_and(|user| user.is_some()),
        }
}

fn merge(into: &mut toml::Table, from: toml::Table) {
    for (key, value) in from {
        match (into.get_mut(&key), value) {
            (Some(toml::Value::Table(mine)), toml::Value::Table(theirs)) => merge(mine, theirs),
            (_, value) => {
                into.insert(key, value);
            }
        }
    }
}
