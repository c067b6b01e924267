// How much of the sun gets to a point, by the map of shadows near the eye and by height among the blades
// beyond. Reads the map. Twin of where it lies: mod.rs.

struct Shadow {
    map_from_world: mat4x4f,
    strength: f32,
    texel_m: f32,
    _pad_0: f32,
    _pad_1: f32,
}

@group(2) @binding(0) var<uniform> shadow: Shadow;
@group(2) @binding(1) var shadow_map: texture_depth_2d;
@group(2) @binding(2) var shadow_sampler: sampler_comparison;

// `depth_m`: below the meadow's roof.
fn sun_at(in_world: vec3f, depth_m: f32) -> f32 {
    let by_height = sun_below(depth_m);
    if shadow.strength == 0.0 {
        return by_height;
    }
    // A leaf does not hide itself: the look goes from a little before it.
    let at = (shadow.map_from_world * vec4f(in_world + light.to_sun * (2.5 * shadow.texel_m + 0.002), 1.0)).xyz;
    let edge = max(abs(at.x), abs(at.y));
    let inside = 1.0 - smoothstep(0.7, 1.0, edge);
    if inside <= 0.0 {
        return by_height;
    }
    let uv = vec2f(0.5 + 0.5 * at.x, 0.5 - 0.5 * at.y);
    // Four looks around it: the sun is no point, and a texel's corners are not to be seen on a leaf.
    let texel = 1.0 / vec2f(textureDimensions(shadow_map));
    let seen = 0.25 * (textureSampleCompareLevel(shadow_map, shadow_sampler, uv + texel * vec2f(0.4, 1.1), at.z)
        + textureSampleCompareLevel(shadow_map, shadow_sampler, uv + texel * vec2f(-0.4, -1.1), at.z)
        + textureSampleCompareLevel(shadow_map, shadow_sampler, uv + texel * vec2f(1.1, -0.4), at.z)
        + textureSampleCompareLevel(shadow_map, shadow_sampler, uv + texel * vec2f(-1.1, 0.4), at.z));
    // Blades out of the picture are not in the map: some of what they take is taken by height.
    return mix(by_height, seen * mix(1.0, by_height, 0.35), inside);
}
