//! The frame: all passes in order.

use glam::{Vec2, Vec3};

use common::library::Snapshot;

use crate::gpu::Gpu;
use crate::gpu::targets::Targets;
use crate::passes::cull::{self, Cull};
use crate::passes::grass::{Grass, Growth};
use crate::passes::{ground::Ground, shadow, sky::Sky, tone::Tone, world::World};
use crate::scene::camera::{Camera, frustum_planes};
use crate::scene::grassland;
use crate::scene::light::Light;

/// The patch is the same everywhere and always.
const PATCH_SEED: u64 = 0x5EED;

/// What every shader reads, in its layout.
pub mod gpu_data {
    use bytemuck::{Pod, Zeroable};
    use glam::{Mat4, Vec3, Vec4};

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
        /// Whether anything grows, 0 or 1.
        pub grows: u32,
        /// Padding.
        pub _pad_0: u32,
        /// Padding.
        pub _pad_1: u32,
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
    /// The frame's uniform for a picture of `size` pixels.
    pub fn uniform(&self, size: (u32, u32), grows: bool) -> gpu_data::Frame {
        let (width, height) = (size.0.max(1) as f32, size.1.max(1) as f32);
        let clip_from_world = self.camera.clip_from_world(width / height);
        gpu_data::Frame {
            clip_from_world,
            world_from_clip: clip_from_world.inverse(),
            planes: frustum_planes(clip_from_world),
            eye_in_world: self.camera.eye_in_world(),
            time_s: self.time_s,
            pixel_rad: 2.0 * (self.camera.fov_y_rad * 0.5).tan() / height,
            grows: u32::from(grows),
            _pad_0: 0,
            _pad_1: 0,
        }
    }
}

/// The meadow on the GPU: passes, and the library that grows.
#[derive(Debug)]
pub struct Meadow {
    world: World,
    patch: wgpu::Buffer,
    cull: Cull,
    grass: Grass,
    ground: Ground,
    sky: Sky,
    tone: Tone,
    growth: Option<Growth>,
    throws_shadows: bool,
}

impl Meadow {
    /// A bare meadow that draws pictures of `format`.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let world = World::new(gpu);
        let layout = &world.layout;
        let grass = Grass::new(gpu, layout);
        let patch = cull::upload_patch(gpu, &grassland::patch(PATCH_SEED));
        Self {
            cull: Cull::new(gpu, layout, &patch),
            ground: Ground::new(gpu, layout, &grass.shadows.layout),
            sky: Sky::new(gpu, layout),
            tone: Tone::new(gpu, format),
            growth: None,
            throws_shadows: true,
            grass,
            world,
            patch,
        }
    }

    /// Lets another library grow from the next frame on: whole, since all that belongs to it is
    /// replaced at once.
    pub fn plant<B: AsRef<[u8]>>(&mut self, gpu: &Gpu, library: &Snapshot<B>) {
        self.growth = self.grass.plant(gpu, &self.patch, library);
    }

    /// Whether blades near the eye throw shadows; they do at first. Without, light is taken by height alone.
    pub fn set_shadows(&mut self, thrown: bool) {
        self.throws_shadows = thrown;
    }

    /// Draws one frame to `display`, a view of the size of `targets`.
    pub fn draw(&self, gpu: &Gpu, targets: &Targets, view: &View, display: &wgpu::TextureView) {
        let uniform = view.uniform(targets.size, self.growth.is_some());
        let light = Light::new(view.sun_rad);
        self.world.write(gpu, &uniform, &light);
        let mut encoder =
            gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("frame") });

        if let Some(growth) = &self.growth {
            let window = cull::window(uniform.eye_in_world, growth.reach_m);
            self.cull.encode(gpu, &mut encoder, &self.world.bindings, window);
        }
        match &self.growth {
            Some(growth) if self.throws_shadows && light.sun != Vec3::ZERO => {
                let place = shadow::place(&view.camera, light.to_sun);
                let grown = (&self.grass, growth, &self.cull);
                self.grass.shadows.draw(gpu, &mut encoder, place, &uniform, &light, grown);
            }
            _ => self.grass.shadows.skip(gpu),
        }
        let mut scene = begin_scene(&mut encoder, targets);
        scene.set_bind_group(0, &self.world.bindings, &[]);
        scene.set_bind_group(2, &self.grass.shadows.bindings, &[]);
        if let Some(growth) = &self.growth {
            self.grass.draw(&mut scene, growth, &self.cull);
        }
        self.ground.draw(&mut scene);
        self.sky.draw(&mut scene);
        drop(scene);
        self.tone.draw(gpu, &mut encoder, targets, display);

        gpu.queue.submit([encoder.finish()]);
    }
}

fn begin_scene<'a>(encoder: &'a mut wgpu::CommandEncoder, targets: &Targets) -> wgpu::RenderPass<'a> {
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
        ..Default::default()
    })
}
