//! The blades of a library as the vertex shader wants them: each with 16, 8, 4 and 2 knots, and how each
//! of these turns into the next.
//!
//! A library may hold a blade that is 5 m long, or one of 1 mm: shapes are brought to what a meadow has, so
//! that it stays a meadow and bounds stay bounds.

use bytemuck::{Pod, Zeroable};
use common::blade::Knot;
use common::library::Snapshot;
use common::refine;
use common::strand::motions_in_wind;
use glam::Vec3;

use super::mix;

/// Knots of a blade at each level of detail, fine to coarse.
pub const LEVEL_KNOTS: [u32; 4] = [16, 8, 4, 2];
/// Number of levels of detail.
pub const LEVELS: usize = LEVEL_KNOTS.len();
/// Knots of all levels of a shape.
pub const SHAPE_KNOTS: u32 = LEVEL_KNOTS[0] + LEVEL_KNOTS[1] + LEVEL_KNOTS[2] + LEVEL_KNOTS[3];
/// Shortest and longest reach of a shape, metres; others are scaled to it.
pub const REACH_M: (f32, f32) = (0.04, 0.6);
/// Widest half of a shape, as a part of its reach; what is wider is made narrower.
pub const MAX_HALF_WIDTH: f32 = 0.25;
/// Narrowest half of a shape at its widest knot, as a part of its reach: a thread of no width is no blade.
pub const MIN_HALF_WIDTH: f32 = 0.004;
/// Most that a level's knots are widened to keep the area.
const MAX_LEVEL_WIDEN: f32 = 2.5;
/// Moments of a blade's motion that its levels are chosen by.
const FRAMES: usize = 8;
/// How much distance counts against movement (μ of Eq. 1).
const DISTANCE_WEIGHT: f32 = 0.7;

/// The first knot of each level among a shape's.
pub const fn first_knot(level: usize) -> u32 {
    let mut first = 0;
    let mut finer = 0;
    while finer < level {
        first += LEVEL_KNOTS[finer];
        finer += 1;
    }
    first
}

/// A cross-section of a shape at one level of detail, as the shaders read it: 64 bytes. Blade frame, metres.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ShapeKnot {
    /// Position on the midrib.
    pub position: Vec3,
    /// Arc length from the root, as a part of the blade's, 0 to 1.
    pub along: f32,
    /// Unit vector from the left edge to the right edge.
    pub across: Vec3,
    /// From the midrib to the left edge.
    pub half_width_left: f32,
    /// Unit vector along the midrib to the tip.
    pub tangent: Vec3,
    /// From the midrib to the right edge.
    pub half_width_right: f32,
    /// The next coarser level's row at or before this knot, 0..=its knots − 2.
    pub coarse_row: u32,
    /// How far this knot comes to lie from that row to the one after it, 0 to 1.
    pub coarse_between: f32,
    /// Which of the finest level's knots this is: where a simulated blade has it.
    pub finest_row: u32,
    /// Farthest that any part of the shape is from its root, metres.
    pub reach_m: f32,
}

/// A library's shapes, ready for the GPU.
#[derive(Clone, Debug, PartialEq)]
pub struct Shapes {
    /// Generation of the library.
    pub generation: u64,
    /// [`SHAPE_KNOTS`] a shape, in the library's order: each level's, fine to coarse.
    pub knots: Vec<ShapeKnot>,
    /// Which shape each shape index stands for: see [`mix::shape_table`].
    pub table: Vec<u32>,
    /// Farthest that any part of any shape is from its root, metres.
    pub reach_m: f32,
}

/// Makes the shapes of a library. `None`: nothing in it grows.
///
/// Some 0.3 ms a blade: not for the thread that draws.
pub fn shapes<B: AsRef<[u8]>>(library: &Snapshot<B>) -> Option<Shapes> {
    let weights: Vec<_> = library.blades().map(|blade| (blade.id(), blade.mix())).collect();
    let table = mix::shape_table(&weights)?;
    let fitted: Vec<Vec<Knot>> = library.blades().map(|blade| fit(blade.knots())).collect();
    let midribs: Vec<Vec<Vec3>> =
        fitted.iter().map(|knots| knots.iter().map(|knot| knot.position).collect()).collect();
    let midribs: Vec<&[Vec3]> = midribs.iter().map(Vec::as_slice).collect();
    let motions = motions_in_wind(&midribs, FRAMES);
    let mut knots = Vec::with_capacity(fitted.len() * SHAPE_KNOTS as usize);
    for (blade, motion) in fitted.iter().zip(&motions) {
        let counts = LEVEL_KNOTS.map(|count| count as usize);
        knots.extend(of_blade(blade, &refine::levels(blade, motion, DISTANCE_WEIGHT, &counts)));
    }
    let reach_m = knots.iter().map(|knot: &ShapeKnot| knot.reach_m).fold(0.0, f32::max);
    Some(Shapes { generation: library.generation(), knots, table, reach_m })
}

fn reach_m(knots: &[Knot]) -> f32 {
    knots.iter().flat_map(|knot| [knot.left(), knot.right()]).map(Vec3::length).fold(0.0, f32::max)
}

/// Of a size that a meadow has, and of at least as many knots as the finest level.
fn fit(mut knots: Vec<Knot>) -> Vec<Knot> {
    let root = knots[0].position;
    knots.iter_mut().for_each(|knot| knot.position -= root);
    let length_m = knots.iter().map(|knot| knot.position.length()).fold(f32::MIN_POSITIVE, f32::max);
    let scale = length_m.clamp(REACH_M.0, REACH_M.1 * (1.0 - MAX_HALF_WIDTH)) / length_m;
    let reach_m = length_m * scale;
    let widest_m =
        knots.iter().map(|knot| knot.half_width_left.max(knot.half_width_right)).fold(0.0, f32::max);
    let wanted_m = (widest_m * scale).clamp(MIN_HALF_WIDTH * reach_m, MAX_HALF_WIDTH * reach_m);
    for knot in &mut knots {
        knot.position *= scale;
        if widest_m > 0.0 {
            knot.half_width_left *= wanted_m / widest_m;
            knot.half_width_right *= wanted_m / widest_m;
        } else {
            (knot.half_width_left, knot.half_width_right) = (wanted_m, wanted_m);
        }
    }
    while knots.len() < LEVEL_KNOTS[0] as usize {
        let link = |at: &usize| knots[*at].position.distance(knots[at + 1].position);
        let longest = (0..knots.len() - 1).max_by(|a, b| link(a).total_cmp(&link(b))).unwrap_or(0);
        let (a, b) = (knots[longest], knots[longest + 1]);
        knots.insert(
            longest + 1,
            Knot {
                position: a.position.midpoint(b.position),
                half_width_left: 0.5 * (a.half_width_left + b.half_width_left),
                across: (a.across + b.across).normalize_or(a.across),
                half_width_right: 0.5 * (a.half_width_right + b.half_width_right),
            },
        );
    }
    knots
}

/// The area of left and right half of a ribbon, square metres.
fn areas(knots: &[Knot]) -> [f32; 2] {
    let mut areas = [0.0; 2];
    for pair in knots.windows(2) {
        let link_m = pair[0].position.distance(pair[1].position);
        areas[0] += 0.5 * link_m * (pair[0].half_width_left + pair[1].half_width_left);
        areas[1] += 0.5 * link_m * (pair[0].half_width_right + pair[1].half_width_right);
    }
    areas
}

/// All levels of one blade. `levels`: for each of [`LEVEL_KNOTS`] which of the blade's knots it has.
fn of_blade(blade: &[Knot], levels: &[refine::Level]) -> Vec<ShapeKnot> {
    let finest: Vec<Knot> = levels[0].iter().map(|index| blade[*index]).collect();
    let along = along(&finest);
    let [left, right] = areas(&finest);
    let reach_m = reach_m(blade);
    // Rows of the finest level, which has all that the others have.
    let rows_of = |level: &refine::Level| -> Vec<usize> {
        level.iter().filter_map(|index| levels[0].iter().position(|finest| finest == index)).collect()
    };
    let mut all = Vec::with_capacity(SHAPE_KNOTS as usize);
    for (nth, level) in levels.iter().enumerate() {
        let rows = rows_of(level);
        let mut knots: Vec<Knot> = rows.iter().map(|row| finest[*row]).collect();
        if rows.len() == 2 {
            // A triangle: all of its area hangs on the root's width.
            let span_m = knots[0].position.distance(knots[1].position).max(f32::MIN_POSITIVE);
            (knots[0].half_width_left, knots[0].half_width_right) =
                (bounded(2.0 * left / span_m, reach_m), bounded(2.0 * right / span_m, reach_m));
            (knots[1].half_width_left, knots[1].half_width_right) = (0.0, 0.0);
            knots[0].across = finest[finest.len() / 3].across;
        } else {
            let [own_left, own_right] = areas(&knots);
            let widen = |whole: f32, own: f32| {
                if own > 0.0 { (whole / own).clamp(1.0 / MAX_LEVEL_WIDEN, MAX_LEVEL_WIDEN) } else { 1.0 }
            };
            let (widen_left, widen_right) = (widen(left, own_left), widen(right, own_right));
            for knot in &mut knots {
                knot.half_width_left *= widen_left;
                knot.half_width_right *= widen_right;
            }
        }
        let coarser = levels.get(nth + 1).map(rows_of);
        all.extend(knots.iter().zip(&rows).enumerate().map(|(at, (knot, row))| {
            let (coarse_row, coarse_between) =
                coarser.as_ref().map_or((0, 0.0), |coarser| place(&along, coarser, *row));
            let (before, after) = (at.saturating_sub(1), (at + 1).min(knots.len() - 1));
            ShapeKnot {
                position: knot.position,
                along: along[*row],
                across: knot.across,
                half_width_left: knot.half_width_left,
                tangent: (knots[after].position - knots[before].position).normalize_or(Vec3::Y),
                half_width_right: knot.half_width_right,
                coarse_row,
                coarse_between,
                finest_row: *row as u32,
                reach_m,
            }
        }));
    }
    all
}

fn bounded(half_width_m: f32, reach_m: f32) -> f32 {
    half_width_m.min(2.0 * MAX_HALF_WIDTH * reach_m)
}

/// Each knot's arc length as a part of the whole.
fn along(knots: &[Knot]) -> Vec<f32> {
    let midrib: Vec<Vec3> = knots.iter().map(|knot| knot.position).collect();
    let lengths = common::geometry::polyline::cumulative_length(&midrib);
    let whole = lengths.last().copied().unwrap_or(0.0).max(f32::MIN_POSITIVE);
    lengths.into_iter().map(|length| length / whole).collect()
}

/// Where the finest level's `row` comes to lie among those of `coarser` (ascending, first and last among them).
fn place(along: &[f32], coarser: &[usize], row: usize) -> (u32, f32) {
    let before = coarser.iter().rposition(|coarse| *coarse <= row).unwrap_or(0).min(coarser.len() - 2);
    let (from, to) = (along[coarser[before]], along[coarser[before + 1]]);
    let between = (along[row] - from) / (to - from).max(f32::MIN_POSITIVE);
    (before as u32, between.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::blade::{Blade, BladeId};

    fn arc(length_m: f32, width_m: f32, knots: usize) -> Blade {
        let knots: Vec<Knot> = (0..knots)
            .map(|knot| {
                let t = knot as f32 / (knots - 1) as f32;
                let position = Vec3::new(1.0 - (1.2 * t).cos(), (1.2 * t).sin(), 0.0) / 1.2 * length_m;
                let half = 0.5 * width_m * (0.6 + 1.4 * t) * (1.0 - t);
                Knot { position, half_width_left: half, across: Vec3::Z, half_width_right: half }
            })
            .collect();
        Blade::new(BladeId::of(1, 0, &knots), "arc", knots, [length_m, width_m], 0, 1.0).expect("plausible")
    }

    fn shapes_of(blades: &[Blade]) -> Shapes {
        let bytes = common::library::encode(1, blades).expect("few blades");
        shapes(&Snapshot::validate(bytes).expect("valid")).expect("something grows")
    }

    fn level(shapes: &Shapes, shape: usize, level: usize) -> &[ShapeKnot] {
        let first = shape * SHAPE_KNOTS as usize + first_knot(level) as usize;
        &shapes.knots[first..first + LEVEL_KNOTS[level] as usize]
    }

    fn area(knots: &[ShapeKnot]) -> f32 {
        let width = |knot: &ShapeKnot| knot.half_width_left + knot.half_width_right;
        knots
            .windows(2)
            .map(|pair| {
                0.5 * pair[0].position.distance(pair[1].position) * (width(&pair[0]) + width(&pair[1]))
            })
            .sum()
    }

    #[test]
    fn every_level_has_its_knots_from_root_to_tip_and_about_the_same_area() {
        let shapes = shapes_of(&[arc(0.2, 0.01, 24), arc(0.2, 0.01, 3)]);
        for shape in 0..2 {
            let whole = area(level(&shapes, shape, 0));
            for at in 0..LEVELS {
                let knots = level(&shapes, shape, at);
                assert_eq!((knots[0].along, knots[knots.len() - 1].along), (0.0, 1.0));
                assert!(knots.is_sorted_by(|a, b| a.along < b.along));
                assert!((area(knots) / whole - 1.0).abs() < 0.02, "level {at}: {} of {whole}", area(knots));
            }
        }
    }

    #[test]
    fn a_level_turns_into_the_next_without_a_step() {
        let shapes = shapes_of(&[arc(0.2, 0.01, 40)]);
        for at in 0..LEVELS - 1 {
            let (fine, coarse) = (level(&shapes, 0, at), level(&shapes, 0, at + 1));
            for knot in fine {
                let (a, b) = (&coarse[knot.coarse_row as usize], &coarse[knot.coarse_row as usize + 1]);
                let along = a.along + (b.along - a.along) * knot.coarse_between;
                assert!((along - knot.along).abs() < 1e-5, "level {at}: {knot:?} between {a:?} and {b:?}");
            }
            // The knots that stay do not move at all.
            let stays = |knot: &&ShapeKnot| coarse.iter().any(|other| other.finest_row == knot.finest_row);
            for knot in fine.iter().filter(stays) {
                let (a, b) = (&coarse[knot.coarse_row as usize], &coarse[knot.coarse_row as usize + 1]);
                assert!(a.position.lerp(b.position, knot.coarse_between).distance(knot.position) < 1e-6);
            }
        }
    }

    #[test]
    fn absurd_blades_become_such_as_a_meadow_has() {
        let blades = [
            arc(5.0, 0.2, 16),
            arc(0.001, 0.0001, 16),
            arc(0.2, 0.0, 16),
            arc(0.2, 3.0, 16),
            arc(1e-12, 1e-12, 5),
        ];
        let shapes = shapes_of(&blades);
        for (shape, _) in blades.iter().enumerate() {
            for at in 0..LEVELS {
                for knot in level(&shapes, shape, at) {
                    assert!(bytemuck::bytes_of(knot).chunks_exact(4).take(14).all(|bytes| {
                        f32::from_ne_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]).is_finite()
                    }));
                    assert!(
                        (REACH_M.0 * 0.99..=REACH_M.1).contains(&knot.reach_m),
                        "{shape}: {}",
                        knot.reach_m
                    );
                    let far = knot.position.length() + knot.half_width_left.max(knot.half_width_right);
                    assert!(far < 1.6 * knot.reach_m, "{shape}, level {at}: {far} of {}", knot.reach_m);
                }
                assert!(area(level(&shapes, shape, at)) > 1e-6, "shape {shape} is to be seen");
            }
        }
        assert!(shapes.reach_m <= REACH_M.1);
    }
}
