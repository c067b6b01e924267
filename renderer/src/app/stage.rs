//! The window, its surface, and the meadow that is drawn to it; whichever of them is lost is made anew.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context;
use winit::dpi::PhysicalSize;
use winit::event_loop::ActiveEventLoop;
use winit::window::{Fullscreen, Window};

use crate::cli::{Cli, Loss, Shadows};
use crate::frame::View;
use crate::garden::Garden;
use crate::governor::Governor;
use crate::gpu::shader::Sources;
use crate::gpu::targets::{self, Targets};
use crate::gpu::{Gpu, device};
use crate::passes::cull::Detail;
use crate::scene::camera::path::Path;
use crate::scene::grassland::field::Field;

/// How long a lost device is tried to be replaced: a driver that starts anew takes seconds.
const PATIENCE: Duration = Duration::from_secs(30);
/// Pause between two tries.
const RETRY: Duration = Duration::from_secs(1);

/// What came of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shown {
    /// It is in the window.
    Frame,
    /// Nothing: the window has no pixels, cannot be seen, or waits for a device.
    Nothing,
}

/// The window and all that draws to it.
pub(super) struct Stage {
    /// The window.
    pub(super) window: Arc<Window>,
    /// The meadow on its device.
    pub(super) garden: Garden,
    /// The way of a camera that nobody steers, in the kiosk.
    pub(super) attract: Option<Path>,
    instance: wgpu::Instance,
    /// `None` while another is made.
    surface: Option<wgpu::Surface<'static>>,
    config: wgpu::SurfaceConfiguration,
    targets: Targets,
    field: Field,
    /// What the command line asks for, before the governor.
    detail: Detail,
    /// `None`: all is drawn whatever it takes.
    governor: Option<Governor>,
    /// When the frame before was drawn, if one has been since the window showed anything.
    last_frame: Option<Instant>,
    /// Since when there is no device, and when it was last tried to get one.
    without_device: Option<(Instant, Instant)>,
    /// What is taken away on purpose, and the frames so far.
    losses: Vec<Loss>,
    frames: u64,
}

impl Stage {
    /// Opens the window that the command line asks for.
    ///
    /// # Errors
    /// No window, no device that can draw to it.
    pub(super) fn open(event_loop: &ActiveEventLoop, cli: &Cli, shaders: Sources) -> anyhow::Result<Self> {
        let mut attributes = Window::default_attributes()
            .with_title("Sward")
            .with_inner_size(PhysicalSize::new(cli.size.0, cli.size.1));
        if cli.fullscreen || cli.kiosk {
            attributes =
                attributes.with_fullscreen(Some(Fullscreen::Borderless(None))).with_decorations(!cli.kiosk);
            // A kiosk without a window manager has nobody who would enlarge the window.
            if let Some(monitor) = event_loop.available_monitors().next() {
                attributes = attributes.with_inner_size(monitor.size()).with_position(monitor.position());
            }
        }
        let window = Arc::new(event_loop.create_window(attributes).context("cannot open a window")?);
        window.set_cursor_visible(!cli.kiosk);
        let instance = device::instance();
        let surface = surface(&instance, &window)?;
        let gpu = Gpu::open(&instance, Some(&surface))?.with_shaders(shaders);
        let config = configure(&gpu, &surface, window.inner_size())?;
        let targets = Targets::new(&gpu, (config.width, config.height));
        let software = gpu.adapter.get_info().device_type == wgpu::DeviceType::Cpu;
        let mut garden = Garden::new(gpu, config.format);
        let (field, detail) = (cli.field(), cli.detail()?);
        garden.lay_out(field, detail);
        garden.set_shadows(cli.shadows == Shadows::On || cli.shadows == Shadows::Auto && !software);
        Ok(Self {
            garden,
            attract: cli.kiosk.then(super::attract).transpose()?,
            surface: Some(surface),
            without_device: None,
            losses: cli.lose.clone(),
            frames: 0,
            governor: (cli.budget_ms > 0.0).then(|| Governor::new(cli.budget_ms * 1e-3)),
            last_frame: None,
            field,
            detail,
            window,
            instance,
            config,
            targets,
        })
    }

    /// Fits the pictures to the window.
    pub(super) fn resize(&mut self, size: PhysicalSize<u32>) {
        // A minimised window has no pixels; it keeps its last size.
        if size.width == 0 || size.height == 0 || self.garden.gpu.is_lost() {
            return;
        }
        (self.config.width, self.config.height) = (size.width, size.height);
        if let Some(surface) = &self.surface {
            surface.configure(&self.garden.gpu.device, &self.config);
        }
        self.renew_targets();
    }

    /// As many pixels as the governor allows.
    fn renew_targets(&mut self) {
        let resolution = self.governor.as_ref().map_or(1.0, |governor| governor.setting().resolution);
        let scaled = |side: u32| ((side as f32 * resolution).round() as u32).max(1);
        let size = (scaled(self.config.width), scaled(self.config.height));
        if self.targets.size != size {
            self.targets = Targets::new(&self.garden.gpu, size);
        }
    }

    /// Tells meadow and governor how much time went by since the frame before.
    fn pass_time(&mut self) {
        let Some(before) = self.last_frame.replace(Instant::now()) else { return };
        let frame_s = before.elapsed().as_secs_f32();
        self.garden.pass_time(frame_s);
        let Some(governor) = &mut self.governor else { return };
        if !governor.observe(frame_s) {
            return;
        }
        let setting = governor.setting();
        tracing::debug!(?setting, frame_s, "another level of detail");
        self.garden.lay_out(self.field, Detail { distance: setting.distance, ..self.detail });
        self.renew_targets();
    }

    /// Fills the screen, or gives it back.
    pub(super) fn toggle_fullscreen(&self) {
        let wanted = self.window.fullscreen().is_none().then_some(Fullscreen::Borderless(None));
        self.window.set_fullscreen(wanted);
    }

    /// Draws one frame. A surface that was lost is made anew, and so is a device.
    ///
    /// # Errors
    /// When a device does not come back within half a minute, or a surface cannot be made.
    pub(super) fn draw(&mut self, view: &View) -> anyhow::Result<Shown> {
        let shown = self.try_draw(view);
        if !matches!(shown, Ok(Shown::Frame)) {
            // A pause is no slow frame.
            self.last_frame = None;
        }
        shown
    }

    fn lose_on_purpose(&mut self) {
        self.frames += 1;
        for loss in &self.losses {
            match loss {
                Loss::Surface(frame) if *frame == self.frames => self.surface = None,
                Loss::Device(frame) if *frame == self.frames => self.garden.gpu.device.destroy(),
                Loss::Surface(_) | Loss::Device(_) => {}
            }
        }
    }

    fn try_draw(&mut self, view: &View) -> anyhow::Result<Shown> {
        use wgpu::CurrentSurfaceTexture::{
            Lost, Occluded, Outdated, Suboptimal, Success, Timeout, Validation,
        };
        let size = self.window.inner_size();
        if size.width == 0 || size.height == 0 {
            return Ok(Shown::Nothing);
        }
        self.lose_on_purpose();
        if self.garden.gpu.is_lost() && !self.renew_device()? {
            return Ok(Shown::Nothing);
        }
        let Some(surface) = &self.surface else {
            return self.renew_surface().map(|()| Shown::Nothing);
        };
        let picture = match surface.get_current_texture() {
            Success(picture) | Suboptimal(picture) => picture,
            Outdated => {
                self.resize(size);
                return Ok(Shown::Frame);
            }
            Lost => {
                self.surface = None;
                return Ok(Shown::Frame);
            }
            Timeout | Occluded => return Ok(Shown::Nothing),
            Validation => {
                // A device that is gone says so only when it is asked; else it is the surface that will not do.
                let _ = self.garden.gpu.device.poll(wgpu::PollType::Poll);
                self.surface = None;
                return Ok(Shown::Nothing);
            }
        };
        self.pass_time();
        self.garden.draw(&self.targets, view, &picture.texture.create_view(&Default::default()));
        self.window.pre_present_notify();
        self.garden.gpu.queue.present(picture);
        Ok(Shown::Frame)
    }

    fn renew_surface(&mut self) -> anyhow::Result<()> {
        tracing::warn!("the window's surface was lost; making another");
        let surface = surface(&self.instance, &self.window)?;
        surface.configure(&self.garden.gpu.device, &self.config);
        self.surface = Some(surface);
        Ok(())
    }

    /// Tries to replace a lost device and all that was made on it; whether it is there.
    fn renew_device(&mut self) -> anyhow::Result<bool> {
        let now = Instant::now();
        let (since, tried) = match self.without_device {
            Some((since, tried)) => (since, tried),
            None => {
                tracing::error!("the graphics device was lost; opening another");
                (now, now - RETRY)
            }
        };
        self.without_device = Some((since, tried));
        if now.duration_since(tried) < RETRY {
            return Ok(false);
        }
        self.without_device = Some((since, now));
        match self.try_device() {
            Ok(()) => {
                tracing::info!("drawing again");
                self.without_device = None;
                Ok(true)
            }
            Err(error) if now.duration_since(since) > PATIENCE => {
                Err(error.context("the graphics device was lost and did not come back"))
            }
            Err(error) => {
                tracing::warn!(error = format!("{error:#}"), "no device yet, trying again");
                Ok(false)
            }
        }
    }

    fn try_device(&mut self) -> anyhow::Result<()> {
        // The old surface holds the window; the instance is replaced too, for a driver that went away.
        self.surface = None;
        self.instance = device::instance();
        let surface = surface(&self.instance, &self.window)?;
        let gpu = Gpu::open(&self.instance, Some(&surface))?;
        self.config = configure(&gpu, &surface, self.window.inner_size())?;
        self.garden.move_to(gpu, self.config.format)?;
        self.targets = Targets::new(&self.garden.gpu, self.targets.size);
        self.renew_targets();
        self.surface = Some(surface);
        Ok(())
    }
}

fn surface(instance: &wgpu::Instance, window: &Arc<Window>) -> anyhow::Result<wgpu::Surface<'static>> {
    instance
        .create_surface(Arc::clone(window))
        .context("no Vulkan device can draw to this window: install mesa-vulkan-drivers, or use --headless")
}

fn configure(
    gpu: &Gpu,
    surface: &wgpu::Surface<'_>,
    size: PhysicalSize<u32>,
) -> anyhow::Result<wgpu::SurfaceConfiguration> {
    let capabilities = surface.get_capabilities(&gpu.adapter);
    let mut config = surface
        .get_default_config(&gpu.adapter, size.width.max(1), size.height.max(1))
        .context("the Vulkan device cannot draw to this window; use --headless to draw to files")?;
    let plain = |format: &wgpu::TextureFormat| targets::PLAIN.contains(format);
    config.format = capabilities.formats.iter().copied().find(plain).unwrap_or(config.format);
    // The default under X11 is Immediate, which tears.
    config.present_mode = wgpu::PresentMode::Fifo;
    surface.configure(&gpu.device, &config);
    Ok(config)
}
