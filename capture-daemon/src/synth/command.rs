//! The verb `synth`: clips and their truth as files.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use super::clip::{Clip, ClipParams, ClipParamsError};
use super::scene::{FAMILIES, Family, Scene};
use super::truth::Truth;
use crate::config::Config;
use crate::recording::{McapWriter, PngWriter, RecordingParams, WriteError};

/// Form of the recordings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// One MCAP file each, with ROS 2 messages.
    #[default]
    Mcap,
    /// One folder of 16-bit PNGs each.
    Png,
}

/// Which scenes to film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Families {
    /// Each family in turn.
    All,
    /// One of them.
    Only(Family),
}

impl clap::ValueEnum for Families {
    fn value_variants<'a>() -> &'a [Self] {
        static VARIANTS: std::sync::LazyLock<Vec<Families>> = std::sync::LazyLock::new(|| {
            FAMILIES.into_iter().map(Families::Only).chain([Families::All]).collect()
        });
        &VARIANTS
    }

    fn to_possible_value(&self) -> Option<clap::builder::PossibleValue> {
        match self {
            Families::All => Some(clap::builder::PossibleValue::new("all").help("Each family in turn")),
            Families::Only(family) => family.to_possible_value(),
        }
    }
}

/// Writes recordings of synthetic blades, each with its truth beside it.
#[derive(Clone, Debug, clap::Args)]
pub struct SynthArgs {
    /// Folder to write to; made if it is not there. Example: --out clips
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Seed of the first clip of each family; the next clips have the seeds after it. The same seed
    /// gives the same frames on every machine. Any whole number from 0 on. Example: --seed 42
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
    /// Family of the scenes; may be given more than once or as a list. Example: --family single,row
    #[arg(long, value_name = "FAMILY", value_enum, value_delimiter = ',', default_value = "all")]
    pub family: Vec<Families>,
    /// Clips of each family, 1 to 100000. Example: --clips 5
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub clips: u64,
    /// Columns and rows in pixels, each 16 to 1280, and 1280x1024 pixels in all at most. Example: --size
    /// 512x424
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = parse_size)]
    pub size: (usize, usize),
    /// Errors of the sensor: 1 like a real one, 0 none, 10 at most. Example: --noise 0.5
    #[arg(long, value_name = "F", default_value_t = 1.0, value_parser = parse_noise, allow_negative_numbers = true)]
    pub noise: f64,
    /// Frames of each clip at 30 a second, 1 to 100000, the empty ones before and after included. Without it
    /// 45; 60 of a hand, 80 for each visitor of a kiosk. Example: --frames 60
    #[arg(long, value_name = "N", value_parser = parse_frames, allow_negative_numbers = true)]
    pub frames: Option<usize>,
    /// Form of the recordings. The same clip in both forms has one truth. Example: --format png
    #[arg(long, value_name = "FORMAT", value_enum, default_value_t)]
    pub format: Format,
    /// Level of the MCAP files' zstd compression, 1 to 22; 0 is zstd's own default. 19 makes them 40 %
    /// smaller, slowly. Example: --compression-level 19
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(0..=22))]
    pub compression_level: u32,
}

/// `640x480` as columns and rows.
///
/// # Errors
/// What is wrong with it, in a sentence without its full stop.
pub fn parse_size(text: &str) -> Result<(usize, usize), String> {
    let sides =
        text.split_once('x').and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    let wrong = || format!("{text:?} is not a size; expected columns x rows in pixels, such as 640x480");
    let (width, height) = sides.ok_or_else(wrong)?;
    checked((width, height), ClipParams { width, height, ..ClipParams::default() })
}

fn parse_noise(text: &str) -> Result<f64, String> {
    let noise = text.parse().map_err(|_| format!("{text:?} is not a number; expected 0 to 10"))?;
    checked(noise, ClipParams { noise, ..ClipParams::default() })
}

fn parse_frames(text: &str) -> Result<usize, String> {
    let frames = text.parse().map_err(|_| format!("{text:?} is not a whole number; expected 1 to 100000"))?;
    checked(frames, ClipParams { frames, ..ClipParams::default() })
}

/// The value, if the parameters that it stands in are in their ranges.
fn checked<T>(value: T, params: ClipParams) -> Result<T, String> {
    params.check().map(|()| value).map_err(|error| error.to_string())
}

/// So many seeds from the first one on.
fn seeds(first: u64, clips: u64) -> Result<RangeInclusive<u64>, ClipParamsError> {
    match first.checked_add(clips.saturating_sub(1)) {
        Some(last) => Ok(first..=last),
        None => Err(ClipParamsError {
            what: "the last clip's seed",
            found: (u128::from(first) + u128::from(clips) - 1).to_string(),
            expected: "18446744073709551615 at most; give a smaller --seed or fewer --clips",
        }),
    }
}

/// Writes the clips that are asked for; the paths of their recordings.
///
/// # Errors
/// [`ClipParamsError`] when a parameter is out of its range or there are no seeds for so many
/// clips, anything else when a file cannot be written.
pub fn run(args: &SynthArgs) -> anyhow::Result<Vec<PathBuf>> {
    let (width, height) = args.size;
    let seeds = seeds(args.seed, args.clips)?;
    let params = ClipParams { width, height, noise: args.noise, ..ClipParams::default() };
    let wanted = |family| [Families::All, Families::Only(family)].iter().any(|it| args.family.contains(it));
    let mut paths = Vec::new();
    for family in FAMILIES.into_iter().filter(|&family| wanted(family)) {
        for seed in seeds.clone() {
            let scene = Scene::new(family, seed);
            let params = ClipParams { frames: args.frames.unwrap_or(scene.frames()), ..params };
            let clip = Clip::new(scene, params)?;
            paths.push(write(&args.out, &clip, args.format, args.compression_level)?);
        }
    }
    Ok(paths)
}

/// Writes a clip and its truth into a folder, which is made if it is not there: `single-1.mcap` (or a
/// folder `single-1`) and `single-1.truth.json` for seed 1 of the family `single`. The path of the
/// recording. `compression_level`: of an MCAP file, as in [`RecordingParams`].
///
/// The same clip in both forms has one truth. A truth never comes to stand beside a recording of the other form
/// that shows something else.
///
/// # Errors
/// When a file cannot be written, or the folder has another clip of this name in the other form.
pub fn write(out: &Path, clip: &Clip, format: Format, compression_level: u32) -> anyhow::Result<PathBuf> {
    const REMEDY: &str = "check the path, its permissions and the room on the disk";
    std::fs::create_dir_all(out)
        .with_context(|| format!("{}: the folder cannot be made; {REMEDY}", out.display()))?;
    let name = format!("{}-{}", clip.scene().family.name(), clip.scene().seed);
    let path = match format {
        Format::Mcap => out.join(format!("{name}.mcap")),
        Format::Png => out.join(&name),
    };
    let truth_path = out.join(format!("{name}.truth.json"));
    let truth = truth_of(clip)?;
    let other = match format {
        Format::Mcap => out.join(&name),
        Format::Png => out.join(format!("{name}.mcap")),
    };
    if other.exists() && std::fs::read_to_string(&truth_path).is_ok_and(|its| its != truth) {
        bail!(
            "{}: belongs to {}, which is another clip (of another size, noise or number of frames); give another --out",
            truth_path.display(),
            other.display()
        );
    }
    write_frames(&path, clip, format, compression_level).map_err(|error| match error {
        // It does not know where it is written to.
        WriteError::Mcap(_) => anyhow::Error::new(error).context(path.display().to_string()),
        named => named.into(),
    })?;
    let part = truth_path.with_extension("json.part");
    if let Err(error) = std::fs::write(&part, truth).and_then(|()| std::fs::rename(&part, &truth_path)) {
        let _gone = std::fs::remove_file(&part);
        return Err(error).context(format!("{}: cannot be written; {REMEDY}", truth_path.display()));
    }
    Ok(path)
}

/// The truth as it stands in its file.
fn truth_of(clip: &Clip) -> anyhow::Result<String> {
    let truth = serde_json::to_string(&Truth::of(clip)).context("the truth cannot be written as JSON")?;
    // One knot on a line: readable, and short.
    let truth = truth.replace("{\"camera_m\"", "\n{\"camera_m\"").replace("{\"shape\"", "\n{\"shape\"");
    Ok(truth.replace("{\"rotation\"", "\n{\"rotation\"") + "\n")
}

fn write_frames(path: &Path, clip: &Clip, format: Format, compression_level: u32) -> Result<(), WriteError> {
    match format {
        Format::Mcap => {
            let sensor = "Sward synthetic sensor".to_owned();
            let config = Config::default().to_toml();
            let params = RecordingParams { sensor, config, compression_level, ..RecordingParams::default() };
            // A clip that was cut short by a full disk never stands there under its name.
            let part = path.with_extension("mcap.part");
            let written = McapWriter::create(&part, params).and_then(|mut writer| {
                clip.frames().try_for_each(|frame| writer.write(&frame))?;
                writer.finish()
            });
            let refused = |source| WriteError::Io { path: path.to_owned(), source };
            if let Err(error) = written.and_then(|_| std::fs::rename(&part, path).map_err(refused)) {
                let _gone = std::fs::remove_file(&part);
                return Err(error);
            }
        }
        Format::Png => {
            if path.read_dir().is_ok_and(|mut entries| entries.next().is_some()) {
                return Err(WriteError::NotEmpty { path: path.to_owned() });
            }
            let part = path.with_extension("part");
            let _gone = std::fs::remove_dir_all(&part);
            let written = PngWriter::create(&part, clip.params().fps)
                .and_then(|mut writer| clip.frames().try_for_each(|frame| writer.write(&frame)));
            let refused = |source| WriteError::Io { path: path.to_owned(), source };
            if let Err(error) = written.and_then(|()| std::fs::rename(&part, path).map_err(refused)) {
                let _gone = std::fs::remove_dir_all(&part);
                return Err(error);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_end_at_the_largest_number() {
        assert_eq!(seeds(7, 3).expect("there are as many").collect::<Vec<_>>(), [7, 8, 9]);
        assert_eq!(seeds(u64::MAX, 1).expect("it is the last").count(), 1);
        let error = seeds(u64::MAX - 1, 3).expect_err("there are but two").to_string();
        assert!(error.contains("18446744073709551616") && error.contains("fewer --clips"), "{error}");
    }
}
