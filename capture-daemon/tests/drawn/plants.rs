//! Leaves before and behind each other, as on a plant that is seen from its edge.

use capture_daemon::session::Capture;
use glam::DVec2;

use crate::painter::{Painted, capture, capture_at_once, flat};

fn outline(corners: &[(f64, f64)]) -> Vec<DVec2> {
    corners.iter().map(|&(x, y)| DVec2::new(x, y)).collect()
}

/// The midrib of each leaf that was followed, from root to tip, pixels.
fn midribs(capture: &Capture) -> Vec<Vec<DVec2>> {
    let mids = |skeleton: &capture_daemon::stages::skeleton::Skeleton| {
        skeleton.stations.iter().map(|station| station.mid.as_dvec2()).collect()
    };
    capture.steps.skeletons.iter().map(mids).collect()
}

/// Where midribs begin and end in a scene of a leaf that ends at (320, 300) and of one before that, from there to
/// the lower border, which gets nearer by so many millimetres a row.
fn ends(nearer_mm: f64) -> Vec<[DVec2; 2]> {
    let behind = outline(&[(306.3, 300.2), (304.3, 160.2), (320.3, 80.2), (336.3, 160.2), (334.3, 300.2)]);
    let before = outline(&[(300.3, 292.2), (340.3, 292.2), (352.3, 480.2), (308.3, 480.2)]);
    let falling = Painted {
        outline: before,
        depth_mm: Box::new(move |point: DVec2| 570.0 - nearer_mm * (point.y - 292.0)),
    };
    ends_of(&capture(&[flat(behind, 600.0), falling]).expect("something is there"))
}

/// Where midribs begin and end.
fn ends_of(capture: &Capture) -> Vec<[DVec2; 2]> {
    midribs(capture).iter().map(|mids| [mids[0], mids[mids.len() - 1]]).collect()
}

#[test]
fn a_leaf_that_falls_out_of_the_picture_begins_where_its_plant_is() {
    let at_plant = DVec2::new(320.0, 293.0);
    let falls = |[root, tip]: &[DVec2; 2]| root.distance(at_plant) < 12.0 && tip.y > 440.0;
    let fallen = ends(0.95);
    assert!(fallen.iter().any(falls), "{fallen:?}");
    // What stands there is a stem, and leads the other way.
    let standing = ends(0.0);
    assert!(!standing.iter().any(falls) && standing.iter().any(|[root, _]| root.y > 470.0), "{standing:?}");
}

#[test]
fn a_leaf_whose_one_edge_is_hidden_all_along_has_a_midrib_and_is_no_blade() {
    // Of its tip both edges are seen for five rows, or for twenty.
    for tip_x in [323.3, 328.3] {
        let behind =
            outline(&[(308.3, 420.2), (304.3, 180.2), (tip_x, 90.2), (340.3, 180.2), (338.3, 420.2)]);
        let before = outline(&[(280.3, 430.2), (278.3, 70.2), (300.3, 40.2), (322.3, 60.2), (322.3, 430.2)]);
        let capture = capture(&[flat(behind, 620.0), flat(before, 540.0)]).expect("something is there");
        // Between the edge of what is before it and its own.
        let along = |mids: &Vec<DVec2>| {
            let on_it = mids.iter().filter(|mid| (321.0..340.5).contains(&mid.x)).count();
            let (root, tip) = (mids[0], mids[mids.len() - 1]);
            10 * on_it > 9 * mids.len() && root.y > 400.0 && tip.y < 130.0
        };
        let midribs = midribs(&capture);
        assert!(midribs.iter().any(along), "{tip_x}: {midribs:?}");
        assert_eq!(capture.steps.blades.len(), 1, "half of its width is not known");
        let codes: Vec<&str> = capture.steps.refused.iter().map(|refusal| refusal.code()).collect();
        assert_eq!(codes, ["hidden"], "{tip_x}");
    }
}

/// The outline of a strip of even width along a line, pixels.
fn strip(line: &[(f64, f64)], width_px: f64) -> Vec<DVec2> {
    let points = outline(line);
    let beside = |i: usize, side: f64| {
        let along = points[(i + 1).min(points.len() - 1)] - points[i.saturating_sub(1)];
        points[i] + side * 0.5 * width_px * along.normalize().perp()
    };
    let left = (0..points.len()).map(|i| beside(i, -1.0));
    left.chain((0..points.len()).rev().map(|i| beside(i, 1.0))).collect()
}

/// Midribs of a leaf that ends at (321, 200) and of a crumb that hangs beside its tip down to (335, 224), with
/// what there is between them.
fn beside_crumb(between: Option<Painted>) -> Vec<Vec<DVec2>> {
    let leaf = outline(&[
        (308.3, 480.2),
        (312.3, 300.2),
        (318.3, 200.2),
        (324.3, 200.2),
        (330.3, 300.2),
        (334.3, 480.2),
    ]);
    let crumb = strip(&[(334.3, 202.2), (335.3, 212.2), (335.3, 224.2)], 4.0);
    let scene: Vec<Painted> = between.into_iter().chain([flat(leaf, 600.0), flat(crumb, 630.0)]).collect();
    midribs(&capture_at_once(&scene, 0.05).expect("something is there"))
}

#[test]
fn a_tip_goes_on_along_a_trail_without_readings() {
    let ends = |midribs: &[Vec<DVec2>], tip: DVec2| {
        midribs.iter().any(|mids| mids[0].y > 460.0 && mids[mids.len() - 1].distance(tip) < 6.0)
    };
    let trail = strip(&[(321.3, 203.2), (322.3, 196.2), (327.3, 192.2), (332.3, 195.2), (334.3, 203.2)], 4.0);
    let midribs = beside_crumb(Some(flat(trail, 0.0)));
    assert!(midribs.len() == 1 && ends(&midribs, DVec2::new(335.0, 224.0)), "{midribs:?}");
    // Where the wall is seen between them they are two.
    let apart = beside_crumb(None);
    assert!(ends(&apart, DVec2::new(321.0, 200.0)), "{apart:?}");
}

#[test]
fn the_thin_tip_of_a_broad_leaf_may_hang_over() {
    let leaf = outline(&[
        (306.3, 480.2),
        (308.3, 270.2),
        (317.3, 240.2),
        (323.3, 240.2),
        (332.3, 270.2),
        (334.3, 480.2),
    ]);
    let tip = strip(&[(320.3, 243.2), (322.3, 229.2), (333.3, 225.2), (343.3, 233.2), (348.3, 252.2)], 6.0);
    let capture = capture(&[flat(leaf, 600.0), flat(tip, 600.0)]).expect("something is there");
    let midribs = midribs(&capture);
    let hangs = |mids: &Vec<DVec2>| mids[mids.len() - 1].distance(DVec2::new(348.0, 252.0)) < 6.0;
    assert!(midribs.iter().any(hangs), "{midribs:?}");
}

#[test]
fn a_leaf_whose_base_is_hidden_by_another_has_its_midrib_from_there_on() {
    let behind = outline(&[(312.3, 480.2), (311.3, 200.2), (322.3, 110.2), (333.3, 200.2), (330.3, 480.2)]);
    let before = outline(&[
        (306.3, 480.2),
        (276.3, 380.2),
        (288.3, 300.2),
        (321.3, 230.2),
        (344.3, 300.2),
        (358.3, 380.2),
        (336.3, 480.2),
    ]);
    let capture = capture(&[flat(behind, 600.0), flat(before, 540.0)]).expect("something is there");
    let midribs = midribs(&capture);
    let whole = |mids: &Vec<DVec2>| {
        mids[0].y > 455.0 && mids[mids.len() - 1].distance(DVec2::new(322.0, 112.0)) < 10.0
    };
    assert!(midribs.iter().any(whole), "{midribs:?}");
}

#[test]
fn a_leaf_begins_where_others_do_though_its_way_from_there_bows() {
    // What hides it bows to the left, from where all of them grow up to where it comes out.
    let before =
        strip(&[(321.3, 480.2), (300.3, 440.2), (286.3, 360.2), (300.3, 280.2), (326.3, 215.2)], 38.0);
    let behind = strip(&[(321.3, 236.2), (321.3, 180.2), (323.3, 110.2)], 16.0);
    let another = strip(&[(330.3, 480.2), (380.3, 400.2), (420.3, 300.2)], 20.0);
    let scene = [flat(before, 540.0), flat(behind, 600.0), flat(another, 560.0)];
    let capture = capture(&scene).expect("something is there");
    let midribs = midribs(&capture);
    let whole = |mids: &Vec<DVec2>| {
        let bows = mids.iter().any(|mid| mid.y > 340.0 && mid.x < 305.0);
        bows && mids[0].y > 455.0 && mids[mids.len() - 1].distance(DVec2::new(323.0, 112.0)) < 10.0
    };
    assert!(midribs.iter().any(whole), "{:?}", ends_of(&capture));
}
