//! Writes a library of made-up blades, to try the renderer without a sensor:
//! `cargo run -p renderer --example write_meadow -- meadow.sward`

#[path = "../tests/common/mod.rs"]
mod fixture;

fn main() -> std::io::Result<()> {
    let mut args = std::env::args().skip(1);
    let path = args.next().unwrap_or_else(|| "meadow.sward".into());
    let which: Vec<usize> = args.filter_map(|arg| arg.parse().ok()).collect();
    let bytes = if which.is_empty() { fixture::meadow(1) } else { fixture::library(1, &which) };
    std::fs::write(path, bytes)
}
