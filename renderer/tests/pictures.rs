//! Does a meadow grow, and does a new library go live whole? These need a Vulkan device, one in software will
//! do; without one they say so, or fail with SWARD_REQUIRE_GPU=1.

mod common;

use std::io::Write;

use ::common::library::Snapshot;
use glam::Vec2;
use renderer::frame::View;
use renderer::gpu::device::OpenError;
use renderer::headless::Studio;
use renderer::scene::camera::Camera;

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
