//! The command line.

use std::path::PathBuf;

use clap::Parser;
use common::library::layout::MAX_BLADES;
use common::manual::Shell;
use glam::Vec2;

use crate::bench::BenchArgs;
use crate::frame::View;
use crate::passes::cull::{Detail, NAIVE_TILES};
use crate::scene::camera::Camera;
use crate::scene::camera::path::Path;
use crate::scene::camera::views::NamedView;
use crate::scene::grassland::field::Field;
use crate::scene::sky;

/// Grows a meadow from the blades that the capture station has in its library
///
/// In a window, or as pictures. While no station answers, it shows the meadow that it had last and tries again.
///
/// In the window, 1 flies, 2 walks, 3 goes round a point, and 0 goes back to the window's own slow way. W A S D or
/// the arrows move, Space and C up and down, Shift faster; the mouse looks while a button is held, its wheel zooms. F
/// fills the screen, Esc closes the window. Whoever moves first flies.
///
/// Exit code 0: done; 1: something prevents drawing; 2: bad arguments.
///
/// Example: sward-render --fullscreen
///
/// Example: sward-render --library meadow.sward --size 1920x1080
///
/// Example: sward-render --headless --out pictures --frames 30 --wait-blades 1
#[derive(Clone, Debug, Parser)]
#[command(name = "sward-render", version, max_term_width = 100, args_conflicts_with_subcommands = true)]
pub struct Cli {
    /// Something else than to show the meadow
    #[command(subcommand)]
    pub verb: Option<Verb>,

    /// The capture station's socket; new blades grow as soon as they are captured
    #[arg(long, value_name = "PATH", env = "SWARD_SOCKET", default_value = "/run/sward/station.sock")]
    pub socket: PathBuf,

    /// A library snapshot to grow, in place of a station
    #[arg(long, value_name = "FILE")]
    pub library: Option<PathBuf>,

    /// Draw to PNG files and end, without a window; prints the path of each finished picture
    #[arg(long, requires = "out")]
    pub headless: bool,

    /// Folder for the pictures; made if it is not there
    #[arg(long, value_name = "DIR", requires = "headless")]
    pub out: Option<PathBuf>,

    /// Number of pictures, 1 or more, 1/30 s of the meadow's time apart
    #[arg(long, value_name = "N", default_value_t = 1, requires = "headless",
          value_parser = clap::value_parser!(u32).range(1..))]
    pub frames: u32,

    /// Size of the picture or window, columns and rows in pixels, each 16 to 8192
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse_size)]
    pub size: (u32, u32),

    /// Before the first picture, wait until the station's library holds so many blades, 0 to 4096
    #[arg(long, value_name = "N", default_value_t = 0, requires = "headless", conflicts_with = "library",
          value_parser = parse_blades)]
    pub wait_blades: usize,

    /// How long to wait for these blades, seconds, 0 to 1000000
    #[arg(long, value_name = "S", default_value_t = 30.0, requires = "headless", value_parser = parse_number)]
    pub timeout_secs: f32,

    /// Seconds of the meadow's time for each second, 0 to 1000000; 0 holds the wind and the camera's way still
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = parse_number)]
    pub time_scale: f32,

    /// Fill the screen
    #[arg(long, conflicts_with = "headless")]
    pub fullscreen: bool,

    /// Fill the screen without pointer, keys and mouse, and let the eye go slowly round; SIGTERM ends it
    #[arg(long, conflicts_with = "headless")]
    pub kiosk: bool,

    /// A view that has a name
    #[arg(long, value_name = "NAME", conflicts_with_all = ["eye_height_m", "heading_deg", "pitch_deg", "fov_deg"])]
    pub view: Option<NamedView>,

    /// Key frames that the eye glides along, 1 or more, some seconds apart: TOML as in renderer/docs/camera.md
    #[arg(long, value_name = "FILE", conflicts_with_all = ["view", "eye_height_m", "heading_deg", "pitch_deg", "fov_deg"],
          value_parser = read_path)]
    pub path: Option<Path>,

    /// Height of the eye above the ground, metres, 0 to 1000000
    #[arg(long, value_name = "M", default_value_t = 0.42, value_parser = parse_number)]
    pub eye_height_m: f32,

    /// Where the eye looks, degrees clockwise from -z seen from above, -360 to 360
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true, value_parser = parse_signed)]
    pub heading_deg: f32,

    /// Where the eye looks, degrees above the horizon, -360 to 360
    #[arg(long, value_name = "DEG", default_value_t = -7.0, allow_negative_numbers = true, value_parser = parse_signed)]
    pub pitch_deg: f32,

    /// Vertical field of view, degrees, 10 to 120
    #[arg(long, value_name = "DEG", default_value_t = 48.0, value_parser = parse_fov)]
    pub fov_deg: f32,

    /// The hour, true solar time of a day in late May at 48 degrees north, 00:00 to 23:59; -z is north
    #[arg(long, value_name = "HH:MM", conflicts_with = "sun_deg", value_parser = parse_hour)]
    pub time: Option<f32>,

    /// Where the sun stands: heading, -360 to 360, and elevation, 1 to 90, degrees
    #[arg(long, value_name = "DEG,DEG", default_value = "46,24", allow_hyphen_values = true, value_parser = parse_sun)]
    pub sun_deg: Vec2,

    /// Whether blades near the eye throw shadows on each other; auto: unless a window is drawn in software
    #[arg(long, value_name = "WHEN", value_enum, default_value_t = Shadows::Auto)]
    pub shadows: Shadows,

    /// A folder like renderer/src/passes whose shaders take the place of those built in, also when they change
    /// later; for development
    #[arg(long, value_name = "DIR")]
    pub shaders: Option<PathBuf>,

    /// Loses the window's surface or its device after so many frames, to see that it comes back. Example: --lose surface@40
    #[arg(long, value_name = "WHAT@FRAME", hide = true, value_parser = parse_loss)]
    pub lose: Vec<Loss>,

    /// Tiles of the field, each 18 cm along a side with 64 blades, 1 to 4000000000; the paper's field has 14926.
    /// Without it, the field has no end that can be seen
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4_000_000_000))]
    pub tiles: Option<u32>,

    /// Draw every blade of the field with 16 knots, as the paper does, to compare
    #[arg(long, requires = "tiles")]
    pub naive: bool,

    /// What a frame of the window may take, milliseconds, 0 to 1000: where it takes longer, less detail and fewer pixels
    /// are drawn; 0 draws all whatever it takes
    #[arg(long, value_name = "MS", default_value_t = 33.0, conflicts_with = "headless", value_parser = parse_budget)]
    pub budget_ms: f32,

    /// Print a script that completes this command line in a shell, and end
    #[arg(long, value_name = "SHELL", exclusive = true)]
    pub completions: Option<Shell>,

    /// Write the man page into this folder, which is made if it is not there, and end
    #[arg(long, value_name = "DIR", exclusive = true)]
    pub man: Option<PathBuf>,
}

/// What it does other than show the meadow.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Verb {
    /// Measure what a frame takes, pass by pass, beside the paper's scheme
    ///
    /// Minutes in software. Prints a table, or JSON.
    ///
    /// Exit code 0: done; 1: something prevents drawing; 2: bad arguments.
    ///
    /// Example: sward-render bench --library meadow.sward --json
    Bench(BenchArgs),
}

/// When blades throw shadows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Shadows {
    /// Unless a window is drawn in software
    Auto,
    /// Always
    On,
    /// Never
    Off,
}

impl Cli {
    /// Where grass grows.
    pub fn field(&self) -> Field {
        self.tiles.map_or(Field::ENDLESS, Field::of_tiles)
    }

    /// How much of it is drawn.
    ///
    /// # Errors
    /// When the field has more tiles than can be drawn naively.
    pub fn detail(&self) -> anyhow::Result<Detail> {
        if self.naive && self.tiles.is_some_and(|tiles| tiles > NAIVE_TILES) {
            anyhow::bail!("--naive draws at most {NAIVE_TILES} tiles; give fewer with --tiles");
        }
        Ok(Detail { naive: self.naive, ..Detail::default() })
    }

    /// The view at `time_s` seconds of the meadow's time.
    pub fn view(&self, time_s: f32) -> View {
        let sun_rad = match self.time {
            Some(hour) => sky::sun_at_hour(hour),
            None => Vec2::new(self.sun_deg.x.to_radians(), self.sun_deg.y.to_radians()),
        };
        // Where the field has no end, the named views look at the part of it that is as large as the paper's.
        let looked_at = Field::of_tiles(self.tiles.unwrap_or(Field::PAPER_TILES));
        let camera = match (&self.path, self.view) {
            (Some(path), _) => path.at(time_s),
            (None, Some(view)) => view.camera(2.0 * looked_at.edge().y, sun_rad.x),
            (None, None) => Camera {
                foot: Vec2::ZERO,
                eye_height_m: self.eye_height_m,
                heading_rad: self.heading_deg.to_radians(),
                pitch_rad: self.pitch_deg.to_radians(),
                fov_y_rad: self.fov_deg.to_radians(),
            },
        };
        View { camera, time_s, sun_rad }
    }
}

pub(crate) fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let side = |text: &str| text.parse().ok().filter(|side| (16..=8192).contains(side));
    let (width, height) = text.split_once('x').unwrap_or_default();
    side(width).zip(side(height)).ok_or_else(|| "expected WxH, each 16 to 8192, as in 1280x720".into())
}

fn number_in(text: &str, range: std::ops::RangeInclusive<f32>) -> Result<f32, String> {
    let number = text.parse().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| format!("expected a number from {} to {}", range.start(), range.end()))
}

fn parse_blades(text: &str) -> Result<usize, String> {
    let blades = text.parse().ok().filter(|blades| *blades <= MAX_BLADES);
    blades.ok_or_else(|| format!("expected a whole number from 0 to {MAX_BLADES}"))
}

fn parse_number(text: &str) -> Result<f32, String> {
    number_in(text, 0.0..=1e6)
}

fn parse_budget(text: &str) -> Result<f32, String> {
    number_in(text, 0.0..=1000.0)
}

fn parse_signed(text: &str) -> Result<f32, String> {
    number_in(text, -360.0..=360.0)
}

fn parse_fov(text: &str) -> Result<f32, String> {
    number_in(text, 10.0..=120.0)
}

fn parse_sun(text: &str) -> Result<Vec2, String> {
    let (heading, elevation) = text.split_once(',').ok_or("expected heading and elevation, as in 34,30")?;
    Ok(Vec2::new(parse_signed(heading)?, number_in(elevation, 1.0..=90.0)?))
}

/// What a test takes from a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// Its surface, at this frame.
    Surface(u64),
    /// The device that draws to it, at this frame.
    Device(u64),
}

fn parse_loss(text: &str) -> Result<Loss, String> {
    let (what, frame) = text.split_once('@').ok_or("expected WHAT@FRAME")?;
    let frame = frame.parse().map_err(|_| "expected the number of a frame")?;
    match what {
        "surface" => Ok(Loss::Surface(frame)),
        "device" => Ok(Loss::Device(frame)),
        _ => Err("expected surface or device".into()),
    }
}

fn parse_hour(text: &str) -> Result<f32, String> {
    let part = |text: &str, below: u8| text.parse::<u8>().ok().filter(|part| *part < below).map(f32::from);
    let (hour, minute) = text.split_once(':').unwrap_or_default();
    let hour = part(hour, 24).zip(part(minute, 60)).map(|(hour, minute)| hour + minute / 60.0);
    hour.ok_or_else(|| "expected HH:MM, 00:00 to 23:59, as in 07:30".into())
}

fn read_path(file: &str) -> Result<Path, String> {
    let text = std::fs::read_to_string(file).map_err(|error| error.to_string())?;
    Path::parse(&text).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_has_its_unit_and_range() {
        use clap::CommandFactory;
        let command = Cli::command();
        assert_eq!(common::manual::faults(&command), Vec::<String>::new());
        command.debug_assert();
    }

    #[test]
    fn wrong_values_are_refused() {
        let parse = |args: &[&str]| Cli::try_parse_from(["sward-render"].iter().chain(args));
        assert_eq!(parse(&["--size", "640x480"]).expect("valid").size, (640, 480));
        assert_eq!(parse(&["--pitch-deg", "-90"]).expect("valid").pitch_deg, -90.0);
        assert_eq!(parse(&["--time", "07:30"]).expect("valid").time, Some(7.5));
        assert!(parse(&["--view", "against-sun", "--time", "19:00"]).is_ok());
        for args in [
            &["--size", "640"][..],
            &["--size", "0x480"],
            &["--fov-deg", "NaN"],
            &["--sun-deg", "10,-5"],
            &["--headless"],
            &["--time", "24:00"],
            &["--time", "noon"],
            &["--time", "7:30", "--sun-deg", "10,20"],
            &["--view", "below"],
            &["--view", "edge", "--fov-deg", "40"],
            &["--path", "no such file"],
            &["--kiosk", "--headless", "--out", "d"],
            &["--frames", "2"],
            &["--headless", "--out", "d", "--frames", "0"],
            &["--headless", "--out", "d", "--library", "f", "--wait-blades", "1"],
            &["--headless", "--out", "d", "--wait-blades", "4097"],
            &["--completions", "bash", "--fullscreen"],
            &["--tiles", "0"],
            &["--naive"],
            &["--budget-ms", "-1"],
        ] {
            assert!(parse(args).is_err(), "{args:?}");
        }
    }
}
