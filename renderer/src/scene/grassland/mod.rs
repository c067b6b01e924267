//! The meadow as Fan & Sheng lay it out (§4.5): one patch of blades, small enough to stay in a
//! cache; the plane cut into tiles; each tile grows 64 consecutive blades of the patch, from an
//! offset that its coordinates give. No tile costs memory.
//!
//! Any 64 consecutive patch blades fill a jittered 8×8 grid once (cell = index mod 64), so every
//! tile is covered evenly whatever its offset, and grid neighbours are known without a search.
//!
//! [`field`] says where grass grows and which of it the eye can see, [`mix`] which shape stands where,
//! [`shapes`] how the shapes look at each level of detail. Non-goal here: what is drawn (`passes/cull`).

pub mod field;
pub mod mix;
pub mod shapes;

use bytemuck::{Pod, Zeroable};
use glam::Vec2;
use rand_pcg::Pcg32;
use rand_pcg::rand_core::{RngCore, SeedableRng};

use super::perlin::hash;

/// Blades of the patch.
pub const PATCH_BLADES: u32 = 16_384;
/// Blades of a tile.
pub const TILE_BLADES: u32 = 64;
/// Cells of the jittered grid along one side of a tile.
pub const GRID_SIDE: u32 = 8;
/// Side of a tile, metres: 64 blades on it are 2000 on a square metre.
pub const TILE_M: f32 = 0.18;
/// Number of values of a shape index: 12 bits.
pub const SHAPES: usize = 4096;
/// Smallest and largest scale of a blade.
pub const SCALE: (f32, f32) = (0.7, 1.3);

/// One blade of the patch, 16 bytes: where it stands and how it differs from its captured shape.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct PatchBlade {
    /// Root in the tile: x in the low 16 bits, z in the high, 65536 to a tile's side.
    pub root: u32,
    /// Shape index (12 bits), turn about the vertical (12 bits, 4096 to a full turn), scale (7 bits,
    /// over [`SCALE`]), mirrored (1 bit), from the low end.
    pub shape_turn_scale_mirror: u32,
    /// Lean's direction (12 bits, 4096 to a full turn), lean's angle (8 bits, 256 to 0.5 rad), hue
    /// (12 bits), from the low end.
    pub lean_hue: u32,
    /// Random bits of the blade's own, for dryness and gloss.
    pub salt: u32,
}

/// Grows the patch: the same for the same seed, everywhere.
///
/// Returns [`PATCH_BLADES`] blades, 256 KiB. Blade `i` stands in grid cell `i mod 64`, row by row.
pub fn patch(seed: u64) -> Vec<PatchBlade> {
    let mut random = Pcg32::seed_from_u64(seed);
    let cell_side = 65_536 / GRID_SIDE;
    (0..PATCH_BLADES)
        .map(|index| {
            let cell = index % TILE_BLADES;
            let x = cell % GRID_SIDE * cell_side + random.next_u32() % cell_side;
            let z = cell / GRID_SIDE * cell_side + random.next_u32() % cell_side;
            // Few blades lean far: the product of two uniform numbers is mostly small.
            let lean = (random.next_u32() & 0xFF) * (random.next_u32() & 0xFF) / 0xFF;
            PatchBlade {
                root: x | z << 16,
                shape_turn_scale_mirror: random.next_u32(),
                lean_hue: random.next_u32() & 0xFFF | lean << 12 | (random.next_u32() & 0xFFF) << 20,
                salt: random.next_u32(),
            }
        })
        .collect()
}

impl PatchBlade {
    /// Root in its tile, 0..1 along each side.
    pub fn root_in_tile(&self) -> Vec2 {
        Vec2::new((self.root & 0xFFFF) as f32, (self.root >> 16) as f32) * (1.0 / 65_536.0)
    }
}

/// First patch blade of the tile at these coordinates: 0..=16320.
pub fn tile_offset(tile_x: i32, tile_z: i32) -> u32 {
    hash(tile_x, tile_z) % (PATCH_BLADES - TILE_BLADES + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_patch_stays_within_its_memory() {
        assert_eq!(size_of::<PatchBlade>(), 16);
        assert!(size_of_val(&patch(1)[..]) <= 256 * 1024);
    }

    #[test]
    fn any_64_consecutive_blades_fill_the_grid_once() {
        let patch = patch(1);
        for first in 0..=(PATCH_BLADES - TILE_BLADES) as usize {
            let mut filled = 0u64;
            for blade in &patch[first..first + TILE_BLADES as usize] {
                let cell = (blade.root_in_tile() * GRID_SIDE as f32).floor();
                filled |= 1 << (cell.x as u32 + cell.y as u32 * GRID_SIDE);
            }
            assert_eq!(filled, u64::MAX, "window at {first}");
        }
    }

    #[test]
    fn tile_offsets_stay_in_the_patch_and_vary() {
        let mut offsets = std::collections::HashSet::new();
        for x in -40..40 {
            for z in -40..40 {
                let offset = tile_offset(x, z);
                assert!(offset + TILE_BLADES <= PATCH_BLADES);
                offsets.insert(offset);
            }
        }
        assert!(offsets.len() > 5000, "{} different offsets of 6400", offsets.len());
    }
}
