//! Where grass grows, and which of it the eye may see: blocks of tiles around the eye, near to far.
//! Neither memory nor time depends on the size of the field.

use bytemuck::{Pod, Zeroable};
use glam::{IVec2, Vec2, Vec3, Vec4};

use super::{TILE_BLADES, TILE_M};
use crate::scene::terrain;

/// Tiles along each side of a block.
pub const BLOCK_SIDE: i32 = 8;
/// Steepest that the ground is taken to be, as height over distance, when something is thrown away.
const STEEPEST: f32 = 0.6;

/// A field of tiles around the origin: rows of equally many tiles, the last row perhaps of fewer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// The first row's first tile.
    pub first: IVec2,
    /// Tiles of a row.
    pub columns: u32,
    /// All tiles.
    pub tiles: u32,
}

impl Field {
    /// As many tiles as can be told apart, 11.8 km along each side: it has no end that an eye could see from
    /// its middle.
    pub const ENDLESS: Self = Self { first: IVec2::splat(-32_767), columns: 65_535, tiles: 65_535 * 65_535 };
    /// Tiles of the paper's field (Fan & Sheng §5): 955,264 blades.
    pub const PAPER_TILES: u32 = 14_926;

    /// A field of this many tiles (at least 1), as nearly square as it can be.
    pub fn of_tiles(tiles: u32) -> Self {
        let tiles = tiles.clamp(1, Self::ENDLESS.tiles);
        let columns = f64::from(tiles).sqrt().ceil() as u32;
        let rows = tiles.div_ceil(columns);
        Self { first: -IVec2::new(columns as i32 / 2, rows as i32 / 2), columns, tiles }
    }

    /// Blades of all tiles, where the density is full.
    pub fn blades(&self) -> u64 {
        u64::from(self.tiles) * u64::from(TILE_BLADES)
    }

    /// Whether this tile is one of its.
    pub fn has(&self, tile: IVec2) -> bool {
        let at = tile - self.first;
        let in_rows = at.x >= 0 && at.y >= 0 && (at.x as u32) < self.columns;
        in_rows && at.y as u64 * u64::from(self.columns) + (at.x as u64) < u64::from(self.tiles)
    }

    /// The middle of the side that lies towards +z, (x, z) in metres: from there, the whole field lies towards −z.
    pub fn edge(&self) -> Vec2 {
        let full_rows = (self.tiles / self.columns).max(1) as i32;
        Vec2::new(
            (self.first.x as f32 + 0.5 * self.columns as f32) * TILE_M,
            (self.first.y + full_rows) as f32 * TILE_M,
        )
    }

    /// The least and the greatest corner of the rectangle around all tiles, (x, z) in metres.
    pub fn corners_m(&self) -> (Vec2, Vec2) {
        let rows = self.tiles.div_ceil(self.columns);
        let first = self.first.as_vec2() * TILE_M;
        (first, first + Vec2::new(self.columns as f32, rows as f32) * TILE_M)
    }

    /// First and last block, both included, that have a tile of it.
    fn blocks(&self) -> (IVec2, IVec2) {
        let rows = self.tiles.div_ceil(self.columns);
        let last = self.first + IVec2::new(self.columns as i32, rows as i32) - 1;
        (self.first.map(block_of), last.map(block_of))
    }
}

fn block_of(tile: i32) -> i32 {
    tile.div_euclid(BLOCK_SIDE)
}

/// A square of [`BLOCK_SIDE`]² tiles: tile (x·8, z·8) and those after it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Block {
    /// Along x.
    pub x: i32,
    /// Along z.
    pub z: i32,
}

/// From where is looked, how far, and what is to be seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// The eye, metres.
    pub eye_in_world: Vec3,
    /// The view's planes, pointing inwards, each `plane · (p, 1) ≥ 0` inside.
    pub planes: [Vec4; 5],
    /// How far blades are drawn, metres.
    pub range_m: f32,
    /// How far any part of any blade is from its root, metres.
    pub reach_m: f32,
}

/// A block within sight, and how far its nearest point is at least, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenBlock {
    /// Which.
    pub block: Block,
    /// How far, metres.
    pub nearest_m: f32,
}

/// The blocks of the field that may have a blade in sight, near to far (then by coordinates).
///
/// Looks at those within the range, whatever the size of the field: O((range / 1.44 m)²).
pub fn blocks_in_sight(field: &Field, sight: &Sight) -> Vec<SeenBlock> {
    let side_m = BLOCK_SIDE as f32 * TILE_M;
    let (first, last) = field.blocks();
    let reach = (sight.range_m / side_m).ceil() as i32 + 1;
    let eye = Vec2::new(sight.eye_in_world.x, sight.eye_in_world.z);
    let around = (eye / side_m).floor().as_ivec2();
    let (from, to) = (first.max(around - reach), last.min(around + reach));
    let across_m = side_m * std::f32::consts::FRAC_1_SQRT_2;
    let radius_m = across_m * (1.0 + STEEPEST * STEEPEST).sqrt();
    let mut seen = Vec::new();
    for z in from.y..=to.y {
        for x in from.x..=to.x {
            let centre = (Vec2::new(x as f32, z as f32) + 0.5) * side_m;
            let level_m = (centre.distance(eye) - across_m).max(0.0);
            if level_m > sight.range_m {
                continue;
            }
            let centre = Vec3::new(centre.x, terrain::height_m(centre), centre.y);
            let nearest_m = (centre.distance(sight.eye_in_world) - radius_m).max(0.0);
            let outside = |plane: &Vec4| plane.dot(centre.extend(1.0)) < -(radius_m + sight.reach_m);
            if nearest_m <= sight.range_m && !sight.planes.iter().any(outside) {
                seen.push(SeenBlock { block: Block { x, z }, nearest_m });
            }
        }
    }
    seen.sort_by(|a, b| {
        a.nearest_m.total_cmp(&b.nearest_m).then((a.block.z, a.block.x).cmp(&(b.block.z, b.block.x)))
    });
    seen
}

/// Every block of the field, row by row.
pub fn all_blocks(field: &Field) -> Vec<Block> {
    let (first, last) = field.blocks();
    (first.y..=last.y).flat_map(|z| (first.x..=last.x).map(move |x| Block { x, z })).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::camera::{Camera, frustum_planes};

    #[test]
    fn a_field_has_as_many_tiles_as_it_says() {
        for tiles in [1, 2, 3, 64, 1000, Field::PAPER_TILES] {
            let field = Field::of_tiles(tiles);
            let counted = (-130..130).flat_map(|x| (-130..130).map(move |z| IVec2::new(x, z)));
            assert_eq!(counted.filter(|tile| field.has(*tile)).count(), tiles as usize);
        }
        assert_eq!(Field::of_tiles(Field::PAPER_TILES).blades(), 955_264);
    }

    #[test]
    fn every_tile_of_a_field_lies_in_one_of_its_blocks() {
        let field = Field::of_tiles(1000);
        let tiles = all_blocks(&field).into_iter().flat_map(|block| {
            let first = IVec2::new(block.x, block.z) * BLOCK_SIDE;
            (0..BLOCK_SIDE).flat_map(move |x| (0..BLOCK_SIDE).map(move |z| first + IVec2::new(x, z)))
        });
        assert_eq!(tiles.filter(|tile| field.has(*tile)).count(), 1000);
    }

    fn sight(foot: Vec2) -> Sight {
        let camera = Camera { foot, eye_height_m: 1.7, heading_rad: 0.3, pitch_rad: -0.17, fov_y_rad: 1.05 };
        Sight {
            eye_in_world: camera.eye_in_world(),
            planes: frustum_planes(camera.clip_from_world(1.6)),
            range_m: 40.0,
            reach_m: 0.3,
        }
    }

    #[test]
    fn no_root_in_sight_lies_outside_of_the_blocks() {
        let field = Field::of_tiles(2_000_000);
        let sight = sight(Vec2::new(3.0, -7.0));
        let seen = blocks_in_sight(&field, &sight);
        assert!(seen.is_sorted_by(|a, b| a.nearest_m <= b.nearest_m));
        let mut inside = 0;
        for step in 0..60_000 {
            let around = Vec2::from_angle(step as f32 * 2.399_963) * (step as f32).sqrt() * 0.16;
            let root = Vec2::new(3.0, -7.0) + around;
            let root_in_world = Vec3::new(root.x, terrain::height_m(root), root.y);
            let distance_m = root_in_world.distance(sight.eye_in_world);
            let in_view = sight.planes.iter().all(|plane| plane.dot(root_in_world.extend(1.0)) >= -0.3);
            if distance_m > sight.range_m || !in_view {
                continue;
            }
            inside += 1;
            let block = (root / (BLOCK_SIDE as f32 * TILE_M)).floor().as_ivec2();
            let found = seen.iter().find(|seen| (seen.block.x, seen.block.z) == (block.x, block.y));
            let found = found.unwrap_or_else(|| panic!("the block of {root} is missing"));
            assert!(found.nearest_m <= distance_m, "{found:?} for {distance_m} m");
        }
        assert!(inside > 5000, "{inside} roots in sight");
    }

    #[test]
    fn a_thousand_times_the_field_has_no_more_blocks_in_sight() {
        let sight = sight(Vec2::ZERO);
        let blocks = |tiles| blocks_in_sight(&Field::of_tiles(tiles), &sight);
        assert_eq!(blocks(1_000_000), blocks(1_000_000_000));
        assert!(blocks(1_000_000).len() < 1500, "{}", blocks(1_000_000).len());
    }
}
