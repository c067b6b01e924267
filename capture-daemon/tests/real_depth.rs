//! What do the stages make of real plants? Skipped where `../shared/data` is absent.

use std::path::{Path, PathBuf};

use capture_daemon::config;
use capture_daemon::frame::CameraModel;
use capture_daemon::recording::{self, OpenOptions};
use capture_daemon::session::{Capture, Session};
use capture_daemon::stages::blade::CapturedBlade;
use capture_daemon::stages::mask::Mask;
use glam::DVec2;
use serde_json::Value;

/// The folder of real depth, if it is there.
fn data() -> Option<PathBuf> {
    let repository = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let shared = std::env::var_os("SWARD_SHARED").map_or(repository.join("../shared"), Into::into);
    let data = shared.join("data");
    if !data.exists() {
        eprintln!("skipped: there is no {}", data.display());
        return None;
    }
    Some(data)
}

/// The captures of one PNG of a folder, under these settings.
fn captures(folder: &Path, png: &str, sets: &[&str]) -> Vec<(Capture, CameraModel)> {
    let alone = tempfile::tempdir().expect("a temporary folder");
    for file in [png, "camera.toml"] {
        std::fs::copy(folder.join(file), alone.path().join(file)).expect("it can be copied");
    }
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    let config = config::load(None, &sets).expect("valid settings");
    let mut source = recording::open(alone.path(), &OpenOptions::default()).expect("a recording");
    let mut session = Session::new(config.session_params());
    let mut captures = Vec::new();
    while let Ok(frame) = source.next_frame() {
        captures.extend(session.push(&frame).map(|capture| (capture, frame.camera)));
    }
    captures
}

const SORGHUM_VIEWS: [&str; 7] = [
    "DepthImage_21600208944_0.png",
    "DepthImage_21660538681_2.png",
    "DepthImage_21690878844_3.png",
    "DepthImage_21721208930_4.png",
    "DepthImage_21811878836_7.png",
    "DepthImage_21872538140_9.png",
    "DepthImage_21932878750_11.png",
];

const SORGHUM: [&str; 4] =
    ["mask.near_m=0.6", "mask.far_m=1.25", "mask.roi=[60,90,380,325]", "capture.hold_s=0"];

#[test]
fn the_leaves_of_a_sorghum_are_found_by_their_tips() {
    let Some(data) = data() else { return };
    let folder = data.join("sorghum_kinect2");
    let marked = std::fs::read_to_string(folder.join("tips.json")).expect("marked tips");
    let marked: Value = serde_json::from_str(&marked).expect("JSON");
    for view in ["0", "7", "11"] {
        let view_marks = &marked["views"][view];
        let captures = captures(&folder, view_marks["file"].as_str().expect("a name"), &SORGHUM);
        let [(capture, camera)] = captures.as_slice() else { panic!("{} captures", captures.len()) };
        let mut tips: Vec<(f64, f64)> = capture
            .steps
            .blades
            .iter()
            .filter_map(|blade| blade.knots_in_camera.last())
            .map(|tip| camera.project(tip.position))
            .collect();
        let number = |value: &Value| value.as_f64().expect("a number");
        let close = |tip: &(f64, f64), mark: &Value| {
            (tip.0 - number(&mark[0])).hypot(tip.1 - number(&mark[1])) < 12.0
        };
        let mut found = 0;
        for marks in view_marks["tips"].as_array().expect("tips") {
            let marks = marks.as_array().expect("alternatives");
            if let Some(index) = tips.iter().position(|tip| marks.iter().any(|mark| close(tip, mark))) {
                tips.swap_remove(index);
                found += 1;
            }
        }
        let optional = view_marks["optional"].as_array().expect("a list");
        tips.retain(|tip| !optional.iter().any(|mark| close(tip, mark)));
        println!("view {view}: {found} of 8 tips, false {tips:?}");
        assert!(found >= 7 && tips.len() <= 1, "view {view}: {found} of 8 tips, false {tips:?}");
    }
}

#[test]
fn a_sorghum_has_its_leaves_from_every_side() {
    /// A view's file, its fewest and most blades, and where its stem is at rows 230 and 320, if it is not
    /// hidden behind a leaf.
    type View = (&'static str, std::ops::RangeInclusive<usize>, Option<[f64; 2]>);
    let Some(data) = data() else { return };
    // Leaves counted by eye on enlarged depth: 8, 6, 7, 8, 9, 7 and 8. Of those that lie behind others
    // or point at the camera some are missed, and in view 3, from the plant's edge, nearly half.
    let views: [View; 7] = [
        ("DepthImage_21600208944_0.png", 7..=9, Some([227.0, 226.0])),
        ("DepthImage_21660538681_2.png", 5..=7, Some([214.0, 221.0])),
        ("DepthImage_21690878844_3.png", 4..=7, None),
        ("DepthImage_21721208930_4.png", 7..=9, Some([218.0, 226.0])),
        ("DepthImage_21811878836_7.png", 8..=10, Some([240.0, 239.0])),
        ("DepthImage_21872538140_9.png", 5..=8, Some([238.0, 240.0])),
        ("DepthImage_21932878750_11.png", 7..=9, Some([227.0, 225.0])),
    ];
    for (png, count, stem) in views {
        let captures = captures(&data.join("sorghum_kinect2"), png, &SORGHUM);
        let [(capture, camera)] = captures.as_slice() else { panic!("{} captures", captures.len()) };
        let blades = &capture.steps.blades;
        assert!(count.contains(&blades.len()), "{png}: {} blades", blades.len());
        let Some([upper, lower]) = stem else { continue };
        let roots: Vec<(f64, f64)> =
            blades.iter().map(|blade| camera.project(blade.knots_in_camera[0].position)).collect();
        let off = |(x, y): &(f64, f64)| (x - (upper + (lower - upper) * (y - 230.0) / 90.0)).abs() > 9.0;
        let off: Vec<_> = roots.iter().filter(|root| off(root)).collect();
        println!("{png}: {} blades, off the stem {off:?}", blades.len());
        assert!(off.len() <= 1, "{png}: roots off the stem: {off:?}");
    }
}

/// How far a midrib is from the middle of what is seen there of its leaf, over half of that width, at places along
/// it where both edges are seen in the readings: told from them alone, by their steps in depth.
fn off_middle(mask: &Mask, camera: &CameraModel, blade: &CapturedBlade) -> Vec<f64> {
    const STEP_M: f32 = 0.012;
    const FARTHEST_PX: f64 = 40.0;
    let knots = &blade.knots_in_camera;
    let pixels: Vec<DVec2> = knots.iter().map(|knot| DVec2::from(camera.project(knot.position))).collect();
    let [x0, y0, x1, y1] = mask.region;
    let at = |point: DVec2| {
        let (x, y) = (point.x.round() as usize, point.y.round() as usize);
        let inside = (x0..x1).contains(&x) && (y0..y1).contains(&y);
        inside.then(|| mask.depth_m[y * mask.width + x])
    };
    let reach = |from: DVec2, way: DVec2| {
        let (mut before, mut px) = (at(from).filter(|depth_m| *depth_m > 0.0)?, 0.0);
        while px < FARTHEST_PX {
            // Beyond the border of the region nothing is known.
            let depth_m = at(from + way * (px + 0.5))?;
            if depth_m <= 0.0 || (depth_m - before).abs() > STEP_M {
                return Some(px);
            }
            (before, px) = (depth_m, px + 0.5);
        }
        None
    };
    let mut off = Vec::new();
    for pair in pixels.windows(2) {
        let aside = (pair[1] - pair[0]).normalize_or_zero().perp();
        for k in 0..8 {
            let from = pair[0].lerp(pair[1], f64::from(k) / 8.0);
            if let (Some(left), Some(right)) = (reach(from, -aside), reach(from, aside)) {
                off.push((right - left).abs() / (left + right + 1.0));
            }
        }
    }
    off
}

#[test]
fn midribs_run_along_the_middle_of_their_leaves() {
    let Some(data) = data() else { return };
    for png in SORGHUM_VIEWS {
        let captures = captures(&data.join("sorghum_kinect2"), png, &SORGHUM);
        let [(capture, camera)] = captures.as_slice() else { panic!("{} captures", captures.len()) };
        let mask = &capture.steps.mask;
        let (mut off, mut on_plant, mut knots) = (Vec::new(), 0, 0);
        for blade in &capture.steps.blades {
            off.extend(off_middle(mask, camera, blade));
            for knot in &blade.knots_in_camera {
                let (x, y) = camera.project(knot.position);
                let index = mask.index_at(DVec2::new(x, y).as_vec2());
                on_plant += usize::from(index.is_some_and(|index| mask.occupancy[index] > 0.0));
                knots += 1;
            }
        }
        off.sort_by(f64::total_cmp);
        let (median, most) = (off[off.len() / 2], off[off.len() * 9 / 10]);
        let share = on_plant as f64 / knots as f64;
        println!("{png}: off the middle {median:.2}, a tenth more than {most:.2}; {share:.2} on the plant");
        assert!(median < 0.25 && most < 0.85, "{png}: off the middle {median:.2}, a tenth {most:.2}");
        assert!(share > 0.85, "{png}: {share:.2} of the knots are on the plant");
    }
}

#[test]
fn leaves_that_leave_the_region_are_followed_to_its_border() {
    let Some(data) = data() else { return };
    // The middle between both edges in the last row of the region, from the readings.
    let ends: [(&str, &[f64]); 4] = [
        ("DepthImage_21660538681_2.png", &[291.5, 333.0]),
        ("DepthImage_21690878844_3.png", &[231.5]),
        ("DepthImage_21721208930_4.png", &[135.5, 181.5]),
        ("DepthImage_21872538140_9.png", &[173.0]),
    ];
    for (png, ends) in ends {
        let captures = captures(&data.join("sorghum_kinect2"), png, &SORGHUM);
        let [(capture, camera)] = captures.as_slice() else { panic!("{} captures", captures.len()) };
        let tips: Vec<(f64, f64)> = capture
            .steps
            .blades
            .iter()
            .map(|blade| camera.project(blade.knots_in_camera[blade.knots_in_camera.len() - 1].position))
            .collect();
        for end in ends {
            let is_there = |(x, y): &(f64, f64)| (x - end).abs() < 5.0 && *y > 315.0;
            assert!(tips.iter().any(is_there), "{png}: no tip at {end}: {tips:?}");
        }
    }
}

#[test]
fn ragged_crops_give_few_blades() {
    let Some(data) = data() else { return };
    for (folder, far_m, most) in [
        ("pepper_realsense", "0.6", 2),
        ("pepper_realsense", "0.9", 3),
        ("pepper_realsense", "1.5", 7),
        ("pepper_realsense", "3.0", 7),
        ("kiwi_d4xx", "0.6", 1),
        ("kiwi_d4xx", "0.9", 3),
        ("kiwi_d4xx", "1.5", 3),
        ("kiwi_d4xx", "3.0", 3),
    ] {
        let far = format!("mask.far_m={far_m}");
        for (capture, _) in captures(&data.join(folder), "depth_image.png", &[&far, "capture.hold_s=0"]) {
            let (blades, refused) = (&capture.steps.blades, &capture.steps.refused);
            println!("{folder} to {far_m} m: {} blades, {} refused", blades.len(), refused.len());
            assert!(blades.len() <= most, "{folder} to {far_m} m: {} blades", blades.len());
            assert!(blades.len() * 5 < refused.len() + 5, "{folder} to {far_m} m: most are refused");
        }
    }
}

#[test]
fn lettuces_two_metres_away_give_no_blade() {
    let Some(data) = data() else { return };
    let folder = data.join("lettuce_d435");
    let sets = ["mask.near_m=1.6", "mask.far_m=2.4", "capture.hold_s=0"];
    for png in ["depthimg_2024-03-13_14_17_28.png", "depthimg_2024-03-24_14_18_55.png"] {
        for (capture, _) in captures(&folder, png, &sets) {
            assert_eq!(capture.steps.blades.len(), 0, "{png}");
        }
    }
}

#[test]
fn a_leaf_that_comes_towards_the_camera_is_followed_from_its_stem_to_its_tip() {
    let Some(data) = data() else { return };
    let captures = captures(&data.join("sorghum_kinect2"), "DepthImage_21690878844_3.png", &SORGHUM);
    let [(capture, camera)] = captures.as_slice() else { panic!("{} captures", captures.len()) };
    // Both ends by eye on enlarged depth.
    let (root, tip) = ((210.0, 259.0), (229.0, 168.0));
    let near = |(x, y): (f64, f64), (u, v): (f64, f64)| (x - u).hypot(y - v) < 12.0;
    let ends = |blade: &CapturedBlade| {
        [0, blade.knots_in_camera.len() - 1].map(|i| camera.project(blade.knots_in_camera[i].position))
    };
    let found = capture.steps.blades.iter().map(ends).any(|[from, to]| near(from, root) && near(to, tip));
    assert!(found, "{:?}", capture.steps.blades.iter().map(ends).collect::<Vec<_>>());
}

/// A view's file, and where a leaf has its root and its tip there, by eye on enlarged depth.
type Leaf = (&'static str, (f64, f64), (f64, f64));

/// The leaves without a midrib from the one to the other.
fn without_midrib(data: &Path, leaves: &[Leaf]) -> Vec<Leaf> {
    let has_midrib = |(png, root, tip): &Leaf| {
        let captures = captures(&data.join("sorghum_kinect2"), png, &SORGHUM);
        let [(capture, _)] = captures.as_slice() else { panic!("{} captures", captures.len()) };
        let near = |at: glam::Vec2, (x, y): (f64, f64)| at.as_dvec2().distance(DVec2::new(x, y)) < 12.0;
        capture.steps.skeletons.iter().any(|skeleton| {
            let ends = [0, skeleton.stations.len() - 1].map(|i| skeleton.stations[i].mid);
            near(ends[0], *root) && near(ends[1], *tip)
        })
    };
    leaves.iter().copied().filter(|leaf| !has_midrib(leaf)).collect()
}

#[test]
fn leaves_before_and_behind_others_have_midribs_from_the_stem_on() {
    let Some(data) = data() else { return };
    // A leaf that falls out of the region towards the camera, two of which one edge is hidden all along by a leaf
    // before them, and one whose base is hidden.
    let missing = without_midrib(
        &data,
        &[
            ("DepthImage_21690878844_3.png", (213.0, 265.0), (235.0, 322.0)),
            ("DepthImage_21690878844_3.png", (218.0, 262.0), (228.0, 199.0)),
            ("DepthImage_21690878844_3.png", (214.0, 262.0), (234.0, 135.0)),
            ("DepthImage_21872538140_9.png", (241.0, 262.0), (239.0, 128.0)),
        ],
    );
    assert!(missing.is_empty(), "no midribs: {missing:?}");
}

#[test]
fn leaves_go_on_where_they_are_too_thin_or_too_steep_for_a_reading() {
    let Some(data) = data() else { return };
    // Tips that are parted from their leaves by pixels without readings; one that hangs down behind its own leaf; one
    // that hangs over beyond the window; and one whose lower half is hidden behind another leaf.
    let missing = without_midrib(
        &data,
        &[
            ("DepthImage_21600208944_0.png", (228.0, 295.0), (312.0, 296.0)),
            ("DepthImage_21600208944_0.png", (223.0, 303.0), (143.0, 325.0)),
            ("DepthImage_21932878750_11.png", (228.0, 295.0), (312.0, 296.0)),
            ("DepthImage_21660538681_2.png", (216.0, 296.0), (159.0, 291.0)),
            ("DepthImage_21660538681_2.png", (220.0, 276.0), (172.0, 240.0)),
            ("DepthImage_21721208930_4.png", (222.0, 262.0), (283.0, 211.0)),
            ("DepthImage_21872538140_9.png", (247.0, 303.0), (269.0, 303.0)),
            ("DepthImage_21872538140_9.png", (240.0, 263.0), (132.0, 238.0)),
            ("DepthImage_21690878844_3.png", (212.0, 262.0), (201.0, 157.0)),
            ("DepthImage_21690878844_3.png", (212.0, 262.0), (231.0, 167.0)),
        ],
    );
    assert!(missing.is_empty(), "no midribs: {missing:?}");
}
