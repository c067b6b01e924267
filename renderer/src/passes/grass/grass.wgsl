// Two vertices a knot: expands the knots of a blade into a ribbon. One instance is one blade that `passes/cull`
// let through, at its level of detail; of the last level, one triangle. `light.wgsl`, which has the `Ribbon`,
// follows and lights it.
// Reads the level's list, the instances, the shapes of this library and the one before, and simulated knots.
// Source: Fan & Sheng §4.5.

struct ShapeKnot {
    position: vec3f,
    along: f32,
    across: vec3f,
    half_width_left: f32,
    tangent: vec3f,
    half_width_right: f32,
    coarse_row: u32,
    coarse_between: f32,
    finest_row: u32,
    reach_m: f32,
}

// A knot of a simulated blade, without wind: metres from the blade's root, along the world's axes.
struct SimulatedKnot {
    position: vec3f,
    _pad_0: u32,
}

@group(1) @binding(0) var<storage, read> lists: array<u32>;
@group(1) @binding(1) var<storage, read> instances: array<Instance>;
@group(1) @binding(2) var<storage, read> knots: array<ShapeKnot>;
@group(1) @binding(3) var<storage, read> old_knots: array<ShapeKnot>;
@group(1) @binding(4) var<storage, read> simulated_knots: array<SimulatedKnot>;

const TAU = 6.2831853;
// Whose colour the root of the coarsest level has, as a part of the blade.
const COARSE_ROOT = 0.4;
// No blade sends more stored light than this.
const BRIGHTEST = 0.9;

// A unit vector along `v`, `otherwise` where it has no direction.
fn along_or(v: vec3f, otherwise: vec3f) -> vec3f {
    let size = length(v);
    return select(otherwise, v / max(size, 1e-20), size > 1e-9);
}

fn shape_knot(at: u32, is_old: bool) -> ShapeKnot {
    if is_old {
        return old_knots[at];
    }
    return knots[at];
}

// Vertex `index` of the blade that is `at` in its level's list.
fn expand(index: u32, at: u32) -> Ribbon {
    let blade = instances[lists[at]];
    let packed = blade.shape_turn_scale_mirror;
    let turn = f32(packed >> 12u & 0xFFFu) * (TAU / 4096.0);
    let mirror = select(1.0, -1.0, packed >> 31u == 1u);
    let is_old = blade.first_knot >> 31u == 1u;
    let first_knot = blade.first_knot & 0x7FFFFFFFu;

    // The base vertex of the draw tells the level: 64 vertices are set apart for each.
    let level = index >> 6u;
    let row = (index & 63u) >> 1u;
    let right = (index & 1u) == 1u;
    var knot = shape_knot(first_knot + row, is_old);
    let along = knot.along;
    let finest_row = knot.finest_row;
    if blade.morph > 0.0 {
        let coarse = first_knot + LEVEL_KNOTS[level] + knot.coarse_row;
        let a = shape_knot(coarse, is_old);
        let b = shape_knot(coarse + 1u, is_old);
        let between = knot.coarse_between;
        knot.position = mix(knot.position, mix(a.position, b.position, between), blade.morph);
        knot.across = mix(knot.across, mix(a.across, b.across, between), blade.morph);
        knot.tangent = mix(knot.tangent, mix(a.tangent, b.tangent, between), blade.morph);
        knot.half_width_left =
            mix(knot.half_width_left, mix(a.half_width_left, b.half_width_left, between), blade.morph);
        knot.half_width_right =
            mix(knot.half_width_right, mix(a.half_width_right, b.half_width_right, between), blade.morph);
    }

    let flip = vec3f(mirror, 1.0, 1.0);
    let c = cos(turn);
    let s = sin(turn);
    let turned = mat3x3f(vec3f(c, 0.0, -s), vec3f(0.0, 1.0, 0.0), vec3f(s, 0.0, c));
    let lean_heading = f32(blade.lean_hue & 0xFFFu) * (TAU / 4096.0);
    let lean_rad = f32(blade.lean_hue >> 12u & 0xFFu) * (0.5 / 256.0);
    let own_lean = vec2f(cos(lean_heading), sin(lean_heading)) * lean_rad;
    var midrib = lean(turned * (knot.position * flip) * blade.scale, own_lean);
    var across = lean(turned * (knot.across * flip), own_lean);
    var tangent = lean(turned * (knot.tangent * flip), own_lean);
    if blade.simulated >= 0 {
        // Its own lean is in its knots already.
        let first = u32(blade.simulated);
        midrib = simulated_knots[first + finest_row].position;
        let last = LEVEL_KNOTS[0] - 1u;
        tangent = simulated_knots[first + min(finest_row + 1u, last)].position
            - simulated_knots[first + max(finest_row, 1u) - 1u].position;
    }
    let turn_rad = 2.0 * along * blade.bend_rad;
    midrib = bent(midrib, tangent, along, blade.bend_rad);
    across = along_or(lean(across, turn_rad), vec3f(1.0, 0.0, 0.0));
    tangent = along_or(lean(tangent, turn_rad), vec3f(0.0, 1.0, 0.0));

    let midrib_in_world = blade.root_in_world + midrib;
    let eye_distance = distance(midrib_in_world, frame.eye_in_world);
    // Never thinner than most of a pixel, else distant blades break up into dots.
    let thinnest = select(0.0, 0.4 * frame.pixel_rad * eye_distance * (1.0 - along * along), blade.stands_for > 0.0);
    let left_width = max(knot.half_width_left * blade.widen, thinnest);
    let right_width = max(knot.half_width_right * blade.widen, thinnest);
    let offset = select(-left_width, right_width, right);
    // A blade seen on its edge turns a little towards the eye, or it would flicker as a dotted line.
    let normal = along_or(cross(tangent, across), vec3f(0.0, 0.0, 1.0));
    let to_eye = (frame.eye_in_world - midrib_in_world) / eye_distance;
    let on_edge = saturate(1.0 - abs(dot(normal, to_eye)));
    let broadside = cross(to_eye, tangent);
    let on_edge_3 = on_edge * on_edge * on_edge;
    let turned_across = broadside * (sign(dot(broadside, across)) * 0.45 * on_edge_3 * on_edge_3);
    let in_world = midrib_in_world + (across + turned_across) * offset;

    let hue = f32(blade.lean_hue >> 20u) * (1.0 / 4095.0);
    // Most of a triangle is near its root, most of a blade is not: the root has the colour of higher up.
    let to_coarsest = select(select(0.0, blade.morph, level == LEVELS - 2u), 1.0, level == LEVELS - 1u);
    let colour_along = mix(along, mix(COARSE_ROOT, 1.0, along), to_coarsest);
    // A blade that stands for some more is less unlike its neighbours, as their mean would be.
    let alike = inverseSqrt(max(blade.stands_for, 1.0));
    let own = leaf_of(colour_along, blade.lush, hue, blade.salt);
    let mean = mean_leaf(colour_along, blade.lush);

    var ribbon: Ribbon;
    ribbon.position = frame.clip_from_world * vec4f(in_world, 1.0);
    ribbon.in_world = in_world;
    ribbon.normal = normal;
    ribbon.across = across;
    ribbon.side_and_height = vec2f(select(-1.0, 1.0, right), max(in_world.y - blade.root_in_world.y, 0.0));
    ribbon.albedo = mix(mean.albedo, own.albedo, alike);
    ribbon.through_gloss_sun = vec3f(mix(mean.through, own.through, alike), mix(mean.gloss, own.gloss, alike), blade.sunlight);
    return ribbon;
}

@vertex
fn vs_main(@builtin(vertex_index) index: u32, @builtin(instance_index) at: u32) -> Ribbon {
    return expand(index, at);
}

// Steps of the map of shadows from its middle to its side in which vertices lie.
override SUN_STEPS: f32 = 8192.0;

// As the sun sees it. Drivers place vertices in steps of their own, a sixteenth of a texel at the coarsest, and
// would not agree on the texels that a thin blade covers.
@vertex
fn vs_sun(@builtin(vertex_index) index: u32, @builtin(instance_index) at: u32) -> @builtin(position) vec4f {
    let position = expand(index, at).position;
    return vec4f(round(position.xy * SUN_STEPS) / SUN_STEPS, position.zw);
}

// A blade that is small in the picture is lit at its vertices: what varies between them could not be seen.
struct Lit {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(perspective, centroid) colour: vec4f,
}

@vertex
fn vs_lit(@builtin(vertex_index) index: u32, @builtin(instance_index) at: u32) -> Lit {
    var ribbon = expand(index, at);
    // Halfway between rib and edge.
    ribbon.side_and_height.x *= 0.5;
    return Lit(ribbon.position, light_of(ribbon, 0.0));
}

@fragment
fn fs_lit(lit: Lit) -> @location(0) vec4f {
    // Of a sliver, the sample may lie beyond the vertices that were lit.
    return clamp(lit.colour, vec4f(0.0), vec4f(vec3f(BRIGHTEST), 1.0));
}
