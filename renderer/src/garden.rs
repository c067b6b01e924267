//! A meadow and the device that it grows on, which outlives the device: when that is lost, another one is
//! opened and the same library planted again. Shaders can be replaced while it stands.

use common::library::Snapshot;

use crate::frame::{Meadow, View};
use crate::gpu::Gpu;
use crate::gpu::device::{self, OpenError};
use crate::gpu::shader::Sources;
use crate::gpu::targets::Targets;
use crate::nursery::Seedling;
use crate::passes::cull::Detail;
use crate::scene::grassland::field::Field;
use crate::scene::grassland::shapes::shapes;

/// The meadow on its device.
#[derive(Debug)]
pub struct Garden {
    /// The device.
    pub gpu: Gpu,
    meadow: Meadow,
    format: wgpu::TextureFormat,
    field: Field,
    detail: Detail,
    seedling: Option<Seedling>,
    shadows: bool,
}

/// Why shaders are not used.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct ShaderError(String);

/// Why the meadow cannot go on with another device.
#[derive(Debug, thiserror::Error)]
pub enum MoveError {
    /// There is none.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// It refuses the shaders.
    #[error("the new device refuses a shader: {0}")]
    Shader(#[from] ShaderError),
}

impl Garden {
    /// A bare meadow on `gpu` for pictures of `format`.
    pub fn new(gpu: Gpu, format: wgpu::TextureFormat) -> Self {
        let meadow = Meadow::new(&gpu, format);
        Self {
            gpu,
            meadow,
            format,
            field: Field::ENDLESS,
            detail: Detail::default(),
            seedling: None,
            shadows: true,
        }
    }

    /// Where grass grows, and how much of it is drawn, from the next frame on.
    pub fn lay_out(&mut self, field: Field, detail: Detail) {
        (self.field, self.detail) = (field, detail);
        self.meadow.lay_out(field);
        self.meadow.set_detail(&self.gpu, detail);
    }

    /// Lets this library grow from the next frame on, at once and whole.
    pub fn plant<B: AsRef<[u8]>>(&mut self, library: &Snapshot<B>) {
        self.seedling = Some(Seedling { generation: library.generation(), shapes: shapes(library) });
        self.replant();
    }

    /// Lets what the nursery made ready take the place of what grows, as [`Garden::pass_time`] goes on.
    pub fn grow(&mut self, seedling: Seedling) {
        self.meadow.grow(&self.gpu, seedling.shapes.as_ref());
        self.seedling = Some(seedling);
    }

    /// Whether a library is still taking the place of another.
    pub fn is_growing(&self) -> bool {
        self.meadow.is_growing()
    }

    /// Lets `seconds` pass for what grows.
    pub fn pass_time(&mut self, seconds: f32) {
        self.meadow.pass_time(seconds);
    }

    /// Whether blades near the eye throw shadows, which costs about as much again as drawing them.
    pub fn set_shadows(&mut self, thrown: bool) {
        self.shadows = thrown;
        self.meadow.set_shadows(thrown);
    }

    /// Generation of the library that grows; 0 while the meadow is bare.
    pub fn generation(&self) -> u64 {
        self.seedling.as_ref().map_or(0, |seedling| seedling.generation)
    }

    /// Draws one frame to `display`, a view of the size of `targets`.
    pub fn draw(&self, targets: &Targets, view: &View, display: &wgpu::TextureView) {
        self.meadow.draw(&self.gpu, targets, view, display);
    }

    /// Goes on with another device, which was opened because this one was lost: the same library grows, with
    /// the same shaders, in pictures of `format`. All that was made on the old device is void.
    ///
    /// # Errors
    /// When the shaders are refused by the new device.
    pub fn move_to(&mut self, gpu: Gpu, format: wgpu::TextureFormat) -> Result<(), ShaderError> {
        let gpu = gpu.with_shaders(self.gpu.shaders.clone());
        let meadow = build(&gpu, format)?;
        (self.gpu, self.meadow, self.format) = (gpu, meadow, format);
        self.replant();
        Ok(())
    }

    /// Opens another device, without a window, and goes on there.
    ///
    /// # Errors
    /// When there is no device, or it refuses the shaders.
    pub fn reopen(&mut self) -> Result<(), MoveError> {
        let gpu = Gpu::open(&device::instance(), None)?;
        Ok(self.move_to(gpu, self.format)?)
    }

    /// Draws with these shaders from the next frame on; if the device refuses one of them, with those that it
    /// had.
    ///
    /// # Errors
    /// What is wrong, with file's line and column, where they are refused.
    pub fn replace_shaders(&mut self, shaders: Sources) -> Result<(), ShaderError> {
        let before = std::mem::replace(&mut self.gpu.shaders, shaders);
        match build(&self.gpu, self.format) {
            Ok(meadow) => {
                self.meadow = meadow;
                self.replant();
                Ok(())
            }
            Err(error) => {
                self.gpu.shaders = before;
                Err(error)
            }
        }
    }

    fn replant(&mut self) {
        self.lay_out(self.field, self.detail);
        self.meadow.set_shadows(self.shadows);
        if let Some(seedling) = &self.seedling {
            self.meadow.grow(&self.gpu, seedling.shapes.as_ref());
            self.meadow.pass_time(f32::MAX);
        }
    }
}

/// A bare meadow, unless a shader is wrong.
fn build(gpu: &Gpu, format: wgpu::TextureFormat) -> Result<Meadow, ShaderError> {
    let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
    let meadow = Meadow::new(gpu, format);
    match device::ready(scope.pop()) {
        Some(error) => Err(ShaderError(error.to_string())),
        None => Ok(meadow),
    }
}
