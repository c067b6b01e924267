//! A stream of depth and its frames.

use std::ffi::c_int;
use std::ptr;
use std::time::Duration;

use openni2_sys as sys;

use super::{Device, Mode, OpenNiError, check};
use crate::frame::MAX_PIXELS;

/// A mode whose pixels are depth in a unit.
pub(super) fn read_mode(mode: &sys::OniVideoMode) -> Option<Mode> {
    let depth_unit_m = match mode.pixelFormat {
        sys::ONI_PIXEL_FORMAT_DEPTH_1_MM => 0.001,
        sys::ONI_PIXEL_FORMAT_DEPTH_100_UM => 0.0001,
        _ => return None,
    };
    let [width, height] = [mode.resolutionX, mode.resolutionY].map(|side| usize::try_from(side).unwrap_or(0));
    let fits = width.checked_mul(height).is_some_and(|pixels| (1..=MAX_PIXELS).contains(&pixels));
    fits.then(|| Mode { width, height, fps: u32::try_from(mode.fps).unwrap_or(0), depth_unit_m })
}

/// A stream of depth.
pub(in super::super) struct Stream<'d> {
    device: &'d Device<'d>,
    handle: sys::OniStreamHandle,
    is_started: bool,
}

impl Drop for Stream<'_> {
    fn drop(&mut self) {
        let api = self.device.api();
        // SAFETY: it was made and not yet destroyed; its frames, which borrow it, are gone.
        unsafe {
            if self.is_started {
                api.oniStreamStop(self.handle);
            }
            api.oniStreamDestroy(self.handle);
        }
    }
}

impl<'d> Stream<'d> {
    /// Of what the library has made.
    pub(super) fn of(device: &'d Device<'d>, handle: sys::OniStreamHandle) -> Self {
        Self { device, handle, is_started: false }
    }
}

impl Stream<'_> {
    /// Reads a property whose bytes are any `T`.
    fn get<T: bytemuck::Pod>(&self, property: u32) -> Option<T> {
        let mut value = T::zeroed();
        let mut size = size_of::<T>() as c_int;
        let to = (&raw mut value).cast();
        // SAFETY: the stream is there, and so many bytes may be written; any bytes are a `T`.
        let status = unsafe {
            self.device.api().oniStreamGetProperty(self.handle, property as c_int, to, &raw mut size)
        };
        (status == sys::ONI_STATUS_OK && size == size_of::<T>() as c_int).then_some(value)
    }

    fn set<T>(&self, property: u32, value: &T) -> Result<(), OpenNiError> {
        let (value, size) = (ptr::from_ref(value).cast(), size_of::<T>() as c_int);
        let api = self.device.api();
        // SAFETY: the stream is there, and so many bytes are read from the value.
        let status = unsafe { api.oniStreamSetProperty(self.handle, property as c_int, value, size) };
        check(api, status, || format!("set property {property} of the depth of {}", self.device.uri))
    }

    /// Its mode, if its pixels are depth in a unit.
    pub(in super::super) fn mode(&self) -> Option<Mode> {
        let [pixel_format, width, height, fps] =
            self.get::<[c_int; 4]>(sys::ONI_STREAM_PROPERTY_VIDEO_MODE)?;
        let pixel_format = pixel_format.cast_unsigned();
        read_mode(&sys::OniVideoMode {
            pixelFormat: pixel_format,
            resolutionX: width,
            resolutionY: height,
            fps,
        })
    }

    /// Goes by another mode; before it is started.
    ///
    /// # Errors
    /// When the library refuses.
    pub(in super::super) fn set_mode(&self, mode: &Mode) -> Result<(), OpenNiError> {
        let is_millimetres = mode.depth_unit_m == 0.001;
        let [millimetres, tenths] = [sys::ONI_PIXEL_FORMAT_DEPTH_1_MM, sys::ONI_PIXEL_FORMAT_DEPTH_100_UM];
        let mode = sys::OniVideoMode {
            pixelFormat: if is_millimetres { millimetres } else { tenths },
            resolutionX: mode.width as c_int,
            resolutionY: mode.height as c_int,
            fps: mode.fps as c_int,
        };
        self.set(sys::ONI_STREAM_PROPERTY_VIDEO_MODE, &mode)
    }

    /// Angles that it sees, across and down, radians.
    pub(in super::super) fn field_of_view(&self) -> Option<[f64; 2]> {
        let across = self.get::<f32>(sys::ONI_STREAM_PROPERTY_HORIZONTAL_FOV)?;
        let down = self.get::<f32>(sys::ONI_STREAM_PROPERTY_VERTICAL_FOV)?;
        Some([across, down].map(f64::from))
    }

    /// Whether left and right are exchanged; `None` where it does not say.
    pub(in super::super) fn is_mirrored(&self) -> Option<bool> {
        self.get::<sys::OniBool>(sys::ONI_STREAM_PROPERTY_MIRRORING).map(|mirrored| mirrored != 0)
    }

    /// Exchanges left and right, or no longer.
    ///
    /// # Errors
    /// When the library refuses.
    pub(in super::super) fn set_mirrored(&self, is_mirrored: bool) -> Result<(), OpenNiError> {
        self.set(sys::ONI_STREAM_PROPERTY_MIRRORING, &sys::OniBool::from(is_mirrored))
    }

    /// Of a recording: its number of frames, if it says one.
    pub(in super::super) fn frames(&self) -> Option<u64> {
        let frames = self.get::<c_int>(sys::ONI_STREAM_PROPERTY_NUMBER_OF_FRAMES)?;
        u64::try_from(frames).ok().filter(|frames| *frames > 0)
    }

    /// Has frames come.
    ///
    /// # Errors
    /// When the library refuses.
    pub(in super::super) fn start(&mut self) -> Result<(), OpenNiError> {
        let api = self.device.api();
        // SAFETY: the stream is there.
        let status = unsafe { api.oniStreamStart(self.handle) };
        check(api, status, || format!("start the depth of {}", self.device.uri))?;
        self.is_started = true;
        Ok(())
    }

    /// The next frame; `None` when none comes within `wait`.
    ///
    /// # Errors
    /// When the library refuses.
    pub(in super::super) fn next(&mut self, wait: Duration) -> Result<Option<Frame<'_>>, OpenNiError> {
        let api = self.device.api();
        let (mut streams, mut ready) = ([self.handle], -1);
        let wait_ms = c_int::try_from(wait.as_millis()).unwrap_or(c_int::MAX);
        // SAFETY: one stream, which is there, and where to write which of them is ready.
        let status = unsafe { api.oniWaitForAnyStream(streams.as_mut_ptr(), 1, &raw mut ready, wait_ms) };
        if status == sys::ONI_STATUS_TIME_OUT {
            return Ok(None);
        }
        check(api, status, || format!("wait for the depth of {}", self.device.uri))?;
        let mut frame = ptr::null_mut();
        // SAFETY: the stream is there and has a frame, which is ours until it is released.
        let status = unsafe { api.oniStreamReadFrame(self.handle, &raw mut frame) };
        check(api, status, || format!("read the depth of {}", self.device.uri))?;
        // SAFETY: null, or a frame that stays as it is until it is released, when this borrow is over.
        Ok(unsafe { frame.as_ref() }.map(|frame| Frame { api, frame }))
    }
}

/// A frame, which the library keeps until this is dropped.
pub(in super::super) struct Frame<'s> {
    api: &'s sys::OpenNi2,
    frame: &'s sys::OniFrame,
}

impl Drop for Frame<'_> {
    fn drop(&mut self) {
        // SAFETY: it came from the library and is released once; nothing reads it after.
        unsafe { self.api.oniFrameRelease(ptr::from_ref(self.frame).cast_mut()) };
    }
}

impl Frame<'_> {
    /// Its number in the stream, from 1 as the drivers count.
    pub(in super::super) fn index(&self) -> i64 {
        self.frame.frameIndex.into()
    }

    /// When it was taken, microseconds on the sensor's own clock.
    pub(in super::super) fn timestamp_us(&self) -> u64 {
        self.frame.timestamp
    }

    /// The mode that it was taken in, of which it may be a section; `None` where its pixels are no depth in a unit.
    pub(in super::super) fn mode(&self) -> Option<Mode> {
        read_mode(&self.frame.videoMode)
    }

    /// Columns and rows.
    pub(in super::super) fn size(&self) -> Option<[usize; 2]> {
        let [width, height] =
            [self.frame.width, self.frame.height].map(|side| usize::try_from(side).unwrap_or(0));
        let fits = width.checked_mul(height).is_some_and(|pixels| (1..=MAX_PIXELS).contains(&pixels));
        fits.then_some([width, height])
    }

    /// Its first column and row in the picture of its mode.
    pub(in super::super) fn origin(&self) -> [i64; 2] {
        let sys::OniFrame { croppingEnabled, cropOriginX, cropOriginY, .. } = *self.frame;
        if croppingEnabled == 0 { [0; 2] } else { [cropOriginX.into(), cropOriginY.into()] }
    }

    /// Its pixels, row by row.
    ///
    /// # Errors
    /// What is wrong with its size, where it has less than it should.
    pub(in super::super) fn pixels(&self) -> Result<Vec<u16>, String> {
        let sys::OniFrame { data, dataSize, stride, width, height, .. } = *self.frame;
        let [found, step] = [dataSize, stride].map(|bytes| usize::try_from(bytes).unwrap_or(0));
        let Some([width, height]) = self.size() else {
            return Err(format!("a frame of {width}x{height} px, expected up to {MAX_PIXELS} pixels"));
        };
        let expected = step.saturating_mul(height - 1).saturating_add(2 * width);
        if data.is_null() || step < 2 * width || found < expected {
            return Err(format!(
                "a frame of {width}x{height} px with {found} bytes in rows of {step}, expected {expected} or more"
            ));
        }
        // SAFETY: the library keeps so many bytes there until the frame is released, and nobody writes to them.
        let bytes = unsafe { std::slice::from_raw_parts(data.cast::<u8>(), expected) };
        let mut pixels = Vec::with_capacity(width * height);
        for row in bytes.chunks(step) {
            pixels
                .extend(row[..2 * width].chunks_exact(2).map(|pair| u16::from_ne_bytes([pair[0], pair[1]])));
        }
        Ok(pixels)
    }
}
