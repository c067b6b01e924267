//! What the two programs take in time, as one table: `make figures`, or some of it with
//! `make figures ONLY="latency publish cpu start"`.
//!
//! The real programs, in release, each in a process of its own, speaking over the real socket. Times
//! are of this process's monotonic clock: what a program says is stamped when its line is read here.
//! Slowness is no error: the exit code is not 0 only if something could not be measured.

mod cpu;
mod latency;
mod machine;
mod publish;
mod start;
mod table;

use std::path::Path;

use table::Table;
use tests::programs::Program;

/// A part of the table: its name on the command line, and what measures it.
type Part = (&'static str, fn(&mut Table));

const PARTS: [Part; 4] = [
    ("latency", latency::measure),
    ("publish", publish::measure),
    ("cpu", cpu::measure),
    ("start", start::measure),
];

fn main() {
    // `cargo test` runs benches too, with nothing to measure.
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if !arguments.iter().any(|argument| argument == "--bench") {
        return;
    }
    let named: Vec<&str> = arguments.iter().map(String::as_str).filter(|name| *name != "--bench").collect();
    if let Some(other) = named.iter().find(|name| PARTS.iter().all(|(part, _)| part != *name)) {
        eprintln!("figures: there is no part {other:?}; expected latency, publish, cpu or start.");
        std::process::exit(2);
    }
    // Built before anything is measured.
    Program::Capture.path();
    println!("{}\n", machine::lines());
    let mut table = Table::begin();
    for (name, measure) in PARTS {
        if named.is_empty() || named.contains(&name) {
            measure(&mut table);
        }
    }
}

/// A recording of a family of synthetic scenes, made by `sward-capture synth`.
fn synthetic(folder: &Path, family: &str, frames: u32) -> String {
    let mut command =
        Program::Capture.command(["synth", "--family", family, "--frames", &frames.to_string()]);
    command.arg("--out").arg(folder);
    let made = tests::programs::Running::start(command).finish(tests::programs::DEADLINE);
    assert_eq!(made.code, Some(0), "{made:?}");
    let recording = folder.join(format!("{family}-1.mcap"));
    assert!(recording.exists(), "{made:?}");
    format!("{recording:?}")
}

/// Writes the files of `count` blades of 16 knots into a state directory.
fn fill(state: &Path, count: usize) {
    let blades = state.join("blades");
    std::fs::create_dir_all(&blades).expect("room");
    for number in 0..count {
        let length = 0.1 + 1e-5 * number as f64;
        let knots: String = (0..16)
            .map(|knot| {
                let t = f64::from(knot) / 15.0;
                let (x, y, half) = (0.02 * t * t, length * t, 0.004 * (1.0 - t));
                format!("  {{ position_m = [{x:?}, {y:?}, 0.0], half_width_m = [{half:?}, {half:?}] }},\n")
            })
            .collect();
        let text = format!("format = 1\nmix = 1.0\ncaptured_unix_ns = {number}\nknots = [\n{knots}]\n");
        std::fs::write(blades.join(format!("b{number}.toml")), text).expect("room");
    }
}

/// Settings under which the recording is over at once and nothing is captured.
fn nothing_to_see() -> Vec<(&'static str, String)> {
    vec![
        ("source.rate", "0.0".to_owned()),
        ("mask.near_m", "0.01".to_owned()),
        ("mask.far_m", "0.02".to_owned()),
    ]
}
