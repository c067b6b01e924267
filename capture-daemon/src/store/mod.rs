//! Blades on disk: one readable file each in the state directory, and what became of earlier ones.
//!
//! ```text
//! <directory>/blades/NAME.toml            what the library holds
//!             history/NAME/000001.toml    earlier blades of a name: replaced, weighted otherwise, renamed, removed
//!             archive/NAME/000001.toml    what had to go when the library was full, up to `store.archive_max`
//!             generation                  above every generation that was announced
//! ```
//!
//! Goals: a blade that was announced is on disk, whole, whatever is killed when; people edit, drop and
//! remove files with whatever they like; the last good blade of a name stays until a better one comes or
//! it is removed. Non-goals: several stations on one directory (it is locked).
//!
//! The store knows no clock, thread or channel: the keeper's thread gives it its turns.

pub(crate) mod archive;
pub(crate) mod file;
pub(crate) mod generation;
mod load;
pub(crate) mod orders;
pub mod record;
pub(crate) mod shelf;

use std::collections::{BTreeMap, HashMap, HashSet};
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use common::blade::{Blade, BladeId};
use common::library::layout::MAX_BLADES;

use archive::Archive;
use file::{SUFFIX, Signature, make_folder, write_atomically};
use generation::Generation;
use record::Record;

use crate::mistake::one_line;

/// A blade that the library holds.
#[derive(Clone, Debug)]
pub(crate) struct Live {
    /// The blade.
    pub(crate) record: Record,
    /// The file it was read from; `None` when the file is another by now.
    seen: Option<Signature>,
}

/// A file that is no blade.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Refused {
    /// File, line, column and what is wrong; no full stop.
    pub(crate) reason: String,
    /// The file it was read from; `None` when it is to be looked at again.
    seen: Option<Signature>,
}

/// Why a store cannot be opened.
#[derive(Debug, thiserror::Error)]
pub(crate) enum OpenError {
    /// Another station has it.
    #[error(
        "{0}: the state directory is in use by another station, expected one of its own; stop the other station or set store.directory to another path"
    )]
    InUse(String),
    /// What stands there cannot be read.
    #[error(
        "{path}: the state directory cannot be read: {source}; check its owner and mode, or set store.directory to another path"
    )]
    Io {
        /// The directory.
        path: String,
        /// What the system said.
        source: io::Error,
    },
}

/// Why something was not done.
#[derive(Debug, thiserror::Error)]
pub(crate) enum StoreError {
    /// No blade of this name.
    #[error("there is no blade {0:?}; `sward-capture blades list` shows what there is")]
    NotFound(String),
    /// Something of this name is there already.
    #[error("the name {0:?} is taken; rename or remove that blade first, or choose another name")]
    Taken(String),
    /// No blade may be called that.
    #[error("{0}")]
    Name(String),
    /// A weight out of its range.
    #[error("the mix weight is {0:?}, expected 0, or a number of 1e-30 to 1000000")]
    Mix(f64),
    /// There is nothing to go back to.
    #[error("there is no earlier blade of the name {0:?} to go back to")]
    NoHistory(String),
    /// The file was edited and is not valid (or not read yet).
    #[error("{reason}; mend or remove the file first")]
    Refused {
        /// File and reason.
        reason: String,
    },
    /// Every blade is pinned.
    #[error(
        "the library is full: all {MAX_BLADES} blades are pinned; remove one, or set `pinned = false` in a file"
    )]
    AllPinned,
    /// The disk is full, read-only or broken.
    #[error("{path}: {source}")]
    Disk {
        /// What was to be written.
        path: String,
        /// What the system said.
        source: io::Error,
    },
}

/// What became of a captured blade.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kept {
    /// It is on disk and in the library.
    New,
    /// It was there before, or someone has removed or replaced it: a looping recording shows it again.
    Known,
}

/// The blades of a state directory.
#[derive(Debug)]
pub(crate) struct Store {
    folder: PathBuf,
    /// Held while the store is open.
    lock: Option<OwnedFd>,
    /// Device and inode of `blades/`: another folder there is not an empty library.
    identity: Option<(u64, u64)>,
    /// That folder is gone, and what it held is in the history.
    is_remembered: bool,
    live: BTreeMap<String, Live>,
    refused: BTreeMap<String, Refused>,
    ids: HashMap<BladeId, String>,
    /// Blades that someone removed or replaced.
    removed: HashSet<BladeId>,
    generation: Generation,
    next_sequence: u64,
    capacity: usize,
    archive: Archive,
}

impl Store {
    /// Opens `folder`, makes it where it is not there yet, and reads all blades. `now_us`: the clock,
    /// microseconds since 1970. `archive_max`: blades that the archive holds at most.
    ///
    /// A folder that cannot be made or written is no error: what can be read is served, and
    /// [`Self::prepare`] tries again.
    ///
    /// # Errors
    /// When another station has it, or what is there cannot be read.
    pub(crate) fn open(folder: &Path, now_us: u64, archive_max: usize) -> Result<Self, OpenError> {
        Self::open_with(folder, now_us, MAX_BLADES, archive_max)
    }

    /// The same with room for `capacity` blades.
    fn open_with(folder: &Path, now_us: u64, capacity: usize, archive_max: usize) -> Result<Self, OpenError> {
        let mut store = Self {
            folder: folder.to_path_buf(),
            lock: None,
            identity: None,
            is_remembered: false,
            live: BTreeMap::new(),
            refused: BTreeMap::new(),
            ids: HashMap::new(),
            removed: HashSet::new(),
            generation: Generation::open(folder, now_us),
            next_sequence: 1,
            capacity,
            archive: Archive::new(folder.join("archive"), archive_max),
        };
        if let Err(error) = store.make_folders() {
            tracing::warn!(
                %error,
                "the store cannot be written, and captured blades wait until it can; make room there, or set store.directory to a folder that may be written"
            );
        }
        store.attach()?;
        Ok(store)
    }

    /// Locks and reads the folder, once it is there.
    fn attach(&mut self) -> Result<(), OpenError> {
        self.lock()?;
        if self.identity.is_none() && self.blades_folder().is_dir() {
            let path = self.folder.display().to_string();
            self.load().map_err(|source| OpenError::Io { path: path.clone(), source })?;
            let found = std::fs::metadata(self.blades_folder());
            let found = found.map_err(|source| OpenError::Io { path, source })?;
            self.identity = Some((found.dev(), found.ino()));
            self.archive.thin_out();
        }
        Ok(())
    }

    fn lock(&mut self) -> Result<(), OpenError> {
        if self.lock.is_some() || !self.folder.is_dir() {
            return Ok(());
        }
        let path = || self.folder.display().to_string();
        let folder: OwnedFd = std::fs::File::open(&self.folder)
            .map_err(|source| OpenError::Io { path: path(), source })?
            .into();
        match rustix::fs::flock(&folder, rustix::fs::FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(rustix::io::Errno::WOULDBLOCK) => return Err(OpenError::InUse(path())),
            // Some file systems know no locks; then whoever starts two stations has to know.
            Err(error) => tracing::debug!(%error, "the state directory cannot be locked"),
        }
        self.lock = Some(folder);
        Ok(())
    }

    /// `blades/`, which people write to.
    pub(crate) fn blades_folder(&self) -> PathBuf {
        self.folder.join("blades")
    }

    fn history(&self) -> PathBuf {
        self.folder.join("history")
    }

    fn path(&self, name: &str) -> PathBuf {
        self.blades_folder().join(format!("{name}{SUFFIX}"))
    }

    fn make_folders(&self) -> Result<(), StoreError> {
        for folder in
            [self.folder.clone(), self.blades_folder(), self.history(), self.archive.folder().to_path_buf()]
        {
            // One that was there and is gone was unmounted or moved: an empty one in its place would
            // hide what it holds.
            if self.identity.is_some() && folder == self.blades_folder() {
                continue;
            }
            if std::fs::metadata(&folder).is_ok_and(|found| !found.is_dir()) {
                let told = "it is a file; expected a folder, or nothing";
                return Err(disk(&folder, io::Error::new(io::ErrorKind::NotADirectory, told)));
            }
            make_folder(&folder).map_err(|source| disk(&folder, source))?;
        }
        Ok(())
    }

    /// Sees to it that the next generation may be announced: makes what is missing of the folders and
    /// sets generations aside.
    ///
    /// # Errors
    /// When the disk is full, read-only or gone, or another station took the directory meanwhile.
    pub(crate) fn prepare(&mut self) -> Result<(), StoreError> {
        self.make_folders()?;
        self.attach().map_err(|error| disk(&self.folder, io::Error::other(error.to_string())))?;
        self.check_identity()?;
        self.generation.reserve(&self.folder).map_err(|source| disk(&self.folder, source))
    }

    /// Whether the disk takes a file again.
    ///
    /// # Errors
    /// When it does not.
    pub(crate) fn probe(&mut self) -> Result<(), StoreError> {
        self.prepare()?;
        let bytes = vec![b'#'; 16 * 1024];
        write_atomically(&self.folder, ".probe", &bytes).map_err(|source| disk(&self.folder, source))?;
        std::fs::remove_file(self.folder.join(".probe")).map_err(|source| disk(&self.folder, source))
    }

    /// The folder of blades is the one that was opened.
    fn check_identity(&self) -> Result<(), StoreError> {
        let folder = self.blades_folder();
        let found = std::fs::metadata(&folder).map_err(|source| disk(&folder, source))?;
        if self.identity == Some((found.dev(), found.ino())) {
            return Ok(());
        }
        let reason =
            "it is another folder than when the station started; put it back, or restart the station";
        Err(disk(&folder, io::Error::other(reason)))
    }

    /// The next generation.
    pub(crate) fn next_generation(&mut self) -> u64 {
        self.generation.next()
    }

    /// The blades in the library's order.
    pub(crate) fn records(&self) -> Vec<&Record> {
        let mut records: Vec<&Record> = self.live.values().map(|live| &live.record).collect();
        records.sort_by(|a, b| a.order().cmp(&b.order()));
        records
    }

    /// Copies of the blades in the library's order.
    pub(crate) fn blades(&self) -> Vec<Blade> {
        self.records().into_iter().map(|record| record.blade.clone()).collect()
    }

    /// Files that are no blades: name and reason.
    pub(crate) fn refused(&self) -> &BTreeMap<String, Refused> {
        &self.refused
    }

    /// Whether the library holds nothing.
    pub(crate) fn is_empty(&self) -> bool {
        self.live.is_empty()
    }

    /// Every blade that [`Self::keep`] takes for known.
    pub(crate) fn known(&self) -> impl Iterator<Item = BladeId> {
        self.ids.keys().chain(&self.removed).copied()
    }

    /// What the blade with this id is called, if the library holds it.
    pub(crate) fn name_of(&self, id: BladeId) -> Option<&str> {
        self.ids.get(&id).map(String::as_str)
    }

    /// Whether a captured blade was removed or replaced, so that [`Self::keep`] does not take it again.
    pub(crate) fn is_removed(&self, id: BladeId) -> bool {
        self.removed.contains(&id)
    }

    /// Puts a captured blade on disk and into the library; the oldest blade that is not pinned makes
    /// room for it.
    ///
    /// # Errors
    /// When it is not on disk; nothing has changed then.
    pub(crate) fn keep(&mut self, captured: &Record) -> Result<Kept, StoreError> {
        let id = captured.blade.id();
        if self.ids.contains_key(&id) || self.removed.contains(&id) {
            return Ok(Kept::Known);
        }
        self.check_identity()?;
        let name = self.free_name(&captured.blade)?;
        let oldest = self.surplus_after(1)?;
        let record = Record { sequence: Some(self.next_sequence), ..captured.clone() };
        let file = format!("{name}{SUFFIX}");
        if let Err(source) = write_atomically(&self.blades_folder(), &file, record.to_toml().as_bytes()) {
            // Where only the folder could not be synced, it would be taken for somebody's copy later.
            let _ = std::fs::remove_file(self.path(&name));
            return Err(disk(&self.path(&name), source));
        }
        if let Some(oldest) = oldest
            && let Err(error) = self.archive_blade(&oldest)
        {
            // There is no room in the library: the new one has to wait.
            std::fs::remove_file(self.path(&name)).map_err(|source| disk(&self.path(&name), source))?;
            return Err(error);
        }
        self.take_up(&name)?;
        Ok(Kept::New)
    }

    /// A name for a captured blade that no other has: its own, or more of its id.
    fn free_name(&self, blade: &Blade) -> Result<String, StoreError> {
        let id = blade.id().to_string();
        let longer = [12, 16, 32].map(|digits| format!("blade-{}", &id[..digits]));
        let mut names = std::iter::once(blade.name().to_owned()).chain(longer);
        let free = names.find(|name| !self.is_taken(name));
        free.ok_or_else(|| StoreError::Taken(blade.name().to_owned()))
    }

    fn is_taken(&self, name: &str) -> bool {
        self.live.contains_key(name)
            || self.refused.contains_key(name)
            || self.path(name).symlink_metadata().is_ok()
    }

    /// The blade that has to go when `more` come; `None` while there is room.
    fn surplus_after(&self, more: usize) -> Result<Option<String>, StoreError> {
        if self.live.len() + more <= self.capacity {
            return Ok(None);
        }
        let oldest = self.records().into_iter().find(|record| !record.pinned);
        oldest.map(|record| Some(record.blade.name().to_owned())).ok_or(StoreError::AllPinned)
    }

    fn archive_blade(&mut self, name: &str) -> Result<(), StoreError> {
        let path = self.path(name);
        let to = shelf::shelve(self.archive.folder(), name, &path).map_err(|source| disk(&path, source))?;
        tracing::warn!(name, to = %to.display(), "the library is full: its oldest blade goes to the archive");
        self.forget(name);
        self.archive.note();
        Ok(())
    }

    /// Reads the file of `name`, which this store has just written or moved.
    fn take_up(&mut self, name: &str) -> Result<(), StoreError> {
        match self.read(name) {
            Ok(live) => {
                self.insert(name, live);
                Ok(())
            }
            Err(refused) => {
                let reason = refused.reason.clone();
                self.refused.insert(name.to_owned(), refused);
                Err(StoreError::Refused { reason })
            }
        }
    }
}

fn disk(path: &Path, source: io::Error) -> StoreError {
    StoreError::Disk { path: one_line(path), source }
}

impl StoreError {
    /// Whether it may go away by itself, when there is room.
    pub(crate) fn is_disk(&self) -> bool {
        matches!(self, Self::Disk { .. } | Self::AllPinned)
    }
}

#[cfg(test)]
mod tests;
