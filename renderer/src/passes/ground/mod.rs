//! The ground under the grass, and its look from afar.

use super::ScenePipeline;
use crate::gpu::Gpu;

/// How far the ground reaches, metres: to where the haze has taken it.
pub const RANGE_M: f32 = 700.0;
/// From so far within a field's end to so far beyond it the ground takes the look of the meadow, metres.
pub const FIELD_FRINGE_M: f32 = 0.15;
/// Rings around the eye, narrow near it and wide far away.
pub const RINGS: u32 = 96;
/// Sectors of a ring.
pub const SECTORS: u32 = 120;

/// The pass.
#[derive(Debug)]
pub struct Ground {
    pipeline: wgpu::RenderPipeline,
}

impl Ground {
    /// The pass, with the layouts of the frame and of the shadows.
    pub fn new(gpu: &Gpu, frame: &wgpu::BindGroupLayout, shadow: &wgpu::BindGroupLayout) -> Self {
        let pipeline = ScenePipeline {
            pass: "ground",
            layouts: &[Some(frame), None, Some(shadow)],
            buffers: &[],
            topology: wgpu::PrimitiveTopology::TriangleStrip,
            depth: (wgpu::CompareFunction::Greater, true),
        };
        Self { pipeline: pipeline.create(gpu) }
    }

    /// Draws it; frame and shadows are bound.
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_pipeline(&self.pipeline);
        pass.draw(0..2 * (SECTORS + 1), 0..RINGS);
    }
}
