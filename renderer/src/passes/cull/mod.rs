//! Which blades are drawn, and with how many knots: tiles are thrown away out of view or too far off, then
//! blades likewise, or because fewer are drawn with distance; those left are packed into one list a level of
//! detail, for one indirect draw each.
//!
//! The CPU lists the blocks of tiles within sight, near to far (`scene/grassland/field`): the GPU looks at no
//! tile outside of them, and blades nearby are drawn before those that they hide.
//!
//! The lists have room for [`CAPACITY`] blades. Where a view asks for more, all of it is thinned until they fit
//! ([`plan`]); the kernels drop what would still not fit, which is then the farthest.
//!
//! Non-goal: occlusion.

pub mod cpu;

use glam::Vec4;
use wgpu::BufferUsages;

use crate::frame::gpu_data::Frame;
use crate::gpu::buffers::{Use, bind, layout, reserve, upload};
use crate::gpu::timing::Timing;
use crate::gpu::{Gpu, shader};
use crate::scene::grassland::field::{self, Block, Field, Sight};
use crate::scene::grassland::shapes::{LEVEL_KNOTS, LEVELS};
use crate::scene::grassland::{PatchBlade, SCALE, TILE_BLADES, TILE_M};

/// How far blades are drawn, metres; beyond, the ground has their colour.
pub const RANGE_M: f32 = 42.0;
/// From this part of the range on, blades sink into the ground.
pub const FADE_FROM: f32 = 0.7;
/// Up to where a pixel covers so many metres every blade of a tile is drawn; then ever fewer.
pub const FULL_PIXEL_M: f32 = 0.0074;
/// How much of a blade's size comes from the order in which tiles are thinned out, 0 to 1; the rest is its own. Short
/// blades go first: taller ones hide them, so that little of the picture goes with them.
pub const SIZE_BY_RANK: f32 = 0.88;
/// Where a part k of the blades is drawn, k to this power is the part of the area that they had: the tallest are left.
pub const KEPT_AREA: f32 = 0.75;
/// Most that the blades of thinned tiles are widened.
pub const MAX_WIDEN: f32 = 12.0;
/// Height of the meadow's roof, metres: below it, blades shade each other.
pub const CANOPY_M: f32 = 0.17;
/// A blade whose reach is smaller than this, in pixels, has the next level's knots; the last level takes what is
/// left.
pub const LEVEL_PX: [f32; LEVELS - 1] = [90.0, 26.0, 14.0];
/// A blade turns into its next level from this many times that size on.
pub const MORPH_FROM: f32 = 1.2;
/// Smallest and largest factor of lushness on a blade's size.
pub const LUSH_SCALE: (f32, f32) = (0.62, 1.08);
/// Most that a blade is larger than its shape.
pub const MAX_GROWTH: f32 = SCALE.1 * LUSH_SCALE.1;
/// How far a tile's ground is from the middle of it at most, metres.
pub const TILE_RADIUS_M: f32 = 0.84 * TILE_M;

/// Blades that can be drawn at once.
pub const CAPACITY: u32 = 524_288;
/// Blades that can be drawn at once when nothing is thrown away: tiles are drawn whole.
pub const NAIVE_CAPACITY: u32 = NAIVE_TILES * TILE_BLADES;
/// Tiles that can be drawn when nothing is thrown away.
pub const NAIVE_TILES: u32 = 16_384;
/// Candidates of a chunk, the unit in which tiles hand on their blades.
pub const CHUNK_BLADES: u32 = 8;
/// Chunks that can be handed on.
pub const CHUNK_CAPACITY: u32 = 262_144;
/// Blocks that can be looked at.
pub const BLOCK_CAPACITY: u32 = 16_384;
/// Tiles that can be simulated at once.
pub const SLOT_CAPACITY: u32 = 1024;
/// Vertex numbers set apart for each level, so that the base vertex tells the level.
pub const VERTICES_A_LEVEL: u32 = 64;
/// What no shape index stands for, in a library in which nothing grows.
pub const NO_SHAPE: u32 = u32::MAX;

/// Indices of a blade of each level: two triangles a link; the coarsest is one.
pub fn level_indices() -> [u32; LEVELS] {
    LEVEL_KNOTS.map(|knots| if knots == 2 { 3 } else { 6 * (knots - 1) })
}

/// What the shaders read and write, in their layout.
pub mod gpu_data {
    use bytemuck::{Pod, Zeroable};

    /// What is looked at and how.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
    pub struct Survey {
        /// The field's first tile along x.
        pub first_tile_x: i32,
        /// The field's first tile along z.
        pub first_tile_z: i32,
        /// Tiles of a row of the field.
        pub columns: u32,
        /// Tiles of the field.
        pub tiles: u32,
        /// Side of the ground that a pixel covers up to which every blade is drawn, metres.
        pub full_pixel_m: f32,
        /// Factor on a blade's size in pixels where its level of detail is chosen.
        pub detail: f32,
        /// How far blades are drawn, metres.
        pub range_m: f32,
        /// How far the library before has given way to this one, 0 to 1.
        pub swapped: f32,
        /// Blocks to look at.
        pub blocks: u32,
        /// Whether every blade is drawn with all knots, 0 or 1.
        pub everything: u32,
        /// Simulated tiles.
        pub slots: u32,
        /// Blades that fit a list.
        pub capacity: u32,
        /// How far any part of any blade is from its root, metres.
        pub reach_m: f32,
        /// Whether what comes, goes or changes does so smoothly, 0 or 1.
        pub blended: u32,
        /// Padding.
        pub _pad_0: u32,
        /// Padding.
        pub _pad_1: u32,
    }

    /// Some blades of a tile.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
    pub struct Chunk {
        /// The tile along x.
        pub tile_x: i32,
        /// The tile along z.
        pub tile_z: i32,
        /// The first blade's place in the order in which a tile fills up.
        pub first_rank: u32,
        /// The tile's slot of simulated knots, −1 without.
        pub slot: i32,
    }

    /// A simulated tile: where its knots are.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
    pub struct Slot {
        /// The tile along x.
        pub tile_x: i32,
        /// The tile along z.
        pub tile_z: i32,
        /// Number of the slot, ≥ 0: its blades, by grid cell, have 16 knots each.
        pub slot: i32,
        /// Padding.
        pub _pad_0: u32,
    }

    /// What a shape index stands for.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
    pub struct Share {
        /// An entry of the shape table.
        pub shape: u32,
        /// How far any part of that shape is from its root, metres.
        pub reach_m: f32,
    }

    /// What the kernels count.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
    pub struct Counts {
        /// Chunks, also those that did not fit.
        pub chunks: u32,
        /// Blades, also those that did not fit.
        pub instances: u32,
        /// Blades of each level.
        pub levels: [u32; super::LEVELS],
    }

    /// One blade to draw.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
    pub struct Instance {
        /// Where it grows, metres.
        pub root_in_world: glam::Vec3,
        /// The first of its level's knots; bit 31: in the library before.
        pub first_knot: u32,
        /// The tip's angle, of wind and tuft together, radians along x and z.
        pub bend_rad: glam::Vec2,
        /// Factor on its shape; 0 where it is not there.
        pub scale: f32,
        /// Factor on its width.
        pub widen: f32,
        /// How far it has turned into its next level, 0 to 1.
        pub morph: f32,
        /// As the patch has it.
        pub shape_turn_scale_mirror: u32,
        /// As the patch has it.
        pub lean_hue: u32,
        /// As the patch has it.
        pub salt: u32,
        /// How lush the grass is here, 0 to 1.
        pub lush: f32,
        /// How much sun passes the clouds here, 0 to 1.
        pub sunlight: f32,
        /// The first of its simulated knots, −1 without.
        pub simulated: i32,
        /// How many blades it stands for, itself among them; 0 where it is drawn however thin it is.
        pub stands_for: f32,
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
        /// Where the level's list begins.
        pub first_instance: u32,
    }
}
use gpu_data::{Chunk, Counts, Draw, Instance, Share, Slot, Survey};

/// How the meadow is drawn, whatever is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detail {
    /// Every blade of every tile with all its knots, as the paper does.
    pub naive: bool,
    /// Factor on the distances at which less is drawn, above 0; 1 as designed.
    pub distance: f32,
    /// Whether what comes, goes or changes does so smoothly; else at once, to compare.
    pub blended: bool,
}

impl Default for Detail {
    fn default() -> Self {
        Self { naive: false, distance: 1.0, blended: true }
    }
}

/// What the GPU is to look at for a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// How.
    pub survey: Survey,
    /// Where, near to far.
    pub blocks: Vec<Block>,
}

/// The part of the blades that is drawn `distance_m` away, 0 to 1: less where a pixel covers more.
pub(crate) fn kept(full_pixel_m: f32, pixel_rad: f32, distance_m: f32) -> f32 {
    let ratio = (full_pixel_m / (pixel_rad * distance_m).max(1e-9)).min(1.0);
    ratio * ratio.sqrt().sqrt()
}

/// How far from the eye a blade that reaches `reach_m` is of one of the first `levels` levels of detail, metres.
pub fn farthest_m(plan: &Plan, frame: &Frame, levels: u32, reach_m: f32) -> f32 {
    let has_levels = plan.survey.everything == 0;
    let least_px = levels.checked_sub(1).and_then(|last| LEVEL_PX.get(last as usize)).filter(|_| has_levels);
    least_px.map_or(f32::MAX, |px| plan.survey.detail * reach_m / (frame.pixel_rad * px))
}

/// What to look at for this frame. `reach_m`: how far any part of any shape is from its root; `swapped`: how far
/// the library before has given way, 0 to 1.
///
/// Of a view that asks for more blades than there is room for, all is thinned until they fit.
pub fn plan(frame: &Frame, field: &Field, detail: Detail, reach_m: f32, swapped: f32) -> Plan {
    let mut survey = Survey {
        first_tile_x: field.first.x,
        first_tile_z: field.first.y,
        columns: field.columns,
        tiles: field.tiles,
        full_pixel_m: FULL_PIXEL_M * detail.distance,
        detail: detail.distance,
        range_m: RANGE_M * detail.distance.clamp(0.5, 1.0),
        swapped,
        blocks: 0,
        everything: u32::from(detail.naive),
        slots: 0,
        capacity: if detail.naive { NAIVE_CAPACITY } else { CAPACITY },
        reach_m: reach_m * MAX_GROWTH * (1.0 + 0.25 * MAX_WIDEN),
        blended: u32::from(detail.blended),
        _pad_0: 0,
        _pad_1: 0,
    };
    let blocks: Vec<Block> = if detail.naive {
        field::all_blocks(field)
    } else {
        let sight = Sight {
            eye_in_world: frame.eye_in_world,
            planes: frame.planes,
            range_m: survey.range_m,
            reach_m: survey.reach_m,
        };
        let seen = field::blocks_in_sight(field, &sight);
        let most = |full_pixel_m: f32| -> f32 {
            // What is kept falls evenly enough over a block to be taken from its middle; near the eye, it is all.
            let kept = seen.iter().map(|seen| {
                kept(full_pixel_m, frame.pixel_rad, seen.nearest_m + 0.5 * field::BLOCK_SIDE as f32 * TILE_M)
            });
            kept.sum::<f32>() * (field::BLOCK_SIDE * field::BLOCK_SIDE) as f32 * TILE_BLADES as f32
        };
        while most(survey.full_pixel_m) > CAPACITY as f32 {
            survey.full_pixel_m *= 0.93;
        }
        seen.iter().map(|seen| seen.block).take(BLOCK_CAPACITY as usize).collect()
    };
    survey.blocks = blocks.len() as u32;
    Plan { survey, blocks }
}

/// The view's planes of a frame that sees all around, for tests and comparisons.
pub const NO_PLANES: [Vec4; 5] = [Vec4::W; 5];

/// The pass and its results.
#[derive(Debug)]
pub struct Cull {
    tiles: Kernel,
    blades: Kernel,
    args: Kernel,
    survey: wgpu::Buffer,
    blocks: wgpu::Buffer,
    slots: wgpu::Buffer,
    slot_count: u32,
    chunks: wgpu::Buffer,
    dispatch: wgpu::Buffer,
    tiles_bindings: wgpu::BindGroup,
    args_bindings: wgpu::BindGroup,
    /// What was counted: a [`Counts`].
    pub counts: wgpu::Buffer,
    /// One [`Draw`] a level.
    pub draws: wgpu::Buffer,
    /// [`Instance`]s, in no order.
    pub instances: wgpu::Buffer,
    /// Each level's list of instances.
    pub lists: wgpu::Buffer,
    /// Blades that fit.
    pub capacity: u32,
}

#[derive(Debug)]
struct Kernel {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

impl Kernel {
    fn new(gpu: &Gpu, name: &str, frame: &wgpu::BindGroupLayout, uses: &[Use]) -> Self {
        let layout = layout(gpu, name, wgpu::ShaderStages::COMPUTE, uses);
        let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(name),
            bind_group_layouts: &[Some(frame), Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(name),
            layout: Some(&pipeline_layout),
            module: &shader::module(gpu, name),
            entry_point: Some("main"),
            compilation_options: Default::default(),
            cache: None,
        });
        Self { pipeline, layout }
    }
}

impl Cull {
    /// The pass, with the frame's layout, for lists of `capacity` blades.
    pub fn new(gpu: &Gpu, frame: &wgpu::BindGroupLayout, capacity: u32) -> Self {
        use Use::{Read, ReadWrite, Uniform};
        let tiles = Kernel::new(gpu, "cull.tiles", frame, &[Uniform, Read, Read, ReadWrite, ReadWrite]);
        let blades = Kernel::new(
            gpu,
            "cull.blades",
            frame,
            &[Uniform, Read, Read, Read, Read, ReadWrite, ReadWrite, ReadWrite],
        );
        let args = Kernel::new(gpu, "cull.args", frame, &[Uniform, ReadWrite, ReadWrite, ReadWrite]);
        let of = |label: &str, usage: BufferUsages, size: usize, count: u32| {
            reserve(gpu, label, usage, size as u64 * u64::from(count))
        };
        let (input, out) = (BufferUsages::COPY_DST, BufferUsages::STORAGE | BufferUsages::COPY_SRC);
        let survey = of("cull.survey", BufferUsages::UNIFORM | input, size_of::<Survey>(), 1);
        let blocks = of("cull.blocks", BufferUsages::STORAGE | input, size_of::<Block>(), BLOCK_CAPACITY);
        let slots = of("cull.slots", BufferUsages::STORAGE | input, size_of::<Slot>(), SLOT_CAPACITY);
        let chunks = of("cull.chunks", out, size_of::<Chunk>(), CHUNK_CAPACITY);
        let counts = of("cull.counts", out | input, size_of::<Counts>(), 1);
        let dispatch = of("cull.dispatch", out | BufferUsages::INDIRECT, 4, 3);
        let draws = of("cull.draws", out | BufferUsages::INDIRECT, size_of::<Draw>(), LEVELS as u32);
        let instances = of("cull.instances", out, size_of::<Instance>(), capacity);
        let lists = of("cull.lists", out, 4 * LEVELS, capacity);
        let tiles_bindings =
            bind(gpu, "cull.tiles", &tiles.layout, &[&survey, &blocks, &slots, &counts, &chunks]);
        let args_bindings = bind(gpu, "cull.args", &args.layout, &[&survey, &counts, &dispatch, &draws]);
        Self {
            tiles,
            blades,
            args,
            survey,
            blocks,
            slots,
            slot_count: 0,
            chunks,
            dispatch,
            tiles_bindings,
            args_bindings,
            counts,
            draws,
            instances,
            lists,
            capacity,
        }
    }

    /// Binds a patch ([`upload_patch`]), and this library's and the former one's shares ([`upload_shares`]).
    pub fn bind(
        &self,
        gpu: &Gpu,
        patch: &wgpu::Buffer,
        shares: &wgpu::Buffer,
        old_shares: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        let buffers = [
            &self.survey,
            patch,
            &self.chunks,
            shares,
            old_shares,
            &self.counts,
            &self.instances,
            &self.lists,
        ];
        bind(gpu, "cull.blades", &self.blades.layout, &buffers)
    }

    /// Says which tiles are simulated and in which slots their knots are: at most [`SLOT_CAPACITY`], in any order,
    /// no tile twice.
    pub fn set_slots(&mut self, gpu: &Gpu, slots: &[Slot]) {
        let mut sorted: Vec<Slot> = slots.iter().take(SLOT_CAPACITY as usize).copied().collect();
        sorted.sort_by_key(|slot| (slot.tile_z, slot.tile_x));
        gpu.queue.write_buffer(&self.slots, 0, bytemuck::cast_slice(&sorted));
        self.slot_count = sorted.len() as u32;
    }

    /// Counts and packs what `plan` shows; `bindings` are those of [`Cull::bind`].
    pub fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        frame: &wgpu::BindGroup,
        bindings: &wgpu::BindGroup,
        plan: &Plan,
        timing: Option<&Timing>,
    ) {
        let survey = Survey {
            slots: self.slot_count,
            capacity: self.capacity,
            blocks: plan.survey.blocks.min(BLOCK_CAPACITY),
            ..plan.survey
        };
        gpu.queue.write_buffer(&self.survey, 0, bytemuck::bytes_of(&survey));
        let blocks = &plan.blocks[..survey.blocks as usize];
        gpu.queue.write_buffer(&self.blocks, 0, bytemuck::cast_slice(blocks));
        encoder.clear_buffer(&self.counts, 0, None);
        let begin = |encoder: &mut wgpu::CommandEncoder, label: &'static str| {
            let mut pass = encoder
                .begin_compute_pass(&wgpu::ComputePassDescriptor {
                    label: Some(label),
                    timestamp_writes: timing.and_then(|timing| timing.compute(label)),
                })
                .forget_lifetime();
            pass.set_bind_group(0, frame, &[]);
            pass
        };
        let mut pass = begin(encoder, "cull.tiles");
        pass.set_pipeline(&self.tiles.pipeline);
        pass.set_bind_group(1, &self.tiles_bindings, &[]);
        pass.dispatch_workgroups(survey.blocks, 1, 1);
        pass.set_pipeline(&self.args.pipeline);
        pass.set_bind_group(1, &self.args_bindings, &[]);
        pass.dispatch_workgroups(1, 1, 1);
        drop(pass);
        let mut pass = begin(encoder, "cull.blades");
        pass.set_pipeline(&self.blades.pipeline);
        pass.set_bind_group(1, bindings, &[]);
        pass.dispatch_workgroups_indirect(&self.dispatch, 0);
        pass.set_pipeline(&self.args.pipeline);
        pass.set_bind_group(1, &self.args_bindings, &[]);
        pass.dispatch_workgroups(1, 1, 1);
    }
}

/// Uploads the patch.
pub fn upload_patch(gpu: &Gpu, patch: &[PatchBlade]) -> wgpu::Buffer {
    upload(gpu, "grassland.patch", BufferUsages::STORAGE, bytemuck::cast_slice(patch))
}

/// Uploads what the shape indices stand for.
pub fn upload_shares(gpu: &Gpu, shares: &[Share]) -> wgpu::Buffer {
    upload(gpu, "grassland.shares", BufferUsages::STORAGE, bytemuck::cast_slice(shares))
}
