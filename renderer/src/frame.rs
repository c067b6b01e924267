//! The frame: all passes in order.

use glam::{Vec2, Vec3};

use common::library::Snapshot;

use crate::gpu::Gpu;
use crate::gpu::targets::Targets;
use crate::gpu::timing::Timing;
use crate::passes::cull::gpu_data::Slot;
use crate::passes::cull::{self, Cull, Detail};
use crate::passes::grass::gpu_data::SimulatedKnot;
use crate::passes::grass::{Grass, Growth, SHADOW_LEVELS};
use crate::passes::{ground::Ground, shadow, sky::Sky, tone::Tone, world::World};
use crate::scene::camera::{Camera, frustum_planes};
use crate::scene::grassland::shapes::{self, LEVEL_KNOTS, Shapes};
use crate::scene::grassland::{self, TILE_BLADES, field::Field};
use crate::scene::light::Light;

/// The patch is the same everywhere and always.
pub const PATCH_SEED: u64 = 0x5EED;
/// How long a new library takes to take the place of the one before, seconds.
pub const SWAP_S: f32 = 1.0;

/// What every shader reads, in its layout.
pub mod gpu_data {
    use bytemuck::{Pod, Zeroable};
    use glam::{Mat4, Vec2, Vec3, Vec4};

    /// The frame's uniform.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
    pub struct Frame {
        /// World to clip space, reversed depth.
        pub clip_from_world: Mat4,
        /// Its inverse.
        pub world_from_clip: Mat4,
        /// The view's planes, pointing inwards.
        pub planes: [Vec4; 5],
        /// The eye, metres.
        pub eye_in_world: Vec3,
        /// The meadow's time, seconds.
        pub time_s: f32,
        /// Angle that a pixel covers in the picture's middle, radians.
        pub pixel_rad: f32,
        /// How far it is from bare ground to a meadow, 0 to 1.
        pub grown: f32,
        /// Size of a pixel, metres at the blades, up to which every blade is drawn.
        pub full_pixel_m: f32,
        /// How far blades are drawn, metres.
        pub range_m: f32,
        /// The field's least corner, x and z, metres.
        pub field_from_m: Vec2,
        /// Its greatest.
        pub field_to_m: Vec2,
    }
}

/// What a frame shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// From where.
    pub camera: Camera,
    /// When, seconds of the meadow's time.
    pub time_s: f32,
    /// Where the sun stands: heading (radians clockwise from −z) and elevation.
    pub sun_rad: Vec2,
}

impl View {
    /// The frame's uniform for a picture of `size` pixels of what is `grown` from bare ground, 0, to a meadow, 1;
    /// how much is drawn is for the plan to say.
    pub fn uniform(&self, size: (u32, u32), grown: f32) -> gpu_data::Frame {
        let (width, height) = (size.0.max(1) as f32, size.1.max(1) as f32);
        let clip_from_world = self.camera.clip_from_world(width / height);
        gpu_data::Frame {
            clip_from_world,
            world_from_clip: clip_from_world.inverse(),
            planes: frustum_planes(clip_from_world),
            eye_in_world: self.camera.eye_in_world(),
            time_s: self.time_s,
            pixel_rad: 2.0 * (self.camera.fov_y_rad * 0.5).tan() / height,
            grown,
            full_pixel_m: 0.0,
            range_m: 0.0,
            field_from_m: Vec2::ZERO,
            field_to_m: Vec2::ZERO,
        }
    }
}

/// The meadow on the GPU: passes, and the library that grows.
#[derive(Debug)]
pub struct Meadow {
    world: World,
    patch: wgpu::Buffer,
    field: Field,
    detail: Detail,
    cull: Cull,
    grass: Grass,
    ground: Ground,
    sky: Sky,
    tone: Tone,
    now: Growth,
    before: Growth,
    /// How far the library before has given way, 0 to 1.
    swapped: f32,
    cull_bindings: wgpu::BindGroup,
    grass_bindings: wgpu::BindGroup,
    throws_shadows: bool,
    slots: Vec<Slot>,
}

impl Meadow {
    /// A bare meadow without end that draws pictures of `format`.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let world = World::new(gpu);
        let layout = &world.layout;
        let patch = cull::upload_patch(gpu, &grassland::patch(PATCH_SEED));
        let cull = Cull::new(gpu, layout, cull::CAPACITY);
        let grass = Grass::new(gpu, layout);
        let (now, before) = (Growth::new(gpu, None), Growth::new(gpu, None));
        Self {
            field: Field::ENDLESS,
            detail: Detail::default(),
            ground: Ground::new(gpu, layout, &grass.shadows.layout),
            sky: Sky::new(gpu, layout),
            tone: Tone::new(gpu, format),
            swapped: 1.0,
            throws_shadows: true,
            slots: Vec::new(),
            cull_bindings: cull.bind(gpu, &patch, &now.shares, &before.shares),
            grass_bindings: grass.bind(gpu, &cull, &now, &before),
            cull,
            grass,
            now,
            before,
            world,
            patch,
        }
    }

    /// Where grass grows from the next frame on.
    pub fn lay_out(&mut self, field: Field) {
        self.field = field;
    }

    /// How much of it is drawn from the next frame on.
    pub fn set_detail(&mut self, gpu: &Gpu, detail: Detail) {
        let capacity = if detail.naive { cull::NAIVE_CAPACITY } else { cull::CAPACITY };
        self.detail = detail;
        if self.cull.capacity != capacity {
            self.cull = Cull::new(gpu, &self.world.layout, capacity);
            self.cull.set_slots(gpu, &self.slots);
            self.bind(gpu);
        }
    }

    /// Lets another library grow from the next frame on, at once and whole.
    pub fn plant<B: AsRef<[u8]>>(&mut self, gpu: &Gpu, library: &Snapshot<B>) {
        self.grow(gpu, shapes::shapes(library).as_ref());
        self.pass_time(SWAP_S);
    }

    /// Lets other shapes grow from the next frame on: where a blade changes, the old one gives way and the new
    /// one grows, as [`Meadow::pass_time`] goes on. A change that is still going on ends at once.
    pub fn grow(&mut self, gpu: &Gpu, shapes: Option<&Shapes>) {
        self.before = std::mem::replace(&mut self.now, Growth::new(gpu, shapes));
        self.swapped = 0.0;
        self.bind(gpu);
    }

    /// Whether a library is still taking the place of another.
    pub fn is_growing(&self) -> bool {
        self.swapped < 1.0
    }

    /// Lets `seconds` pass for what grows.
    pub fn pass_time(&mut self, seconds: f32) {
        self.swapped = (self.swapped + seconds / SWAP_S).min(1.0);
    }

    /// How far it is from bare ground to a meadow, 0 to 1: as far as blades have grown in, or given way.
    fn grown(&self) -> f32 {
        let [before, now] = [&self.before, &self.now].map(|growth| f32::from(u8::from(growth.grows())));
        before + (now - before) * self.swapped
    }

    /// Lets the blades of these tiles stand as `knots` says from the next frame on, and all others as the library
    /// does: of slot s, grid cell c and knot k of the finest level, at `(64 s + c) 16 + k`. A slot whose knots are not
    /// all there is as if it were not named. At most [`cull::SLOT_CAPACITY`] tiles, no one twice.
    pub fn simulate(&mut self, gpu: &Gpu, slots: &[Slot], knots: &[SimulatedKnot]) {
        let of_slot = (TILE_BLADES * LEVEL_KNOTS[0]) as usize;
        let is_there = |slot: &&Slot| usize::try_from(slot.slot).is_ok_and(|at| at < knots.len() / of_slot);
        self.slots = slots.iter().filter(is_there).copied().collect();
        self.cull.set_slots(gpu, &self.slots);
        self.grass.set_simulated(gpu, knots);
        self.bind(gpu);
    }

    fn bind(&mut self, gpu: &Gpu) {
        self.cull_bindings = self.cull.bind(gpu, &self.patch, &self.now.shares, &self.before.shares);
        self.grass_bindings = self.grass.bind(gpu, &self.cull, &self.now, &self.before);
    }

    /// What was culled and drawn in the last frame.
    pub fn cull(&self) -> &Cull {
        &self.cull
    }

    /// Whether blades near the eye throw shadows; they do at first. Without, light is taken by height alone.
    pub fn set_shadows(&mut self, thrown: bool) {
        self.throws_shadows = thrown;
    }

    /// Draws one frame to `display`, a view of the size of `targets` or a larger one.
    pub fn draw(&self, gpu: &Gpu, targets: &Targets, view: &View, display: &wgpu::TextureView) {
        self.draw_timed(gpu, targets, view, display, None);
    }

    /// As [`Meadow::draw`], with the time of each pass.
    pub fn draw_timed(
        &self,
        gpu: &Gpu,
        targets: &Targets,
        view: &View,
        display: &wgpu::TextureView,
        timing: Option<&Timing>,
    ) {
        let mut uniform = view.uniform(targets.size, self.grown());
        let light = Light::new(view.sun_rad);
        let reach_m = self.now.reach_m.max(self.before.reach_m);
        let plan = cull::plan(&uniform, &self.field, self.detail, reach_m, self.swapped);
        (uniform.full_pixel_m, uniform.range_m) = match plan.survey.everything {
            0 => (plan.survey.full_pixel_m, plan.survey.range_m),
            _ => (f32::MAX, f32::MAX),
        };
        (uniform.field_from_m, uniform.field_to_m) = self.field.corners_m();
        self.world.write(gpu, &uniform, &light);
        let mut encoder =
            gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("frame") });

        let grass_shows = self.now.grows() || (self.is_growing() && self.before.grows());
        if grass_shows {
            self.cull.encode(gpu, &mut encoder, &self.world.bindings, &self.cull_bindings, &plan, timing);
        }
        if grass_shows && self.throws_shadows && light.sun != Vec3::ZERO {
            let thrown_to_m = cull::farthest_m(&plan, &uniform, SHADOW_LEVELS, reach_m);
            let place = shadow::place(&view.camera, light.to_sun, thrown_to_m);
            let grown = (&self.grass, &self.grass_bindings, &self.cull);
            self.grass.shadows.draw(gpu, &mut encoder, place, &uniform, &light, grown, timing);
        } else {
            self.grass.shadows.skip(gpu);
        }
        let mut scene = begin_scene(&mut encoder, targets, timing);
        scene.set_bind_group(0, &self.world.bindings, &[]);
        scene.set_bind_group(2, &self.grass.shadows.bindings, &[]);
        if grass_shows {
            self.grass.draw(&mut scene, &self.grass_bindings, &self.cull);
        }
        self.ground.draw(&mut scene);
        self.sky.draw(&mut scene);
        drop(scene);
        self.tone.draw(gpu, &mut encoder, targets, display);
        if let Some(timing) = timing {
            timing.resolve(&mut encoder);
        }

        gpu.queue.submit([encoder.finish()]);
    }
}

fn begin_scene<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    targets: &Targets,
    timing: Option<&Timing>,
) -> wgpu::RenderPass<'a> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("scene.colour"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &targets.colour,
            depth_slice: None,
            resolve_target: Some(&targets.resolved),
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                store: wgpu::StoreOp::Discard,
            },
        })],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &targets.depth,
            depth_ops: Some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(0.0),
                store: wgpu::StoreOp::Discard,
            }),
            stencil_ops: None,
        }),
        timestamp_writes: timing.and_then(|timing| timing.render("scene.colour")),
        ..Default::default()
    })
}
