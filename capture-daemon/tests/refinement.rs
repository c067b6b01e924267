//! Are refined blades closer to the full ones in motion than blades with as many knots chosen otherwise?

use capture_daemon::synth::SHAPES;
use capture_daemon::synth::refinement::{Fidelity, WAYS, Way, fidelity, skeletons};

#[test]
fn the_default_beats_douglas_peucker_and_even_resampling_in_motion() {
    for shape in SHAPES {
        for (index, skeleton) in skeletons(shape, 8).iter().enumerate() {
            for count in [16, 8] {
                let of = |way: Way| fidelity(skeleton, &way.refine(skeleton, count));
                let fit = of(Way::Fit);
                for way in [Way::DouglasPeucker, Way::Uniform, Way::Merge] {
                    let other = of(way);
                    let at = format!("{} {index}, {count} knots, {}", shape.name(), way.name());
                    assert!(fit.carried_m < other.carried_m, "{at}: {fit:?} {other:?}");
                    assert!(fit.simulated_m < other.simulated_m, "{at}: {fit:?} {other:?}");
                }
            }
        }
    }
}

#[test]
fn the_table_in_the_docs_is_what_comes_out_today() {
    let page = include_str!("../docs/refinement.md");
    let mut rows = 0;
    for line in page.lines() {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let [_, shape, knots, columns @ .., _] = &cells[..] else { continue };
        let Some(shape) = SHAPES.into_iter().find(|it| it.name() == *shape) else { continue };
        let knots: usize = knots.parse().expect("a number of knots");
        // The others stand or fall with these.
        if knots > 16 {
            continue;
        }
        rows += 1;
        let skeletons = skeletons(shape, 8);
        for (way, cell) in WAYS.into_iter().zip(columns) {
            let told: Vec<f32> = cell.split(" / ").map(|mm| mm.parse().expect("millimetres")).collect();
            let mut means = [0.0_f32; 3];
            for skeleton in &skeletons {
                let Fidelity { hausdorff_m, carried_m, simulated_m } =
                    fidelity(skeleton, &way.refine(skeleton, knots));
                for (mean, metres) in means.iter_mut().zip([hausdorff_m, carried_m, simulated_m]) {
                    *mean += 1e3 * metres / skeletons.len() as f32;
                }
            }
            for (told, is) in told.iter().zip(means) {
                // Other processors round elsewhere.
                let stale = (told - is).abs() > 0.003 + 0.02 * is;
                assert!(!stale, "{} {knots}, {}: {told} mm in the docs, {is} mm", shape.name(), way.name());
            }
        }
    }
    assert_eq!(rows, 2 * SHAPES.len(), "rows of 16 and 8 knots");
}

#[test]
fn all_knots_are_the_blade_itself() {
    for shape in SHAPES {
        let skeleton = &skeletons(shape, 1)[0];
        let all = fidelity(skeleton, &Way::Fit.refine(skeleton, skeleton.len()));
        assert!(all.hausdorff_m == 0.0 && all.carried_m < 1e-5 && all.simulated_m < 1e-5, "{all:?}");
    }
}
