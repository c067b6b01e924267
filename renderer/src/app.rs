//! The meadow in a window.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Context;
use common::sealed::SealedBytes;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, KeyEvent, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::keyboard::{Key, NamedKey};
use winit::window::{Fullscreen, Window, WindowId};

use crate::cli::Cli;
use crate::frame::Meadow;
use crate::governor::Governor;
use crate::gpu::targets::Targets;
use crate::gpu::{Gpu, device};
use crate::headless;
use crate::library_watch::LibraryWatch;
use crate::nursery::Nursery;
use crate::passes::cull::Detail;
use crate::scene::camera;

/// Shows the meadow until it is closed.
///
/// # Errors
/// No display, no device, a library file that is refused.
pub fn run(cli: &Cli) -> anyhow::Result<()> {
    let library = cli.library.as_deref().map(headless::read_library).transpose()?;
    let watch = match library {
        Some(_) => None,
        None => Some(LibraryWatch::start(cli.socket.clone())?),
    };
    let event_loop = EventLoop::new().map_err(|error| {
        // winit's text names its own source lines.
        tracing::debug!(%error, "no display");
        anyhow::anyhow!("cannot open a display: expected X11 at DISPLAY or Wayland at WAYLAND_DISPLAY; set one, or use --headless to draw to files")
    })?;
    event_loop.set_control_flow(ControlFlow::Poll);
    let nursery = Nursery::start().context("cannot start a thread")?;
    let mut app = App { cli, nursery, library, watch, stage: None, failure: None };
    event_loop.run_app(&mut app).context("the display ended")?;
    app.failure.map_or(Ok(()), Err)
}

struct App<'a> {
    cli: &'a Cli,
    library: Option<common::library::Snapshot<Vec<u8>>>,
    watch: Option<LibraryWatch>,
    nursery: Nursery<SealedBytes>,
    stage: Option<Stage>,
    failure: Option<anyhow::Error>,
}

/// The window and all that draws to it.
struct Stage {
    window: Arc<Window>,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    gpu: Gpu,
    targets: Targets,
    meadow: Meadow,
    started: Instant,
    last_frame: Instant,
    /// `None`: all is drawn whatever it takes.
    governor: Option<Governor>,
}

impl ApplicationHandler for App<'_> {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.stage.is_some() {
            return;
        }
        match Stage::open(event_loop, self.cli) {
            Ok(mut stage) => {
                if let Some(library) = &self.library {
                    stage.meadow.plant(&stage.gpu, library);
                }
                stage.window.request_redraw();
                self.stage = Some(stage);
            }
            Err(error) => {
                self.failure = Some(error);
                event_loop.exit();
            }
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(stage) = &mut self.stage else { return };
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::KeyboardInput {
                event: KeyEvent { logical_key, state: ElementState::Pressed, .. },
                ..
            } if ends(&logical_key) => event_loop.exit(),
            WindowEvent::Resized(size) => stage.resize(size),
            WindowEvent::RedrawRequested => {
                if let Some(library) = self.watch.as_ref().and_then(LibraryWatch::take) {
                    self.nursery.sow(library);
                }
                // One library after the other: a change that is cut short would be seen.
                let ready = if stage.meadow.is_growing() { None } else { self.nursery.take() };
                if let Some(seedling) = ready {
                    tracing::info!(generation = seedling.generation, "growing");
                    stage.meadow.grow(&stage.gpu, seedling.shapes.as_ref());
                }
                stage.draw(self.cli);
                stage.window.request_redraw();
            }
            _ => {}
        }
    }
}

fn ends(key: &Key) -> bool {
    match key {
        Key::Named(NamedKey::Escape) => true,
        Key::Character(text) => text.eq_ignore_ascii_case("q"),
        _ => false,
    }
}

impl Stage {
    fn open(event_loop: &ActiveEventLoop, cli: &Cli) -> anyhow::Result<Self> {
        let mut attributes = Window::default_attributes()
            .with_title("Sward")
            .with_inner_size(PhysicalSize::new(cli.size.0, cli.size.1));
        if cli.fullscreen {
            attributes = attributes.with_fullscreen(Some(Fullscreen::Borderless(None)));
            // A kiosk without a window manager has nobody who would enlarge the window.
            if let Some(monitor) = event_loop.available_monitors().next() {
                attributes = attributes.with_inner_size(monitor.size()).with_position(monitor.position());
            }
        }
        let window = Arc::new(event_loop.create_window(attributes).context("cannot open a window")?);
        let instance = device::instance();
        let surface = instance.create_surface(Arc::clone(&window)).context(
            "no Vulkan device can draw to this window: install mesa-vulkan-drivers, or use --headless",
        )?;
        let gpu = Gpu::open(&instance, Some(&surface))?;
        let size = window.inner_size();
        let capabilities = surface.get_capabilities(&gpu.adapter);
        let mut config = surface
            .get_default_config(&gpu.adapter, size.width.max(1), size.height.max(1))
            .context("the Vulkan device cannot draw to this window; use --headless to draw to files")?;
        config.format =
            capabilities.formats.iter().copied().find(wgpu::TextureFormat::is_srgb).unwrap_or(config.format);
        // The default under X11 is Immediate, which tears.
        config.present_mode = wgpu::PresentMode::Fifo;
        surface.configure(&gpu.device, &config);
        let mut meadow = Meadow::new(&gpu, config.format);
        meadow.lay_out(cli.field());
        meadow.set_detail(&gpu, cli.detail()?);
        Ok(Self {
            targets: Targets::new(&gpu, (config.width, config.height)),
            meadow,
            started: Instant::now(),
            last_frame: Instant::now(),
            governor: (cli.budget_ms > 0.0).then(|| Governor::new(cli.budget_ms * 1e-3)),
            window,
            surface,
            config,
            gpu,
        })
    }

    fn resize(&mut self, size: PhysicalSize<u32>) {
        // A minimised window has no pixels; it keeps its last size.
        if size.width == 0 || size.height == 0 {
            return;
        }
        (self.config.width, self.config.height) = (size.width, size.height);
        self.surface.configure(&self.gpu.device, &self.config);
        self.targets = Targets::new(&self.gpu, self.drawn_size());
    }

    /// As many pixels as the governor allows.
    fn drawn_size(&self) -> (u32, u32) {
        let resolution = self.governor.as_ref().map_or(1.0, |governor| governor.setting().resolution);
        let scaled = |side: u32| ((side as f32 * resolution).round() as u32).max(1);
        (scaled(self.config.width), scaled(self.config.height))
    }

    /// Tells meadow and governor how much time went by since the last frame.
    fn pass_time(&mut self, cli: &Cli) {
        let frame_s = self.last_frame.elapsed().as_secs_f32();
        self.last_frame = Instant::now();
        self.meadow.pass_time(frame_s);
        let Some(governor) = &mut self.governor else { return };
        if !governor.observe(frame_s) {
            return;
        }
        let setting = governor.setting();
        tracing::debug!(?setting, frame_s, "another level of detail");
        let detail = Detail { naive: cli.naive, distance: setting.distance, ..Detail::default() };
        self.meadow.set_detail(&self.gpu, detail);
        if self.targets.size != self.drawn_size() {
            self.targets = Targets::new(&self.gpu, self.drawn_size());
        }
    }

    fn draw(&mut self, cli: &Cli) {
        use wgpu::CurrentSurfaceTexture::{
            Lost, Occluded, Outdated, Suboptimal, Success, Timeout, Validation,
        };
        let picture = match self.surface.get_current_texture() {
            Success(picture) | Suboptimal(picture) => picture,
            Outdated | Lost => return self.resize(self.window.inner_size()),
            Timeout | Occluded | Validation => return,
        };
        self.pass_time(cli);
        // Wind and clouds start anew with each round, about once an hour: their noise has no period,
        // and after months of running the seconds would be too large to tell frames apart.
        let elapsed = self.started.elapsed().as_secs_f64() * f64::from(cli.time_scale);
        let seconds = elapsed.rem_euclid(f64::from(camera::WALK_S)) as f32;
        let mut view = cli.view(seconds);
        view.camera = view.camera.drifted(seconds);
        self.meadow.draw(&self.gpu, &self.targets, &view, &picture.texture.create_view(&Default::default()));
        self.window.pre_present_notify();
        self.gpu.queue.present(picture);
    }
}
