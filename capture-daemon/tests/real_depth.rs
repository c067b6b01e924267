//! What do the stages make of real plants? Skipped where `../shared/data` is absent.

use std::path::{Path, PathBuf};

use capture_daemon::config;
use capture_daemon::recording::{self, OpenOptions};
use capture_daemon::session::{Capture, Session};
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
fn captures(folder: &Path, png: &str, sets: &[&str]) -> Vec<(Capture, capture_daemon::frame::CameraModel)> {
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

#[test]
fn the_leaves_of_a_sorghum_are_found_by_their_tips() {
    let Some(data) = data() else { return };
    let folder = data.join("sorghum_kinect2");
    let marked = std::fs::read_to_string(folder.join("tips.json")).expect("marked tips");
    let marked: Value = serde_json::from_str(&marked).expect("JSON");
    let sets = ["mask.near_m=0.6", "mask.far_m=1.25", "mask.roi=[60,90,380,325]", "capture.hold_s=0"];
    for view in ["0", "7", "11"] {
        let view_marks = &marked["views"][view];
        let captures = captures(&folder, view_marks["file"].as_str().expect("a name"), &sets);
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
