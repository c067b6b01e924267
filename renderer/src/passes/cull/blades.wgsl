// One invocation handles one candidate, eight of them a chunk: throws it away when it is thinned out here or
// out of view, else writes it to `instances`, and its number to the list of its level of detail.
// Reads the chunks, the patch, and what both libraries' shape indices stand for; counts in `counts`.
// Source: Fan & Sheng §4.5 (patch), Jahrmann & Wimmer 2017 (culling by blade). Twin: cpu.rs.

struct PatchBlade {
    root: u32,
    shape_turn_scale_mirror: u32,
    lean_hue: u32,
    salt: u32,
}

struct Share {
    // Index of the blade in its library, and above SHAPE_BITS what tells it from those of other libraries.
    shape: u32,
    reach_m: f32,
}

@group(1) @binding(1) var<storage, read> patch_blades: array<PatchBlade>;
@group(1) @binding(2) var<storage, read> chunks: array<Chunk>;
// Which blade each shape index stands for, in this library and in the one before.
@group(1) @binding(3) var<storage, read> shares: array<Share>;
@group(1) @binding(4) var<storage, read> old_shares: array<Share>;
@group(1) @binding(5) var<storage, read_write> counts: Counts;
@group(1) @binding(6) var<storage, read_write> instances: array<Instance>;
@group(1) @binding(7) var<storage, read_write> lists: array<u32>;

// The grid cell that appears as the `rank`th when a tile fills up: an ordered dither, so that any
// number of blades covers the tile evenly. Source: Bayer 1973.
fn cell_of_rank(rank: u32) -> u32 {
    let x = (rank & 1u) << 2u | (rank >> 1u & 2u) | (rank >> 4u & 1u);
    let d = rank ^ rank >> 1u;
    let z = (d & 1u) << 2u | (d >> 1u & 2u) | (d >> 4u & 1u);
    return x + GRID_SIDE * z;
}

fn shape_index(blade: PatchBlade, root: vec2f) -> u32 {
    if (blade.lean_hue >> 20u & 0xFFu) < LONERS {
        return blade.shape_turn_scale_mirror & 0xFFFu;
    }
    let jitter = vec2f(f32(blade.salt >> 16u & 0xFFu), f32(blade.salt >> 24u)) * (1.0 / 255.0) - 0.5;
    let clump = vec2i(floor(root * (1.0 / CLUMP_M) + jitter * CLUMP_FRAY));
    return hash(clump.x, clump.y + 0x5EED) & 0xFFFu;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let candidate = group.x * 64u + lane;
    let at = candidate / CHUNK_BLADES;
    if at >= min(atomicLoad(&counts.chunks), CHUNK_CAPACITY) {
        return;
    }
    let chunk = chunks[at];
    let tile = vec2i(chunk.tile_x, chunk.tile_z);
    let rank = chunk.first_rank + candidate % CHUNK_BLADES;
    let tile_hash = hash(tile.x, tile.y);
    let offset = tile_hash % (PATCH_BLADES - TILE_BLADES + 1u);
    let cell = cell_of_rank(rank) ^ (tile_hash >> 26u);
    let index = offset + ((cell - offset) & (TILE_BLADES - 1u));
    let blade = patch_blades[index];
    let in_tile = vec2f(f32(blade.root & 0xFFFFu), f32(blade.root >> 16u)) * (1.0 / 65536.0);
    let root = (vec2f(tile) + in_tile) * TILE_M;
    let root_in_world = vec3f(root.x, ground_height_m(root), root.y);
    let distance_m = max(distance(root_in_world, frame.eye_in_world), 1e-3);

    // Blades that are thinned out sink rather than vanish; those left are widened to
    // the area that goes.
    let kept_here = kept(distance_m);
    let everything = survey.everything == 1u;
    let blended = survey.blended == 1u;
    let full = f32(TILE_BLADES) * density(root);
    var presence = select(saturate(full * kept_here - f32(rank)), f32(f32(rank) < full), everything);
    var far_fade = max(1.0 - smoothstep(FADE_FROM * survey.range_m, survey.range_m, distance_m), f32(everything));
    presence = select(f32(presence > 0.5), presence, blended);
    far_fade = select(f32(far_fade > 0.5), far_fade, blended);
    let widen = min(pow(kept_here, -KEPT_AREA), MAX_WIDEN);

    // Where the library before had another blade, that one gives way first, then the new one grows.
    let index_of_shape = shape_index(blade, root);
    var share = shares[index_of_shape];
    var old = 0u;
    let old_share = old_shares[index_of_shape];
    if (survey.swapped < 1.0) & (old_share.shape != share.shape) {
        let turn = f32(blade.salt >> 20u & 0xFFu) * (1.0 / 255.0);
        let swapped = saturate(survey.swapped * 1.6 - 0.6 * turn);
        presence *= smoothstep(0.0, 1.0, abs(2.0 * swapped - 1.0));
        if swapped < 0.5 {
            old = 1u;
            share = old_share;
        }
    }
    presence *= far_fade;
    // Nothing grows there: no blade of this library, or of the one before.
    if presence <= 0.0 || share.shape == NO_SHAPE {
        return;
    }
    let lush = lushness(root);
    // Blades that are thinned out first are short ones, which taller ones hide.
    let own_size = f32(blade.shape_turn_scale_mirror >> 24u & 0x7Fu) * (1.0 / 127.0);
    let by_rank = 1.0 - (f32(rank) + 0.5) / f32(TILE_BLADES);
    let size = mix(SCALE_MIN, SCALE_MAX, mix(own_size, by_rank, SIZE_BY_RANK));
    let scale = size * mix(LUSH_SCALE_MIN, LUSH_SCALE_MAX, lush);
    let reach_m = scale * share.reach_m;
    let margin_m = select(reach_m + widen * reach_m * 0.25, BEYOND_ALL, everything);
    for (var i = 0u; i < 5u; i++) {
        if dot(frame.planes[i], vec4f(root_in_world, 1.0)) < -margin_m {
            return;
        }
    }

    let size_px = select(survey.detail * reach_m / (frame.pixel_rad * distance_m), BEYOND_ALL, everything);
    var level = 0u;
    while level < LEVELS - 1u && size_px < LEVEL_PX[level] {
        level++;
    }
    var morph = 0.0;
    if level < LEVELS - 1u {
        let nearly = 1.0 - smoothstep(LEVEL_PX[level], LEVEL_PX[level] * MORPH_FROM, size_px);
        morph = select(0.0, nearly, blended);
    }

    let slot = atomicAdd(&counts.instances, 1u);
    if slot >= survey.capacity {
        return;
    }
    var instance: Instance;
    instance.root_in_world = root_in_world;
    instance.first_knot = (share.shape & 0xFFFu) * SHAPE_KNOTS + LEVEL_FIRST_KNOT[level] | old << 31u;
    instance.bend_rad = bend_rad(root, frame.time_s) + tuft_lean_rad(root);
    instance.scale = scale * presence;
    instance.widen = size * widen * sqrt(presence);
    instance.morph = morph;
    instance.shape_turn_scale_mirror = blade.shape_turn_scale_mirror;
    instance.lean_hue = blade.lean_hue;
    instance.salt = blade.salt;
    instance.lush = lush;
    instance.sunlight = sunlight(root);
    instance.simulated = select(-1, (chunk.slot * i32(TILE_BLADES) + i32(cell)) * i32(LEVEL_KNOTS[0]), chunk.slot >= 0);
    instance.stands_for = select(1.0 / kept_here, 0.0, survey.everything == 1u);
    instances[slot] = instance;
    let place = atomicAdd(&counts.levels[level], 1u);
    lists[level * survey.capacity + place] = slot;
}
