//! Shader sources: each pass's WGSL behind the constants that Rust knows and what all passes share.

use std::fmt::Write;

use super::Gpu;
use crate::passes::{cull, ground};
use crate::scene::{grassland, wind};

/// The shaders of the scene, by pass; each is completed by [`compose`].
pub const SCENE: [(&str, &str); 4] = [
    ("cull", include_str!("../passes/cull/cull.wgsl")),
    ("grass", include_str!("../passes/grass/grass.wgsl")),
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
    define("FULL_DENSITY_M", float(cull::FULL_DENSITY_M));
    define("MAX_WIDEN", float(cull::MAX_WIDEN));
    define("CANOPY_M", float(cull::CANOPY_M));
    let levels = cull::LEVELS;
    let regions = cull::regions();
    define("LEVELS", unsigned(levels.len() as u32));
    define("LEVEL_UNTIL_M", array("f32", levels.iter().map(|level| float(level.until_m)).collect()));
    define("LEVEL_ROWS", array("u32", levels.iter().map(|level| unsigned(level.rows)).collect()));
    define("LEVEL_FIRST", array("u32", regions.iter().map(|region| unsigned(region.start)).collect()));
    define(
        "LEVEL_CAPACITY",
        array("u32", regions.iter().map(|region| unsigned(region.end - region.start)).collect()),
    );
    define("GROUND_RANGE_M", float(ground::RANGE_M));
    define("GROUND_RINGS", unsigned(ground::RINGS));
    define("GROUND_SECTORS", unsigned(ground::SECTORS));
    text
}
