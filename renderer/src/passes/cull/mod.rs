//! Which blades are drawn: a tile is thrown away out of view or too far off, the others grow as many
//! of their blades as their distance calls for, packed by level of detail into one indirect draw.
//!
//! Alternatives: one invocation a blade is four times the work on a software rasteriser, since most
//! tiles around the eye are out of view. Non-goal: occlusion.

pub mod cpu;

use std::ops::Range;

use wgpu::BufferUsages;

use crate::gpu::buffers::{Use, bind, layout, reserve, upload};
use crate::gpu::{Gpu, shader};
use crate::scene::grassland::{PatchBlade, TILE_BLADES, TILE_M};

/// How far blades are drawn, metres; beyond, the ground has their colour.
pub const RANGE_M: f32 = 42.0;
/// Up to here, in metres, every blade of a tile is drawn; then ever fewer.
pub const FULL_DENSITY_M: f32 = 3.0;
/// Most that the blades of thinned tiles are widened.
pub const MAX_WIDEN: f32 = 3.6;
/// Height of the meadow's roof, metres: below it, blades shade each other.
pub const CANOPY_M: f32 = 0.17;

/// A level of detail.
#[derive(Clone, Copy, Debug)]
pub struct Level {
    /// Up to this distance, metres; the last level takes what is left.
    pub until_m: f32,
    /// Cross-sections of a blade, 2..=32.
    pub rows: u32,
}

/// The levels, near to far.
pub const LEVELS: [Level; 3] =
    [Level { until_m: 1.8, rows: 14 }, Level { until_m: 6.0, rows: 7 }, Level { until_m: RANGE_M, rows: 4 }];

/// Vertex numbers set apart for each level, so that the base vertex tells the level.
pub const VERTICES_A_LEVEL: u32 = 64;

/// What the shaders read and write, in their layout.
pub mod gpu_data {
    use bytemuck::{Pod, Zeroable};

    /// The square of tiles around the eye that is looked at.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
    pub struct Window {
        /// Lowest tile coordinate along x.
        pub first_tile_x: i32,
        /// Lowest tile coordinate along z.
        pub first_tile_z: i32,
        /// Tiles along one side.
        pub side: u32,
        /// How far any part of any blade is from its root, metres.
        pub reach_m: f32,
    }

    /// One blade to draw.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
    pub struct Instance {
        /// Where it grows, metres.
        pub root_in_world: glam::Vec3,
        /// Index in the patch (16 bits), lushness 0..=255 above.
        pub blade_and_lushness: u32,
        /// The tip's angle, of wind and tuft together, radians along x and z.
        pub bend_rad: glam::Vec2,
        /// How much of it is there, 0 to 1: it grows or sinks as its tile comes nearer or goes.
        pub presence: f32,
        /// Factor on its width, for those that are left out around it.
        pub widen: f32,
    }

    /// One indexed indirect draw.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
    pub struct Draw {
        /// Indices of one blade.
        pub index_count: u32,
        /// Blades.
        pub instance_count: u32,
        /// Zero.
        pub first_index: u32,
        /// Tells the vertex shader the level.
        pub base_vertex: i32,
        /// Where the level's region of the instances begins.
        pub first_instance: u32,
    }
}
use gpu_data::{Draw, Instance, Window};

/// How much of a tile's blades is drawn at this distance in metres, 0 to 1.
pub(crate) fn kept(distance_m: f32) -> f32 {
    let ratio = (FULL_DENSITY_M / distance_m).min(1.0);
    ratio * ratio.sqrt()
}

/// Each level's region of the instance buffer, as indices: large enough for whatever the eye sees.
///
/// A level holds no tile farther than its end, and no tile more blades than `kept` of the ground
/// distance between the eye and the tile's nearest corner.
pub fn regions() -> [Range<u32>; LEVELS.len()] {
    let mut start = 0;
    LEVELS.map(|level| {
        let reach = (level.until_m / TILE_M) as i32 + 2;
        let mut blades = 0;
        for x in -reach..=reach {
            for z in -reach..=reach {
                let nearest_m = (glam::IVec2::new(x, z).as_vec2().length() - 1.5).max(0.0) * TILE_M;
                if nearest_m <= level.until_m {
                    blades += (TILE_BLADES as f32 * kept(nearest_m)).ceil() as u32;
                }
            }
        }
        let region = start..start + blades;
        start = region.end;
        region
    })
}

/// The window around `eye` for blades of this reach.
pub fn window(eye: glam::Vec3, reach_m: f32) -> Window {
    let tiles = (RANGE_M / TILE_M).ceil() as i32 + 1;
    let first = |coordinate: f32| (coordinate / TILE_M).floor() as i32 - tiles;
    Window { first_tile_x: first(eye.x), first_tile_z: first(eye.z), side: 2 * tiles as u32 + 1, reach_m }
}

/// The draws with no blade in them.
pub fn empty_draws() -> [Draw; LEVELS.len()] {
    let regions = regions();
    std::array::from_fn(|level| Draw {
        index_count: 6 * (LEVELS[level].rows - 1),
        instance_count: 0,
        first_index: 0,
        base_vertex: (level as u32 * VERTICES_A_LEVEL) as i32,
        first_instance: regions[level].start,
    })
}

/// The pass and its results.
#[derive(Debug)]
pub struct Cull {
    pipeline: wgpu::ComputePipeline,
    bindings: wgpu::BindGroup,
    window: wgpu::Buffer,
    empty_draws: wgpu::Buffer,
    /// One [`Draw`] a level.
    pub draws: wgpu::Buffer,
    /// [`Instance`]s, each level in its region.
    pub instances: wgpu::Buffer,
}

impl Cull {
    /// The pass over this patch, with the frame's layout.
    pub fn new(gpu: &Gpu, frame: &wgpu::BindGroupLayout, patch: &wgpu::Buffer) -> Self {
        let capacity = regions()[LEVELS.len() - 1].end as usize;
        let window = reserve(
            gpu,
            "cull.window",
            BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            size_of::<Window>() as u64,
        );
        let empty_draws =
            upload(gpu, "cull.empty_draws", BufferUsages::COPY_SRC, bytemuck::bytes_of(&empty_draws()));
        let out = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let draws = reserve(gpu, "cull.draws", out | BufferUsages::INDIRECT, empty_draws.size());
        let instances = reserve(
            gpu,
            "cull.instances",
            out | BufferUsages::VERTEX,
            (capacity * size_of::<Instance>()) as u64,
        );
        let uses = [Use::Uniform, Use::Read, Use::ReadWrite, Use::ReadWrite];
        let layout = layout(gpu, "cull", wgpu::ShaderStages::COMPUTE, &uses);
        let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("cull"),
            bind_group_layouts: &[Some(frame), Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("cull"),
            layout: Some(&pipeline_layout),
            module: &shader::module(gpu, "cull"),
            entry_point: Some("main"),
            compilation_options: Default::default(),
            cache: None,
        });
        let bindings = bind(gpu, "cull", &layout, &[&window, patch, &draws, &instances]);
        Self { pipeline, bindings, window, empty_draws, draws, instances }
    }

    /// Counts and packs the blades that `window` shows; the draws are emptied by a copy before.
    pub fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        frame: &wgpu::BindGroup,
        window: Window,
    ) {
        /// Side of a workgroup in cull.wgsl.
        const WORKGROUP: u32 = 8;
        gpu.queue.write_buffer(&self.window, 0, bytemuck::bytes_of(&window));
        encoder.copy_buffer_to_buffer(&self.empty_draws, 0, &self.draws, 0, self.draws.size());
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("cull.instances"),
            timestamp_writes: None,
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, frame, &[]);
        pass.set_bind_group(1, &self.bindings, &[]);
        let groups = window.side.div_ceil(WORKGROUP);
        pass.dispatch_workgroups(groups, groups, 1);
    }
}

/// Uploads the patch.
pub fn upload_patch(gpu: &Gpu, patch: &[PatchBlade]) -> wgpu::Buffer {
    upload(gpu, "grassland.patch", BufferUsages::STORAGE, bytemuck::cast_slice(patch))
}
