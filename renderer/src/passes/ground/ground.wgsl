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

    // Thatch and earth in the shade of the blades.
    let speckle = perlin(p * 60.0) * 0.5 + perlin(p * 140.0) * 0.5;
    let thatch = mix(vec3f(0.024, 0.030, 0.009), vec3f(0.085, 0.086, 0.028), 0.5 + 0.5 * speckle);
    // Where nothing grows, nothing shades.
    let open = select(vec2f(0.45, 1.6), vec2f(0.16, 0.40), frame.grows > 0u);
    let bare = thatch * (SUN_COLOUR * open.x + SKY_FILL * open.y);

    // The grass from afar: its colour, lit as its blades are, light through them included.
    let lush = lushness(p);
    let albedo = mix(vec3f(0.105, 0.135, 0.030), vec3f(0.046, 0.100, 0.020), lush);
    let behind = max(dot(to_eye, -frame.sun_direction), 0.0);
    let lit = 0.20 + 0.62 * behind * behind;
    let tufts = 1.0 + 0.34 * perlin(p * vec2f(1.9, 1.9)) + 0.22 * perlin(p * 0.31);
    let grass = albedo * (SUN_COLOUR * lit + SKY_FILL * 0.45) * tufts;

    let far = select(0.0, smoothstep(0.30 * RANGE_M, 0.9 * RANGE_M, distance_m), frame.grows > 0u);
    return vec4f(with_haze(mix(bare, grass, far), -to_eye, distance_m), 1.0);
}
