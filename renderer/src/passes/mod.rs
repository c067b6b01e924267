//! One folder a pass: its resources in Rust, its shader, and where it computes, its CPU twin.

pub mod cull;
pub mod grass;
pub mod ground;
pub mod shadow;
pub mod sky;
pub mod tone;
pub mod world;

use crate::gpu::targets::{self, SAMPLES};

/// A pipeline that draws into the scene's targets.
pub(crate) struct ScenePipeline<'a> {
    /// Label, and name of the pass.
    pub pass: &'a str,
    /// Bind groups after the frame's.
    pub layouts: &'a [Option<&'a wgpu::BindGroupLayout>],
    /// Vertex buffers.
    pub buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    /// List or strip.
    pub topology: wgpu::PrimitiveTopology,
    /// Which depths pass, and whether they are written.
    pub depth: (wgpu::CompareFunction, bool),
}

impl ScenePipeline<'_> {
    pub(crate) fn create(&self, gpu: &crate::gpu::Gpu) -> wgpu::RenderPipeline {
        self.create_of(gpu, "vs_main", "fs_main")
    }

    /// The same with these entry points of the pass's shader.
    pub(crate) fn create_of(
        &self,
        gpu: &crate::gpu::Gpu,
        vertex: &str,
        fragment: &str,
    ) -> wgpu::RenderPipeline {
        let module = crate::gpu::shader::module(gpu, self.pass);
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(self.pass),
            bind_group_layouts: self.layouts,
            immediate_size: 0,
        });
        gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.pass),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(vertex),
                compilation_options: Default::default(),
                buffers: self.buffers,
            },
            primitive: wgpu::PrimitiveState { topology: self.topology, ..Default::default() },
            depth_stencil: Some(targets::depth_state(self.depth.0, self.depth.1)),
            multisample: wgpu::MultisampleState { count: SAMPLES, ..Default::default() },
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(fragment),
                compilation_options: Default::default(),
                targets: &[Some(targets::COLOUR.into())],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}
