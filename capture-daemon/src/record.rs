//! The verb `record`: a sensor, or a recording that stands in for one, through the session of `run` into a file.

use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

use anyhow::Context;
use clap::Args;
use common::blade::Blade;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use tokio::sync::watch;

use crate::cli::ConfigArgs;
use crate::config::Config;
use crate::feed::Feed;
use crate::frames::{Source, open_source};
use crate::note::Note;
use crate::recorder::{self, Job, Recorder, Shape, Told, Work};
use crate::replay::Output;
use crate::session::Session;
use crate::source::SourceError;
use crate::source::host::{Fares, Health};

/// It is looked whether it is over at least so often.
const TICK: Duration = Duration::from_millis(100);

/// What to record and how.
#[derive(Debug, Args)]
pub struct RecordArgs {
    /// The MCAP file to write; nothing may be there yet
    pub out: PathBuf,
    /// Configuration.
    #[command(flatten)]
    pub config: ConfigArgs,
    /// How long, seconds, 0.1 to 1000000 [default: until it is interrupted, or the recording that is played is over]
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = seconds)]
    pub seconds: Option<f64>,
    /// JSON Lines on stdout of what is captured meanwhile, as `replay` writes them, and nothing else there
    #[arg(long)]
    pub json: bool,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.1..=1e6).contains(seconds));
    seconds.ok_or_else(|| "expected a number of 0.1 to 1000000".to_owned())
}

/// Why nothing is recorded. One sentence without its full stop.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The configuration names no source.
    #[error(
        "the configuration names no source of frames, expected sensor.driver or source.recording, as in --set \
         'sensor.driver=\"openni2\"'"
    )]
    NoSource,
    /// The sensor gives not one frame.
    #[error(
        "the sensor gives no frame: {0}; see sward-capture devices, and stop a station that has it (or have it record: \
         sward-capture recordings start)"
    )]
    Sensor(String),
    /// Something is at the place to write to.
    #[error("{}: exists already; give a path where nothing is yet", .0.display())]
    Exists(PathBuf),
    /// It cannot be written, or not to its end.
    #[error("{}: {reason}", .path.display())]
    Write {
        /// Where.
        path: PathBuf,
        /// What is the matter.
        reason: String,
    },
}

/// Records until it is over.
///
/// # Errors
/// A [`RecordError`]; an [`OpenError`](crate::recording::OpenError) of a recording that is to be played; anything else
/// when stdout cannot be written.
pub fn record(args: &RecordArgs, config: &Config) -> anyhow::Result<()> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // The second one ends it at once; what is on disk by then can be read.
        flag::register_conditional_shutdown(signal, 1, Arc::clone(&stop))
            .and_then(|_| flag::register(signal, Arc::clone(&stop)))
            .context("the signals that end it cannot be handled")?;
    }
    if args.out.symlink_metadata().is_ok() {
        return Err(RecordError::Exists(args.out.clone()).into());
    }
    let source = open_source(config)?.ok_or(RecordError::NoSource)?;
    let health = source.health();
    let is_patient = health.is_none() && config.source.rate == 0.0;
    let (recorder, inbox) = recorder::queue(is_patient);
    let (tell, told) = watch::channel(Told::default());
    let work = Work::new(config.one_recording(&args.out), &source.describe(), inbox, tell);
    let thread = std::thread::Builder::new()
        .name("recorder".to_owned())
        .spawn(move || work.run())
        .context("the recorder's thread cannot be started")?;
    let jobs = recorder.jobs();
    let run = Run {
        config,
        args,
        health,
        stop,
        told: told.clone(),
        recorder,
        session: Session::new(config.session_params()),
        shape: None,
        skipped: 0,
    };
    let out = Output { json: args.json, to: io::BufWriter::new(io::stdout().lock()) };
    let played = run.play(source, out);
    // It is there as long as its thread is.
    let _ = jobs.send(Job::End);
    anyhow::ensure!(thread.join().is_ok(), "the recorder's thread panicked; see above");
    played?;
    let Told { trouble, frames, slow_frames, .. } = told.borrow().clone();
    if let Some(reason) = trouble {
        return Err(RecordError::Write { path: args.out.clone(), reason }.into());
    }
    if slow_frames > 0 {
        tracing::warn!(
            slow_frames,
            "frames are missing in the recording: the disk or the processor did not keep up"
        );
    }
    tracing::info!(frames, path = %args.out.display(), "recorded");
    Ok(())
}

/// One recording.
struct Run<'a> {
    config: &'a Config,
    args: &'a RecordArgs,
    health: Option<Arc<Health>>,
    stop: Arc<AtomicBool>,
    told: watch::Receiver<Told>,
    recorder: Recorder,
    session: Session,
    shape: Option<Shape>,
    skipped: u64,
}

impl Run<'_> {
    fn play(mut self, source: Source, mut out: Output<impl Write>) -> anyhow::Result<()> {
        let feed =
            Feed::start(source, self.config.source.rate).context("the source's thread cannot be started")?;
        let due = self.args.seconds.map(|seconds| Instant::now() + Duration::from_secs_f64(seconds));
        let mut blades: Vec<Blade> = Vec::new();
        let (mut captures, mut dropped) = (0, 0);
        while !self.is_over(due) {
            let given = feed.next(TICK);
            dropped += feed.take_dropped();
            let frame = match given {
                Ok(Ok(frame)) => Arc::new(frame),
                Ok(Err(SourceError::Told(note))) => {
                    self.recorder.note(note.clone());
                    self.session.take_note(&note);
                    continue;
                }
                Ok(Err(SourceError::BadFrame(reason))) => {
                    tracing::debug!(reason, "a frame was skipped");
                    self.skipped += 1;
                    continue;
                }
                Ok(Err(SourceError::Interrupted(reason))) if self.shape.is_none() => {
                    return Err(RecordError::Sensor(reason).into());
                }
                Ok(Err(SourceError::Interrupted(reason))) => {
                    tracing::warn!(reason, "no frames come from the sensor; it is tried again");
                    self.interrupt();
                    continue;
                }
                Ok(Err(SourceError::End)) | Err(RecvTimeoutError::Disconnected) => break,
                Ok(Err(SourceError::Failed(reason))) => {
                    tracing::warn!(reason, "the source cannot be read further");
                    break;
                }
                Err(RecvTimeoutError::Timeout) => continue,
            };
            self.look_at(Shape::of(&frame));
            self.recorder.frame(&frame, &mut self.session);
            let Some(capture) = self.session.push(&frame) else { continue };
            captures += u32::from(!capture.steps.blades.is_empty());
            out.capture(&capture).context("stdout cannot be written")?;
            blades.extend(capture.steps.blades.into_iter().map(|captured| captured.blade));
        }
        if dropped > 0 {
            tracing::warn!(dropped, "frames were dropped: they came faster than the stages are");
        }
        if self.shape.is_none() && self.health.is_some() {
            return Err(RecordError::Sensor("it gave none until it was to end".to_owned()).into());
        }
        out.end(self.session.frames(), captures, &blades, self.skipped)
    }

    fn is_over(&self, due: Option<Instant>) -> bool {
        let is_due = due.is_some_and(|due| Instant::now() >= due);
        is_due || self.stop.load(Ordering::Relaxed) || self.told.borrow().trouble.is_some()
    }

    fn interrupt(&mut self) {
        self.session.interrupt();
        self.recorder.note(Note::Interrupted);
    }

    /// Another shape is another picture, and the first one is that of a sensor which is open.
    fn look_at(&mut self, shape: Shape) {
        match self.shape.replace(shape) {
            Some(before) if before != shape => self.interrupt(),
            Some(_) => {}
            None => {
                let fares = self.health.as_ref().map(|health| health.now());
                if let Some(Fares { name: Some(name), serial, .. }) = fares {
                    self.recorder.sensor(&name, serial.as_deref().unwrap_or_default());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_is_a_number_in_its_range() {
        assert_eq!(seconds("2.5"), Ok(2.5));
        for wrong in ["0", "-1", "nan", "inf", "ten", "1e7"] {
            assert!(seconds(wrong).is_err_and(|why| why.contains("0.1 to 1000000")), "{wrong}");
        }
    }
}
