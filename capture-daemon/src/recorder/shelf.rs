//! The folder of recordings: their names, which of them stay, and the room on its disk.
//!
//! ```text
//! <record.directory>/2026-11-23T18-20-26.123Z.mcap           goes when it is old, or there is too much
//!                    2026-11-23T18-20-26.123Z-refused.mcap   the last seconds, saved for a reason
//!                    pinned/NAME.mcap                        stays until it is removed by hand
//! ```

use std::fs::{self, DirBuilder};
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rustix::fs::statvfs;

use super::file::remove;

/// What the files are called behind their names.
const SUFFIX: &str = ".mcap";
/// The folder of those that stay.
const PINNED: &str = "pinned";

/// A recording on disk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Kept {
    /// Its name, without the ending.
    pub(crate) name: String,
    /// Where it is.
    pub(crate) path: PathBuf,
    /// Its size.
    pub(crate) bytes: u64,
    /// When it was last written.
    pub(crate) written: SystemTime,
    /// It does not go by itself.
    pub(crate) is_pinned: bool,
}

/// What is kept of what is recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Limits {
    /// Room on the disk that recordings leave free, bytes.
    pub(crate) reserve_bytes: u64,
    /// All that are not pinned together, bytes.
    pub(crate) max_bytes: u64,
    /// How old one may become; `None`: any age.
    pub(crate) max_age: Option<Duration>,
}

/// The folder.
#[derive(Debug)]
pub(super) struct Shelf {
    folder: PathBuf,
    limits: Limits,
}

impl Shelf {
    pub(super) fn new(folder: PathBuf, limits: Limits) -> Self {
        Self { folder, limits }
    }

    /// Makes the folder where it is not there; the one around it has to be.
    ///
    /// # Errors
    /// When it cannot be made.
    pub(super) fn prepare(&self) -> io::Result<()> {
        for folder in [self.folder.clone(), self.folder.join(PINNED)] {
            match DirBuilder::new().mode(0o750).create(folder) {
                Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
                _ => {}
            }
        }
        Ok(())
    }

    /// A path that nothing has yet, for a recording that begins at a time.
    pub(super) fn path_for(&self, begins: SystemTime, cause: Option<&str>) -> PathBuf {
        let time = humantime::format_rfc3339_millis(begins).to_string().replace(':', "-");
        let cause = cause.map_or_else(String::new, |cause| format!("-{cause}"));
        let named = |more: String| self.folder.join(format!("{time}{cause}{more}{SUFFIX}"));
        let first = named(String::new());
        if first.exists() {
            (2..).map(|n| named(format!("-{n}"))).find(|path| !path.exists()).unwrap_or(first)
        } else {
            first
        }
    }

    /// All recordings, the oldest first.
    pub(super) fn kept(&self) -> Vec<Kept> {
        let folders = [(self.folder.clone(), false), (self.folder.join(PINNED), true)];
        let mut kept: Vec<Kept> = folders
            .iter()
            .flat_map(|(folder, is_pinned)| {
                let entries = fs::read_dir(folder).into_iter().flatten().flatten();
                entries.filter_map(|entry| kept(&entry.path(), *is_pinned))
            })
            .collect();
        kept.sort_by(|a, b| (a.written, &a.name).cmp(&(b.written, &b.name)));
        kept
    }

    /// Room on the disk, bytes.
    ///
    /// # Errors
    /// When the folder is not there.
    pub(super) fn free_bytes(&self) -> io::Result<u64> {
        let disk = statvfs(&self.folder)?;
        Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
    }

    /// Removes what is too old or too much, the oldest first; never a pinned one, nor those of `busy`. What is whole does not go
    /// for a reserve that lacks room.
    ///
    /// # Errors
    /// When one cannot be removed, or there is no room for more than `spare` bytes beyond the reserve then.
    pub(super) fn tidy(&self, busy: &[&Path], spare: u64, now: SystemTime) -> Result<(), String> {
        let told = |error: io::Error| format!("{}: {error}", self.folder.display());
        let mut old: Vec<Kept> = self
            .kept()
            .into_iter()
            .filter(|kept| !kept.is_pinned && !busy.contains(&kept.path.as_path()))
            .collect();
        let busy_bytes: u64 =
            busy.iter().filter_map(|path| fs::metadata(path).ok()).map(|metadata| metadata.len()).sum();
        let mut total = busy_bytes + old.iter().map(|kept| kept.bytes).sum::<u64>();
        let needed = self.limits.reserve_bytes.saturating_add(spare);
        let is_old = |kept: &Kept| {
            let age = now.duration_since(kept.written).unwrap_or_default();
            self.limits.max_age.is_some_and(|max| age > max)
        };
        old.reverse();
        while let Some(kept) = old.pop() {
            if !is_old(&kept) && total <= self.limits.max_bytes {
                break;
            }
            remove(&kept.path).map_err(|error| format!("{}: {error}", kept.path.display()))?;
            total -= kept.bytes;
            tracing::info!(recording = kept.name, bytes = kept.bytes, "an old recording is removed");
        }
        let free_bytes = self.free_bytes().map_err(told)?;
        if free_bytes >= needed {
            return Ok(());
        }
        let [free_mb, needed_mb] = [free_bytes, needed].map(|bytes| bytes as f64 / 1e6);
        Err(format!(
            "{}: {free_mb:.1} MB are free on its disk, expected {needed_mb:.1} (record.reserve_mb); make room there, \
             and see record.max_mb",
            self.folder.display()
        ))
    }

    /// The recording of a name.
    pub(super) fn find(&self, name: &str) -> Option<Kept> {
        let name = name.strip_suffix(SUFFIX).unwrap_or(name);
        self.kept().into_iter().find(|kept| kept.name == name)
    }

    /// Where a recording is to be that is pinned, or no longer.
    pub(super) fn place(&self, kept: &Kept, pinned: bool) -> PathBuf {
        let folder = if pinned { self.folder.join(PINNED) } else { self.folder.clone() };
        folder.join(format!("{}{SUFFIX}", kept.name))
    }
}

fn kept(path: &Path, is_pinned: bool) -> Option<Kept> {
    let name = path.file_name()?.to_str()?.strip_suffix(SUFFIX)?.to_owned();
    let metadata = fs::symlink_metadata(path).ok().filter(fs::Metadata::is_file)?;
    let (bytes, written) = (metadata.len(), metadata.modified().ok()?);
    Some(Kept { name, path: path.to_owned(), bytes, written, is_pinned })
}

#[cfg(test)]
mod tests {
    use super::*;

    const MINUTE: Duration = Duration::from_secs(60);

    /// A shelf with recordings of 1000 bytes, written a minute after each other, the last now.
    fn shelf(limits: Limits, names: &[&str]) -> (tempfile::TempDir, Shelf, SystemTime) {
        let folder = tempfile::tempdir().expect("a folder");
        let shelf = Shelf::new(folder.path().join("recordings"), limits);
        shelf.prepare().expect("room");
        shelf.prepare().expect("it is there");
        let now = SystemTime::now();
        for (name, age) in names.iter().rev().zip(0..) {
            let path = folder.path().join("recordings").join(format!("{name}.mcap"));
            fs::write(&path, [0; 1000]).expect("room");
            let file = fs::File::options().write(true).open(&path).expect("it is ours");
            file.set_modified(now - MINUTE * age).expect("it is ours");
        }
        (folder, shelf, now)
    }

    const ALL: Limits = Limits { reserve_bytes: 0, max_bytes: u64::MAX, max_age: None };

    fn names(shelf: &Shelf) -> Vec<String> {
        shelf.kept().into_iter().map(|kept| kept.name).collect()
    }

    #[test]
    fn the_oldest_go_first_by_age_and_by_size() {
        let (_folder, shelf, now) =
            shelf(Limits { max_age: Some(MINUTE * 2), ..ALL }, &["a", "b", "c", "d", "e"]);
        shelf.tidy(&[], 0, now).expect("room");
        assert_eq!(names(&shelf), ["c", "d", "e"]);
        let shelf = Shelf::new(shelf.folder.clone(), Limits { max_bytes: 2500, ..ALL });
        shelf.tidy(&[], 0, now).expect("room");
        assert_eq!(names(&shelf), ["d", "e"]);
        shelf.tidy(&[], 0, now).expect("room");
        assert_eq!(names(&shelf), ["d", "e"], "no more than needed");
    }

    #[test]
    fn what_is_pinned_or_being_written_stays() {
        let (_folder, shelf, now) = shelf(Limits { max_bytes: 0, ..ALL }, &["a", "b", "c"]);
        let pinned = shelf.find("a").expect("it is there");
        fs::rename(&pinned.path, shelf.place(&pinned, true)).expect("the same disk");
        let busy = shelf.find("b.mcap").expect("it is there");
        shelf.tidy(&[&busy.path], 0, now).expect("room");
        assert_eq!(names(&shelf), ["a", "b"]);
        assert!(shelf.find("a").is_some_and(|kept| kept.is_pinned));
        assert_eq!(shelf.place(&shelf.find("a").expect("it is there"), false), pinned.path);
    }

    #[test]
    fn where_the_reserve_lacks_room_it_is_said_and_nothing_goes() {
        let (_folder, shelf, now) = shelf(Limits { reserve_bytes: u64::MAX / 2, ..ALL }, &["a", "b"]);
        let lacking = shelf.tidy(&[], 0, now).expect_err("no disk is that large");
        assert!(lacking.contains("record.reserve_mb") && lacking.contains("make room"), "{lacking}");
        assert_eq!(names(&shelf), ["a", "b"]);
    }

    #[test]
    fn names_are_times_and_no_file_is_taken_twice() {
        let (_folder, shelf, _) = shelf(ALL, &[]);
        let begins = SystemTime::UNIX_EPOCH + Duration::from_millis(1_700_000_001_033);
        let path = shelf.path_for(begins, Some("refused"));
        assert_eq!(
            path.file_name().and_then(|name| name.to_str()),
            Some("2023-11-14T22-13-21.033Z-refused.mcap")
        );
        fs::write(&path, []).expect("room");
        assert!(shelf.path_for(begins, Some("refused")).ends_with("2023-11-14T22-13-21.033Z-refused-2.mcap"));
    }
}
