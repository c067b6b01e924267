//! What a mask takes in and leaves out.

use super::*;
use crate::frame::CameraModel;

/// A frame from rows of digits: each digit a depth in decimetres, `.` for no reading.
fn frame(rows: &[&str]) -> DepthFrame {
    let depth = rows.iter().flat_map(|row| row.bytes());
    DepthFrame {
        width: rows[0].len(),
        height: rows.len(),
        depth: depth.map(|b| if b == b'.' { 0 } else { u16::from(b - b'0') * 100 }).collect(),
        depth_unit_m: 0.001,
        timestamp_ns: 0,
        camera: CameraModel { fx: 100.0, fy: 100.0, cx: 0.0, cy: 0.0 },
    }
}

fn mask(rows: &[&str], min_area_px: usize, bridge_px: usize) -> Mask {
    let params = MaskParams { min_area_px, bridge_px, ..MaskParams::default() };
    let frame = frame(rows);
    let mut accumulation = Accumulation::like(&frame);
    accumulation.add(&frame, &params);
    extract(&accumulation, &params)
}

fn check(rows: &[&str], min_area_px: usize, bridge_px: usize, expected: &[&str]) {
    let mask = mask(rows, min_area_px, bridge_px);
    let drawn: Vec<String> = mask
        .blobs
        .of
        .chunks(mask.width)
        .map(|row| row.iter().map(|label| char::from(b'0' + *label as u8)).collect())
        .collect();
    assert_eq!(drawn, expected);
}

#[test]
fn only_the_depth_window_counts() {
    check(&["2444", "9.44"], 1, 0, &["0111", "2011"]);
}

#[test]
fn a_depth_jump_separates_neighbours() {
    check(&["4455"], 1, 0, &["1122"]);
}

#[test]
fn specks_go() {
    check(&["4....", "...44"], 2, 0, &["00000", "00011"]);
}

#[test]
fn a_gap_without_readings_is_bridged_where_both_sides_agree() {
    check(&["44..44"], 1, 2, &["111111"]);
    check(&["44..44"], 1, 1, &["110022"]);
    check(&["44..55"], 1, 2, &["110022"]);
    check(&["442244"], 1, 2, &["110022"]);
    check(&["4..", "...", "..4"], 1, 2, &["100", "010", "001"]);
}

#[test]
fn the_region_is_half_open_and_cut_to_the_image() {
    let params = MaskParams { roi: Some([1, 0, 3, 9]), ..MaskParams::default() };
    assert_eq!(params.region(4, 2), [1, 0, 3, 2]);
    let presence = crate::stages::presence::presence(&frame(&["4444", "4444"]), &params);
    assert_eq!(presence, crate::stages::presence::Presence { area_px: 4, centroid_px: [1.5, 0.5] });
}

#[test]
fn depth_is_the_mean_and_occupancy_the_share_over_the_frames() {
    let params = MaskParams { min_area_px: 1, ..MaskParams::default() };
    let mut accumulation = Accumulation::like(&frame(&["4"]));
    for row in ["4", "5", "1", "."] {
        accumulation.add(&frame(&[row]), &params);
    }
    let mask = extract(&accumulation, &params);
    assert_eq!(mask.occupancy, [0.5]);
    assert!((mask.depth_m[0] - 0.45).abs() < 1e-6);
    assert_eq!(mask.blobs.regions, [Region { label: 1, area_px: 1, bounds: [0, 0, 1, 1] }]);
}

#[test]
fn no_frames_give_an_empty_mask() {
    let params = MaskParams::default();
    let empty = extract(&Accumulation::like(&frame(&["44"])), &params);
    assert!(empty.blobs.regions.is_empty());
}
