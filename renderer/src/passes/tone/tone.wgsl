// One invocation handles one pixel: scene light, exposed already, to display light.
// Reads the resolved picture.
// Source: AgX (Sobotka 2022), its curve as the polynomial of Wrensch 2023: bright colours go pale
// together, where a curve a channel would turn sunlit grass to lemon.

override ENCODE_SRGB: bool = false;

const CONTRAST = 1.28;
const SATURATION = 1.22;

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

// Light to what a display with a gamma of 2.2 is given.
fn agx(light: vec3f) -> vec3f {
    let inset = mat3x3f(
        vec3f(0.842479062, 0.042328242, 0.042375655),
        vec3f(0.078433600, 0.878468636, 0.078433600),
        vec3f(0.079223745, 0.079166127, 0.879142974),
    );
    let outset = mat3x3f(
        vec3f(1.196879005, -0.052896852, -0.052971636),
        vec3f(-0.098020881, 1.151903130, -0.098043450),
        vec3f(-0.099029744, -0.098961177, 1.151073673),
    );
    let x = saturate((log2(max(inset * light, vec3f(1e-10))) + 12.47393) / 16.5);
    let x2 = x * x;
    let x4 = x2 * x2;
    let curve = 15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.00232;
    let punchy = pow(max(curve, vec3f(0.0)), vec3f(CONTRAST));
    let grey = dot(punchy, vec3f(0.2126, 0.7152, 0.0722));
    return saturate(outset * (grey + SATURATION * (punchy - grey)));
}

// Half a step of 8 bits to either side, so that a slow gradient has no edges: interleaved gradient noise
// (Jimenez 2014).
fn dither(pixel: vec2f) -> f32 {
    return (fract(52.9829189 * fract(dot(floor(pixel), vec2f(0.06711056, 0.00583715)))) - 0.5) / 255.0;
}

@fragment
fn fs_main(place: Place) -> @location(0) vec4f {
    let stored = scene_at(place.across);
    let light = stored / max(1.0 - max(stored.r, max(stored.g, stored.b)), 1e-3);
    let mapped = pow(agx(light), vec3f(2.2));
    // A display that is not sRGB by itself gets the curve here.
    let srgb = select(1.055 * pow(mapped, vec3f(1.0 / 2.4)) - 0.055, mapped * 12.92, mapped <= vec3f(0.0031308));
    return vec4f(select(mapped, srgb + dither(place.position.xy), vec3<bool>(ENCODE_SRGB)), 1.0);
}
