// One invocation: what was counted becomes the arguments of the commands that follow, within the lists' bounds.
// Reads `counts`; writes the dispatch of blades.wgsl and the draws, one a level of detail. Runs after tiles.wgsl
// and again after blades.wgsl.

struct Dispatch {
    x: u32,
    y: u32,
    z: u32,
}

struct Draw {
    index_count: u32,
    instance_count: u32,
    first_index: u32,
    base_vertex: i32,
    first_instance: u32,
}

@group(1) @binding(1) var<storage, read_write> counts: Counts;
@group(1) @binding(2) var<storage, read_write> dispatch: Dispatch;
@group(1) @binding(3) var<storage, read_write> draws: array<Draw, LEVELS>;

@compute @workgroup_size(1)
fn main() {
    let chunks = min(atomicLoad(&counts.chunks), CHUNK_CAPACITY);
    dispatch = Dispatch((chunks * CHUNK_BLADES + 63u) / 64u, 1u, 1u);
    for (var level = 0u; level < LEVELS; level++) {
        let blades = min(atomicLoad(&counts.levels[level]), survey.capacity);
        let vertices = i32(level * VERTICES_A_LEVEL);
        draws[level] = Draw(LEVEL_INDICES[level], blades, 0u, vertices, level * survey.capacity);
    }
}
