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

// Noise of about `size_m`, turned so that no two of them share a lattice, and gone where a pixel is larger.
fn grain(p: vec2f, size_m: f32, turn: f32, pixel_m: f32) -> f32 {
    let visible = 1.0 - smoothstep(0.25, 0.8, pixel_m / size_m);
    if visible <= 0.0 {
        return 0.0;
    }
    let c = cos(turn);
    let s = sin(turn);
    return visible * perlin(vec2f(c * p.x - s * p.y, s * p.x + c * p.y) * (1.0 / size_m));
}

// The grass from afar: a few leaves that stand for all that a pixel covers, lit as each blade is.
fn meadow(p: vec2f, to_eye: vec3f, distance_m: f32, cloud: f32, lower_m: f32) -> vec3f {
    let lush = lushness(p);
    // The steeper the look, the deeper down it goes between the blades.
    let deeper = 1.0 + 2.5 * saturate(to_eye.y);
    var sum = vec3f(0.0);
    for (var i = 0u; i < 4u; i++) {
        let turn = f32(i) * (TAU / 4.0) + 0.6;
        let flat_normal = normalize(vec3f(cos(turn), 0.45, sin(turn)));
        let facing = select(-flat_normal, flat_normal, dot(flat_normal, to_eye) >= 0.0);
        let n = normalize(facing + vec3f(0.0, 0.18, 0.0));
        let leaf = mean_leaf(0.55 + 0.12 * f32(i), lush);
        let depth_m = lower_m + (0.012 + 0.022 * f32(3u - i)) * deeper;
        sum += lit_leaf(leaf, facing, n, to_eye, depth_m, sun_below(depth_m), cloud, distance_m);
    }
    return sum * 0.25;
}

@fragment
fn fs_main(ground: Ground) -> @location(0) vec4f {
    let to_eye_m = frame.eye_in_world - ground.in_world;
    let distance_m = length(to_eye_m);
    let to_eye = to_eye_m / distance_m;
    let p = ground.in_world.xz;

    // Side of a pixel on the ground, as the geometric mean of its two sides.
    let pixel_m = distance_m * frame.pixel_rad / sqrt(max(to_eye.y, 0.02));
    let cloud = sunlight(p);
    let above = sky_fill(vec3f(0.0, 1.0, 0.0));
    let sun = light.sun * (cloud * light.to_sun.y);
    // The fewer blades are drawn, the more the ground stands for those left out: first for what is low between
    // the others, at the end for all.
    let ratio = min(frame.full_pixel_m / max(frame.pixel_rad * distance_m, 1e-9), 1.0);
    let drawn = ratio * sqrt(sqrt(ratio)) * (1.0 - smoothstep(FADE_FROM * frame.range_m, frame.range_m, distance_m));
    // Where the field ends, the same meadow goes on, seen from afar.
    let beyond_m = max(frame.field_from_m - p, p - frame.field_to_m);
    let within = 1.0 - smoothstep(-FIELD_FRINGE_M, FIELD_FRINGE_M, max(beyond_m.x, beyond_m.y));
    let far = frame.grown * (1.0 - drawn * within);

    var near_light = vec3f(0.0);
    if far < 1.0 {
        // Thatch in the shade of the blades; where nothing grows, earth in the sun.
        let litter = grain(p, 0.017, 0.6, pixel_m) + grain(p + 0.02 * perlin(p * 23.0), 0.0071, 2.1, pixel_m);
        let speckle = saturate(0.42 + 0.26 * litter);
        let thatch = mix(vec3f(0.040, 0.035, 0.018), vec3f(0.098, 0.083, 0.045), speckle);
        let clods = 0.8 + 0.3 * perlin(p * 9.0) + 0.2 * perlin(p * 0.7);
        let earth = mix(vec3f(0.060, 0.042, 0.026), vec3f(0.140, 0.105, 0.068), speckle) * clods;
        near_light = mix(
            earth * (sun + above),
            thatch * (sun * sun_at(ground.in_world, CANOPY_M) + above * sky_below(CANOPY_M)),
            frame.grown,
        );
    }
    var far_light = vec3f(0.0);
    if far > 0.0 {
        // Tufts, single tips in the light and gaps between them, and the waves of the wind, where the grass
        // that is laid over shows its sides.
        let fine = 0.7 * grain(p, 0.11, 0.9, pixel_m) + 0.8 * grain(p, 0.034, 1.7, pixel_m) + 0.6 * grain(p, 0.013, 0.3, pixel_m);
        let coarse = 0.22 * grain(p, 0.53, 2.6, pixel_m) + 0.20 * grain(p, 3.2, 0.4, pixel_m);
        let wave = dot(bend_rad(p, frame.time_s), WIND_DIRECTION) - 0.12;
        let tufts = (1.0 + coarse) * exp(0.75 * fine) * (1.0 + 1.1 * wave);
        far_light = meadow(p, to_eye, distance_m, cloud, 0.06 * (1.0 - far)) * tufts;
    }
    return stored(with_haze(mix(near_light, far_light, far), -to_eye, distance_m));
}
