//! The CPU twin of cull.wgsl.

use glam::{IVec2, Vec2, Vec3};

use super::gpu_data::{Instance, Window};
use super::{LEVELS, MAX_WIDEN, RANGE_M, kept};
use crate::frame::gpu_data::Frame;
use crate::scene::grassland::{GRID_SIDE, PatchBlade, TILE_BLADES, TILE_M, tile_offset};
use crate::scene::{perlin, terrain, wind};

fn cell_of_rank(rank: u32) -> u32 {
    let spread = |bits: u32| (bits & 1) << 2 | bits >> 1 & 2 | bits >> 4 & 1;
    spread(rank) + GRID_SIDE * spread(rank ^ rank >> 1)
}

fn smoothstep(low: f32, high: f32, value: f32) -> f32 {
    let t = ((value - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The blades that are drawn, by level; within a level in the order of tiles (the GPU's order is its
/// own).
pub fn main(frame: &Frame, window: &Window, patch: &[PatchBlade]) -> [Vec<Instance>; LEVELS.len()] {
    let mut levels: [Vec<Instance>; LEVELS.len()] = Default::default();
    for z in 0..window.side as i32 {
        for x in 0..window.side as i32 {
            let tile = IVec2::new(window.first_tile_x + x, window.first_tile_z + z);
            grow_tile(frame, window, patch, tile, &mut levels);
        }
    }
    levels
}

fn grow_tile(
    frame: &Frame,
    window: &Window,
    patch: &[PatchBlade],
    tile: IVec2,
    levels: &mut [Vec<Instance>; LEVELS.len()],
) {
    let on_ground = |p: Vec2| Vec3::new(p.x, terrain::height_m(p), p.y);
    let centre = (tile.as_vec2() + 0.5) * TILE_M;
    let centre_in_world = on_ground(centre);
    let distance_m = centre_in_world.distance(frame.eye_in_world);
    let outside = |plane: &glam::Vec4| plane.dot(centre_in_world.extend(1.0)) < -(TILE_M + window.reach_m);
    if distance_m > RANGE_M || frame.planes.iter().any(outside) {
        return;
    }
    let wanted = TILE_BLADES as f32 * kept(distance_m) * terrain::density(centre);
    let widen = (1.0 / kept(distance_m).sqrt()).min(MAX_WIDEN);
    let far_fade = 1.0 - smoothstep(0.7 * RANGE_M, RANGE_M, distance_m);
    let lush = (terrain::lushness(centre) * 255.0) as u32;
    let level = LEVELS.iter().position(|level| distance_m < level.until_m).unwrap_or(LEVELS.len() - 1);
    let offset = tile_offset(tile.x, tile.y);
    for rank in 0..wanted.ceil() as u32 {
        let cell = cell_of_rank(rank) ^ perlin::hash(tile.x, tile.y) >> 26;
        let index = offset + (cell.wrapping_sub(offset) & (TILE_BLADES - 1));
        let root = (tile.as_vec2() + patch[index as usize].root_in_tile()) * TILE_M;
        levels[level].push(Instance {
            root_in_world: on_ground(root),
            blade_and_lushness: index | lush << 16,
            bend_rad: wind::bend_rad(root, frame.time_s) + terrain::tuft_lean_rad(root),
            presence: (wanted - rank as f32).clamp(0.0, 1.0) * far_fade,
            widen,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_visit_every_cell_once() {
        let visited: std::collections::HashSet<u32> = (0..TILE_BLADES).map(cell_of_rank).collect();
        assert_eq!(visited.len(), TILE_BLADES as usize);
        assert!(visited.iter().all(|cell| *cell < TILE_BLADES));
    }
}
