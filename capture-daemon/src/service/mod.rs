//! The varlink service `io.sward.Station`.
//!
//! zlink carries the bytes and descriptors and defines the types; the calls are taken apart here, since
//! its own server hangs up on a call whose parameters have the wrong type or whose method it does not
//! know, where a client is owed an error of `org.varlink.service`. One task per connection, so that a
//! client that does not read holds up nobody else.

mod access;
mod call;
mod connection;
mod previews;
mod published;
mod socket;

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::SyncSender;

use common::protocol::{
    DEFINITION, GetStatusReply, Library, ListBladesReply, ListHistoryReply, ListRecordingsReply,
    ListRemovedReply, RecordingName, ReloadReply, StationError, Status,
};
use serde_json::{Value, json};
use std::os::fd::OwnedFd;
use tokio::sync::{mpsc, oneshot, watch};

pub(crate) use access::{Access, Peer};
pub(crate) use previews::Previews;
pub(crate) use published::Published;
pub(crate) use socket::{Socket, passed_socket};

use crate::frames::FrameOrder;
use crate::keeper::{Holdings, Job, Order, Outcome};
use crate::recorder::{self, Cause};
use call::{Call, CallError, RecordingCall, Right};

/// Someone asks for the configuration to be read again, and where the outcome goes.
pub(crate) type ReloadOrder = oneshot::Sender<Outcome<ReloadReply>>;

/// What the service tells its clients and whom it asks.
#[derive(Clone, Debug)]
pub(crate) struct Service {
    /// The newest library; none before there is a blade, so that a station that was started anew does
    /// not take its readers' meadow away.
    pub(crate) library: watch::Receiver<Option<Arc<Published>>>,
    /// What the store holds.
    pub(crate) holdings: watch::Receiver<Arc<Holdings>>,
    /// What the frame thread says of itself.
    pub(crate) status: watch::Receiver<Status>,
    /// What the frame thread sees.
    pub(crate) previews: Previews,
    /// Who may do what.
    pub(crate) access: watch::Receiver<Arc<Access>>,
    /// The keeper's queue.
    pub(crate) keeper: SyncSender<Job>,
    /// The frame thread's queue.
    pub(crate) frames: SyncSender<FrameOrder>,
    /// The recorder's queue.
    pub(crate) recorder: SyncSender<recorder::Job>,
    /// What the recorder says of itself.
    pub(crate) recording: watch::Receiver<recorder::Told>,
    /// The daemon's queue.
    pub(crate) reload: mpsc::Sender<ReloadOrder>,
    /// Connections at present.
    pub(crate) clients: Arc<AtomicUsize>,
}

/// Parameters of a reply, and its descriptors.
type Answer = Result<(Value, Vec<OwnedFd>), CallError>;

impl Service {
    /// The status, put together.
    pub(crate) fn status(&self) -> Status {
        let holdings = Arc::clone(&self.holdings.borrow());
        let library = self.library.borrow().as_ref().map(|library| (library.generation(), library.blades()));
        let (generation, blades) = library.unwrap_or_default();
        let recorder::Told { recording, trouble, frames, slow_frames, disk_frames, saves, .. } =
            self.recording.borrow().clone();
        Status {
            generation: generation.cast_signed(),
            blades: blades as i64,
            store: holdings.trouble.clone().unwrap_or_else(|| "ok".to_owned()),
            recording: recording.unwrap_or_else(|| "none".to_owned()),
            recording_trouble: trouble.unwrap_or_else(|| "ok".to_owned()),
            recorded_frames: frames.cast_signed(),
            unrecorded_slow: slow_frames.cast_signed(),
            unrecorded_disk: disk_frames.cast_signed(),
            saves: saves.cast_signed(),
            waiting: holdings.waiting as i64,
            lost: holdings.lost.cast_signed() + self.status.borrow().lost,
            captures: holdings.captures.cast_signed(),
            repeats: holdings.repeats.cast_signed(),
            refused_files: holdings.refused.len() as i64,
            clients: self.clients.load(Ordering::Relaxed) as i64,
            ..self.status.borrow().clone()
        }
    }

    /// Answers a call of `peer`.
    ///
    /// # Errors
    /// What the client is told instead.
    async fn answer(&mut self, call: Call, peer: &Peer) -> Answer {
        let allowed = match call.right() {
            Right::Anyone => true,
            Right::Watch => self.access.borrow().may_watch(peer),
            Right::Change => self.access.borrow().may_change(peer),
        };
        if !allowed {
            tracing::info!(?call, uid = peer.uid, "a client that may not do this was refused");
            return Err(CallError::PermissionDenied);
        }
        let parameters = match call {
            Call::GetInfo => json!({
                "vendor": "Sward", "product": "sward-capture", "version": env!("CARGO_PKG_VERSION"), "url": "",
                "interfaces": ["org.varlink.service", "io.sward.Station"],
            }),
            Call::GetInterfaceDescription { interface } => match interface.as_str() {
                "io.sward.Station" => json!({"description": DEFINITION}),
                "org.varlink.service" => {
                    json!({"description": zlink::varlink_service::DESCRIPTION.to_string()})
                }
                _ => return Err(CallError::InterfaceNotFound { interface }),
            },
            Call::GetLibrary { after } => return self.get_library(after).await,
            Call::GetPreview { after } => return self.get_preview(after).await,
            Call::GetStatus => reply(&GetStatusReply { status: self.status() })?,
            Call::ListBlades => {
                let holdings = Arc::clone(&self.holdings.borrow());
                let Holdings { blades, refused, .. } = holdings.as_ref();
                reply(&ListBladesReply { blades: blades.clone(), refused: refused.clone() })?
            }
            Call::ListHistory { name } => {
                let (asked, told) = oneshot::channel();
                self.keeper.try_send(Job::History(name, asked)).map_err(|_| StationError::Busy)?;
                reply(&ListHistoryReply { earlier: told.await.map_err(|_| StationError::Busy)? })?
            }
            Call::ListRemoved => {
                let (asked, told) = oneshot::channel();
                self.keeper.try_send(Job::Removed(asked)).map_err(|_| StationError::Busy)?;
                reply(&ListRemovedReply { removed: told.await.map_err(|_| StationError::Busy)? })?
            }
            Call::Order(order) => self.order(order).await?,
            Call::Recording(call) => self.recording(call).await?,
            Call::Capture => self.capture().await?,
            Call::Reload => self.reload().await?,
        };
        Ok((parameters, Vec::new()))
    }

    async fn get_library(&mut self, after: i64) -> Answer {
        let Ok(after_generation) = u64::try_from(after) else {
            return Err(StationError::InvalidGeneration { after }.into());
        };
        let newer = |library: &Option<Arc<Published>>| {
            library.as_ref().is_some_and(|library| library.generation() > after_generation)
        };
        let Ok(Some(library)) = self.library.wait_for(newer).await.map(|library| library.clone()) else {
            // The station is ending; so will this connection.
            return std::future::pending().await;
        };
        let memfd = library.descriptor().map_err(|_| StationError::OutOfDescriptors)?;
        let parameters = reply(&Library {
            generation: library.generation().cast_signed(),
            blades: library.blades() as i64,
            size: library.size() as i64,
            fd: 0,
        })?;
        Ok((parameters, vec![memfd]))
    }

    async fn get_preview(&mut self, after: i64) -> Answer {
        let Ok(after_sequence) = u64::try_from(after) else {
            return Err(StationError::InvalidSequence { after }.into());
        };
        let preview = self.previews.other_than(after_sequence).await.and_then(|preview| {
            let memfd = preview.descriptor()?;
            Ok((preview, memfd))
        });
        let (preview, memfd) = preview.map_err(|error| {
            tracing::debug!(%error, "a preview cannot be given");
            StationError::OutOfDescriptors
        })?;
        Ok((reply(preview.reply())?, vec![memfd]))
    }

    async fn order(&self, order: Order) -> Result<Value, CallError> {
        let (asked, outcome) = oneshot::channel();
        self.keeper.try_send(Job::Order(order, asked)).map_err(|_| StationError::Busy)?;
        outcome.await.map_err(|_| StationError::Busy)??;
        Ok(json!({}))
    }

    async fn capture(&self) -> Result<Value, CallError> {
        let (asked, outcome) = oneshot::channel();
        self.frames.try_send(FrameOrder::Capture(asked)).map_err(|error| match error {
            std::sync::mpsc::TrySendError::Full(_) => StationError::Busy,
            std::sync::mpsc::TrySendError::Disconnected(_) => StationError::NoFrames,
        })?;
        reply(&outcome.await.map_err(|_| StationError::NoFrames)??)
    }

    async fn recording(&self, call: RecordingCall) -> Result<Value, CallError> {
        use recorder::Job;
        match call {
            RecordingCall::Start => {
                let name = self.of_recorder(Job::Start).await?;
                reply(&RecordingName { name })
            }
            RecordingCall::Stop => reply(&self.of_recorder(Job::Stop).await?),
            RecordingCall::Save => {
                let name = self.of_recorder(|reply| Job::Save(Cause::Asked, Some(reply))).await?;
                reply(&RecordingName { name })
            }
            RecordingCall::List => {
                reply(&ListRecordingsReply { recordings: self.of_recorder(Job::List).await? })
            }
            RecordingCall::Pin { name, pinned } => {
                self.of_recorder(|reply| Job::Pin(name, pinned, reply)).await?;
                Ok(json!({}))
            }
            RecordingCall::Remove { name } => {
                self.of_recorder(|reply| Job::Remove(name, reply)).await?;
                Ok(json!({}))
            }
        }
    }

    async fn of_recorder<T>(
        &self,
        job: impl FnOnce(recorder::Reply<T>) -> recorder::Job,
    ) -> Result<T, CallError> {
        let (asked, told) = oneshot::channel();
        self.recorder.try_send(job(asked)).map_err(|_| StationError::Busy)?;
        Ok(told.await.map_err(|_| StationError::Busy)??)
    }

    async fn reload(&self) -> Result<Value, CallError> {
        let (asked, outcome) = oneshot::channel();
        self.reload.try_send(asked).map_err(|_| StationError::Busy)?;
        reply(&outcome.await.map_err(|_| StationError::Busy)??)
    }
}

fn reply(parameters: &impl serde::Serialize) -> Result<Value, CallError> {
    // Numbers, texts and lists of them: there is nothing that JSON could not hold.
    serde_json::to_value(parameters).map_err(|_| StationError::Busy.into())
}
