//! systemd's watchdog.

use std::time::{Duration, Instant};

/// Tells systemd that the loop goes on, if it wants to know.
#[derive(Debug)]
pub(super) struct Watchdog {
    every: Option<Duration>,
    fed: Instant,
}

impl Watchdog {
    pub(super) fn new() -> Self {
        let every = sd_notify::watchdog_enabled().map(|timeout| timeout / 4);
        Self { every, fed: Instant::now() }
    }

    pub(super) fn feed(&mut self) {
        if self.every.is_some_and(|every| self.fed.elapsed() >= every) {
            self.fed = Instant::now();
            if let Err(error) = sd_notify::notify(&[sd_notify::NotifyState::Watchdog]) {
                tracing::debug!(%error, "systemd's watchdog cannot be fed");
            }
        }
    }
}
