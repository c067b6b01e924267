// How much of the sun gets to a point, by the map of shadows near the eye and by height among the blades
// beyond. Reads the map. Twin of where it lies: mod.rs.

struct Shadow {
    map_from_world: mat4x4f,
    strength: f32,
    texel_m: f32,
    thrown_to_m: f32,
    _pad_0: f32,
}

@group(2) @binding(0) var<uniform> shadow: Shadow;
@group(2) @binding(1) var shadow_map: texture_depth_2d;

// How much of the sun is seen from a point of this depth: nine texels, weighed by a quadratic B-spline, so
// that a shadow's edge is soft and no texel's corner is seen on a leaf. By hand, since the drivers' own filters
// differ.
fn sun_seen(uv: vec2f, depth: f32) -> f32 {
    let size = vec2i(textureDimensions(shadow_map));
    let t = uv * vec2f(size);
    let middle = floor(t);
    let f = t - middle - 0.5;
    let x = array(0.5 * (0.5 - f.x) * (0.5 - f.x), 0.75 - f.x * f.x, 0.5 * (0.5 + f.x) * (0.5 + f.x));
    let y = array(0.5 * (0.5 - f.y) * (0.5 - f.y), 0.75 - f.y * f.y, 0.5 * (0.5 + f.y) * (0.5 + f.y));
    var seen = 0.0;
    for (var row = 0; row < 3; row++) {
        for (var column = 0; column < 3; column++) {
            let texel = clamp(vec2i(middle) + vec2i(column - 1, row - 1), vec2i(0), size - 1);
            seen += select(0.0, x[column] * y[row], depth <= textureLoad(shadow_map, texel, 0));
        }
    }
    return seen;
}

// `depth_m`: below the meadow's roof.
fn sun_at(in_world: vec3f, depth_m: f32) -> f32 {
    let by_height = sun_below(depth_m);
    // A leaf does not hide itself: the look goes from a little before it.
    let at = (shadow.map_from_world * vec4f(in_world + light.to_sun * (4.0 * shadow.texel_m + 0.004), 1.0)).xyz;
    let edge = max(abs(at.x), abs(at.y));
    // Without a map nothing is inside. A branch on the strength alone would have Mesa's software driver make the
    // shader anew for each frame.
    // Where blades grow too small in the picture to throw any, the map is empty and would let all of the sun through.
    let far = distance(in_world, frame.eye_in_world) / max(shadow.thrown_to_m, 1e-3);
    let inside = shadow.strength * (1.0 - smoothstep(0.7, 1.0, edge)) * (1.0 - smoothstep(0.4, 0.8, far));
    if inside <= 0.0 {
        return by_height;
    }
    let uv = vec2f(0.5 + 0.5 * at.x, 0.5 - 0.5 * at.y);
    let seen = sun_seen(uv, at.z);
    // A leaf lets some light through: its shadow is not black.
    let lit = mix(0.14, 1.0, seen);
    // Blades out of the picture are not in the map: some of what they take is taken by height.
    return mix(by_height, lit * mix(1.0, by_height, 0.25), inside);
}
