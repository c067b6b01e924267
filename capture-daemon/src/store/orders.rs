//! What people order of the store: put, remove, rename, set the mix, go back.

use std::io;

use common::blade::MAX_MIX;

use super::file::{
    SUFFIX, Signature, make_folder, shelve, shelve_text, shift, text, versions, write_as_of, write_atomically,
};
use super::record::{Record, check_name};
use super::{Live, Store, StoreError, disk};

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
        make_folder(&aside).map_err(|source| disk(&aside, source))?;
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
        let changed = || format!("{}: it was just changed and is not read yet", self.path(name).display());
        let reason = self.refused.get(name).map_or_else(changed, |refused| refused.reason.clone());
        Err(StoreError::Refused { reason })
    }

    /// Gives a blade another name, which no other has.
    ///
    /// # Errors
    /// When there is no such blade, the new name is none or taken, or the disk refuses.
    pub(crate) fn rename(&mut self, name: &str, to: &str) -> Result<(), StoreError> {
        check_name(to).map_err(StoreError::Name)?;
        self.settled(name)?;
        if self.is_taken(to) {
            return Err(StoreError::Taken(to.to_owned()));
        }
        let from = self.path(name);
        shift(&from, &self.path(to)).map_err(|source| match source.kind() {
            io::ErrorKind::AlreadyExists => StoreError::Taken(to.to_owned()),
            _ => disk(&from, source),
        })?;
        self.forget(name);
        self.take_up(to)
    }

    /// Sets how often a blade stands in the meadow. All else in its file stays as it is, comments too.
    ///
    /// # Errors
    /// When there is no such blade, the weight is out of its range, or the disk refuses.
    pub(crate) fn set_mix(&mut self, name: &str, mix: f64) -> Result<(), StoreError> {
        let weight = mix as f32;
        if !(0.0..=f64::from(MAX_MIX)).contains(&mix) {
            return Err(StoreError::Mix(mix));
        }
        self.settled(name)?;
        let path = self.path(name);
        let text = text(&path).map_err(|reason| StoreError::Refused { reason })?;
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
        // The time of its last change stands for that of its capture, where it does not give that.
        let modified = std::fs::metadata(&path).and_then(|metadata| metadata.modified()).ok();
        write_as_of(&self.blades_folder(), &format!("{name}{SUFFIX}"), text.as_bytes(), modified)
            .map_err(|source| disk(&path, source))?;
        self.take_up(name)
    }

    /// Puts the blade of a file's text into the library, under a name. A blade that has it goes to the
    /// history; else the oldest one that is not pinned makes room.
    ///
    /// # Errors
    /// When the name or the text is no blade's, another blade has its id, or the disk refuses.
    pub(crate) fn put_text(&mut self, name: &str, text: &str) -> Result<(), StoreError> {
        check_name(name).map_err(StoreError::Name)?;
        let refused = |error| StoreError::Refused { reason: format!("{name}:{error}") };
        let id = Record::parse(name, text, 0).map_err(refused)?.blade.id();
        if let Some(other) = self.ids.get(&id).filter(|other| *other != name) {
            return Err(StoreError::Taken(other.clone()));
        }
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
        self.forget(name);
        self.removed.remove(&id);
        self.take_up(name)
    }

    /// Goes back to the blade that had this name before: the one that was removed, else the one that
    /// was replaced (and again to that one, with the next call), else the one in the archive.
    ///
    /// # Errors
    /// When there is none, another blade has its id, or the disk refuses.
    pub(crate) fn restore(&mut self, name: &str) -> Result<(), StoreError> {
        check_name(name).map_err(StoreError::Name)?;
        let is_live = self.live.contains_key(name);
        let earlier = [self.history(), self.archive.folder().to_path_buf()].into_iter().find_map(|shelf| {
            versions(&shelf, name).into_iter().rev().find_map(|path| {
                let text = text(&path).ok()?;
                let modified = Signature::of(&path).ok()?.modified_unix_ns();
                let record = Record::parse(name, &text, modified).ok()?;
                let same = self.live.get(name).is_some_and(|live| live.record == record);
                (!same).then_some((path, text, record))
            })
        });
        let (shelved, text, record) = earlier.ok_or_else(|| StoreError::NoHistory(name.to_owned()))?;
        let id = record.blade.id();
        if let Some(other) = self.ids.get(&id).filter(|other| *other != name) {
            return Err(StoreError::Taken(other.clone()));
        }
        if is_live {
            self.remember(name)?;
        } else if let Some(oldest) = self.surplus_after(1)? {
            self.archive_blade(&oldest)?;
        }
        if self.refused.contains_key(name) {
            self.discard_refused(name)?;
        }
        let path = self.path(name);
        write_atomically(&self.blades_folder(), &format!("{name}{SUFFIX}"), text.as_bytes())
            .map_err(|source| disk(&path, source))?;
        // It is live; a copy that stays on the shelf would do no harm.
        let _ = std::fs::remove_file(&shelved);
        self.forget(name);
        self.removed.remove(&id);
        self.take_up(name)
    }

    /// Puts the live blade of `name` into its history.
    pub(super) fn remember(&self, name: &str) -> Result<(), StoreError> {
        let Some(live) = self.live.get(name) else { return Ok(()) };
        let path = self.path(name);
        let own = if self.is_as_read(name) { text(&path).ok() } else { None };
        let text = own.unwrap_or_else(|| live.record.to_toml());
        shelve_text(&self.history(), name, &text).map_err(|source| disk(&path, source))
    }
}
