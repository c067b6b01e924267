//! Blades whose root is cut off, square or aslant.

use glam::DVec2;

use crate::painter::{CAMERA, FOCAL_PX, HEIGHT, MIDDLE, Strip, capture, flat};

const DEPTH_MM: f64 = 550.0;

/// Asserts that a strip is found, and measured to a pixel along its lower half.
fn check(strip: Strip) {
    let capture = capture(&[flat(strip.outline(), DEPTH_MM)]).expect("something is there");
    let [blade] = &capture.steps.blades[..] else {
        panic!("{strip:?} gives {:?}", capture.steps.refused);
    };
    let px = |metres: f32| f64::from(metres) * FOCAL_PX / (DEPTH_MM * 1e-3);
    // A tip thinner than a pixel is not seen.
    let length = px(blade.blade.length_m());
    assert!((length - strip.length_px).abs() < 11.0, "{strip:?} is {length:.1} px long");
    // How wide what is cut off aslant is can be said in two ways.
    let aslant = 0.5 * strip.width_px * strip.slant.tan().abs();
    for knot in &blade.knots_in_camera {
        let (x, y) = CAMERA.project(knot.position);
        let along = (DVec2::new(x, y) - strip.root).dot(strip.along());
        let off = px(knot.width()) - strip.width_at(along);
        let counts = strip.slant == 0.0 || along > aslant + 1.0 || off > 0.0;
        if counts && along < 0.5 * strip.length_px {
            assert!(off.abs() < 1.0, "{off:+.2} px at {along:.1} px from the root of {strip:?}");
        }
    }
}

#[test]
fn a_root_that_is_cut_off_is_as_wide_as_what_is_above_it() {
    for width_px in [8.0, 12.0, 18.0, 24.0, 32.0] {
        for lean in [0.0, 0.1, -0.35, 0.8, -1.2] {
            for slant in [0.0, 0.35, -0.7] {
                let along = DVec2::new(f64::sin(lean), -f64::cos(lean));
                check(Strip { root: MIDDLE - along * 110.0, lean, length_px: 220.0, width_px, slant });
            }
        }
    }
}

#[test]
fn the_midrib_of_what_comes_in_aslant_stays_in_its_middle_up_to_the_border() {
    for width_px in [12.0, 20.0, 30.0] {
        for lean in [0.0, 0.3, 0.6, -0.7] {
            let along = DVec2::new(f64::sin(lean), -f64::cos(lean));
            let strip = Strip { root: MIDDLE - along * 380.0, lean, length_px: 430.0, width_px, slant: 0.0 };
            let capture = capture(&[flat(strip.outline(), DEPTH_MM)]).expect("something is there");
            let [blade] = &capture.steps.blades[..] else {
                panic!("{strip:?} gives {:?}", capture.steps.refused);
            };
            let places = blade.knots_in_camera.iter().map(|knot| DVec2::from(CAMERA.project(knot.position)));
            for place in places.clone() {
                let aside = (place - strip.root).perp_dot(strip.along());
                assert!(aside.abs() < 1.0, "{aside:+.2} px beside the middle of {strip:?} at {place}");
            }
            let lowest = places.map(|place| place.y).fold(0.0, f64::max);
            assert!(lowest > HEIGHT as f64 - 4.0, "{strip:?} begins at row {lowest:.1}");
        }
    }
}
