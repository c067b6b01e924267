//! Safe handles of OpenNI2: context > device > stream > frame, each borrowed from the one before, so that none
//! outlives what it needs. All unsafe code of this crate is here.
//!
//! - The library is opened once and never closed: the threads of its drivers may outlast any handle.
//! - What its callbacks write to is never freed, so that none of them comes too late.
//! - Nothing is read without a deadline ([`Stream::next`]).
//! - Handles stay on their thread, as the raw pointers within them do.

#![allow(unsafe_code, reason = "calls into a C library")]

mod stream;

use std::collections::BTreeSet;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::{Path, PathBuf};
use std::ptr;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use openni2_sys as sys;

use self::stream::read_mode;
pub(super) use self::stream::{Frame, Stream};
use super::Mode;

/// The interface that the bindings are made of.
const API_VERSION: c_int = (sys::ONI_VERSION_MAJOR * 1000 + sys::ONI_VERSION_MINOR) as c_int;
/// Longest serial number, bytes.
const MAX_SERIAL: usize = 256;
/// Most modes that are looked at.
const MAX_MODES: usize = 1024;

/// Why OpenNI2 does not do what it is asked for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum OpenNiError {
    /// The library is not there, or is another.
    #[error(
        "{path}: OpenNI2 cannot be loaded ({reason}); install it (Debian's libopenni2-0), or set sensor.openni2_library to its file"
    )]
    Library {
        /// Where it was looked for.
        path: PathBuf,
        /// What the system said.
        reason: String,
    },
    /// It was loaded and refuses.
    #[error("OpenNI2 cannot {action}: {reason}")]
    Refused {
        /// What was tried.
        action: String,
        /// What it said.
        reason: String,
    },
}

/// A device as the library lists it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct DeviceInfo {
    /// What it is opened by; of a USB device with its bus and port.
    pub(super) uri: String,
    /// Its vendor.
    pub(super) vendor: String,
    /// Its model.
    pub(super) name: String,
    /// USB vendor and product; 0 where it has none.
    pub(super) usb: (u16, u16),
}

/// What the callbacks have heard. URIs, each of a device.
#[derive(Debug, Default)]
struct Heard {
    /// Gone since they were opened.
    gone: BTreeSet<String>,
    /// Recordings that are over.
    ended: BTreeSet<String>,
    /// Devices that came or went so far.
    changes: u64,
}

#[derive(Debug, Default)]
struct Events {
    heard: Mutex<Heard>,
    happened: Condvar,
}

impl Events {
    fn heard(&self) -> MutexGuard<'_, Heard> {
        // Sets of texts are whole after any panic.
        self.heard.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn note(&self, note: impl FnOnce(&mut Heard)) {
        note(&mut self.heard());
        self.happened.notify_all();
    }
}

/// Up to the first zero.
fn text_of(characters: &[c_char]) -> String {
    let bytes: Vec<u8> = characters.iter().map(|c| c.cast_unsigned()).take_while(|byte| *byte != 0).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// What a callback is of, and what it writes to.
///
/// # Safety
/// `info` is null or points to a device's description; `cookie` is the one that was registered.
unsafe fn of_callback<'a>(
    info: *const sys::OniDeviceInfo,
    cookie: *mut c_void,
) -> Option<(String, &'a Events)> {
    // SAFETY: the library passes a description that lives for the call.
    let info = unsafe { info.as_ref() }?;
    // SAFETY: the cookie points to events that are never freed and are changed under their lock alone.
    let events = unsafe { cookie.cast::<Events>().as_ref() }?;
    Some((text_of(&info.uri), events))
}

unsafe extern "C" fn connected(info: *const sys::OniDeviceInfo, cookie: *mut c_void) {
    // SAFETY: called by the library as it was registered.
    if let Some((uri, events)) = unsafe { of_callback(info, cookie) } {
        events.note(|heard| {
            heard.gone.remove(&uri);
            heard.changes += 1;
        });
    }
}

unsafe extern "C" fn disconnected(info: *const sys::OniDeviceInfo, cookie: *mut c_void) {
    // SAFETY: called by the library as it was registered.
    if let Some((uri, events)) = unsafe { of_callback(info, cookie) } {
        events.note(|heard| {
            heard.gone.insert(uri);
            heard.changes += 1;
        });
    }
}

unsafe extern "C" fn state_changed(
    info: *const sys::OniDeviceInfo,
    state: sys::OniDeviceState,
    cookie: *mut c_void,
) {
    // SAFETY: called by the library as it was registered.
    if let Some((uri, events)) = unsafe { of_callback(info, cookie) }
        && state == sys::ONI_DEVICE_STATE_EOF
    {
        events.note(|heard| {
            heard.ended.insert(uri);
        });
    }
}

/// The library, initialised.
pub(super) struct Context {
    api: &'static sys::OpenNi2,
    events: &'static Events,
    callbacks: sys::OniCallbackHandle,
}

impl Drop for Context {
    fn drop(&mut self) {
        // SAFETY: the handle came from the registration, and no device of this context is left.
        unsafe {
            self.api.oniUnregisterDeviceCallbacks(self.callbacks);
            self.api.oniShutdown();
        }
    }
}

impl Context {
    /// Opens the library at a path, or by its name where the system looks for libraries. It takes its drivers from
    /// `OpenNI2/Drivers` beside that file.
    ///
    /// # Errors
    /// When there is none, or not one driver of it starts.
    pub(super) fn open(library: &Path) -> Result<Self, OpenNiError> {
        let refused = |error: sys::LoadError| OpenNiError::Library {
            path: library.to_owned(),
            reason: error.to_string(),
        };
        // SAFETY: whoever configures the path answers for the library's initialisers; the bindings fit what has all
        // of these symbols.
        let api = unsafe { sys::OpenNi2::new(library) }.map_err(refused)?;
        let api: &'static sys::OpenNi2 = Box::leak(Box::new(api));
        let events: &'static Events = Box::leak(Box::default());
        // SAFETY: may be called at any time; a second time it counts.
        check(api, unsafe { api.oniInitialize(API_VERSION) }, || "start".to_owned())?;
        let mut callbacks = sys::OniDeviceCallbacks {
            deviceConnected: Some(connected),
            deviceDisconnected: Some(disconnected),
            deviceStateChanged: Some(state_changed),
        };
        let mut handle = ptr::null_mut();
        let cookie = ptr::from_ref(events).cast_mut().cast();
        // SAFETY: the functions are of the types that the header declares, and the cookie is never freed.
        let status = unsafe { api.oniRegisterDeviceCallbacks(&raw mut callbacks, cookie, &raw mut handle) };
        if let Err(error) = check(api, status, || "watch for devices".to_owned()) {
            // SAFETY: it is initialised, and nothing of it is in use.
            unsafe { api.oniShutdown() };
            return Err(error);
        }
        Ok(Self { api, events, callbacks: handle })
    }

    /// The devices that are plugged in.
    ///
    /// # Errors
    /// When the library refuses.
    pub(super) fn devices(&self) -> Result<Vec<DeviceInfo>, OpenNiError> {
        let (mut list, mut count) = (ptr::null_mut(), 0);
        // SAFETY: both point to where the library writes a list of its own and its length.
        let status = unsafe { self.api.oniGetDeviceList(&raw mut list, &raw mut count) };
        check(self.api, status, || "list the devices".to_owned())?;
        let count = usize::try_from(count).unwrap_or(0);
        let devices = if list.is_null() || count == 0 {
            Vec::new()
        } else {
            // SAFETY: the library has made a list of so many descriptions, which is ours until it is released.
            let list = unsafe { std::slice::from_raw_parts(list, count) };
            list.iter().map(described).collect()
        };
        if !list.is_null() {
            // SAFETY: it came from the library and is released once.
            unsafe { self.api.oniReleaseDeviceList(list) };
        }
        Ok(devices)
    }

    /// Waits until a device comes or goes, at most for `wait`.
    pub(super) fn wait_for_change(&self, wait: Duration) {
        let heard = self.events.heard();
        let before = heard.changes;
        let waited = self.events.happened.wait_timeout_while(heard, wait, |heard| heard.changes == before);
        // What it was woken for is looked at anew.
        drop(waited);
    }

    /// Opens a device by its URI, or a recording by its path.
    ///
    /// # Errors
    /// When the library refuses.
    pub(super) fn open_device(&self, uri: &str) -> Result<Device<'_>, OpenNiError> {
        let refused =
            |reason: &str| OpenNiError::Refused { action: format!("open {uri}"), reason: reason.to_owned() };
        let wanted = CString::new(uri).map_err(|_| refused("its name holds a zero byte"))?;
        {
            let mut heard = self.events.heard();
            heard.gone.remove(uri);
            heard.ended.remove(uri);
        }
        let mut handle = ptr::null_mut();
        // SAFETY: the text ends with a zero; the handle is written where it may be.
        let status = unsafe { self.api.oniDeviceOpen(wanted.as_ptr(), &raw mut handle) };
        check(self.api, status, || format!("open {uri}"))?;
        if handle.is_null() {
            return Err(refused("it gave no handle"));
        }
        Ok(Device { context: self, handle, uri: uri.to_owned() })
    }
}

fn described(info: &sys::OniDeviceInfo) -> DeviceInfo {
    DeviceInfo {
        uri: text_of(&info.uri),
        vendor: text_of(&info.vendor),
        name: text_of(&info.name),
        usb: (info.usbVendorId, info.usbProductId),
    }
}

/// What the library's status means.
fn check(
    api: &sys::OpenNi2,
    status: sys::OniStatus,
    action: impl FnOnce() -> String,
) -> Result<(), OpenNiError> {
    if status == sys::ONI_STATUS_OK {
        return Ok(());
    }
    // SAFETY: it gives a text that ends with a zero and stays until this thread calls the library again.
    let said = unsafe { api.oniGetExtendedError() };
    let said = if said.is_null() {
        String::new()
    } else {
        // SAFETY: as above.
        unsafe { CStr::from_ptr(said) }.to_string_lossy().into_owned()
    };
    let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
    let reason = match status {
        _ if !said.is_empty() => said,
        sys::ONI_STATUS_NO_DEVICE => "there is no such device".to_owned(),
        sys::ONI_STATUS_NOT_SUPPORTED | sys::ONI_STATUS_NOT_IMPLEMENTED => "it is not supported".to_owned(),
        status => format!("status {status}"),
    };
    Err(OpenNiError::Refused { action: action(), reason })
}

/// A device that is open.
pub(super) struct Device<'c> {
    context: &'c Context,
    handle: sys::OniDeviceHandle,
    uri: String,
}

impl Drop for Device<'_> {
    fn drop(&mut self) {
        // SAFETY: it is open, and its streams, which borrow it, are gone.
        let status = unsafe { self.context.api.oniDeviceClose(self.handle) };
        if status != sys::ONI_STATUS_OK {
            tracing::debug!(status, uri = self.uri, "the device does not close");
        }
    }
}

impl Device<'_> {
    fn api(&self) -> &sys::OpenNi2 {
        self.context.api
    }

    /// Whether it was unplugged: the library says so by a callback alone.
    pub(super) fn is_gone(&self) -> bool {
        self.context.events.heard().gone.contains(&self.uri)
    }

    /// Whether its recording is over.
    pub(super) fn is_over(&self) -> bool {
        self.context.events.heard().ended.contains(&self.uri)
    }

    /// Its description.
    ///
    /// # Errors
    /// When the library refuses.
    pub(super) fn info(&self) -> Result<DeviceInfo, OpenNiError> {
        let mut info = sys::OniDeviceInfo {
            uri: [0; 256],
            vendor: [0; 256],
            name: [0; 256],
            usbVendorId: 0,
            usbProductId: 0,
        };
        // SAFETY: it is open, and the description is written where there is room for one.
        let status = unsafe { self.api().oniDeviceGetInfo(self.handle, &raw mut info) };
        check(self.api(), status, || format!("describe {}", self.uri))?;
        Ok(described(&info))
    }

    /// Its serial number, if it tells one.
    pub(super) fn serial(&self) -> Option<String> {
        let mut serial = [0 as c_char; MAX_SERIAL];
        let mut size = MAX_SERIAL as c_int;
        let property = sys::ONI_DEVICE_PROPERTY_SERIAL_NUMBER as c_int;
        // SAFETY: it is open, and so many bytes may be written.
        let status = unsafe {
            self.api().oniDeviceGetProperty(self.handle, property, serial.as_mut_ptr().cast(), &raw mut size)
        };
        let serial = text_of(&serial[..MAX_SERIAL - 1]);
        (status == sys::ONI_STATUS_OK && !serial.trim().is_empty()).then(|| serial.trim().to_owned())
    }

    fn set<T>(&self, property: u32, value: &T) -> Result<(), OpenNiError> {
        let (value, size) = (ptr::from_ref(value).cast(), size_of::<T>() as c_int);
        // SAFETY: it is open, and so many bytes are read from the value.
        let status = unsafe { self.api().oniDeviceSetProperty(self.handle, property as c_int, value, size) };
        check(self.api(), status, || format!("set property {property} of {}", self.uri))
    }

    /// Of a recording: how fast it is played, in times real time, or -1 for each frame as it is read; whether it
    /// begins again at its end.
    ///
    /// # Errors
    /// When the library refuses, as for what is no recording.
    pub(super) fn set_playback(&self, speed: f32, repeats: bool) -> Result<(), OpenNiError> {
        self.set(sys::ONI_DEVICE_PROPERTY_PLAYBACK_REPEAT_ENABLED, &sys::OniBool::from(repeats))?;
        self.set(sys::ONI_DEVICE_PROPERTY_PLAYBACK_SPEED, &speed)
    }

    /// Modes of its depth, those that can be read; empty where it has no depth.
    pub(super) fn depth_modes(&self) -> Vec<Mode> {
        // SAFETY: it is open; what comes back is null or lives as long as the device is open.
        let info = unsafe { self.api().oniDeviceGetSensorInfo(self.handle, sys::ONI_SENSOR_DEPTH).as_ref() };
        let Some(info) = info.filter(|info| !info.pSupportedVideoModes.is_null()) else { return Vec::new() };
        let count = usize::try_from(info.numSupportedVideoModes).unwrap_or(0).min(MAX_MODES);
        // SAFETY: the library keeps so many modes there while the device is open.
        let modes = unsafe { std::slice::from_raw_parts(info.pSupportedVideoModes, count) };
        modes.iter().filter_map(read_mode).collect()
    }

    /// Its stream of depth.
    ///
    /// # Errors
    /// When it has none.
    pub(super) fn depth_stream(&self) -> Result<Stream<'_>, OpenNiError> {
        let mut handle = ptr::null_mut();
        // SAFETY: it is open, and the handle is written where it may be.
        let status =
            unsafe { self.api().oniDeviceCreateStream(self.handle, sys::ONI_SENSOR_DEPTH, &raw mut handle) };
        check(self.api(), status, || format!("stream depth from {}", self.uri))?;
        if handle.is_null() {
            let action = format!("stream depth from {}", self.uri);
            return Err(OpenNiError::Refused { action, reason: "it gave no handle".to_owned() });
        }
        Ok(Stream::of(self, handle))
    }
}
