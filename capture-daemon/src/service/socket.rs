//! The Unix socket: bound once, its mode set, its file removed at the end; or one that systemd made, whose mode and
//! file are systemd's.

use std::cell::RefCell;
use std::collections::HashMap;
use std::io;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::UnixListener as PassedListener;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use listenfd::ListenFd;
use nix::sys::socket::getsockopt;
use nix::sys::socket::sockopt::PeerCredentials;
use rustix::net::sockopt::{set_socket_send_buffer_size, socket_acceptconn};
use tokio::net::{UnixListener, UnixStream};
use zlink::connection::socket::FetchPeerCredentials;

use super::{Peer, Service, connection};
use crate::recurring::Recurring;
use crate::store::file::make_folder;

/// Room for replies that a client has not taken yet. Each of them may hold the memory of a preview, so that a
/// client that asks and does not read must not have many.
const SEND_BUFFER_BYTES: usize = 8 * 1024;

/// How long a client for which there is no place may take to ask, before it is told so and closed.
const FAREWELL: Duration = Duration::from_secs(1);
/// Clients without a place that may take so long at once.
const MAX_LEAVING: usize = 16;

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
    /// What systemd passes is something else.
    #[error(
        "the environment says that sockets were passed (LISTEN_FDS), expected one Unix stream socket that listens, found {found}; see systemd/sward-capture.socket"
    )]
    Passed {
        /// What it is.
        found: String,
    },
}

/// The socket that systemd passes to this process, if it does (`sd_listen_fds(3)`). It is taken out of the
/// environment with that: to be asked once, before there are threads.
///
/// # Errors
/// When it is not one Unix stream socket that listens.
pub(crate) fn passed_socket() -> Result<Option<PassedListener>, BindError> {
    let refused = |found: String| BindError::Passed { found };
    let mut passed = ListenFd::from_env();
    if passed.len() > 1 {
        return Err(refused(format!("{} of them", passed.len())));
    }
    let listener = passed.take_unix_listener(0).map_err(|error| refused(format!("that {error}")))?;
    if let Some(listener) = &listener
        && !socket_acceptconn(listener).map_err(|error| refused(format!("that {error}")))?
    {
        return Err(refused("one that does not listen, as with Accept=yes".to_owned()));
    }
    Ok(listener)
}

/// The socket while it is listened on; the file that it made goes when it is dropped.
#[derive(Debug)]
pub(crate) struct Socket {
    listener: UnixListener,
    path: PathBuf,
    /// Whether it stays where it is for the next station.
    is_passed: bool,
}

impl Drop for Socket {
    fn drop(&mut self) {
        if !self.is_passed
            && let Err(error) = std::fs::remove_file(&self.path)
        {
            tracing::debug!(%error, "the socket's file is gone already");
        }
    }
}

impl Socket {
    /// Listens on what systemd passed. Who connected before is served, too.
    ///
    /// # Errors
    /// When the system refuses.
    pub(crate) fn of_passed(passed: PassedListener) -> Result<Self, BindError> {
        let refused = |error: io::Error| BindError::Passed { found: format!("that {error}") };
        let address = passed.local_addr().map_err(refused)?;
        let path = address.as_pathname().map(Path::to_path_buf).unwrap_or_default();
        // Whoever made it shares this with us, and may have set it otherwise.
        passed.set_nonblocking(true).map_err(refused)?;
        Ok(Self { listener: UnixListener::from_std(passed).map_err(refused)?, path, is_passed: true })
    }

    /// Where it is; empty for one that has no name in the file system.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Listens on `path`, whose file gets this `mode`. A socket that nobody answers on is left over from
    /// a station that was killed, and is replaced.
    ///
    /// # Errors
    /// When another process answers on it, or the system refuses.
    pub(crate) async fn bind(path: &Path, mode: u32) -> Result<Self, BindError> {
        let shown = || path.display().to_string();
        let refused = |source| BindError::Io { path: shown(), source };
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            make_folder(folder).map_err(refused)?;
        }
        match UnixStream::connect(path).await {
            Ok(_) => return Err(BindError::InUse { path: shown() }),
            Err(error) if error.kind() == io::ErrorKind::ConnectionRefused && is_socket(path) => {
                std::fs::remove_file(path).map_err(refused)?;
            }
            Err(_) => {}
        }
        let listener = UnixListener::bind(path).map_err(refused)?;
        let socket = Self { listener, path: path.to_path_buf(), is_passed: false };
        // Whoever slips in before this is still asked for his credentials.
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).map_err(refused)?;
        Ok(socket)
    }

    /// Serves every client in a task of its own, for ever; at most `limit` at once, and from one user
    /// that is neither root nor our own at most half as many. Needs a `LocalSet`.
    pub(crate) async fn serve(&self, service: Service, limit: usize) {
        let counts = Rc::new(RefCell::new(HashMap::new()));
        // Held by each that is told to go.
        let leaving = Rc::new(());
        let (mut turned_away, mut not_accepted) = (Recurring::default(), Recurring::default());
        loop {
            match self.listener.accept().await {
                Ok((stream, _)) => match admit(stream, &service, &counts, limit).await {
                    Ok(Admitted::Seated(stream, peer, seat)) => {
                        let service = service.clone();
                        tokio::task::spawn_local(async move {
                            connection::serve(stream, service, &peer).await;
                            drop(seat);
                        });
                    }
                    Ok(Admitted::Full { stream, uid, limit }) => {
                        if let Some(clients) = turned_away.count(1) {
                            tracing::warn!(
                                clients,
                                uid,
                                limit,
                                "clients were turned away: there are too many"
                            );
                        }
                        // Of a flood, most wait for nothing and take nothing.
                        let patience = (Rc::strong_count(&leaving) <= MAX_LEAVING).then_some(FAREWELL);
                        let leaves = Rc::clone(&leaving);
                        tokio::task::spawn_local(async move {
                            connection::turn_away(stream, limit, patience).await;
                            drop(leaves);
                        });
                    }
                    Err(error) => tracing::debug!(%error, "a client left at once"),
                },
                Err(error) => {
                    // Out of descriptors, as a rule: they come back as clients leave.
                    if let Some(times) = not_accepted.count(1) {
                        tracing::warn!(%error, times, "a client could not be accepted; it is tried again");
                    }
                    tokio::time::sleep(Duration::from_millis(100)).await;
                }
            }
        }
    }
}

/// Connections by user.
type Counts = Rc<RefCell<HashMap<u32, usize>>>;

/// A client's place; free again when dropped.
struct Seat {
    counts: Counts,
    uid: u32,
    clients: Arc<AtomicUsize>,
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.clients.fetch_sub(1, Ordering::Relaxed);
        let mut counts = self.counts.borrow_mut();
        if let Some(count) = counts.get_mut(&self.uid) {
            *count -= 1;
            if *count == 0 {
                counts.remove(&self.uid);
            }
        }
    }
}

/// A client that came.
enum Admitted {
    /// It has a place.
    Seated(zlink::tokio::unix::Stream, Peer, Seat),
    /// There is none: `limit` is what its user may have.
    Full { stream: zlink::tokio::unix::Stream, uid: u32, limit: usize },
}

async fn admit(stream: UnixStream, service: &Service, counts: &Counts, limit: usize) -> io::Result<Admitted> {
    set_socket_send_buffer_size(&stream, SEND_BUFFER_BYTES)?;
    let plain = getsockopt(&stream, PeerCredentials)?;
    let stream = zlink::tokio::unix::Stream::try_from(stream).map_err(io::Error::other)?;
    let peer = match stream.fetch_peer_credentials().await {
        Ok(credentials) => {
            let groups = credentials.unix_supplementary_group_ids().iter();
            let gids = groups.chain([&credentials.unix_primary_group_id()]).map(|gid| gid.as_raw()).collect();
            Peer { uid: credentials.unix_user_id().as_raw(), gids }
        }
        // Processes outside of our own PID namespace (beside a container) have no PID here, and zlink gives up on
        // them. User and primary group are known all the same.
        Err(_) => Peer { uid: plain.uid(), gids: vec![plain.gid()] },
    };
    let own_limit = if service.access.borrow().is_own(&peer) { limit } else { limit.div_ceil(2) };
    let mut by_user = counts.borrow_mut();
    let all: usize = by_user.values().sum();
    let own = by_user.entry(peer.uid).or_default();
    if all >= limit || *own >= own_limit {
        return Ok(Admitted::Full { stream, uid: peer.uid, limit: own_limit });
    }
    *own += 1;
    service.clients.fetch_add(1, Ordering::Relaxed);
    let clients = Arc::clone(&service.clients);
    let seat = Seat { counts: Rc::clone(counts), uid: peer.uid, clients };
    drop(by_user);
    Ok(Admitted::Seated(stream, peer, seat))
}

fn is_socket(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|metadata| metadata.file_type().is_socket())
}
