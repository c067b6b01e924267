//! Does a meadow grow, and does a new library go live whole? These need a Vulkan device, one in software will
//! do; without one they say so, or fail with SWARD_REQUIRE_GPU=1.

mod common;

use std::io::Write;

use ::common::library::Snapshot;
use glam::Vec2;
use renderer::frame::{SWAP_S, View};
use renderer::gpu::device::OpenError;
use renderer::gpu::shader::Sources;
use renderer::headless::Studio;
use renderer::nursery::Seedling;
use renderer::passes::cull;
use renderer::scene::camera::Camera;
use renderer::scene::grassland::shapes::shapes;
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

/// Whether two pictures show the same: the GPU's order of blades is its own, which few pixels tell.
fn alike(a: &[u8], b: &[u8]) -> bool {
    let differing = a.iter().zip(b).filter(|(a, b)| a.abs_diff(**b) > 8).count();
    a.len() == b.len() && differing * 2000 < a.len()
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
    assert!(
        alike(&picture_of_b, &fresh.draw(&view()).expect("a picture")),
        "nothing of the old library is left"
    );
    assert!(!alike(&picture_of_b, &picture_of_a));
    swapped.plant(&library(3, &[]));
    let bare = swapped.draw(&view()).expect("a picture");
    assert!(green_pixels(&bare) < green_pixels(&picture_of_b) / 2, "the last blade can be taken away too");
}
#[test]
fn a_bare_meadow_turns_green_bit_by_bit() {
    let Some(mut studio) = or_skip(Studio::open(SIZE)) else { return };
    // To the horizon, where the ground stands for the grass.
    let camera = Camera { eye_height_m: 1.6, pitch_rad: -0.1, ..view().camera };
    let view = View { camera, ..view() };
    let mut before = studio.draw(&view).expect("a picture");
    let bare = before.clone();
    let library = library(1, &[0, 1]);
    studio.garden().grow(Seedling { generation: 1, shapes: shapes(&library) });
    let change = |a: &[u8], b: &[u8]| a.iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(*b))).sum::<u64>();
    let mut steps = Vec::new();
    for _ in 0..=10 {
        let now = studio.draw(&view).expect("a picture");
        steps.push(change(&before, &now));
        before = now;
        studio.garden().pass_time(0.1 * SWAP_S);
    }
    let whole = change(&bare, &before);
    let largest = *steps.iter().max().expect("steps");
    assert!(whole > 5 * (SIZE.0 * SIZE.1) as u64, "it turns green: {whole}");
    assert!(3 * largest < 2 * whole, "no step is most of the change: {steps:?} of {whole}");
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
        assert!(alike(&after, &before), "the same meadow");
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

#[test]
fn shadows_do_not_make_a_meadow_brighter() {
    let Some(mut studio) = or_skip(Studio::open(SIZE)) else { return };
    studio.plant(&Snapshot::validate(common::meadow(1)).expect("valid"));
    // Low and high: near blades throw shadows, and none that is small in the picture does.
    for (eye_height_m, pitch_rad) in [(0.45, -0.2), (1.7, -0.5), (1.7, -0.17), (3.0, -0.6)] {
        let camera = Camera { eye_height_m, pitch_rad, ..view().camera };
        let view = View { camera, sun_rad: Vec2::new(0.6, 0.5), ..view() };
        let below = |picture: Vec<u8>| {
            let lower = &picture[picture.len() / 2..];
            lower.iter().map(|value| f64::from(*value)).sum::<f64>() / lower.len() as f64
        };
        studio.garden().set_shadows(true);
        let with = below(studio.draw(&view).expect("a picture"));
        studio.garden().set_shadows(false);
        let without = below(studio.draw(&view).expect("a picture"));
        assert!(with / without < 1.02, "{eye_height_m} m: {with} with, {without} without");
    }
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
