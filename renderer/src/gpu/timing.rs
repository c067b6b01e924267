//! How long each pass takes on the GPU, by its own clock.

use std::sync::Mutex;
use std::sync::PoisonError;

use super::Gpu;
use super::readback::{self, ReadbackError};

/// Passes of a frame that can be timed.
const PASSES: u32 = 16;

/// A pass and the time it took.
#[derive(Clone, Debug, PartialEq)]
pub struct Timed {
    /// Its label.
    pub pass: &'static str,
    /// Seconds.
    pub seconds: f64,
}

/// Timestamps before and after each pass of a frame.
#[derive(Debug)]
pub struct Timing {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    /// Labels of this frame's passes, in order.
    passes: Mutex<Vec<&'static str>>,
}

impl Timing {
    /// `None` where the device has no such clock.
    pub fn new(gpu: &Gpu) -> Option<Self> {
        if !gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
        Some(Self {
            queries: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timing"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * PASSES,
            }),
            resolved: super::buffers::reserve(gpu, "timing.resolved", usage, u64::from(2 * PASSES) * 8),
            passes: Mutex::default(),
        })
    }

    /// The two queries of a new pass of this frame; none when there are too many passes.
    fn next(&self, label: &'static str) -> Option<[Option<u32>; 2]> {
        let mut passes = self.passes.lock().unwrap_or_else(PoisonError::into_inner);
        let at = passes.len() as u32;
        (at < PASSES).then(|| {
            passes.push(label);
            [Some(2 * at), Some(2 * at + 1)]
        })
    }

    /// What a compute pass of this label is begun with.
    pub fn compute(&self, label: &'static str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let [begin, end] = self.next(label)?;
        Some(wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: begin,
            end_of_pass_write_index: end,
        })
    }

    /// What a render pass of this label is begun with.
    pub fn render(&self, label: &'static str) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let [begin, end] = self.next(label)?;
        Some(wgpu::RenderPassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: begin,
            end_of_pass_write_index: end,
        })
    }

    /// To be encoded after the frame's last pass.
    pub fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        let passes = self.passes.lock().unwrap_or_else(PoisonError::into_inner).len() as u32;
        if passes > 0 {
            encoder.resolve_query_set(&self.queries, 0..2 * passes, &self.resolved, 0);
        }
    }

    /// Waits for the frame and gives its times; the next frame starts anew.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn take(&self, gpu: &Gpu) -> Result<Vec<Timed>, ReadbackError> {
        let passes = std::mem::take(&mut *self.passes.lock().unwrap_or_else(PoisonError::into_inner));
        let bytes = readback::buffer(gpu, &self.resolved)?;
        let ticks: Vec<u64> = bytes.chunks_exact(8).map(bytemuck::pod_read_unaligned).collect();
        let tick_s = f64::from(gpu.queue.get_timestamp_period()) * 1e-9;
        let seconds = |pair: &[u64]| pair[1].saturating_sub(pair[0]) as f64 * tick_s;
        Ok(passes
            .into_iter()
            .zip(ticks.chunks_exact(2))
            .map(|(pass, pair)| Timed { pass, seconds: seconds(pair) })
            .collect())
    }
}
