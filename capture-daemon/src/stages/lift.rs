//! Skeleton → knots in metres, in the camera frame.

use common::blade::Knot;
use common::geometry::polyline;
use glam::{Vec2, Vec3};

use super::mask::Mask;
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
    /// Length of the midrib in the image, pixels.
    pub length_px: f32,
    /// Share of the midrib that lies on what was seen, 0..=1.
    pub seen: f32,
    /// Whether all of it lies within the region of interest, but for its rim.
    pub within_region: bool,
}

impl Lifted {
    /// The widest cross-section, metres.
    pub fn max_width_m(&self) -> f32 {
        self.knots_in_camera.iter().map(Knot::width).fold(0.0, f32::max)
    }

    /// The most that its width changes along its midrib but for the ends, metres for a metre.
    pub fn steepest_flank(&self) -> f32 {
        const APART: usize = 6;
        let knots = &self.knots_in_camera;
        let inner = &knots[knots.len() / 10..knots.len() - knots.len() / 10];
        let step = |pair: &[Knot]| {
            let (from, to) = (&pair[0], &pair[APART]);
            (to.width() - from.width()).abs() / from.position.distance(to.position).max(f32::MIN_POSITIVE)
        };
        inner.windows(APART + 1).map(step).fold(0.0, f32::max)
    }

    /// Whether its midrib comes back over its own blade: a later knot lies within half of the width of an earlier
    /// one, though it is more than twice that width along from it. O(knots²).
    pub fn doubles_back(&self) -> bool {
        /// More than of the arc with the tightest turn that leaves a blade's sides apart.
        const ALONG: f32 = 4.0;
        let knots = &self.knots_in_camera;
        let apart_m = self.length_m / (knots.len().max(2) - 1) as f32;
        // One that always advances by half of what it is long comes back nowhere.
        let [Some(first), Some(last)] = [knots.first(), knots.last()] else { return false };
        let ahead = (last.position - first.position).normalize_or_zero();
        let advances = |pair: &[Knot]| {
            let step = pair[1].position - pair[0].position;
            step.dot(ahead) >= 0.5 * step.length()
        };
        if knots.windows(2).all(advances) {
            return false;
        }
        knots.iter().enumerate().any(|(i, earlier)| {
            knots.iter().enumerate().skip(i + 1).any(|(j, later)| {
                let half_m = 0.5 * earlier.width().max(later.width());
                let along_m = (j - i) as f32 * apart_m;
                along_m > ALONG * half_m
                    && earlier.position.distance_squared(later.position) < half_m * half_m
            })
        })
    }

    /// How far to the right of the camera its root is, metres.
    pub fn root_x_m(&self) -> f32 {
        self.knots_in_camera[0].position.x
    }
}

/// Lifts one skeleton. The slope of depth across gives `across` in space, and with it the true width
/// of a blade that is turned away; of a folded one it is the direction that both halves fall away from
/// alike, and half widths are taken along it. O(stations).
pub fn lift(mask: &Mask, skeleton: &Skeleton, camera: &CameraModel) -> Lifted {
    let stations = &skeleton.stations;
    let mids: Vec<Vec3> = stations.iter().map(|s| at(camera, s.mid, s.depth_m)).collect();
    let knots_in_camera = (0..mids.len()).map(|i| knot(camera, &stations[i], &mids, i)).collect();
    let mean_depth = stations.iter().map(|s| s.depth_m).sum::<f32>() / stations.len() as f32;
    let on_blob = |s: &&Station| mask.index_at(s.mid).is_some_and(|index| mask.blobs.of[index] != 0);
    const RIM_PX: f32 = 3.0;
    let [x0, y0, x1, y1] = mask.region.map(|edge| edge as f32);
    let within = |s: &Station| {
        let low = Vec2::new(x0, y0) - RIM_PX;
        let high = Vec2::new(x1, y1) + RIM_PX;
        s.mid.cmpge(low).all() && s.mid.cmple(high).all()
    };
    Lifted {
        within_region: stations.iter().all(within),
        length_px: skeleton.length_px,
        seen: stations.iter().filter(on_blob).count() as f32 / stations.len() as f32,
        length_m: polyline::length(&mids),
        pixels_across: stations.iter().map(|s| s.left_px + s.right_px).fold(0.0, f32::max),
        metres_per_px: mean_depth / camera.fx as f32,
        knots_in_camera,
    }
}

fn at(camera: &CameraModel, pixel: Vec2, z: f32) -> Vec3 {
    camera.deproject(f64::from(pixel.x), f64::from(pixel.y), f64::from(z))
}

fn knot(camera: &CameraModel, station: &Station, mids: &[Vec3], i: usize) -> Knot {
    let along = (mids[(i + 1).min(mids.len() - 1)] - mids[i.saturating_sub(1)]).normalize_or(Vec3::NEG_Y);
    let edge = |t: f32| {
        let depth_m = station.depth_m + station.slope_m * t + station.fold_m * t.abs();
        at(camera, station.mid + station.across * t, depth_m)
    };
    let aside = |way: Vec3| way - along * way.dot(along);
    let across = if station.fold_m == 0.0 {
        aside(edge(1.0) - edge(-1.0))
    } else {
        // Both halves fall away from it alike.
        aside(edge(1.0) - mids[i]).normalize_or_zero() - aside(edge(-1.0) - mids[i]).normalize_or_zero()
    };
    let across = across.normalize_or(Vec3::X);
    let reach = |t: f32| (edge(t) - mids[i]).dot(across).abs();
    Knot {
        position: mids[i],
        half_width_left: reach(-station.left_px),
        across,
        half_width_right: reach(station.right_px),
    }
}
