//! Follows the capture station's library: a long poll on a thread of its own, and a slot that holds
//! the newest snapshot until the frame loop takes it.
//!
//! A station that is away is tried again; a snapshot that is not valid is refused with its reason.
//! Either way the meadow keeps what it has.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use common::library::Snapshot;
use common::protocol::StationError;
use common::sealed::SealedBytes;
use common::station::{self, StationProxy};
use tokio::sync::oneshot;

/// A validated snapshot in shared memory.
pub type Library = Snapshot<SealedBytes>;

const FIRST_RETRY: Duration = Duration::from_millis(50);
const LONGEST_RETRY: Duration = Duration::from_secs(2);

/// Why the conversation with the station ended.
#[derive(Debug, thiserror::Error)]
enum LostError {
    #[error(transparent)]
    Connection(#[from] zlink::Error),
    #[error("the station answers {0:?}")]
    Station(StationError),
    #[error("the station answers with generation {generation} to a question for one after {after}")]
    NotNewer { generation: i64, after: i64 },
}

#[derive(Default)]
struct Slot {
    newest: Mutex<Option<Library>>,
    filled: Condvar,
}

impl Slot {
    // A snapshot is put there whole or not at all, so a panic elsewhere leaves nothing half done.
    fn lock(&self) -> MutexGuard<'_, Option<Library>> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The watch over one station; it ends when this is dropped.
pub struct LibraryWatch {
    slot: Arc<Slot>,
    _stop: oneshot::Sender<()>,
}

impl LibraryWatch {
    /// Starts to follow the station at `socket`, which need not be there yet.
    ///
    /// # Errors
    /// When the system gives no thread or no runtime.
    pub fn start(socket: PathBuf) -> std::io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let slot = Arc::new(Slot::default());
        let filled = Arc::clone(&slot);
        let (stop, stopped) = oneshot::channel();
        std::thread::Builder::new().name("library-watch".into()).spawn(move || {
            runtime.block_on(async {
                tokio::select! {
                    () = follow_for_ever(&socket, &filled) => {}
                    _ = stopped => {}
                }
            });
        })?;
        Ok(Self { slot, _stop: stop })
    }

    /// The newest library, if one came since the last time. Never waits.
    pub fn take(&self) -> Option<Library> {
        self.slot.lock().take()
    }

    /// The newest library as soon as there is one; `None` when there is none until `deadline`.
    pub fn wait_until(&self, deadline: Instant) -> Option<Library> {
        let wait = deadline.saturating_duration_since(Instant::now());
        let (mut newest, _) = self
            .slot
            .filled
            .wait_timeout_while(self.slot.lock(), wait, |newest| newest.is_none())
            .unwrap_or_else(PoisonError::into_inner);
        newest.take()
    }
}

async fn follow_for_ever(socket: &Path, slot: &Slot) {
    let mut newest = 0;
    let mut retry = FIRST_RETRY;
    let mut said = String::new();
    loop {
        let before = newest;
        let Err(error) = follow(socket, &mut newest, slot).await;
        if newest != before {
            retry = FIRST_RETRY;
        }
        let reason = error.to_string();
        if reason != said || newest != before {
            tracing::warn!(socket = %socket.display(), %reason, "no station; the meadow stays, trying again");
            said = reason;
        }
        tokio::time::sleep(retry).await;
        retry = (retry * 2).min(LONGEST_RETRY);
    }
}

/// Follows one connection until it ends. `newest`: the generation that came last, over any connection.
async fn follow(socket: &Path, newest: &mut i64, slot: &Slot) -> Result<std::convert::Infallible, LostError> {
    let mut connection = zlink::tokio::unix::connect(socket).await?;
    // Another station may answer now, or one whose store was replaced: its generations may be lower.
    let mut after = 0;
    loop {
        let (reply, descriptors) = connection.get_library(after).await?;
        let reply = reply.map_err(LostError::Station)?;
        if reply.generation <= after {
            return Err(LostError::NotNewer { generation: reply.generation, after });
        }
        // Counted as seen even when it is refused: asking again would bring the same bytes.
        after = reply.generation;
        if after == *newest {
            continue;
        }
        *newest = after;
        match station::library(&reply, &descriptors) {
            Ok(library) => {
                tracing::info!(generation = reply.generation, blades = library.len(), "new library");
                *slot.lock() = Some(library);
                slot.filled.notify_all();
            }
            Err(reason) => {
                tracing::error!(generation = reply.generation, %reason, "library refused; the meadow stays");
            }
        }
    }
}
