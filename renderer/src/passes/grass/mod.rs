//! The blades, each a ribbon that the vertex shader expands from the library's own knot bytes.

use common::library::Snapshot;
use wgpu::BufferUsages;

use super::ScenePipeline;
use super::cull::{Cull, LEVELS, gpu_data::Instance};
use super::shadow::Shadows;
use crate::gpu::Gpu;
use crate::gpu::buffers::{Use, bind, layout, upload};
use crate::scene::grassland;

/// What the shader reads, in its layout.
pub mod gpu_data {
    use bytemuck::{Pod, Zeroable};

    /// One blade of the library.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
    pub struct Shape {
        /// Its first knot.
        pub first_knot: u32,
        /// Its number of knots, 2..=64.
        pub knot_count: u32,
    }
}
use gpu_data::Shape;

/// Levels of detail, from the nearest, that throw shadows: as far as the map of shadows reaches.
const SHADOW_LEVELS: u32 = 2;
/// How much taller than its captured shape a blade may grow: scale and lushness together.
const MAX_GROWTH: f32 = grassland::SCALE.1 * 1.08;

/// A library on the GPU, whole and unchanging: a newer one is another value.
#[derive(Debug)]
pub struct Growth {
    bindings: wgpu::BindGroup,
    /// How far any part of any blade is from its root, metres.
    pub reach_m: f32,
}

/// The pass.
#[derive(Debug)]
pub struct Grass {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    indices: wgpu::Buffer,
    /// The shadows that it throws.
    pub shadows: Shadows,
}

/// How an instance lies in its buffer.
fn instances() -> wgpu::VertexBufferLayout<'static> {
    const ATTRIBUTES: [wgpu::VertexAttribute; 5] = wgpu::vertex_attr_array![
        0 => Float32x3, 1 => Uint32, 2 => Float32x2, 3 => Float32, 4 => Float32
    ];
    wgpu::VertexBufferLayout {
        array_stride: size_of::<Instance>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &ATTRIBUTES,
    }
}

impl Grass {
    /// The pass, with the frame's layout.
    pub fn new(gpu: &Gpu, frame: &wgpu::BindGroupLayout) -> Self {
        let layout = layout(gpu, "grass", wgpu::ShaderStages::VERTEX, &[Use::Read; 4]);
        let shadows = Shadows::new(gpu, &layout, instances());
        let pipeline = ScenePipeline {
            pass: "grass",
            layouts: &[Some(frame), Some(&layout), Some(&shadows.layout)],
            buffers: &[Some(instances())],
            topology: wgpu::PrimitiveTopology::TriangleList,
            depth: (wgpu::CompareFunction::Greater, true),
        };
        let rows = LEVELS.iter().map(|level| level.rows).max().unwrap_or(2);
        let indices: Vec<u16> =
            (0..rows as u16 - 1).flat_map(|row| [0, 1, 2, 2, 1, 3].map(|corner| 2 * row + corner)).collect();
        let indices = upload(gpu, "grass.indices", BufferUsages::INDEX, bytemuck::cast_slice(&indices));
        Self { pipeline: pipeline.create(gpu), layout, indices, shadows }
    }

    /// Puts a library on the GPU; its knot bytes go there unchanged. `None`: nothing in it grows.
    pub fn plant<B: AsRef<[u8]>>(
        &self,
        gpu: &Gpu,
        patch: &wgpu::Buffer,
        library: &Snapshot<B>,
    ) -> Option<Growth> {
        let weights: Vec<f32> = library.blades().map(|blade| blade.mix()).collect();
        let table = grassland::shape_table(&weights)?;
        let mut reach_m: f32 = 0.0;
        let shapes: Vec<Shape> = library
            .blades()
            .map(|blade| {
                let farthest = |reach: f32, knot: &common::blade::Knot| {
                    reach.max(knot.left().length()).max(knot.right().length())
                };
                reach_m = blade.knots().iter().fold(reach_m, farthest);
                let range = blade.knot_range();
                Shape { first_knot: range.start as u32, knot_count: range.len() as u32 }
            })
            .collect();
        let store = |label, bytes: &[u8]| upload(gpu, label, BufferUsages::STORAGE, bytes);
        let buffers = [
            &store("grass.shape_table", bytemuck::cast_slice(&table)),
            &store("grass.shapes", bytemuck::cast_slice(&shapes)),
            &store("grass.knots", library.knot_bytes()),
        ];
        let bindings = bind(gpu, "grass", &self.layout, &[patch, buffers[0], buffers[1], buffers[2]]);
        Some(Growth { bindings, reach_m: reach_m * MAX_GROWTH })
    }

    /// Draws what `cull` let through, all levels with one indirect draw; frame and shadows are bound.
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>, growth: &Growth, cull: &Cull) {
        pass.set_pipeline(&self.pipeline);
        self.draw_levels(pass, growth, cull, LEVELS.len() as u32);
    }

    /// Draws the levels that throw shadows, with the pipeline that is set.
    pub fn draw_near(&self, pass: &mut wgpu::RenderPass<'_>, growth: &Growth, cull: &Cull) {
        self.draw_levels(pass, growth, cull, SHADOW_LEVELS);
    }

    fn draw_levels(&self, pass: &mut wgpu::RenderPass<'_>, growth: &Growth, cull: &Cull, levels: u32) {
        pass.set_bind_group(1, &growth.bindings, &[]);
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint16);
        pass.set_vertex_buffer(0, cull.instances.slice(..));
        pass.multi_draw_indexed_indirect(&cull.draws, 0, levels);
    }
}
