//! The keys of `[record]`.

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::Config;
use crate::recorder::{Cause, Limits, RingSettings, Settings, Target};

/// What the station records.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RecordConfig {
    /// Where recordings are kept; by default `recordings` in the state directory.
    pub directory: Option<PathBuf>,
    /// Whether it records from its start on.
    pub always: bool,
    /// How long one file becomes, seconds.
    pub file_s: f64,
    /// How much is kept in memory to be saved, seconds; 0: nothing.
    pub ring_s: f64,
    /// Most memory of that, megabytes.
    pub ring_max_mb: f64,
    /// After what the last seconds are saved unasked.
    pub save_on: Vec<Cause>,
    /// Room that is left free on the disk, megabytes.
    pub reserve_mb: f64,
    /// What all recordings take that are not pinned, megabytes.
    pub max_mb: f64,
    /// How old one becomes that is not pinned, days; 0: any age.
    pub max_age_days: f64,
}

impl Default for RecordConfig {
    fn default() -> Self {
        Self {
            directory: None,
            always: false,
            file_s: 600.0,
            ring_s: 0.0,
            ring_max_mb: 256.0,
            save_on: vec![Cause::Refused, Cause::Sensor],
            reserve_mb: 1000.0,
            max_mb: 20_000.0,
            max_age_days: 30.0,
        }
    }
}

impl RecordConfig {
    /// Where recordings are kept; `store`: the state directory.
    pub fn folder(&self, store: &Path) -> PathBuf {
        self.directory.clone().unwrap_or_else(|| store.join("recordings"))
    }
}

impl Config {
    /// What the recorder goes by; `store`: the state directory.
    pub(crate) fn recorder_settings(&self, store: &Path) -> Settings {
        let RecordConfig { always, file_s, ring_s, ring_max_mb, reserve_mb, max_mb, max_age_days, .. } =
            self.record;
        let bytes = |mb: f64| (mb * 1e6) as u64;
        let ring = (ring_s > 0.0).then(|| RingSettings {
            span: Duration::from_secs_f64(ring_s),
            max_bytes: bytes(ring_max_mb) as usize,
        });
        let max_age = (max_age_days > 0.0).then(|| Duration::from_secs_f64(max_age_days * 86_400.0));
        Settings {
            target: Target::Folder(self.record.folder(store)),
            limits: Limits { reserve_bytes: bytes(reserve_mb), max_bytes: bytes(max_mb), max_age },
            file_span: Duration::from_secs_f64(file_s),
            is_always: always,
            ring,
            save_on: self.record.save_on.clone(),
            config: self.capture_toml(),
        }
    }

    /// What the recorder of the verb `record` goes by, which writes one file.
    pub(crate) fn one_recording(&self, path: &Path) -> Settings {
        Settings {
            target: Target::File(path.to_owned()),
            limits: Limits { reserve_bytes: 0, max_bytes: u64::MAX, max_age: None },
            file_span: Duration::MAX,
            is_always: true,
            ring: None,
            save_on: Vec::new(),
            config: self.capture_toml(),
        }
    }
}
