//! The synthetic sensor: is its truth true, and is it the same everywhere?

use std::path::Path;
use std::process::Command;

use capture_daemon::config::Config;
use capture_daemon::frame::DepthFrame;
use capture_daemon::recording::{self, McapWriter, OpenOptions, RecordingParams};
use capture_daemon::source::synthetic::SyntheticSource;
use capture_daemon::source::{FrameSource, SourceError};
use capture_daemon::synth::{self, Clip, ClipParams, FAMILIES, Family, Format, Scene, Truth, TruthVisit};

fn clip(family: Family, seed: u64, params: ClipParams) -> Clip {
    Clip::new(Scene::new(family, seed), params).expect("the parameters are in range")
}

/// Depth of the nearest pixel, metres.
fn depth_at(frame: &DepthFrame, (u, v): (f64, f64)) -> Option<f64> {
    frame.depth_m(u.round() as usize, v.round() as usize)
}

/// A frame that shows each blade of a clip as its truth has it: the first, or the first of its hold.
fn frame_of_blade(truth: &Truth, blade: usize) -> usize {
    let mine = |visit: &&TruthVisit| (visit.blades[0]..visit.blades[1]).contains(&blade);
    truth.visits.iter().find(mine).map_or(truth.visible_frames[0], |visit| visit.held_frames[0])
}

fn check_truth_against_picture(clip: &Clip) {
    let (family, seed, truth) = (clip.scene().family, clip.scene().seed, Truth::of(clip));
    let alone = truth.blades.len() == 1 && truth.visits.is_empty();
    let mut shown = None;
    for (index, blade) in truth.blades.iter().enumerate() {
        let at = frame_of_blade(&truth, index);
        let (_, frame) = shown.take().filter(|(of, _)| *of == at).unwrap_or_else(|| (at, clip.frame(at)));
        let mut hidden = 0;
        // The root is the end of the ribbon: the nearest pixel centre may lie beyond.
        for knot in &blade.knots[1..] {
            let half_width_m = knot.half_width_m[0].min(knot.half_width_m[1]);
            let half_width_px = frame.camera.fx * half_width_m / knot.camera_m[2];
            // Where the blade is thinner than the distance to the next pixel centre, the picture may
            // show the wall.
            if half_width_px < 1.0 {
                continue;
            }
            let point = glam::DVec3::from_array(knot.camera_m);
            let seen = depth_at(&frame, frame.camera.project(point.as_vec3()));
            let error = seen.expect("a clean picture has no holes") - point.z;
            // What is more than that before it is another blade.
            if error < -0.002 && !alone {
                hidden += 1;
                continue;
            }
            assert!(error.abs() < 0.002, "{family:?} {seed}: {error} m at {point}");
        }
        // 35 % of the midrib, and what the nearest pixel makes of it.
        assert!(hidden <= 25, "{family:?} {seed}: {hidden} of 64 knots are hidden");
        shown = Some((at, frame));
    }
}

#[test]
fn the_truth_lies_in_the_picture() {
    for family in FAMILIES {
        for seed in 0..if family == Family::Kiosk { 2 } else { 8 } {
            let scene = Scene::new(family, seed);
            let params = ClipParams { noise: 0.0, frames: scene.frames(), ..ClipParams::default() };
            check_truth_against_picture(&Clip::new(scene, params).expect("in range"));
        }
    }
}

#[test]
fn other_sizes_show_the_same_scene() {
    for (width, height) in [(512, 424), (1280, 720)] {
        for family in [Family::Fan, Family::Held] {
            let params = ClipParams { width, height, noise: 0.0, frames: 60, fps: 30.0 };
            let clip = clip(family, 2, params);
            check_truth_against_picture(&clip);
            let small = Clip::new(Scene::new(family, 2), ClipParams { frames: 60, ..ClipParams::default() });
            assert_eq!(Truth::of(&clip).blades, Truth::of(&small.expect("in range")).blades);
        }
    }
}

/// The midrib of an asymmetric blade is a crease: the nearest of its cross-section, or the farthest.
#[test]
fn the_midrib_of_an_asymmetric_blade_can_be_seen() {
    for seed in 0..10 {
        let scene = Scene::new(Family::Asymmetric, seed);
        let blade = &scene.blades[0];
        let section = &blade.sections[blade.sections.len() / 3];
        let ratio = section.half_width_left / section.half_width_right;
        assert!((1.19..=2.01).contains(&ratio.max(1.0 / ratio)), "seed {seed}: {ratio}");
        let chord = section.left().lerp(section.right(), 1.0 / (1.0 + 1.0 / ratio));
        let behind = (chord - section.center).z;
        assert!(behind * blade.fold > 0.0, "seed {seed}: {behind} m behind at a fold of {}", blade.fold);
        assert!(behind.abs() > 0.0004, "seed {seed}: {behind} m");
    }
}

/// Pixels that are nearer than the wall.
fn near_pixels(frame: &DepthFrame) -> usize {
    frame.depth.iter().filter(|&&count| (1..1200).contains(&count)).count()
}

#[test]
fn a_hand_comes_in_and_leaves_and_its_forearm_reaches_the_border() {
    for (family, seed) in [(Family::Held, 1), (Family::Held, 4), (Family::Hand, 3), (Family::Hand, 5)] {
        let clip = clip(family, seed, ClipParams { noise: 0.0, frames: 60, ..ClipParams::default() });
        let visit = clip.visits().remove(0);
        assert!(visit.held.len() >= 24);
        for outside in [visit.visible.start - 1, visit.visible.end] {
            assert_eq!(near_pixels(&clip.frame(outside)), 0, "{family:?} {seed}");
        }
        for inside in [visit.held.start, visit.held.end - 1] {
            let frame = clip.frame(inside);
            assert!(near_pixels(&frame) > 8_000, "{family:?} {seed}");
            // 5 cm of forearm are 40 pixels and more.
            let near = |x: usize, y: usize| frame.depth[y * frame.width + x] < 1200;
            let bottom = (0..frame.width).filter(|&x| near(x, frame.height - 1)).count();
            let sides: usize =
                [0, frame.width - 1].map(|x| (0..frame.height).filter(|&y| near(x, y)).count()).iter().sum();
            assert!(bottom + sides > 40, "{family:?} {seed}: {bottom} {sides}");
            assert!((0..frame.width).all(|x| !near(x, 0)), "{family:?} {seed}");
        }
        assert_eq!(Truth::of(&clip).blades.is_empty(), family == Family::Hand);
    }
}

#[test]
fn an_empty_scene_shows_nothing() {
    let clip = clip(Family::Empty, 1, ClipParams { noise: 0.0, frames: 4, ..ClipParams::default() });
    assert!(clip.frames().all(|frame| near_pixels(&frame) == 0));
    assert_eq!(Truth::of(&clip).visible_frames, [0, 0]);
}

#[test]
fn visitors_of_a_kiosk_come_one_after_the_other() {
    for seed in 0..4 {
        let scene = Scene::new(Family::Kiosk, seed);
        let params = ClipParams { frames: scene.frames(), ..ClipParams::default() };
        let truth = Truth::of(&Clip::new(scene, params).expect("in range"));
        assert!((3..=5).contains(&truth.visits.len()));
        assert_eq!(truth.visits[0].blades[0], 0);
        assert_eq!(truth.visits[truth.visits.len() - 1].blades[1], truth.blades.len());
        for pair in truth.visits.windows(2) {
            assert!(pair[1].visible_frames[0] >= pair[0].visible_frames[1] + 15);
            assert_eq!(pair[1].blades[0], pair[0].blades[1]);
        }
        for visit in &truth.visits {
            let [start, end] = visit.held_frames;
            assert!(end - start >= 24 && visit.blades[1] > visit.blades[0]);
            assert_eq!(visit.poses.len(), visit.visible_frames[1] - visit.visible_frames[0]);
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
    let held: Vec<DepthFrame> = clip(Family::Held, 7, params).frames().collect();
    for index in [30, 20, 14, 9] {
        assert_eq!(clip(Family::Held, 7, params).frame(index), held[index]);
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
    assert_eq!(hash_of(&[Family::Held, Family::Hand, Family::Empty, Family::Kiosk]), "669e81b31c570b86");
    assert_eq!(hash_of(&[Family::Twisted, Family::Asymmetric]), "263a34505079877a");
}

/// Of four frames of a clip of each family.
fn hash_of(families: &[Family]) -> String {
    let mut hasher = blake3::Hasher::new();
    for &family in families {
        let scene = Scene::new(family, 1);
        let frames = if scene.visits.is_empty() { 45 } else { scene.frames() };
        let params = ClipParams { width: 320, height: 240, frames, ..ClipParams::default() };
        let clip = Clip::new(scene, params).expect("in range");
        let first = clip.visits().first().map_or(6, |visit| visit.held.start - 1);
        for frame in clip.frames().skip(first).take(4) {
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
    let mut bytes = 0;
    for entry in std::fs::read_dir(shipped()).expect("readable") {
        let entry = entry.expect("readable");
        bytes += entry.metadata().expect("readable").len();
        let name = entry.file_name().into_string().expect("UTF-8");
        let needs_none = ["SHA256SUMS", "README.md"].contains(&name.as_str());
        assert!(needs_none || sums.contains(&name), "{name} has no checksum");
    }
    assert!(bytes < 12_000_000, "{bytes} bytes");
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
    assert!(seen >= 10, "{seen} recordings");
}

#[test]
fn both_forms_of_a_clip_share_its_truth_and_another_clip_does_not_take_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let of =
        |noise| clip(Family::Single, 1, ClipParams { width: 48, height: 36, frames: 4, noise, fps: 30.0 });
    let write = |noise, format| synth::write(folder.path(), &of(noise), format, 0);
    let truth = || std::fs::read_to_string(folder.path().join("single-1.truth.json")).expect("a truth");
    write(1.0, Format::Mcap).expect("written");
    let before = truth();
    write(1.0, Format::Png).expect("the same clip");
    assert_eq!(truth(), before);
    // Neither may leave the other without its truth.
    for format in [Format::Mcap, Format::Png] {
        let refused = write(0.0, format).expect_err("another clip").to_string();
        assert!(refused.contains("single-1.truth.json") && refused.contains("another --out"), "{refused}");
    }
    assert_eq!(truth(), before);
    std::fs::remove_dir_all(folder.path().join("single-1")).expect("there");
    write(0.0, Format::Mcap).expect("nobody else has that truth");
    assert_ne!(truth(), before);
}

/// What `make recordings` makes is what lies there.
#[test]
fn shipped_recordings_are_those_of_the_command_that_makes_them() {
    let script = std::fs::read_to_string(shipped().join("../.ci/recordings")).expect("readable");
    let mut made = std::collections::BTreeSet::new();
    for line in script.lines().filter_map(|line| line.strip_prefix("make_one ")) {
        let mut words = line.split_whitespace();
        let mut word = || words.next().expect("family, seed, frames");
        let (name, frames) = (format!("{}-{}", word(), word()), word());
        let truth = std::fs::read_to_string(shipped().join(format!("{name}.truth.json"))).expect("readable");
        let truth: Truth = serde_json::from_str(&truth).expect("a truth");
        assert_eq!(truth.frames.to_string(), frames, "{name}");
        assert_eq!(truth.noise, if line.contains("--noise 0") { 0.0 } else { 1.0 }, "{name}");
        made.insert(format!("{name}.mcap"));
    }
    let entries = std::fs::read_dir(shipped()).expect("readable");
    let names = entries.map(|entry| entry.expect("readable").file_name().into_string().expect("UTF-8"));
    assert_eq!(names.filter(|name| name.ends_with(".mcap")).collect::<std::collections::BTreeSet<_>>(), made);
}

/// One of them, as its own metadata say: the configuration that is the default may be another by now.
#[test]
fn a_shipped_recording_is_made_again_bit_for_bit() {
    let path = shipped().join("single-5.mcap");
    let info = recording::info(&path, &OpenOptions::default()).expect("a recording");
    let entry = |key: &str| info.metadata["sward"][key].clone();
    let config: Config =
        toml::from_str(&entry("config")).expect("a configuration; `make recordings` mends it");
    assert_eq!(config.refine.knots, 16);
    let (sensor, serial) = (entry("sensor"), entry("serial"));
    let params =
        RecordingParams { sensor, serial, config: entry("config"), compression_level: 19, is_live: false };
    let clip = clip(Family::Single, 5, ClipParams { noise: 0.0, frames: 24, ..ClipParams::default() });
    let mut writer = McapWriter::new(std::io::Cursor::new(Vec::new()), params).expect("in memory");
    clip.frames().for_each(|frame| writer.write(&frame).expect("in memory"));
    let made = writer.finish().expect("in memory").into_inner();
    assert!(made == std::fs::read(&path).expect("readable"), "{} bytes are others", made.len());
}
