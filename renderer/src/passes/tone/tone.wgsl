// One invocation handles one pixel: scene light to display light.
// Reads the resolved picture. Source: Narkowicz 2016, a fit of the ACES curve.

override ENCODE_SRGB: bool = false;

const EXPOSURE = 0.62;

@group(0) @binding(0) var scene: texture_2d<f32>;

struct Place {
    @builtin(position) position: vec4f,
    // Right and down the picture, 0 to 1.
    @location(0) across: vec2f,
}

@vertex
fn vs_main(@builtin(vertex_index) index: u32) -> Place {
    let clip = vec2f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0);
    return Place(vec4f(clip, 0.0, 1.0), vec2f(0.5 + 0.5 * clip.x, 0.5 - 0.5 * clip.y));
}

// The scene there: a pixel, or where it has fewer pixels than the display, the mean of the four around, by nearness.
fn scene_at(across: vec2f) -> vec3f {
    let size = vec2f(textureDimensions(scene));
    let at = clamp(across * size - 0.5, vec2f(0.0), size - 1.0);
    // Of as many pixels as the display, each is itself.
    let first = floor(at + 0.002);
    let between = max(at - first, vec2f(0.0));
    if all(between < vec2f(0.004)) {
        return textureLoad(scene, vec2u(first), 0).rgb;
    }
    let a = vec2u(first);
    let b = min(a + 1u, textureDimensions(scene) - 1u);
    let upper = mix(textureLoad(scene, a, 0).rgb, textureLoad(scene, vec2u(b.x, a.y), 0).rgb, between.x);
    let lower = mix(textureLoad(scene, vec2u(a.x, b.y), 0).rgb, textureLoad(scene, b, 0).rgb, between.x);
    return mix(upper, lower, between.y);
}

@fragment
fn fs_main(place: Place) -> @location(0) vec4f {
    let stored = scene_at(place.across);
    let x = stored / max(1.0 - max(stored.r, max(stored.g, stored.b)), 1e-3) * EXPOSURE;
    let mapped = saturate(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14));
    // A display that is not sRGB by itself gets the curve here.
    let srgb = select(1.055 * pow(mapped, vec3f(1.0 / 2.4)) - 0.055, mapped * 12.92, mapped <= vec3f(0.0031308));
    return vec4f(select(mapped, srgb, vec3<bool>(ENCODE_SRGB)), 1.0);
}
