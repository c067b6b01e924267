// What the kernels of this folder share: the field, the lists that they hand on, and how many blades are drawn
// how far away. Twin: cpu.rs.

struct Survey {
    first_tile_x: i32,
    first_tile_z: i32,
    columns: u32,
    tiles: u32,
    // Side of the ground that a pixel covers up to which every blade is drawn.
    full_pixel_m: f32,
    // Factor on a blade's size in pixels where its level of detail is chosen.
    detail: f32,
    range_m: f32,
    // How far the library before has given way to this one, 0 to 1.
    swapped: f32,
    blocks: u32,
    // Whether every blade of every tile is drawn with all knots, 0 or 1.
    everything: u32,
    slots: u32,
    capacity: u32,
    // How far any part of any blade is from its root, metres.
    reach_m: f32,
    // Whether what comes, goes or changes does so smoothly, 0 or 1.
    blended: u32,
    _pad_0: u32,
    _pad_1: u32,
}

struct Chunk {
    tile_x: i32,
    tile_z: i32,
    first_rank: u32,
    // The tile's slot of simulated knots, −1 without.
    slot: i32,
}

struct Counts {
    chunks: atomic<u32>,
    instances: atomic<u32>,
    levels: array<atomic<u32>, LEVELS>,
}

// No branch of these kernels hangs on the survey alone: Mesa's software driver makes a shader anew for each frame whose
// uniforms decide a branch, and keeps them all.
@group(1) @binding(0) var<uniform> survey: Survey;

// More than anything is away or large.
const BEYOND_ALL: f32 = 1e9;

// The part of the blades that is drawn this far away, 0 to 1.
fn kept(distance_m: f32) -> f32 {
    let ratio = min(survey.full_pixel_m / max(frame.pixel_rad * distance_m, 1e-9), 1.0);
    return select(ratio * sqrt(sqrt(ratio)), 1.0, survey.everything == 1u);
}
