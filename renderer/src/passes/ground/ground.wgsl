// Rings around the eye, each a strip of triangles one instance wide: the ground under the grass,
// and far away, where no blades are drawn, the look of the grass itself.

struct Ground {
    @builtin(position) position: vec4f,
    @location(0) in_world: vec3f,
}

const TAU = 6.2831853;

fn ring_radius_m(ring: u32) -> f32 {
    return GROUND_RANGE_M * (exp2(f32(ring) / f32(GROUND_RINGS) * 12.0) - 1.0) / 4095.0;
}

@vertex
fn vs_main(@builtin(vertex_index) vertex: u32, @builtin(instance_index) ring: u32) -> Ground {
    let angle = f32(vertex >> 1u) * (TAU / f32(GROUND_SECTORS));
    let radius_m = ring_radius_m(ring + (vertex & 1u));
    let p = frame.eye_in_world.xz + vec2f(cos(angle), sin(angle)) * radius_m;
    var ground: Ground;
    ground.in_world = vec3f(p.x, ground_height_m(p), p.y);
    ground.position = frame.clip_from_world * vec4f(ground.in_world, 1.0);
    return ground;
}

@fragment
fn fs_main(ground: Ground) -> @location(0) vec4f {
    let to_eye_m = frame.eye_in_world - ground.in_world;
    let distance_m = length(to_eye_m);
    let to_eye = to_eye_m / distance_m;
    let p = ground.in_world.xz;

    let sun = SUN_COLOUR * sunlight(p);

    // Thatch in the shade of the blades; where nothing grows, earth in the sun.
    let speckle = 0.5 + 0.5 * (perlin(p * 60.0) * 0.5 + perlin(p * 140.0) * 0.5);
    let thatch = mix(vec3f(0.022, 0.032, 0.009), vec3f(0.078, 0.095, 0.027), speckle);
    let clods = 0.8 + 0.3 * perlin(p * 9.0) + 0.2 * perlin(p * 0.7);
    let earth = mix(vec3f(0.060, 0.042, 0.026), vec3f(0.140, 0.105, 0.068), speckle) * clods;
    let bare = select(
        earth * (sun * 0.45 + SKY_FILL * 0.8),
        thatch * (sun * 0.19 + SKY_FILL * 0.42),
        frame.grows > 0u,
    );

    // The grass from afar: its colour, lit as its blades are, light through them included.
    let lush = lushness(p);
    let albedo = mix(vec3f(0.105, 0.135, 0.030), vec3f(0.046, 0.100, 0.020), lush);
    let behind = max(dot(to_eye, -frame.sun_direction), 0.0);
    let lit = 0.20 + 0.62 * behind * behind;
    let tufts = 1.0 + 0.34 * perlin(p * vec2f(1.9, 1.9)) + 0.22 * perlin(p * 0.31);
    let grass = albedo * (sun * lit + SKY_FILL * 0.45) * tufts;

    let far = select(0.0, smoothstep(0.30 * RANGE_M, 0.9 * RANGE_M, distance_m), frame.grows > 0u);
    return stored(with_haze(mix(bare, grass, far), -to_eye, distance_m));
}
