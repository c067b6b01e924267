//! Does a tile that is simulated show the knots that it is given, and do all others stand as the library says?
//! Needs a Vulkan device; says so where there is none, or fails with SWARD_REQUIRE_GPU=1.

mod common;

use std::f32::consts::TAU;
use std::io::Write;

use ::common::library::Snapshot;
use glam::{IVec2, Quat, Vec2, Vec3};
use renderer::frame::{Meadow, PATCH_SEED, View};
use renderer::gpu::targets::{self, Targets};
use renderer::gpu::{Gpu, device, readback};
use renderer::passes::cull::cpu::{self, Grown};
use renderer::passes::cull::gpu_data::{Instance, Slot};
use renderer::passes::cull::{self, Detail};
use renderer::passes::grass;
use renderer::passes::grass::gpu_data::SimulatedKnot;
use renderer::scene::camera::Camera;
use renderer::scene::grassland::field::Field;
use renderer::scene::grassland::shapes::{LEVEL_KNOTS, SHAPE_KNOTS, Shapes, shapes};
use renderer::scene::grassland::{self, TILE_BLADES, TILE_M};

const SIZE: (u32, u32) = (320, 180);
/// Tiles to each side of the one before the camera that are simulated.
const AROUND: i32 = 3;

fn view() -> View {
    let camera = Camera {
        foot: Vec2::new(11.3, -4.1),
        eye_height_m: 0.6,
        heading_rad: 0.4,
        pitch_rad: -0.5,
        fov_y_rad: 0.6,
    };
    View { camera, time_s: 1.25, sun_rad: Vec2::new(0.6, 0.5) }
}

/// The tiles that the camera looks at.
fn slots() -> Vec<Slot> {
    let camera = view().camera;
    let ahead = Vec2::new(camera.heading_rad.sin(), -camera.heading_rad.cos()) * 1.1;
    let middle = ((camera.foot + ahead) / TILE_M).floor().as_ivec2();
    let around = -AROUND..=AROUND;
    let tiles = around.clone().flat_map(|z| around.clone().map(move |x| middle + IVec2::new(x, z)));
    tiles.zip(0..).map(|(tile, slot)| Slot { tile_x: tile.x, tile_z: tile.y, slot, _pad_0: 0 }).collect()
}

/// Where the library has a blade's knots, without wind: metres from its root, along the world's axes.
fn at_rest(shapes: &Shapes, blade: &Instance) -> Vec<Vec3> {
    let packed = blade.shape_turn_scale_mirror;
    let turn = Quat::from_rotation_y((packed >> 12 & 0xFFF) as f32 * (TAU / 4096.0));
    let mirror = Vec3::new(if packed >> 31 == 1 { -1.0 } else { 1.0 }, 1.0, 1.0);
    let heading = (blade.lean_hue & 0xFFF) as f32 * (TAU / 4096.0);
    let lean_rad = (blade.lean_hue >> 12 & 0xFF) as f32 * (0.5 / 256.0);
    let lean = Quat::from_axis_angle(Vec3::new(heading.sin(), 0.0, -heading.cos()), lean_rad);
    let shape = (blade.first_knot & 0x7FFF_FFFF) / SHAPE_KNOTS * SHAPE_KNOTS;
    let knots = &shapes.knots[shape as usize..][..LEVEL_KNOTS[0] as usize];
    knots.iter().map(|knot| lean * (turn * (knot.position * mirror) * blade.scale)).collect()
}

struct Stand {
    gpu: Gpu,
    meadow: Meadow,
    targets: Targets,
    picture: wgpu::Texture,
}

impl Stand {
    /// `None`: there is no Vulkan device.
    fn open(library: &[u8]) -> Option<Self> {
        let gpu = match Gpu::open(&device::instance(), None) {
            Ok(gpu) => gpu,
            Err(error) if std::env::var_os("SWARD_REQUIRE_GPU").is_some_and(|value| value == "1") => {
                panic!("{error}")
            }
            Err(_) => {
                // Not by a macro, whose output the test harness would hide.
                writeln!(std::io::stderr(), "skipped: no Vulkan device").expect("stderr is there");
                return None;
            }
        };
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let picture = targets::texture(&gpu, "picture", SIZE, targets::PICTURE, 1, usage);
        let mut meadow = Meadow::new(&gpu, targets::PICTURE);
        meadow.plant(&gpu, &Snapshot::validate(library).expect("a valid library"));
        Some(Self { targets: Targets::new(&gpu, SIZE), gpu, meadow, picture })
    }

    fn draw(&self) -> Vec<u8> {
        self.meadow.draw(&self.gpu, &self.targets, &view(), &self.picture.create_view(&Default::default()));
        readback::texels(&self.gpu, &self.picture).expect("a picture")
    }
}

/// Share of the picture's bytes that differ by more than rounding does.
fn changed(a: &[u8], b: &[u8]) -> f32 {
    let count = a.iter().zip(b).filter(|(a, b)| a.abs_diff(**b) > 8).count();
    count as f32 / a.len() as f32
}

#[test]
fn a_simulated_tile_stands_as_its_knots_say() {
    let library = common::meadow(1);
    let Some(mut stand) = Stand::open(&library) else { return };
    let shapes = shapes(&Snapshot::validate(library).expect("a valid library")).expect("something grows");
    let shares = grass::shares(Some(&shapes));
    let patch = grassland::patch(PATCH_SEED);
    let frame = view().uniform(SIZE, 1.0);
    let plan = cull::plan(&frame, &Field::ENDLESS, Detail::default(), shapes.reach_m, 1.0);
    let slots = slots();
    let grown = Grown { patch: &patch, shares: &shares, old_shares: &shares, slots: &slots };
    let blades: Vec<Instance> = cpu::main(&frame, &plan, &grown).into_iter().flatten().collect();
    let simulated: Vec<&Instance> = blades.iter().filter(|blade| blade.simulated >= 0).collect();
    assert!(simulated.len() > 500, "{} simulated blades in sight", simulated.len());

    let room = slots.len() * (TILE_BLADES * LEVEL_KNOTS[0]) as usize;
    let pose = |pose: &dyn Fn(Vec3) -> Vec3| {
        let mut knots = vec![SimulatedKnot { position: Vec3::ZERO, _pad_0: 0 }; room];
        for blade in &simulated {
            for (at, position) in at_rest(&shapes, blade).into_iter().enumerate() {
                knots[blade.simulated as usize + at].position = pose(position);
            }
        }
        knots
    };
    let plain = stand.draw();

    stand.meadow.simulate(&stand.gpu, &slots, &pose(&|position| position));
    let rest = changed(&plain, &stand.draw());
    // Tangents come from the knots' own neighbours, which is a little else than the library's.
    assert!(rest < 0.04, "at rest {rest} of the picture differs");

    stand.meadow.simulate(&stand.gpu, &slots, &pose(&|position| Quat::from_rotation_z(1.2) * position));
    let laid = changed(&plain, &stand.draw());
    assert!(laid > 0.2, "laid flat, only {laid} of the picture differs");

    // Of slots whose knots are not there, none is simulated; nor is one once they are taken back.
    stand.meadow.simulate(&stand.gpu, &slots, &[]);
    assert_eq!(changed(&plain, &stand.draw()), 0.0);
    stand.meadow.simulate(&stand.gpu, &[], &pose(&|_| Vec3::ZERO));
    assert_eq!(changed(&plain, &stand.draw()), 0.0);
}
