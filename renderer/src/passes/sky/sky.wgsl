// One triangle over the picture, behind everything: gradient, thin clouds, the sun, and two ridges
// of hills in the haze, so that the meadow ends in a landscape and not at an edge.

struct Sky {
    @builtin(position) position: vec4f,
    @location(0) clip: vec2f,
}

@vertex
fn vs_main(@builtin(vertex_index) index: u32) -> Sky {
    var sky: Sky;
    sky.clip = vec2f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0);
    // Reversed depth: 0 is infinitely far.
    sky.position = vec4f(sky.clip, 0.0, 1.0);
    return sky;
}

fn clouds(direction: vec3f) -> f32 {
    let p = direction.xz / (direction.y + 0.12) * 1.3 + vec2f(0.012, 0.004) * frame.time_s;
    let warped = p + 0.35 * vec2f(perlin(p * 1.7), perlin(p * 1.7 + vec2f(5.2, 1.3)));
    var sum = 0.0;
    var amplitude = 0.55;
    var q = warped;
    for (var octave = 0; octave < 4; octave++) {
        sum += amplitude * perlin(q);
        q = vec2f(q.x * 1.6 - q.y * 1.2, q.x * 1.2 + q.y * 1.6);
        amplitude *= 0.5;
    }
    return smoothstep(0.02, 0.55, sum) * smoothstep(0.01, 0.22, direction.y);
}

fn ridge(heading: f32, scale: f32, row: f32) -> f32 {
    let p = vec2f(cos(heading), sin(heading)) * scale + row;
    return perlin(p) + 0.4 * perlin(p * 2.7) + 0.12 * perlin(p * 9.0);
}

@fragment
fn fs_main(sky: Sky) -> @location(0) vec4f {
    let near = frame.world_from_clip * vec4f(sky.clip, 1.0, 1.0);
    let direction = normalize(near.xyz / near.w - frame.eye_in_world);
    let towards_sun = dot(direction, light.to_sun);

    let haze = horizon_radiance(direction);
    var colour = mix(haze, sky_radiance(direction), smoothstep(0.0, 0.07, direction.y));
    let cloud = clouds(direction);
    let above = sky_fill(vec3f(0.0, 1.0, 0.0));
    let lit = light.sun * (0.20 + 0.9 * pow(max(towards_sun, 0.0), 10.0)) + above * 1.1;
    colour = mix(colour, lit, cloud * 0.6);
    let disc = smoothstep(0.99985, 0.99992, towards_sun);
    colour += light.sun * ((200.0 * disc + 0.5 * pow(max(towards_sun, 0.0), 900.0)) * (1.0 - 0.8 * cloud));

    let heading = atan2(direction.z, direction.x);
    let far_ridge = 0.050 + 0.022 * ridge(heading, 2.1, 3.7);
    let near_ridge = 0.022 + 0.016 * ridge(heading, 4.3, 17.1);
    let soft = 1.5 * frame.pixel_rad;
    // Woods, through kilometres of air. Mist lies at the foot of each ridge and takes it over into the
    // haze where the ground ends.
    let woods = vec3f(0.030, 0.045, 0.022) * (light.sun * 0.6 + above);
    // So much air before something dark is bluer than the same air before the bright horizon.
    let veil = haze * vec3f(0.84, 0.95, 1.06);
    let far_colour = mix(mix(haze, veil, smoothstep(0.0, 0.05, direction.y)), woods, 0.30 * smoothstep(0.0, 0.05, direction.y));
    let near_colour = mix(mix(haze, veil, smoothstep(-0.004, 0.03, direction.y)), woods, 0.50 * smoothstep(-0.004, 0.03, direction.y));
    colour = mix(colour, far_colour, 1.0 - smoothstep(-soft, soft, direction.y - far_ridge));
    colour = mix(colour, near_colour, 1.0 - smoothstep(-soft, soft, direction.y - near_ridge));
    return stored(colour);
}
