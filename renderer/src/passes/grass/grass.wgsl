// Two vertices a row, some rows a blade: expands the knots of the library, as they stand there,
// into a ribbon, and lights it. One instance is one blade that `passes/cull` let through.
// Reads the patch, the shape table, the shapes and the knots.
// Source: Fan & Sheng §4.5; light through the blade: Crysis (Sousa, GPU Gems 3 ch. 16).

struct PatchBlade {
    root: u32,
    shape_turn_scale_mirror: u32,
    lean_hue: u32,
    salt: u32,
}

struct Shape {
    first_knot: u32,
    knot_count: u32,
}

struct Knot {
    position: vec3f,
    half_width_left: f32,
    across: vec3f,
    half_width_right: f32,
}

@group(1) @binding(0) var<storage, read> patch_blades: array<PatchBlade>;
@group(1) @binding(1) var<storage, read> shape_table: array<u32>;
@group(1) @binding(2) var<storage, read> shapes: array<Shape>;
@group(1) @binding(3) var<storage, read> knots: array<Knot>;

struct Vertex {
    @builtin(vertex_index) index: u32,
    @location(0) root_in_world: vec3f,
    @location(1) blade_and_lushness: u32,
    @location(2) bend_rad: vec2f,
    @location(3) presence: f32,
    @location(4) widen: f32,
}

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

const TAU = 6.2831853;

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

fn blade_albedo(along: f32, lush: f32, hue: f32, dry: f32) -> vec3f {
    let base = vec3f(0.020, 0.045, 0.009);
    let middle = mix(vec3f(0.090, 0.128, 0.032), vec3f(0.034, 0.088, 0.020), lush);
    let tip = mix(vec3f(0.190, 0.195, 0.070), vec3f(0.085, 0.148, 0.036), lush);
    let green = mix(mix(base, middle, smoothstep(0.0, 0.45, along)), tip, smoothstep(0.35, 1.0, along));
    let varied = green * mix(vec3f(0.62, 0.80, 0.95), vec3f(1.35, 1.12, 0.90), hue);
    let straw = vec3f(0.36, 0.27, 0.125) * mix(0.55, 1.0, along);
    return mix(varied, straw, dry);
}

@vertex
fn vs_main(vertex: Vertex) -> Ribbon {
    let blade = patch_blades[vertex.blade_and_lushness & 0xFFFFu];
    let lush = f32(vertex.blade_and_lushness >> 16u) * (1.0 / 255.0);
    let packed = blade.shape_turn_scale_mirror;
    let shape = shapes[shape_table[packed & 0xFFFu]];
    let turn = f32(packed >> 12u & 0xFFFu) * (TAU / 4096.0);
    let size = mix(SCALE_MIN, SCALE_MAX, f32(packed >> 24u & 0x7Fu) * (1.0 / 127.0));
    let mirror = select(1.0, -1.0, packed >> 31u == 1u);

    // The base vertex of the draw tells the level: 64 vertices are set apart for each.
    let rows = LEVEL_ROWS[vertex.index >> 6u];
    let row = (vertex.index & 63u) >> 1u;
    let right = (vertex.index & 1u) == 1u;
    let along = f32(row) / f32(rows - 1u);
    let at = along * f32(shape.knot_count - 1u);
    let lower = min(u32(at), shape.knot_count - 2u);
    let a = knots[shape.first_knot + lower];
    let b = knots[shape.first_knot + lower + 1u];
    let between = at - f32(lower);

    // A blade that comes or goes grows or sinks, and does not pop.
    let scale = size * mix(0.62, 1.08, lush) * vertex.presence;
    let flip = vec3f(mirror, 1.0, 1.0);
    var midrib = mix(a.position, b.position, between) * flip * scale;
    var across = mix(a.across, b.across, between) * flip;
    var tangent = (b.position - a.position) * flip;

    let c = cos(turn);
    let s = sin(turn);
    let turned = mat3x3f(vec3f(c, 0.0, -s), vec3f(0.0, 1.0, 0.0), vec3f(s, 0.0, c));
    let lean_heading = f32(blade.lean_hue & 0xFFFu) * (TAU / 4096.0);
    let lean_rad = f32(blade.lean_hue >> 12u & 0xFFu) * (0.5 / 256.0);
    let angle = vec2f(cos(lean_heading), sin(lean_heading)) * lean_rad + vertex.bend_rad * along;
    midrib = lean(turned * midrib, angle);
    across = normalize(lean(turned * across, angle));
    tangent = lean(turned * tangent, angle);

    let midrib_in_world = vertex.root_in_world + midrib;
    let eye_distance = distance(midrib_in_world, frame.eye_in_world);
    // Never thinner than most of a pixel, else distant blades break up into dots.
    let thinnest = 0.4 * frame.pixel_rad * eye_distance * (1.0 - along * along);
    let widen = size * vertex.widen * sqrt(vertex.presence);
    let left_width = max(mix(a.half_width_left, b.half_width_left, between) * widen, thinnest);
    let right_width = max(mix(a.half_width_right, b.half_width_right, between) * widen, thinnest);
    let offset = select(-left_width, right_width, right);
    // A blade seen on its edge turns a little towards the eye, or it would flicker as a dotted line.
    let normal = normalize(cross(tangent, across));
    let to_eye = (frame.eye_in_world - midrib_in_world) / eye_distance;
    let on_edge = 1.0 - abs(dot(normal, to_eye));
    let broadside = cross(to_eye, normalize(tangent));
    let turned_across = broadside * (sign(dot(broadside, across)) * 0.45 * pow(on_edge, 6.0));
    let in_world = midrib_in_world + (across + turned_across) * offset;

    let hue = f32(blade.lean_hue >> 20u) * (1.0 / 4095.0);
    let dry_chance = f32(blade.salt & 0xFFFFu) * (1.0 / 65535.0);
    let dry = smoothstep(0.91 + 0.06 * lush, 1.0, dry_chance);
    let dry_tip = 0.8 * smoothstep(0.75, 1.0, along) * smoothstep(0.55, 0.8, dry_chance);

    var ribbon: Ribbon;
    ribbon.position = frame.clip_from_world * vec4f(in_world, 1.0);
    ribbon.in_world = in_world;
    ribbon.normal = normal;
    ribbon.across = across;
    ribbon.side_and_height = vec2f(select(-1.0, 1.0, right), max(in_world.y - vertex.root_in_world.y, 0.0));
    ribbon.albedo = blade_albedo(along, lush, hue, max(dry, dry_tip));
    let sun = sunlight(vertex.root_in_world.xz);
    ribbon.through_gloss_sun = vec3f(1.0 - 0.6 * max(dry, dry_tip), 1.0 - 0.8 * dry, sun);
    return ribbon;
}

@fragment
fn fs_main(ribbon: Ribbon) -> @location(0) vec4f {
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
