// One invocation handles one tile of the window around the eye: throws it away when it is out of
// view or too far, else writes those of its blades that its distance calls for.
// Reads the patch; appends to `instances` and counts in `draws` (cleared by a copy before).
// Source: Fan & Sheng §4.5 (patch and tiles), Jahrmann & Wimmer 2017 (culling by distance).
// Twin: cpu.rs.

struct Window {
    first_tile_x: i32,
    first_tile_z: i32,
    side: u32,
    reach_m: f32,
}

struct PatchBlade {
    root: u32,
    shape_turn_scale_mirror: u32,
    lean_hue: u32,
    salt: u32,
}

struct Instance {
    root_in_world: vec3f,
    blade_and_lushness: u32,
    bend_rad: vec2f,
    presence: f32,
    widen: f32,
}

struct Draw {
    index_count: u32,
    instance_count: atomic<u32>,
    first_index: u32,
    base_vertex: i32,
    first_instance: u32,
}

@group(1) @binding(0) var<uniform> window: Window;
@group(1) @binding(1) var<storage, read> patch_blades: array<PatchBlade>;
@group(1) @binding(2) var<storage, read_write> draws: array<Draw, LEVELS>;
@group(1) @binding(3) var<storage, read_write> instances: array<Instance>;

// The grid cell that appears as the `rank`th when a tile fills up: an ordered dither, so that any
// number of blades covers the tile evenly. Source: Bayer 1973.
fn cell_of_rank(rank: u32) -> u32 {
    let x = (rank & 1u) << 2u | (rank >> 1u & 2u) | (rank >> 4u & 1u);
    let d = rank ^ rank >> 1u;
    let z = (d & 1u) << 2u | (d >> 1u & 2u) | (d >> 4u & 1u);
    return x + GRID_SIDE * z;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= window.side || id.y >= window.side {
        return;
    }
    let tile = vec2i(window.first_tile_x, window.first_tile_z) + vec2i(id.xy);
    let centre = (vec2f(tile) + 0.5) * TILE_M;
    let centre_in_world = vec3f(centre.x, ground_height_m(centre), centre.y);
    let distance_m = distance(centre_in_world, frame.eye_in_world);
    if distance_m > RANGE_M {
        return;
    }
    let radius_m = TILE_M + window.reach_m;
    for (var i = 0u; i < 5u; i++) {
        if dot(frame.planes[i], vec4f(centre_in_world, 1.0)) < -radius_m {
            return;
        }
    }

    let ratio = min(1.0, FULL_DENSITY_M / distance_m);
    let kept = ratio * sqrt(ratio);
    let wanted = f32(TILE_BLADES) * kept * density(centre);
    let count = u32(ceil(wanted));
    let widen = min(1.0 / sqrt(kept), MAX_WIDEN);
    let far_fade = 1.0 - smoothstep(0.7 * RANGE_M, RANGE_M, distance_m);
    let lush = u32(lushness(centre) * 255.0);
    var level = 0u;
    for (; level < LEVELS - 1u; level++) {
        if distance_m < LEVEL_UNTIL_M[level] {
            break;
        }
    }

    let tile_hash = hash(tile.x, tile.y);
    let offset = tile_hash % (PATCH_BLADES - TILE_BLADES + 1u);
    let first_slot = atomicAdd(&draws[level].instance_count, count);
    for (var rank = 0u; rank < count; rank++) {
        let slot = first_slot + rank;
        if slot >= LEVEL_CAPACITY[level] {
            return;
        }
        let cell = cell_of_rank(rank) ^ (tile_hash >> 26u);
        let index = offset + ((cell - offset) & (TILE_BLADES - 1u));
        let packed_root = patch_blades[index].root;
        let in_tile = vec2f(f32(packed_root & 0xFFFFu), f32(packed_root >> 16u)) * (1.0 / 65536.0);
        let root = (vec2f(tile) + in_tile) * TILE_M;
        var instance: Instance;
        instance.root_in_world = vec3f(root.x, ground_height_m(root), root.y);
        instance.blade_and_lushness = index | lush << 16u;
        instance.bend_rad = bend_rad(root, frame.time_s) + tuft_lean_rad(root);
        instance.presence = clamp(wanted - f32(rank), 0.0, 1.0) * far_fade;
        instance.widen = widen;
        instances[LEVEL_FIRST[level] + slot] = instance;
    }
}
