//! `sward-render bench`: what a frame takes, pass by pass, of the paper's scheme and of ours in turn, of fields from
//! a million to a thousand million blades; how near ours is to the paper's picture; what a change of library and
//! a step of the camera show.

mod report;
mod stand;
mod swap;
mod walk;

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;
use glam::Vec2;

use crate::cli::parse_size;
use crate::frame::View;
use crate::headless::{self, write_picture};
use crate::passes::cull::Detail;
use crate::scene::camera::Camera;
use crate::scene::grassland::field::Field;
use report::{Report, Scene};
use stand::Stand;

/// Tiles of the larger fields, of 1 M to 1 G blades.
const FIELD_TILES: [u32; 4] = [15_625, 156_250, 1_562_500, 15_625_000];

/// What to measure
#[derive(Clone, Debug, Args)]
pub struct BenchArgs {
    /// A library snapshot to grow
    #[arg(long, value_name = "FILE")]
    pub library: PathBuf,

    /// Size of the pictures, columns and rows in pixels, each 16 to 8192
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse_size)]
    pub size: (u32, u32),

    /// Frames of each scene, 1 to 1000; the naive scheme draws no more than 2 of them
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub frames: u32,

    /// Changes of the library to look at, of 256 blades each, a whole number from 0 to 1000
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(0..=1000))]
    pub swaps: u32,

    /// Steps of the camera to look at, each between two frames, a whole number from 0 to 1000
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(0..=1000))]
    pub steps: u32,

    /// Leave the naive scheme out, which takes seconds a frame in software
    #[arg(long)]
    pub skip_naive: bool,

    /// Keep the pictures of the scenes in this folder, which is made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// Print JSON in place of a table
    #[arg(long)]
    pub json: bool,
}

/// The eye 1.7 m above a field's edge, looking over it: more than half of the paper's field is in sight.
pub fn edge(field: &Field) -> View {
    View {
        camera: Camera {
            foot: field.edge(),
            eye_height_m: 1.7,
            heading_rad: 0.0,
            pitch_rad: -10_f32.to_radians(),
            fov_y_rad: 60_f32.to_radians(),
        },
        time_s: 0.0,
        sun_rad: Vec2::new(46_f32.to_radians(), 24_f32.to_radians()),
    }
}

/// Measures, and prints what was found.
///
/// # Errors
/// No device, or one without a clock; a library that is refused or empty; a picture that cannot be written.
pub fn run(args: &BenchArgs) -> anyhow::Result<()> {
    let library = headless::read_library(&args.library)?;
    if library.is_empty() {
        bail!("the library {} has no blade: nothing would grow", args.library.display());
    }
    if let Some(out) = &args.out {
        std::fs::create_dir_all(out)
            .with_context(|| format!("cannot make the folder {} for the pictures", out.display()))?;
    }
    let keep = |name: &str, pixels: &[u8]| -> anyhow::Result<()> {
        if let Some(out) = &args.out {
            write_picture(&out.join(format!("{name}.png")), args.size, pixels)?;
        }
        Ok(())
    };
    let paper = Field::of_tiles(Field::PAPER_TILES);
    let view = edge(&paper);
    let mut ours = Stand::open(args.size)?;
    ours.meadow.plant(&ours.gpu, &library);
    ours.meadow.lay_out(paper);
    let mut scenes = Vec::new();
    let mut naive_picture = None;
    if args.skip_naive {
        scenes.push(scene(&ours, "paper's field", &paper, &view, args.frames)?);
    } else {
        let mut naive = Stand::open(args.size)?;
        naive.meadow.plant(&naive.gpu, &library);
        naive.meadow.lay_out(paper);
        naive.meadow.set_detail(&naive.gpu, Detail { naive: true, ..Detail::default() });
        let mut pair = [Scene::new("paper's field, naive", &paper), Scene::new("paper's field", &paper)];
        // In turn, so that a busy machine slows both; the first frames warm up.
        for round in 0..=args.frames {
            if round <= 2 {
                naive_picture = Some(naive.measure(&view, (round > 0).then_some(&mut pair[0]))?);
            }
            ours.measure(&view, (round > 0).then_some(&mut pair[1]))?;
        }
        keep("naive", naive_picture.as_deref().unwrap_or_default())?;
        scenes.extend(pair);
    }
    let picture = ours.measure(&view, None)?;
    keep("ours", &picture)?;
    let flip_to_naive = naive_picture.map(|naive| flip(args.size, &naive, &picture));
    for tiles in FIELD_TILES {
        let field = Field::of_tiles(tiles);
        ours.meadow.lay_out(field);
        // The camera stays; the field grows beyond what it saw.
        let name = format!("{:.0e} blades", field.blades() as f64);
        scenes.push(scene(&ours, &name, &field, &view, args.frames)?);
        keep(&format!("field-{tiles}"), &ours.measure(&view, None)?)?;
    }
    let report = Report {
        adapter: ours.adapter(),
        size: args.size,
        scenes,
        flip_to_naive,
        walk: (args.steps > 0).then(|| walk::measure(&library, args.steps)).transpose()?,
        swap: (args.swaps > 0).then(|| swap::measure(&library, args.swaps)).transpose()?,
    };
    let text = if args.json { serde_json::to_string_pretty(&report)? + "\n" } else { report.to_string() };
    write!(std::io::stdout(), "{text}").context("cannot write to stdout")
}

fn scene(stand: &Stand, name: &str, field: &Field, view: &View, frames: u32) -> anyhow::Result<Scene> {
    let mut scene = Scene::new(name, field);
    stand.measure(view, None)?;
    for _ in 0..frames {
        stand.measure(view, Some(&mut scene))?;
    }
    Ok(scene)
}

/// How different two pictures of 4 bytes a pixel look, 0 to 1: the mean of FLIP, as seen from 0.7 m on a display of
/// 3840 pixels on 0.7 m.
///
/// # Source
/// Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", 2020.
fn flip(size: (u32, u32), reference: &[u8], picture: &[u8]) -> f32 {
    flip_of(size, reference, picture).mean()
}

/// The difference of all but the most different thousandth of the pixels is at most this, 0 to 1: what pops is few
/// pixels, and would not show in the mean.
fn flip_of_worst(size: (u32, u32), reference: &[u8], picture: &[u8]) -> f32 {
    flip_of(size, reference, picture).get_percentile(0.999, false)
}

fn flip_of(size: (u32, u32), reference: &[u8], picture: &[u8]) -> nv_flip::FlipPool {
    let image = |pixels: &[u8]| {
        let rgb: Vec<u8> = pixels.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
        nv_flip::FlipImageRgb8::with_data(size.0, size.1, &rgb)
    };
    let map = nv_flip::flip(image(reference), image(picture), nv_flip::DEFAULT_PIXELS_PER_DEGREE);
    nv_flip::FlipPool::from_image(&map)
}
