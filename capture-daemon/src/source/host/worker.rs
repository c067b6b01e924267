//! The sensor process from within: it opens what it is told to and sends what comes, until it is killed.

use std::io::{self, IoSlice};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use rustix::cmsg_space;
use rustix::io::Errno;
use rustix::net::sockopt::set_socket_send_buffer_size;
use rustix::net::{SendAncillaryBuffer, SendAncillaryMessage, SendFlags, sendmsg};
use rustix::process::{Signal, set_parent_process_death_signal};

use super::message::Message;
use super::{Order, Task};
use crate::config::SensorDriver;
use crate::frame::DepthFrame;
use crate::source::listed::Listed;
#[cfg(feature = "v4l2")]
use crate::source::v4l2;
use crate::source::{faulty, openni2};

/// Bytes of packets that may wait for the daemon: a few frames, of which each packet only names the memory.
const SEND_BUFFER: usize = 8 << 10;
/// How often the daemon hears that a sensor is waited for.
const SAY_MISSING_EVERY: Duration = Duration::from_millis(500);

/// Nobody listens any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Closed;

/// The way to the daemon.
#[derive(Debug)]
pub(crate) struct Link {
    socket: OwnedFd,
    /// A frame that finds the way full is lost, rather than held up.
    is_live: bool,
    lost: u64,
    said_missing: Option<Instant>,
}

impl Link {
    /// Says something, and waits until there is room for it.
    pub(crate) fn say(&mut self, message: &Message) -> Result<(), Closed> {
        self.send(message, SendFlags::empty()).map(|_| ())
    }

    /// Says that a sensor is waited for, if that was not said a moment ago.
    pub(crate) fn missing(&mut self, reason: &str) -> Result<(), Closed> {
        if self.said_missing.is_some_and(|said| said.elapsed() < SAY_MISSING_EVERY) {
            return Ok(());
        }
        self.said_missing = Some(Instant::now());
        self.say(&Message::Missing(reason.to_owned()))
    }

    /// Sends a frame: where it is live and the way is full, the frame is counted as lost.
    pub(crate) fn frame(&mut self, frame: DepthFrame) -> Result<(), Closed> {
        let flags = if self.is_live { SendFlags::DONTWAIT } else { SendFlags::empty() };
        if self.lost > 0 && self.send(&Message::Lost(self.lost), flags)? {
            self.lost = 0;
        }
        if !self.send(&Message::Frame(frame), flags)? {
            self.lost += 1;
        }
        Ok(())
    }

    /// Whether there was room.
    fn send(&mut self, message: &Message, flags: SendFlags) -> Result<bool, Closed> {
        let (packet, memory) = match message.to_packet() {
            Ok(packet) => packet,
            Err(error) => {
                tracing::warn!(%error, "a frame is lost: there is no memory to send it in");
                return Ok(false);
            }
        };
        let mut space = [MaybeUninit::uninit(); cmsg_space!(ScmRights(1))];
        let mut control = SendAncillaryBuffer::new(&mut space);
        let descriptors = memory.as_ref().map(AsFd::as_fd);
        if let Some(descriptor) = &descriptors {
            control.push(SendAncillaryMessage::ScmRights(std::slice::from_ref(descriptor)));
        }
        loop {
            match sendmsg(&self.socket, &[IoSlice::new(&packet)], &mut control, flags | SendFlags::NOSIGNAL) {
                Ok(_) => return Ok(true),
                Err(Errno::AGAIN) => return Ok(false),
                Err(Errno::INTR) => {}
                Err(_) => return Err(Closed),
            }
        }
    }
}

/// Does what `order` says, with the socket on standard input. Ends when nobody listens any more, and is killed when the
/// thread that started it ends.
///
/// # Errors
/// When it was not started by the station.
pub fn work(order: &str) -> anyhow::Result<()> {
    set_parent_process_death_signal(Some(Signal::KILL))
        .context("the system does not say when the station ends")?;
    let order: Order = toml::from_str(order).context("the order is none; only the station starts this")?;
    let socket = io::stdin().as_fd().try_clone_to_owned().context("there is no socket")?;
    set_socket_send_buffer_size(&socket, SEND_BUFFER)
        .context("standard input is no socket; only the station starts this")?;
    let mut link = Link { socket, is_live: order.task == Task::Stream, lost: 0, said_missing: None };
    let done = match &order.task {
        Task::List => list(&order).and_then(|devices| {
            let list = serde_json::to_string(&devices).map_err(|error| error.to_string())?;
            Ok(link.say(&Message::Devices(list)))
        }),
        Task::Stream => stream(&order, &mut link),
        Task::Play { path, frames } => openni2::play(path, *frames, &order, &mut link),
    };
    if let Err(reason) = done {
        // Whether or not anybody hears it.
        let _ = link.say(&Message::Failed(reason));
    }
    Ok(())
}

/// What a program says that was built without V4L2.
#[cfg(not(feature = "v4l2"))]
const WITHOUT_V4L2: &str =
    "this program was built without V4L2; build it with the feature v4l2, which is on by default";

fn list(order: &Order) -> Result<Vec<Listed>, String> {
    match order.sensor.driver {
        #[cfg(feature = "v4l2")]
        Some(SensorDriver::V4l2) => Ok(v4l2::list(&order.sensor)),
        #[cfg(not(feature = "v4l2"))]
        Some(SensorDriver::V4l2) => Err(WITHOUT_V4L2.to_owned()),
        _ => openni2::list(&order.sensor.openni2_library),
    }
}

fn stream(order: &Order, link: &mut Link) -> Result<Result<(), Closed>, String> {
    match order.sensor.driver {
        #[cfg(feature = "v4l2")]
        Some(SensorDriver::V4l2) => v4l2::stream(order, link),
        #[cfg(not(feature = "v4l2"))]
        Some(SensorDriver::V4l2) => Err(WITHOUT_V4L2.to_owned()),
        Some(SensorDriver::Faulty) => faulty::stream(order, link),
        _ => openni2::stream(order, link),
    }
}
