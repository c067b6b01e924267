//! The sky behind everything. A plain gradient with sun, clouds and ridges, not yet a physical sky.

use super::ScenePipeline;
use crate::gpu::Gpu;

/// The pass.
#[derive(Debug)]
pub struct Sky {
    pipeline: wgpu::RenderPipeline,
}

impl Sky {
    /// The pass, with the frame's layout.
    pub fn new(gpu: &Gpu, frame: &wgpu::BindGroupLayout) -> Self {
        let pipeline = ScenePipeline {
            pass: "sky",
            layouts: &[Some(frame)],
            buffers: &[],
            topology: wgpu::PrimitiveTopology::TriangleList,
            depth: (wgpu::CompareFunction::GreaterEqual, false),
        };
        Self { pipeline: pipeline.create(gpu) }
    }

    /// Draws it where nothing was drawn yet; the frame is bound.
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_pipeline(&self.pipeline);
        pass.draw(0..3, 0..1);
    }
}
