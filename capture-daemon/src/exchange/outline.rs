//! A closed outline in the plane: where it is, and how wide.

use glam::Vec2;

/// A polygon, closed without its first point again.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Outline {
    pub(super) points: Vec<Vec2>,
}

impl Outline {
    fn edges(&self) -> impl Iterator<Item = (Vec2, Vec2)> + '_ {
        let next = self.points.iter().cycle().skip(1);
        self.points.iter().copied().zip(next.copied())
    }

    /// What it encloses, in squared units. O(points).
    pub(super) fn area(&self) -> f32 {
        // From its own first point, for the sake of precision.
        let from = self.points.first().copied().unwrap_or_default();
        0.5 * self.edges().map(|(a, b)| (a - from).perp_dot(b - from)).sum::<f32>().abs()
    }

    /// Whether two of its edges cross, not only touch. O(points · edges above one another), less than O(points²) for
    /// what is drawn.
    pub(super) fn crosses_itself(&self) -> bool {
        let mut edges: Vec<(Vec2, Vec2)> = self.edges().collect();
        edges.sort_by(|(a, b), (c, d)| a.min(*b).x.total_cmp(&c.min(*d).x));
        let side = |a: Vec2, b: Vec2, point: Vec2| (b - a).perp_dot(point - a);
        let cross = |(a, b): (Vec2, Vec2), (c, d): (Vec2, Vec2)| {
            side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
        };
        edges.iter().enumerate().any(|(index, first)| {
            let end = first.0.max(first.1).x;
            let beside = edges[index + 1..].iter().take_while(|(a, b)| a.min(*b).x <= end);
            beside.into_iter().any(|second| cross(*first, *second))
        })
    }

    /// Lower and upper corner of its bounding box.
    pub(super) fn bounds(&self) -> [Vec2; 2] {
        let low = self.points.iter().copied().reduce(Vec2::min).unwrap_or_default();
        let high = self.points.iter().copied().reduce(Vec2::max).unwrap_or_default();
        [low, high]
    }

    /// Whether a point lies inside (even–odd). O(points).
    pub(super) fn contains(&self, point: Vec2) -> bool {
        let crosses = |(a, b): &(Vec2, Vec2)| {
            (a.y > point.y) != (b.y > point.y) && point.x < a.x + (b.x - a.x) * (point.y - a.y) / (b.y - a.y)
        };
        self.edges().filter(crosses).count() % 2 == 1
    }

    /// How far it is from a point to the nearest edge in a direction (a unit vector). O(points).
    pub(super) fn reach(&self, from: Vec2, way: Vec2) -> Option<f32> {
        let meet = |(a, b): (Vec2, Vec2)| {
            let edge = b - a;
            let cross = way.perp_dot(edge);
            if cross == 0.0 {
                return None;
            }
            let along_way = (a - from).perp_dot(edge) / cross;
            let along_edge = (a - from).perp_dot(way) / cross;
            (along_way >= 0.0 && (0.0..=1.0).contains(&along_edge)).then_some(along_way)
        };
        self.edges().filter_map(meet).min_by(f32::total_cmp)
    }

    /// The distances from a point at which edges are crossed in a direction (a unit vector), rising: as many as
    /// tell whether the point lies inside, also where corners are met. O(points).
    pub(super) fn crossings(&self, from: Vec2, way: Vec2) -> Vec<f32> {
        let side = |point: Vec2| way.perp_dot(point - from);
        let cut = |(a, b): (Vec2, Vec2)| {
            let (a_side, b_side) = (side(a), side(b));
            ((a_side > 0.0) != (b_side > 0.0))
                .then(|| way.dot(a - from) + way.dot(b - a) * (a_side / (a_side - b_side)))
        };
        let mut cuts: Vec<f32> = self.edges().filter_map(cut).filter(|reach| *reach > 0.0).collect();
        cuts.sort_by(f32::total_cmp);
        cuts
    }

    /// The centre of what it encloses; that of its points where it encloses nothing. O(points).
    pub(super) fn centre(&self) -> Vec2 {
        let from = self.points.first().copied().unwrap_or_default();
        let part = |(a, b): (Vec2, Vec2)| {
            let twice = (a - from).perp_dot(b - from);
            (twice, (a - from + b - from) * twice / 3.0)
        };
        let (area, moment) =
            self.edges().map(part).fold((0.0, Vec2::ZERO), |sum, part| (sum.0 + part.0, sum.1 + part.1));
        let centre = from + moment / area;
        let mean = || self.points.iter().sum::<Vec2>() / self.points.len().max(1) as f32;
        if centre.is_finite() { centre } else { mean() }
    }

    /// The same without points that are nearer to the one before than this. O(points).
    pub(super) fn thinned(&self, distance: f32) -> Self {
        let mut points: Vec<Vec2> = Vec::new();
        for point in &self.points {
            if points.last().is_none_or(|last| last.distance(*point) >= distance) {
                points.push(*point);
            }
        }
        Self { points }
    }

    /// Where the rows of a picture are inside of it: for each row with its centre at a whole number of y the
    /// columns, of which every second one ends a stretch. O(rows · points).
    pub(super) fn stretches(&self, y: f32) -> Vec<f32> {
        let cut = |(a, b): (Vec2, Vec2)| {
            ((a.y > y) != (b.y > y)).then(|| a.x + (b.x - a.x) * (y - a.y) / (b.y - a.y))
        };
        let mut cuts: Vec<f32> = self.edges().filter_map(cut).collect();
        cuts.sort_by(f32::total_cmp);
        cuts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_has_its_area_its_inside_and_its_reach() {
        let of = Outline { points: vec![Vec2::new(1.0, 1.0), Vec2::new(5.0, 1.0), Vec2::new(1.0, 4.0)] };
        assert!((of.area() - 6.0).abs() < 1e-6);
        assert!(of.contains(Vec2::new(2.0, 2.0)) && !of.contains(Vec2::new(4.0, 3.0)));
        assert_eq!(of.reach(Vec2::new(2.0, 1.5), Vec2::NEG_X), Some(1.0));
        assert_eq!(of.reach(Vec2::new(2.0, 1.5), Vec2::NEG_Y), Some(0.5));
        assert_eq!(of.reach(Vec2::new(0.0, 0.0), Vec2::NEG_X), None);
        assert_eq!(of.stretches(2.5), [1.0, 3.0]);
        assert_eq!(of.crossings(Vec2::new(2.0, 1.5), Vec2::NEG_X), [1.0]);
        assert_eq!(of.crossings(Vec2::new(0.0, 1.75), Vec2::X), [1.0, 4.0]);
        assert!(of.centre().distance(Vec2::new(7.0 / 3.0, 2.0)) < 1e-6);
        assert_eq!([3.5, 4.5].map(|distance| of.thinned(distance).points.len()), [3, 1]);
    }

    #[test]
    fn an_eight_crosses_itself_and_a_square_does_not() {
        let of = |points: [(f32, f32); 4]| Outline { points: points.map(|(x, y)| Vec2::new(x, y)).into() };
        assert!(!of([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]).crosses_itself());
        assert!(of([(0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 2.0)]).crosses_itself());
    }
}
