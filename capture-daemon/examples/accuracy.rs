//! Prints how true the capture is, family by family:
//! `accuracy [clips] [first seed] [family]... [--markdown FILE]`.
//!
//! Each column is explained under the table. Clips are measured on all processors; the result does
//! not depend on how many there are.

use std::fmt::Write as _;

use capture_daemon::session::SessionParams;
use capture_daemon::synth::accuracy::{Summary, measure};
use capture_daemon::synth::{ClipParams, FAMILIES, Family, Scene, sweep};

fn main() {
    let mut numbers = Vec::new();
    let (mut names, mut markdown) = (Vec::new(), None);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.parse::<u64>() {
            Ok(number) => numbers.push(number),
            Err(_) if argument == "--markdown" => markdown = arguments.next(),
            Err(_) => names.push(argument),
        }
    }
    let (clips, first) = (numbers.first().copied().unwrap_or(20), numbers.get(1).copied().unwrap_or(1));
    let wanted = |family: &Family| names.is_empty() || names.iter().any(|name| name == family.name());
    let mut table = format!("{}\n", Summary::MARKDOWN_HEAD);
    for family in FAMILIES.into_iter().filter(wanted) {
        let summary = Summary::of(&sweep(first..first + clips, |seed| {
            let clip = ClipParams { frames: Scene::new(family, seed).frames(), ..ClipParams::default() };
            measure(family, seed, clip, &SessionParams::default()).expect("valid parameters")
        }));
        println!("{:10}  {summary}", family.name());
        writeln!(table, "{}", summary.markdown_row(family.name())).expect("text has room");
    }
    if let Some(path) = markdown {
        let last = first + clips.saturating_sub(1);
        let text = format!("{table}\nSeeds {first} to {last}. {}\n", Summary::LEGEND);
        std::fs::write(&path, text).unwrap_or_else(|error| panic!("{path} cannot be written: {error}"));
    }
}
