//! The meadow as PNG files, without a window.

use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use common::library::Snapshot;

use crate::cli::{Cli, Shadows};
use crate::frame::View;
use crate::garden::Garden;
use crate::gpu::readback::{self, ReadbackError};
use crate::gpu::shader::Sources;
use crate::gpu::targets::{self, Targets};
use crate::gpu::{Gpu, device};
use crate::library_watch::LibraryWatch;

/// Format of the pictures.
const FORMAT: wgpu::TextureFormat = targets::PICTURE;
/// Pictures to a second of the meadow's time.
const FRAMES_PER_SECOND: f32 = 30.0;
/// How long a picture waits for a station that has not answered yet, when no blade is waited for.
const FIRST_ANSWER: Duration = Duration::from_secs(2);

/// A meadow that draws to memory.
#[derive(Debug)]
pub struct Studio {
    garden: Garden,
    targets: Targets,
    picture: wgpu::Texture,
}

impl Studio {
    /// A bare meadow for pictures of `size` pixels, on a device of its own.
    ///
    /// # Errors
    /// When there is no Vulkan device.
    pub fn open(size: (u32, u32)) -> Result<Self, device::OpenError> {
        let gpu = Gpu::open(&device::instance(), None)?;
        let (targets, picture) = Self::targets(&gpu, size);
        Ok(Self { garden: Garden::new(gpu, FORMAT), targets, picture })
    }

    /// Lets this library grow from the next picture on.
    pub fn plant<B: AsRef<[u8]>>(&mut self, library: &Snapshot<B>) {
        self.garden.plant(library);
    }

    /// Generation of the library that the next picture shows; 0 while the meadow is bare.
    pub fn generation(&self) -> u64 {
        self.garden.generation()
    }

    /// What draws: name of the adapter and of its driver.
    pub fn adapter(&self) -> String {
        let info = self.garden.gpu.adapter.get_info();
        format!("{} {}", info.name, info.driver)
    }

    /// Scene light of the frame drawn last, as the passes store it: four half floats a pixel, rows from
    /// the top, each its 16 bits.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn scene_light(&self) -> Result<Vec<u16>, ReadbackError> {
        let bytes = readback::texels(&self.garden.gpu, self.targets.resolved.texture())?;
        Ok(bytes.chunks_exact(2).map(|pair| u16::from_ne_bytes([pair[0], pair[1]])).collect())
    }

    /// Draws one frame. Returns sRGB with alpha, 4 bytes a pixel, rows from the top.
    ///
    /// A device that was lost since the last time is replaced by another before.
    ///
    /// # Errors
    /// When the device is lost while it draws, or there is no other.
    pub fn draw(&mut self, view: &View) -> anyhow::Result<Vec<u8>> {
        if self.garden.gpu.is_lost() {
            self.garden.reopen()?;
            (self.targets, self.picture) = Self::targets(&self.garden.gpu, self.targets.size);
        }
        self.garden.draw(&self.targets, view, &self.picture.create_view(&Default::default()));
        Ok(readback::texels(&self.garden.gpu, &self.picture)?)
    }

    /// The meadow and its device, to do to them what may happen to them.
    pub fn garden(&mut self) -> &mut Garden {
        &mut self.garden
    }

    fn targets(gpu: &Gpu, size: (u32, u32)) -> (Targets, wgpu::Texture) {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        (Targets::new(gpu, size), targets::texture(gpu, "picture", size, FORMAT, 1, usage))
    }
}

/// Draws the pictures that the command line asks for, and prints the path of each.
///
/// # Errors
/// No device, a library that is refused, blades that do not come in time, a folder that cannot be
/// written.
pub fn run(cli: &Cli) -> anyhow::Result<()> {
    let out = cli.out.as_deref().context("--headless needs --out DIR")?;
    std::fs::create_dir_all(out)
        .with_context(|| format!("cannot make the folder {} for the pictures", out.display()))?;
    let library = cli.library.as_deref().map(read_library).transpose()?;
    let mut studio = Studio::open(cli.size)?;
    let detail = cli.detail()?;
    studio.garden().lay_out(cli.field(), detail);
    studio.garden().set_shadows(cli.shadows != Shadows::Off);
    if let Some(folder) = &cli.shaders {
        let refused = || format!("the shaders in {} are refused", folder.display());
        studio.garden().replace_shaders(Sources::read(folder)?).with_context(refused)?;
    }
    let watch = match &library {
        Some(library) => {
            studio.plant(library);
            None
        }
        None => {
            let watch = LibraryWatch::start(cli.socket.clone())?;
            wait_for_blades(cli, &watch, &mut studio)?;
            Some(watch)
        }
    };
    for index in 0..cli.frames {
        if let Some(library) = watch.as_ref().and_then(LibraryWatch::take) {
            studio.plant(&library);
        }
        let started = Instant::now();
        let pixels = studio.draw(&cli.view(index as f32 / FRAMES_PER_SECOND * cli.time_scale))?;
        let seconds = started.elapsed().as_secs_f32();
        tracing::info!(index, seconds, generation = studio.generation(), "drawn");
        let path = out.join(format!("frame-{index:04}.png"));
        write_picture(&path, cli.size, &pixels)?;
        writeln!(std::io::stdout(), "{}", path.display()).context("cannot write to stdout")?;
    }
    Ok(())
}

/// Reads a snapshot from a file.
///
/// # Errors
/// When the file cannot be read, or is not a valid snapshot.
pub fn read_library(path: &Path) -> anyhow::Result<Snapshot<Vec<u8>>> {
    let limit = common::protocol::MAX_SNAPSHOT_BYTES;
    let read = || -> std::io::Result<(u64, Vec<u8>)> {
        // A pipe without a writer would never open.
        if !std::fs::metadata(path)?.is_file() {
            return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, "it is not a regular file"));
        }
        let mut file = std::fs::File::open(path)?;
        let size = file.metadata()?.len();
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut std::io::Read::take(&mut file, limit + 1), &mut bytes)?;
        Ok((size, bytes))
    };
    let (size, bytes) = read().with_context(|| format!("cannot read the library {}", path.display()))?;
    if bytes.len() as u64 > limit {
        bail!("the library {} has {size} bytes; at most {limit} are accepted", path.display());
    }
    Snapshot::validate(bytes).with_context(|| format!("the library {} is refused", path.display()))
}

fn wait_for_blades(cli: &Cli, watch: &LibraryWatch, studio: &mut Studio) -> anyhow::Result<()> {
    let patience =
        if cli.wait_blades == 0 { FIRST_ANSWER } else { Duration::from_secs_f32(cli.timeout_secs) };
    let deadline = Instant::now() + patience;
    let mut blades = 0;
    while let Some(library) = watch.wait_until(deadline) {
        blades = library.len();
        studio.plant(&library);
        if blades >= cli.wait_blades {
            return Ok(());
        }
    }
    if blades < cli.wait_blades {
        bail!(
            "the library at {} holds {blades} blades after {} s, expected at least {}: see that the station runs there, or wait longer with --timeout-secs",
            cli.socket.display(),
            cli.timeout_secs,
            cli.wait_blades
        );
    }
    tracing::warn!(socket = %cli.socket.display(), "no answer from the station; the meadow stays bare");
    Ok(())
}

/// Writes a picture of 4 bytes a pixel.
///
/// # Errors
/// When the file cannot be written.
pub fn write_picture(path: &Path, size: (u32, u32), pixels: &[u8]) -> anyhow::Result<()> {
    image::save_buffer(path, pixels, size.0, size.1, image::ColorType::Rgba8)
        .with_context(|| format!("cannot write the picture {}", path.display()))
}
