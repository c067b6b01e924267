//! Shader sources: each pass's WGSL behind the constants that Rust knows and what all passes share.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use super::Gpu;
use crate::passes::{cull, ground};
use crate::scene::{grassland, light, sky, wind};

macro_rules! built_in {
    ($($path:literal),* $(,)?) => {
        [$(($path, include_str!(concat!("../passes/", $path)))),*]
    };
}

/// Every shader file, by its path under `src/passes`.
const FILES: &[(&str, &str)] = &built_in![
    "common.wgsl",
    "cull/cull.wgsl",
    "grass/grass.wgsl",
    "grass/light.wgsl",
    "ground/ground.wgsl",
    "leaf.wgsl",
    "light.wgsl",
    "shadow/shadow.wgsl",
    "sky/sky.wgsl",
    "tone/tone.wgsl",
    "wind.wgsl",
];

/// The shaders by pass, and the files that each is put together from, in order.
pub const PASSES: [(&str, &[&str]); 5] = [
    ("cull", &["common.wgsl", "wind.wgsl", "cull/cull.wgsl"]),
    (
        "grass",
        &[
            "common.wgsl",
            "wind.wgsl",
            "light.wgsl",
            "leaf.wgsl",
            "shadow/shadow.wgsl",
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
