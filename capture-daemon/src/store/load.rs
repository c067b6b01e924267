//! What is read from the state directory: at the start, and whenever something there has changed.

use std::collections::BTreeSet;
use std::fs;
use std::io;

use super::file::{Signature, blade_name, text};
use super::record::Record;
use super::{Live, Refused, Store, StoreError, shelf};
use crate::mistake::one_line;

/// What reading the folder again has changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Changes {
    /// The library's blades are others.
    pub(crate) library: bool,
    /// Files are refused that were not, or no longer.
    pub(crate) refused: bool,
}

impl Store {
    /// Reads all blades. A file that is no blade stands aside for the newest of its history.
    pub(super) fn load(&mut self) -> io::Result<()> {
        self.clean_up()?;
        self.remember_removed();
        let mut found: Vec<(u64, String)> = Vec::new();
        for name in self.names_on_disk()? {
            let modified = Signature::of(&self.path(&name)).map_or(0, |seen| seen.modified_unix_ns());
            found.push((modified, name));
        }
        // Of two files with one id, the older is the original.
        found.sort();
        for (_, name) in found {
            match self.read(&name) {
                Ok(live) => self.insert(&name, live),
                Err(refused) => {
                    let last_good = self.last_good(&name);
                    let stays = last_good.is_some();
                    tracing::warn!(reason = refused.reason, stays, "a blade's file is refused");
                    self.refused.insert(name.clone(), refused);
                    if let Some(live) = last_good {
                        self.put(&name, live);
                    }
                }
            }
        }
        while self.live.len() > self.capacity {
            let moved = match self.surplus_after(0) {
                Ok(Some(oldest)) => self.archive_blade(&oldest),
                Ok(None) => break,
                Err(error) => Err(error),
            };
            if let Err(error) = moved {
                let names: Vec<String> = self
                    .records()
                    .iter()
                    .skip(self.capacity)
                    .map(|record| record.blade.name().to_owned())
                    .collect();
                tracing::error!(%error, surplus = names.len(), "more blades than a library holds; some are not served");
                for name in names {
                    self.forget(&name);
                }
            }
        }
        Ok(())
    }

    /// Removes what a killed station left half done.
    fn clean_up(&self) -> io::Result<()> {
        for entry in fs::read_dir(self.blades_folder())? {
            let path = entry?.path();
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            if name.starts_with('.') && name.ends_with(".toml.tmp") {
                tracing::debug!(path = %path.display(), "a file that was not finished is removed");
                let _ = fs::remove_file(&path);
            }
        }
        Ok(())
    }

    /// Which captured blades were removed or replaced, so that a looping recording does not bring them back.
    fn remember_removed(&mut self) {
        let history = self.history();
        let names = fs::read_dir(&history).into_iter().flatten().flatten();
        let names = names.filter_map(|entry| entry.file_name().into_string().ok());
        self.removed = names.flat_map(|name| shelf::ids(&history, &name)).collect();
    }

    /// The newest blade in the history of a name; none where that has another name now.
    fn last_good(&self, name: &str) -> Option<Live> {
        let history = self.history();
        let mut versions = shelf::versions(&history, name).take_while(|it| it.renamed_to.is_none());
        let free = versions.find(|version| !self.ids.contains_key(&version.record.blade.id()))?;
        Some(Live { record: free.record, seen: None })
    }

    fn names_on_disk(&self) -> io::Result<Vec<String>> {
        let mut names = Vec::new();
        for entry in fs::read_dir(self.blades_folder())? {
            let file = entry?.file_name();
            // A name that is not UTF-8 gets its reason under the name that it can be shown by.
            names.extend(blade_name(&file.to_string_lossy()).map(str::to_owned));
        }
        Ok(names)
    }

    /// Reads the file of `name`.
    pub(super) fn read(&self, name: &str) -> Result<Live, Refused> {
        let path = self.path(name);
        let shown = one_line(&path);
        let seen = Signature::of(&path).ok();
        let refused = |reason: String, seen| Refused { reason, seen };
        if seen.is_none() && name.contains(char::REPLACEMENT_CHARACTER) {
            let reason = format!(
                "{shown}: the name of this file is not UTF-8 (what is not is shown as {}), expected one that is; rename it",
                char::REPLACEMENT_CHARACTER
            );
            return Err(refused(reason, None));
        }
        let text = text(&path).map_err(|reason| refused(format!("{shown}: {reason}"), seen))?;
        let modified = seen.map_or(0, |seen| seen.modified_unix_ns());
        let record = Record::parse(name, &text, modified)
            .map_err(|error| refused(format!("{shown}:{error}"), seen))?;
        if let Some(other) = self.ids.get(&record.blade.id()).filter(|other| *other != name) {
            let reason = format!(
                "{shown}: its `id` is that of the blade {other:?}, expected one of its own; take the line `id` out of it"
            );
            return Err(refused(reason, None));
        }
        Ok(Live { record, seen })
    }

    /// Puts a blade that was read into the library.
    pub(super) fn insert(&mut self, name: &str, live: Live) {
        self.refused.remove(name);
        self.put(name, live);
    }

    fn put(&mut self, name: &str, live: Live) {
        if let Some(before) = self.live.get(name) {
            self.ids.remove(&before.record.blade.id());
            self.removed.insert(before.record.blade.id());
        }
        self.removed.remove(&live.record.blade.id());
        self.next_sequence =
            self.next_sequence.max(live.record.sequence.map_or(0, |own| own.saturating_add(1)));
        self.ids.insert(live.record.blade.id(), name.to_owned());
        self.live.insert(name.to_owned(), live);
    }

    /// Drops `name` from memory.
    pub(super) fn forget(&mut self, name: &str) {
        if let Some(live) = self.live.remove(name) {
            self.ids.remove(&live.record.blade.id());
        }
        self.refused.remove(name);
    }

    /// Reads what has changed in the folder since it was last read: dropped, edited and removed files.
    ///
    /// # Errors
    /// When the folder cannot be read or is another one; nothing has changed then.
    pub(crate) fn rescan(&mut self) -> Result<Changes, StoreError> {
        self.check_identity()?;
        let folder = self.blades_folder();
        let names = self.names_on_disk().map_err(|source| super::disk(&folder, source))?;
        let on_disk: BTreeSet<&str> = names.iter().map(String::as_str).collect();
        let mut changes = Changes::default();
        let known = self.live.keys().chain(self.refused.keys());
        let gone: BTreeSet<String> = known.filter(|name| !on_disk.contains(name.as_str())).cloned().collect();
        for name in gone {
            changes.refused |= self.refused.contains_key(&name);
            if let Some(live) = self.live.get(&name) {
                changes.library = true;
                let id = live.record.blade.id();
                if let Err(error) = self.remember(&name) {
                    tracing::warn!(%error, "a removed blade is not in its history");
                }
                self.removed.insert(id);
                tracing::info!(name, "a blade's file was removed, and so is the blade");
            }
            self.forget(&name);
        }
        for name in on_disk {
            let seen = Signature::of(&self.path(name)).ok();
            let refused = self.refused.get(name);
            let last = refused
                .map_or_else(|| self.live.get(name).and_then(|live| live.seen), |refused| refused.seen);
            if seen.is_none() || seen != last {
                self.read_again(name, &mut changes);
            }
        }
        Ok(changes)
    }

    fn read_again(&mut self, name: &str, changes: &mut Changes) {
        match self.read(name) {
            Ok(live) => {
                changes.refused |= self.refused.contains_key(name);
                let before = self.live.get(name).map(|before| &before.record);
                if before != Some(&live.record) {
                    changes.library = true;
                    if let Err(refused) = self.make_way(name, &live) {
                        changes.refused = true;
                        tracing::warn!(reason = refused.reason, "a blade's file is refused");
                        self.refused.insert(name.to_owned(), refused);
                        return;
                    }
                    tracing::info!(name, "a blade's file goes live");
                }
                self.insert(name, live);
            }
            Err(refused) => {
                if self.refused.get(name).map(|before| &before.reason) != Some(&refused.reason) {
                    changes.refused = true;
                    let stays = self.live.contains_key(name);
                    tracing::warn!(reason = refused.reason, stays, "a blade's file is refused");
                }
                // From now on the last good one is in memory alone: a restart finds it in the history.
                if let Err(error) = self.remember(name) {
                    tracing::warn!(%error, "the last good blade is not in its history");
                }
                self.refused.insert(name.to_owned(), refused);
            }
        }
    }

    /// Before a file goes live: what it replaces goes to its history, and what it leaves no room for to
    /// the archive.
    fn make_way(&mut self, name: &str, new: &Live) -> Result<(), Refused> {
        match self.live.get(name) {
            Some(before) if !before.record.is_like(&new.record) => {
                if let Err(error) = self.remember(name) {
                    tracing::warn!(%error, "what a file replaces is not in its history");
                }
            }
            Some(_) => {}
            None => {
                let room = self
                    .surplus_after(1)
                    .and_then(|oldest| oldest.map_or(Ok(()), |oldest| self.archive_blade(&oldest)));
                let path = self.path(name);
                room.map_err(|error| Refused {
                    reason: format!("{}: {error}", one_line(&path)),
                    seen: None,
                })?;
            }
        }
        Ok(())
    }
}
