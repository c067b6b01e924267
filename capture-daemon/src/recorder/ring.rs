//! The last seconds, compressed in memory.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::shot::{Shape, Shot};
use crate::note::Note;

/// How hard frames are compressed: little, since most are thrown away.
const LEVEL: i32 = 1;

/// A frame in the ring.
#[derive(Debug)]
pub(super) struct Packed {
    notes: Vec<Note>,
    begins: Option<Note>,
    shape: Shape,
    timestamp_ns: u64,
    pixels: Vec<u8>,
    came: Instant,
}

impl Packed {
    fn of(shot: &Shot, came: Instant) -> std::io::Result<Self> {
        let Shot { notes, begins, frame } = shot;
        let pixels = zstd::bulk::compress(bytemuck::cast_slice(&frame.depth), LEVEL)?;
        let (notes, begins, shape) = (notes.clone(), begins.clone(), Shape::of(frame));
        Ok(Self { notes, begins, shape, timestamp_ns: frame.timestamp_ns, pixels, came })
    }

    /// As it was.
    ///
    /// # Errors
    /// When there is no memory for it.
    pub(super) fn unpack(&self) -> std::io::Result<Shot> {
        let bytes = zstd::bulk::decompress(&self.pixels, 2 * crate::frame::MAX_PIXELS)?;
        let frame = self.shape.frame(bytemuck::pod_collect_to_vec(&bytes), self.timestamp_ns);
        Ok(Shot { notes: self.notes.clone(), begins: self.begins.clone(), frame: Arc::new(frame) })
    }

    fn bytes(&self) -> usize {
        self.pixels.len() + size_of::<Self>()
    }
}

/// The ring.
#[derive(Debug)]
pub(super) struct Ring {
    span: Duration,
    max_bytes: usize,
    bytes: usize,
    frames: VecDeque<Arc<Packed>>,
}

impl Ring {
    /// One that holds frames of so long, and so many bytes at most.
    pub(super) fn new(span: Duration, max_bytes: usize) -> Self {
        Self { span, max_bytes, bytes: 0, frames: VecDeque::new() }
    }

    /// Takes a frame that came `now`; older ones go.
    ///
    /// # Errors
    /// When it cannot be compressed.
    pub(super) fn push(&mut self, shot: &Shot, now: Instant) -> std::io::Result<()> {
        let packed = Packed::of(shot, now)?;
        self.bytes += packed.bytes();
        self.frames.push_back(Arc::new(packed));
        let is_over = |ring: &Self| {
            let is_old = |first: &Arc<Packed>| now.saturating_duration_since(first.came) > ring.span;
            ring.frames.front().is_some_and(is_old) || ring.bytes > ring.max_bytes
        };
        while is_over(self)
            && let Some(gone) = self.frames.pop_front()
        {
            self.bytes -= gone.bytes();
        }
        Ok(())
    }

    /// What is there, from the first frame that a session can begin with; from the very first where there is none.
    pub(super) fn frames(&self) -> Vec<Arc<Packed>> {
        let first = self.frames.iter().position(|packed| packed.begins.is_some()).unwrap_or(0);
        // Of two sensors, or modes of one, the later.
        let last = self.frames.back().map(|packed| packed.shape);
        let alike = self.frames.iter().rposition(|packed| Some(packed.shape) != last).map_or(0, |at| at + 1);
        self.frames.iter().skip(first.max(alike)).cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bar;

    fn shot(index: u64, begins: bool) -> Shot {
        let frame = Arc::new(bar::frame(index, Some(500), 1300));
        Shot { notes: vec![Note::Asked], begins: begins.then_some(Note::Begins { captured: true }), frame }
    }

    fn held(ring: &Ring) -> Vec<u64> {
        let unpacked =
            ring.frames().iter().map(|packed| packed.unpack().expect("memory")).collect::<Vec<_>>();
        unpacked.iter().map(|shot| (shot.frame.timestamp_ns - 1_000_000_000) / 33_333_333).collect()
    }

    #[test]
    fn the_last_seconds_come_back_as_they_were() {
        let mut ring = Ring::new(Duration::from_secs(1), usize::MAX);
        let start = Instant::now();
        for index in 0..50 {
            ring.push(&shot(index, index % 10 == 4), start + Duration::from_millis(100 * index))
                .expect("memory");
        }
        // Ten before the last, and from there the first to begin with.
        assert_eq!(held(&ring), [44, 45, 46, 47, 48, 49]);
        let first = ring.frames()[0].unpack().expect("memory");
        let Shot { notes, begins, frame } = shot(44, true);
        assert_eq!((first.notes, first.begins, first.frame), (notes, begins, frame));
    }

    #[test]
    fn its_memory_is_bounded() {
        let mut ring = Ring::new(Duration::from_secs(1000), 20_000);
        let now = Instant::now();
        for index in 0..500 {
            ring.push(&shot(index, true), now).expect("memory");
            assert!(ring.bytes <= 20_000);
            assert_eq!(ring.bytes, ring.frames.iter().map(|packed| packed.bytes()).sum::<usize>());
        }
        let held = held(&ring);
        assert!(held.len() > 3 && held.last() == Some(&499), "{held:?}");
    }

    #[test]
    fn frames_of_another_shape_begin_another_recording() {
        let mut ring = Ring::new(Duration::from_secs(10), usize::MAX);
        let now = Instant::now();
        for index in 0..6 {
            let mut shot = shot(index, true);
            if index < 4 {
                Arc::make_mut(&mut shot.frame).depth_unit_m = 0.0001;
            }
            ring.push(&shot, now).expect("memory");
        }
        assert_eq!(held(&ring), [4, 5]);
    }
}
