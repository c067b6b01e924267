// The light on a blade: its colour from root to tip, and one invocation a sample of its ribbon, which
// `grass.wgsl` (before it in the same module) has expanded.
// Source: light through the blade: Crysis (Sousa, GPU Gems 3 ch. 16).

struct Ribbon {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(perspective, centroid) in_world: vec3f,
    @location(1) @interpolate(perspective, centroid) normal: vec3f,
    @location(2) @interpolate(perspective, centroid) across: vec3f,
    // -1 at the left edge, 1 at the right; height above the ground, metres.
    @location(3) @interpolate(perspective, centroid) side_and_height: vec2f,
    @location(4) @interpolate(perspective, centroid) albedo: vec3f,
    // How much of the light comes through; how glossy; how much sun reaches the meadow here.
    @location(5) @interpolate(perspective, centroid) through_gloss_sun: vec3f,
}

fn blade_albedo(along: f32, lush: f32, hue: f32, dry: f32) -> vec3f {
    let base = vec3f(0.020, 0.045, 0.009);
    let middle = mix(vec3f(0.090, 0.128, 0.032), vec3f(0.034, 0.088, 0.020), lush);
    let tip = mix(vec3f(0.190, 0.195, 0.070), vec3f(0.085, 0.148, 0.036), lush);
    let green = mix(mix(base, middle, smoothstep(0.0, 0.45, along)), tip, smoothstep(0.35, 1.0, along));
    let varied = green * mix(vec3f(0.62, 0.80, 0.95), vec3f(1.35, 1.12, 0.90), hue);
    let straw = vec3f(0.36, 0.27, 0.125) * mix(0.55, 1.0, along);
    return mix(varied, straw, dry);
}

// The stored light that a ribbon sends to the eye: of a sample, or of a vertex where the blade is small.
fn light(ribbon: Ribbon) -> vec4f {
    let to_eye_m = frame.eye_in_world - ribbon.in_world;
    let distance_m = length(to_eye_m);
    let to_eye = to_eye_m / distance_m;
    let to_sun = frame.sun_direction;
    let side = ribbon.side_and_height.x;
    let height_m = ribbon.side_and_height.y;

    // Both faces are seen: the normal is turned to the eye, rounded across the blade like a shallow
    // gutter, and bent up a little, since neighbours light a blade from all around.
    let flat_normal = normalize(ribbon.normal);
    let facing = select(-flat_normal, flat_normal, dot(flat_normal, to_eye) >= 0.0);
    let n = normalize(facing + ribbon.across * (side * 0.55) + vec3f(0.0, 0.35, 0.0));

    // How much of the sky and the sun reaches down between the neighbours.
    let depth_m = max(CANOPY_M - height_m, 0.0);
    let open_sky = mix(0.14, 1.0, exp(-depth_m * 13.0));
    let sun_reach = exp(-depth_m * (2.6 / max(to_sun.y, 0.15)));

    let rib = 1.0 + 0.28 * exp(-side * side * 70.0) - 0.10 * abs(side);
    let albedo = ribbon.albedo * rib;

    let n_dot_l = dot(n, to_sun);
    let diffuse = max(n_dot_l, 0.0);
    let behind = max(dot(to_eye, -to_sun), 0.0);
    let behind_2 = behind * behind;
    let back = mix(behind_2 * behind_2, saturate(-n_dot_l * 0.6 + 0.4), 0.62);
    let through = (albedo * vec3f(1.15, 1.20, 0.62)) * (back * ribbon.through_gloss_sun.x);

    let half_way = normalize(to_eye + to_sun);
    let fresnel = 0.04 + 0.5 * pow(1.0 - max(dot(to_eye, half_way), 0.0), 5.0);
    // Far away a highlight is smaller than a pixel, and would only sparkle.
    // So is one on a blade that is seen on its edge.
    let broad = saturate(abs(dot(flat_normal, to_eye)) * 3.5);
    let calm = broad / (1.0 + distance_m * distance_m * 0.12);
    let gloss = pow(max(dot(n, half_way), 0.0), 38.0) * fresnel * 2.2 * calm * ribbon.through_gloss_sun.y;

    let sky = mix(vec3f(0.10, 0.14, 0.04), SKY_FILL, 0.5 + 0.5 * n.y) * (0.85 * open_sky);
    let sheen = SKY_FILL * (0.05 * open_sky * pow(1.0 - max(dot(n, to_eye), 0.0), 3.0));
    let sun = SUN_COLOUR * (sun_reach * ribbon.through_gloss_sun.z) * (albedo * diffuse * 0.55 + through + vec3f(gloss));
    return stored(with_haze(sun + albedo * sky + sheen, -to_eye, distance_m));
}

@fragment
fn fs_main(ribbon: Ribbon) -> @location(0) vec4f {
    return light(ribbon);
}
