//! Distances between curves.

use glam::Vec3;

/// Distance from `point` to the segment `a`–`b`.
pub fn point_segment(point: Vec3, a: Vec3, b: Vec3) -> f32 {
    let along = b - a;
    let squared = along.length_squared();
    let t = if squared > 0.0 { ((point - a).dot(along) / squared).clamp(0.0, 1.0) } else { 0.0 };
    point.distance(a + along * t)
}

/// Distance from `point` to the polyline `points` (≥ 1). O(n).
pub fn point_polyline(point: Vec3, points: &[Vec3]) -> f32 {
    if let [only] = points {
        return point.distance(*only);
    }
    points.windows(2).map(|pair| point_segment(point, pair[0], pair[1])).fold(f32::INFINITY, f32::min)
}

/// Hausdorff distance between two polylines (≥ 1 point each), the larger of both directions.
///
/// The farthest point is looked for among the vertices: distance to a polyline is not convex along
/// a segment, so the true value can be larger by at most half of the longest segment of either.
/// O(n·m).
///
/// # Source
/// Fan & Sheng §5, Eq. 4.
pub fn hausdorff(a: &[Vec3], b: &[Vec3]) -> f32 {
    farthest(a, b, farthest(b, a, 0.0))
}

/// The farthest that a vertex of `from` is from the polyline `to`, or `least` if none is farther.
///
/// # Source
/// Taha & Hanbury 2015: what is near enough to tell that a vertex is not the farthest ends the search, and it
/// begins where curves that run alike are nearest.
fn farthest(from: &[Vec3], to: &[Vec3], least: f32) -> f32 {
    if to.len() < 2 {
        return from.iter().map(|point| point_polyline(*point, to)).fold(least, f32::max);
    }
    let segments = to.len() - 1;
    let beyond = |most: f32, (i, point): (usize, &Vec3)| {
        let first = i * segments / from.len();
        let mut nearest = f32::INFINITY;
        for segment in (first..segments).chain((0..first).rev()) {
            nearest = nearest.min(point_segment(*point, to[segment], to[segment + 1]));
            if nearest <= most {
                return most;
            }
        }
        nearest
    };
    from.iter().enumerate().fold(least, beyond)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hausdorff_is_symmetric_and_zero_only_for_the_same_curve() {
        let a = [Vec3::ZERO, Vec3::X];
        let b = [Vec3::ZERO, Vec3::X * 0.5, Vec3::X];
        let c = [Vec3::ZERO, Vec3::new(0.5, 0.2, 0.0), Vec3::X];
        assert_eq!(hausdorff(&a, &b), 0.0);
        assert!((hausdorff(&a, &c) - 0.2).abs() < 1e-6);
        assert_eq!(hausdorff(&a, &c), hausdorff(&c, &a));
    }

    #[test]
    fn a_degenerate_segment_is_a_point() {
        assert_eq!(point_segment(Vec3::Y, Vec3::ZERO, Vec3::ZERO), 1.0);
    }
}
