//! Pictures of what each stage made of a capture, for `replay --explain`.

pub(crate) mod picture;

use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};
use tiny_skia::Color;

use crate::frame::CameraModel;
use crate::session::Capture;
use crate::stages::cover;
use picture::{Picture, WHITE, hue};

/// Why a picture cannot be written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{path}: the picture cannot be written: {reason}; check that the folder is writable and the disk not full"
)]
pub struct ExplainError {
    path: String,
    reason: String,
}

/// Writes six PNGs into `folder`, which is made if it is not there: `frame-NNNNNN-1-mask.png` and so
/// on to `-6-refine.png`. Gives their paths.
///
/// # Errors
/// When the folder or a file cannot be written.
pub fn write(folder: &Path, capture: &Capture, camera: &CameraModel) -> Result<Vec<PathBuf>, ExplainError> {
    let failed = |path: &Path, reason: String| ExplainError { path: path.display().to_string(), reason };
    std::fs::create_dir_all(folder).map_err(|error| failed(folder, error.to_string()))?;
    let pictures = [
        ("1-mask", mask(capture)),
        ("2-contour", contour(capture)),
        ("3-partition", partition(capture)),
        ("4-skeleton", skeleton(capture)),
        ("5-lift", lift(capture)),
        ("6-refine", refine(capture, camera)),
    ];
    let mut paths = Vec::new();
    for (stage, picture) in pictures {
        let path = folder.join(format!("frame-{:06}-{stage}.png", capture.frame));
        picture.pixmap.save_png(&path).map_err(|error| failed(&path, error.to_string()))?;
        paths.push(path);
    }
    Ok(paths)
}

fn mask(capture: &Capture) -> Picture {
    let mask = &capture.steps.mask;
    let mut picture = Picture::of_depth(mask);
    for y in mask.region[1]..mask.region[3] {
        for x in mask.region[0]..mask.region[2] {
            let index = y * mask.width + x;
            if let Some(blob) = usize::from(mask.blobs.of[index]).checked_sub(1) {
                let mut color = hue(blob);
                color.set_alpha(0.25 + 0.75 * mask.occupancy[index]);
                picture.pixel(x, y, color);
            }
        }
    }
    picture
}

fn contour(capture: &Capture) -> Picture {
    let mut picture = Picture::of_depth(&capture.steps.mask);
    for (index, outline) in capture.steps.outlines.iter().enumerate() {
        let closed = outline.points.iter().chain(outline.points.first());
        picture.line(closed.copied(), hue(index), 2.0);
    }
    picture
}

fn partition(capture: &Capture) -> Picture {
    let mask = &capture.steps.mask;
    let mut picture = Picture::of_depth(mask);
    for (index, part) in cover::cover(mask, &capture.steps.parts).into_iter().enumerate() {
        if part > 0 {
            let mut color = hue(part as usize - 1);
            color.set_alpha(0.3);
            picture.pixel(index % mask.width, index / mask.width, color);
        }
    }
    for (index, part) in capture.steps.parts.iter().enumerate() {
        for side in [&part.left, &part.right] {
            picture.line(side.points.iter().copied(), hue(index), 2.5);
        }
        picture.line([part.left.points[0], part.right.points[0]], WHITE, 2.0);
        picture.dot(part.tip(), WHITE, 6.0);
        picture.dot(part.tip(), hue(index), 4.5);
    }
    picture
}

fn skeleton(capture: &Capture) -> Picture {
    let mut picture = Picture::of_depth(&capture.steps.mask);
    for (index, skeleton) in capture.steps.skeletons.iter().enumerate() {
        for station in skeleton.stations.iter().step_by(3) {
            let left = station.mid - station.across * station.left_px;
            let right = station.mid + station.across * station.right_px;
            picture.line([left, right], hue(index), 1.2);
        }
        picture.line(skeleton.stations.iter().map(|station| station.mid), WHITE, 2.0);
        picture.dot(skeleton.stations[0].mid, WHITE, 5.0);
    }
    picture
}

/// Seen from the camera's left: away from the camera to the right, up is up; a grid of 5 cm.
fn lift(capture: &Capture) -> Picture {
    let knots = || capture.steps.lifted.iter().flat_map(|blade| &blade.knots_in_camera);
    let side = |p: Vec3| Vec2::new(p.z, p.y);
    let low = knots().fold(Vec2::INFINITY, |a, k| a.min(side(k.position))) - 0.02;
    let high = knots().fold(Vec2::NEG_INFINITY, |a, k| a.max(side(k.position))) + 0.02;
    if !(low.is_finite() && high.is_finite()) {
        return Picture::blank(640, 480);
    }
    let zoom = (1200.0 / (high - low).max_element()).min(6000.0);
    let size = ((high - low) * zoom).ceil();
    let mut picture = Picture::blank(size.x as u32, size.y as u32);
    (picture.zoom, picture.origin) = (zoom, low);
    let lines = |from: f32, to: f32| {
        ((from / 0.05).ceil() as i32..=(to / 0.05).floor() as i32).map(|k| k as f32 * 0.05)
    };
    let grid = Color::from_rgba8(60, 64, 68, 255);
    for z in lines(low.x, high.x) {
        picture.line([Vec2::new(z, low.y), Vec2::new(z, high.y)], grid, 1.0);
    }
    for y in lines(low.y, high.y) {
        picture.line([Vec2::new(low.x, y), Vec2::new(high.x, y)], grid, 1.0);
    }
    for (index, blade) in capture.steps.lifted.iter().enumerate() {
        for knot in blade.knots_in_camera.iter().step_by(3) {
            picture.line([side(knot.left()), side(knot.right())], hue(index), 1.2);
        }
        picture.line(blade.knots_in_camera.iter().map(|knot| side(knot.position)), WHITE, 2.0);
    }
    picture
}

fn refine(capture: &Capture, camera: &CameraModel) -> Picture {
    let mut picture = Picture::of_depth(&capture.steps.mask);
    let pixel = |point: Vec3| {
        let (u, v) = camera.project(point);
        Vec2::new(u as f32, v as f32)
    };
    for (index, blade) in capture.steps.blades.iter().enumerate() {
        let knots = &blade.knots_in_camera;
        let rim = knots.iter().map(|knot| knot.left()).chain(knots.iter().rev().map(|knot| knot.right()));
        picture.line(rim.map(pixel), hue(index), 2.0);
        picture.line(knots.iter().map(|knot| pixel(knot.position)), WHITE, 1.5);
        for knot in knots {
            picture.line([pixel(knot.left()), pixel(knot.right())], hue(index), 1.2);
            picture.dot(pixel(knot.position), WHITE, 3.5);
        }
    }
    picture
}
