// Wind and what it does to a blade. Twin: scene/wind.rs, where the laws and their sources are.

@group(0) @binding(2) var<storage, read> wind_field: array<vec2f>;

fn wind_at(at: vec2f) -> vec2f {
    let texel = (at - floor(at)) * f32(WIND_SIDE);
    let lower = floor(texel);
    let f = texel - lower;
    let x = vec2u(u32(lower.x), u32(lower.x) + 1u) % WIND_SIDE;
    let z = vec2u(u32(lower.y), u32(lower.y) + 1u) % WIND_SIDE * WIND_SIDE;
    return mix(
        mix(wind_field[z.x + x.x], wind_field[z.x + x.y], f.x),
        mix(wind_field[z.y + x.x], wind_field[z.y + x.y], f.x),
        f.y,
    );
}

fn bend_rad(root: vec2f, time_s: f32) -> vec2f {
    let across = vec2f(-WIND_DIRECTION.y, WIND_DIRECTION.x);
    let gust = wind_at((root - WIND_DIRECTION * (GUST_M_PER_S * time_s)) * (1.0 / GUST_FIELD_M));
    let turned = vec2f(0.6 * root.x + 0.8 * root.y, 0.6 * root.y - 0.8 * root.x);
    let flutter = wind_at((turned - WIND_DIRECTION * (FLUTTER_M_PER_S * time_s)) * (1.0 / FLUTTER_FIELD_M));
    let wind = 1.0 + 0.9 * gust.x;
    return WIND_DIRECTION * (0.10 * wind * wind + 0.05 * flutter.x) + across * (0.09 * gust.y + 0.06 * flutter.y);
}

// Turns `v` by `angle` (radians, as a vector in x and z) from upright towards that direction.
fn lean(v: vec3f, angle: vec2f) -> vec3f {
    let size = length(angle);
    if size < 1e-5 {
        return v;
    }
    let axis = vec3f(angle.y, 0.0, -angle.x) / size;
    let c = cos(size);
    return v * c + cross(axis, v) * sin(size) + axis * (dot(axis, v) * (1.0 - c));
}

// Where a point of a blade goes in the wind, so that the blade keeps its length; its tangent leans by
// twice `along * bend`.
fn bent(point: vec3f, tangent: vec3f, along: f32, bend: vec2f) -> vec3f {
    let angle = bend * along;
    let size = length(angle);
    if size < 1e-5 {
        return point;
    }
    let axis = vec3f(angle.y, 0.0, -angle.x) / size;
    let reach = max(length(point) * length(tangent), 1e-12);
    let more = dot(axis, cross(point, tangent)) / reach;
    return lean(point, angle) * (sin(size) / size * (1.0 - size * more / 3.0));
}
