//! `sward-render`: the meadow in a window, or as pictures.

use std::io::IsTerminal;
use std::process::ExitCode;

use clap::Parser;
use renderer::cli::Cli;
use renderer::{app, headless};
use tracing_subscriber::EnvFilter;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let filter = EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| EnvFilter::new("warn,renderer=info,sward_render=info"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr)
        .init();
    let done = if cli.headless { headless::run(&cli) } else { app::run(&cli) };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("sward-render: {error:#}");
            ExitCode::FAILURE
        }
    }
}
