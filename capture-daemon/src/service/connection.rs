//! One client: its messages one after the other, each answered before the next is looked at.

use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::time::Duration;

use common::protocol::{MAX_MESSAGE_BYTES, StationError};
use rustix::net::SendFlags;
use serde_json::{Value, json};
use tokio::io::Interest;
use tokio::net::UnixStream;
use zlink::connection::Socket;
use zlink::connection::socket::{ReadHalf, WriteHalf};

use super::call::{CallError, Message};
use super::{Peer, Service};

/// How long a client may take to take a reply.
const SEND_DEADLINE: Duration = Duration::from_secs(10);

/// Why a connection ends.
#[derive(Debug, thiserror::Error)]
enum Hangup {
    #[error("the client left")]
    Left,
    #[error("a message of more than {MAX_MESSAGE_BYTES} bytes")]
    TooLong,
    #[error("a message that is no JSON object")]
    NotVarlink,
    #[error("the client did not take a reply within {} s", SEND_DEADLINE.as_secs())]
    DoesNotRead,
    #[error(transparent)]
    Zlink(#[from] zlink::Error),
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// Serves a client until it leaves or misbehaves.
pub(super) async fn serve(stream: zlink::tokio::unix::Stream, mut service: Service, peer: &Peer) {
    let twin = stream.as_fd().try_clone_to_owned().and_then(|fd| UnixStream::from_std(fd.into()));
    let result = match twin {
        Ok(twin) => converse(stream, &twin, &mut service, peer).await,
        Err(error) => Err(error.into()),
    };
    if let Err(reason) = result {
        tracing::debug!(uid = peer.uid, %reason, "a connection ends");
    }
}

async fn converse(
    stream: zlink::tokio::unix::Stream,
    twin: &UnixStream,
    service: &mut Service,
    peer: &Peer,
) -> Result<(), Hangup> {
    let (read, mut write) = stream.split();
    let mut messages = Messages { read, bytes: Vec::new(), taken: 0 };
    loop {
        let bytes = match messages.next().await {
            Err(Hangup::TooLong) => {
                let limit = MAX_MESSAGE_BYTES as i64;
                // Whoever still writes does not see it; whoever is done does.
                let _ = send(&mut write, &farewell(StationError::MessageTooLong { limit }), &[]).await;
                return Err(Hangup::TooLong);
            }
            bytes => bytes?,
        };
        let Some(Message { call, oneway }) = Message::parse(bytes) else {
            let _ = send(&mut write, &farewell(StationError::NotAMessage), &[]).await;
            return Err(Hangup::NotVarlink);
        };
        let answer = match call {
            // A client that leaves while it waits for a library is noticed only by its hang-up.
            Ok(call) => tokio::select! {
                answer = service.answer(call, peer) => answer,
                () = hung_up(twin) => return Err(Hangup::Left),
            },
            Err(error) => Err(error),
        };
        if oneway {
            continue;
        }
        let (reply, descriptors) = match answer {
            Ok((parameters, descriptors)) => (reply(parameters), descriptors),
            Err(error) => (error.reply(), Vec::new()),
        };
        send(&mut write, &message(&reply), &descriptors).await?;
    }
}

/// A reply as it is sent.
fn message(reply: &Value) -> Vec<u8> {
    let mut bytes = reply.to_string().into_bytes();
    bytes.push(0);
    bytes
}

/// The reply before a connection is closed.
fn farewell(error: StationError) -> Vec<u8> {
    message(&CallError::from(error).reply())
}

async fn send(write: &mut impl WriteHalf, bytes: &[u8], descriptors: &[OwnedFd]) -> Result<(), Hangup> {
    let sent = tokio::time::timeout(SEND_DEADLINE, write.write(bytes, descriptors, None)).await;
    Ok(sent.map_err(|_| Hangup::DoesNotRead)??)
}

/// Tells a client that there is no place for it: `limit` is what its user may have. `patience`: how long its
/// question is waited for, since one that finds the connection closed when it asks does not look for an answer;
/// none: it is told at once, as far as that takes no time.
pub(super) async fn turn_away(stream: zlink::tokio::unix::Stream, limit: usize, patience: Option<Duration>) {
    let told = farewell(StationError::TooManyConnections { limit: limit as i64 });
    let Some(patience) = patience else {
        // It may have left already.
        let _ = rustix::net::send(stream.as_fd(), &told, SendFlags::DONTWAIT | SendFlags::NOSIGNAL);
        return;
    };
    let (mut read, mut write) = stream.split();
    let mut asked = [0; 4096];
    let _ = tokio::time::timeout(patience, read.read(&mut asked)).await;
    let _ = tokio::time::timeout(patience, write.write(&told, &[] as &[OwnedFd], None)).await;
}

/// What is empty is left out: some readers take a reply of nothing for nothing else.
fn reply(parameters: Value) -> Value {
    let is_empty = parameters.as_object().is_some_and(serde_json::Map::is_empty);
    if is_empty { json!({}) } else { json!({"parameters": parameters}) }
}

/// The messages of a client, each ended by a zero byte.
struct Messages<R> {
    read: R,
    bytes: Vec<u8>,
    /// Bytes of the last message, which go before the next is read.
    taken: usize,
}

impl<R: ReadHalf> Messages<R> {
    /// The next message without its zero byte.
    async fn next(&mut self) -> Result<&[u8], Hangup> {
        self.bytes.drain(..self.taken);
        self.taken = 0;
        let mut searched = 0;
        let mut chunk = [0; 4096];
        loop {
            if let Some(end) = self.bytes[searched..].iter().position(|byte| *byte == 0) {
                let end = searched + end;
                if end > MAX_MESSAGE_BYTES {
                    return Err(Hangup::TooLong);
                }
                self.taken = end + 1;
                return Ok(&self.bytes[..end]);
            }
            searched = self.bytes.len();
            if searched > MAX_MESSAGE_BYTES {
                return Err(Hangup::TooLong);
            }
            // No method takes descriptors: those that come with the bytes are closed here.
            let read = self.read.read(&mut chunk).await?.bytes_read();
            if read == 0 {
                return Err(Hangup::Left);
            }
            self.bytes.extend_from_slice(&chunk[..read]);
        }
    }
}

/// Ends when the peer has closed its side.
async fn hung_up(socket: &UnixStream) {
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
