//! What is read from the state directory: at the start, and whenever something there has changed.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;

use common::blade::BladeId;

use super::file::{SUFFIX, Signature, blade_name, text, write_as_of};
use super::record::{Record, made_id};
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
        self.removed = shelf::names(&history).iter().flat_map(|name| shelf::ids(&history, name)).collect();
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
        let text = text(&path).map_err(|error| refused(format!("{shown}{error}"), seen))?;
        let modified = seen.map_or(0, |seen| seen.modified_unix_ns());
        let record = Record::parse(name, &text, modified)
            .map_err(|error| refused(format!("{shown}:{error}"), seen))?;
        let Some(own) = self.with_own_id(name, &text, &record) else { return Ok(Live { record, seen }) };
        // Somebody copied a blade's file.
        let modified_at = fs::metadata(&path).and_then(|metadata| metadata.modified()).ok();
        let written =
            write_as_of(&self.blades_folder(), &format!("{name}{SUFFIX}"), own.as_bytes(), modified_at);
        if let Err(error) = written {
            let line = 1 + text.lines().take_while(|line| !line.trim_start().starts_with("id")).count();
            let reason = format!(
                "{shown}:{line}:1: its `id` is that of another blade, expected one of its own, which cannot be written \
                 to it: {error}; take the line out"
            );
            return Err(refused(reason, None));
        }
        tracing::info!(name, "a copy of another blade's file gets an id of its own");
        let record =
            Record::parse(name, &own, modified).map_err(|error| refused(format!("{shown}:{error}"), seen))?;
        Ok(Live { record, seen: Signature::of(&path).ok() })
    }

    /// The text of a blade's file with another `id`, where another blade has that one; all else in it stays as it is.
    pub(super) fn with_own_id(&self, name: &str, text: &str, record: &Record) -> Option<String> {
        let is_others = |id: BladeId| self.ids.get(&id).is_some_and(|other| other != name);
        if !is_others(record.blade.id()) {
            return None;
        }
        let mut document: toml_edit::DocumentMut = text.parse().ok()?;
        let id =
            (0..).map(|number| made_id(name, number, record.blade.knots())).find(|id| !is_others(*id))?;
        let mut value = toml_edit::Value::from(id.to_string());
        if let Some(before) = document.get("id").and_then(toml_edit::Item::as_value) {
            *value.decor_mut() = before.decor().clone();
        }
        document["id"] = toml_edit::Item::Value(value);
        Some(document.to_string())
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
        let identity = self.check_identity();
        if identity.is_err() {
            self.remember_all();
        }
        identity?;
        self.is_remembered = false;
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

    /// Puts every blade into its history, once: their folder is gone or another one, and with the next start they are
    /// no more than that. Not where the whole state directory is gone, as a disk that was unmounted.
    fn remember_all(&mut self) {
        let identity = |metadata: io::Result<fs::Metadata>| metadata.map(|it| (it.dev(), it.ino())).ok();
        let opened = self.lock.as_ref().and_then(|folder| rustix::fs::fstat(folder).ok());
        let opened = opened.map(|stat| (stat.st_dev, stat.st_ino));
        if self.is_remembered || opened.is_none() || identity(fs::metadata(&self.folder)) != opened {
            return;
        }
        self.is_remembered = true;
        let names: Vec<&String> = self.live.keys().collect();
        let kept = names.iter().filter(|name| self.remember(name).is_ok()).count();
        tracing::warn!(
            kept,
            blades = names.len(),
            "the folder of blades is gone or another one; its blades are in the history, for sward-capture blades restore --all"
        );
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
