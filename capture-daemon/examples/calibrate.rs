//! Fits the constants of `stages/confidence.rs` to synthetic blades and checks them on others:
//! `calibrate [--check] [clips of each family]`, by default 200.
//!
//! Prints the two constants as they stand in the source, then for each family the share of blades whose true
//! length and width lie in the predicted 95 % band: of those that were fitted (seeds from 1 on), and
//! of others (seeds from 20,000 on). With `--check`, the constants that are compiled in are checked on
//! the others and nothing is fitted.

use capture_daemon::session::SessionParams;
use capture_daemon::stages::confidence::{LENGTH_CAUSES, WIDTH_CAUSES};
use capture_daemon::synth::accuracy::{BAND_95, BladeError, ClipResult, measure};
use capture_daemon::synth::{ClipParams, Family, Scene, sweep};

/// The families that are fitted: those with blades, but for sessions of several visitors, who are like those
/// of [`Family::Held`].
const FITTED: [Family; 8] = [
    Family::Single,
    Family::Row,
    Family::Toward,
    Family::Fan,
    Family::Crossing,
    Family::Held,
    Family::Twisted,
    Family::Asymmetric,
];
const FIRST_FITTED: u64 = 1;
const FIRST_OTHER: u64 = 20_000;
/// The share of blades that is to lie in the band. Families differ by what no number tells, and other blades
/// lie in it a little less often than those that were fitted: about the middle of 90 to 99 % leaves most room on
/// both sides.
const SHARE: f64 = 0.96;

/// One blade: its family's index, what its errors come from, and |error| of length and width, metres.
struct Sample {
    family: usize,
    causes_m: [Vec<f32>; 2],
    errors_m: [f32; 2],
    predicted_m: [f32; 2],
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let check_only = arguments.iter().any(|argument| argument == "--check");
    let clips = arguments.iter().find_map(|argument| argument.parse().ok()).unwrap_or(200);
    let others = samples(FIRST_OTHER, clips);
    if check_only {
        coverage("compiled in, other blades", &others, |sample, i| sample.predicted_m[i]);
        return;
    }
    let fitted_on = samples(FIRST_FITTED, clips);
    let constants = [0, 1].map(|i| fit(&fitted_on, i));
    let causes: [(&str, &[&str]); 2] = [("LENGTH", &LENGTH_CAUSES), ("WIDTH", &WIDTH_CAUSES)];
    for ((name, causes), constants) in causes.into_iter().zip(&constants) {
        println!("const {name}: [f32; {name}_CAUSES.len()] = [");
        for (constant, cause) in constants.iter().zip(causes) {
            println!("    {constant:.4}, // {cause}");
        }
        println!("];");
    }
    let predicted = |sample: &Sample, i: usize| {
        let causes = constants[i].iter().zip(&sample.causes_m[i]);
        causes.map(|(weight, cause)| (weight * f64::from(*cause)).powi(2)).sum::<f64>().sqrt() as f32
    };
    coverage("fitted", &fitted_on, predicted);
    coverage("other blades", &others, predicted);
}

/// Blades of `clips` seeds of each family.
fn samples(first: u64, clips: u64) -> Vec<Sample> {
    let mut samples = Vec::new();
    for (index, family) in FITTED.into_iter().enumerate() {
        let results = sweep(first..first + clips, |seed| measured(family, seed));
        samples.extend(results.iter().flat_map(|result| &result.matched).map(|blade| sample(index, blade)));
    }
    samples
}

fn sample(family: usize, blade: &BladeError) -> Sample {
    let predicted_m = [blade.quality.length_error_m, blade.quality.width_error_m];
    let errors_m =
        [blade.length_deviations * predicted_m[0], blade.width_deviations * predicted_m[1]].map(f32::abs);
    let evidence = &blade.quality.evidence;
    let causes_m = [evidence.length_causes_m().to_vec(), evidence.width_causes_m().to_vec()];
    Sample { family, causes_m, errors_m, predicted_m }
}

/// A clip, measured; one in eight is captured from a single frame, one in eight from a few. Nothing is refused
/// for being unsure.
fn measured(family: Family, seed: u64) -> ClipResult {
    let scene = Scene::new(family, seed);
    // As short as they can be to show their blades for longer than the hold.
    let frames = if scene.visits.is_empty() { 26 } else { scene.frames() };
    let mut params = SessionParams::default();
    params.pipeline.accept.min_score = 0.0;
    match seed % 8 {
        // What a hand brings in is captured when it holds still, not on its way.
        0 if scene.visits.is_empty() => params.station.hold_s = 0.0,
        0 | 1 => params.station.hold_s = 0.15,
        _ => {}
    }
    let clip = ClipParams { frames, ..ClipParams::default() };
    measure(family, seed, clip, &params).expect("valid parameters")
}

/// Quantile regression of ln |error|, all families counting the same: what each cause counts, ≥ 0, such that
/// [`SHARE`] of the errors lie within [`BAND_95`] predicted deviations. The loss is smoothed at its kink and
/// minimised by Adam (Kingma & Ba 2015) over the logarithms; a slight ridge keeps causes that say nothing small.
fn fit(samples: &[Sample], which: usize) -> Vec<f64> {
    const STEPS: i32 = 3000;
    const RATE: f64 = 0.05;
    const SMOOTH: f64 = 0.1;
    const RIDGE: f64 = 2e-5;
    const LEAST: f64 = 1e-4;
    let in_family = |family: usize| samples.iter().filter(|sample| sample.family == family).count();
    let sizes: Vec<usize> = (0..FITTED.len()).map(in_family).collect();
    let families = sizes.iter().filter(|size| **size > 0).count() as f64;
    let weight = |sample: &Sample| 1.0 / (sizes[sample.family] as f64 * families);
    let causes = samples.first().map_or(0, |sample| sample.causes_m[which].len());
    let mut logs = vec![0.05_f64.ln(); causes];
    let (mut first, mut second) = (vec![0.0; causes], vec![0.0; causes]);
    for step in 1..=STEPS {
        let mut gradient: Vec<f64> = logs.iter().map(|log| RIDGE * log.exp()).collect();
        for sample in samples {
            let causes = logs.iter().zip(&sample.causes_m[which]);
            let squares: Vec<f64> = causes.map(|(log, m)| (log.exp() * f64::from(*m)).powi(2)).collect();
            let sum = squares.iter().sum::<f64>() + 1e-16;
            let target = f64::from((sample.errors_m[which] / BAND_95).max(1e-6)).ln();
            let left = target - 0.5 * sum.ln();
            let slope = weight(sample) * (SHARE - 1.0 / (1.0 + (left / SMOOTH).exp()));
            gradient.iter_mut().zip(squares).for_each(|(g, square)| *g -= slope * square / sum);
        }
        let rate = RATE * (1.0 - f64::from(step) / f64::from(STEPS));
        for i in 0..causes {
            first[i] = 0.9 * first[i] + 0.1 * gradient[i];
            second[i] = 0.999 * second[i] + 0.001 * gradient[i] * gradient[i];
            let (m, v): (f64, f64) =
                (first[i] / (1.0 - 0.9_f64.powi(step)), second[i] / (1.0 - 0.999_f64.powi(step)));
            logs[i] = (logs[i] - rate * m / (v.sqrt() + 1e-9)).max(LEAST.ln());
        }
    }
    logs.into_iter().map(f64::exp).collect()
}

/// Prints for each family the share in the band, and the predicted deviations: median and 95 %.
fn coverage(title: &str, samples: &[Sample], predicted_m: impl Fn(&Sample, usize) -> f32) {
    println!("\n{title}: blades, length in band (predicted deviation p50 / p95), width likewise");
    for (index, family) in FITTED.into_iter().enumerate() {
        let of: Vec<&Sample> = samples.iter().filter(|sample| sample.family == index).collect();
        print!("{:10} {:5}", family.name(), of.len());
        for i in [0, 1] {
            let inside = of.iter().filter(|s| s.errors_m[i] <= BAND_95 * predicted_m(s, i)).count();
            let mut sigmas: Vec<f32> = of.iter().map(|sample| predicted_m(sample, i)).collect();
            sigmas.sort_by(f32::total_cmp);
            let at = |share: f32| {
                let last = sigmas.len().saturating_sub(1) as f32;
                1e3 * sigmas.get((share * last) as usize).copied().unwrap_or(0.0)
            };
            let share = 1e2 * inside as f64 / of.len().max(1) as f64;
            print!("   {share:5.1} % ({:.2} / {:.2} mm)", at(0.5), at(0.95));
        }
        println!();
    }
}
