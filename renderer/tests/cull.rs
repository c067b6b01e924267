//! Do GPU and CPU let the same blades through, and do they fit? Those that need a Vulkan device say so where
//! there is none, or fail with SWARD_REQUIRE_GPU=1.

mod common;

use std::collections::HashMap;
use std::io::Write;

use ::common::library::Snapshot;
use glam::{Vec2, Vec4};
use renderer::frame::{View, gpu_data::Frame};
use renderer::gpu::{Gpu, device, readback};
use renderer::passes::cull::cpu::{self, Grown};
use renderer::passes::cull::gpu_data::{Counts, Draw, Instance, Share, Slot};
use renderer::passes::cull::{self, Cull, Detail, Plan};
use renderer::passes::grass;
use renderer::passes::world::World;
use renderer::scene::camera::Camera;
use renderer::scene::grassland::field::Field;
use renderer::scene::grassland::shapes::{LEVELS, shapes};
use renderer::scene::grassland::{self, TILE_M};
use renderer::scene::light::Light;

const SIZE: (u32, u32) = (320, 180);

fn view() -> View {
    View {
        camera: Camera {
            foot: Vec2::new(11.3, -4.1),
            eye_height_m: 0.45,
            heading_rad: 0.4,
            pitch_rad: -0.15,
            fov_y_rad: 0.8,
        },
        time_s: 1.25,
        sun_rad: Vec2::new(0.6, 0.5),
    }
}

fn shares(bytes: Vec<u8>) -> Vec<Share> {
    grass::shares(shapes(&Snapshot::validate(bytes).expect("valid")).as_ref())
}

fn cull_on_gpu(gpu: &Gpu, frame: &Frame, plan: &Plan, grown: &Grown<'_>) -> Vec<Vec<Instance>> {
    let patch = cull::upload_patch(gpu, grown.patch);
    let world = World::new(gpu);
    world.write(gpu, frame, &Light::new(view().sun_rad));
    let mut cull = Cull::new(gpu, &world.layout, plan.survey.capacity);
    cull.set_slots(gpu, grown.slots);
    let [now, before] = [grown.shares, grown.old_shares].map(|shares| cull::upload_shares(gpu, shares));
    let bindings = cull.bind(gpu, &patch, &now, &before);
    // Twice: the counts of the first time must be gone.
    for _ in 0..2 {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        cull.encode(gpu, &mut encoder, &world.bindings, &bindings, plan, None);
        gpu.queue.submit([encoder.finish()]);
    }
    let read = |buffer| readback::buffer(gpu, buffer).expect("what the GPU wrote");
    let counts: Counts = bytemuck::pod_read_unaligned(&read(&cull.counts)[..size_of::<Counts>()]);
    let draws: Vec<Draw> =
        read(&cull.draws).chunks_exact(size_of::<Draw>()).map(bytemuck::pod_read_unaligned).collect();
    let instances: Vec<Instance> =
        read(&cull.instances).chunks_exact(size_of::<Instance>()).map(bytemuck::pod_read_unaligned).collect();
    let lists: Vec<u32> = read(&cull.lists).chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
    assert_eq!(
        draws.iter().map(|draw| draw.instance_count).sum::<u32>(),
        counts.instances.min(cull.capacity)
    );
    assert_eq!(draws.len(), LEVELS);
    draws
        .iter()
        .map(|draw| {
            let list = &lists[draw.first_instance as usize..][..draw.instance_count as usize];
            list.iter().map(|at| instances[*at as usize]).collect()
        })
        .collect()
}

/// Where and what, to a tenth of a millimetre: the GPU's order is its own.
fn key(instance: &Instance) -> (u32, i32, i32) {
    let at = instance.root_in_world * 1e4;
    (instance.salt, at.x.round() as i32, at.z.round() as i32)
}

/// Whether a blade that only one of the two has is one that may fall to either side: on the border of a plane,
/// of a distance or of a clump, for the two round differently.
fn compare(on_cpu: &[Vec<Instance>], on_gpu: &[Vec<Instance>]) {
    let of_gpu: HashMap<_, _> = (on_gpu.iter().enumerate())
        .flat_map(|(level, blades)| blades.iter().map(move |blade| (key(blade), (level, blade))))
        .collect();
    assert_eq!(of_gpu.len(), on_gpu.iter().map(Vec::len).sum::<usize>(), "no blade twice");
    let (mut odd, mut all) = (0_usize, 0_usize);
    for (level, blades) in on_cpu.iter().enumerate() {
        for expected in blades {
            all += 1;
            let Some((found_level, found)) = of_gpu.get(&key(expected)) else {
                odd += 1;
                continue;
            };
            if *found_level != level || found.first_knot != expected.first_knot {
                odd += 1;
                continue;
            }
            let close = found.root_in_world.distance(expected.root_in_world) < 1e-4
                && found.bend_rad.distance(expected.bend_rad) < 1e-3
                && (found.scale - expected.scale).abs() < 1e-2
                && (found.widen / expected.widen - 1.0).abs() < 2e-2
                && (found.morph - expected.morph).abs() < 1e-2
                && (found.lush - expected.lush).abs() < 1e-3
                && (found.stands_for - expected.stands_for).abs() < 1e-2
                && found.simulated == expected.simulated
                && found.lean_hue == expected.lean_hue;
            // Of a blade that is just about to come, the root of almost nothing is anything.
            assert!(close || expected.scale < 0.05, "level {level}: {found:?}, expected {expected:?}");
        }
    }
    assert!(odd * 200 <= all, "{odd} of {all} blades differ");
    assert!(all.abs_diff(of_gpu.len()) * 200 <= all, "{all} blades and {}", of_gpu.len());
}

#[test]
fn gpu_and_cpu_cull_alike() {
    let gpu = match Gpu::open(&device::instance(), None) {
        Ok(gpu) => gpu,
        Err(error) if std::env::var_os("SWARD_REQUIRE_GPU").is_some_and(|value| value == "1") => {
            panic!("{error}")
        }
        Err(_) => {
            // Not by a macro, whose output the test harness would hide.
            writeln!(std::io::stderr(), "skipped: no Vulkan device").expect("stderr is there");
            return;
        }
    };
    let patch = grassland::patch(7);
    let (now, before) = (shares(common::meadow(1)), shares(common::library(2, &[0, 2, 5])));
    let view = view();
    let frame = view.uniform(SIZE, 1.0);
    let eye_tile = (view.camera.foot / TILE_M).floor().as_ivec2();
    let slots: Vec<Slot> = (-9..9)
        .map(|step| Slot {
            tile_x: eye_tile.x + step,
            tile_z: eye_tile.y - 5 - step,
            slot: step + 9,
            _pad_0: 0,
        })
        .collect();
    let grown = Grown { patch: &patch, shares: &now, old_shares: &before, slots: &slots };

    let whole = cull::plan(&frame, &Field::ENDLESS, Detail::default(), 0.3, 1.0);
    let on_cpu = cpu::main(&frame, &whole, &grown);
    for (level, blades) in on_cpu.iter().enumerate().skip(1) {
        assert!(blades.len() > 300, "level {level} has {} blades", blades.len());
    }
    assert!(on_cpu.iter().flatten().any(|blade| blade.simulated >= 0), "a simulated tile is in sight");
    compare(&on_cpu, &cull_on_gpu(&gpu, &frame, &whole, &grown));

    let swapping = cull::plan(&frame, &Field::of_tiles(20_000), Detail::default(), 0.3, 0.4);
    let on_cpu = cpu::main(&frame, &swapping, &grown);
    assert!(on_cpu.iter().flatten().any(|blade| blade.first_knot >> 31 == 1), "old ones are left");
    assert!(on_cpu.iter().flatten().any(|blade| blade.first_knot >> 31 == 0), "new ones grow");
    compare(&on_cpu, &cull_on_gpu(&gpu, &frame, &swapping, &grown));

    let naive = Detail { naive: true, ..Detail::default() };
    let everything = cull::plan(&frame, &Field::of_tiles(500), naive, 0.3, 1.0);
    let on_cpu = cpu::main(&frame, &everything, &grown);
    assert!(on_cpu[0].len() > 500 * 64 / 2 && on_cpu[1..].iter().all(Vec::is_empty));
    compare(&on_cpu, &cull_on_gpu(&gpu, &frame, &everything, &grown));
}

#[test]
fn every_view_fits_the_lists() {
    let patch = grassland::patch(7);
    let shares = shares(common::meadow(1));
    let grown = Grown { patch: &patch, shares: &shares, old_shares: &shares, slots: &[] };
    for (height, fov, size) in [(0.0, 2.0, (1000, 200)), (3.0, 0.6, (3840, 2160)), (0.4, 1.0, (8192, 8192))] {
        let mut view = view();
        (view.camera.eye_height_m, view.camera.fov_y_rad) = (height, fov);
        let mut frame = view.uniform(size, 1.0);
        // All around at once, which no camera sees.
        frame.planes = [Vec4::W; 5];
        let plan = cull::plan(&frame, &Field::ENDLESS, Detail::default(), 0.6, 1.0);
        let blades: usize = cpu::main(&frame, &plan, &grown).iter().map(Vec::len).sum();
        assert!(blades <= cull::CAPACITY as usize, "{blades} blades, room for {}", cull::CAPACITY);
        assert!(blades > cull::CAPACITY as usize / 20, "{blades} blades: too few to call it a meadow");
    }
}

#[test]
fn blades_come_and_go_and_change_in_small_steps() {
    let patch = grassland::patch(7);
    let shares = shares(common::meadow(1));
    let grown = Grown { patch: &patch, shares: &shares, old_shares: &shares, slots: &[] };
    let at = |step_m: f32| {
        let mut view = view();
        view.camera.foot.y -= step_m;
        let mut frame = view.uniform(SIZE, 1.0);
        // Turning away is no popping.
        frame.planes = [Vec4::W; 5];
        let plan = cull::plan(&frame, &Field::of_tiles(4000), Detail::default(), 0.3, 1.0);
        let blades = cpu::main(&frame, &plan, &grown);
        blades.into_iter().flatten().map(|blade| (key(&blade), blade)).collect::<HashMap<_, _>>()
    };
    let (here, there) = (at(0.0), at(0.01));
    assert!(here.len() > 5000, "{} blades", here.len());
    let mut largest: f32 = 0.0;
    for (key, blade) in &here {
        let scale = there.get(key).map_or(0.0, |blade| blade.scale);
        largest = largest.max((scale - blade.scale).abs());
    }
    for (key, blade) in &there {
        if !here.contains_key(key) {
            largest = largest.max(blade.scale);
        }
    }
    assert!(largest < 0.45, "a step of 1 cm changes a blade's scale by {largest}");
}
