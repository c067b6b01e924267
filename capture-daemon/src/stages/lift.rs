//! Skeleton and depth → knots in metres, in the camera frame.

use common::blade::Knot;
use common::geometry::{polyline, smooth};
use glam::{Vec2, Vec3};

use super::mask::{Mask, depth_step_m};
use super::skeleton::{Skeleton, Station};
use crate::frame::CameraModel;

/// A blade in space, before refinement.
#[derive(Clone, Debug, PartialEq)]
pub struct Lifted {
    /// Knots from root to tip in the camera frame, metres; as many as the skeleton has stations.
    pub knots_in_camera: Vec<Knot>,
    /// Arc length of the midrib, metres.
    pub length_m: f32,
    /// The widest cross-section, image pixels.
    pub pixels_across: f32,
    /// Metres that a pixel spans at the blade's mean depth.
    pub metres_per_px: f32,
}

/// Share of a half width whose pixels are read: the rim's pixels mix near and far.
const INNER_SHARE: f32 = 0.75;
/// A pixel that is occupied less often than this is rim.
const INNER_OCCUPANCY: f32 = 0.9;
/// Half-height wavelength of the smoothing of depth along the midrib, pixels.
const DEPTH_WAVELENGTH_PX: f64 = 48.0;
/// σ of the window along the midrib in which the slope across is fitted, pixels.
const SLOPE_WINDOW_PX: f32 = 9.0;

/// Lifts one skeleton; `None` when not a single reading lies on it.
///
/// Each cross-section's depth is the median over its inner pixels; the slope of depth across gives
/// `across` in space, and with it the true width of a blade that is turned away. O(stations · width).
pub fn lift(mask: &Mask, skeleton: &Skeleton, camera: &CameraModel) -> Option<Lifted> {
    let readings: Vec<Reading> =
        skeleton.stations.iter().map(|station| read(mask, skeleton.label, station)).collect();
    let spacing_px = skeleton.length_px / (readings.len() - 1) as f32;
    let depth = depth_along(&readings, spacing_px)?;
    let slope = slope_across(&readings, &depth, spacing_px);
    let mids: Vec<Vec3> = skeleton.stations.iter().zip(&depth).map(|(s, z)| at(camera, s.mid, *z)).collect();
    let knots_in_camera =
        (0..mids.len()).map(|i| knot(camera, &skeleton.stations[i], &mids, i, depth[i], slope[i])).collect();
    let mean_depth = depth.iter().sum::<f32>() / depth.len() as f32;
    Some(Lifted {
        length_m: polyline::length(&mids),
        pixels_across: skeleton.stations.iter().map(|s| s.left_px + s.right_px).fold(0.0, f32::max),
        metres_per_px: mean_depth / camera.fx as f32,
        knots_in_camera,
    })
}

fn at(camera: &CameraModel, pixel: Vec2, z: f32) -> Vec3 {
    camera.deproject(f64::from(pixel.x), f64::from(pixel.y), f64::from(z))
}

/// The inner pixels of a cross-section: position across, pixels, and depth, metres.
type Reading = Vec<(f32, f32)>;

fn read(mask: &Mask, label: u16, station: &Station) -> Reading {
    let from = (-INNER_SHARE * station.left_px).min(0.0).ceil() as i32;
    let to = (INNER_SHARE * station.right_px).floor() as i32;
    let mut pixels: Reading = Vec::new();
    let mut previous = usize::MAX;
    for k in from..=to {
        let pixel = (station.mid + station.across * k as f32).round();
        let inside =
            pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < mask.width as f32 && pixel.y < mask.height as f32;
        let index = if inside { pixel.y as usize * mask.width + pixel.x as usize } else { continue };
        let inner = mask.labels[index] == label && mask.occupancy[index] >= INNER_OCCUPANCY;
        if inner && index != previous && mask.depth_m[index] > 0.0 {
            pixels.push(((pixel - station.mid).dot(station.across), mask.depth_m[index]));
            previous = index;
        }
    }
    pixels
}

fn median(mut values: Vec<f32>) -> Option<f32> {
    values.sort_by(f32::total_cmp);
    let n = values.len();
    (n > 0).then(|| 0.5 * (values[(n - 1) / 2] + values[n / 2]))
}

fn depth_along(readings: &[Reading], spacing_px: f32) -> Option<Vec<f32>> {
    let medians: Vec<Option<f32>> =
        readings.iter().map(|pixels| median(pixels.iter().map(|(_, z)| *z).collect())).collect();
    // Sections that lie off the blade's own depth, seen over their neighbourhood, read something else.
    let typical = |i: usize| {
        let near = i.saturating_sub(12)..(i + 13).min(medians.len());
        median(medians[near].iter().flatten().copied().collect())
    };
    let fallback = median(medians.iter().flatten().copied().collect())?;
    let (mut values, mut weights) = (Vec::new(), Vec::new());
    for (i, section) in medians.iter().enumerate() {
        let trusted =
            section.filter(|z| typical(i).is_some_and(|typical| (z - typical).abs() < depth_step_m(typical)));
        values.push(f64::from(trusted.unwrap_or(fallback)));
        weights.push(trusted.map_or(0.0, |_| readings[i].len() as f64));
    }
    let mean = weights.iter().sum::<f64>() / weights.iter().filter(|w| **w > 0.0).count().max(1) as f64;
    weights.iter_mut().for_each(|weight| *weight /= mean.max(1.0));
    let wavelength = DEPTH_WAVELENGTH_PX / f64::from(spacing_px.max(0.1));
    Some(smooth::penalised(&values, &weights, wavelength).into_iter().map(|z| z as f32).collect())
}

/// Slope of depth across the blade, metres a pixel, to its right.
fn slope_across(readings: &[Reading], depth: &[f32], spacing_px: f32) -> Vec<f32> {
    // What a slope is expected to be, against the noise of one reading (1 px to the side, 0.4 mm of
    // noise, 0.6 mm a px of slope): keeps the fit calm where there are but a few pixels.
    const RIDGE: f32 = 0.5;
    let moments: Vec<(f32, f32)> = readings
        .iter()
        .zip(depth)
        .map(|(pixels, z)| {
            let inner = pixels.iter().filter(|(_, reading)| (reading - z).abs() < 0.5 * depth_step_m(*z));
            inner.fold((0.0, 0.0), |(tz, tt), (t, reading)| (tz + t * (reading - z), tt + t * t))
        })
        .collect();
    let half = (3.0 * SLOPE_WINDOW_PX / spacing_px.max(0.1)).ceil() as usize;
    (0..moments.len())
        .map(|i| {
            let window = i.saturating_sub(half)..(i + half + 1).min(moments.len());
            let (mut tz, mut tt) = (0.0, RIDGE);
            for k in window {
                let away = (k as f32 - i as f32) * spacing_px / SLOPE_WINDOW_PX;
                let weight = (-0.5 * away * away).exp();
                tz += weight * moments[k].0;
                tt += weight * moments[k].1;
            }
            tz / tt
        })
        .collect()
}

fn knot(camera: &CameraModel, station: &Station, mids: &[Vec3], i: usize, z: f32, slope: f32) -> Knot {
    let along = (mids[(i + 1).min(mids.len() - 1)] - mids[i.saturating_sub(1)]).normalize_or(Vec3::NEG_Y);
    let edge = |offset: f32| at(camera, station.mid + station.across * offset, z + slope * offset);
    let chord = edge(1.0) - edge(-1.0);
    let across = (chord - along * chord.dot(along)).normalize_or(Vec3::X);
    let reach = |offset: f32| (edge(offset) - mids[i]).dot(across).abs();
    Knot {
        position: mids[i],
        half_width_left: reach(-station.left_px),
        across,
        half_width_right: reach(station.right_px),
    }
}
