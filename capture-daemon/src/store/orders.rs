//! What people order of the store: put, remove, rename, set the mix, go back.

use std::io;

use common::blade::MAX_MIX;

use super::file::{SUFFIX, Signature, shift, supplant, text, write_as_of, write_atomically};
use super::record::{Record, check_name};
use super::shelf::{self, Version, shelve, shelve_text};
use super::{Live, Store, StoreError, disk};
use crate::mistake::one_line;

/// Smallest weight but 0 that can be ordered.
pub(crate) const MIN_MIX: f64 = 1e-30;

impl Store {
    /// Takes a blade away; its file goes to the history of its name.
    ///
    /// # Errors
    /// When there is none of that name, or the disk refuses.
    pub(crate) fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        check_name(name).map_err(StoreError::Name)?;
        let path = self.path(name);
        if !self.live.contains_key(name) && !self.refused.contains_key(name) {
            return Err(StoreError::NotFound(name.to_owned()));
        }
        if let Some(live) = self.live.get(name) {
            let id = live.record.blade.id();
            if self.is_as_read(name) {
                shelve(&self.history(), name, &path).map_err(|source| disk(&path, source))?;
            } else {
                // What goes is the last good one; the file beside it was never a blade.
                self.remember(name)?;
                self.discard_refused(name)?;
            }
            self.removed.insert(id);
        } else {
            self.discard_refused(name)?;
        }
        self.forget(name);
        Ok(())
    }

    /// Sets a file that is no blade aside, where nothing takes it for one.
    fn discard_refused(&self, name: &str) -> Result<(), StoreError> {
        let path = self.path(name);
        if path.symlink_metadata().is_err() {
            return Ok(());
        }
        let aside = self.history().join(name).join("refused");
        std::fs::create_dir_all(&aside).map_err(|source| disk(&aside, source))?;
        shelve(&aside, name, &path).map(drop).map_err(|source| disk(&path, source))
    }

    /// Whether the file of `name` is the one that the live blade was read from.
    fn is_as_read(&self, name: &str) -> bool {
        let seen = self.live.get(name).and_then(|live| live.seen);
        seen.is_some() && Signature::of(&self.path(name)).ok() == seen
    }

    /// A live blade whose file is as it was read.
    fn settled(&self, name: &str) -> Result<&Live, StoreError> {
        check_name(name).map_err(StoreError::Name)?;
        let live = self.live.get(name).ok_or_else(|| StoreError::NotFound(name.to_owned()))?;
        if self.is_as_read(name) {
            return Ok(live);
        }
        let changed = || {
            let path = self.path(name);
            let why = Signature::of(&path).map_or_else(
                |error| error.to_string(),
                |_| "it was just changed and is not read yet".to_owned(),
            );
            format!("{}: {why}", path.display())
        };
        let reason = self.refused.get(name).map_or_else(changed, |refused| refused.reason.clone());
        Err(StoreError::Refused { reason })
    }

    /// Gives a blade another name, which no other has. [`Self::restore`] of the old name undoes it.
    ///
    /// # Errors
    /// When there is no such blade, the new name is none or taken, or the disk refuses.
    pub(crate) fn rename(&mut self, name: &str, to: &str) -> Result<(), StoreError> {
        check_name(to).map_err(StoreError::Name)?;
        self.settled(name)?;
        if self.is_taken(to) {
            return Err(StoreError::Taken(to.to_owned()));
        }
        self.shelve_live(name, Some(to))?;
        let from = self.path(name);
        shift(&from, &self.path(to)).map_err(|source| match source.kind() {
            io::ErrorKind::AlreadyExists => StoreError::Taken(to.to_owned()),
            _ => disk(&from, source),
        })?;
        self.forget(name);
        self.take_up(to)
    }

    /// Sets how often a blade stands in the meadow. All else in its file stays as it is, comments too; with the
    /// weight that it had, it goes to the history.
    ///
    /// # Errors
    /// When there is no such blade, the weight is out of its range, or the disk refuses.
    pub(crate) fn set_mix(&mut self, name: &str, mix: f64) -> Result<(), StoreError> {
        // There is one 0 only.
        let mix = if mix == 0.0 { 0.0 } else { mix };
        let weight = mix as f32;
        // Less than that the library cannot tell from 0.
        if mix != 0.0 && !(MIN_MIX..=f64::from(MAX_MIX)).contains(&mix) {
            return Err(StoreError::Mix(mix));
        }
        self.settled(name)?;
        let path = self.path(name);
        let text = text(&path)
            .map_err(|error| StoreError::Refused { reason: format!("{}{error}", one_line(&path)) })?;
        let mut document: toml_edit::DocumentMut = text
            .parse()
            .map_err(|_| StoreError::Refused { reason: format!("{}: no TOML", path.display()) })?;
        // The shortest decimal of the weight as the library holds it.
        let shortest: f64 = format!("{weight:?}").parse().unwrap_or(mix);
        match document.get_mut("mix").and_then(toml_edit::Item::as_value_mut) {
            Some(value) => {
                let decor = value.decor().clone();
                *value = shortest.into();
                *value.decor_mut() = decor;
            }
            None => document["mix"] = toml_edit::value(shortest),
        }
        let text = document.to_string();
        let modified = Signature::of(&path).map_or(0, |seen| seen.modified_unix_ns());
        Record::parse(name, &text, modified)
            .map_err(|error| StoreError::Refused { reason: error.to_string() })?;
        if self.live.get(name).is_some_and(|live| live.record.blade.mix() != weight) {
            self.remember(name)?;
        }
        // The time of its last change stands for that of its capture, where it does not give that.
        let modified = std::fs::metadata(&path).and_then(|metadata| metadata.modified()).ok();
        write_as_of(&self.blades_folder(), &format!("{name}{SUFFIX}"), text.as_bytes(), modified)
            .map_err(|source| disk(&path, source))?;
        self.take_up(name)
    }

    /// Puts the blade of a file's text into the library, under a name. A blade that has it goes to the
    /// history; else the oldest one that is not pinned makes room. A copy of another blade gets an id of its own.
    ///
    /// # Errors
    /// When the name or the text is no blade's, or the disk refuses.
    pub(crate) fn put_text(&mut self, name: &str, text: &str) -> Result<(), StoreError> {
        check_name(name).map_err(StoreError::Name)?;
        let refused = |error| StoreError::Refused { reason: format!("{name}:{error}") };
        let record = Record::parse(name, text, 0).map_err(refused)?;
        let own = self.with_own_id(name, text, &record);
        let text = own.as_deref().unwrap_or(text);
        let is_live = self.live.contains_key(name);
        let oldest = if is_live { None } else { self.surplus_after(1)? };
        if is_live {
            self.remember(name)?;
        }
        if self.refused.contains_key(name) {
            self.discard_refused(name)?;
        }
        let path = self.path(name);
        write_atomically(&self.blades_folder(), &format!("{name}{SUFFIX}"), text.as_bytes())
            .map_err(|source| disk(&path, source))?;
        // Nobody makes room for what is not on disk.
        if let Some(oldest) = oldest
            && let Err(error) = self.archive_blade(&oldest)
        {
            std::fs::remove_file(&path).map_err(|source| disk(&path, source))?;
            return Err(error);
        }
        self.replace(name)
    }

    /// What a name can go back to, the newest first: what was replaced, had another weight, was renamed or
    /// removed, then what went to the archive.
    pub(crate) fn earlier(&self, name: &str) -> Vec<Version> {
        if check_name(name).is_err() {
            return Vec::new();
        }
        let live = self.live.get(name).map(|live| &live.record);
        let shelves = [self.history(), self.archive.folder().to_path_buf()];
        let all = shelves.iter().flat_map(|shelf| shelf::versions(shelf, name));
        all.filter(|version| !live.is_some_and(|live| live.is_like(&version.record))).collect()
    }

    /// What names that no blade has now would go back to, what went last first: removed blades, and those whose files
    /// were removed. O(names in the history).
    pub(crate) fn removed(&self) -> Vec<Version> {
        let history = self.history();
        let mut removed: Vec<Version> = shelf::names(&history)
            .into_iter()
            .filter(|name| !self.live.contains_key(name) && !self.refused.contains_key(name))
            .filter_map(|name| shelf::newest_of_name(&history, &name))
            .filter(|version| !self.ids.contains_key(&version.record.blade.id()))
            .collect();
        removed.sort_by_key(|version| std::cmp::Reverse(version.kept_unix_ns));
        removed
    }

    /// Whether a version that [`Self::earlier`] gave comes from the archive.
    pub(crate) fn is_archived(&self, version: &Version) -> bool {
        version.path.starts_with(self.archive.folder())
    }

    /// Goes back to an earlier blade of this name, `back` of them: 1 is the newest that [`Self::earlier`] gives.
    /// What has the name now takes its place in the history, so that the next call with 1 goes forth again. A
    /// blade that has another name now gets this one back, as it is now.
    ///
    /// # Errors
    /// When there is none, or the disk refuses.
    pub(crate) fn restore(&mut self, name: &str, back: usize) -> Result<(), StoreError> {
        check_name(name).map_err(StoreError::Name)?;
        let version = back.checked_sub(1).and_then(|index| self.earlier(name).into_iter().nth(index));
        let version = version.ok_or_else(|| StoreError::NoHistory(name.to_owned()))?;
        if let Some(holder) = self.holder(name, &version) {
            self.call_back(&holder, name)?;
            if version.renamed_to.is_some() {
                let _ = std::fs::remove_file(&version.path);
                return Ok(());
            }
        }
        if self.live.contains_key(name) {
            self.remember(name)?;
        } else if let Some(oldest) = self.surplus_after(1)? {
            self.archive_blade(&oldest)?;
        }
        if self.refused.contains_key(name) {
            self.discard_refused(name)?;
        }
        let path = self.path(name);
        let file = format!("{name}{SUFFIX}");
        write_as_of(&self.blades_folder(), &file, version.text.as_bytes(), Some(version.modified()))
            .map_err(|source| disk(&path, source))?;
        // It is live; a copy that stays on the shelf would do no harm.
        let _ = std::fs::remove_file(&version.path);
        self.replace(name)
    }

    /// Reads the file of `name`, which this store has just written over what has the name.
    fn replace(&mut self, name: &str) -> Result<(), StoreError> {
        if let Some(before) = self.live.get(name) {
            self.removed.insert(before.record.blade.id());
        }
        self.forget(name);
        self.take_up(name)
    }

    /// The other name that the blade of a version has now: by its id or, where that is made of its name, by the
    /// names that it was given one after the other.
    fn holder(&self, name: &str, version: &Version) -> Option<String> {
        let of_id = self.ids.get(&version.record.blade.id()).filter(|other| *other != name);
        if let Some(other) = of_id {
            return Some(other.clone());
        }
        let mut now = version.renamed_to.clone()?;
        let mut seen = vec![name.to_owned()];
        while !self.live.contains_key(&now) {
            seen.push(now.clone());
            let next = shelf::versions(&self.history(), &now).next()?.renamed_to?;
            now = if seen.contains(&next) { return None } else { next };
        }
        let is_same = self.live.get(&now)?.record.blade.knots() == version.record.blade.knots();
        (now != name && is_same).then_some(now)
    }

    /// Gives a live blade a name that it had before. One that has it now goes to the history.
    fn call_back(&mut self, holder: &str, name: &str) -> Result<(), StoreError> {
        self.settled(holder)?;
        if self.live.contains_key(name) {
            self.remember(name)?;
        }
        if self.refused.contains_key(name) {
            self.discard_refused(name)?;
        }
        self.shelve_live(holder, Some(name))?;
        let from = self.path(holder);
        supplant(&from, &self.path(name)).map_err(|source| disk(&from, source))?;
        self.forget(holder);
        self.replace(name)
    }

    /// Puts the live blade of `name` into its history.
    pub(super) fn remember(&self, name: &str) -> Result<(), StoreError> {
        self.shelve_live(name, None)
    }

    /// The same, with the name that it is to get instead.
    fn shelve_live(&self, name: &str, renamed_to: Option<&str>) -> Result<(), StoreError> {
        let Some(live) = self.live.get(name) else { return Ok(()) };
        let path = self.path(name);
        let own = if self.is_as_read(name) { text(&path).ok() } else { None };
        let modified = own.as_ref().and_then(|_| std::fs::metadata(&path).ok()?.modified().ok());
        let text = own.unwrap_or_else(|| live.record.to_toml());
        shelve_text(&self.history(), name, &text, modified, renamed_to).map_err(|source| disk(&path, source))
    }
}
