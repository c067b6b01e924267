//! Shader sources: each pass's WGSL behind the constants that Rust knows and what all passes share.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use super::Gpu;
use crate::passes::{cull, ground};
use crate::scene::grassland::{self, field, mix, shapes};
use crate::scene::{light, sky, wind};

macro_rules! built_in {
    ($($path:literal),* $(,)?) => {
        [$(($path, include_str!(concat!("../passes/", $path)))),*]
    };
}

/// Every shader file, by its path under `src/passes`.
const FILES: &[(&str, &str)] = &built_in![
    "common.wgsl",
    "cull/args.wgsl",
    "cull/blades.wgsl",
    "cull/survey.wgsl",
    "cull/tiles.wgsl",
    "grass/grass.wgsl",
    "grass/light.wgsl",
    "ground/ground.wgsl",
    "instance.wgsl",
    "leaf.wgsl",
    "light.wgsl",
    "shadow/shadow.wgsl",
    "sky/sky.wgsl",
    "tone/tone.wgsl",
    "wind.wgsl",
];

/// The shaders by pass, and the files that each is put together from, in order.
pub const PASSES: [(&str, &[&str]); 7] = [
    ("cull.tiles", &["common.wgsl", "cull/survey.wgsl", "cull/tiles.wgsl"]),
    (
        "cull.blades",
        &["common.wgsl", "wind.wgsl", "light.wgsl", "instance.wgsl", "cull/survey.wgsl", "cull/blades.wgsl"],
    ),
    ("cull.args", &["common.wgsl", "cull/survey.wgsl", "cull/args.wgsl"]),
    (
        "grass",
        &[
            "common.wgsl",
            "wind.wgsl",
            "light.wgsl",
            "leaf.wgsl",
            "shadow/shadow.wgsl",
            "instance.wgsl",
            "grass/grass.wgsl",
            "grass/light.wgsl",
        ],
    ),
    (
        "ground",
        &["common.wgsl", "wind.wgsl", "light.wgsl", "leaf.wgsl", "shadow/shadow.wgsl", "ground/ground.wgsl"],
    ),
    ("sky", &["common.wgsl", "light.wgsl", "sky/sky.wgsl"]),
    ("tone", &["tone/tone.wgsl"]),
];

/// Why a folder of shaders cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("cannot read the shader {path}: {source}; expected a folder like renderer/src/passes")]
pub struct SourceError {
    path: PathBuf,
    source: std::io::Error,
}

/// The texts of the shaders: those built in, or newer ones from a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sources {
    files: BTreeMap<&'static str, Cow<'static, str>>,
}

impl Default for Sources {
    fn default() -> Self {
        Self { files: FILES.iter().map(|(path, text)| (*path, Cow::Borrowed(*text))).collect() }
    }
}

impl Sources {
    /// Reads them from a folder that is laid out as `renderer/src/passes`. A file that is not there is the
    /// one built in.
    ///
    /// # Errors
    /// When the folder is none, or a file in it is no text.
    pub fn read(folder: &Path) -> Result<Self, SourceError> {
        let failed = |path: PathBuf| move |source| SourceError { path, source };
        std::fs::read_dir(folder).map_err(failed(folder.into()))?;
        let mut sources = Self::default();
        for (name, text) in &mut sources.files {
            let path = folder.join(name);
            match std::fs::read_to_string(&path) {
                Ok(newer) => *text = Cow::Owned(newer),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
                Err(error) => return Err(failed(path)(error)),
            }
        }
        Ok(sources)
    }

    /// The whole source of a pass of [`PASSES`]: the constants from Rust, then its files.
    ///
    /// # Panics
    /// When there is no such pass.
    pub fn compose(&self, pass: &str) -> String {
        let (_, files) = PASSES.iter().find(|(name, _)| *name == pass).expect("every pass is listed");
        let mut whole = constants();
        for file in *files {
            whole.push_str(&self.files[file]);
        }
        whole
    }
}

/// The module of the pass of this name in [`PASSES`].
pub(crate) fn module(gpu: &Gpu, pass: &str) -> wgpu::ShaderModule {
    gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(pass),
        source: wgpu::ShaderSource::Wgsl(gpu.shaders.compose(pass).into()),
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
    define("WIND_SIDE", unsigned(wind::FIELD_SIDE));
    define("GUST_FIELD_M", float(wind::GUST_FIELD_M));
    define("GUST_M_PER_S", float(wind::GUST_M_PER_S));
    define("FLUTTER_FIELD_M", float(wind::FLUTTER_FIELD_M));
    define("FLUTTER_M_PER_S", float(wind::FLUTTER_M_PER_S));
    define("HAZE_TERMS", unsigned(light::HAZE_TERMS as u32));
    define("MIN_COS_ZENITH", float(sky::MIN_COS_ZENITH));
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
    define("FIELD_FRINGE_M", float(ground::FIELD_FRINGE_M));
    define("GROUND_RINGS", unsigned(ground::RINGS));
    define("GROUND_SECTORS", unsigned(ground::SECTORS));
    text
}
