//! `sward-capture`: the capture station.

use std::process::ExitCode;

use capture_daemon::cli::{Cli, ConfigArgs, Verb};
use capture_daemon::client::ClientError;
use capture_daemon::config::{self, Config, ConfigError};
use capture_daemon::devices::DevicesError;
use capture_daemon::record::RecordError;
use capture_daemon::source::host;
use capture_daemon::{client, daemon, devices, doctor, logging, quality, record, recording, replay, synth};
use clap::error::ErrorKind;
use clap::{CommandFactory, Parser};
use common::manual;
use common::sentence::{complain, of_causes, of_paragraphs, print};

/// How it calls itself.
const PROGRAM: &str = "sward-capture";
/// Anything that prevents running.
const FAILED: u8 = 1;
/// Bad arguments or configuration.
const BAD_ARGUMENTS: u8 = 2;
/// A recording that is missing or from which not one frame can be read.
const BAD_RECORDING: u8 = 3;
/// A sensor that cannot be opened.
const BAD_SENSOR: u8 = 4;

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return refuse_arguments(&error),
    };
    logging::start();
    match perform(&cli.verb) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            complain(PROGRAM, &of_causes(error.chain()));
            ExitCode::from(exit_code(&error))
        }
    }
}

fn perform(verb: &Verb) -> anyhow::Result<()> {
    match verb {
        Verb::Run(args) => daemon::run(args),
        Verb::Replay(args) => replay::replay(args, &replay::configure(args)?),
        Verb::Synth(args) => {
            let mut paths = String::new();
            for path in synth::run(args)? {
                paths += &format!("{}\n", path.display());
            }
            Ok(print(&paths)?)
        }
        Verb::Info(args) => {
            let info = recording::info(&args.recording, &load(&args.config)?.open_options())?;
            let text = if args.json { format!("{}\n", info.to_json()) } else { info.to_string() };
            Ok(print(&text)?)
        }
        Verb::Recover(args) => {
            let recovered = recording::recover(&args.recording, &args.out)?;
            if let Some(first) = recovered.damage.first() {
                let places = recovered.damaged_places;
                let path = args.recording.display();
                tracing::warn!(places, "{path}: {first}; what is whole is rewritten");
            }
            let (messages, images) = (recovered.messages, recovered.images);
            Ok(print(&format!("{}: {messages} messages, {images} of them images\n", args.out.display()))?)
        }
        Verb::Record(args) => record::record(args, &load(&args.config)?),
        Verb::Recordings(verb) => client::recordings(verb),
        Verb::Quality(args) => quality::quality(args, &load(&args.config)?),
        Verb::Devices(args) => devices::devices(args),
        Verb::SensorProcess { order } => host::work(order),
        Verb::CheckConfig(args) => {
            let (_, warnings) = config::check(args.config.as_deref(), &args.sets)?;
            for warning in warnings {
                tracing::warn!("{warning}");
            }
            Ok(())
        }
        Verb::Status(args) => client::status(args),
        Verb::Preview(args) => client::preview(args),
        Verb::Doctor(args) => doctor::doctor(args),
        Verb::Reload(args) => client::reload(args),
        Verb::Blades(verb) => client::blades(verb),
        Verb::Completions { shell } => Ok(print(&manual::completions(Cli::command(), *shell))?),
        Verb::Man { folder } => {
            let mut pages = manual::pages(Cli::command())?;
            pages.push(config::manual::page());
            let paths = manual::write_pages(folder, &pages)?;
            Ok(print(&paths.iter().map(|path| format!("{}\n", path.display())).collect::<String>())?)
        }
    }
}

fn load(args: &ConfigArgs) -> anyhow::Result<Config> {
    Ok(config::load(args.config.as_deref(), &args.sets)?)
}

fn exit_code(error: &anyhow::Error) -> u8 {
    let refused = error.downcast_ref::<ClientError>();
    let no_source = matches!(error.downcast_ref(), Some(RecordError::NoSource));
    if no_source
        || error.is::<ConfigError>()
        || error.is::<synth::ClipParamsError>()
        || refused.is_some_and(ClientError::is_bad_argument)
    {
        BAD_ARGUMENTS
    } else if error.is::<recording::OpenError>()
        || matches!(error.downcast_ref(), Some(recording::RecoverError::Open(_)))
    {
        BAD_RECORDING
    } else if error.is::<DevicesError>() || matches!(error.downcast_ref(), Some(RecordError::Sensor(_))) {
        BAD_SENSOR
    } else {
        FAILED
    }
}

/// One sentence for what clap says in a paragraph.
fn refuse_arguments(error: &clap::Error) -> ExitCode {
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => match print(&error.to_string()) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                complain(PROGRAM, &format!("{error}."));
                ExitCode::from(FAILED)
            }
        },
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand | ErrorKind::MissingSubcommand => {
            let (name, command) = manual::verb_of(&Cli::command(), std::env::args_os().skip(1));
            let verbs: Vec<&str> = command.get_subcommands().map(clap::Command::get_name).take(2).collect();
            let verbs = verbs.join(" or ");
            complain(
                PROGRAM,
                &format!("no verb was given, expected one such as {verbs}; see {name} --help."),
            );
            ExitCode::from(BAD_ARGUMENTS)
        }
        _ => {
            let (name, _) = manual::verb_of(&Cli::command(), std::env::args_os().skip(1));
            let sentence = of_paragraphs(&error.to_string());
            complain(PROGRAM, &format!("{sentence}; see {name} --help."));
            ExitCode::from(BAD_ARGUMENTS)
        }
    }
}
