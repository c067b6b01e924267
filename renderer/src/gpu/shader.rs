//! Shader sources: each pass's WGSL behind the constants that Rust knows and what all passes share.

use std::fmt::Write;

use super::Gpu;
use crate::passes::{cull, ground};
use crate::scene::grassland::{self, field, mix, shapes};
use crate::scene::wind;

/// The shaders of the scene, by pass; each is completed by [`compose`].
pub const SCENE: [(&str, &str); 6] = [
    (
        "cull.tiles",
        concat!(include_str!("../passes/cull/survey.wgsl"), include_str!("../passes/cull/tiles.wgsl")),
    ),
    (
        "cull.blades",
        concat!(include_str!("../passes/cull/survey.wgsl"), include_str!("../passes/cull/blades.wgsl")),
    ),
    (
        "cull.args",
        concat!(include_str!("../passes/cull/survey.wgsl"), include_str!("../passes/cull/args.wgsl")),
    ),
    (
        "grass",
        concat!(include_str!("../passes/grass/grass.wgsl"), include_str!("../passes/grass/light.wgsl")),
    ),
    ("ground", include_str!("../passes/ground/ground.wgsl")),
    ("sky", include_str!("../passes/sky/sky.wgsl")),
];

/// The tone curve's shader, which stands alone.
pub const TONE: &str = include_str!("../passes/tone/tone.wgsl");

/// The whole source of a scene shader: constants from Rust, `common.wgsl`, then `source`.
pub fn compose(source: &str) -> String {
    let mut whole = constants();
    whole.push_str(include_str!("../passes/common.wgsl"));
    whole.push_str(source);
    whole
}

/// The module of the scene pass of this name in [`SCENE`].
pub(crate) fn scene_module(gpu: &Gpu, pass: &str) -> wgpu::ShaderModule {
    let (_, source) = SCENE.into_iter().find(|(name, _)| *name == pass).expect("every pass is listed");
    gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(pass),
        source: wgpu::ShaderSource::Wgsl(compose(source).into()),
    })
}

fn constants() -> String {
    let mut text = String::new();
    let mut define = |name: &str, value: String| {
        writeln!(text, "const {name} = {value};").expect("writing to a string cannot fail");
    };
    let array =
        |kind: &str, values: Vec<String>| format!("array<{kind}, {}>({})", values.len(), values.join(", "));
    let unsigned = |value: u32| format!("{value}u");
    let float = |value: f32| format!("{value:?}f");
    define("PATCH_BLADES", unsigned(grassland::PATCH_BLADES));
    define("TILE_BLADES", unsigned(grassland::TILE_BLADES));
    define("GRID_SIDE", unsigned(grassland::GRID_SIDE));
    define("TILE_M", float(grassland::TILE_M));
    define("SCALE_MIN", float(grassland::SCALE.0));
    define("SCALE_MAX", float(grassland::SCALE.1));
    define("WIND_DIRECTION", format!("vec2f({}, {})", float(wind::DIRECTION.x), float(wind::DIRECTION.y)));
    define("WIND_SPEED_M_PER_S", float(wind::SPEED_M_PER_S));
    define("RANGE_M", float(cull::RANGE_M));
    define("FADE_FROM", float(cull::FADE_FROM));
    define("MAX_WIDEN", float(cull::MAX_WIDEN));
    define("CANOPY_M", float(cull::CANOPY_M));
    define("SIZE_BY_RANK", float(cull::SIZE_BY_RANK));
    define("KEPT_AREA", float(cull::KEPT_AREA));
    define("MORPH_FROM", float(cull::MORPH_FROM));
    define("LUSH_SCALE_MIN", float(cull::LUSH_SCALE.0));
    define("LUSH_SCALE_MAX", float(cull::LUSH_SCALE.1));
    define("TILE_RADIUS_M", float(cull::TILE_RADIUS_M));
    define("BLOCK_SIDE", format!("{}i", field::BLOCK_SIDE));
    define("CHUNK_BLADES", unsigned(cull::CHUNK_BLADES));
    define("CHUNK_CAPACITY", unsigned(cull::CHUNK_CAPACITY));
    define("VERTICES_A_LEVEL", unsigned(cull::VERTICES_A_LEVEL));
    define("NO_SHAPE", unsigned(cull::NO_SHAPE));
    define("CLUMP_M", float(mix::CLUMP_M));
    define("CLUMP_FRAY", float(mix::CLUMP_FRAY));
    define("LONERS", unsigned(mix::LONERS));
    define("LEVELS", unsigned(shapes::LEVELS as u32));
    define("SHAPE_KNOTS", unsigned(shapes::SHAPE_KNOTS));
    define("LEVEL_PX", array("f32", cull::LEVEL_PX.map(float).to_vec()));
    define("LEVEL_KNOTS", array("u32", shapes::LEVEL_KNOTS.map(unsigned).to_vec()));
    define("LEVEL_INDICES", array("u32", cull::level_indices().map(unsigned).to_vec()));
    let first_knots = (0..shapes::LEVELS).map(|level| unsigned(shapes::first_knot(level)));
    define("LEVEL_FIRST_KNOT", array("u32", first_knots.collect()));
    define("GROUND_RANGE_M", float(ground::RANGE_M));
    define("GROUND_RINGS", unsigned(ground::RINGS));
    define("GROUND_SECTORS", unsigned(ground::SECTORS));
    text
}
