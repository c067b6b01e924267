//! Previews as they are offered: the newest look, made into bytes and sealed once it is asked for, and once for
//! all who ask.

use std::cell::RefCell;
use std::io;
use std::os::fd::OwnedFd;
use std::rc::Rc;
use std::sync::Arc;

use common::preview::EncodeError;
use common::protocol::Preview;
use common::sealed::{SealedError, seal};
use tokio::sync::{OnceCell, watch};

use crate::preview::Look;

/// A preview that is offered: sealed, never changed again.
#[derive(Debug)]
pub(crate) struct Sealed {
    reply: Preview,
    memfd: OwnedFd,
}

/// Why a preview cannot be offered.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PreviewError {
    /// It cannot be written as bytes.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// There is no shared memory for it.
    #[error(transparent)]
    Sealed(#[from] SealedError),
    /// There is no descriptor left.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// It could not be made.
    #[error("the thread that was to make it ended: {0}")]
    Thread(#[from] tokio::task::JoinError),
}

impl Sealed {
    fn of(look: &Look) -> Result<Self, PreviewError> {
        let bytes = look.encode()?;
        let memfd = seal("sward-preview", &bytes)?;
        let reply = Preview {
            sequence: look.sequence.cast_signed(),
            state: look.state.name().to_owned(),
            code: look.message.code().to_owned(),
            words: look.message.to_string(),
            size: bytes.len() as i64,
            fd: 0,
        };
        Ok(Self { reply, memfd })
    }

    /// What a client is told of it.
    pub(super) fn reply(&self) -> &Preview {
        &self.reply
    }

    /// A descriptor of it for a client.
    pub(super) fn descriptor(&self) -> Result<OwnedFd, PreviewError> {
        Ok(self.memfd.try_clone()?)
    }
}

/// A look that somebody has asked for. It is kept here until there is a newer one, so that its memory is given
/// back here rather than by the frame thread.
#[derive(Debug)]
struct Asked {
    look: Arc<Look>,
    sealed: OnceCell<Arc<Sealed>>,
}

/// Previews for all readers.
#[derive(Clone, Debug)]
pub(crate) struct Previews {
    looks: watch::Receiver<Option<Arc<Look>>>,
    newest: Rc<RefCell<Option<Rc<Asked>>>>,
}

impl Previews {
    /// Of what the frame thread shows.
    pub(crate) fn new(looks: watch::Receiver<Option<Arc<Look>>>) -> Self {
        Self { looks, newest: Rc::default() }
    }

    /// The newest preview, as soon as its sequence number is another than `after`.
    ///
    /// # Errors
    /// When there is no memory or no descriptor left for it.
    pub(super) async fn other_than(&mut self, after: u64) -> Result<Arc<Sealed>, PreviewError> {
        let is_other = |look: &Option<Arc<Look>>| look.as_ref().is_some_and(|look| look.sequence != after);
        let Ok(Some(look)) = self.looks.wait_for(is_other).await.map(|look| look.clone()) else {
            // The station is ending; so will this connection.
            return std::future::pending().await;
        };
        let asked = self.asked(look);
        let make = async || {
            let look = Arc::clone(&asked.look);
            // A large picture takes some milliseconds, which whoever asks for something else need not wait.
            let sealed = tokio::task::spawn_blocking(move || Sealed::of(&look)).await??;
            Ok(Arc::new(sealed))
        };
        asked.sealed.get_or_try_init(make).await.cloned()
    }

    fn asked(&self, look: Arc<Look>) -> Rc<Asked> {
        let mut newest = self.newest.borrow_mut();
        match newest.as_ref().filter(|asked| asked.look.sequence == look.sequence) {
            Some(asked) => Rc::clone(asked),
            None => {
                let asked = Rc::new(Asked { look, sealed: OnceCell::new() });
                *newest = Some(Rc::clone(&asked));
                asked
            }
        }
    }
}
