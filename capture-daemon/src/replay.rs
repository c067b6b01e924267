//! The verb `replay`: a recording through the session of `run`, with its blades on stdout.

use std::io::{self, Write};
use std::time::{Duration, Instant};

use anyhow::Context;
use common::blade::Blade;
use common::library::{encode, layout::MAX_BLADES, library_hash};
use common::sentence::counted;
use serde_json::{Value, json};

use crate::cli::{ConfigArgs, ReplayArgs};
use crate::config::{self, Config, ConfigError};
use crate::explain;
use crate::note::Note;
use crate::recording;
use crate::region::RegionWatch;
use crate::session::{Capture, Session};
use crate::source::{FrameSource, SourceError};
use crate::stages::blade::{CapturedBlade, Refusal};

/// Keeps to the recording's own time, at a rate.
#[derive(Debug)]
pub struct Pace {
    rate: f64,
    first: Option<(Instant, u64)>,
}

impl Pace {
    /// `rate` in times real time, above 0.
    pub fn new(rate: f64) -> Self {
        Self { rate, first: None }
    }

    /// How long to wait until the frame of `timestamp_ns` is due. A clock that steps back starts
    /// anew; no wait is longer than ten seconds of the recording.
    pub fn wait(&mut self, timestamp_ns: u64) -> Duration {
        let (start, first_ns) = *self.first.get_or_insert((Instant::now(), timestamp_ns));
        let Some(elapsed_ns) = timestamp_ns.checked_sub(first_ns) else {
            self.first = Some((Instant::now(), timestamp_ns));
            return Duration::ZERO;
        };
        let due = start + Duration::from_secs_f64(elapsed_ns as f64 * 1e-9 / self.rate);
        let longest = Duration::from_secs_f64(10.0 / self.rate);
        let wait = due.saturating_duration_since(Instant::now());
        if wait > longest {
            self.first = Some((Instant::now() + longest, timestamp_ns));
        }
        wait.min(longest)
    }
}

/// Replays a recording.
///
/// # Errors
/// An [`recording::OpenError`] when it cannot be opened, anything else when a picture or stdout
/// cannot be written.
pub fn replay(args: &ReplayArgs, config: &Config) -> anyhow::Result<()> {
    let mut source = recording::open(&args.recording, &config.open_options())?;
    let mut out = Output { json: args.json, to: io::BufWriter::new(io::stdout().lock()) };
    match play(source.as_mut(), args, config, &mut out) {
        // Who reads our output has seen enough.
        Err(error) if is_broken_pipe(&error) => Ok(()),
        Err(error) if error.is::<io::Error>() => Err(error.context("stdout cannot be written")),
        result => result,
    }
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.downcast_ref::<io::Error>().is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
}

fn play(
    source: &mut dyn FrameSource,
    args: &ReplayArgs,
    config: &Config,
    out: &mut Output<impl Write>,
) -> anyhow::Result<()> {
    let mut session = Session::new(config.session_params());
    let mut pace = args.rate.or(args.realtime.then_some(1.0)).map(Pace::new);
    let mut blades: Vec<Blade> = Vec::new();
    let (mut captures, mut skipped) = (0, 0);
    let mut first_skipped = String::new();
    let mut region = RegionWatch::default();
    loop {
        let frame = match source.next_frame() {
            Ok(frame) => frame,
            Err(SourceError::Told(note)) => {
                take_note(&mut session, &note, &args.config)?;
                continue;
            }
            Err(SourceError::End) => break,
            Err(SourceError::BadFrame(reason) | SourceError::Interrupted(reason)) => {
                tracing::debug!(reason, "a frame was skipped");
                skipped += 1;
                if skipped == 1 {
                    first_skipped = reason;
                }
                continue;
            }
            Err(SourceError::Failed(reason)) => {
                tracing::warn!(reason, "the recording cannot be read further");
                break;
            }
        };
        if let Some(pace) = &mut pace {
            std::thread::sleep(pace.wait(frame.timestamp_ns));
        }
        if let Some(warning) = region.warning(config.mask.roi, [frame.width, frame.height]) {
            tracing::warn!("{warning}");
        }
        let Some(capture) = session.push(&frame) else { continue };
        captures += u32::from(!capture.steps.blades.is_empty());
        if let Some(folder) = &args.explain {
            for path in explain::write(folder, &capture, &frame.camera)? {
                out.picture(&path)?;
            }
        }
        out.capture(&capture)?;
        blades.extend(capture.steps.blades.into_iter().map(|captured| captured.blade));
    }
    if skipped > 0 {
        tracing::warn!(skipped, first = first_skipped, "frames were skipped: they cannot be read or used");
    }
    out.end(session.frames(), captures, &blades, skipped)
}

/// Does what the session was told where it was recorded. Another configuration holds unless a file was given in its place.
fn take_note(session: &mut Session, note: &Note, args: &ConfigArgs) -> anyhow::Result<()> {
    match note {
        Note::Config { toml } if args.config.is_none() => {
            session.set_params(config::load_recorded(Some(toml), None, &args.sets)?.session_params());
        }
        Note::Dropped { frames } => {
            tracing::warn!(
                frames,
                "frames that the station saw are missing here: it may have captured something else"
            );
        }
        _ => session.take_note(note),
    }
    Ok(())
}

/// The configuration of a replay: what the recording was made under, where it is of a live run and no file is given.
///
/// # Errors
/// What is wrong, as [`config::load`] says it.
pub fn configure(args: &ReplayArgs) -> Result<Config, ConfigError> {
    let ConfigArgs { config, sets } = &args.config;
    let recorded = config.is_none().then(|| recording::recorded_config(&args.recording)).flatten();
    config::load_recorded(recorded.as_deref(), config.as_deref(), sets)
}

/// What is found, on its way to stdout.
pub(crate) struct Output<W> {
    /// JSON Lines.
    pub(crate) json: bool,
    /// Where to.
    pub(crate) to: W,
}

impl<W: Write> Output<W> {
    fn line(&mut self, value: &Value) -> io::Result<()> {
        writeln!(self.to, "{value}")?;
        self.to.flush()
    }

    /// What a capture found.
    pub(crate) fn capture(&mut self, capture: &Capture) -> io::Result<()> {
        for blade in &capture.steps.blades {
            if self.json {
                self.line(&blade_event(capture, blade))?;
            } else {
                let CapturedBlade { blade, quality, .. } = blade;
                let (length, width) = (blade.length_m() * 1e3, blade.max_width_m() * 1e3);
                let (name, frame, score) = (blade.name(), capture.frame, quality.score);
                let across = quality.pixels_across;
                writeln!(
                    self.to,
                    "frame {frame:5}  {name}  {length:6.1} mm long  {width:5.1} mm wide  {across:4.1} px across  quality {score:.2}",
                )?;
            }
        }
        if self.json {
            for refusal in &capture.steps.refused {
                self.line(&refused_event(capture, refusal))?;
            }
        } else {
            for line in refused_lines(&capture.steps.refused) {
                writeln!(self.to, "frame {:5}  refused: {line}", capture.frame)?;
            }
        }
        self.to.flush()
    }

    fn picture(&mut self, path: &std::path::Path) -> io::Result<()> {
        if self.json { Ok(()) } else { writeln!(self.to, "{}", path.display()) }
    }

    /// That it is over: so many frames, captures and skipped frames, and all blades.
    pub(crate) fn end(
        &mut self,
        frames: u64,
        captures: u32,
        blades: &[Blade],
        skipped: u64,
    ) -> anyhow::Result<()> {
        let kept = &blades[blades.len().saturating_sub(MAX_BLADES)..];
        let library = encode(0, kept).context("the library cannot be written")?;
        let (blades, hash) = (blades.len(), library_hash(&library));
        if self.json {
            self.line(&json!({
                "event": "end", "frames": frames, "captures": captures, "blades": blades,
                "library_hash": hash, "skipped_frames": skipped,
            }))?;
        } else {
            let counts = [
                counted(frames, "frame"),
                counted(captures.into(), "capture"),
                counted(blades as u64, "blade"),
                format!("{} skipped", counted(skipped, "frame")),
            ];
            writeln!(self.to, "{}", counts.join(", "))?;
            self.to.flush()?;
        }
        Ok(())
    }
}

/// What was refused in one capture, for people: the sentence of what was refused once, and one line for all that was
/// refused more than once for the same reason.
fn refused_lines(refused: &[Refusal]) -> Vec<String> {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for code in refused.iter().map(Refusal::code) {
        match counts.iter_mut().find(|(known, _)| *known == code) {
            Some((_, count)) => *count += 1,
            None => counts.push((code, 1)),
        }
    }
    let once = |refusal: &&Refusal| counts.contains(&(refusal.code(), 1));
    let mut lines: Vec<String> = refused.iter().filter(once).map(ToString::to_string).collect();
    counts.retain(|(_, count)| *count > 1);
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let sums: Vec<String> =
        counts.iter().map(|(code, count)| format!("{count} {}", code.replace('_', " "))).collect();
    if !sums.is_empty() {
        lines.push(sums.join(", "));
    }
    lines
}

fn blade_event(capture: &Capture, captured: &CapturedBlade) -> Value {
    let knots: Vec<Value> = captured
        .knots_in_camera
        .iter()
        .map(|knot| {
            json!({
                "camera_m": knot.position.to_array(),
                "half_width_m": [knot.half_width_left, knot.half_width_right],
            })
        })
        .collect();
    let quality = &captured.quality;
    json!({
        "event": "blade", "frame": capture.frame, "timestamp_ns": capture.timestamp_ns,
        "id": captured.blade.id().to_string(),
        "length_m": captured.blade.length_m(), "max_width_m": captured.blade.max_width_m(),
        "knots": knots,
        "quality": {
            "score": quality.score, "pixels_across": quality.pixels_across,
            "hausdorff_m": quality.hausdorff_m, "length_error_m": quality.length_error_m,
            "width_error_m": quality.width_error_m,
        },
    })
}

fn refused_event(capture: &Capture, refusal: &Refusal) -> Value {
    json!({
        "event": "refused", "frame": capture.frame, "timestamp_ns": capture.timestamp_ns,
        "code": refusal.code(), "reason": refusal.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_refused_alike_is_summed_up() {
        let short = |found_m| Refusal::TooShort { found_m, needed_m: 0.03 };
        let refused =
            [short(0.01), Refusal::Outside, short(0.02), Refusal::Hidden, Refusal::Outside, short(0.025)];
        let expected = [Refusal::Hidden.to_string(), "3 too short, 2 outside".to_owned()];
        assert_eq!(refused_lines(&refused), expected);
        assert_eq!(refused_lines(&refused[..1]), [refused[0].to_string()]);
        assert!(refused_lines(&[]).is_empty());
    }
}
