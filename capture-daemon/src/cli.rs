//! The command line of `sward-capture`.

mod blades;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use common::manual::Shell;

pub use self::blades::BladesVerb;
use crate::client::RecordingsVerb;
use crate::quality::QualityArgs;
use crate::record::RecordArgs;

/// Captures grass blades from a depth camera or a recording and offers them as a library
///
/// Every key of the configuration is documented in the man page capture-daemon.toml(5), which the verb `man`
/// writes with the others.
///
/// Exit code 0: done; 1: something prevents running; 2: bad arguments or configuration; 3: a recording that is
/// missing or from which not one frame can be read; 4: a sensor that cannot be opened.
///
/// Example: sward-capture replay recordings/row-3.mcap
#[derive(Debug, Parser)]
#[command(name = "sward-capture", version, max_term_width = 100, subcommand_value_name = "VERB")]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Run the capture station until SIGTERM or SIGINT
    ///
    /// Streams the sensor that `sensor.driver` names, or plays `source.recording` as one, and offers the library on
    /// `service.socket`. A sensor that is missing or fails is tried again for ever. The second of these
    /// signals ends it at once. SWARD_LOG says what is logged: error, warn, info (the default), debug or trace.
    ///
    /// Exit code 0: it was asked to end; 1: something prevents running, such as a socket in use; 2: bad
    /// arguments or configuration; 3: the recording is missing or not one frame of it can be read.
    ///
    /// Example: sward-capture run --set 'source.recording="recordings/row-3.mcap"'
    Run(ConfigArgs),
    /// Pass a recording through the pipeline of `run`, on the recording's own time
    ///
    /// A recording of a live run (`record`, `recordings start`) brings the configuration that it was made under, which
    /// holds where no file is given with --config, and gives the same blades as the live run, bit for bit.
    ///
    /// Exit code 0: done, also when nothing was found; 2: bad arguments or configuration; 3: the
    /// recording is missing or not one frame of it can be read.
    ///
    /// Example: sward-capture replay recordings/row-3.mcap --json --explain /tmp/steps
    Replay(ReplayArgs),
    /// Write synthetic recordings with their truth
    ///
    /// Prints the path of each recording.
    ///
    /// Exit code 0: done; 1: a file cannot be written; 2: bad arguments.
    ///
    /// Example: sward-capture synth --out /tmp/clips --seed 7 --family row --clips 3
    Synth(crate::synth::SynthArgs),
    /// Print what a recording holds: topics, frames, rate, camera, metadata, damage
    ///
    /// Reads it to its end.
    ///
    /// Exit code 0: done; 2: bad arguments or configuration; 3: the recording is
    /// missing or not one frame of it can be read.
    ///
    /// Example: sward-capture info recordings/row-3.mcap --json
    Info(InfoArgs),
    /// List the sensors that are plugged in, with their modes
    ///
    /// Those of OpenNI2 and of V4L2. What `sensor.device` may say: the serial number, the URI, any of the names, or the port,
    /// which stands in the URI of OpenNI2 behind the @.
    ///
    /// Exit code 0: done, also when there is none, or one of the two is not there, which is warned of; 2: bad arguments
    /// or configuration; 4: the driver that `sensor.driver` names is not there, or refuses.
    ///
    /// Example: sward-capture devices --json
    Devices(DevicesArgs),
    /// Stream a sensor, or play a recording of OpenNI2, for the station that starts this
    ///
    /// Example: sward-capture sensor-process ORDER
    #[command(hide = true)]
    SensorProcess {
        /// What to do, as TOML
        order: String,
    },
    /// Record a sensor into an MCAP file, and say what is captured meanwhile
    ///
    /// Opens the sensor that `sensor.driver` names, or plays `source.recording` in its place, without a station; one that
    /// runs records by `recordings start`. A replay of the file captures the same, bit for bit. The file can be read up to
    /// the last second however this ends.
    ///
    /// Exit code 0: done; 1: OUT exists, or cannot be written; 2: bad arguments or configuration; 3: the recording that is
    /// to be played is missing or not one frame of it can be read; 4: the sensor cannot be opened.
    ///
    /// Example: sward-capture record leaf.mcap --seconds 10 --set 'sensor.driver="openni2"'
    Record(RecordArgs),
    /// Start and stop recordings of the station that runs, save the last seconds, and keep what was recorded
    ///
    /// Recordings are files in `record.directory`, which replay, info and others read. Those that are not pinned go by age
    /// and size, as `[record]` of the configuration says.
    ///
    /// Exit code 0: done; 1: no station answers, or it refuses; 2: bad arguments or configuration.
    ///
    /// Example: sward-capture recordings list
    #[command(subcommand)]
    Recordings(RecordingsVerb),
    /// Measure whether a sensor, or a recording, sees well enough for blades
    ///
    /// For whoever mounts the camera, and before opening hours: how many pixels have a reading, how far readings lie from
    /// a plane through their neighbours and how much they change from frame to frame (both as they are at the distance at
    /// which blades are held), how many pixels there are across a narrow blade, how many frames come, and how many are of no
    /// use. Each passes or fails, with what to do. Best done with nobody before the camera; nothing is captured.
    ///
    /// Exit code 0: all is well; 1: something is not; 2: bad arguments or configuration; 3: the recording is missing or not
    /// one frame of it can be read; 4: the sensor cannot be opened.
    ///
    /// Example: sward-capture quality --set 'sensor.driver="openni2"' --blade-width-mm 4
    Quality(QualityArgs),
    /// Rewrite a recording that was cut short into a whole one
    ///
    /// Every whole message is kept, with its topic, times, metadata and attachments.
    ///
    /// Exit code 0: done; 1: OUT exists or cannot be written; 3: the recording is missing or holds not one
    /// image.
    ///
    /// Example: sward-capture recover torn.mcap mended.mcap
    Recover(RecoverArgs),
    /// Check a configuration
    ///
    /// Says nothing if it is valid, else what is wrong with file, line and column, and what was expected. Warns of users
    /// and groups in `service.watch` and `service.change` that this machine does not know: where the station is to
    /// run they may be known.
    ///
    /// Exit code 0: it is valid; 2: it is not.
    ///
    /// Example: sward-capture check-config --config /etc/sward/capture-daemon.toml
    CheckConfig(ConfigArgs),
    /// Say what the station that runs is doing: its state, its rates, what it dropped, its library and store
    ///
    /// Exit code 0: it runs; 1: it does not answer, or refuses; 2: bad arguments or configuration.
    ///
    /// Example: sward-capture status --watch
    Status(StatusArgs),
    /// Draw what the station that runs sees, and say what it tells the visitor
    ///
    /// For whoever mounts the camera. Depth is the brighter the nearer, red before the depth window and blue behind
    /// it; what is seen within has a light border, hands are brown, contours yellow, and a captured blade has its
    /// midrib and its widths, with a dot at its root. Exit code 0: done; 1: no station answers, it refuses, or the
    /// picture cannot be written; 2: bad arguments or configuration.
    ///
    /// Example: sward-capture preview seen.png
    Preview(PreviewArgs),
    /// Have the station that runs read its configuration again
    ///
    /// Names the keys that changed, and those that wait for a restart. The station reads the file that it was started
    /// with: another one, and other keys than `service.socket` with --set, are refused.
    ///
    /// Exit code 0: done; 1: no station answers, or it refuses; 2: the configuration is not valid, and the
    /// old one stays.
    ///
    /// Example: sward-capture reload
    Reload(StationArgs),
    /// Check everything on this machine that a station needs, and say what to do
    ///
    /// Configuration, recording, store and disk, socket and who may use it, limits, clock, systemd's units,
    /// sensors, and the station that runs. Changes nothing but for a file that it writes to the store and
    /// removes again.
    ///
    /// Exit code 0: nothing is wrong; 1: something is; 2: bad arguments.
    ///
    /// Example: sward-capture doctor --config /etc/sward/capture-daemon.toml
    Doctor(DoctorArgs),
    /// Show and change the blades of the station that runs
    ///
    /// Exit code 0: done; 1: no station answers, or it refuses; 2: bad arguments or configuration.
    ///
    /// Example: sward-capture blades list
    #[command(subcommand)]
    Blades(BladesVerb),
    /// Print a script that completes this command line in a shell
    ///
    /// Packages put it into /usr/share/bash-completion/completions/sward-capture,
    /// /usr/share/zsh/vendor-completions/_sward-capture and
    /// /usr/share/fish/vendor_completions.d/sward-capture.fish.
    ///
    /// Example: sward-capture completions bash
    Completions {
        /// Which shell
        shell: Shell,
    },
    /// Write the man pages of all verbs and of the configuration into a folder
    ///
    /// Prints the path of each. Packages put those that end with .1 into /usr/share/man/man1/, the one that ends
    /// with .5 into /usr/share/man/man5/.
    ///
    /// Exit code 0: done; 1: one cannot be written.
    ///
    /// Example: sward-capture man /tmp/man
    Man {
        /// The folder; made if it is not there
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
}

/// Which station to talk to.
#[derive(Debug, Args)]
pub struct StationArgs {
    /// The station's socket [default: service.socket of the configuration]
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// Configuration.
    #[command(flatten)]
    pub config: ConfigArgs,
}

/// What to say of the station.
#[derive(Debug, Args)]
pub struct StatusArgs {
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// One JSON object on stdout, as the interface defines it
    #[arg(long)]
    pub json: bool,
    /// Say it again every second, a line each, until interrupted
    #[arg(long)]
    pub watch: bool,
}

/// What to show of what the station sees.
#[derive(Debug, Args)]
pub struct PreviewArgs {
    /// The picture, a .png; one that is there is replaced [default: only the text on stdout]
    #[arg(value_name = "OUT.png", value_parser = png)]
    pub out: Option<PathBuf>,
    /// A line at each change of state, hold or message, until interrupted; the picture is drawn anew with each
    #[arg(long)]
    pub watch: bool,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
}

/// What to look after.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// The socket of the station to look at [default: service.socket of the configuration]
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// Configuration.
    #[command(flatten)]
    pub config: ConfigArgs,
    /// One JSON object on stdout, and nothing else there
    #[arg(long)]
    pub json: bool,
}

/// What to list.
#[derive(Debug, Args)]
pub struct ListArgs {
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// JSON on stdout, as the interface defines it
    #[arg(long)]
    pub json: bool,
}

/// Where the configuration comes from.
#[derive(Debug, Args)]
pub struct ConfigArgs {
    /// Configuration file (TOML); without it all keys have their defaults. See capture-daemon.toml(5)
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// One key of the configuration as TOML, over the file; text needs quotes; may be given again
    ///
    /// Example: --set mask.far_m=0.8 --set 'service.socket="/tmp/sward.sock"'
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
}

/// What to replay and how.
#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// An MCAP file, a rosbag2 folder, a folder of 16-bit PNGs with camera.toml, or an .oni file
    pub recording: PathBuf,
    /// Configuration; without a file, that which a recording of a live run was made under.
    #[command(flatten)]
    pub config: ConfigArgs,
    /// JSON Lines on stdout, and nothing else there
    #[arg(long)]
    pub json: bool,
    /// Write a picture of every stage of every capture into this folder
    #[arg(long, value_name = "DIR")]
    pub explain: Option<PathBuf>,
    /// Speed in times real time, above 0, 1000 at most [default: as fast as the stages are]
    #[arg(long, value_name = "R", conflicts_with = "realtime", allow_negative_numbers = true, value_parser = rate)]
    pub rate: Option<f64>,
    /// The same as --rate 1
    #[arg(long)]
    pub realtime: bool,
}

/// What to look at.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// An MCAP file, a rosbag2 folder, a folder of 16-bit PNGs with camera.toml, or an .oni file
    pub recording: PathBuf,
    /// Configuration.
    #[command(flatten)]
    pub config: ConfigArgs,
    /// One JSON object on stdout
    #[arg(long)]
    pub json: bool,
}

/// What to list.
#[derive(Debug, Args)]
pub struct DevicesArgs {
    /// Configuration.
    #[command(flatten)]
    pub config: ConfigArgs,
    /// One JSON list on stdout
    #[arg(long)]
    pub json: bool,
}

/// What to rewrite.
#[derive(Debug, Args)]
pub struct RecoverArgs {
    /// An MCAP file or a rosbag2 folder; it is only read
    pub recording: PathBuf,
    /// The MCAP file to write; nothing may be there yet
    pub out: PathBuf,
}

fn png(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let is_png = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
    if is_png { Ok(path) } else { Err("expected a name that ends with .png".to_owned()) }
}

fn rate(text: &str) -> Result<f64, String> {
    let rate: f64 = text.parse().map_err(|_| "expected a number".to_owned())?;
    if rate > 0.0 && rate <= 1000.0 {
        Ok(rate)
    } else {
        Err("expected more than 0 and at most 1000".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn every_verb_has_its_example_and_every_value_its_unit_and_range() {
        let command = Cli::command();
        assert_eq!(common::manual::faults(&command), Vec::<String>::new());
        command.debug_assert();
    }
}
