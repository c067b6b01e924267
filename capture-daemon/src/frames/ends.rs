//! What comes to the frame thread beside frames, and where what it makes of them goes.

use std::sync::Arc;
use std::sync::mpsc::SyncSender;

use common::protocol::{CaptureReply, Status};
use tokio::sync::{oneshot, watch};

use crate::keeper::{Job, Outcome};
use crate::preview::Look;
use crate::recorder::Recorder;
use crate::session::SessionParams;

/// What the frame thread is asked to do.
#[derive(Debug)]
pub(crate) enum FrameOrder {
    /// Capture what is held, and say what came of it.
    Capture(oneshot::Sender<Outcome<CaptureReply>>),
    /// Go by other parameters from the next frame on.
    Params(Box<NewParams>),
}

/// Other parameters.
#[derive(Debug)]
pub(crate) struct NewParams {
    /// What the session goes by.
    pub(crate) session: SessionParams,
    /// Hash of the keys that the capture goes by.
    pub(crate) hash: String,
    /// These keys, TOML.
    pub(crate) toml: String,
}

/// Where what the frame thread makes of frames goes.
#[derive(Debug)]
pub(crate) struct Outlets {
    /// How it does.
    pub(crate) status: watch::Sender<Status>,
    /// What it sees.
    pub(crate) looks: watch::Sender<Option<Arc<Look>>>,
    /// What it captures.
    pub(crate) keeper: SyncSender<Job>,
    /// Each frame.
    pub(crate) recorder: Recorder,
}
