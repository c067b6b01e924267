//! Shelves: earlier blades of each name, as numbered files in a folder of that name.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use common::blade::BladeId;
use serde::Deserialize;

use super::file::{SUFFIX, Signature, shift, sync, text, write_as_of};
use super::record::{Record, parse_id};

/// Versions that a shelf keeps of one name.
const KEPT: usize = 16;
/// What stands between the text of a blade and the note on why it is here.
const NOTE: &str = "\n[history]\n";

/// Why a version is on the shelf, where its text alone does not say it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Note {
    renamed_to: String,
}

/// An earlier blade of a name.
#[derive(Clone, Debug)]
pub(crate) struct Version {
    /// Its file.
    pub(super) path: PathBuf,
    /// The text that the blade's own file had.
    pub(super) text: String,
    /// What that text says.
    pub(crate) record: Record,
    /// The name that the blade got instead.
    pub(crate) renamed_to: Option<String>,
    /// When it came onto the shelf, nanoseconds since 1970.
    pub(crate) kept_unix_ns: u64,
    /// When its own file was last changed, nanoseconds since 1970.
    modified_unix_ns: u64,
}

impl Version {
    /// Reads a version of `name`; `None` for what is no blade (any more).
    fn read(name: &str, path: PathBuf) -> Option<Self> {
        let (text, signature) = (text(&path).ok()?, Signature::of(&path).ok()?);
        let noted = text.rsplit_once(NOTE).and_then(|(body, note)| {
            let Note { renamed_to } = toml::from_str(note).ok()?;
            Some((body.to_owned(), renamed_to))
        });
        let (text, renamed_to) = noted.map_or((text, None), |(body, to)| (body, Some(to)));
        let modified_unix_ns = signature.modified_unix_ns();
        let record = Record::parse(name, &text, modified_unix_ns).ok()?;
        let (seconds, nanoseconds) = signature.changed();
        let kept_unix_ns = i128::from(seconds) * 1_000_000_000 + i128::from(nanoseconds);
        let kept_unix_ns = u64::try_from(kept_unix_ns).unwrap_or(0);
        Some(Self { path, text, record, renamed_to, kept_unix_ns, modified_unix_ns })
    }

    /// When its own file was last changed: that stands for the time of its capture, where it does not give one.
    pub(super) fn modified(&self) -> SystemTime {
        UNIX_EPOCH + Duration::from_nanos(self.modified_unix_ns)
    }
}

/// The names that something on a shelf had, in no order.
pub(crate) fn names(shelf: &Path) -> Vec<String> {
    let names = fs::read_dir(shelf).into_iter().flatten().flatten();
    names.filter_map(|entry| entry.file_name().into_string().ok()).collect()
}

/// The numbered files in a shelf's folder for one name, the oldest first.
pub(crate) fn files(shelf: &Path, name: &str) -> Vec<PathBuf> {
    let folder = shelf.join(name);
    let mut numbers: Vec<u64> = fs::read_dir(&folder)
        .into_iter()
        .flatten()
        .filter_map(|entry| entry.ok()?.file_name().to_str()?.strip_suffix(SUFFIX)?.parse().ok())
        .collect();
    numbers.sort_unstable();
    numbers.iter().map(|number| folder.join(numbered(*number))).collect()
}

/// The blades on a shelf that had this name, the newest first, read as they are asked for.
pub(super) fn versions(shelf: &Path, name: &str) -> impl Iterator<Item = Version> {
    files(shelf, name).into_iter().rev().filter_map(move |path| Version::read(name, path))
}

/// The newest blade on a shelf of this name, if it has the name still.
pub(crate) fn newest_of_name(shelf: &Path, name: &str) -> Option<Version> {
    versions(shelf, name).next().filter(|newest| newest.renamed_to.is_none())
}

/// The ids that the captured blades on a shelf say that they have, in no order.
pub(super) fn ids(shelf: &Path, name: &str) -> Vec<BladeId> {
    let id = |path: PathBuf| {
        let text = text(&path).ok()?;
        text.lines().find_map(|line| parse_id(line.strip_prefix("id = \"")?.strip_suffix('"')?))
    };
    files(shelf, name).into_iter().filter_map(id).collect()
}

fn numbered(number: u64) -> String {
    format!("{number:06}{SUFFIX}")
}

/// Where the next version of `name` goes on a shelf; makes its folder.
fn next_version(shelf: &Path, name: &str) -> io::Result<(PathBuf, String)> {
    let folder = shelf.join(name);
    if !folder.is_dir() {
        fs::create_dir_all(&folder)?;
        sync(shelf)?;
    }
    let newest = files(shelf, name).pop();
    let newest = newest.and_then(|path| path.file_stem()?.to_str()?.parse::<u64>().ok()).unwrap_or(0);
    Ok((folder, numbered(newest + 1)))
}

/// Moves the file of `name` onto a shelf, as its newest version there. Gives its new path.
///
/// # Errors
/// When the system refuses; then the file is where it was.
pub(super) fn shelve(shelf: &Path, name: &str, file: &Path) -> io::Result<PathBuf> {
    let (folder, version) = next_version(shelf, name)?;
    let to = folder.join(version);
    shift(file, &to)?;
    thin_out(shelf, name);
    Ok(to)
}

/// Writes the text of a blade's file onto a shelf, as the newest version of `name` there. `modified`: when that
/// file was last changed; `renamed_to`: the name that the blade has instead.
///
/// # Errors
/// When the system refuses.
pub(super) fn shelve_text(
    shelf: &Path,
    name: &str,
    text: &str,
    modified: Option<SystemTime>,
    renamed_to: Option<&str>,
) -> io::Result<()> {
    let note = renamed_to.map(|to| format!("{NOTE}renamed_to = {}\n", toml::Value::from(to)));
    let text = format!("{text}{}", note.unwrap_or_default());
    if files(shelf, name).pop().is_some_and(|newest| fs::read(newest).is_ok_and(|is| is == text.as_bytes())) {
        return Ok(());
    }
    let (folder, version) = next_version(shelf, name)?;
    write_as_of(&folder, &version, text.as_bytes(), modified)?;
    thin_out(shelf, name);
    Ok(())
}

/// Forgets versions beyond the number that a shelf keeps: first those whose shape a newer one has too, so that
/// a weight that is tried out over and over does not push out what looks different; then the oldest.
fn thin_out(shelf: &Path, name: &str) {
    let files = files(shelf, name);
    let surplus = files.len().saturating_sub(KEPT);
    if surplus == 0 {
        return;
    }
    let shape = |path: PathBuf| {
        let version = Version::read(name, path.clone());
        (path, version.map(|version| version.record.blade.knots().to_vec()))
    };
    let mut shelved: Vec<_> = files.into_iter().map(shape).collect();
    for _ in 0..surplus {
        let is_repeated = |index: usize| {
            let (_, shape) = &shelved[index];
            shape.is_some() && shelved[index + 1..].iter().any(|(_, newer)| newer == shape)
        };
        let (path, _) = shelved.remove((0..shelved.len()).find(|index| is_repeated(*index)).unwrap_or(0));
        if let Err(error) = fs::remove_file(&path) {
            tracing::debug!(path = %path.display(), %error, "an old version stays");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `height`: decimetres.
    fn blade(height: usize, mix: usize) -> String {
        let height_m = height as f32 / 10.0;
        format!(
            "format = 1\nmix = {mix}.0\nknots = [\n  {{ position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004] }},\n  {{ position_m = [0.0, {height_m:?}, 0.0], half_width_m = [0.0, 0.0] }},\n]\n"
        )
    }

    /// Length in decimetres and weight of what is on the shelf, the oldest first.
    fn kept(folder: &Path) -> Vec<(usize, usize)> {
        let mut kept: Vec<_> = versions(folder, "fern")
            .map(|Version { record, .. }| {
                ((10.0 * record.blade.length_m()).round() as usize, record.blade.mix() as usize)
            })
            .collect();
        kept.reverse();
        kept
    }

    #[test]
    fn a_shelf_keeps_the_newest_versions_in_order() {
        let folder = tempfile::tempdir().expect("a folder");
        for height in 1..=KEPT + 3 {
            shelve_text(folder.path(), "fern", &blade(height, 1), None, None).expect("room");
        }
        shelve_text(folder.path(), "fern", &blade(KEPT + 3, 1), None, None).expect("room");
        let expected: Vec<_> = (4..=KEPT + 3).map(|height| (height, 1)).collect();
        assert_eq!(kept(folder.path()), expected, "the same text twice is one version");
    }

    #[test]
    fn weights_that_are_tried_out_push_out_no_shape() {
        let folder = tempfile::tempdir().expect("a folder");
        for height in 1..=3 {
            shelve_text(folder.path(), "fern", &blade(height, 1), None, None).expect("room");
        }
        for mix in 2..60 {
            shelve_text(folder.path(), "fern", &blade(3, mix), None, None).expect("room");
        }
        let kept = kept(folder.path());
        assert_eq!((kept.len(), kept[0], kept[1]), (KEPT, (1, 1), (2, 1)), "{kept:?}");
        assert_eq!(kept.last(), Some(&(3, 59)));
    }

    #[test]
    fn a_version_keeps_its_text_its_time_and_the_note_beside_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let modified = UNIX_EPOCH + Duration::from_secs(5000);
        // What reads like a note is the blade's own where it is none.
        let own = format!("{}\n[history]\nrenamed_to = 7\n", blade(1, 1));
        for text in [blade(2, 1).trim_end(), &blade(2, 1)] {
            let to = "mo\"ss";
            shelve_text(folder.path(), "fern", text, Some(modified), Some(to)).expect("room");
            let version = versions(folder.path(), "fern").next().expect("it is there");
            assert_eq!((&*version.text, version.renamed_to.as_deref()), (text, Some(to)));
            assert_eq!(
                (version.modified(), version.record.blade.captured_unix_ns()),
                (modified, 5000 * 1_000_000_000)
            );
            assert!(version.kept_unix_ns > version.modified_unix_ns);
        }
        shelve_text(folder.path(), "fern", &own, None, None).expect("room");
        assert_eq!(versions(folder.path(), "fern").count(), 2, "that is no blade");
    }
}
