//! `sward-render`: the meadow in a window, or as pictures.

use std::io::IsTerminal;
use std::process::ExitCode;

use clap::{CommandFactory, Parser};
use common::manual;
use common::sentence::{complain, of_causes, of_paragraphs, print};
use renderer::cli::{Cli, Verb};
use renderer::{app, bench, headless};
use tracing_subscriber::EnvFilter;

/// How it calls itself.
const PROGRAM: &str = "sward-render";
/// Anything that prevents drawing.
const FAILED: u8 = 1;
/// Bad arguments.
const BAD_ARGUMENTS: u8 = 2;

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            let sentence = of_paragraphs(&error.to_string());
            complain(PROGRAM, &format!("{sentence}; see sward-render --help."));
            return ExitCode::from(BAD_ARGUMENTS);
        }
        Err(help) => {
            return match print(&help.to_string()) {
                Ok(()) => ExitCode::SUCCESS,
                Err(error) => {
                    complain(PROGRAM, &format!("{error}."));
                    ExitCode::from(FAILED)
                }
            };
        }
    };
    let filter = EnvFilter::try_from_env("SWARD_LOG")
        .unwrap_or_else(|_| EnvFilter::new("warn,renderer=info,sward_render=info"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr)
        .init();
    match perform(&cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            complain(PROGRAM, &of_causes(error.chain()));
            ExitCode::from(FAILED)
        }
    }
}

fn perform(cli: &Cli) -> anyhow::Result<()> {
    if let Some(shell) = cli.completions {
        return Ok(print(&manual::completions(Cli::command(), shell))?);
    }
    if let Some(folder) = &cli.man {
        let paths = manual::write_pages(folder, &manual::pages(Cli::command())?)?;
        return Ok(print(&paths.iter().map(|path| format!("{}\n", path.display())).collect::<String>())?);
    }
    if let Some(Verb::Bench(args)) = &cli.verb {
        return bench::run(args);
    }
    if cli.headless { headless::run(cli) } else { app::run(cli) }
}
