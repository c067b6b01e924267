//! Does a meadow grow, does a new library go live whole, and do GPU and CPU cull alike? These need a
//! Vulkan device, one in software will do; without one they say so, or fail with SWARD_REQUIRE_GPU=1.

mod common;

use std::collections::HashMap;
use std::io::Write;

use ::common::library::Snapshot;
use glam::Vec2;
use renderer::frame::{View, gpu_data::Frame};
use renderer::gpu::device::{self, OpenError};
use renderer::gpu::shader::Sources;
use renderer::gpu::{Gpu, readback};
use renderer::headless::Studio;
use renderer::passes::cull::{self, Cull, gpu_data::Draw, gpu_data::Instance};
use renderer::passes::world::World;
use renderer::scene::camera::Camera;
use renderer::scene::grassland;
use renderer::scene::light::Light;
use renderer::scene::terrain;

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

fn or_skip<T>(opened: Result<T, OpenError>) -> Option<T> {
    match opened {
        Ok(opened) => Some(opened),
        Err(error) if std::env::var_os("SWARD_REQUIRE_GPU").is_some_and(|value| value == "1") => {
            panic!("{error}")
        }
        Err(_) => {
            // Not by a macro, whose output the test harness would hide.
            writeln!(std::io::stderr(), "skipped: no Vulkan device").expect("stderr is there");
            None
        }
    }
}

fn library(generation: u64, which: &[usize]) -> Snapshot<Vec<u8>> {
    Snapshot::validate(common::library(generation, which)).expect("a valid library")
}

/// How many of the picture's pixels are green: more of it than of red and of blue.
fn green_pixels(picture: &[u8]) -> usize {
    picture
        .chunks_exact(4)
        .filter(|p| p[1] > p[0].saturating_add(5) && p[1] > p[2].saturating_add(20))
        .count()
}

#[test]
fn blades_make_the_picture_green() {
    let Some(mut studio) = or_skip(Studio::open(SIZE)) else { return };
    let pixels = (SIZE.0 * SIZE.1) as usize;
    let bare = studio.draw(&view()).expect("a picture");
    assert_eq!(bare.len(), 4 * pixels);
    studio.plant(&library(1, &[]));
    assert_eq!(studio.draw(&view()).expect("a picture"), bare, "an empty library leaves the ground bare");
    studio.plant(&Snapshot::validate(common::meadow(2)).expect("valid"));
    let grown = studio.draw(&view()).expect("a picture");
    let (before, after) = (green_pixels(&bare), green_pixels(&grown));
    assert!(after > before + pixels / 3, "{before} green pixels when bare, {after} of {pixels} when grown");
    let black = grown.chunks_exact(4).filter(|p| p[..3] == [0, 0, 0]).count();
    assert!(black < pixels / 200, "{black} black pixels: numbers that are none?");
    assert!(grown.chunks_exact(4).all(|p| p[3] == 255));
}

#[test]
fn a_new_library_goes_live_whole() {
    let (Some(mut swapped), Some(mut fresh)) = (or_skip(Studio::open(SIZE)), or_skip(Studio::open(SIZE)))
    else {
        return;
    };
    let (a, b) = (library(1, &[0, 1]), library(2, &[2, 3, 4]));
    swapped.plant(&a);
    let picture_of_a = swapped.draw(&view()).expect("a picture");
    swapped.plant(&b);
    let picture_of_b = swapped.draw(&view()).expect("a picture");
    fresh.plant(&b);
    assert!(picture_of_b == fresh.draw(&view()).expect("a picture"), "nothing of the old library is left");
    assert!(picture_of_b != picture_of_a);
    swapped.plant(&library(3, &[]));
    let bare = swapped.draw(&view()).expect("a picture");
    assert!(green_pixels(&bare) < green_pixels(&picture_of_b) / 2, "the last blade can be taken away too");
}

fn cull_on_gpu(gpu: &Gpu, frame: &Frame, window: cull::gpu_data::Window) -> Vec<Vec<Instance>> {
    let patch = cull::upload_patch(gpu, &grassland::patch(7));
    let world = World::new(gpu);
    world.write(gpu, frame, &Light::new(view().sun_rad));
    let cull = Cull::new(gpu, &world.layout, &patch);
    // Twice: the counts of the first time must be gone.
    for _ in 0..2 {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        cull.encode(gpu, &mut encoder, &world.bindings, window);
        gpu.queue.submit([encoder.finish()]);
    }
    let draws = readback::buffer(gpu, &cull.draws).expect("draws");
    let instances = readback::buffer(gpu, &cull.instances).expect("instances");
    let stride = size_of::<Instance>();
    cull::regions()
        .iter()
        .zip(draws.chunks_exact(size_of::<Draw>()))
        .map(|(region, draw)| {
            let count = bytemuck::pod_read_unaligned::<Draw>(draw).instance_count;
            assert!(count <= region.end - region.start, "{count} blades in a region of {region:?}");
            instances[region.start as usize * stride..][..count as usize * stride]
                .chunks_exact(stride)
                .map(bytemuck::pod_read_unaligned)
                .collect()
        })
        .collect()
}

/// Where and which, to a tenth of a millimetre: the GPU's order is its own.
fn key(instance: &Instance) -> (u32, i32, i32) {
    let at = instance.root_in_world * 1e4;
    (instance.blade_and_lushness & 0xFFFF, at.x.round() as i32, at.z.round() as i32)
}

#[test]
fn gpu_and_cpu_cull_alike() {
    let Some(gpu) = or_skip(Gpu::open(&device::instance(), None)) else { return };
    let view = view();
    let frame = view.uniform(SIZE, true);
    let window = cull::window(frame.eye_in_world, 0.3);
    let on_cpu = cull::cpu::main(&frame, &window, &grassland::patch(7));
    let on_gpu = cull_on_gpu(&gpu, &frame, window);
    for (level, (cpu, gpu)) in on_cpu.iter().zip(&on_gpu).enumerate() {
        assert!(cpu.len() > 500, "level {level} has {} blades", cpu.len());
        let by_key: HashMap<_, _> = gpu.iter().map(|instance| (key(instance), instance)).collect();
        assert_eq!(by_key.len(), gpu.len(), "no blade twice");
        // A tile on the very border of a plane or of a distance may fall to either side, for the two
        // round differently; a blade of almost no presence likewise.
        let mut missing = 0;
        for expected in cpu {
            let Some(found) = by_key.get(&key(expected)) else {
                missing += 1;
                continue;
            };
            let root = found.root_in_world.distance(expected.root_in_world);
            let bend = found.bend_rad.distance(expected.bend_rad);
            let lush = (found.blade_and_lushness >> 16).abs_diff(expected.blade_and_lushness >> 16);
            let close = root < 1e-4
                && bend < 1e-3
                && lush <= 1
                && (found.presence - expected.presence).abs() < 1e-2
                && (found.widen - expected.widen).abs() < 1e-3;
            assert!(close, "level {level}: {found:?}, expected {expected:?}");
        }
        assert!(missing * 200 <= cpu.len(), "level {level}: {missing} of {} blades missing", cpu.len());
        assert!(cpu.len().abs_diff(gpu.len()) * 200 <= cpu.len(), "{} and {}", cpu.len(), gpu.len());
    }
}

#[test]
fn every_view_fits_the_regions() {
    let regions = cull::regions();
    let patch = grassland::patch(7);
    for (height, pitch) in [(0.0, 0.0), (0.4, -0.2), (0.1, -1.57), (3.0, -1.57)] {
        let mut view = view();
        (view.camera.eye_height_m, view.camera.pitch_rad, view.camera.fov_y_rad) = (height, pitch, 2.0);
        let mut frame = view.uniform((1000, 200), true);
        // All around at once, which no camera sees.
        frame.planes = [glam::Vec4::W; 5];
        let levels = cull::cpu::main(&frame, &cull::window(frame.eye_in_world, 0.3), &patch);
        for (level, region) in levels.iter().zip(&regions) {
            assert!(level.len() <= region.len(), "{} blades in a region of {}", level.len(), region.len());
        }
    }
}

#[test]
fn a_lost_device_is_replaced_and_the_meadow_stays() {
    let Some(mut studio) = or_skip(Studio::open(SIZE)) else { return };
    studio.plant(&library(5, &[0, 1, 3]));
    let before = studio.draw(&view()).expect("a picture");
    for _ in 0..2 {
        let gpu = &studio.garden().gpu;
        gpu.device.destroy();
        gpu.device.poll(wgpu::PollType::Poll).ok();
        assert!(gpu.is_lost(), "the driver says so");
        let after = studio.draw(&view()).expect("a picture of the new device");
        assert!(after == before, "the same meadow");
        assert_eq!(studio.generation(), 5);
    }
}

#[test]
fn changed_shaders_are_used_and_wrong_ones_are_not() {
    let Some(mut studio) = or_skip(Studio::open(SIZE)) else { return };
    studio.plant(&library(1, &[0]));
    let before = studio.draw(&view()).expect("a picture");
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("sky/sky.wgsl");
    std::fs::create_dir_all(file.parent().expect("a folder")).expect("made");
    let good = include_str!("../src/passes/sky/sky.wgsl");
    let red = good.replace("return stored(colour);", "return vec4f(0.4, 0.0, 0.0, 1.0);");
    assert_ne!(red, good);
    for (text, accepted) in
        [(red.as_str(), true), ("fn fs_main( {", false), (&red.replace("frame.", "phrame."), false)]
    {
        std::fs::write(&file, text).expect("written");
        let sources = Sources::read(folder.path()).expect("readable");
        let result = studio.garden().replace_shaders(sources);
        match result {
            Ok(()) => assert!(accepted, "{text:.60} is taken"),
            Err(error) => {
                assert!(!accepted, "{text:.60} is refused: {error}");
                assert!(error.to_string().len() > 20, "it says what is wrong: {error}");
            }
        }
        let picture = studio.draw(&view()).expect("a picture");
        let reds = picture
            .chunks_exact(4)
            .filter(|p| p[0] > p[1].saturating_add(50) && p[0] > p[2].saturating_add(50))
            .count();
        assert!(reds > 1000, "the last good sky stays: {reds} red pixels");
        assert_ne!(picture, before);
    }
    assert!(Sources::read(&folder.path().join("nowhere")).is_err());
}

#[test]
fn blades_throw_shadows_on_each_other() {
    let Some(mut studio) = or_skip(Studio::open(SIZE)) else { return };
    studio.plant(&Snapshot::validate(common::meadow(1)).expect("valid"));
    let mut low = view();
    low.sun_rad.y = 0.5;
    let with = studio.draw(&low).expect("a picture");
    studio.garden().set_shadows(false);
    let without = studio.draw(&low).expect("a picture");
    let brightness =
        |picture: &[u8]| picture.iter().map(|value| f64::from(*value)).sum::<f64>() / picture.len() as f64;
    let differing = with.iter().zip(&without).filter(|(a, b)| a.abs_diff(**b) > 12).count();
    assert!(differing > with.len() / 50, "{differing} values differ");
    // Near map and far formula take about the same light, or the map's end would be seen.
    let (with, without) = (brightness(&with), brightness(&without));
    assert!((with / without - 1.0).abs() < 0.08, "{with} with, {without} without");
}

/// Mean colour of the ground and what grows on it between two distances from a camera that looks down on it.
fn mean_between(studio: &mut Studio, view: &View, near_m: f32, far_m: f32) -> glam::Vec3 {
    let picture = studio.draw(view).expect("a picture");
    let clip_from_world = view.camera.clip_from_world(SIZE.0 as f32 / SIZE.1 as f32);
    let ahead = view.camera.forward().with_y(0.0).normalize();
    let row_at = |distance_m: f32| {
        let p = view.camera.foot + Vec2::new(ahead.x, ahead.z) * distance_m;
        let y = clip_from_world.project_point3(glam::Vec3::new(p.x, terrain::height_m(p), p.y)).y;
        ((0.5 - 0.5 * y) * SIZE.1 as f32) as usize
    };
    let rows = row_at(far_m)..row_at(near_m);
    assert!(rows.len() >= 4 && rows.end < SIZE.1 as usize, "{rows:?} between {near_m} and {far_m} m");
    let pixels = &picture[4 * rows.start * SIZE.0 as usize..4 * rows.end * SIZE.0 as usize];
    let sum: glam::Vec3 =
        pixels.chunks_exact(4).map(|p| glam::Vec3::new(p[0].into(), p[1].into(), p[2].into())).sum();
    sum * 4.0 / pixels.len() as f32
}

#[test]
fn no_line_shows_where_blades_end() {
    let Some(mut studio) = or_skip(Studio::open(SIZE)) else { return };
    studio.plant(&Snapshot::validate(common::meadow(1)).expect("valid"));
    for sun_rad in [Vec2::new(0.6, 0.5), Vec2::new(3.6, 0.9), Vec2::new(0.1, 0.2)] {
        let camera = Camera { eye_height_m: 7.0, pitch_rad: -0.25, heading_rad: 0.1, ..view().camera };
        let view = View { camera, sun_rad, ..view() };
        let (inside, outside) = (0.75 * cull::RANGE_M, cull::RANGE_M);
        let blades = mean_between(&mut studio, &view, inside, outside);
        let ground = mean_between(&mut studio, &view, outside, 1.35 * outside);
        let off = (blades - ground).abs().max_element();
        assert!(off < 14.0, "sun {sun_rad}: {blades} before, {ground} behind the end of the blades");
    }
}
