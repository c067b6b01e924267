//! What the passes draw to: colour in scene light with four samples, depth, and the resolved colour.

use super::Gpu;

/// Format of scene light.
pub const COLOUR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
/// Format of depth; reversed, 1 is near.
pub const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Format of pictures. The shader encodes them as sRGB: Mesa's software driver writes its own sRGB formats by a
/// processor's estimates of roots, which AMD's and Intel's give differently.
pub const PICTURE: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Formats of windows that are encoded alike.
pub const PLAIN: [wgpu::TextureFormat; 2] = [wgpu::TextureFormat::Bgra8Unorm, PICTURE];
/// Samples a pixel.
pub const SAMPLES: u32 = 4;

/// The targets of one picture size.
#[derive(Debug)]
pub struct Targets {
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// Scene light, [`SAMPLES`] a pixel.
    pub colour: wgpu::TextureView,
    /// Depth, [`SAMPLES`] a pixel.
    pub depth: wgpu::TextureView,
    /// Scene light, one value a pixel.
    pub resolved: wgpu::TextureView,
}

impl Targets {
    /// Targets of `size` pixels; a side of zero counts as one.
    pub fn new(gpu: &Gpu, size: (u32, u32)) -> Self {
        let view = |label, format, sample_count, more| {
            let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | more;
            texture(gpu, label, size, format, sample_count, usage).create_view(&Default::default())
        };
        Self {
            size,
            colour: view("scene.colour", COLOUR, SAMPLES, wgpu::TextureUsages::empty()),
            depth: view("scene.depth", DEPTH, SAMPLES, wgpu::TextureUsages::empty()),
            resolved: view(
                "scene.resolved",
                COLOUR,
                1,
                wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC,
            ),
        }
    }
}

/// A texture without mips.
pub fn texture(
    gpu: &Gpu,
    label: &str,
    (width, height): (u32, u32),
    format: wgpu::TextureFormat,
    sample_count: u32,
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width: width.max(1), height: height.max(1), depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

/// Depth state of what is drawn into the scene. `compare`: reversed depth, so nearer is greater.
pub fn depth_state(compare: wgpu::CompareFunction, write: bool) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: DEPTH,
        depth_write_enabled: Some(write),
        depth_compare: Some(compare),
        stencil: Default::default(),
        bias: Default::default(),
    }
}
