//! A depth camera that is not there: a USB video class device, plugged into this kernel over USB/IP (`vhci-hcd`), so that the
//! kernel's own `uvcvideo` finds and streams it. For a machine of its own: it needs root, and every program there sees it.

mod descriptors;
mod usbip;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs;
use std::io;
use std::net::Shutdown;
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use self::usbip::{Request, Wire};
use crate::programs::wait_for;

/// The host controller that it is plugged into.
const HUB: &str = "/sys/devices/platform/vhci_hcd.0";
/// A port of it without a device.
const IS_FREE: &str = "004";
/// High speed, as USB/IP counts them.
const HIGH_SPEED: u32 = 3;
/// How long the kernel may take to see that it is gone.
const PATIENCE: Duration = Duration::from_secs(10);
/// What stands before the pixels of a frame: its own length and flags.
const HEADER_BYTES: usize = 2;

/// A format of pixels, by its GUID.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// Depth, 16 bits.
    Z16,
    /// The same by another GUID.
    Invz,
    /// Infrared, 16 bits, then depth, 16 bits.
    Inzi,
    /// Grey, 16 bits.
    Y16,
    /// Grey, 10 bits in 16.
    Y10,
}

/// What goes wrong with a frame, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// It ends after half of its bytes.
    Short(u64),
    /// It is all zero.
    Blank(u64),
    /// It does not come, nor does any after it until the host agrees on a size anew.
    Stall(u64),
    /// The camera is unplugged before it.
    Unplug(u64),
}

/// What it sees: the depth of a frame by its number, of so many columns and rows.
pub type Picture = dyn Fn(u64, [usize; 2]) -> Vec<u16> + Send + Sync;

/// A camera.
#[derive(Clone)]
pub struct CameraParams {
    /// Format of its pixels.
    pub pixels: Pixels,
    /// Columns and rows of what it can send.
    pub sizes: Vec<[usize; 2]>,
    /// Frames each second.
    pub fps: u32,
    /// USB vendor and product.
    pub id: (u16, u16),
    /// Serial number.
    pub serial: &'static str,
    /// The port it is plugged into, from 0.
    pub port: u32,
    /// What it sees.
    pub picture: Arc<Picture>,
    /// What goes wrong.
    pub fault: Option<Fault>,
}

impl Default for CameraParams {
    fn default() -> Self {
        let picture = |k: u64, [width, height]: [usize; 2]| crate::sensors::picture(k as u32, width, height);
        Self {
            pixels: Pixels::Z16,
            sizes: vec![[320, 240]],
            fps: 15,
            id: (0x1234, 0x0001),
            serial: "A1",
            port: 0,
            picture: Arc::new(picture),
            fault: None,
        }
    }
}

/// What both threads of a camera know.
#[derive(Debug, Default)]
struct Known {
    /// Buffers of the host, by number and size, that wait for bytes of frames.
    buffers: VecDeque<(u32, usize)>,
    /// The newest transfer that came.
    newest: u32,
    /// Transfers that were taken back before they came: the kernel may send the two the wrong way round.
    early: BTreeSet<u32>,
    /// The size that was agreed on, from 1; `None` before that.
    size_index: Option<u8>,
    /// Another agreement was made: the frame that was under way is not ended.
    is_anew: bool,
    /// The cable is out.
    is_unplugged: bool,
    /// When the first bytes of each frame were sent, by its number, nanoseconds since 1970.
    sent_ns: BTreeMap<u64, u64>,
}

#[derive(Debug)]
struct Shared {
    known: Mutex<Known>,
    changed: Condvar,
    /// To answer by. Transfers are answered while `known` is held: one that was taken back must not be answered.
    wire: Mutex<Wire>,
}

impl Shared {
    fn known(&self) -> MutexGuard<'_, Known> {
        // Each change is a single assignment, and whole after any panic.
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wire(&self) -> MutexGuard<'_, Wire> {
        self.wire.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn unplug(&self) {
        self.known().is_unplugged = true;
        self.changed.notify_all();
        // The other end may have gone.
        let _ = self.wire().0.shutdown(Shutdown::Both);
    }
}

/// A camera that is plugged in; unplugged when dropped.
#[derive(Debug)]
pub struct Camera {
    shared: Arc<Shared>,
    port: u32,
    threads: Vec<JoinHandle<()>>,
}

impl Camera {
    /// Plugs a camera in. The kernel needs a moment to find it.
    ///
    /// # Panics
    /// If there is no `vhci-hcd`, or its port is taken.
    pub fn plug(params: CameraParams) -> Self {
        let (host, camera) = UnixStream::pair().expect("a socket");
        let port = params.port;
        let order = format!("{port} {} {} {HIGH_SPEED}", host.as_raw_fd(), port + 1);
        fs::write(format!("{HUB}/attach"), order).expect("the kernel takes the device");
        let reader = Wire(camera.try_clone().expect("a descriptor"));
        let shared = Arc::new(Shared {
            known: Mutex::default(),
            changed: Condvar::new(),
            wire: Mutex::new(Wire(camera)),
        });
        let params = Arc::new(params);
        let answering = (Arc::clone(&shared), Arc::clone(&params));
        let sending = Arc::clone(&shared);
        let threads = vec![
            std::thread::spawn(move || {
                let (shared, params) = answering;
                // The end is an error, too.
                let _ = answer(&shared, &params, reader);
                shared.unplug();
            }),
            std::thread::spawn(move || {
                let _ = send(&sending, &params);
            }),
        ];
        Self { shared, port, threads }
    }

    /// The newest frame that was on its way by then, `unix_ns` being nanoseconds since 1970.
    pub fn newest_frame(&self, unix_ns: u64) -> Option<u64> {
        let known = self.shared.known();
        let by_then = known.sent_ns.iter().filter(|(_, sent_ns)| **sent_ns <= unix_ns);
        by_then.map(|(k, _)| *k).max()
    }

    /// Pulls the cable out, and waits until the kernel has seen it.
    pub fn unplug(self) {
        drop(self);
    }
}

impl Drop for Camera {
    fn drop(&mut self) {
        self.shared.unplug();
        for thread in self.threads.drain(..) {
            // One that panicked has said so.
            let _ = thread.join();
        }
        let port = format!("{:04}", self.port);
        let device = PathBuf::from(format!("/sys/bus/usb/devices/1-{}", self.port + 1));
        wait_for(PATIENCE, || {
            let status = fs::read_to_string(format!("{HUB}/status")).unwrap_or_default();
            let mut lines = status.lines().map(|line| line.split_ascii_whitespace().collect::<Vec<_>>());
            let is_free = lines.any(|words| words.get(1) == Some(&&*port) && words.get(2) == Some(&IS_FREE));
            (is_free && !device.exists()).then_some(())
        });
    }
}

/// Answers the host until the cable is out.
fn answer(shared: &Shared, params: &CameraParams, mut reader: Wire) -> io::Result<()> {
    // What the host proposed last.
    let mut size_index = 1;
    loop {
        match reader.read()? {
            Request::Frames { number, room } => {
                let mut known = shared.known();
                known.newest = number;
                if !known.early.remove(&number) {
                    known.buffers.push_back((number, room));
                    shared.changed.notify_all();
                }
            }
            Request::TakeBack { number, of } => {
                let mut known = shared.known();
                let place = known.buffers.iter().position(|(number, _)| *number == of);
                if let Some(place) = place {
                    known.buffers.remove(place);
                } else if of > known.newest {
                    known.early.insert(of);
                }
                shared.wire().taken_back(number, place.is_some())?;
            }
            Request::Control { number, setup, room: Some(room), .. } => {
                shared.known().newest = number;
                match said(setup, size_index, params) {
                    Some(bytes) => shared.wire().give(number, &bytes[..bytes.len().min(room)])?,
                    None => shared.wire().refuse(number)?,
                }
            }
            Request::Control { number, setup, room: None, data } => {
                shared.known().newest = number;
                if !hear(setup, &data, &mut size_index, shared, params) {
                    shared.wire().refuse(number)?;
                    continue;
                }
                shared.wire().took(number, data.len())?;
            }
        }
    }
}

/// What the camera says to a request; `None` to one that it does not know.
fn said(setup: [u8; 8], size_index: u8, params: &CameraParams) -> Option<Vec<u8>> {
    let [kind, request, index, value, ..] = setup;
    match (kind, request) {
        (0x80, 6) => match value {
            1 => Some(descriptors::device(params)),
            2 => Some(descriptors::configuration(params)),
            3 => descriptors::name(index, params),
            _ => None,
        },
        // Status of device, interface and endpoint.
        (0x80..=0x82, 0) => Some(vec![0, 0]),
        // Of probe (1) and commit (2): what can be done with it, its length, and what it is, now, at least, at most,
        // by default.
        (0xa1, 0x86) => Some(vec![3]),
        (0xa1, 0x85) => Some(26_u16.to_le_bytes().to_vec()),
        (0xa1, 0x81..=0x84 | 0x87) if [1, 2].contains(&value) => {
            Some(descriptors::agreement(size_index, params))
        }
        _ => None,
    }
}

/// Hears what the host orders; whether it is known.
fn hear(setup: [u8; 8], data: &[u8], size_index: &mut u8, shared: &Shared, params: &CameraParams) -> bool {
    let [kind, request, _, value, ..] = setup;
    match (kind, request, value) {
        // A configuration, an interface's setting, an endpoint to go on.
        (0, 9, _) | (1, 11, _) | (2, 1, _) => true,
        (0x21, 1, 1 | 2) => {
            let wanted = data.get(3).copied().unwrap_or(1);
            *size_index = wanted.clamp(1, params.sizes.len() as u8);
            if value == 2 {
                let mut known = shared.known();
                (known.size_index, known.is_anew) = (Some(*size_index), true);
                shared.changed.notify_all();
            }
            true
        }
        _ => false,
    }
}

/// The bytes of a frame, with what stands before them.
fn payload(k: u64, size: [usize; 2], params: &CameraParams) -> Vec<u8> {
    // Header's length; end of header, end of frame, and a bit that is another one in the next frame.
    let mut bytes = vec![HEADER_BYTES as u8, 0x82 | (k & 1) as u8];
    let mut depth = (params.picture)(k, size);
    if params.fault == Some(Fault::Blank(k)) {
        depth.fill(0);
    }
    if params.pixels == Pixels::Inzi {
        bytes.extend((0..depth.len()).flat_map(|index| ((index % 1024) as u16).to_le_bytes()));
    }
    bytes.extend(depth.iter().flat_map(|count| count.to_le_bytes()));
    if params.fault == Some(Fault::Short(k)) {
        bytes.truncate(bytes.len() / 2);
    }
    bytes
}

/// Sends frames as they are asked for, at their pace, until the cable is out.
fn send(shared: &Shared, params: &CameraParams) -> io::Result<()> {
    let every = Duration::from_secs(1) / params.fps;
    let mut due = Instant::now();
    let mut frame: Option<(Vec<u8>, usize)> = None;
    let (mut k, mut has_stalled) = (0, false);
    let mut fault = params.fault;
    loop {
        let mut known = shared.known();
        while known.buffers.is_empty() && !known.is_unplugged {
            known = shared.changed.wait(known).unwrap_or_else(PoisonError::into_inner);
        }
        if known.is_unplugged {
            return Ok(());
        }
        if std::mem::take(&mut known.is_anew) {
            (frame, due) = (None, Instant::now());
            if has_stalled {
                fault = None;
            }
        }
        let size = params.sizes[usize::from(known.size_index.unwrap_or(1)) - 1];
        let Some((bytes, sent)) = &mut frame else {
            drop(known);
            match fault {
                Some(Fault::Stall(from)) if k >= from => {
                    has_stalled = true;
                    std::thread::sleep(every);
                    continue;
                }
                Some(Fault::Unplug(from)) if k >= from => {
                    shared.unplug();
                    return Ok(());
                }
                _ => {}
            }
            frame = Some((payload(k, size, params), 0));
            k += 1;
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            // On a grid, so that a late one does not make all after it late; after a long silence not all at once.
            due = due.max(Instant::now().checked_sub(10 * every).unwrap_or(due)) + every;
            continue;
        };
        let (number, room) = known.buffers.pop_front().expect("it is not empty");
        if *sent == 0 {
            let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |now| now.as_nanos() as u64);
            known.sent_ns.insert(k - 1, now);
        }
        let end = (*sent + room).min(bytes.len());
        shared.wire().give(number, &bytes[*sent..end])?;
        *sent = end;
        if end == bytes.len() {
            frame = None;
        }
    }
}
