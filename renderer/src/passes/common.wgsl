// What every pass shares: the frame's uniform, noise, ground and wind (twins: scene/perlin.rs,
// scene/terrain.rs, scene/wind.rs), and the colours of sky and haze.
// Constants in capitals that are not declared here come from Rust (gpu/shader.rs).

struct Frame {
    clip_from_world: mat4x4f,
    world_from_clip: mat4x4f,
    planes: array<vec4f, 5>,
    eye_in_world: vec3f,
    time_s: f32,
    sun_direction: vec3f,
    pixel_rad: f32,
    grows: u32,
    _pad_0: u32,
    _pad_1: u32,
    _pad_2: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;

const SUN_COLOUR = vec3f(4.6, 4.05, 3.1);
const ZENITH = vec3f(0.13, 0.36, 0.92);
const HORIZON = vec3f(0.86, 1.08, 1.26);
const SKY_FILL = vec3f(0.52, 0.72, 0.98);

fn hash(x: i32, z: i32) -> u32 {
    var h = bitcast<u32>(x) * 0x9E3779B1u;
    h = (h ^ h >> 15u) * 0x2C1B3C6Du + bitcast<u32>(z) * 0x85EBCA77u;
    h ^= h >> 16u;
    h *= 0x85EBCA6Bu;
    h ^= h >> 13u;
    h *= 0xC2B2AE35u;
    return h ^ (h >> 16u);
}

fn gradient_dot(x: i32, z: i32, f: vec2f) -> f32 {
    let h = hash(x, z);
    let s = select(vec2f(-1.0), vec2f(1.0), vec2<bool>((h & 4u) == 0u, (h & 8u) == 0u));
    switch h & 3u {
        case 0u: { return s.x * f.x; }
        case 1u: { return s.x * f.y; }
        default: { return dot(s, f) * 0.70710678; }
    }
}

fn perlin(p: vec2f) -> f32 {
    let cell = floor(p);
    let f = p - cell;
    let x = i32(cell.x);
    let z = i32(cell.y);
    let u = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let near = mix(gradient_dot(x, z, f), gradient_dot(x + 1, z, f - vec2f(1.0, 0.0)), u.x);
    let far = mix(gradient_dot(x, z + 1, f - vec2f(0.0, 1.0)), gradient_dot(x + 1, z + 1, f - vec2f(1.0)), u.x);
    return mix(near, far, u.y) * 1.4;
}

fn ground_height_m(p: vec2f) -> f32 {
    return perlin(p * (1.0 / 31.0)) * 1.1 + perlin(p * (1.0 / 7.3)) * 0.16;
}

fn density(p: vec2f) -> f32 {
    return clamp(0.86 + 0.5 * perlin(p * (1.0 / 1.9)), 0.45, 1.0);
}

fn lushness(p: vec2f) -> f32 {
    let patches = 0.62 * perlin(p * (1.0 / 5.7)) + 0.34 * perlin(p * (1.0 / 1.3)) + 0.30 * perlin(p * (1.0 / 0.43));
    return clamp(0.52 + patches, 0.0, 1.0);
}

fn tuft_lean_rad(p: vec2f) -> vec2f {
    return 0.42 * vec2f(perlin(p * (1.0 / 0.47)), perlin(p * (1.0 / 0.47) + vec2f(31.7, 11.3)));
}

fn bend_rad(root: vec2f, time_s: f32) -> vec2f {
    let travelled = root - WIND_DIRECTION * (WIND_SPEED_M_PER_S * time_s);
    let gust = perlin(travelled * (1.0 / 2.6));
    let flutter = perlin(travelled * (1.0 / 0.45) + vec2f(0.0, 0.7 * time_s));
    return WIND_DIRECTION * (0.10 + 0.14 * gust)
        + vec2f(-WIND_DIRECTION.y, WIND_DIRECTION.x) * (0.07 * flutter);
}

// How much of the sun passes the clouds above `p`, 0.3 to 1.
fn sunlight(p: vec2f) -> f32 {
    let drift = p * (1.0 / 19.0) + vec2f(0.03, 0.01) * frame.time_s + vec2f(0.35, 0.6);
    return mix(0.30, 1.0, smoothstep(-0.38, 0.02, perlin(drift) + 0.25 * perlin(drift * 3.1)));
}

// Radiance of the clear sky towards `direction`, without the sun's disc.
fn sky_radiance(direction: vec3f) -> vec3f {
    let up = max(direction.y, 0.0);
    let towards_sun = max(dot(direction, frame.sun_direction), 0.0);
    let base = mix(HORIZON, ZENITH, 1.0 - exp(-up * 3.4));
    let glow = SUN_COLOUR * (0.045 * pow(towards_sun, 8.0) + 0.16 * pow(towards_sun, 48.0));
    return base + glow;
}

// What the air between the eye and a point `distance_m` away does to the point's light.
fn with_haze(colour: vec3f, direction: vec3f, distance_m: f32) -> vec3f {
    let haze = sky_radiance(normalize(vec3f(direction.x, 0.02, direction.z))) * 0.92;
    return mix(haze, colour, exp(-distance_m * (1.0 / 150.0)));
}

// Scene light as it is stored: within 0..1, so that one bright sample of four does not outshine the
// others of its pixel. `passes/tone` undoes it after they are averaged.
// Source: Karis, "Tone mapping", 2013.
fn stored(colour: vec3f) -> vec4f {
    return vec4f(colour / (1.0 + max(colour.r, max(colour.g, colour.b))), 1.0);
}
