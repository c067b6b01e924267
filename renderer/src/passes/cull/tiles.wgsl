// One invocation handles one tile of a block within sight: throws it away when it is no tile of the field, out
// of view or too far, else appends its candidates to `chunks`, eight blades each.
// Reads the blocks and which tiles are simulated; counts in `counts` (cleared by a command before).
// Source: Fan & Sheng §4.5 (tiles). Twin: cpu.rs.

struct Block {
    x: i32,
    z: i32,
}

struct Slot {
    tile_x: i32,
    tile_z: i32,
    slot: i32,
    _pad_0: u32,
}

@group(1) @binding(1) var<storage, read> blocks: array<Block>;
@group(1) @binding(2) var<storage, read> slots: array<Slot>;
@group(1) @binding(3) var<storage, read_write> counts: Counts;
@group(1) @binding(4) var<storage, read_write> chunks: array<Chunk>;

fn is_of_field(tile: vec2i) -> bool {
    let x = bitcast<u32>(tile.x - survey.first_tile_x);
    let z = bitcast<u32>(tile.y - survey.first_tile_z);
    // Rows before this one have fewer tiles than a u32 can count.
    return x < survey.columns && z <= survey.tiles / survey.columns && z * survey.columns + x < survey.tiles;
}

// The slots are sorted by z, then x.
fn slot_of(tile: vec2i) -> i32 {
    var low = 0u;
    var high = survey.slots;
    while low < high {
        let middle = (low + high) / 2u;
        let found = slots[middle];
        if found.tile_x == tile.x && found.tile_z == tile.y {
            return found.slot;
        }
        if found.tile_z < tile.y || (found.tile_z == tile.y && found.tile_x < tile.x) {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return -1;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let block = blocks[group.x];
    let tile = vec2i(block.x, block.z) * BLOCK_SIDE + vec2i(i32(lane) % BLOCK_SIDE, i32(lane) / BLOCK_SIDE);
    if !is_of_field(tile) {
        return;
    }
    let centre = (vec2f(tile) + 0.5) * TILE_M;
    let centre_in_world = vec3f(centre.x, ground_height_m(centre), centre.y);
    let nearest_m = distance(centre_in_world, frame.eye_in_world) - TILE_RADIUS_M;
    let everything = survey.everything == 1u;
    if nearest_m > select(survey.range_m, BEYOND_ALL, everything) {
        return;
    }
    let margin_m = select(TILE_RADIUS_M + survey.reach_m, BEYOND_ALL, everything);
    for (var i = 0u; i < 5u; i++) {
        if dot(frame.planes[i], vec4f(centre_in_world, 1.0)) < -margin_m {
            return;
        }
    }
    let candidates = u32(ceil(f32(TILE_BLADES) * kept(nearest_m)));
    let wanted = (candidates + CHUNK_BLADES - 1u) / CHUNK_BLADES;
    let slot = slot_of(tile);
    let first = atomicAdd(&counts.chunks, wanted);
    for (var i = 0u; i < wanted && first + i < CHUNK_CAPACITY; i++) {
        chunks[first + i] = Chunk(tile.x, tile.y, i * CHUNK_BLADES, slot);
    }
}
