// The light that every pass sees: sky, sun, haze and the shadows of clouds. Colours are linear sRGB,
// exposed. Twins: scene/light.rs, scene/sky.rs, where the sources are.

struct Light {
    perez: array<vec4f, 5>,
    zenith_over_perez: vec4f,
    haze: array<vec4f, HAZE_TERMS>,
    fill: array<vec4f, 4>,
    sun: vec3f,
    exposure: f32,
    to_sun: vec3f,
    shadow_slope: f32,
}

@group(0) @binding(1) var<uniform> light: Light;

// Light of the clear sky from `direction`, without the sun's disc.
fn sky_radiance(direction: vec3f) -> vec3f {
    let cos_zenith = max(direction.y, MIN_COS_ZENITH);
    let cos_gamma = clamp(dot(direction, light.to_sun), -1.0, 1.0);
    let gamma = acos(cos_gamma);
    let perez = (1.0 + light.perez[0].xyz * exp(light.perez[1].xyz / cos_zenith))
        * (1.0 + light.perez[2].xyz * exp(light.perez[3].xyz * gamma) + light.perez[4].xyz * (cos_gamma * cos_gamma));
    let yxy = light.zenith_over_perez.xyz * perez;
    let xyz = vec3f(yxy.y / yxy.z, 1.0, (1.0 - yxy.y - yxy.z) / yxy.z) * yxy.x;
    let rgb_from_xyz = mat3x3f(
        vec3f(3.2406, -0.9689, 0.0557),
        vec3f(-1.5372, 1.8758, -0.2040),
        vec3f(-0.4986, 0.0415, 1.0570),
    );
    let rgb = max(rgb_from_xyz * xyz, vec3f(0.0));
    let daylight = vec3f(rgb.r, max(rgb.g, 0.5 * (rgb.r + rgb.b)), rgb.b);
    let luminance = vec3f(0.2126, 0.7152, 0.0722);
    return daylight * (dot(rgb, luminance) / max(dot(daylight, luminance), 1e-9));
}

// Light of the horizon below `direction`: what the air itself sends to the eye. The cosines of the
// series' angles come from one another (Chebyshev).
fn horizon_radiance(direction: vec3f) -> vec3f {
    let flat_sun = light.to_sun.xz / max(length(light.to_sun.xz), 1e-4);
    let flat_direction = direction.xz / max(length(direction.xz), 1e-4);
    let c = clamp(dot(flat_sun, flat_direction), -1.0, 1.0);
    var before = 1.0;
    var now = c;
    var sum = light.haze[0].xyz;
    for (var order = 1u; order < HAZE_TERMS; order++) {
        sum += light.haze[order].xyz * now;
        let next = 2.0 * c * now - before;
        before = now;
        now = next;
    }
    return max(sum, vec3f(0.0));
}

// What the air between the eye and a point `distance_m` away does to the point's light. `direction`: from
// the eye to the point.
fn with_haze(colour: vec3f, direction: vec3f, distance_m: f32) -> vec3f {
    return mix(horizon_radiance(direction), colour, exp(-distance_m * (1.0 / 420.0)));
}

// What a white matt surface of normal `n` shows of the sky.
fn sky_fill(n: vec3f) -> vec3f {
    return max(light.fill[0].xyz + light.fill[1].xyz * n.x + light.fill[2].xyz * n.y + light.fill[3].xyz * n.z, vec3f(0.0));
}

// How much of the sun passes the clouds above `p`, 0.3 to 1.
fn sunlight(p: vec2f) -> f32 {
    let drift = p * (1.0 / 19.0) + vec2f(0.03, 0.01) * frame.time_s + vec2f(0.35, 0.6);
    return mix(0.38, 1.0, smoothstep(-0.42, 0.04, perlin(drift) + 0.25 * perlin(drift * 3.1)));
}

// Light as the scene's target stores it: within 0..1, so that one bright sample of four does not outshine
// the others of its pixel. `passes/tone` undoes it after they are averaged.
// Source: Karis, "Tone mapping", 2013.
fn stored(colour: vec3f) -> vec4f {
    return vec4f(colour / (1.0 + max(colour.r, max(colour.g, colour.b))), 1.0);
}
