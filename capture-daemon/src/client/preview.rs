//! `preview`: what the station sees, as a picture, and what it tells the visitor, as text.

use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use common::preview::{CaptureNote, HAND, Header, PolylineKind, Preview, SEEN, State};
use common::sealed::SealedBytes;
use common::sentence::{print, print_on};
use common::station::{self, StationProxy};
use glam::Vec2;
use tiny_skia::{Color, FilterQuality, Pixmap, PixmapPaint, PremultipliedColorU8, Transform};

use super::{PATIENCE, Station, files};
use crate::cli::PreviewArgs;
use crate::explain::picture::{Picture, WHITE, hue};

/// Longer side of a picture, pixels, about.
const LONGEST_SIDE: f32 = 1400.0;

/// `sward-capture preview`.
///
/// # Errors
/// When no station answers, it refuses, what it sends is no preview, or the picture or stdout cannot be written.
pub fn preview(args: &PreviewArgs) -> anyhow::Result<()> {
    let mut station = Station::connect(&args.station)?;
    let mut preview = next(&mut station, 0, Some(PATIENCE))?;
    if !args.watch {
        print(&page(&preview))?;
        return args.out.as_deref().map_or(Ok(()), |out| write(out, &preview));
    }
    let mut said = String::new();
    loop {
        let line = line(&preview);
        if line != said {
            if !print_on(&line)? {
                return Ok(());
            }
            if let Some(out) = &args.out {
                write(out, &preview)?;
            }
            said = line;
        }
        let after = preview.header().sequence.cast_signed();
        preview = next(&mut station, after, None)?;
    }
}

/// The newest preview that is another than `after`.
fn next(
    station: &mut Station,
    after: i64,
    patience: Option<Duration>,
) -> anyhow::Result<Preview<SealedBytes>> {
    let (reply, descriptors) = station.call_with(patience, async |station| {
        let (reply, descriptors) = station.get_preview(after).await?;
        Ok(reply.map(|reply| (reply, descriptors)))
    })?;
    station::preview(&reply, &descriptors).context("the preview cannot be used")
}

/// A line for `--watch`, the same while nothing changes that a reader would notice.
fn line(preview: &Preview<SealedBytes>) -> String {
    let Header { state, hold, .. } = preview.header();
    let percent = (hold * 10.0).floor() * 10.0;
    let (state, code, words) = (state.name(), preview.code(), preview.words());
    format!("{state:9}  {percent:3.0} %  {code:13}  {words}\n")
}

fn page(preview: &Preview<SealedBytes>) -> String {
    let Header {
        sequence,
        frame,
        timestamp_ns,
        width,
        height,
        window_mm: [near, far],
        state,
        hold,
        capture,
        ..
    } = *preview.header();
    let mut text = format!("state    {}", state.name());
    if state == State::Settling {
        let _ = write!(text, ", {:.0} % of the hold", hold * 100.0);
    }
    let _ = writeln!(text, "\nvisitor  {}: {}", preview.code(), preview.words());
    if width == 0 {
        return text + "frame    none\n";
    }
    let seconds = timestamp_ns as f64 * 1e-9;
    let _ =
        writeln!(text, "frame    {frame}, {width}×{height}, {seconds:.3} s since 1970, preview {sequence}");
    let pixels = (u64::from(width) * u64::from(height)) as f64;
    let share = |is: &dyn Fn(&u8) -> bool| {
        100.0 * preview.mask().iter().filter(|bits| is(bits)).count() as f64 / pixels
    };
    let readings = 100.0 * preview.depth_mm().filter(|depth| *depth != 0).count() as f64 / pixels;
    let (seen, hand) = (share(&|bits| bits & SEEN != 0), share(&|bits| bits & HAND != 0));
    let _ = writeln!(
        text,
        "depth    {readings:.1} % of the pixels have a reading, {seen:.1} % are seen within {near} to {far} mm, {hand:.1} % are of a hand"
    );
    if let Some(CaptureNote { frame, blades, .. }) = capture {
        let _ = writeln!(text, "capture  {blades} blades, at frame {frame}");
    }
    text
}

/// Writes the picture whole, or not at all.
fn write(out: &Path, preview: &Preview<SealedBytes>) -> anyhow::Result<()> {
    let png = draw(preview).pixmap.encode_png().context("the picture cannot be encoded")?;
    files::write_whole(out, &png)
}

/// Depth, the nearer the brighter, red before the window and blue behind it; parts and hand tinted; the border of
/// what is seen; contours and skeletons.
fn draw<B: AsRef<[u8]>>(preview: &Preview<B>) -> Picture {
    let Header { width, height, .. } = *preview.header();
    if width == 0 {
        return Picture::blank(640, 480);
    }
    let mut pixels = Pixmap::new(width, height).expect("the size is above zero and small");
    let border = border(preview.mask(), width as usize);
    let planes = preview.depth_mm().zip(preview.mask()).zip(preview.labels()).zip(border);
    for (pixel, (((depth, bits), label), is_border)) in pixels.pixels_mut().iter_mut().zip(planes) {
        let mut colour = shade(depth, preview.header().window_mm);
        if *label > 0 {
            colour = mixed(colour, hue(usize::from(*label) - 1), 0.4);
        }
        if bits & HAND != 0 {
            colour = mixed(colour, Color::from_rgba8(220, 120, 90, 255), 0.5);
        }
        if is_border {
            colour = mixed(colour, Color::from_rgba8(90, 220, 255, 255), 0.6);
        }
        let opaque = colour.premultiply().to_color_u8();
        *pixel = PremultipliedColorU8::from_rgba(opaque.red(), opaque.green(), opaque.blue(), 255)
            .unwrap_or(opaque);
    }
    let zoom = (LONGEST_SIDE / width.max(height) as f32).floor().clamp(1.0, 8.0);
    let mut picture = Picture::blank(width * zoom as u32, height * zoom as u32);
    (picture.zoom, picture.origin) = (zoom, Vec2::splat(-0.5));
    let nearest = PixmapPaint { quality: FilterQuality::Nearest, ..PixmapPaint::default() };
    picture.pixmap.draw_pixmap(0, 0, pixels.as_ref(), &nearest, Transform::from_scale(zoom, zoom), None);

    for line in preview.polylines().filter(|line| line.kind() == PolylineKind::Contour) {
        let points: Vec<Vec2> = line.points().map(|point| Vec2::new(point.x, point.y)).collect();
        picture.line(points.iter().chain(points.first()).copied(), Color::from_rgba8(255, 215, 0, 255), 1.5);
    }
    for line in preview.polylines().filter(|line| line.kind() == PolylineKind::Skeleton) {
        let points: Vec<_> = line.points().collect();
        let is_refused = line.label() == 0;
        let colour =
            if is_refused { Color::from_rgba8(255, 60, 60, 255) } else { hue(line.label() as usize - 1) };
        let mids: Vec<Vec2> = points.iter().map(|point| Vec2::new(point.x, point.y)).collect();
        for (index, point) in points.iter().enumerate().step_by(4) {
            let along = mids[(index + 1).min(mids.len() - 1)] - mids[index.saturating_sub(1)];
            // To the right of one who looks from the root to the tip, with y down.
            let right = Vec2::new(-along.y, along.x).normalize_or_zero();
            let ends = [-right * point.half_width_left, right * point.half_width_right];
            picture.line(ends.map(|end| mids[index] + end), colour, 1.2);
        }
        picture.line(mids.iter().copied(), if is_refused { colour } else { WHITE }, 2.0);
        picture.dot(mids[0], WHITE, 5.0);
    }
    picture
}

/// Whether a pixel is seen and one beside it is not.
fn border(mask: &[u8], width: usize) -> impl Iterator<Item = bool> + '_ {
    let is_seen = move |index: usize| mask.get(index).is_some_and(|bits| bits & SEEN != 0);
    (0..mask.len()).map(move |index| {
        let x = index % width;
        let sides = (x > 0 && is_seen(index - 1)) && (x + 1 < width && is_seen(index + 1));
        is_seen(index) && !(sides && is_seen(index.wrapping_sub(width)) && is_seen(index + width))
    })
}

fn shade(depth_mm: u16, [near, far]: [u16; 2]) -> Color {
    let [depth, near, far] = [depth_mm, near, far].map(f32::from);
    let rgb = |r: f32, g: f32, b: f32| Color::from_rgba8(r as u8, g as u8, b as u8, 255);
    if depth == 0.0 {
        rgb(16.0, 18.0, 20.0)
    } else if depth < near {
        rgb(130.0, 50.0, 40.0)
    } else if depth <= far {
        let grey = 215.0 - 120.0 * (depth - near) / (far - near).max(1.0);
        rgb(grey, grey, grey)
    } else {
        let strength = 1.0 / (1.0 + (depth - far) / 800.0);
        rgb(24.0 + 26.0 * strength, 28.0 + 40.0 * strength, 36.0 + 80.0 * strength)
    }
}

fn mixed(under: Color, over: Color, share: f32) -> Color {
    let mix = |a: f32, b: f32| (a + (b - a) * share).clamp(0.0, 1.0);
    let [r, g, b] =
        [mix(under.red(), over.red()), mix(under.green(), over.green()), mix(under.blue(), over.blue())];
    Color::from_rgba(r, g, b, 1.0).unwrap_or(under)
}
