//! Are the blades of synthetic clips found, and how true are they?

use capture_daemon::session::SessionParams;
use capture_daemon::synth::accuracy::{BladeError, ClipResult, measure, quantile};
use capture_daemon::synth::{ClipParams, Family};

/// Seeds that the stages were not tuned on.
const SEEDS: std::ops::Range<u64> = 9_000..9_020;

fn results(family: Family, clip: ClipParams) -> Vec<ClipResult> {
    let measured = |seed| measure(family, seed, clip, &SessionParams::default()).expect("valid parameters");
    SEEDS.map(measured).collect()
}

fn error_at(results: &[ClipResult], share: f32, of: fn(&BladeError) -> f32) -> f32 {
    quantile(results.iter().flat_map(|result| &result.matched).map(of).collect(), share)
}

fn check(family: Family) {
    let results = results(family, ClipParams { frames: 36, ..ClipParams::default() });
    let exact = results.iter().filter(|result| result.is_exact()).count();
    let at = |share, of| error_at(&results, share, of);
    println!(
        "{family:?}: exact {exact}/{}, length p50 {:.2} % p95 {:.2} %, width p50 {:.2} % p95 {:.2} %, \
         midrib p50 {:.2} mm, Hausdorff p95 {:.2} mm",
        results.len(),
        1e2 * at(0.5, |e| e.length),
        1e2 * at(0.95, |e| e.length),
        1e2 * at(0.5, |e| e.max_width),
        1e2 * at(0.95, |e| e.max_width),
        1e3 * at(0.5, |e| e.midrib_m),
        1e3 * at(0.95, |e| e.hausdorff_m),
    );
    let inexact: Vec<u64> = results.iter().filter(|r| !r.is_exact()).map(|r| r.seed).collect();
    assert!(exact * 20 >= results.len() * 19, "inexact seeds: {inexact:?}");
    assert!(at(0.5, |e| e.length) < 0.02);
    assert!(at(0.5, |e| e.max_width) < 0.03);
    assert!(at(0.5, |e| e.midrib_m) < 0.001);
}

#[test]
fn single_blades_are_found() {
    check(Family::Single);
}

#[test]
fn blades_of_rows_are_found() {
    check(Family::Row);
}
