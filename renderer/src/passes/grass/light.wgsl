// The light on a blade: one invocation a sample of its ribbon, which `grass.wgsl` (before it in the same
// module) has expanded. What a leaf looks like stands in leaf.wgsl.

struct Ribbon {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(perspective, centroid) in_world: vec3f,
    @location(1) @interpolate(perspective, centroid) normal: vec3f,
    @location(2) @interpolate(perspective, centroid) across: vec3f,
    // -1 at the left edge, 1 at the right; height above the ground, metres.
    @location(3) @interpolate(perspective, centroid) side_and_height: vec2f,
    @location(4) @interpolate(perspective, centroid) albedo: vec3f,
    // How much of the light comes through; how glossy; how much sun the clouds leave.
    @location(5) @interpolate(perspective, centroid) through_gloss_sun: vec3f,
}

// The stored light that a ribbon sends to the eye: of a sample, or of a vertex where the blade is small.
// `veins_seen`: how much of the veins is wide enough to be seen, 0 to 1.
fn light_of(ribbon: Ribbon, veins_seen: f32) -> vec4f {
    let to_eye_m = frame.eye_in_world - ribbon.in_world;
    let distance_m = length(to_eye_m);
    let to_eye = to_eye_m / distance_m;
    let side = ribbon.side_and_height.x;

    // Both faces are seen: the normal is turned to the eye, rounded across the blade like a shallow
    // gutter, and bent up a little, since a blade far below a pixel is one of many.
    let flat_normal = normalize(ribbon.normal);
    let facing = select(-flat_normal, flat_normal, dot(flat_normal, to_eye) >= 0.0);
    let n = normalize(facing + ribbon.across * (side * 0.5) + vec3f(0.0, 0.18, 0.0));

    // A pale midrib, and the veins beside it, where they are wide enough to be seen.
    let veins = 0.11 * veins_seen * cos(side * 44.0) * (1.0 - side * side);
    let rib = 1.0 + 0.22 * exp(-side * side * 60.0) - 0.12 * abs(side) + veins;
    let leaf = Leaf(ribbon.albedo * rib, ribbon.through_gloss_sun.x, ribbon.through_gloss_sun.y);
    let depth_m = max(CANOPY_M - ribbon.side_and_height.y, 0.0);
    let lit = lit_leaf(leaf, facing, n, to_eye, depth_m, sun_at(ribbon.in_world, depth_m), ribbon.through_gloss_sun.z, distance_m);
    return stored(with_haze(lit, -to_eye, distance_m));
}

@fragment
fn fs_main(ribbon: Ribbon) -> @location(0) vec4f {
    return light_of(ribbon, 1.0 - smoothstep(0.02, 0.09, fwidth(ribbon.side_and_height.x)));
}
