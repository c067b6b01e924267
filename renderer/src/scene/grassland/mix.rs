//! Which blade of the library stands where: shares by the blades' mix weights, in clumps.
//!
//! Each blade of the field has a shape index, and a table says which blade of the library that is.
//! Most of the blades of a clump have the clump's index, the others one of their own. Both are uniform over
//! all indices, so that the weights hold over the field however large the clumps are.

use common::blade::BladeId;
use glam::Vec2;

use super::{PatchBlade, SHAPES};
use crate::scene::perlin::hash;

/// Side of a clump, metres.
pub const CLUMP_M: f32 = 0.52;
/// How far blades stand outside of their clump's square, in clumps: no border of it can be seen.
pub const CLUMP_FRAY: f32 = 0.7;
/// Blades of 256 that do not do as their clump does.
pub const LONERS: u32 = 46;

/// Bits of a table's entry that are the blade's index in the library; the others tell blades apart.
pub const SHAPE_BITS: u32 = 12;

/// The shape index of a blade of the patch that stands at `root` (x, z), metres: 0..4096.
pub fn shape_index(blade: &PatchBlade, root: Vec2) -> u32 {
    if blade.lean_hue >> 20 & 0xFF < LONERS {
        return blade.shape_turn_scale_mirror & 0xFFF;
    }
    let jitter = Vec2::new((blade.salt >> 16 & 0xFF) as f32, (blade.salt >> 24) as f32) * (1.0 / 255.0) - 0.5;
    let clump = (root * (1.0 / CLUMP_M) + jitter * CLUMP_FRAY).floor();
    // Other bits than those that give tiles their offsets.
    hash(clump.x as i32, (clump.y as i32).wrapping_add(0x5EED)) & 0xFFF
}

/// Which blade of the library each shape index stands for, by the blades' mix weights: a blade with
/// twice the weight has twice the indices (to 1/4096). An entry is the blade's index in the library, and above
/// [`SHAPE_BITS`] some bits of its identity, so that tables of two libraries show which indices changed.
///
/// The same blades with the same weights give the same table, and one that comes or goes changes little more
/// than the indices that it takes or leaves.
///
/// `blades`: identity and weight (finite, ≥ 0) of each blade of the library, at most 4096. `None` when no weight
/// is above zero: then nothing grows. O(4096·blades).
///
/// # Source
/// Eisenbud et al., "Maglev", NSDI 2016, §3.4: blades take turns to take their next favourite index; turns by
/// weight.
pub fn shape_table(blades: &[(BladeId, f32)]) -> Option<Vec<u32>> {
    struct Taker {
        entry: u32,
        share: f64,
        taken: f64,
        next: u32,
        step: u32,
    }
    let total: f64 = blades.iter().map(|(_, weight)| f64::from(*weight)).sum();
    if total <= 0.0 {
        return None;
    }
    let mut takers: Vec<Taker> = blades
        .iter()
        .zip(0..)
        .filter(|((_, weight), _)| *weight > 0.0)
        .map(|((id, weight), blade)| {
            let word = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|byte| id.0[at + byte]));
            let mixed = hash(word(0) as i32, word(4) as i32);
            Taker {
                entry: blade | mixed << SHAPE_BITS,
                share: f64::from(*weight) / total,
                taken: 0.0,
                next: hash(mixed as i32, word(8) as i32),
                // Odd, so that it visits every index.
                step: hash(mixed as i32, word(12) as i32) | 1,
            }
        })
        .collect();
    const FREE: u32 = u32::MAX;
    let mut table = vec![FREE; SHAPES];
    for turn in 1..=SHAPES {
        let lack = |taker: &Taker| taker.share * turn as f64 - taker.taken;
        let neediest = takers.iter_mut().reduce(|a, b| if lack(b) > lack(a) { b } else { a })?;
        let mut index = neediest.next as usize % SHAPES;
        while table[index] != FREE {
            neediest.next = neediest.next.wrapping_add(neediest.step);
            index = neediest.next as usize % SHAPES;
        }
        table[index] = neediest.entry;
        neediest.taken += 1.0;
    }
    Some(table)
}

/// The blade of the library that an entry of [`shape_table`] means.
pub fn shape_of(entry: u32) -> usize {
    (entry & ((1 << SHAPE_BITS) - 1)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::grassland::{TILE_BLADES, TILE_M, patch, tile_offset};

    fn blades(weights: &[f32]) -> Vec<(BladeId, f32)> {
        let id = |index: u32| BladeId(*blake(index).first_chunk().expect("16 bytes"));
        weights.iter().zip(0..).map(|(weight, index)| (id(index), *weight)).collect()
    }

    fn blake(index: u32) -> Vec<u8> {
        (0..4).flat_map(|word| hash(index as i32, word).to_le_bytes()).collect()
    }

    fn counts(table: &[u32], blades: usize) -> Vec<usize> {
        let mut counts = vec![0; blades];
        table.iter().for_each(|entry| counts[shape_of(*entry)] += 1);
        counts
    }

    #[test]
    fn shapes_follow_the_mix() {
        assert_eq!(shape_table(&[]), None);
        assert_eq!(shape_table(&blades(&[0.0, 0.0])), None);
        let table = shape_table(&blades(&[1.0, 0.0, 3.0])).expect("something grows");
        assert_eq!(counts(&table, 3), [1024, 0, 3072]);
        let thirds = shape_table(&blades(&[0.1; 3])).expect("something grows");
        assert!(counts(&thirds, 3).iter().all(|count| (1364..=1367).contains(count)));
        let all = shape_table(&blades(&[2.0; SHAPES])).expect("something grows");
        assert!(counts(&all, SHAPES).iter().all(|count| *count == 1), "each of 4096 has its index");
    }

    #[test]
    fn a_blade_more_leaves_the_others_where_they_are() {
        let before = shape_table(&blades(&[1.0; 20])).expect("something grows");
        let after = shape_table(&blades(&[1.0; 21])).expect("something grows");
        let changed = before.iter().zip(&after).filter(|(before, after)| before != after).count();
        let least = SHAPES / 21;
        assert!((least..3 * least).contains(&changed), "{changed} of 4096 indices changed, {least} had to");
    }

    /// The blades of the library on tiles `0..side` squared, each with its root.
    fn field(side: i32, table: &[u32]) -> Vec<(Vec2, usize)> {
        let patch = patch(3);
        let tiles = (0..side).flat_map(|x| (0..side).map(move |z| (x, z)));
        tiles
            .flat_map(|(x, z)| {
                let first = tile_offset(x, z) as usize;
                let grown = &patch[first..first + TILE_BLADES as usize];
                grown.iter().map(move |blade| {
                    let root = (Vec2::new(x as f32, z as f32) + blade.root_in_tile()) * TILE_M;
                    (root, shape_of(table[shape_index(blade, root) as usize]))
                })
            })
            .collect()
    }

    #[test]
    fn weights_hold_over_the_field() {
        let weights = [5.0, 0.0, 3.0, 1.0, 1.0];
        let table = shape_table(&blades(&weights)).expect("something grows");
        // 72 m along a side: 19,000 clumps.
        let grown = field(400, &table);
        for (shape, weight) in weights.iter().enumerate() {
            let share = grown.iter().filter(|(_, of)| *of == shape).count() as f32 / grown.len() as f32;
            let wanted = weight / weights.iter().sum::<f32>();
            assert!((share - wanted).abs() < 0.015, "shape {shape}: {share}, expected {wanted}");
            assert!(*weight > 0.0 || share == 0.0, "shape {shape} has no weight");
        }
    }

    #[test]
    fn neighbours_are_alike_more_often_than_by_chance() {
        let table = shape_table(&blades(&[1.0; 10])).expect("something grows");
        let grown = field(40, &table);
        let alike = |near: f32, far: f32| {
            let (mut same, mut pairs) = (0, 0);
            for (at, (root, shape)) in grown.iter().enumerate().step_by(37) {
                for (other, other_shape) in grown[at + 1..].iter().step_by(3) {
                    if (near..far).contains(&root.distance(*other)) {
                        (same, pairs) = (same + usize::from(shape == other_shape), pairs + 1);
                    }
                }
            }
            assert!(pairs > 1000, "{pairs} pairs");
            same as f32 / pairs as f32
        };
        let (neighbours, strangers) = (alike(0.0, 0.06), alike(2.0, 2.2));
        assert!(neighbours > 4.0 * strangers, "{neighbours} of neighbours alike, {strangers} of strangers");
        assert!((0.05..0.2).contains(&strangers), "{strangers}, by chance 0.1");
    }
}
