//! The verb `run`: frames through the session on one thread, the service on another.

use std::sync::{Arc, mpsc};
use std::thread;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::Context;
use common::blade::Blade;
use common::library::layout::MAX_BLADES;
use common::protocol::Status;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

use crate::config::Config;
use crate::control::{Published, Service, Socket};
use crate::recording;
use crate::replay::Pace;
use crate::session::{Capture, Session};
use crate::source::{FrameSource, SourceError};

/// Runs the station until SIGTERM or SIGINT; a second signal ends it at once.
///
/// # Errors
/// When the socket is in use, or the recording that is to be the sensor cannot be opened.
pub fn run(config: &Config) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .context("the service's runtime cannot be started")?;
    tokio::task::LocalSet::new().block_on(&runtime, serve(config))
}

async fn serve(config: &Config) -> anyhow::Result<()> {
    let mut terminate = signal(SignalKind::terminate()).context("SIGTERM cannot be handled")?;
    let mut interrupt = signal(SignalKind::interrupt()).context("SIGINT cannot be handled")?;
    let source = open_source(config)?;
    let socket = Socket::bind(&config.service.socket).await?;
    // Grows across restarts as long as the clock does not step back by more than the station ran.
    let generation = SystemTime::now().duration_since(UNIX_EPOCH).map_or(1, |now| now.as_micros() as u64);
    let status = Status {
        state: "waiting".to_owned(),
        generation: 0,
        blades: 0,
        frames: 0,
        captures: 0,
        skipped_frames: 0,
        source: source.as_ref().map_or_else(|| "none".to_owned(), |source| source.describe()),
    };
    let (library, library_seen) = watch::channel(None);
    let (status, status_seen) = watch::channel(status);
    tracing::info!(socket = %config.service.socket.display(), source = status.borrow().source, "ready");
    let (stop, stopped) = mpsc::channel::<()>();
    let station = Station { config: config.clone(), blades: Vec::new(), generation, library, status };
    let frames = source.map(|source| {
        thread::Builder::new().name("frames".to_owned()).spawn(move || station.run(source, &stopped))
    });
    let frames = frames.transpose().context("the frame thread cannot be started")?;
    let service = Service { library: library_seen, status: status_seen };
    tokio::select! {
        () = socket.serve(service) => {}
        _ = terminate.recv() => tracing::info!("SIGTERM: ending"),
        _ = interrupt.recv() => tracing::info!("SIGINT: ending"),
    }
    drop(stop);
    tokio::task::spawn_local(async move {
        tokio::select! { _ = terminate.recv() => {} _ = interrupt.recv() => {} }
        tracing::warn!("second signal: ending at once");
        std::process::exit(1);
    });
    if let Some(frames) = frames {
        let joined = tokio::task::spawn_blocking(move || frames.join()).await;
        if !matches!(joined, Ok(Ok(()))) {
            anyhow::bail!("the frame thread panicked; see the log above");
        }
    }
    Ok(())
}

fn open_source(config: &Config) -> Result<Option<Box<dyn FrameSource + Send>>, recording::OpenError> {
    let Some(path) = &config.source.recording else {
        tracing::warn!("no source.recording is set: nothing will be captured");
        return Ok(None);
    };
    recording::open(path, &config.open_options()).map(Some)
}

/// What the frame thread owns.
struct Station {
    config: Config,
    blades: Vec<Blade>,
    generation: u64,
    library: watch::Sender<Option<Arc<Published>>>,
    status: watch::Sender<Status>,
}

impl Station {
    /// Plays the source until it ends or `stopped` is closed.
    fn run(mut self, mut source: Box<dyn FrameSource + Send>, stopped: &mpsc::Receiver<()>) {
        let mut session = Session::new(self.config.session_params());
        let rate = self.config.source.rate;
        let mut pace = (rate > 0.0).then(|| Pace::new(rate));
        let ended = |wait| !matches!(stopped.recv_timeout(wait), Err(mpsc::RecvTimeoutError::Timeout));
        loop {
            let frame = match source.next_frame() {
                Ok(frame) => frame,
                Err(SourceError::BadFrame(reason)) => {
                    tracing::debug!(reason, "a frame was skipped");
                    self.status.send_modify(|status| status.skipped_frames += 1);
                    continue;
                }
                Err(SourceError::End) if self.config.source.looped => match open_source(&self.config) {
                    Ok(Some(again)) => {
                        source = again;
                        // The recording's clock steps back here, so the session begins anew too.
                        session = Session::new(self.config.session_params());
                        pace = pace.map(|_| Pace::new(rate));
                        if ended(Duration::ZERO) {
                            return;
                        }
                        continue;
                    }
                    Ok(None) => return,
                    Err(error) => return tracing::error!(%error, "the recording cannot be played again"),
                },
                Err(SourceError::End) => return tracing::info!("the recording is over"),
                Err(SourceError::Failed(reason)) => {
                    return tracing::error!(reason, "the recording cannot be read further");
                }
            };
            if ended(pace.as_mut().map_or(Duration::ZERO, |pace| pace.wait(frame.timestamp_ns))) {
                return;
            }
            if let Some(capture) = session.push(&frame) {
                self.publish(capture);
            }
            let state = session.state().name();
            self.status.send_modify(|status| {
                status.frames += 1;
                if status.state != state {
                    state.clone_into(&mut status.state);
                }
            });
        }
    }

    fn publish(&mut self, capture: Capture) {
        for refusal in &capture.steps.refused {
            tracing::info!(frame = capture.frame, code = refusal.code(), %refusal, "refused");
        }
        let captured = capture.steps.blades;
        if captured.is_empty() {
            return;
        }
        for captured in &captured {
            let (blade, quality) = (&captured.blade, &captured.quality);
            let [length_mm, width_mm] =
                [blade.length_m(), blade.max_width_m()].map(|m| format!("{:.1}", m * 1e3));
            let score = format!("{:.2}", quality.score);
            tracing::info!(
                frame = capture.frame,
                name = blade.name(),
                length_mm,
                width_mm,
                quality = score,
                "captured"
            );
        }
        let known = |id| self.blades.iter().any(|blade| blade.id() == id);
        let new: Vec<Blade> =
            captured.into_iter().map(|captured| captured.blade).filter(|blade| !known(blade.id())).collect();
        self.status.send_modify(|status| status.captures += 1);
        if new.is_empty() {
            // A looping recording shows the same blades again.
            return;
        }
        self.blades.extend(new);
        let surplus = self.blades.len().saturating_sub(MAX_BLADES);
        if surplus > 0 {
            tracing::warn!(surplus, "the library is full: the oldest blades go");
            self.blades.drain(..surplus);
        }
        match Published::new(self.generation + 1, &self.blades) {
            Ok(published) => {
                self.generation += 1;
                self.status.send_modify(|status| {
                    status.generation = published.generation().cast_signed();
                    status.blades = published.blades() as i64;
                });
                self.library.send_replace(Some(Arc::new(published)));
            }
            Err(error) => tracing::error!(%error, "the library cannot be published; the last one stays"),
        }
    }
}
