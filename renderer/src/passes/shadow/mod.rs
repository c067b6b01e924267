//! The shadows that blades near the eye throw: their depth seen from the sun, in a square map that goes
//! with the eye. Farther away the light is taken by the height among the blades alone (`leaf.wgsl`).
//!
//! The blades are drawn by a vertex shader of the grass, which sees the sun's matrix in place of the
//! camera's. Non-goals: the shadow of blades that are out of the camera's view, which are not drawn;
//! shadows of things.

use glam::camera::rh::proj::directx;
use glam::{Vec2, Vec3};
use wgpu::BufferUsages;

use super::cull::Cull;
use super::grass::Grass;
use super::world::World;
use crate::frame::gpu_data::Frame;
use crate::gpu::timing::Timing;
use crate::gpu::{Gpu, buffers, shader, targets};
use crate::scene::camera::Camera;
use crate::scene::light::Light;
use crate::scene::terrain;

/// Texels of the map along one side.
pub const SIDE: u32 = 1024;
/// Depth range of the map to either side of its middle, metres: more than hills are high within it.
const RANGE_M: f32 = 12.0;
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// What the shaders read, in its layout.
pub mod gpu_data {
    use bytemuck::{Pod, Zeroable};
    use glam::Mat4;

    /// Where the map lies.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
    pub struct Shadow {
        /// World to the map's clip space, depth 0 nearest to the sun.
        pub map_from_world: Mat4,
        /// Whether there is a map, 0 or 1.
        pub strength: f32,
        /// Side of a texel, metres.
        pub texel_m: f32,
        /// How far from the eye the largest blades throw shadows, metres.
        pub thrown_to_m: f32,
        /// Padding.
        pub _pad_0: f32,
    }
}
use gpu_data::Shadow;

/// Where the map lies for this camera and this sun: around what is seen nearest, larger for a higher eye, and
/// moved by whole texels, so that shadows do not crawl when the camera moves. `thrown_to_m`: as far from the eye the
/// largest blades throw shadows.
pub fn place(camera: &Camera, to_sun: Vec3, thrown_to_m: f32) -> Shadow {
    let forward = camera.forward();
    // A step in size now and then, not a little with each frame.
    let half_m = 1.5f32.powf((camera.eye_height_m.max(0.2) * 5.0).log(1.5).round()).clamp(1.0, 6.0);
    let ahead = Vec2::new(forward.x, forward.z) * (0.7 * half_m);
    let on_ground = camera.foot + ahead;
    let centre = Vec3::new(on_ground.x, terrain::height_m(on_ground), on_ground.y);
    let up = if to_sun.y > 0.99 { Vec3::X } else { Vec3::Y };
    let sun_from_world = glam::camera::rh::view::look_to_mat4(Vec3::ZERO, -to_sun, up);
    let texel_m = 2.0 * half_m / SIDE as f32;
    let at = sun_from_world.transform_point3(centre);
    let corner = Vec2::new((at.x / texel_m).round(), (at.y / texel_m).round()) * texel_m;
    // Looking along −z, z falls with the way from the sun.
    let map_from_sun = directx::orthographic(
        corner.x - half_m,
        corner.x + half_m,
        corner.y - half_m,
        corner.y + half_m,
        -at.z - RANGE_M,
        -at.z + RANGE_M,
    );
    let map_from_world = map_from_sun * sun_from_world;
    Shadow { map_from_world, strength: 1.0, texel_m, thrown_to_m, _pad_0: 0.0 }
}

/// The pass, and what other passes bind to read its map.
#[derive(Debug)]
pub struct Shadows {
    /// Layout of what they bind.
    pub layout: wgpu::BindGroupLayout,
    /// What they bind.
    pub bindings: wgpu::BindGroup,
    uniform: wgpu::Buffer,
    map: wgpu::TextureView,
    seen_by_sun: World,
    pipeline: wgpu::RenderPipeline,
}

impl Shadows {
    /// The pass over this grass.
    pub fn new(gpu: &Gpu, grass: &wgpu::BindGroupLayout) -> Self {
        let seen_by_sun = World::new(gpu);
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
        let map = targets::texture(gpu, "shadow.map", (SIDE, SIDE), FORMAT, 1, usage)
            .create_view(&Default::default());
        let uniform = buffers::reserve(
            gpu,
            "shadow",
            BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            size_of::<Shadow>() as u64,
        );
        let (layout, bindings) = bind(gpu, &uniform, &map);
        let module = shader::module(gpu, "grass");
        let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("shadow"),
            bind_group_layouts: &[Some(&seen_by_sun.layout), Some(grass)],
            immediate_size: 0,
        });
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("shadow"),
            layout: Some(&pipeline_layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vs_sun"),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &[("SUN_STEPS", 8.0 * f64::from(SIDE))],
                    ..Default::default()
                },
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: FORMAT,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Less),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: None,
            multiview_mask: None,
            cache: None,
        });
        Self { layout, bindings, uniform, map, seen_by_sun, pipeline }
    }

    /// Without a map: what reads it sees the light that height alone takes.
    pub fn skip(&self, gpu: &Gpu) {
        gpu.queue.write_buffer(&self.uniform, 0, &[0; size_of::<Shadow>()]);
    }

    /// Draws the map at `place` with what `cull` let through.
    #[expect(clippy::too_many_arguments, reason = "a pass is given all that it reads")]
    pub fn draw(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        place: Shadow,
        frame: &Frame,
        light: &Light,
        (grass, bindings, cull): (&Grass, &wgpu::BindGroup, &Cull),
        timing: Option<&Timing>,
    ) {
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&place));
        let frame = Frame { clip_from_world: place.map_from_world, ..*frame };
        self.seen_by_sun.write(gpu, &frame, light);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("shadow.map"),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.map,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(1.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            timestamp_writes: timing.and_then(|timing| timing.render("shadow.map")),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.seen_by_sun.bindings, &[]);
        grass.draw_near(&mut pass, bindings, cull);
    }
}

fn bind(
    gpu: &Gpu,
    uniform: &wgpu::Buffer,
    map: &wgpu::TextureView,
) -> (wgpu::BindGroupLayout, wgpu::BindGroup) {
    let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
        ty,
        count: None,
    };
    let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("shadow"),
        entries: &[
            entry(
                0,
                wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
            ),
            entry(
                1,
                wgpu::BindingType::Texture {
                    sample_type: wgpu::TextureSampleType::Depth,
                    view_dimension: wgpu::TextureViewDimension::D2,
                    multisampled: false,
                },
            ),
        ],
    });
    let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("shadow"),
        layout: &layout,
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(map) },
        ],
    });
    (layout, bindings)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::sky;

    fn camera(foot: Vec2, heading_rad: f32) -> Camera {
        Camera { foot, eye_height_m: 0.5, heading_rad, pitch_rad: -0.2, fov_y_rad: 0.8 }
    }

    #[test]
    fn what_is_near_ahead_is_within_the_map_at_every_hour() {
        for (elevation_deg, heading) in [(1.0f32, 0.0), (20.0, 2.0), (60.0, 4.0), (90.0, 1.0)] {
            let to_sun = sky::direction(Vec2::new(heading, elevation_deg.to_radians()));
            let camera = camera(Vec2::new(40.0, -7.0), 1.0);
            let place = place(&camera, to_sun, 5.0);
            for ahead_m in [0.1, 1.0, 2.0] {
                let p = camera.foot + Vec2::new(camera.forward().x, camera.forward().z) * ahead_m;
                let p = Vec3::new(p.x, terrain::height_m(p) + 0.1, p.y);
                let at = place.map_from_world.project_point3(p);
                assert!(at.x.abs() < 0.95 && at.y.abs() < 0.95 && (0.0..1.0).contains(&at.z), "{p} at {at}");
                let sunward = place.map_from_world.project_point3(p + to_sun * 0.1);
                assert!(sunward.z < at.z, "nearer to the sun is less deep");
                assert!((sunward.truncate() - at.truncate()).length() < 1e-3, "and hides what is behind");
            }
        }
    }

    #[test]
    fn the_map_moves_by_whole_texels() {
        let to_sun = sky::direction(Vec2::new(0.7, 0.5));
        let texels =
            |place: &Shadow, p: Vec3| place.map_from_world.project_point3(p).truncate() * (0.5 * SIDE as f32);
        let first = place(&camera(Vec2::ZERO, 0.3), to_sun, 5.0);
        for step in 1..20 {
            let next = place(&camera(Vec2::splat(step as f32 * 0.013), 0.3), to_sun, 5.0);
            let moved = texels(&next, Vec3::ONE) - texels(&first, Vec3::ONE);
            assert!((moved - moved.round()).length() < 0.02, "by {moved}");
        }
    }

    #[test]
    fn the_matrix_is_finite_for_a_sun_in_the_zenith() {
        assert!(place(&camera(Vec2::ZERO, 0.0), Vec3::Y, 5.0).map_from_world.is_finite());
    }
}
