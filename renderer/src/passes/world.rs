//! What every shader may read, bound as group 0: the frame, the light and the wind.

use wgpu::BufferUsages;

use crate::frame::gpu_data::Frame;
use crate::gpu::Gpu;
use crate::gpu::buffers::{self, Use};
use crate::scene::light::Light;
use crate::scene::wind;

/// The group.
#[derive(Debug)]
pub struct World {
    /// Its layout.
    pub layout: wgpu::BindGroupLayout,
    /// The group itself.
    pub bindings: wgpu::BindGroup,
    frame: wgpu::Buffer,
    light: wgpu::Buffer,
}

impl World {
    /// A group whose frame and light are all zero.
    pub fn new(gpu: &Gpu) -> Self {
        let stages = wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE;
        let layout = buffers::layout(gpu, "world", stages, &[Use::Uniform, Use::Uniform, Use::Read]);
        let uniform = |label, size: usize| {
            buffers::reserve(gpu, label, BufferUsages::UNIFORM | BufferUsages::COPY_DST, size as u64)
        };
        let frame = uniform("world.frame", size_of::<Frame>());
        let light = uniform("world.light", size_of::<Light>());
        let field = bytemuck::cast_slice(&wind::FIELD);
        let wind = buffers::upload(gpu, "world.wind", BufferUsages::STORAGE, field);
        let bindings = buffers::bind(gpu, "world", &layout, &[&frame, &light, &wind]);
        Self { layout, bindings, frame, light }
    }

    /// What the shaders read from the next submission on.
    pub fn write(&self, gpu: &Gpu, frame: &Frame, light: &Light) {
        gpu.queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(frame));
        gpu.queue.write_buffer(&self.light, 0, bytemuck::bytes_of(light));
    }
}
