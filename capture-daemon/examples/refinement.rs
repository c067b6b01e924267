//! Writes how true refined blades are, a table and a picture: `refinement [folder]`, by default
//! `capture-daemon/docs`, gives `refinement.md` and `refinement.png` there.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::Context;
use capture_daemon::synth::refinement::{Fidelity, WAYS, Way, fidelity, skeletons};
use capture_daemon::synth::{SHAPES, Shape};
use common::blade::Knot;
use tiny_skia::{Color, FillRule, Paint, PathBuilder, Pixmap, Stroke, Transform};

/// Blades of each shape.
const BLADES: usize = 8;
/// Knots of the picture's rows.
const ROWS: [usize; 4] = [128, 64, 32, 16];
/// A field of the picture, pixels.
const FIELD: (f32, f32) = (170.0, 250.0);

fn main() -> anyhow::Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "capture-daemon/docs".to_owned()));
    std::fs::create_dir_all(&folder).with_context(|| format!("{} cannot be made", folder.display()))?;
    let text = format!("{HEAD}{}{FOOT}", table());
    std::fs::write(folder.join("refinement.md"), text).context("refinement.md cannot be written")?;
    picture()?.save_png(folder.join("refinement.png")).context("refinement.png cannot be written")?;
    println!("{}", folder.join("refinement.md").display());
    println!("{}", folder.join("refinement.png").display());
    Ok(())
}

const HEAD: &str = "\
# Refinement

A raw skeleton has 128 knots; the library and the meadow want 16 or fewer. This page is written by

    cargo run --release -p capture-daemon --example refinement

![Five shapes, each with 128, 64, 32 and 16 knots](refinement.png)

Columns: slim, lanceolate, elliptic, bamboo, sharp. Rows: the raw skeleton of 128 knots, then 64, 32 and
16 (`refine.method = \"fit\"`). Dots are knots.

Each number is the mean over eight blades, in millimetres: **at rest / carried / simulated**.

- *At rest*: Hausdorff distance of the midribs (Fan & Sheng, Eq. 4).
- *Carried*: every blade is simulated with all its vertices for two seconds in a gust that refinement has
  not seen; the few knots are carried along, and points at equal shares of the arc length are
  compared. The largest distance of all moments. This is what a viewer can see of refinement, and what
  counts here.
- *Simulated*: the same, but the few knots are simulated by themselves in that gust (with the links
  evened out, so that the stiffness of a chain of few links does not blur the picture).

";

const FOOT: &str = "
What it shows:

- The paper's merging (`refine.method = \"merge\"`) compares neighbours by their distance and by how much that
  distance varies. A blade hardly stretches, so it hardly varies, however much the two swing: whatever μ
  is, the closest neighbours are merged. That comes to a resampling whose gaps differ by
  up to two to one, with midpoints that cut the bends. What it buys is a chain of links
  that are never very long; it is not closer in motion than links of equal length.
- Douglas–Peucker is close at rest and farthest off in motion: it leaves out the foot, which is straight at
  rest and bends most in the wind. Even resampling has the same fault where it has few knots.
- Fitting (`refine.method = \"fit\"`, the default) keeps the vertices between which the blade is closest to
  straight stretches, at rest and in motion; μ (`refine.distance_weight`) weighs the two. With
  64 or 32 knots it pays for that with a few micrometres at rest.
";

fn table() -> String {
    let mut table = String::from("| shape | knots |");
    WAYS.iter().for_each(|way| write!(table, " {} |", way.name()).expect("text has room"));
    table += "\n|---|---|";
    table += &"---|".repeat(WAYS.len());
    table.push('\n');
    for shape in SHAPES {
        let skeletons = skeletons(shape, BLADES);
        for count in [64, 32, 16, 8] {
            write!(table, "| {} | {count} |", shape.name()).expect("text has room");
            for way in WAYS {
                write!(table, " {} |", mean(&skeletons, way, count)).expect("text has room");
            }
            table.push('\n');
        }
    }
    table
}

fn mean(skeletons: &[Vec<Knot>], way: Way, count: usize) -> String {
    let of = |skeleton: &Vec<Knot>| fidelity(skeleton, &way.refine(skeleton, count));
    let all: Vec<Fidelity> = skeletons.iter().map(of).collect();
    let mean = |of: fn(&Fidelity) -> f32| 1e3 * all.iter().map(of).sum::<f32>() / all.len() as f32;
    format!("{:.3} / {:.3} / {:.3}", mean(|f| f.hausdorff_m), mean(|f| f.carried_m), mean(|f| f.simulated_m))
}

fn picture() -> anyhow::Result<Pixmap> {
    let size = (FIELD.0 * SHAPES.len() as f32, FIELD.1 * ROWS.len() as f32);
    let mut pixmap = Pixmap::new(size.0 as u32, size.1 as u32).context("the picture has a size")?;
    pixmap.fill(Color::from_rgba8(250, 250, 247, 255));
    for (column, shape) in SHAPES.into_iter().enumerate() {
        let skeleton = first(shape);
        for (row, count) in ROWS.into_iter().enumerate() {
            let knots = Way::Fit.refine(&skeleton, count);
            draw(&mut pixmap, &knots, (FIELD.0 * column as f32, FIELD.1 * row as f32));
        }
    }
    Ok(pixmap)
}

fn first(shape: Shape) -> Vec<Knot> {
    skeletons(shape, 1).remove(0)
}

/// Draws a blade as the renderer expands it, seen from the front, into the field at `corner`.
fn draw(pixmap: &mut Pixmap, knots: &[Knot], corner: (f32, f32)) {
    let tips = knots.iter().flat_map(|knot| [knot.left(), knot.right()]);
    let (low, high) = tips.fold((glam::Vec3::INFINITY, glam::Vec3::NEG_INFINITY), |(low, high), point| {
        (low.min(point), high.max(point))
    });
    let extent = high - low;
    let zoom = ((FIELD.0 - 40.0) / extent.x).min((FIELD.1 - 30.0) / extent.y);
    let middle = 0.5 * (low + high);
    let at = |point: glam::Vec3| {
        let x = corner.0 + 0.5 * FIELD.0 + (point.x - middle.x) * zoom;
        (x, corner.1 + 0.5 * FIELD.1 - (point.y - middle.y) * zoom)
    };
    let mut outline = PathBuilder::new();
    let left = knots.iter().map(Knot::left);
    for (i, point) in left.chain(knots.iter().rev().map(Knot::right)).enumerate() {
        let (x, y) = at(point);
        if i == 0 { outline.move_to(x, y) } else { outline.line_to(x, y) }
    }
    outline.close();
    let mut dots = PathBuilder::new();
    for knot in knots {
        let (x, y) = at(knot.position);
        dots.push_circle(x, y, if knots.len() > 64 { 0.9 } else { 1.8 });
    }
    let paint =
        |color| Paint { shader: tiny_skia::Shader::SolidColor(color), anti_alias: true, ..Paint::default() };
    let (leaf, rim) = (Color::from_rgba8(150, 196, 112, 255), Color::from_rgba8(62, 104, 48, 255));
    let place = Transform::identity();
    if let Some(outline) = outline.finish() {
        pixmap.fill_path(&outline, &paint(leaf), FillRule::Winding, place, None);
        pixmap.stroke_path(&outline, &paint(rim), &Stroke { width: 1.2, ..Stroke::default() }, place, None);
    }
    if let Some(dots) = dots.finish() {
        pixmap.fill_path(&dots, &paint(Color::from_rgba8(120, 30, 30, 255)), FillRule::Winding, place, None);
    }
}
