//! The varlink service `io.sward.Station`.

use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use common::blade::Blade;
use common::library::{LibraryError, encode};
use common::protocol::{GetStatusReply, Library, StationError, Status};
use common::sealed::{SealedError, seal};
use tokio::io::Interest;
use tokio::net::{UnixListener, UnixStream};
use tokio::sync::watch;
use zlink::{ReadyListener, Server};

/// A library that is offered: sealed, never changed again.
#[derive(Debug)]
pub(crate) struct Published {
    generation: u64,
    blades: usize,
    size: usize,
    memfd: OwnedFd,
}

/// Why a library cannot be published.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PublishError {
    /// It cannot be written as bytes.
    #[error(transparent)]
    Library(#[from] LibraryError),
    /// There is no shared memory for it.
    #[error(transparent)]
    Sealed(#[from] SealedError),
}

impl Published {
    /// Seals `blades` as one generation.
    ///
    /// # Errors
    /// Too many blades, or no memory or descriptor left.
    pub(crate) fn new(generation: u64, blades: &[Blade]) -> Result<Self, PublishError> {
        let bytes = encode(generation, blades)?;
        let memfd = seal("sward-library", &bytes)?;
        Ok(Self { generation, blades: blades.len(), size: bytes.len(), memfd })
    }

    /// Its generation.
    pub(crate) fn generation(&self) -> u64 {
        self.generation
    }

    /// Number of its blades.
    pub(crate) fn blades(&self) -> usize {
        self.blades
    }
}

/// What the service tells its clients.
#[derive(Clone, Debug)]
pub(crate) struct Service {
    /// The newest library; none before the first capture, so that a station that was started again
    /// does not take its readers' meadow away.
    pub(crate) library: watch::Receiver<Option<Arc<Published>>>,
    /// The newest status.
    pub(crate) status: watch::Receiver<Status>,
}

#[zlink::service(
    interface = "io.sward.Station",
    types = [Status],
    vendor = "Sward",
    product = "sward-capture",
    version = env!("CARGO_PKG_VERSION"),
    url = ""
)]
impl Service {
    #[zlink(return_fds)]
    async fn get_library(&mut self, after: i64) -> (Result<Library, StationError>, Vec<OwnedFd>) {
        let Ok(after_generation) = u64::try_from(after) else {
            return (Err(StationError::InvalidGeneration { after }), Vec::new());
        };
        let newer = |library: &Option<Arc<Published>>| {
            library.as_ref().is_some_and(|library| library.generation > after_generation)
        };
        let Ok(Some(library)) = self.library.wait_for(newer).await.map(|library| library.clone()) else {
            // The station is ending; so will this connection.
            return std::future::pending().await;
        };
        let Ok(memfd) = library.memfd.try_clone() else {
            return (Err(StationError::OutOfDescriptors), Vec::new());
        };
        let reply = Library {
            generation: library.generation.cast_signed(),
            blades: library.blades as i64,
            size: library.size as i64,
            fd: 0,
        };
        (Ok(reply), vec![memfd])
    }

    async fn get_status(&self) -> GetStatusReply {
        GetStatusReply { status: self.status.borrow().clone() }
    }
}

/// Why the socket cannot be listened on.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BindError {
    /// Another process answers on it.
    #[error(
        "{path}: the socket is in use by another process, expected a free one; stop the other station or set service.socket to another path"
    )]
    InUse {
        /// The socket.
        path: String,
    },
    /// The system refused.
    #[error(
        "{path}: the socket cannot be made: {source}; set service.socket to a path where nothing is yet, in a folder that you may write to"
    )]
    Io {
        /// The socket.
        path: String,
        /// What the system said.
        source: io::Error,
    },
}

/// The socket while it is listened on; its file goes when it is dropped.
#[derive(Debug)]
pub(crate) struct Socket {
    listener: UnixListener,
    path: PathBuf,
}

impl Drop for Socket {
    fn drop(&mut self) {
        if let Err(error) = std::fs::remove_file(&self.path) {
            tracing::debug!(%error, "the socket's file is gone already");
        }
    }
}

impl Socket {
    /// Listens on `path`. A socket that nobody answers on is left over from a station that was
    /// killed, and is replaced.
    ///
    /// # Errors
    /// When another process answers on it, or the system refuses.
    pub(crate) async fn bind(path: &Path) -> Result<Self, BindError> {
        let shown = || path.display().to_string();
        let refused = |source| BindError::Io { path: shown(), source };
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).map_err(refused)?;
        }
        match UnixStream::connect(path).await {
            Ok(_) => return Err(BindError::InUse { path: shown() }),
            Err(error) if error.kind() == io::ErrorKind::ConnectionRefused && is_socket(path) => {
                std::fs::remove_file(path).map_err(refused)?;
            }
            Err(_) => {}
        }
        let listener = UnixListener::bind(path).map_err(refused)?;
        Ok(Self { listener, path: path.to_path_buf() })
    }

    /// Serves every client in a task of its own, for ever. Needs a `LocalSet`.
    pub(crate) async fn serve(&self, service: Service) {
        loop {
            match self.listener.accept().await {
                Ok((stream, _)) => {
                    tokio::task::spawn_local(serve_client(stream, service.clone()));
                }
                Err(error) => {
                    // Out of descriptors, as a rule: they come back as clients leave.
                    tracing::warn!(%error, "a client could not be accepted");
                    tokio::time::sleep(std::time::Duration::from_millis(100)).await;
                }
            }
        }
    }
}

fn is_socket(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt;
    std::fs::metadata(path).is_ok_and(|metadata| metadata.file_type().is_socket())
}

async fn serve_client(stream: UnixStream, service: Service) {
    let twin = stream.as_fd().try_clone_to_owned().and_then(|fd| UnixStream::from_std(fd.into()));
    let stream = match zlink::tokio::unix::Stream::try_from(stream) {
        Ok(stream) => stream,
        Err(error) => return tracing::debug!(%error, "a client could not be set up"),
    };
    // One server per connection: a single one awaits every send, so that a client that does not read
    // would hold up the others.
    let server = Server::new(ReadyListener::new(stream), service).run();
    let peer_left = async {
        match twin {
            Ok(twin) => hung_up(twin).await,
            Err(_) => std::future::pending().await,
        }
    };
    // A client that leaves while it waits for a library is noticed only by its hang-up.
    tokio::select! {
        result = server => if let Err(error) = result {
            tracing::debug!(%error, "a client was served badly");
        },
        () = peer_left => {}
    }
}

/// Ends when the peer has closed its side.
async fn hung_up(socket: UnixStream) {
    loop {
        match socket.ready(Interest::WRITABLE).await {
            Ok(ready) if ready.is_write_closed() => return,
            Ok(_) => {}
            Err(_) => return,
        }
        // Clears the readiness, so that the next round waits for the next event.
        let cleared: io::Result<()> =
            socket.try_io(Interest::WRITABLE, || Err(io::ErrorKind::WouldBlock.into()));
        drop(cleared);
    }
}
