//! A camera's node, through the crate `v4l`.
//!
//! The crate's stream panics when it is dropped and the kernel refuses to end it, so it is not dropped: the sensor process
//! ends, and the kernel takes all back. Its `next` queues a buffer again that a time-out left queued; no
//! time-out is set here, since whoever waits for this process has one, and any error ends the stream. Its `set_format`
//! carries over what `format` said of the rows of another size; a new `Format` is made each time. What it makes of a node's
//! capabilities panics on names that are no UTF-8; nothing is asked of them.

use std::io;
use std::mem::ManuallyDrop;
use std::path::Path;

use v4l::buffer::{Flags, Type};
use v4l::frameinterval::FrameIntervalEnum;
use v4l::framesize::{FrameSizeEnum, Stepwise};
use v4l::io::traits::CaptureStream;
use v4l::prelude::MmapStream;
use v4l::video::Capture;
use v4l::video::capture::Parameters;
use v4l::{Device, Format, FourCC};

use super::plan::Mode;
use super::stamp::{Clock, Moment, Stamp};
use crate::source::pixels::PixelFormat;

/// Buffers that the driver fills in turn.
const BUFFERS: u32 = 4;
/// The usual size: what is shown of a driver that scales to any.
const USUAL: [usize; 2] = [640, 480];

/// An open node.
pub(super) struct Camera(Device);

/// A camera that streams.
pub(super) struct Frames {
    stream: ManuallyDrop<MmapStream<'static>>,
    stride: usize,
}

/// A frame as the driver gives it.
pub(super) struct Raw<'a> {
    /// Its bytes, as many as the driver says that it filled.
    pub(super) bytes: &'a [u8],
    /// From one row to the next, bytes; 0 where the driver does not say.
    pub(super) stride: usize,
    /// Its number.
    pub(super) sequence: u32,
    /// Whether the driver says that it is damaged.
    pub(super) is_damaged: bool,
    /// When it was taken.
    pub(super) stamp: Stamp,
}

impl Camera {
    /// Opens a node.
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        Device::with_path(path).map(Self)
    }

    /// Its modes that may be depth; none of a node of something else.
    pub(super) fn modes(&self) -> Vec<Mode> {
        let known = self.0.enum_formats().unwrap_or_default();
        let known = known.iter().filter_map(|format| PixelFormat::of_fourcc(format.fourcc.repr));
        known.flat_map(|format| self.modes_of(format)).collect()
    }

    fn modes_of(&self, format: PixelFormat) -> Vec<Mode> {
        let fourcc = FourCC::new(&format.fourcc());
        let sizes = self.0.enum_framesizes(fourcc).unwrap_or_default();
        let sizes = sizes.into_iter().map(|size| match size.size {
            FrameSizeEnum::Discrete(size) => [size.width as usize, size.height as usize],
            FrameSizeEnum::Stepwise(steps) => nearest(&steps),
        });
        let modes = |size: [usize; 2]| {
            let rates = self.rates(fourcc, size);
            let fps: Vec<Option<u32>> = if rates.is_empty() { vec![None] } else { rates };
            fps.into_iter().map(move |fps| Mode { format, size, fps })
        };
        sizes.flat_map(modes).collect()
    }

    /// Frames each second at a size; of a driver that gives any rate, none.
    fn rates(&self, fourcc: FourCC, [width, height]: [usize; 2]) -> Vec<Option<u32>> {
        let intervals = self.0.enum_frameintervals(fourcc, width as u32, height as u32).unwrap_or_default();
        let rate = |interval: FrameIntervalEnum| match interval {
            FrameIntervalEnum::Discrete(interval) if interval.numerator > 0 => {
                let fps = f64::from(interval.denominator) / f64::from(interval.numerator);
                Some(fps.round() as u32)
            }
            _ => None,
        };
        intervals.into_iter().map(|interval| rate(interval.interval)).collect()
    }

    /// Sets a mode and starts.
    pub(super) fn start(self, mode: &Mode) -> io::Result<Frames> {
        let [width, height] = mode.size.map(|pixels| pixels as u32);
        let wanted = Format::new(width, height, FourCC::new(&mode.format.fourcc()));
        let given = self.0.set_format(&wanted)?;
        if (given.width, given.height, given.fourcc) != (width, height, wanted.fourcc) {
            let given = format!("{}x{} {}", given.width, given.height, given.fourcc);
            return Err(io::Error::other(format!("it was asked for {mode} and gives {given}")));
        }
        if let Some(fps) = mode.fps {
            // Some drivers have one rate and refuse to be told it.
            if let Err(error) = self.0.set_params(&Parameters::with_fps(fps)) {
                tracing::debug!(%error, fps, "the driver is not told how many frames a second");
            }
        }
        let stream = ManuallyDrop::new(MmapStream::with_buffers(&self.0, Type::VideoCapture, BUFFERS)?);
        Ok(Frames { stream, stride: given.stride as usize })
    }
}

/// Of the sizes that a driver scales to, the one nearest to the usual.
fn nearest(steps: &Stepwise) -> [usize; 2] {
    let along = |usual: usize, min: u32, max: u32, step: u32| {
        let inside = (usual as u32).clamp(min, max.max(min));
        (inside - (inside - min) % step.max(1)) as usize
    };
    [
        along(USUAL[0], steps.min_width, steps.max_width, steps.step_width),
        along(USUAL[1], steps.min_height, steps.max_height, steps.step_height),
    ]
}

impl Frames {
    /// The next frame.
    pub(super) fn next(&mut self) -> io::Result<Raw<'_>> {
        let (bytes, about) = self.stream.next()?;
        let now = Moment::now();
        let clock = match about.flags & Flags::TIMESTAMP_MASK {
            Flags::TIMESTAMP_MONOTONIC => Clock::Monotonic,
            Flags::TIMESTAMP_COPY => Clock::Copied,
            _ => Clock::Unknown,
        };
        let sensor_ns =
            i128::from(about.timestamp.sec) * 1_000_000_000 + i128::from(about.timestamp.usec) * 1000;
        let is_of_start = about.flags & Flags::TSTAMP_SRC_MASK == Flags::TSTAMP_SRC_SOE;
        Ok(Raw {
            bytes: &bytes[..(about.bytesused as usize).min(bytes.len())],
            stride: self.stride,
            sequence: about.sequence,
            is_damaged: about.flags.contains(Flags::ERROR),
            stamp: Stamp { sensor_ns, clock, is_of_start, now },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_sizes_in_steps_the_nearest_one_to_the_usual_is_taken() {
        let steps = |min, max, step| Stepwise {
            min_width: min,
            max_width: max,
            step_width: step,
            min_height: min,
            max_height: max,
            step_height: step,
        };
        assert_eq!(nearest(&steps(2, 4096, 2)), [640, 480]);
        assert_eq!(nearest(&steps(100, 500, 7)), [499, 478]);
        assert_eq!(nearest(&steps(1000, 1000, 0)), [1000, 1000]);
    }
}
