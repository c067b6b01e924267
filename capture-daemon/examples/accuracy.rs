//! Prints how true the capture is, family by family: `accuracy [clips] [first seed] [family]...`.
//! Length and width: median / 95 % of the matched blades' errors; midrib: median; Hausdorff: 95 %.

use capture_daemon::session::SessionParams;
use capture_daemon::synth::accuracy::{ClipResult, Summary, measure};
use capture_daemon::synth::{ClipParams, FAMILIES, Scene};

fn main() {
    let (numbers, names): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|argument| argument.parse::<u64>().is_ok());
    let mut numbers = numbers.iter().filter_map(|number| number.parse::<u64>().ok());
    let (clips, first) = (numbers.next().unwrap_or(20), numbers.next().unwrap_or(1));
    let wanted = |name: &str| names.is_empty() || names.iter().any(|it| it == name);
    for family in FAMILIES.into_iter().filter(|family| wanted(family.name())) {
        let result = |seed| {
            let clip = ClipParams { frames: Scene::new(family, seed).frames(), ..ClipParams::default() };
            measure(family, seed, clip, &SessionParams::default()).expect("valid parameters")
        };
        let results: Vec<ClipResult> = (first..first + clips).map(result).collect();
        println!("{:10}  {}", family.name(), Summary::of(&results));
    }
}
