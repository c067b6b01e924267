//! Prints how true the capture is, family by family: `accuracy [clips] [first seed] [family]...`.

use capture_daemon::session::SessionParams;
use capture_daemon::synth::accuracy::{BladeError, ClipResult, measure, quantile};
use capture_daemon::synth::{ClipParams, FAMILIES, Scene};

fn main() {
    let mut numbers = std::env::args().skip(1).filter_map(|argument| argument.parse::<u64>().ok());
    let (clips, first) = (numbers.next().unwrap_or(20), numbers.next().unwrap_or(1));
    println!(
        "family     exact  length p50/p95  width p50/p95  midrib p50  Hausdorff p95   inexact seeds (found/truth)"
    );
    let named: Vec<String> =
        std::env::args().skip(1).filter(|argument| argument.parse::<u64>().is_err()).collect();
    let wanted = |name: &str| named.is_empty() || named.iter().any(|it| it == name);
    for family in FAMILIES.into_iter().filter(|family| wanted(family.name())) {
        let clip = |seed| ClipParams { frames: Scene::new(family, seed).frames(), ..ClipParams::default() };
        let results: Vec<ClipResult> = (first..first + clips)
            .map(|seed| {
                measure(family, seed, clip(seed), &SessionParams::default()).expect("valid parameters")
            })
            .collect();
        let at = |share: f32, of: fn(&BladeError) -> f32| {
            quantile(results.iter().flat_map(|result| &result.matched).map(of).collect(), share)
        };
        let exact = results.iter().filter(|result| result.is_exact()).count();
        let inexact = results.iter().filter(|result| !result.is_exact());
        let inexact: Vec<String> = inexact
            .map(|result| {
                format!("{} ({}m{}/{})", result.seed, result.captured, result.matched.len(), result.truth)
            })
            .collect();
        println!(
            "{:10} {:4.0} %   {:4.1}/{:4.1} %     {:4.1}/{:4.1} %    {:4.2} mm     {:5.1} mm        {}",
            family.name(),
            1e2 * exact as f64 / results.len() as f64,
            1e2 * at(0.5, |e| e.length),
            1e2 * at(0.95, |e| e.length),
            1e2 * at(0.5, |e| e.max_width),
            1e2 * at(0.95, |e| e.max_width),
            1e3 * at(0.5, |e| e.midrib_m),
            1e3 * at(0.95, |e| e.hausdorff_m),
            inexact.join(" "),
        );
    }
}
