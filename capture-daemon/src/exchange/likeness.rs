//! How like a blade is to the outline that it was made of.

use common::blade::Knot;
use common::geometry::polyline;
use glam::Vec2;

use super::outline::Outline;

/// Rows in which areas are compared.
const ROWS: usize = 512;
/// Points of an outline whose distances are measured.
const POINTS: usize = 800;

/// How like a blade is to a drawing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likeness {
    /// What both cover, as a share of what either covers, 0 to 1.
    pub agreement: f32,
    /// Largest distance between the two outlines, millimetres as drawn.
    pub farthest_mm: f32,
}

/// An outline, ready to have blades compared with it.
pub(super) struct Template {
    /// At equal distances, the first point again at its end.
    edge: Vec<Vec2>,
    /// y of the rows, and where they are inside: every second column ends a stretch.
    rows: Vec<(f32, Vec<f32>)>,
}

impl Template {
    /// O(rows · points).
    pub(super) fn new(outline: &Outline) -> Self {
        let [low, high] = outline.bounds();
        let row = |k: usize| low.y + (high.y - low.y) * (k as f32 + 0.5) / ROWS as f32;
        let rows = (0..ROWS).map(row).map(|y| (y, outline.stretches(y))).collect();
        let mut closed = outline.points.clone();
        closed.extend(outline.points.first());
        Self { edge: polyline::resample(&closed, POINTS), rows }
    }

    /// What a blade with these knots, flat, in this outline's millimetres, has in common with it, as a share of what
    /// either covers. What lies above or below the outline does not count. O(rows · knots).
    pub(super) fn agreement(&self, knots: &[Knot]) -> f32 {
        let pieces: Vec<Outline> = knots
            .windows(2)
            .map(|pair| {
                let [root, tip] = [&pair[0], &pair[1]];
                let corners = [root.left(), root.right(), tip.right(), tip.left()];
                Outline { points: corners.map(|corner| corner.truncate()).into() }
            })
            .collect();
        let (mut both, mut either) = (0.0_f64, f64::MIN_POSITIVE);
        for (y, drawn) in &self.rows {
            let mut made: Vec<[f32; 2]> = Vec::new();
            for piece in &pieces {
                made.extend(piece.stretches(*y).chunks_exact(2).map(|stretch| [stretch[0], stretch[1]]));
            }
            made.sort_by(|a, b| a[0].total_cmp(&b[0]));
            // What pieces share counts once.
            let mut merged: Vec<[f32; 2]> = Vec::with_capacity(made.len());
            for stretch in made {
                match merged.last_mut() {
                    Some(last) if stretch[0] <= last[1] => last[1] = last[1].max(stretch[1]),
                    _ => merged.push(stretch),
                }
            }
            let length =
                |stretches: &[[f32; 2]]| stretches.iter().map(|[from, to]| f64::from(to - from)).sum::<f64>();
            let drawn: Vec<[f32; 2]> =
                drawn.chunks_exact(2).map(|stretch| [stretch[0], stretch[1]]).collect();
            let shared: f64 = drawn
                .iter()
                .flat_map(|a| {
                    merged.iter().map(move |b| f64::from((a[1].min(b[1]) - a[0].max(b[0])).max(0.0)))
                })
                .sum();
            both += shared;
            either += length(&drawn) + length(&merged) - shared;
        }
        (both / either) as f32
    }

    /// All that is to be said of a blade with these knots. O(rows · knots + points²).
    pub(super) fn likeness(&self, knots: &[Knot]) -> Likeness {
        let mut edge: Vec<Vec2> = knots.iter().map(|knot| knot.right().truncate()).collect();
        edge.extend(knots.iter().rev().map(|knot| knot.left().truncate()));
        edge.extend(edge.first().copied());
        let even = polyline::resample(&edge, POINTS);
        let farthest_mm = farthest(&self.edge, &edge).max(farthest(&even, &self.edge));
        Likeness { agreement: self.agreement(knots), farthest_mm }
    }
}

/// How far the farthest of some points is from a line.
fn farthest(points: &[Vec2], line: &[Vec2]) -> f32 {
    let to_segment = |point: Vec2, a: Vec2, b: Vec2| {
        let along = b - a;
        let part = ((point - a).dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
        point.distance_squared(a + along * part)
    };
    let nearest = |point: &Vec2| {
        line.windows(2).map(|pair| to_segment(*point, pair[0], pair[1])).fold(f32::INFINITY, f32::min)
    };
    points.iter().map(nearest).fold(0.0, f32::max).sqrt()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// A rectangle 20 mm high.
    fn rectangle(half: f32) -> Outline {
        let corners = [(-half, 0.0), (half, 0.0), (half, 20.0), (-half, 20.0)];
        Outline { points: corners.map(|(x, y)| Vec2::new(x, y)).into() }
    }

    fn knots(half: f32) -> [Knot; 3] {
        [0.0, 12.0, 20.0].map(|y| Knot {
            position: Vec3::Y * y,
            half_width_left: half,
            across: Vec3::X,
            half_width_right: half,
        })
    }

    #[test]
    fn what_is_the_same_agrees_and_what_is_half_as_wide_agrees_by_half() {
        let of = Template::new(&rectangle(4.0));
        for (half, agreement, farthest) in
            [(4.0, 1.0, 0.0), (2.0, 0.5, 2.0), (8.0, 0.5, 4.0), (0.0, 0.0, 4.0)]
        {
            let Likeness { agreement: found, farthest_mm } = of.likeness(&knots(half));
            assert!((found - agreement).abs() < 1e-3, "{half}: {found}");
            assert!((farthest_mm - farthest).abs() < 0.05, "{half}: {farthest_mm} mm");
        }
    }
}
