// One invocation handles one pixel: scene light to display light.
// Reads the resolved picture. Source: Narkowicz 2016, a fit of the ACES curve.

override ENCODE_SRGB: bool = false;

const EXPOSURE = 0.62;

@group(0) @binding(0) var scene: texture_2d<f32>;

@vertex
fn vs_main(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn fs_main(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let stored = textureLoad(scene, vec2u(position.xy), 0).rgb;
    let x = stored / max(1.0 - max(stored.r, max(stored.g, stored.b)), 1e-3) * EXPOSURE;
    let mapped = saturate(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14));
    // A display that is not sRGB by itself gets the curve here.
    let srgb = select(1.055 * pow(mapped, vec3f(1.0 / 2.4)) - 0.055, mapped * 12.92, mapped <= vec3f(0.0031308));
    return vec4f(select(mapped, srgb, vec3<bool>(ENCODE_SRGB)), 1.0);
}
