//! The CPU twin of tiles.wgsl and blades.wgsl.

use glam::{IVec2, Vec2, Vec3};

use super::gpu_data::{Instance, Share, Slot};
use super::{
    FADE_FROM, KEPT_AREA, LEVEL_PX, LUSH_SCALE, MAX_WIDEN, MORPH_FROM, NO_SHAPE, Plan, SIZE_BY_RANK,
    TILE_RADIUS_M, kept,
};
use crate::frame::gpu_data::Frame;
use crate::scene::grassland::field::{BLOCK_SIDE, Field};
use crate::scene::grassland::shapes::{LEVEL_KNOTS, LEVELS, SHAPE_KNOTS, first_knot};
use crate::scene::grassland::{GRID_SIDE, PatchBlade, SCALE, TILE_BLADES, TILE_M, mix, tile_offset};
use crate::scene::{perlin, terrain, wind};

/// What grows: the patch, and what the shape indices stand for now and stood for before.
#[derive(Clone, Copy, Debug)]
pub struct Grown<'a> {
    /// The patch.
    pub patch: &'a [PatchBlade],
    /// For each shape index what it stands for.
    pub shares: &'a [Share],
    /// The same of the library before.
    pub old_shares: &'a [Share],
    /// The simulated tiles.
    pub slots: &'a [Slot],
}

fn cell_of_rank(rank: u32) -> u32 {
    let spread = |bits: u32| (bits & 1) << 2 | bits >> 1 & 2 | bits >> 4 & 1;
    spread(rank) + GRID_SIDE * spread(rank ^ rank >> 1)
}

fn smoothstep(low: f32, high: f32, value: f32) -> f32 {
    let t = ((value - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The blades that are drawn, by level; within a level in the order of blocks and tiles (the GPU's order
/// is its own). Without the clouds' shadows, which only the shaders know: sunlight is 1.
pub fn main(frame: &Frame, plan: &Plan, grown: &Grown<'_>) -> [Vec<Instance>; LEVELS] {
    let mut levels: [Vec<Instance>; LEVELS] = Default::default();
    for block in &plan.blocks {
        for lane in 0..BLOCK_SIDE * BLOCK_SIDE {
            let in_block = IVec2::new(lane % BLOCK_SIDE, lane / BLOCK_SIDE);
            let tile = IVec2::new(block.x, block.z) * BLOCK_SIDE + in_block;
            grow_tile(frame, plan, grown, tile, &mut levels);
        }
    }
    levels
}

fn on_ground(p: Vec2) -> Vec3 {
    Vec3::new(p.x, terrain::height_m(p), p.y)
}

fn is_outside(frame: &Frame, p: Vec3, radius_m: f32) -> bool {
    frame.planes.iter().any(|plane| plane.dot(p.extend(1.0)) < -radius_m)
}

fn grow_tile(
    frame: &Frame,
    plan: &Plan,
    grown: &Grown<'_>,
    tile: IVec2,
    levels: &mut [Vec<Instance>; LEVELS],
) {
    let survey = &plan.survey;
    let field = Field {
        first: IVec2::new(survey.first_tile_x, survey.first_tile_z),
        columns: survey.columns,
        tiles: survey.tiles,
    };
    if !field.has(tile) {
        return;
    }
    let centre_in_world = on_ground((tile.as_vec2() + 0.5) * TILE_M);
    let nearest_m = centre_in_world.distance(frame.eye_in_world) - TILE_RADIUS_M;
    let everything = survey.everything == 1;
    let out_of_sight =
        nearest_m > survey.range_m || is_outside(frame, centre_in_world, TILE_RADIUS_M + survey.reach_m);
    if !everything && out_of_sight {
        return;
    }
    let slot = grown.slots.iter().find(|slot| (slot.tile_x, slot.tile_z) == (tile.x, tile.y));
    let slot = slot.map_or(-1, |slot| slot.slot);
    let wanted = if everything { 1.0 } else { kept(survey.full_pixel_m, frame.pixel_rad, nearest_m) };
    let candidates = (TILE_BLADES as f32 * wanted).ceil() as u32;
    for rank in 0..candidates {
        if let Some((level, instance)) = grow_blade(frame, plan, grown, (tile, slot), rank) {
            levels[level].push(instance);
        }
    }
}

fn grow_blade(
    frame: &Frame,
    plan: &Plan,
    grown: &Grown<'_>,
    (tile, slot): (IVec2, i32),
    rank: u32,
) -> Option<(usize, Instance)> {
    let survey = &plan.survey;
    let everything = survey.everything == 1;
    let offset = tile_offset(tile.x, tile.y);
    let cell = cell_of_rank(rank) ^ perlin::hash(tile.x, tile.y) >> 26;
    let index = offset + (cell.wrapping_sub(offset) & (TILE_BLADES - 1));
    let blade = &grown.patch[index as usize];
    let root = (tile.as_vec2() + blade.root_in_tile()) * TILE_M;
    let root_in_world = on_ground(root);
    let distance_m = root_in_world.distance(frame.eye_in_world).max(1e-3);

    let kept_here = if everything { 1.0 } else { kept(survey.full_pixel_m, frame.pixel_rad, distance_m) };
    let standing = TILE_BLADES as f32 * kept_here * terrain::density(root);
    let mut presence = (standing - rank as f32).clamp(0.0, 1.0);
    let mut far_fade = 1.0 - smoothstep(FADE_FROM * survey.range_m, survey.range_m, distance_m);
    if everything {
        presence = f32::from(u8::from((rank as f32) < TILE_BLADES as f32 * terrain::density(root)));
        far_fade = 1.0;
    }
    if survey.blended == 0 {
        presence = presence.round();
        far_fade = far_fade.round();
    }
    let widen = kept_here.powf(-KEPT_AREA).min(MAX_WIDEN);

    let shape_index = mix::shape_index(blade, root) as usize;
    let mut share = grown.shares[shape_index];
    let mut old = 0;
    if survey.swapped < 1.0 && grown.old_shares[shape_index].shape != share.shape {
        let turn = (blade.salt >> 20 & 0xFF) as f32 * (1.0 / 255.0);
        let swapped = (survey.swapped * 1.6 - 0.6 * turn).clamp(0.0, 1.0);
        presence *= smoothstep(0.0, 1.0, (2.0 * swapped - 1.0).abs());
        if swapped < 0.5 {
            old = 1;
            share = grown.old_shares[shape_index];
        }
    }
    presence *= far_fade;
    if presence <= 0.0 || share.shape == NO_SHAPE {
        return None;
    }
    let lush = terrain::lushness(root);
    let (smallest, largest) = SCALE;
    let own_size = (blade.shape_turn_scale_mirror >> 24 & 0x7F) as f32 * (1.0 / 127.0);
    let by_rank = 1.0 - (rank as f32 + 0.5) / TILE_BLADES as f32;
    let size = smallest + (largest - smallest) * (own_size + (by_rank - own_size) * SIZE_BY_RANK);
    let scale = size * (LUSH_SCALE.0 + (LUSH_SCALE.1 - LUSH_SCALE.0) * lush);
    let reach_m = scale * share.reach_m;
    if !everything && is_outside(frame, root_in_world, reach_m + widen * reach_m * 0.25) {
        return None;
    }

    let size_px = survey.detail * reach_m / (frame.pixel_rad * distance_m);
    let (level, morph) = if everything { (0, 0.0) } else { level_of(size_px) };
    let morph = if survey.blended == 1 { morph } else { 0.0 };
    let instance = Instance {
        root_in_world,
        first_knot: (mix::shape_of(share.shape) as u32 * SHAPE_KNOTS + first_knot(level)) | (old << 31),
        bend_rad: wind::bend_rad(root, frame.time_s) + terrain::tuft_lean_rad(root),
        scale: scale * presence,
        widen: size * widen * presence.sqrt(),
        morph,
        shape_turn_scale_mirror: blade.shape_turn_scale_mirror,
        lean_hue: blade.lean_hue,
        salt: blade.salt,
        lush,
        sunlight: 1.0,
        simulated: if slot < 0 {
            -1
        } else {
            (slot * TILE_BLADES as i32 + cell as i32) * LEVEL_KNOTS[0] as i32
        },
        stands_for: if everything { 0.0 } else { 1.0 / kept_here },
    };
    Some((level, instance))
}

/// The level of detail of a blade of this size, and how far it has turned into the next, 0 to 1.
pub fn level_of(size_px: f32) -> (usize, f32) {
    let level = LEVEL_PX.iter().position(|least| size_px >= *least).unwrap_or(LEVELS - 1);
    let morph =
        LEVEL_PX.get(level).map_or(0.0, |least| 1.0 - smoothstep(*least, *least * MORPH_FROM, size_px));
    (level, morph)
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

    #[test]
    fn a_blade_has_turned_into_its_next_level_when_it_takes_it() {
        for (level, least) in LEVEL_PX.into_iter().enumerate() {
            let (above, before) = level_of(least * 1.0001);
            let (below, after) = level_of(least * 0.9999);
            assert_eq!((above, below), (level, level + 1));
            assert!(before > 0.999 && after < 1e-3, "{before} and {after} at {least} px");
            assert_eq!(level_of(least * MORPH_FROM).1, 0.0, "nor does it begin with a step");
        }
    }
}
