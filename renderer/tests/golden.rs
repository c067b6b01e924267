//! Do small scenes look as they did? Each is drawn and compared with its picture in `tests/golden` by
//! FLIP, a measure of what an eye sees of a difference (Andersson et al. 2020). A failure leaves actual,
//! expected and difference in the folder that it names. `make goldens` draws them anew.
//!
//! Without a Vulkan device these say so, or fail with SWARD_REQUIRE_GPU=1.

mod common;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use ::common::library::Snapshot;
use glam::Vec2;
use image::RgbImage;
use nv_flip::{FlipImageRgb8, FlipPool};
use renderer::frame::View;
use renderer::gpu::device::OpenError;
use renderer::headless::Studio;
use renderer::passes::cull::Detail;
use renderer::scene::camera::Camera;
use renderer::scene::grassland::field::Field;

const SIZE: (u32, u32) = (480, 270);
/// Mean FLIP that Mesa's software driver may be off by: it rounds a little differently on other processors.
const SAME_DRIVER: f32 = 0.002;
/// The same of any other driver.
const OTHER_DRIVER: f32 = 0.04;

struct Scene {
    name: &'static str,
    /// Which of the fixture's blades grow; `None`: all.
    blades: Option<&'static [usize]>,
    /// Whether blades throw shadows.
    shadows: bool,
    field: Field,
    view: View,
}

fn view(eye_height_m: f32, heading_deg: f32, pitch_deg: f32, sun_deg: (f32, f32)) -> View {
    View {
        camera: Camera {
            foot: Vec2::new(3.1, -2.4),
            eye_height_m,
            heading_rad: heading_deg.to_radians(),
            pitch_rad: pitch_deg.to_radians(),
            fov_y_rad: 0.42,
        },
        time_s: 2.5,
        sun_rad: Vec2::new(sun_deg.0.to_radians(), sun_deg.1.to_radians()),
    }
}

/// Views that see few tiles.
fn scenes() -> Vec<Scene> {
    vec![
        Scene {
            name: "sky",
            blades: Some(&[]),
            shadows: false,
            field: Field::ENDLESS,
            view: view(1.5, 40.0, 12.0, (60.0, 22.0)),
        },
        Scene {
            name: "bare-ground",
            blades: Some(&[]),
            shadows: false,
            field: Field::ENDLESS,
            view: view(0.4, 0.0, -30.0, (46.0, 24.0)),
        },
        Scene {
            name: "near",
            blades: None,
            shadows: false,
            field: Field::ENDLESS,
            view: view(0.30, 20.0, -38.0, (46.0, 34.0)),
        },
        Scene {
            name: "shadows",
            blades: None,
            shadows: true,
            field: Field::ENDLESS,
            view: view(0.30, 20.0, -38.0, (46.0, 34.0)),
        },
        Scene {
            name: "above",
            blades: None,
            shadows: false,
            field: Field::ENDLESS,
            view: view(0.65, 0.0, -88.0, (120.0, 55.0)),
        },
        Scene {
            name: "against-sun",
            blades: Some(&[0, 4]),
            shadows: false,
            field: Field::ENDLESS,
            view: view(0.30, 50.0, -28.0, (50.0, 14.0)),
        },
        // A field small enough to see its end: every level of detail, and the ground beyond.
        Scene {
            name: "levels",
            blades: None,
            shadows: false,
            field: Field::of_tiles(1600),
            view: from_the_edge(),
        },
    ]
}

fn from_the_edge() -> View {
    let foot = Field::of_tiles(1600).edge();
    let camera = Camera { foot, eye_height_m: 0.9, heading_rad: 0.0, pitch_rad: -0.17, fov_y_rad: 0.7 };
    View { camera, ..view(0.0, 0.0, 0.0, (46.0, 24.0)) }
}

fn or_skip(opened: Result<Studio, OpenError>) -> Option<Studio> {
    match opened {
        Ok(studio) => Some(studio),
        Err(error) if std::env::var_os("SWARD_REQUIRE_GPU").is_some_and(|value| value == "1") => {
            panic!("{error}")
        }
        Err(_) => {
            say("skipped: no Vulkan device");
            None
        }
    }
}

/// Not by a macro, whose output the test harness would hide.
fn say(line: &str) {
    writeln!(std::io::stderr(), "{line}").expect("stderr is there");
}

fn draw(studio: &mut Studio, scene: &Scene) -> RgbImage {
    let bytes = scene.blades.map_or_else(|| common::meadow(1), |which| common::library(1, which));
    studio.garden().set_shadows(scene.shadows);
    studio.garden().lay_out(scene.field, Detail::default());
    studio.plant(&Snapshot::validate(bytes).expect("a valid library"));
    let pixels = studio.draw(&scene.view).expect("a picture");
    let rgb = pixels.chunks_exact(4).flat_map(|pixel| &pixel[..3]).copied().collect();
    RgbImage::from_raw(SIZE.0, SIZE.1, rgb).expect("a whole picture")
}

/// Mean FLIP between two pictures, and its map in false colours.
fn compare(expected: &RgbImage, actual: &RgbImage) -> (f32, RgbImage) {
    let flip_image =
        |picture: &RgbImage| FlipImageRgb8::with_data(picture.width(), picture.height(), picture);
    let map = nv_flip::flip(flip_image(expected), flip_image(actual), nv_flip::DEFAULT_PIXELS_PER_DEGREE);
    let colours = map.apply_color_lut(&nv_flip::magma_lut());
    let colours = RgbImage::from_raw(colours.width(), colours.height(), colours.to_vec());
    (FlipPool::from_image(&map).mean(), colours.expect("a whole picture"))
}

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name).with_extension("png")
}

#[test]
fn scenes_look_as_they_did() {
    let Some(mut studio) = or_skip(Studio::open(SIZE)) else { return };
    let adapter = studio.adapter();
    let bound = if adapter.contains("llvmpipe") { SAME_DRIVER } else { OTHER_DRIVER };
    let update = std::env::var_os("UPDATE_GOLDEN").is_some_and(|value| value == "1");
    let left = Path::new(env!("CARGO_TARGET_TMPDIR")).join("golden");
    std::fs::create_dir_all(&left).expect("the target folder is writable");
    let mut failures = Vec::new();
    for scene in scenes() {
        let actual = draw(&mut studio, &scene);
        let path = golden(scene.name);
        if update {
            actual.save(&path).expect("the golden can be written");
            continue;
        }
        let expected = image::open(&path)
            .unwrap_or_else(|error| panic!("{}: {error}; make it with: make goldens", path.display()))
            .into_rgb8();
        let (difference, map) = compare(&expected, &actual);
        say(&format!("{}: FLIP {difference:.4} on {adapter}", scene.name));
        // Turned round, a number that is none would pass.
        if !matches!(difference.partial_cmp(&bound), Some(std::cmp::Ordering::Less)) {
            for (kind, picture) in [("actual", &actual), ("expected", &expected), ("difference", &map)] {
                let path = left.join(format!("{}.{kind}.png", scene.name));
                picture.save(path).expect("the target folder is writable");
            }
            failures.push(format!("{} is off by FLIP {difference:.4}, at most {bound}", scene.name));
        }
    }
    assert!(failures.is_empty(), "on {adapter}: {}; see {}", failures.join("; "), left.display());
}

#[test]
fn a_second_driver_sees_the_same() {
    let places = ["/usr/lib/chromium", "/usr/lib/chromium-browser", "/opt/google/chrome"];
    let driver = std::env::var_os("SWARD_SWIFTSHADER").map(PathBuf::from).or_else(|| {
        places.iter().map(|place| Path::new(place).join("vk_swiftshader_icd.json")).find(|path| path.exists())
    });
    let Some(driver) = driver else { return say("skipped: no SwiftShader") };
    let test = std::env::current_exe().expect("a test has a path");
    let status = Command::new(test)
        .args(["--exact", "scenes_look_as_they_did"])
        .env("VK_ICD_FILENAMES", &driver)
        .env("VK_DRIVER_FILES", &driver)
        .env_remove("UPDATE_GOLDEN")
        .status()
        .expect("the test runs");
    assert!(status.success(), "with {}", driver.display());
}

#[test]
fn every_number_is_one() {
    let Some(mut studio) = or_skip(Studio::open(SIZE)) else { return };
    for mut scene in scenes() {
        for sun_elevation_deg in [1.0, 90.0] {
            scene.view.sun_rad.y = f32::to_radians(sun_elevation_deg);
            draw(&mut studio, &scene);
            let light = studio.scene_light().expect("scene light");
            assert_eq!(light.len(), (4 * SIZE.0 * SIZE.1) as usize);
            // A half float whose exponent is all ones is infinite or none.
            let none = light.iter().filter(|bits| **bits & 0x7C00 == 0x7C00).count();
            assert_eq!(none, 0, "{} with the sun at {sun_elevation_deg} degrees", scene.name);
        }
    }
}

#[test]
fn the_measure_sees_what_an_eye_sees() {
    let Some(mut studio) = or_skip(Studio::open(SIZE)) else { return };
    let scenes = scenes();
    let (near, above) = (draw(&mut studio, &scenes[2]), draw(&mut studio, &scenes[4]));
    assert_eq!(compare(&near, &near).0, 0.0);
    assert!(compare(&near, &above).0 > OTHER_DRIVER);
    let brighter = RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let pixel = near.get_pixel(x, y).0;
        image::Rgb(pixel.map(|value| value.saturating_add(8)))
    });
    assert!(compare(&near, &brighter).0 > SAME_DRIVER, "a picture brighter by 3 % is another");
}
