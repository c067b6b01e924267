// One blade to draw: written by cull/blades.wgsl, read by grass/grass.wgsl.

struct Instance {
    root_in_world: vec3f,
    // Above: whether it is of the library before (bit 31).
    first_knot: u32,
    bend_rad: vec2f,
    scale: f32,
    widen: f32,
    morph: f32,
    shape_turn_scale_mirror: u32,
    lean_hue: u32,
    salt: u32,
    lush: f32,
    sunlight: f32,
    // The first of its simulated knots, −1 without.
    simulated: i32,
    // How many blades it stands for, itself among them; 0 where it is drawn however thin it is.
    stands_for: f32,
}
