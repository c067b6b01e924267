//! Open polylines in the plane or in space: arc length and resampling by it.

use glam::{Vec2, Vec3};

/// What a polyline is made of.
pub trait Point: Copy {
    /// Euclidean distance.
    fn distance_to(self, other: Self) -> f32;
    /// The point at `t` of the way to `other`.
    fn toward(self, other: Self, t: f32) -> Self;
}

impl Point for Vec2 {
    fn distance_to(self, other: Self) -> f32 {
        self.distance(other)
    }
    fn toward(self, other: Self, t: f32) -> Self {
        self.lerp(other, t)
    }
}

impl Point for Vec3 {
    fn distance_to(self, other: Self) -> f32 {
        self.distance(other)
    }
    fn toward(self, other: Self, t: f32) -> Self {
        self.lerp(other, t)
    }
}

/// Arc length from the first point to each point; starts with 0. O(n).
///
/// ```
/// use glam::Vec3;
/// let l = common::geometry::polyline::cumulative_length(&[Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y]);
/// assert_eq!(l, [0.0, 1.0, 2.0]);
/// ```
pub fn cumulative_length<P: Point>(points: &[P]) -> Vec<f32> {
    let mut total = 0.0;
    points
        .iter()
        .enumerate()
        .map(|(index, point)| {
            if index > 0 {
                total += point.distance_to(points[index - 1]);
            }
            total
        })
        .collect()
}

/// Arc length of the whole. O(n).
pub fn length<P: Point>(points: &[P]) -> f32 {
    points.windows(2).map(|pair| pair[0].distance_to(pair[1])).sum()
}

/// Where arc length `s` falls in `cumulative` (ascending, at least two entries): the index of the
/// segment's first point and the fraction along the segment, 0..=1. O(log n).
pub fn locate(cumulative: &[f32], s: f32) -> (usize, f32) {
    let last_segment = cumulative.len().saturating_sub(2);
    let index = cumulative.partition_point(|l| *l <= s).saturating_sub(1).min(last_segment);
    within(cumulative, index, s)
}

/// The segment that begins at `index`, and the fraction along it where arc length `s` is reached.
fn within(cumulative: &[f32], index: usize, s: f32) -> (usize, f32) {
    let span = cumulative.get(index + 1).copied().unwrap_or(0.0) - cumulative[index];
    let fraction = if span > 0.0 { ((s - cumulative[index]) / span).clamp(0.0, 1.0) } else { 0.0 };
    (index, fraction)
}

/// Where `count` places (≥ 2) at equal steps from end to end fall in `cumulative`, as [`locate`] tells it.
/// O(n + count).
pub fn locate_evenly(cumulative: &[f32], count: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
    let total = cumulative.last().copied().unwrap_or(0.0);
    let last_segment = cumulative.len().saturating_sub(2);
    let mut index = 0;
    (0..count).map(move |k| {
        let s = total * k as f32 / (count - 1) as f32;
        while index < last_segment && cumulative[index + 1] <= s {
            index += 1;
        }
        within(cumulative, index, s)
    })
}

/// `count` points (≥ 2) at equal arc length along `points` (≥ 2), ends kept. O(n + count).
pub fn resample<P: Point>(points: &[P], count: usize) -> Vec<P> {
    resample_along(points, &cumulative_length(points), count)
}

/// The same where the arc length to each point is known.
pub fn resample_along<P: Point>(points: &[P], cumulative: &[f32], count: usize) -> Vec<P> {
    let at = |(segment, t): (usize, f32)| points[segment].toward(points[segment + 1], t);
    locate_evenly(cumulative, count).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resampling_keeps_the_ends_and_spaces_evenly() {
        let points = [Vec3::ZERO, Vec3::X * 0.1, Vec3::X * 0.7, Vec3::X];
        let even = resample(&points, 5);
        for (index, point) in even.iter().enumerate() {
            assert!(point.distance(Vec3::X * 0.25 * index as f32) < 1e-6, "{even:?}");
        }
    }

    #[test]
    fn even_places_are_where_each_is_located() {
        let cumulative = [0.0, 0.0, 1.0, 1.0, 1.0, 3.5, 7.0, 7.0];
        for count in [2, 3, 8, 29, 200] {
            let each = (0..count).map(|k| locate(&cumulative, 7.0 * k as f32 / (count - 1) as f32));
            assert!(locate_evenly(&cumulative, count).eq(each), "{count}");
        }
    }

    #[test]
    fn locating_clamps_to_the_ends() {
        let cumulative = [0.0, 1.0, 3.0];
        assert_eq!(locate(&cumulative, -1.0), (0, 0.0));
        assert_eq!(locate(&cumulative, 2.0), (1, 0.5));
        assert_eq!(locate(&cumulative, 9.0), (1, 1.0));
    }
}
