//! Are refined blades closer to the full ones in motion than blades with as many knots chosen otherwise?

use capture_daemon::synth::SHAPES;
use capture_daemon::synth::refinement::{Way, fidelity, skeletons};

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
fn all_knots_are_the_blade_itself() {
    for shape in SHAPES {
        let skeleton = &skeletons(shape, 1)[0];
        let all = fidelity(skeleton, &Way::Fit.refine(skeleton, skeleton.len()));
        assert!(all.hausdorff_m == 0.0 && all.carried_m < 1e-5 && all.simulated_m < 1e-5, "{all:?}");
    }
}
