use super::*;
use crate::stages::drawn::mask_of;
use crate::stages::ribbon::ANCHOR;

const NOISE_M: f64 = 2e-4;
const HALF_PX: f64 = 7.0;

/// Sections of a blade whose depth has a shape across, in metres at offsets in pixels from the middle, and
/// noise.
fn rows(shape: impl Fn(f64) -> f64) -> Vec<Row> {
    let mut state = 1_u64;
    let mut noise = || {
        // The sum of four even numbers is nearly normal; σ of one is 1/√12.
        let mut even = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / (1_u64 << 24) as f64 - 0.5
        };
        (even() + even() + even() + even()) * 3.0_f64.sqrt() * NOISE_M
    };
    let row = |index: usize| {
        let readings = (-6..=6).map(|t| {
            let z = 0.55 + 3e-4 * index as f64 + 1e-4 * f64::from(t) + shape(f64::from(t));
            (f64::from(t) / HALF_PX, z + noise())
        });
        Row { index, readings: readings.collect(), half_px: HALF_PX }
    };
    let mut row = row;
    (0..120).map(&mut row).collect()
}

#[test]
fn a_crease_is_found_where_it_is() {
    for (place, slope) in [(-0.3, 2.5e-4), (0.25, -4e-4), (0.0, 3e-4)] {
        let rows = rows(|t| slope * (t - place * HALF_PX).abs());
        let (places, slopes) = fit(&rows, 120, 1e-4).expect("there is a crease");
        for i in 0..120 {
            assert!((places[i] - place).abs() < 0.06, "{} for {place}", places[i]);
            assert!((slopes[i] / slope - 1.0).abs() < 0.12, "{} for {slope}", slopes[i]);
        }
    }
}

#[test]
fn flat_bent_and_hardly_folded_blades_have_none() {
    assert_eq!(fit(&rows(|_| 0.0), 120, 0.0), None);
    assert_eq!(fit(&rows(|t| 3e-5 * t * t), 120, 0.0), None);
    let slight = rows(|t| 0.9e-4 * (t - 1.0).abs());
    assert!(fit(&slight, 120, 0.0).is_some());
    assert_eq!(fit(&slight, 120, 1.2e-4), None);
}

#[test]
fn where_a_blade_is_led_unseen_its_crease_stays_in_its_middle() {
    const SEEN: usize = 130;
    let middle = 60.0;
    // A creased blade down a column, before a wall; what is below is not seen.
    let depth_m = |x: i32, y: i32| {
        let aside = (x as f32 - middle).abs();
        if aside < 8.5 && (10..10 + SEEN as i32).contains(&y) { 0.5 + 4e-4 * aside } else { 1.4 }
    };
    let mask = mask_of((120, 240), depth_m);
    // Where it is seen last it is taken to bend aside a little.
    let section = |i: usize| {
        let aside = 0.05 * (i as f32 - 90.0).clamp(0.0, 40.0);
        let expected = Expected {
            mid: Vec2::new(middle + aside, (10 + i) as f32),
            across: Vec2::X,
            half_px: 8.5,
            depth_m: 0.5,
            slope_m: 0.0,
            fold: Fold::default(),
            tolerance_m: 0.01,
            search_px: 2.0,
        };
        let guide_px = (i >= SEEN).then_some(8.5);
        Section { expected, measured: expected.measure(&mask), anchor: ANCHOR, guide_px }
    };
    let sections: Vec<Section> = (0..SEEN + 80).map(section).collect();
    let crease = Crease::search(&mask, &sections, 570.0).expect("there is a crease");
    for i in SEEN..sections.len() {
        let (aside, half) = (crease.fold(i).at_px, crease.half_px[i]);
        assert!(aside.abs() < 3.0 && (half - 8.5).abs() < 1.0, "{aside} px aside, {half} px at {i}");
    }
}
