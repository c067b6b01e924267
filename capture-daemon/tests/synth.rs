//! The synthetic sensor: is its truth true, and is it the same everywhere?

use std::path::Path;
use std::process::Command;

use capture_daemon::frame::DepthFrame;
use capture_daemon::recording::{self, OpenOptions};
use capture_daemon::source::synthetic::SyntheticSource;
use capture_daemon::source::{FrameSource, SourceError};
use capture_daemon::synth::{Clip, ClipParams, FAMILIES, Family, Scene, Truth};

fn clip(family: Family, seed: u64, params: ClipParams) -> Clip {
    Clip::new(Scene::new(family, seed), params).expect("the parameters are in range")
}

/// Depth of the nearest pixel, metres.
fn depth_at(frame: &DepthFrame, (u, v): (f64, f64)) -> Option<f64> {
    frame.depth_m(u.round() as usize, v.round() as usize)
}

#[test]
fn the_truth_lies_in_the_picture() {
    for family in FAMILIES {
        for seed in 0..8 {
            let clip = clip(family, seed, ClipParams { noise: 0.0, ..ClipParams::default() });
            let frame = clip.frame(clip.visible().start);
            for blade in Truth::of(&clip).blades {
                let mut hidden = 0;
                // The root is the end of the ribbon: the nearest pixel centre may lie beyond.
                for knot in &blade.knots[1..] {
                    let half_width_px = frame.camera.fx * knot.half_width_m[0] / knot.camera_m[2];
                    // Where the blade is thinner than the distance to the next pixel centre, the
                    // picture may show the wall.
                    if half_width_px < 1.0 {
                        continue;
                    }
                    let point = glam::DVec3::from_array(knot.camera_m);
                    let seen = depth_at(&frame, frame.camera.project(point.as_vec3()));
                    let error = seen.expect("a clean picture has no holes") - point.z;
                    // What is more than that before it is another blade.
                    if error < -0.002 && clip.scene().blades.len() > 1 {
                        hidden += 1;
                        continue;
                    }
                    assert!(error.abs() < 0.002, "{family:?} {seed}: {error} m at {point}");
                }
                // 35 % of the midrib, and what its neighbouring pixel makes of it.
                assert!(hidden <= 25, "{family:?} {seed}: {hidden} of 64 knots are hidden");
            }
        }
    }
}

/// The part of the picture that a blade covers, as its outline says, against the pixels that show it.
#[test]
fn a_blade_covers_as_many_pixels_as_its_outline_encloses() {
    for seed in 0..10 {
        let clip = clip(Family::Single, seed, ClipParams { noise: 0.0, ..ClipParams::default() });
        let frame = clip.frame(clip.visible().start);
        let sections = &clip.scene().blades[0].sections;
        let left = sections.iter().map(|section| section.left());
        let outline = left.chain(sections.iter().rev().map(|section| section.right()));
        let outline: Vec<_> = outline.map(|point| frame.camera.project(point.as_vec3())).collect();
        let next = outline.iter().cycle().skip(1);
        let area = 0.5 * outline.iter().zip(next).map(|(a, b)| a.0 * b.1 - a.1 * b.0).sum::<f64>().abs();
        let pixels = frame.depth.iter().filter(|&&count| count < 1000).count() as f64;
        assert!((pixels / area - 1.0).abs() < 0.03, "seed {seed}: {pixels} of {area} px");
    }
}

#[test]
fn the_noise_leaves_the_blade_where_it_is() {
    let noisy = clip(Family::Single, 4, ClipParams::default());
    let clean = clip(Family::Single, 4, ClipParams { noise: 0.0, ..ClipParams::default() });
    let shown = clean.frame(clean.visible().start);
    let near: Vec<usize> = (0..shown.depth.len()).filter(|&i| shown.depth[i] < 1000).collect();
    let (mut sum, mut count) = (0.0, 0.0);
    for index in noisy.visible() {
        let frame = noisy.frame(index);
        for &i in near.iter().filter(|&&i| (1..1000).contains(&frame.depth[i])) {
            sum += f64::from(frame.depth[i]) - f64::from(shown.depth[i]);
            count += 1.0;
        }
    }
    assert!((sum / count).abs() < 0.1, "mean error {} mm", sum / count);
    // A shadow band lies to the left of it, and nowhere else.
    let frame = noisy.frame(noisy.visible().start);
    let unread = |offset: isize| {
        near.iter().filter(|&&i| frame.depth[i.wrapping_add_signed(offset)] == 0).count() as f64
            / near.len() as f64
    };
    assert!(unread(0) < 0.2 && unread(2) < 0.05, "{} {}", unread(0), unread(2));
}

#[test]
fn frames_are_the_same_in_any_order_and_differ_by_seed() {
    let params = ClipParams { width: 128, height: 96, ..ClipParams::default() };
    let one = clip(Family::Row, 7, params);
    let frames: Vec<DepthFrame> = one.frames().collect();
    assert_eq!(frames.len(), 45);
    assert_eq!(one.visible(), 5..42);
    for index in [44, 20, 0] {
        assert_eq!(clip(Family::Row, 7, params).frame(index), frames[index]);
    }
    assert_ne!(clip(Family::Row, 8, params).frame(20), frames[20]);
    let mut source = SyntheticSource::new(one);
    for frame in frames {
        assert_eq!(source.next_frame(), Ok(frame));
    }
    assert_eq!(source.next_frame(), Err(SourceError::End));
}

/// Known bits: another machine, compiler or level of optimisation makes the same frames.
#[test]
fn frames_are_these_bits_on_every_machine() {
    assert_eq!(hash_of(&[Family::Single, Family::Row]), "9043950ca84ad9de");
    assert_eq!(hash_of(&[Family::Toward, Family::Fan, Family::Crossing]), "a2ef773517027fac");
}

fn hash_of(families: &[Family]) -> String {
    let mut hasher = blake3::Hasher::new();
    for &family in families {
        let clip = clip(family, 1, ClipParams { width: 320, height: 240, ..ClipParams::default() });
        for frame in clip.frames().skip(6).take(4) {
            frame.depth.iter().for_each(|count| {
                hasher.update(&count.to_le_bytes());
            });
        }
    }
    hasher.finalize().to_hex()[..16].to_owned()
}

#[test]
fn parameters_out_of_range_are_named() {
    let check = |params: ClipParams, expected: &str| {
        let error = Clip::new(Scene::new(Family::Single, 1), params).err().expect("refused").to_string();
        assert!(error.contains(expected), "{error}");
    };
    let good = ClipParams::default();
    check(ClipParams { width: 1281, height: 1024, ..good }, "the size is 1281x1024");
    check(ClipParams { noise: f64::NAN, ..good }, "the noise is NaN; expected 0 to 10");
    check(ClipParams { frames: 0, ..good }, "the number of frames is 0");
}

fn shipped() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../recordings"))
}

#[test]
fn shipped_recordings_have_their_checksums() {
    let mut command = Command::new("sha256sum");
    command.args(["--check", "--strict", "--quiet", "SHA256SUMS"]).current_dir(shipped());
    let output = command.output().expect("sha256sum is there");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    let sums = std::fs::read_to_string(shipped().join("SHA256SUMS")).expect("readable");
    for entry in std::fs::read_dir(shipped()).expect("readable") {
        let name = entry.expect("readable").file_name().into_string().expect("UTF-8");
        let needs_none = ["SHA256SUMS", "README.md"].contains(&name.as_str());
        assert!(needs_none || sums.contains(&name), "{name} has no checksum");
    }
}

#[test]
fn shipped_recordings_are_what_their_truth_makes() {
    let mut seen = 0;
    for entry in std::fs::read_dir(shipped()).expect("readable") {
        let path = entry.expect("readable").path();
        if path.extension().is_none_or(|extension| extension != "mcap") {
            continue;
        }
        let truth = std::fs::read_to_string(path.with_extension("truth.json")).expect("a truth beside it");
        let truth: Truth = serde_json::from_str(&truth).expect("a truth");
        let ([width, height], noise, frames, fps) = (truth.size, truth.noise, truth.frames, truth.fps);
        let clip = clip(truth.family, truth.seed, ClipParams { width, height, noise, frames, fps });
        assert_eq!(Truth::of(&clip), truth, "{}", path.display());
        let mut source = recording::open(&path, &OpenOptions::default()).expect("a recording");
        for expected in clip.frames() {
            assert_eq!(source.next_frame(), Ok(expected), "{}", path.display());
        }
        assert_eq!(source.next_frame(), Err(SourceError::End));
        seen += 1;
    }
    assert!(seen >= 4, "{seen} recordings");
}
