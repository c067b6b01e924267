// What a leaf of grass looks like: its colour, and the light that it sends to the eye. The grass asks for
// each sample of a ribbon; the ground far away asks for a few leaves that stand for all.
// Sources: reflectance and transmittance of grass leaves are of one size, both matt, with gloss on the
// reflecting side alone: Bousquet et al. 2005; extinction within a stand: Monsi and Saeki 1953.

struct Leaf {
    albedo: vec3f,
    // How much of the light comes through, over what comes back; how glossy it is.
    through: f32,
    gloss: f32,
}

const OLIVE = vec3f(0.090, 0.098, 0.034);
const FRESH = vec3f(0.047, 0.074, 0.019);
const TIP = vec3f(0.120, 0.118, 0.044);
const SHEATH = vec3f(0.062, 0.064, 0.028);
const STRAW = vec3f(0.330, 0.262, 0.150);
const BROWN = vec3f(0.120, 0.080, 0.046);

// `along`: 0 at the root to 1 at the tip; `lush`: 0 dry and poor to 1; `hue`: the blade's own, 0 bluish to
// 1 yellowish; `salt`: its random bits.
fn leaf_of(along: f32, lush: f32, hue: f32, salt: u32) -> Leaf {
    let green = mix(OLIVE, FRESH, saturate(lush * 1.15));
    let own = green * mix(vec3f(0.76, 0.89, 1.00), vec3f(1.34, 1.14, 0.88), hue) * (0.80 + 0.4 * f32(salt >> 24u) * (1.0 / 255.0));
    let tipped = mix(own, TIP, 0.55 * smoothstep(0.35, 1.0, along) * (1.0 - 0.6 * lush));
    let fresh = mix(SHEATH, tipped, smoothstep(0.0, 0.35, along));

    // Old leaves: straw that still stands, and brown that was here last year; fewer where it is lush.
    let age = f32(salt & 0xFFFFu) * (1.0 / 65535.0);
    let old = smoothstep(0.80 + 0.12 * lush, 0.90 + 0.10 * lush, age);
    let rotten = f32(salt >> 16u & 0xFFu) * (1.0 / 255.0);
    let dead = mix(STRAW, BROWN, smoothstep(0.45, 0.75, rotten)) * mix(0.6, 1.0, along);
    // Of others only the tip has dried.
    let tip_from = mix(1.15, 0.55, rotten);
    let dry_tip = smoothstep(tip_from, tip_from + 0.22, along) * smoothstep(0.35, 0.6, age);
    let dry = max(old, 0.85 * dry_tip);

    var leaf: Leaf;
    leaf.albedo = mix(fresh, dead, dry);
    leaf.through = mix(1.15, 0.45, dry);
    leaf.gloss = 1.0 - 0.8 * dry;
    return leaf;
}

// The leaf that stands for all at a place: the mean of `leaf_of` over blades.
fn mean_leaf(along: f32, lush: f32) -> Leaf {
    let old = 0.15 - 0.11 * lush;
    let green = mix(OLIVE, FRESH, saturate(lush * 1.15)) * vec3f(1.02, 1.0, 0.965);
    let fresh = mix(green, TIP, 0.55 * smoothstep(0.35, 1.0, along) * (1.0 - 0.6 * lush));
    let dry = old + 0.10 * smoothstep(0.7, 1.0, along);
    var leaf: Leaf;
    leaf.albedo = mix(fresh, mix(STRAW, BROWN, 0.42), dry);
    leaf.through = mix(1.15, 0.45, dry);
    leaf.gloss = 1.0 - 0.8 * dry;
    return leaf;
}

// How much of the sun reaches `depth_m` below the meadow's roof, on the average.
fn sun_below(depth_m: f32) -> f32 {
    return exp(-depth_m * 3.4 * min(sqrt(1.0 + light.shadow_slope * light.shadow_slope), 7.0));
}

// How much of the sky is seen from `depth_m` below the meadow's roof.
fn sky_below(depth_m: f32) -> f32 {
    return mix(0.10, 1.0, exp(-depth_m * 11.0));
}

// Light of a leaf towards the eye. `facing`: its face's normal, to the eye; `n`: the same, rounded;
// `sun_share`: how much sun gets here; `distance_m` from the eye, with which gloss grows broad.
fn lit_leaf(leaf: Leaf, facing: vec3f, n: vec3f, to_eye: vec3f, depth_m: f32, sun_share: f32, cloud: f32, distance_m: f32) -> vec3f {
    let open = sky_below(depth_m);
    let n_dot_l = dot(n, light.to_sun);
    // Light that has gone through is yellower: the leaf takes blue and red on the way.
    let transmitted = leaf.albedo * vec3f(0.98, 1.10, 0.52) * leaf.through;
    let matt = leaf.albedo * max(n_dot_l, 0.0) + transmitted * max(-n_dot_l, 0.0);
    // What comes through is scattered forwards rather than evenly.
    let ahead = max(-dot(to_eye, light.to_sun), 0.0);
    let glow = transmitted * (0.45 * ahead * ahead * ahead);

    let half_way = normalize(to_eye + light.to_sun + vec3f(0.0, 1e-4, 0.0));
    let fresnel = 0.035 + 0.965 * pow(1.0 - saturate(dot(to_eye, half_way)), 5.0);
    // Far away a highlight is smaller than a pixel: many leaves' highlights together are a broad sheen.
    // One on a leaf that is seen on its edge would only sparkle.
    let power = mix(34.0, 5.0, saturate(distance_m * 0.10));
    let broad = saturate(abs(dot(facing, to_eye)) * 3.0);
    let gloss = leaf.gloss * broad * fresnel * (power + 2.0) * 0.125 * pow(saturate(dot(n, half_way)), power) * saturate(n_dot_l * 4.0);

    let sun = light.sun * (sun_share * cloud);
    let sky = sky_fill(n) * open;
    // Neighbours give back some of what they got, in their colour, the deeper the more of all there is.
    let roof = light.sun * (cloud * light.to_sun.y) + sky_fill(vec3f(0.0, 1.0, 0.0));
    let neighbours = vec3f(0.050, 0.066, 0.020) * roof * (0.30 * (1.0 - 0.75 * open));
    let sheen = sky_fill(vec3f(0.0, 1.0, 0.0)) * (0.35 * open * leaf.gloss * (0.03 + 0.97 * pow(1.0 - saturate(dot(facing, to_eye)), 5.0)) * broad);
    return sun * (matt + glow + vec3f(gloss)) + (leaf.albedo + 0.35 * transmitted) * (sky + neighbours) + sheen;
}
