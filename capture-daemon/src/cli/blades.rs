//! The arguments of `blades`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Subcommand;

use super::{ListArgs, StationArgs};

/// What to do with blades.
#[derive(Debug, Subcommand)]
pub enum BladesVerb {
    /// A line for each blade, in the library's order; then the files that are none, with the reason
    ///
    /// Example: sward-capture blades list --json
    List(ListArgs),
    /// All that is known of a blade, and of the blades that had its name before
    ///
    /// The history says what `restore` can bring back, the newest first: what was replaced, had another weight, was
    /// renamed or removed, or went to the archive.
    ///
    /// Example: sward-capture blades show blade-12ab34cd
    Show {
        /// Name of the blade
        name: String,
        /// Which station, and in what form.
        #[command(flatten)]
        list: ListArgs,
    },
    /// Give a blade a name that no other has; `restore` of the old name undoes it
    ///
    /// Example: sward-capture blades rename blade-12ab34cd fern
    Rename {
        /// Name of the blade
        name: String,
        /// Its new name: 1 to 48 bytes, no slash, no dot or space at its beginning
        new_name: String,
        /// Which station.
        #[command(flatten)]
        station: StationArgs,
    },
    /// Take a blade out of the library; `restore` brings it back
    ///
    /// Nothing else does: a blade that was removed is not captured again, so that a recording that begins anew does not
    /// bring it back.
    ///
    /// Example: sward-capture blades remove fern
    Remove {
        /// Name of the blade
        name: String,
        /// Which station.
        #[command(flatten)]
        station: StationArgs,
    },
    /// Go back to an earlier blade of a name: undo a removal, a swap, a weight or a renaming
    ///
    /// A blade that was removed, replaced (by a file or an import), weighted otherwise or sent to the archive comes
    /// back as it was, with its weight. One that was renamed gets this name back, and is else as it is now. What
    /// has the name meanwhile goes to the history, so that the same command again undoes this one. Up to 16 blades
    /// of a name are kept; `show` lists them.
    ///
    /// With --all, every blade comes back whose name no blade has now: of a folder that was emptied, all.
    ///
    /// Example: sward-capture blades restore fern --back 2
    Restore {
        /// Name that the blade had
        #[arg(required_unless_present = "all")]
        name: Option<String>,
        /// How many blades to go back, 1 to 100, as `show` counts them
        #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = back)]
        back: i64,
        /// All that was removed, by whatever way, and is not there again
        #[arg(long, conflicts_with_all = ["name", "back"])]
        all: bool,
        /// Of these, what went within the last so many seconds, 0 to 1000000000
        #[arg(long, value_name = "S", requires = "all", conflicts_with = "name", value_parser = seconds)]
        since: Option<Duration>,
        /// Which station.
        #[command(flatten)]
        station: StationArgs,
    },
    /// Write blades into a file for other programs: outlines as .svg, meshes as .glb
    ///
    /// An SVG shows them pressed flat, side by side and true to scale, to be redrawn and imported again; a
    /// GLB (glTF 2.0) holds them as they hang, in metres.
    ///
    /// Example: sward-capture blades export blades.svg fern moss
    Export {
        /// The file, .svg or .glb; one that is there is replaced
        file: PathBuf,
        /// Names of the blades [default: all]
        names: Vec<String>,
        /// Which station.
        #[command(flatten)]
        station: StationArgs,
    },
    /// Put blades into the library that someone has drawn: outlines in an .svg, or a blade's own .toml
    ///
    /// Where one of several is refused, the others are put there nevertheless.
    ///
    /// Each closed path of a drawing is a blade, upright with its root at the bottom; an open path inside
    /// whose id begins with `midrib` is its midrib. A blade has one width to each side at every place of its midrib: teeth
    /// and lobes become what is most like them so, and what they become, and how like, is said. A blade is called, in this order, by an id that somebody gave its
    /// path, by the path's `inkscape:label`, by its `<title>`, by an id that a drawing program made up (`path846`), by
    /// the group around it; the second of a name in one drawing gets `-2` behind it. A blade that has the name
    /// already is replaced, and `restore` goes back to it. A .toml that is a copy of another blade's gets an id of its
    /// own.
    ///
    /// Example: sward-capture blades import fern.svg --length-mm 180
    Import {
        /// The file, .svg or .toml
        file: PathBuf,
        /// Name of the blade, 1 to 48 bytes, where the file holds a single one [default: as in the file]
        #[arg(long, allow_hyphen_values = true)]
        name: Option<String>,
        /// Length of each midrib, millimetres, 1 to 10000 [default: as drawn]
        #[arg(long, value_name = "MM", allow_negative_numbers = true, value_parser = length_mm)]
        length_mm: Option<f32>,
        /// Which station.
        #[command(flatten)]
        station: StationArgs,
    },
    /// Set how often a blade stands in the meadow, relative to the others; `restore` goes back to the weight before
    ///
    /// Example: sward-capture blades mix fern 2.5
    Mix {
        /// Name of the blade
        name: String,
        /// Weight of the blade, times that of the others, 0, or 1e-30 to 1000000; all have 1 at first
        #[arg(allow_negative_numbers = true, value_parser = weight)]
        weight: f64,
        /// Which station.
        #[command(flatten)]
        station: StationArgs,
    },
}

fn length_mm(text: &str) -> Result<f32, String> {
    let length: f32 = text.parse().map_err(|_| "expected a number".to_owned())?;
    if (1.0..=10_000.0).contains(&length) { Ok(length) } else { Err("expected 1 to 10000".to_owned()) }
}

fn back(text: &str) -> Result<i64, String> {
    let back = text.parse().ok().filter(|back| (1..=100).contains(back));
    back.ok_or_else(|| "expected a whole number of 1 to 100".to_owned())
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.0..=1e9).contains(seconds));
    seconds.map(Duration::from_secs_f64).ok_or_else(|| "expected a number of 0 to 1000000000".to_owned())
}

fn weight(text: &str) -> Result<f64, String> {
    // Its range is the station's to say.
    text.parse().map_err(|_| "expected 0, or a number of 1e-30 to 1000000".to_owned())
}
