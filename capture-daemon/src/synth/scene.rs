//! Scenes: which blades stand before the camera, and where.
//!
//! A family is one function from random numbers to blades (see [`arrange`]); a new one is a variant, a
//! function and a line in [`Scene::new`].

use super::arrange;
use super::blade::{SHAPES, SyntheticBlade};
use super::held::{self, Visit};
use super::random::Random;

/// A family of scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// One blade, its root below.
    Single,
    /// Three to six blades side by side that do not touch.
    Row,
    /// One blade that bends strongly towards the camera or away from it, by 0.4 to 1.2 rad in all.
    Toward,
    /// A tuft: three to nine blades from one base.
    Fan,
    /// Two blades, now and then three, one before the other: they cross in the picture, 4 to 7 cm apart
    /// in depth at the roots.
    Crossing,
    /// One to five blades in a hand with its forearm: it comes in from the border, holds them up with a
    /// tremor of up to 3 mm and 0.5°, and leaves.
    Held,
    /// A hand that holds nothing, and moves like `held`.
    Hand,
    /// Nothing but the wall.
    Empty,
    /// A session: three to five visitors in turn, each like `held`.
    Kiosk,
    /// One blade that twists by 30° to 90° about its midrib.
    Twisted,
    /// One blade whose halves differ in width, by up to 1:2, folded by 10° to 25° along its midrib.
    Asymmetric,
}

/// All families.
pub const FAMILIES: [Family; 11] = [
    Family::Single,
    Family::Row,
    Family::Toward,
    Family::Fan,
    Family::Crossing,
    Family::Held,
    Family::Hand,
    Family::Empty,
    Family::Kiosk,
    Family::Twisted,
    Family::Asymmetric,
];

/// Blades before a camera that looks at a wall.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Where it comes from.
    pub family: Family,
    /// Which one of its family.
    pub seed: u64,
    /// The blades, camera frame; those of a row and of a fan from left to right, those of a crossing from
    /// the nearest to the farthest; of those in a hand what is seen above it when the hold starts,
    /// visitor by visitor, from left to right.
    pub blades: Vec<SyntheticBlade>,
    /// The hands that come and leave, in turn; none where the blades stand by themselves.
    pub visits: Vec<Visit>,
}

/// The stream of random numbers that scenes use; the sensor's frames use those above it.
const SCENE_STREAM: u64 = 0;

impl Scene {
    /// The scene of a family with a seed: the same on every machine.
    pub fn new(family: Family, seed: u64) -> Self {
        // A family has its own numbers: the blade of `single 1` is not one of `row 1`.
        let seed_of_family = seed ^ ((family as u64) << 56);
        let mut random = Random::new(seed_of_family, SCENE_STREAM);
        // The shape of single blades is given, so that five seeds in a row show all five.
        let shape = SHAPES[(seed % SHAPES.len() as u64) as usize];
        let mut visits = Vec::new();
        let blades = match family {
            Family::Single => arrange::single(shape, &mut random),
            Family::Row => arrange::row(&mut random),
            Family::Toward => arrange::toward(shape, &mut random),
            Family::Twisted => arrange::twisted(shape, &mut random),
            Family::Asymmetric => arrange::asymmetric(shape, &mut random),
            Family::Fan => arrange::fan(&mut random),
            Family::Crossing => arrange::crossing(&mut random),
            Family::Held | Family::Kiosk => {
                let visitors = if family == Family::Held { 1 } else { random.integer(3, 5) };
                let mut blades = Vec::new();
                for visitor in 0..visitors {
                    let (visit, seen) = held::held(seed_of_family, visitor, blades.len(), &mut random);
                    visits.push(visit);
                    blades.extend(seen);
                }
                blades
            }
            Family::Hand => {
                visits.push(held::empty_hand(seed_of_family, &mut random));
                Vec::new()
            }
            Family::Empty => Vec::new(),
        };
        Self { family, seed, blades, visits }
    }

    /// Frames of a clip that shows all of it: 45 of what stands still, 60 of a hand that comes and
    /// leaves, 80 for each of several.
    pub fn frames(&self) -> usize {
        match self.visits.len() {
            0 => 45,
            1 => 60,
            several => 80 * several,
        }
    }
}

impl Family {
    /// Its name as on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Family::Single => "single",
            Family::Row => "row",
            Family::Toward => "toward",
            Family::Fan => "fan",
            Family::Crossing => "crossing",
            Family::Held => "held",
            Family::Hand => "hand",
            Family::Empty => "empty",
            Family::Kiosk => "kiosk",
            Family::Twisted => "twisted",
            Family::Asymmetric => "asymmetric",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::blade::Shape;
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
            for blade in (0..if family == Family::Kiosk { 4 } else { 30 })
                .flat_map(|seed| Scene::new(family, seed).blades)
            {
                let aspect = blade.max_width_m / blade.length_m;
                // What a hand leaves to be seen is shorter, and as wide.
                let in_hand = [Family::Held, Family::Kiosk].contains(&family);
                let (lengths, aspects) =
                    if in_hand { (0.11..=0.25, 0.04..=0.19) } else { (0.12..=0.26, 0.04..=0.14) };
                assert!(lengths.contains(&blade.length_m), "{family:?}: {} m", blade.length_m);
                assert!(aspects.contains(&aspect), "{family:?}: {aspect}");
                let (low, high) = blade.bounds();
                assert!(low.z > 0.4 && high.z < 0.75, "{family:?}");
            }
        }
    }
}
