//! Where the blades of each family stand: functions from random numbers to blades.
//!
//! A layout is drawn again until it shows what its family promises; the conditions are the constants
//! and functions at the end. All of it is in camera space, the root of every blade below.

use glam::{DVec2, DVec3};

use super::blade::{Growth, SECTIONS, SHAPES, Section, Shape, SyntheticBlade};
use super::hand::Triangle;
use super::random::Random;
use super::surface::Surface;
use crate::frame::CameraModel;

/// Nearest and farthest middle of a blade, metres.
const DEPTH_RANGE_M: (f64, f64) = (0.50, 0.65);
/// Widest row, metres: it fits into the picture of a camera of 58° at the nearest depth.
const ROW_WIDTH_M: f64 = 0.48;
/// Largest |x|/z and |y|/z of a layout: it fits into pictures of 4:3 and of 16:9, 58° wide.
pub(super) const VIEW: DVec2 = DVec2::new(0.53, 0.30);
/// Largest part of a blade's midrib that others may hide.
const HIDDEN_SHARE: f64 = 0.35;
/// What lies this much before a section hides it, metres.
const HIDES_M: f64 = 0.002;
/// Least distance of a tip from the edges of other blades in the picture, metres at the tip's depth.
const TIP_FREE_M: f64 = 0.004;
/// Least distance between two tips in the picture, metres at their depth.
const TIPS_APART_M: f64 = 0.012;
/// The camera that layouts are judged by, coarser than all that film them.
const JUDGE: CameraModel = CameraModel { fx: 285.0, fy: 285.0, cx: 159.5, cy: 119.5 };
/// Its columns and rows.
const JUDGE_SIZE: (usize, usize) = (320, 240);

/// One blade near the middle of the picture.
pub(super) fn single(shape: Shape, random: &mut Random) -> Vec<SyntheticBlade> {
    let blade = Growth::random(shape, random).grow();
    vec![centered(blade, place_of_one(random))]
}

/// One blade that bends by 0.4 to 1.2 rad in depth, towards the camera or away from it; its root leans
/// the other way, more or less.
pub(super) fn toward(shape: Shape, random: &mut Random) -> Vec<SyntheticBlade> {
    // Of blades that bend towards the camera, some would cover themselves.
    loop {
        let side = if random.unit() < 0.5 { -1.0 } else { 1.0 };
        let mut growth = Growth::random(shape, random);
        growth.bend_out = side * random.range(0.4, 1.2);
        growth.tilt = side * random.range(-0.35, 0.1);
        growth.yaw *= 0.6;
        growth.bend_across *= 0.6;
        let blades = vec![centered(growth.grow(), place_of_one(random))];
        if rises(&blades[0]) && in_view(&blades) {
            return blades;
        }
    }
}

/// One blade that twists by 30° to 90° about its midrib, flat otherwise; in its middle it faces the
/// camera, more or less.
pub(super) fn twisted(shape: Shape, random: &mut Random) -> Vec<SyntheticBlade> {
    let mut growth = Growth::random(shape, random);
    let side = if random.unit() < 0.5 { -1.0 } else { 1.0 };
    growth.twist = side * random.range(0.524, 1.57);
    growth.yaw = -0.5 * growth.twist + random.range(-0.15, 0.15);
    growth.bend_across *= 0.6;
    vec![centered(growth.grow(), place_of_one(random))]
}

/// One blade whose halves differ in width, 1:1.2 to 1:2, folded along the midrib by 10° to 25°: its
/// edges lie behind the midrib or before it, so that a depth camera sees where the midrib is.
pub(super) fn asymmetric(shape: Shape, random: &mut Random) -> Vec<SyntheticBlade> {
    let mut growth = Growth::random(shape, random);
    growth.left_share = 1.0 / (1.0 + random.range(1.2, 2.0));
    if random.unit() < 0.5 {
        growth.left_share = 1.0 - growth.left_share;
    }
    let side = if random.unit() < 0.5 { -1.0 } else { 1.0 };
    // Tangents of 10° and 25°.
    growth.fold = side * random.range(0.1763, 0.4663);
    growth.yaw *= 0.6;
    growth.twist *= 0.6;
    vec![centered(growth.grow(), place_of_one(random))]
}

/// The middle of a blade that stands alone.
fn place_of_one(random: &mut Random) -> DVec3 {
    let (x, y) = (random.range(-0.06, 0.06), random.range(-0.02, 0.02));
    DVec3::new(x, y, random.range(DEPTH_RANGE_M.0, DEPTH_RANGE_M.1))
}

/// Three to six blades from left to right, 12 to 30 mm of air between the boxes that hold them.
pub(super) fn row(random: &mut Random) -> Vec<SyntheticBlade> {
    let z = random.range(DEPTH_RANGE_M.0 + 0.02, DEPTH_RANGE_M.1 - 0.02);
    // A row that came out too wide is drawn again; about every second one of six blades is.
    loop {
        let count = random.integer(3, 6);
        let placed: Vec<(SyntheticBlade, f64)> = (0..count)
            .map(|_| {
                let shape = SHAPES[random.integer(0, SHAPES.len() - 1)];
                let mut growth = Growth::random(shape, random);
                growth.lean *= 0.5;
                growth.bend_across *= 0.5;
                (growth.grow(), random.range(0.012, 0.030))
            })
            .collect();
        let width = |blade: &SyntheticBlade| blade.bounds().1.x - blade.bounds().0.x;
        let total: f64 = placed.iter().map(|(blade, gap)| width(blade) + gap).sum();
        if total > ROW_WIDTH_M {
            continue;
        }
        let mut left = -0.5 * total;
        return placed
            .into_iter()
            .map(|(blade, gap)| {
                let x = left + 0.5 * (gap + width(&blade));
                left += gap + width(&blade);
                let depth = z + random.range(-0.02, 0.02);
                centered(blade, DVec3::new(x, random.range(-0.015, 0.015), depth))
            })
            .collect();
    }
}

/// Three to nine blades from one base, from left to right: the roots within 15 mm of each other in the
/// picture and 20 mm in depth, neighbours at least 7° apart there, every tip free.
pub(super) fn fan(random: &mut Random) -> Vec<SyntheticBlade> {
    let count = random.integer(3, 9);
    // Tufts are mostly of one species.
    let species = (random.unit() < 0.7).then(|| SHAPES[random.integer(0, SHAPES.len() - 1)]);
    loop {
        let (x, y) = (random.range(-0.03, 0.03), random.range(-0.01, 0.01));
        let at = DVec3::new(x, y, random.range(DEPTH_RANGE_M.0 + 0.02, DEPTH_RANGE_M.1 - 0.02));
        let blades = centered_all(tuft(count, species, random), at);
        if in_view(&blades) && is_clear(&blades, &[]) {
            return blades;
        }
    }
}

/// Blades that fan out from one base at the origin, from left to right; spread over ±15° to ±60°, more
/// for more blades, but never less than 7° between neighbours.
fn tuft(count: usize, species: Option<Shape>, random: &mut Random) -> Vec<SyntheticBlade> {
    // 0 for three blades, 1 for nine.
    let fullness = (count - 3) as f64 / 6.0;
    let half_spread = random.range(0.26 + 0.50 * fullness, 0.44 + 0.60 * fullness);
    spread(count, half_spread, random, |random| {
        let shape = species.unwrap_or_else(|| SHAPES[random.integer(0, SHAPES.len() - 1)]);
        Growth { lean: 0.0, ..Growth::random(shape, random) }
    })
}

/// One to five blades from one grip at the origin, from left to right: 150 to 270 mm long, 10° to 16°
/// between neighbours, more or less; one alone leans by up to 15°.
pub(super) fn handful(count: usize, random: &mut Random) -> Vec<SyntheticBlade> {
    let half_spread = 0.5 * (count - 1) as f64 * random.range(0.18, 0.28);
    let lean = if count == 1 { random.range(-0.26, 0.26) } else { random.range(-0.1, 0.1) };
    spread(count, half_spread, random, |random| {
        let mut growth = Growth::random(SHAPES[random.integer(0, SHAPES.len() - 1)], random);
        let longer = random.range(0.15, 0.27) / growth.length_m;
        growth.length_m *= longer;
        growth.max_width_m *= longer;
        growth.lean = lean;
        growth
    })
}

/// Blades from one base at the origin, from left to right, with leans of ±`half_spread` radians about
/// their own; each off its even place, but neighbours stay 7° apart if they are when evenly spread.
fn spread(
    count: usize,
    half_spread: f64,
    random: &mut Random,
    mut grow: impl FnMut(&mut Random) -> Growth,
) -> Vec<SyntheticBlade> {
    let gaps = count.max(2) as f64 - 1.0;
    let step = 2.0 * half_spread / gaps;
    // 7° are 0.122 rad.
    let slack = 0.5 * (step - 0.125).clamp(0.0, 0.3 * step);
    (0..count)
        .map(|i| {
            // −1 for the leftmost blade to 1 for the rightmost; 0 for one alone.
            let place = if count == 1 { 0.0 } else { 2.0 * i as f64 / gaps - 1.0 };
            let mut growth = grow(random);
            growth.lean += half_spread * place + random.range(-slack, slack);
            // Outer blades droop outwards, a little.
            growth.bend_across = 0.15 * place + random.range(-0.3, 0.3);
            growth.yaw *= 0.7;
            let (dx, dy) = (0.005 * place + random.range(-0.0025, 0.0025), random.range(-0.004, 0.004));
            growth.grow().moved(DVec3::new(dx, dy, random.range(-0.01, 0.01)))
        })
        .collect()
}

/// Two blades, or, one time in five, three, from the nearest to the farthest: each 4 to 7 cm behind the
/// one before at the root; they cross in the picture at 30 to 70 % of their lengths, at 25° to 90°.
pub(super) fn crossing(random: &mut Random) -> Vec<SyntheticBlade> {
    let count = if random.unit() < 0.2 { 3 } else { 2 };
    loop {
        let mut depth = random.range(0.49, 0.53);
        let side = if random.unit() < 0.5 { -1.0 } else { 1.0 };
        let between = random.range(0.5, 1.5);
        let blades: Vec<SyntheticBlade> = (0..count)
            .map(|i| {
                let mut growth = Growth::random(SHAPES[random.integer(0, SHAPES.len() - 1)], random);
                // Evenly about the upright, the third between the first two.
                let leans = [-0.5, 0.5, 0.0];
                growth.lean = side * leans[i] * between + random.range(-0.15, 0.15);
                growth.bend_across *= 0.6;
                growth.bend_out *= 0.6;
                let blade = growth.grow();
                let middle = blade.sections[random.integer(SECTIONS * 32 / 100, SECTIONS * 68 / 100)].center;
                // The place that it crosses the others at lies on the optical axis.
                let spread = DVec3::new(random.range(-0.01, 0.01), random.range(-0.01, 0.01), 0.0);
                let at = spread - middle.with_z(0.0) + DVec3::Z * depth;
                depth += random.range(0.04, 0.07);
                blade.moved(at)
            })
            .collect();
        let (x, y) = (random.range(-0.04, 0.04), random.range(-0.01, 0.01));
        let depth = 0.5 * (depth + blades[0].sections[0].center.z) - 0.03;
        let blades = centered_all(blades, DVec3::new(x, y, depth));
        if crossings_are_good(&blades) && in_view(&blades) && is_clear(&blades, &[]) {
            return blades;
        }
    }
}

/// The blade with the middle of its box at `at`.
pub(super) fn centered(blade: SyntheticBlade, at: DVec3) -> SyntheticBlade {
    let (low, high) = blade.bounds();
    blade.moved(at - 0.5 * (low + high))
}

/// The blades with the middle of the box that holds them all at `at`.
fn centered_all(blades: Vec<SyntheticBlade>, at: DVec3) -> Vec<SyntheticBlade> {
    let (low, high) = bounds_of_all(&blades);
    let by = at - 0.5 * (low + high);
    blades.into_iter().map(|blade| blade.moved(by)).collect()
}

/// The box that holds them all.
pub(super) fn bounds_of_all(blades: &[SyntheticBlade]) -> (DVec3, DVec3) {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    blades.iter().map(SyntheticBlade::bounds).fold(none, |all, one| (all.0.min(one.0), all.1.max(one.1)))
}

/// Whether pictures of all sizes hold the blades.
pub(super) fn in_view(blades: &[SyntheticBlade]) -> bool {
    let (low, high) = bounds_of_all(blades);
    let reach = low.truncate().abs().max(high.truncate().abs());
    low.z > 0.4 && high.z < 0.75 && (reach / low.z).cmple(VIEW).all()
}

/// Whether a blade's midrib rises in the picture all the way: it does not fold back over itself.
fn rises(blade: &SyntheticBlade) -> bool {
    let least = 0.15 * blade.length_m / (SECTIONS - 1) as f64;
    let height: Vec<f64> =
        blade.sections.iter().map(|section| -section.center.y / section.center.z).collect();
    height
        .windows(2)
        .zip(&blade.sections)
        .all(|(pair, section)| (pair[1] - pair[0]) * section.center.z > least)
}

/// In the picture of a camera with a focal length of one.
fn seen(point: DVec3) -> DVec2 {
    point.truncate() / point.z
}

/// Whether every tip stands clear of all other blades and tips in the picture.
fn tips_are_free(blades: &[SyntheticBlade]) -> bool {
    let tip = |blade: &SyntheticBlade| blade.sections[SECTIONS - 1].center;
    blades.iter().enumerate().all(|(i, blade)| {
        let (at, depth) = (seen(tip(blade)), tip(blade).z);
        blades.iter().enumerate().filter(|&(j, _)| j != i).all(|(_, other)| {
            let clear = |section: &Section| {
                let half_width = section.half_width_left.max(section.half_width_right);
                at.distance(seen(section.center)) * depth > half_width + TIP_FREE_M
            };
            at.distance(seen(tip(other))) * depth > TIPS_APART_M && other.sections.iter().all(clear)
        })
    })
}

/// Whether every tip stands clear of all other blades and tips in the picture, and no tip and at most
/// [`HIDDEN_SHARE`] of any midrib is hidden behind another blade or a hand.
pub(super) fn is_clear(blades: &[SyntheticBlade], hand: &[Triangle]) -> bool {
    if !tips_are_free(blades) {
        return false;
    }
    let surface = Surface::draw(blades, hand, &JUDGE, JUDGE_SIZE);
    blades.iter().all(|blade| {
        let hidden = |section: &&Section| {
            let at = seen(section.center);
            let (u, v) = (JUDGE.fx * at.x + JUDGE.cx, JUDGE.fy * at.y + JUDGE.cy);
            surface.depth_at(u, v) < section.center.z - HIDES_M
        };
        let tip_hides = blade.sections[SECTIONS * 9 / 10..].iter().any(|section| hidden(&section));
        let count = blade.sections.iter().filter(hidden).count();
        !tip_hides && count as f64 <= HIDDEN_SHARE * SECTIONS as f64
    })
}

/// Where two midribs cross in the picture.
#[derive(Debug)]
pub(super) struct Crossing {
    /// Part of each one's length at which they do, 0..=1.
    along: [f64; 2],
    /// Between their directions there, radians, 0..=π/2, as its sine.
    sine: f64,
    /// How much farther the second is there, metres.
    depth_gap_m: f64,
}

/// All crossings of two midribs in the picture, judged at every fourth section.
pub(super) fn crossings_of(a: &SyntheticBlade, b: &SyntheticBlade) -> Vec<Crossing> {
    const STEP: usize = 4;
    let points = |blade: &SyntheticBlade| -> Vec<DVec3> {
        blade.sections.iter().step_by(STEP).map(|section| section.center).collect()
    };
    let (a, b) = (points(a), points(b));
    let mut found = Vec::new();
    for (i, of_a) in a.windows(2).enumerate() {
        let (from_a, by_a) = (seen(of_a[0]), seen(of_a[1]) - seen(of_a[0]));
        for (j, of_b) in b.windows(2).enumerate() {
            let (from_b, by_b) = (seen(of_b[0]), seen(of_b[1]) - seen(of_b[0]));
            let cross = by_a.perp_dot(by_b);
            let (t, u) = ((from_b - from_a).perp_dot(by_b) / cross, (from_b - from_a).perp_dot(by_a) / cross);
            if (0.0..1.0).contains(&t) && (0.0..1.0).contains(&u) {
                found.push(Crossing {
                    along: [(i as f64 + t) / (a.len() - 1) as f64, (j as f64 + u) / (b.len() - 1) as f64],
                    sine: (cross / (by_a.length() * by_b.length())).abs(),
                    depth_gap_m: of_b[0].z - of_a[0].z,
                });
            }
        }
    }
    found
}

/// Whether every two of the blades cross once at most, each is crossed, and each crossing lies where it
/// should, the first blade before the second; and whether the lower ends are apart.
fn crossings_are_good(blades: &[SyntheticBlade]) -> bool {
    let mut crossed = vec![false; blades.len()];
    for (j, behind) in blades.iter().enumerate() {
        for (i, before) in blades[..j].iter().enumerate() {
            let roots =
                [before, behind].map(|blade| seen(blade.sections[0].center) * blade.sections[0].center.z);
            if roots[0].distance(roots[1]) < 0.03 {
                return false;
            }
            let found = crossings_of(before, behind);
            let good = |it: &Crossing| {
                // The sine of 25°.
                it.along.iter().all(|along| (0.3..=0.7).contains(along))
                    && it.sine >= 0.4226
                    && it.depth_gap_m >= 0.02
            };
            if found.len() > 1 || !found.iter().all(good) {
                return false;
            }
            if !found.is_empty() {
                (crossed[i], crossed[j]) = (true, true);
            }
        }
    }
    crossed.iter().all(|&crossed| crossed)
}

#[cfg(test)]
mod tests {
    use super::super::scene::{Family, Scene};
    use super::*;

    #[test]
    fn a_fan_grows_from_one_base() {
        for seed in 0..40 {
            let blades = Scene::new(Family::Fan, seed).blades;
            assert!((3..=9).contains(&blades.len()));
            let roots: Vec<DVec3> = blades.iter().map(|blade| blade.sections[0].center).collect();
            for (i, root) in roots.iter().enumerate() {
                for other in &roots[..i] {
                    assert!((root.truncate() - other.truncate()).length() < 0.018, "seed {seed}");
                    assert!((root.z - other.z).abs() < 0.02, "seed {seed}");
                }
            }
            for pair in blades.windows(2) {
                let lean = |blade: &SyntheticBlade| {
                    let by = blade.sections[1].center - blade.sections[0].center;
                    (by.x / -by.y).atan()
                };
                assert!(lean(&pair[1]) - lean(&pair[0]) > 0.1, "seed {seed}");
            }
        }
    }

    #[test]
    fn blades_of_a_crossing_cross_apart_in_depth() {
        for seed in 0..40 {
            let blades = Scene::new(Family::Crossing, seed).blades;
            for pair in blades.windows(2) {
                let gap = pair[1].sections[0].center.z - pair[0].sections[0].center.z;
                assert!((0.04..0.07).contains(&gap), "seed {seed}: {gap} m");
            }
            assert_eq!(crossings_of(&blades[0], &blades[1]).len(), 1, "seed {seed}");
        }
    }

    #[test]
    fn a_blade_of_toward_bends_in_depth() {
        for seed in 0..40 {
            let blade = &Scene::new(Family::Toward, seed).blades[0];
            let slope = |i: usize| {
                let by = blade.sections[i + 1].center - blade.sections[i].center;
                (by.z / by.length()).asin()
            };
            let bend = (slope(SECTIONS - 2) - slope(0)).abs();
            assert!((0.3..1.3).contains(&bend), "seed {seed}: {bend} rad");
        }
    }
}
