// Two vertices a row, some rows a blade: expands the knots of the library, as they stand there,
// into a ribbon. One instance is one blade that `passes/cull` let through. `light.wgsl`, which has the
// `Ribbon`, follows and lights it.
// Reads the patch, the shape table, the shapes and the knots. Source: Fan & Sheng §4.5.

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

const TAU = 6.2831853;

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
    let leaning = vec2f(cos(lean_heading), sin(lean_heading)) * lean_rad;
    let turn_rad = 2.0 * along * vertex.bend_rad;
    tangent = lean(turned * tangent, leaning);
    midrib = bent(lean(turned * midrib, leaning), tangent, along, vertex.bend_rad);
    across = normalize(lean(lean(turned * across, leaning), turn_rad));
    tangent = lean(tangent, turn_rad);

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
    let leaf = leaf_of(along, lush, hue, blade.salt);

    var ribbon: Ribbon;
    ribbon.position = frame.clip_from_world * vec4f(in_world, 1.0);
    ribbon.in_world = in_world;
    ribbon.normal = normal;
    ribbon.across = across;
    ribbon.side_and_height = vec2f(select(-1.0, 1.0, right), max(in_world.y - vertex.root_in_world.y, 0.0));
    ribbon.albedo = leaf.albedo;
    ribbon.through_gloss_sun = vec3f(leaf.through, leaf.gloss, sunlight(vertex.root_in_world.xz));
    return ribbon;
}
