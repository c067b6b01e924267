//! How a live sensor fares, for whoever asks from another thread.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Counts since the start, and what is the matter at present.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Fares {
    /// Model, serial and mode, once it was open.
    pub name: Option<String>,
    /// Its serial number, if it told one.
    pub serial: Option<String>,
    /// Why no frames come at present; none while they do.
    pub trouble: Option<String>,
    /// Sensor processes that were started.
    pub starts: u64,
    /// Those that were killed since nothing came from them.
    pub silences: u64,
    /// Those that crashed or ended.
    pub deaths: u64,
    /// Those that could not open the sensor, or lost it.
    pub failures: u64,
    /// Frames lost before they came to the station.
    pub lost_frames: u64,
}

/// A live sensor's health.
#[derive(Debug, Default)]
pub struct Health(Mutex<Fares>);

impl Health {
    fn fares(&self) -> MutexGuard<'_, Fares> {
        // Counts and texts are whole after any panic.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How it fares now.
    pub fn now(&self) -> Fares {
        self.fares().clone()
    }

    pub(super) fn opened(&self, name: &str) {
        self.fares().name = Some(name.to_owned());
    }

    pub(super) fn has_serial(&self, serial: &str) {
        self.fares().serial = Some(serial.to_owned());
    }

    pub(super) fn streams(&self) {
        self.fares().trouble = None;
    }

    pub(super) fn interrupted(&self, reason: &str) {
        self.fares().trouble = Some(reason.to_owned());
    }

    pub(super) fn count_start(&self) {
        self.fares().starts += 1;
    }

    pub(super) fn count_silence(&self) {
        self.fares().silences += 1;
    }

    pub(super) fn count_death(&self) {
        self.fares().deaths += 1;
    }

    pub(super) fn count_failure(&self) {
        self.fares().failures += 1;
    }

    pub(super) fn count_lost(&self, frames: u64) {
        self.fares().lost_frames += frames;
    }
}
