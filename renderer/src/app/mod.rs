//! The meadow in a window.

use std::time::{Duration, Instant};

use anyhow::Context;
use common::sealed::SealedBytes;
use winit::application::ApplicationHandler;
use winit::event::{ElementState, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::WindowId;

use crate::cli::Cli;
use crate::gpu::shader::Sources;
use crate::headless;
use crate::library_watch::LibraryWatch;
use crate::nursery::Nursery;
use crate::scene::camera::{self, path};

mod hands;
mod stage;

use hands::Hands;
use stage::{Shown, Stage};

/// How long to wait before looking again whether a window that showed nothing can show something.
const HIDDEN_PAUSE: Duration = Duration::from_millis(100);
/// How often the folder of `--shaders` is looked at.
const SHADERS_PAUSE: Duration = Duration::from_millis(500);

/// Shows the meadow until it is closed.
///
/// # Errors
/// No display, a display that ends, no device, a library file that is refused.
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
    let shaders = cli.shaders.as_deref().map(Sources::read).transpose()?;
    let mut app = App {
        cli,
        library,
        watch,
        nursery: Nursery::start().context("cannot start a thread")?,
        shaders: shaders.unwrap_or_default(),
        shaders_seen: Instant::now(),
        hands: Hands::default(),
        stage: None,
        failure: None,
        started: Instant::now(),
        last: Instant::now(),
    };
    event_loop.run_app(&mut app).map_err(|error| {
        tracing::debug!(%error, "display ended");
        anyhow::anyhow!("the display has ended; start again once there is one")
    })?;
    app.failure.map_or(Ok(()), Err)
}

struct App<'a> {
    cli: &'a Cli,
    library: Option<common::library::Snapshot<Vec<u8>>>,
    watch: Option<LibraryWatch>,
    nursery: Nursery<SealedBytes>,
    /// The shaders that were tried last, good or not.
    shaders: Sources,
    shaders_seen: Instant,
    hands: Hands,
    stage: Option<Stage>,
    failure: Option<anyhow::Error>,
    started: Instant,
    last: Instant,
}

impl ApplicationHandler for App<'_> {
    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(stage)) = (cause, &self.stage) {
            stage.window.request_redraw();
        }
    }

    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.stage.is_some() {
            return;
        }
        match Stage::open(event_loop, self.cli, self.shaders.clone()) {
            Ok(mut stage) => {
                if let Some(library) = &self.library {
                    stage.garden.plant(library);
                }
                stage.window.request_redraw();
                self.stage = Some(stage);
            }
            Err(error) => self.fail(event_loop, error),
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        if matches!(event, WindowEvent::CloseRequested) {
            return event_loop.exit();
        }
        if self.stage.is_none() {
            return;
        }
        match event {
            WindowEvent::RedrawRequested => self.draw(event_loop),
            WindowEvent::Resized(size) => {
                let stage = self.stage.as_mut().expect("looked at above");
                stage.resize(size);
                stage.window.request_redraw();
            }
            WindowEvent::Occluded(false) => {
                self.stage.as_ref().expect("looked at above").window.request_redraw();
            }
            _ if self.cli.kiosk => {}
            event => self.steer(event_loop, event),
        }
    }
}

impl App<'_> {
    fn fail(&mut self, event_loop: &ActiveEventLoop, error: anyhow::Error) {
        self.failure = Some(error);
        event_loop.exit();
    }

    /// What hands at keyboard and mouse do.
    fn steer(&mut self, event_loop: &ActiveEventLoop, event: WindowEvent) {
        let camera = self.view().camera;
        let Some(stage) = &self.stage else { return };
        match event {
            WindowEvent::KeyboardInput { event, .. } => {
                if event.state == ElementState::Pressed && !event.repeat {
                    match event.physical_key {
                        PhysicalKey::Code(KeyCode::Escape) => return event_loop.exit(),
                        PhysicalKey::Code(KeyCode::KeyF) => stage.toggle_fullscreen(),
                        _ => {}
                    }
                }
                if !event.repeat {
                    self.hands.key(event.physical_key, event.state, &camera);
                }
            }
            WindowEvent::MouseInput { state, .. } => self.hands.button(state),
            WindowEvent::CursorMoved { position, .. } => {
                self.hands.pointer(position, stage.window.inner_size().height, &camera);
            }
            WindowEvent::MouseWheel { delta, .. } => self.hands.wheel(delta, &camera),
            WindowEvent::Focused(false) => self.hands.let_go(),
            _ => {}
        }
    }

    /// The view as it is now, with the hands where they are.
    fn view(&mut self) -> crate::frame::View {
        // Wind, clouds and the camera's way start anew with each round, about once an hour: after months of
        // running the seconds would be too large to tell frames apart.
        let elapsed = self.started.elapsed().as_secs_f64() * f64::from(self.cli.time_scale);
        let seconds = elapsed.rem_euclid(f64::from(camera::WALK_S)) as f32;
        let mut view = self.cli.view(seconds);
        if self.cli.path.is_none() && self.cli.view.is_none() {
            view.camera = match self.stage.as_ref().and_then(|stage| stage.attract.as_ref()) {
                Some(path) => path.at(seconds),
                None => view.camera.drifted(seconds),
            };
        }
        if let Some(camera) = self.hands.camera(0.0) {
            view.camera = camera;
        }
        view
    }

    fn draw(&mut self, event_loop: &ActiveEventLoop) {
        self.reload_shaders();
        let library = self.watch.as_ref().and_then(LibraryWatch::take);
        let seconds = self.last.elapsed().as_secs_f32();
        self.last = Instant::now();
        self.hands.camera(seconds);
        let view = self.view();
        let Some(stage) = &mut self.stage else { return };
        if let Some(library) = library {
            self.nursery.sow(library);
        }
        // One library after the other: a change that is cut short would be seen.
        let ready = if stage.garden.is_growing() { None } else { self.nursery.take() };
        if let Some(seedling) = ready {
            tracing::info!(generation = seedling.generation, "growing");
            stage.garden.grow(seedling);
        }
        match stage.draw(&view) {
            Ok(Shown::Frame) => {
                event_loop.set_control_flow(ControlFlow::Poll);
                stage.window.request_redraw();
            }
            // Minimised, covered or between two devices: looked at again after a while, at no cost.
            Ok(Shown::Nothing) => {
                event_loop.set_control_flow(ControlFlow::WaitUntil(Instant::now() + HIDDEN_PAUSE));
            }
            Err(error) => self.fail(event_loop, error),
        }
    }

    fn reload_shaders(&mut self) {
        let (Some(folder), Some(stage)) = (&self.cli.shaders, &mut self.stage) else { return };
        if self.shaders_seen.elapsed() < SHADERS_PAUSE {
            return;
        }
        self.shaders_seen = Instant::now();
        match Sources::read(folder) {
            Ok(sources) if sources != self.shaders => {
                self.shaders = sources.clone();
                match stage.garden.replace_shaders(sources) {
                    Ok(()) => tracing::info!(folder = %folder.display(), "new shaders"),
                    Err(error) => tracing::error!(%error, "shaders refused; the last good ones stay"),
                }
            }
            Ok(_) => {}
            // An editor may be at work on it: the next look will tell.
            Err(error) => tracing::debug!(%error, "shaders cannot be read now"),
        }
    }
}

/// The kiosk's way round.
fn attract() -> anyhow::Result<path::Path> {
    path::Path::parse(path::ATTRACT).context("the path of the kiosk, which is built in")
}
