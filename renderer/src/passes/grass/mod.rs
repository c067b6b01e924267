//! The blades, each a ribbon that the vertex shader expands from its shape's knots, or from simulated ones.

use wgpu::BufferUsages;

use super::ScenePipeline;
use super::cull::gpu_data::{Draw, Share};
use super::cull::{Cull, NO_SHAPE, upload_shares};
use super::shadow::Shadows;
use crate::gpu::Gpu;
use crate::gpu::buffers::{Use, bind, layout, upload};
use crate::scene::grassland::SHAPES;
use crate::scene::grassland::mix;
use crate::scene::grassland::shapes::{LEVEL_KNOTS, LEVELS, SHAPE_KNOTS, Shapes};

/// What the shader reads, in its layout.
pub mod gpu_data {
    use bytemuck::{Pod, Zeroable};

    pub use crate::scene::grassland::shapes::ShapeKnot;

    /// A knot of a simulated blade, without wind.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
    pub struct SimulatedKnot {
        /// Metres from the blade's root, along the world's axes.
        pub position: glam::Vec3,
        /// Padding.
        pub _pad_0: u32,
    }
}

/// Levels of detail, from the nearest, that throw shadows: as far as the map of shadows reaches.
pub const SHADOW_LEVELS: u32 = 2;
/// Levels of detail, from the finest on, whose blades are lit at each sample; smaller ones are lit at their
/// vertices.
const LIT_BY_SAMPLE: u32 = 2;

/// A library on the GPU, whole and unchanging: a newer one is another value.
#[derive(Debug)]
pub struct Growth {
    /// What each shape index stands for: [`Share`]s.
    pub shares: wgpu::Buffer,
    knots: wgpu::Buffer,
    /// How far any part of any shape is from its root, metres; 0 where nothing grows.
    pub reach_m: f32,
}

/// What each shape index stands for; `None`: nothing grows.
pub fn shares(shapes: Option<&Shapes>) -> Vec<Share> {
    let Some(shapes) = shapes else { return vec![Share { shape: NO_SHAPE, reach_m: 0.0 }; SHAPES] };
    let reach_m = |entry: u32| shapes.knots[mix::shape_of(entry) * SHAPE_KNOTS as usize].reach_m;
    shapes.table.iter().map(|entry| Share { shape: *entry, reach_m: reach_m(*entry) }).collect()
}

impl Growth {
    /// Puts shapes on the GPU; `None`: nothing grows.
    pub fn new(gpu: &Gpu, shapes: Option<&Shapes>) -> Self {
        let knots = shapes.map_or(&[][..], |shapes| bytemuck::cast_slice(&shapes.knots));
        // Even an empty list has room for one, or it could not be bound.
        let knots = if knots.is_empty() { &[0; size_of::<gpu_data::ShapeKnot>()] } else { knots };
        Self {
            shares: upload_shares(gpu, &shares(shapes)),
            knots: upload(gpu, "grass.knots", BufferUsages::STORAGE, knots),
            reach_m: shapes.map_or(0.0, |shapes| shapes.reach_m),
        }
    }

    /// Whether anything grows.
    pub fn grows(&self) -> bool {
        self.reach_m > 0.0
    }
}

/// The pass.
#[derive(Debug)]
pub struct Grass {
    /// Lit at each sample: for the first [`LIT_BY_SAMPLE`] levels.
    by_sample: wgpu::RenderPipeline,
    /// Lit at each vertex: for the others.
    by_vertex: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    indices: wgpu::Buffer,
    simulated: wgpu::Buffer,
    /// The shadows that it throws.
    pub shadows: Shadows,
}

impl Grass {
    /// The pass, with the frame's layout.
    pub fn new(gpu: &Gpu, frame: &wgpu::BindGroupLayout) -> Self {
        let layout = layout(gpu, "grass", wgpu::ShaderStages::VERTEX, &[Use::Read; 5]);
        let shadows = Shadows::new(gpu, &layout);
        let pipeline = ScenePipeline {
            pass: "grass",
            layouts: &[Some(frame), Some(&layout), Some(&shadows.layout)],
            buffers: &[],
            topology: wgpu::PrimitiveTopology::TriangleList,
            depth: (wgpu::CompareFunction::Greater, true),
        };
        // Every level begins as the finest does; of the coarsest, the first triangle is all.
        let indices: Vec<u16> = (0..LEVEL_KNOTS[0] as u16 - 1)
            .flat_map(|row| [0, 1, 2, 2, 1, 3].map(|corner| 2 * row + corner))
            .collect();
        let simulated = [0; size_of::<gpu_data::SimulatedKnot>()];
        Self {
            by_sample: pipeline.create(gpu),
            by_vertex: pipeline.create_of(gpu, "vs_lit", "fs_lit"),
            layout,
            indices: upload(gpu, "grass.indices", BufferUsages::INDEX, bytemuck::cast_slice(&indices)),
            simulated: upload(gpu, "grass.simulated", BufferUsages::STORAGE, &simulated),
            shadows,
        }
    }

    /// Takes the knots of simulated blades, without wind: those of the blade in grid cell c of slot s begin at
    /// `(64 s + c) 16`. What was bound before has the former ones.
    pub fn set_simulated(&mut self, gpu: &Gpu, knots: &[gpu_data::SimulatedKnot]) {
        self.simulated = upload(gpu, "grass.simulated", BufferUsages::STORAGE, bytemuck::cast_slice(knots));
    }

    /// Binds what `cull` lets through of this library and the one before.
    pub fn bind(&self, gpu: &Gpu, cull: &Cull, now: &Growth, before: &Growth) -> wgpu::BindGroup {
        let buffers = [&cull.lists, &cull.instances, &now.knots, &before.knots, &self.simulated];
        bind(gpu, "grass", &self.layout, &buffers)
    }

    /// Draws what `cull` let through, one indirect draw a level; frame and shadows are bound, `bindings` are
    /// those of [`Grass::bind`].
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>, bindings: &wgpu::BindGroup, cull: &Cull) {
        pass.set_bind_group(1, bindings, &[]);
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint16);
        pass.set_pipeline(&self.by_sample);
        pass.multi_draw_indexed_indirect(&cull.draws, 0, LIT_BY_SAMPLE);
        pass.set_pipeline(&self.by_vertex);
        let rest = u64::from(LIT_BY_SAMPLE) * size_of::<Draw>() as u64;
        pass.multi_draw_indexed_indirect(&cull.draws, rest, LEVELS as u32 - LIT_BY_SAMPLE);
    }

    /// Draws the levels that throw shadows, with the pipeline that is set.
    pub fn draw_near(&self, pass: &mut wgpu::RenderPass<'_>, bindings: &wgpu::BindGroup, cull: &Cull) {
        pass.set_bind_group(1, bindings, &[]);
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint16);
        pass.multi_draw_indexed_indirect(&cull.draws, 0, SHADOW_LEVELS);
    }
}
