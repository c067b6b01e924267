//! Scenes: which blades stand before the camera, and where.
//!
//! A family is one function from random numbers to blades; a new one is a variant, a function and a
//! line in [`Family::place`].

use glam::DVec3;

use super::blade::{Growth, SHAPES, Shape, SyntheticBlade};
use super::random::Random;

/// A family of scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// One blade, its root below.
    Single,
    /// Three to six blades side by side that do not touch.
    Row,
}

/// All families.
pub const FAMILIES: [Family; 2] = [Family::Single, Family::Row];

/// Blades before a camera that looks at a wall.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Where it comes from.
    pub family: Family,
    /// Which one of its family.
    pub seed: u64,
    /// The blades, camera frame; in a row from left to right.
    pub blades: Vec<SyntheticBlade>,
}

/// The stream of random numbers that scenes use; the sensor's frames use those above it.
const SCENE_STREAM: u64 = 0;
/// Nearest and farthest middle of a blade, metres.
const DEPTH_RANGE_M: (f64, f64) = (0.50, 0.65);
/// Widest row, metres: it fits into the picture of a camera of 58° at the nearest depth.
const ROW_WIDTH_M: f64 = 0.48;

impl Scene {
    /// The scene of a family with a seed: the same on every machine.
    pub fn new(family: Family, seed: u64) -> Self {
        Self { family, seed, blades: family.place(seed) }
    }
}

impl Family {
    /// Its name as on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Family::Single => "single",
            Family::Row => "row",
        }
    }

    fn place(self, seed: u64) -> Vec<SyntheticBlade> {
        // A family has its own numbers: the blade of `single 1` is not one of `row 1`.
        let mut random = Random::new(seed ^ ((self as u64) << 56), SCENE_STREAM);
        match self {
            Family::Single => single(SHAPES[(seed % SHAPES.len() as u64) as usize], &mut random),
            Family::Row => row(&mut random),
        }
    }
}

/// One blade near the middle of the picture. Its shape is given, so that five seeds in a row show
/// all five.
fn single(shape: Shape, random: &mut Random) -> Vec<SyntheticBlade> {
    let blade = Growth::random(shape, random).grow();
    let (x, y) = (random.range(-0.06, 0.06), random.range(-0.02, 0.02));
    let z = random.range(DEPTH_RANGE_M.0, DEPTH_RANGE_M.1);
    vec![centered(blade, DVec3::new(x, y, z))]
}

/// Three to six blades from left to right, 12 to 30 mm of air between the boxes that hold them.
fn row(random: &mut Random) -> Vec<SyntheticBlade> {
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

/// The blade with the middle of its box at `at`.
fn centered(blade: SyntheticBlade, at: DVec3) -> SyntheticBlade {
    let (low, high) = blade.bounds();
    blade.moved(at - 0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn five_seeds_in_a_row_show_all_five_shapes() {
        let shapes: Vec<Shape> =
            (10..15).map(|seed| Scene::new(Family::Single, seed).blades[0].shape).collect();
        for shape in SHAPES {
            assert!(shapes.contains(&shape), "{shape:?}");
        }
    }

    #[test]
    fn blades_of_a_row_stand_apart_and_in_the_picture() {
        for seed in 0..50 {
            let blades = Scene::new(Family::Row, seed).blades;
            assert!((3..=6).contains(&blades.len()));
            for pair in blades.windows(2) {
                assert!(pair[0].bounds().1.x + 0.01 < pair[1].bounds().0.x, "seed {seed}");
            }
            for blade in &blades {
                let (low, high) = blade.bounds();
                let x = low.x.abs().max(high.x.abs()) / low.z;
                let y = low.y.abs().max(high.y.abs()) / low.z;
                assert!(x < 0.53 && y < 0.30, "seed {seed}: {x} {y}");
            }
        }
    }

    #[test]
    fn sizes_are_those_of_the_design() {
        for family in FAMILIES {
            for blade in (0..30).flat_map(|seed| Scene::new(family, seed).blades) {
                let aspect = blade.max_width_m / blade.length_m;
                assert!((0.12..=0.26).contains(&blade.length_m));
                assert!((0.04..=0.14).contains(&aspect));
                let (low, high) = blade.bounds();
                assert!(low.z > 0.4 && high.z < 0.75);
            }
        }
    }
}
