// What every pass shares: the frame's uniform, noise and ground (twins: scene/perlin.rs,
// scene/terrain.rs). wind.wgsl and light.wgsl follow it.
// Constants in capitals that are not declared here come from Rust (gpu/shader.rs).

struct Frame {
    clip_from_world: mat4x4f,
    world_from_clip: mat4x4f,
    planes: array<vec4f, 5>,
    eye_in_world: vec3f,
    time_s: f32,
    pixel_rad: f32,
    grown: f32,
    full_pixel_m: f32,
    range_m: f32,
    field_from_m: vec2f,
    field_to_m: vec2f,
}

@group(0) @binding(0) var<uniform> frame: Frame;

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
