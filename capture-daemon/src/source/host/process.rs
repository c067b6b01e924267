//! The sensor process as the daemon has it: started, listened to with a deadline, killed.

use std::io::{self, IoSliceMut};
use std::mem::MaybeUninit;
use std::os::fd::OwnedFd;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::cmsg_space;
use rustix::io::Errno;
use rustix::net::sockopt::{Timeout, set_socket_timeout};
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SocketFlags, SocketType, recvmsg,
    socketpair,
};

use super::message::{MAX_BYTES, Message, MessageError};

/// The verb by which this program is a sensor process.
pub(crate) const VERB: &str = "sensor-process";
/// How long it is waited for a process that was killed; one that the kernel does not let go of is left to a thread.
const PATIENCE: Duration = Duration::from_secs(1);

/// Why no message comes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum ReceiveError {
    /// Not within the wait.
    #[error("the sensor process says nothing")]
    Silent,
    /// It is over.
    #[error("the sensor process {0}")]
    Ended(String),
    /// A frame came whose numbers and bytes do not fit.
    #[error("{0}")]
    BadFrame(String),
    /// What came is no message.
    #[error("{0}")]
    Nonsense(String),
}

/// A sensor process; killed when dropped.
#[derive(Debug)]
pub(crate) struct Process {
    child: Option<Child>,
    socket: OwnedFd,
}

impl Process {
    /// Starts `program` as a sensor process that is told `order`.
    ///
    /// # Errors
    /// When there is no room for another process or socket.
    pub(crate) fn start(program: &Path, order: &str) -> io::Result<Self> {
        let (socket, theirs) =
            socketpair(AddressFamily::UNIX, SocketType::SEQPACKET, SocketFlags::CLOEXEC, None)?;
        let child = Command::new(program)
            .arg0("sward-capture")
            .args([VERB, order])
            // Its standard input is the socket.
            .stdin(Stdio::from(theirs))
            .stdout(Stdio::null())
            .env_remove("NOTIFY_SOCKET")
            .env_remove("WATCHDOG_USEC")
            .spawn()?;
        Ok(Self { child: Some(child), socket })
    }

    /// What it says next.
    ///
    /// # Errors
    /// When nothing comes within `wait`, it is over, or what it says means nothing.
    pub(crate) fn receive(&mut self, wait: Duration) -> Result<Message, ReceiveError> {
        let mut bytes = [0; MAX_BYTES];
        let mut space = [MaybeUninit::uninit(); cmsg_space!(ScmRights(4))];
        let mut control = RecvAncillaryBuffer::new(&mut space);
        // A wait of nothing would be one for ever.
        let wait = wait.max(Duration::from_millis(1));
        let received = set_socket_timeout(&self.socket, Timeout::Recv, Some(wait)).and_then(|()| {
            let mut vector = [IoSliceMut::new(&mut bytes)];
            recvmsg(&self.socket, &mut vector, &mut control, RecvFlags::CMSG_CLOEXEC)
        });
        let received = match received {
            Ok(received) if received.bytes == 0 => return Err(ReceiveError::Ended(self.end())),
            Ok(received) => received.bytes,
            Err(Errno::AGAIN | Errno::INTR) => return Err(ReceiveError::Silent),
            Err(_) => return Err(ReceiveError::Ended(self.end())),
        };
        let mut descriptors: Vec<OwnedFd> = Vec::new();
        for message in control.drain() {
            if let RecvAncillaryMessage::ScmRights(rights) = message {
                descriptors.extend(rights);
            }
        }
        let message = Message::of_packet(&bytes[..received], descriptors.pop());
        message.map_err(|error| match error {
            MessageError::Frame { .. } => ReceiveError::BadFrame(error.to_string()),
            _ => ReceiveError::Nonsense(error.to_string()),
        })
    }

    /// How it ended; killed if it does not by itself.
    fn end(&mut self) -> String {
        let due = Instant::now() + PATIENCE;
        while let Some(child) = &mut self.child {
            match child.try_wait() {
                Ok(Some(status)) => {
                    self.child = None;
                    return told(status);
                }
                Ok(None) if Instant::now() < due => std::thread::sleep(Duration::from_millis(5)),
                _ => break,
            }
        }
        "closed its socket".to_owned()
    }
}

/// An exit in words.
fn told(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("ended with exit code {code}"),
        (_, Some(signal)) => format!("crashed (signal {signal})"),
        _ => "ended".to_owned(),
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let Some(mut child) = self.child.take() else { return };
        // It may have ended by itself.
        let _ = child.kill();
        let due = Instant::now() + PATIENCE;
        while Instant::now() < due {
            if !matches!(child.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        tracing::warn!(
            id = child.id(),
            "the sensor process does not end though it was killed: its driver hangs in the kernel"
        );
        std::thread::spawn(move || child.wait());
    }
}
