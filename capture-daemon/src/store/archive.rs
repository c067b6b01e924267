//! The archive: blades that had to make room in a full library. It holds so many at most, and the oldest go.

use std::fs;
use std::path::{Path, PathBuf};

use super::file::Signature;
use super::shelf;

/// The folder `archive/` of a state directory.
#[derive(Debug)]
pub(super) struct Archive {
    folder: PathBuf,
    /// Blades that it holds at most.
    limit: usize,
    /// It holds no more than this.
    bound: usize,
}

impl Archive {
    /// `limit`: blades that it holds at most.
    pub(super) fn new(folder: PathBuf, limit: usize) -> Self {
        Self { folder, limit, bound: 0 }
    }

    /// Where it is.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Takes note of a blade that came.
    pub(super) fn note(&mut self) {
        self.bound += 1;
        if self.bound > self.limit {
            self.thin_out();
        }
    }

    /// Where there are too many blades, deletes those that came first; a thirtieth more than need be, so that not
    /// each one that comes has the folder read, which is O(blades in it).
    pub(super) fn thin_out(&mut self) {
        let mut files = files(&self.folder);
        self.bound = files.len();
        if files.len() <= self.limit {
            return;
        }
        let surplus = files.len() - self.limit + self.limit / 30;
        // Moving a file sets this time on it, whatever its own.
        files.sort_by_cached_key(|path| (Signature::of(path).map(|seen| seen.changed()).ok(), path.clone()));
        let mut deleted = 0;
        for path in &files[..surplus] {
            match fs::remove_file(path) {
                Ok(()) => deleted += 1,
                Err(error) => tracing::warn!(path = %path.display(), %error, "an archived blade stays"),
            }
            // Goes only when nothing is left of that name.
            let _ = path.parent().map(fs::remove_dir);
        }
        self.bound -= deleted;
        let limit = self.limit;
        tracing::warn!(
            deleted,
            limit,
            "the archive is full (store.archive_max): its oldest blades are deleted"
        );
    }
}

/// Every blade's file in an archive, in no order.
pub(crate) fn files(folder: &Path) -> Vec<PathBuf> {
    let names = fs::read_dir(folder).into_iter().flatten().flatten();
    names.flat_map(|name| shelf::files(folder, &name.file_name().to_string_lossy())).collect()
}
