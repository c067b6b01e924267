//! Files that are there whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::record::place;

/// How the name of a blade's file ends.
pub(crate) const SUFFIX: &str = ".toml";
/// A blade's file is no longer than this: 64 knots take less than a tenth of it.
pub(crate) const MAX_BYTES: u64 = 256 * 1024;

/// What tells one version of a file from the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Signature {
    inode: u64,
    bytes: u64,
    modified: (i64, i64),
    changed: (i64, i64),
}

impl Signature {
    /// The signature of the file at `path`, symbolic links followed.
    ///
    /// # Errors
    /// When it cannot be looked at.
    pub(crate) fn of(path: &Path) -> io::Result<Self> {
        let metadata = fs::metadata(path)?;
        Ok(Self {
            inode: metadata.ino(),
            bytes: metadata.size(),
            modified: (metadata.mtime(), metadata.mtime_nsec()),
            changed: (metadata.ctime(), metadata.ctime_nsec()),
        })
    }

    /// When the file was last changed or moved, seconds and nanoseconds since 1970.
    pub(crate) fn changed(&self) -> (i64, i64) {
        self.changed
    }

    /// When the file's content was last changed, nanoseconds since 1970.
    pub(crate) fn modified_unix_ns(&self) -> u64 {
        let (seconds, nanoseconds) = self.modified;
        u64::try_from(i128::from(seconds) * 1_000_000_000 + i128::from(nanoseconds)).unwrap_or(0)
    }
}

/// Puts `bytes` at `folder/name` so that whoever looks, and whatever fails meanwhile, finds either the
/// file that was there before or this one whole; on disk when this returns.
///
/// # Errors
/// When the disk is full or refuses; then nothing has changed, or (the folder could not be synced) the
/// new file is there but may not outlast a power failure.
pub(crate) fn write_atomically(folder: &Path, name: &str, bytes: &[u8]) -> io::Result<()> {
    write_as_of(folder, name, bytes, None)
}

/// The same, for a file that is to have been changed last at another time than now.
///
/// # Errors
/// As [`write_atomically`].
pub(crate) fn write_as_of(
    folder: &Path,
    name: &str,
    bytes: &[u8],
    modified: Option<SystemTime>,
) -> io::Result<()> {
    let temporary = folder.join(format!(".{name}.tmp"));
    let written = (|| {
        let mut file = OpenOptions::new().write(true).create(true).truncate(true).open(&temporary)?;
        file.write_all(bytes)?;
        modified.map_or(Ok(()), |modified| file.set_modified(modified))?;
        file.sync_all()?;
        fs::rename(&temporary, folder.join(name))
    })();
    if let Err(error) = written {
        // What was begun takes room; where it cannot be removed either, the next start does.
        let _ = fs::remove_file(&temporary);
        return Err(error);
    }
    sync(folder)
}

/// Puts a folder's entries on disk.
///
/// # Errors
/// When the system refuses.
pub(crate) fn sync(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// Moves a file to another folder, where nothing of that name is yet; on disk when this returns.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`] when something is, or the system refuses; then nothing has changed.
pub(crate) fn shift(from: &Path, to: &Path) -> io::Result<()> {
    let folder = |path: &Path| path.parent().map_or_else(|| PathBuf::from("."), Path::to_path_buf);
    let flags = rustix::fs::RenameFlags::NOREPLACE;
    rustix::fs::renameat_with(rustix::fs::CWD, from, rustix::fs::CWD, to, flags)?;
    sync(&folder(to))?;
    if folder(from) != folder(to) {
        sync(&folder(from))?;
    }
    Ok(())
}

/// Moves a file within its folder, over one that may be there; on disk when this returns.
///
/// # Errors
/// When the system refuses; then nothing has changed.
pub(crate) fn supplant(from: &Path, to: &Path) -> io::Result<()> {
    fs::rename(from, to)?;
    to.parent().map_or(Ok(()), sync)
}

/// The text of a blade's file, which is no device or pipe and not too long.
///
/// # Errors
/// When it is not such a file or cannot be read.
pub(crate) fn text(path: &Path) -> Result<String, TextError> {
    let whole = |reason: String| TextError { place: None, reason };
    let unreadable = |error: io::Error| whole(format!("it cannot be read: {error}"));
    if !fs::metadata(path).map_err(unreadable)?.is_file() {
        return Err(whole("it is not a regular file, expected a TOML file".to_owned()));
    }
    let mut bytes = Vec::new();
    File::open(path).map_err(unreadable)?.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(whole(format!("it is larger than {MAX_BYTES} bytes, expected a TOML file")));
    }
    utf8(bytes)
        .map_err(|error| TextError { reason: format!("{}, expected a TOML file", error.reason), ..error })
}

/// Why a file is no text: one sentence without its full stop, behind its file's path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct TextError {
    /// Line, from 1, and column in characters, from 1, where there is one.
    pub(crate) place: Option<(usize, usize)>,
    /// What is wrong.
    pub(crate) reason: String,
}

impl std::fmt::Display for TextError {
    /// To be put directly behind the file's path.
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.place {
            Some((line, column)) => write!(to, ":{line}:{column}: {}", self.reason),
            None => write!(to, ": {}", self.reason),
        }
    }
}

/// Bytes as the text that they are.
///
/// # Errors
/// When they are none, with the place of the first that is not.
pub(crate) fn utf8(bytes: Vec<u8>) -> Result<String, TextError> {
    String::from_utf8(bytes).map_err(|error| {
        let good = error.utf8_error().valid_up_to();
        let before = String::from_utf8_lossy(&error.as_bytes()[..good]);
        let place = Some(place(&before, good));
        TextError { place, reason: format!("the byte {:#04x} is not UTF-8 text", error.as_bytes()[good]) }
    })
}

/// The name of the blade in a file of this name; `None` for what is no blade's file.
pub(crate) fn blade_name(file_name: &str) -> Option<&str> {
    file_name.strip_suffix(SUFFIX).filter(|name| !name.is_empty() && !name.starts_with('.'))
}

/// Makes a folder, in one that is there, and puts it on disk.
///
/// # Errors
/// When the folder around it is not there, with what to do; or the system refuses.
pub(crate) fn make_folder(folder: &Path) -> io::Result<()> {
    if folder.is_dir() {
        return Ok(());
    }
    let parent = folder.parent().filter(|parent| !parent.as_os_str().is_empty());
    // A path that was mistyped, or a disk that is not mounted, is not made into a folder on the wrong disk.
    if let Some(parent) = parent.filter(|parent| !parent.exists()) {
        let reason =
            format!("there is no folder {} to make it in; make that, or mount its disk", parent.display());
        return Err(io::Error::new(io::ErrorKind::NotFound, reason));
    }
    fs::create_dir(folder)?;
    parent.map_or(Ok(()), sync)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_whole_and_nothing_else_is_left() {
        let folder = tempfile::tempdir().expect("a folder");
        write_atomically(folder.path(), "a.toml", b"one").expect("room");
        write_atomically(folder.path(), "a.toml", b"two").expect("room");
        assert_eq!(fs::read(folder.path().join("a.toml")).expect("there"), b"two");
        assert_eq!(fs::read_dir(folder.path()).expect("there").count(), 1);
        assert!(write_atomically(&folder.path().join("lost"), "a.toml", b"three").is_err());
    }

    #[test]
    fn a_file_is_not_moved_over_another() {
        let folder = tempfile::tempdir().expect("a folder");
        let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
        fs::write(&a, "a").expect("room");
        fs::write(&b, "b").expect("room");
        assert_eq!(shift(&a, &b).map_err(|error| error.kind()), Err(io::ErrorKind::AlreadyExists));
        assert_eq!((text(&a).as_deref(), text(&b).as_deref()), (Ok("a"), Ok("b")));
    }

    #[test]
    fn a_folder_is_made_in_one_that_is_there_only() {
        let place = tempfile::tempdir().expect("a folder");
        let nowhere = place.path().join("nowhere");
        let refused = make_folder(&nowhere.join("sward")).expect_err("its parent is missing").to_string();
        assert!(refused.contains(&nowhere.display().to_string()) && refused.contains("mount"), "{refused}");
        assert!(!nowhere.exists());
        make_folder(&nowhere).expect("its parent is there");
        make_folder(&nowhere.join("sward")).expect("now it is");
        make_folder(&nowhere.join("sward")).expect("it is there already");
    }

    #[test]
    fn what_is_no_file_of_text_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let refused = |path: &Path| text(path).expect_err("no text").to_string();
        assert!(refused(folder.path()).contains(": it is not a regular file"));
        let path = folder.path().join("a");
        fs::write(&path, b"a = 1\nb\xc3\xa9 \xff = 2\n").expect("room");
        assert!(refused(&path).starts_with(":2:4: the byte 0xff is not UTF-8"), "{}", refused(&path));
        fs::write(&path, vec![b' '; MAX_BYTES as usize + 1]).expect("room");
        assert!(refused(&path).contains("larger"));
    }
}
