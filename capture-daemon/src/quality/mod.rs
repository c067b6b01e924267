//! The verb `quality`: whether a sensor sees well enough for blades, before anybody comes.

mod measure;

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use common::sentence::print;
use serde_json::{Value, json};

pub use self::measure::{Measure, Measured};
use crate::cli::ConfigArgs;
use crate::config::Config;
use crate::frames::{Source, open_source};
use crate::record::RecordError;
use crate::recording::{self, OpenError};
use crate::source::SourceError;

/// Least share of pixels with a reading.
const MIN_FILL: f64 = 0.8;
/// Most noise at the working distance, metres, that leaves a blade's edges and its slope to be seen.
const MAX_NOISE_M: f64 = 0.002;
/// Fewest frames a second: a hold of half a second then adds up five.
const MIN_RATE_HZ: f64 = 10.0;
/// Most frames, relative, that may be of no use.
const MAX_SKIPPED: f64 = 0.02;
/// How long a sensor may take for all frames, beyond those at the lowest rate.
const PATIENCE: Duration = Duration::from_secs(10);

/// What to measure.
#[derive(Debug, Args)]
pub struct QualityArgs {
    /// A recording to measure instead of the sensor: an MCAP file, a rosbag2 folder, a folder of PNGs, or an .oni file
    pub recording: Option<PathBuf>,
    /// Configuration.
    #[command(flatten)]
    pub config: ConfigArgs,
    /// How many frames to measure, 5 to 10000
    #[arg(long, value_name = "N", default_value_t = 60, allow_negative_numbers = true, value_parser = frames)]
    pub frames: u64,
    /// Width of a narrow blade that is to be captured, millimetres, 0.1 to 1000
    #[arg(long, value_name = "MM", default_value_t = 6.0, allow_negative_numbers = true, value_parser = width_mm)]
    pub blade_width_mm: f64,
    /// Distance at which blades are held up, metres, 0.05 to 20 [default: the middle of the depth window]
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = distance_m)]
    pub distance_m: Option<f64>,
    /// One JSON object on stdout, and nothing else there
    #[arg(long)]
    pub json: bool,
}

fn within(text: &str, least: f64, most: f64) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number| (least..=most).contains(number));
    number.ok_or_else(|| format!("expected a number of {least} to {most}"))
}

fn frames(text: &str) -> Result<u64, String> {
    let number = text.parse().ok().filter(|number| (5..=10_000).contains(number));
    number.ok_or_else(|| "expected a whole number of 5 to 10000".to_owned())
}

fn width_mm(text: &str) -> Result<f64, String> {
    within(text, 0.1, 1000.0)
}

fn distance_m(text: &str) -> Result<f64, String> {
    within(text, 0.05, 20.0)
}

/// Why a sensor is not good enough, or nothing can be measured.
#[derive(Debug, thiserror::Error)]
pub enum QualityError {
    /// Something is not as it has to be; what, was printed.
    #[error("{0} of the measures fail, as was said; mend that before anybody comes")]
    Fails(usize),
}

/// What one measure has to be, and what to do else.
#[derive(Clone, Debug, PartialEq)]
struct Check {
    name: &'static str,
    unit: &'static str,
    /// What was measured.
    found: Option<f64>,
    limit: f64,
    /// The limit is the least, else the most.
    is_least: bool,
    advice: String,
}

impl Check {
    fn passes(&self) -> bool {
        self.found.is_some_and(|found| if self.is_least { found >= self.limit } else { found <= self.limit })
    }
}

/// Measures and prints.
///
/// # Errors
/// A [`QualityError`] when it is not good enough; an [`OpenError`] of a recording; a [`RecordError`] of a sensor that gives
/// nothing; anything else when stdout cannot be written.
pub fn quality(args: &QualityArgs, config: &Config) -> anyhow::Result<()> {
    let (source, path) = match &args.recording {
        Some(path) => (recording::open(path, &config.open_options())?, Some(path.clone())),
        None => (open_source(config)?.ok_or(RecordError::NoSource)?, config.source.recording.clone()),
    };
    let work_m = args.distance_m.unwrap_or_else(|| (config.mask.near_m + config.mask.far_m) / 2.0);
    let seen = watch(source, path, args, config, work_m)?;
    let checks = seen.checks(args, config, work_m);
    let failing = checks.iter().filter(|check| !check.passes()).count();
    print(&if args.json {
        format!("{}\n", seen.to_json(&checks, args, work_m))
    } else {
        seen.page(&checks, args, work_m)
    })?;
    if failing > 0 { Err(QualityError::Fails(failing).into()) } else { Ok(()) }
}

/// What came of watching.
struct Seen {
    source: String,
    measured: Measured,
    skipped: u64,
    rate_hz: Option<f64>,
}

/// Looks at frames. `path`: of the recording, if it is one.
fn watch(
    mut source: Source,
    path: Option<PathBuf>,
    args: &QualityArgs,
    config: &Config,
    work_m: f64,
) -> anyhow::Result<Seen> {
    let due = Instant::now() + PATIENCE + Duration::from_secs_f64(args.frames as f64 / MIN_RATE_HZ * 2.0);
    let health = source.health();
    let mut measure: Option<Measure> = None;
    let mut times: Option<(u64, u64)> = None;
    let (mut frames, mut skipped, mut reason) = (0, 0, String::new());
    while frames < args.frames && (health.is_none() || Instant::now() < due) {
        match source.next_frame() {
            Ok(frame) => {
                let [x0, y0, x1, y1] = config.mask.roi.unwrap_or([0, 0, frame.width, frame.height]);
                let region =
                    [x0.min(frame.width), y0.min(frame.height), x1.min(frame.width), y1.min(frame.height)];
                measure.get_or_insert_with(|| Measure::new(&frame, region, work_m)).push(&frame);
                frames += 1;
                let first = times.map_or(frame.timestamp_ns, |times| times.0);
                times = Some((first, frame.timestamp_ns));
            }
            Err(SourceError::BadFrame(why)) => (skipped, reason) = (skipped + 1, why),
            Err(SourceError::Told(_)) => {}
            Err(SourceError::Interrupted(why)) if measure.is_none() => {
                return Err(RecordError::Sensor(why).into());
            }
            Err(SourceError::Interrupted(why)) => (skipped, reason) = (skipped + 1, why),
            Err(SourceError::End) => break,
            Err(SourceError::Failed(why)) => {
                reason = why;
                break;
            }
        }
    }
    let Some(measure) = measure else {
        return Err(match path {
            Some(path) => OpenError::NoFrames { path, reason: format!("; {reason}") }.into(),
            None => RecordError::Sensor(reason).into(),
        });
    };
    let name = health.and_then(|health| health.now().name);
    let elapsed_s = times.map_or(0.0, |(first, last)| last.saturating_sub(first) as f64 * 1e-9);
    Ok(Seen {
        source: name.unwrap_or_else(|| source.describe()),
        measured: measure.finish(args.blade_width_mm * 1e-3),
        skipped,
        rate_hz: (frames > 1 && elapsed_s > 0.0).then(|| (frames - 1) as f64 / elapsed_s),
    })
}

impl Seen {
    fn checks(&self, args: &QualityArgs, config: &Config, work_m: f64) -> Vec<Check> {
        let Measured { frames, fill, plane_noise_at_work_m, temporal_noise_at_work_m, pixels_across, .. } =
            self.measured;
        let (width_mm, needed) = (args.blade_width_mm, f64::from(config.blade.min_pixels_across));
        let nearer_m = work_m * pixels_across / needed;
        let mm = |metres: Option<f64>| metres.map(|metres| metres * 1e3);
        let skipped = self.skipped as f64 / (frames + self.skipped).max(1) as f64;
        let no_plane = "aim it at something flat, such as the wall behind where blades are held, and see that it gives readings there";
        let noisy = "keep sunlight, lamps and other sensors off what it sees, let it warm up for a quarter of an hour, and \
                     choose a mode with a finer unit";
        let steady = "stand it on something that does not shake, keep sunlight and other sensors off what it sees, and let \
                      it warm up for a quarter of an hour";
        let least = |name, unit, found, limit, advice: String| Check {
            name,
            unit,
            found,
            limit,
            is_least: true,
            advice,
        };
        let most = |name, unit, found, limit, advice: String| Check {
            name,
            unit,
            found,
            limit,
            is_least: false,
            advice,
        };
        vec![
            least(
                "fill",
                "",
                Some(fill),
                MIN_FILL,
                "wipe its windows, move away what shines or is black or nearer than it can see, and keep sunlight off; or \
                 set mask.roi to where it sees well"
                    .to_owned(),
            ),
            most(
                "plane_noise",
                "mm",
                mm(plane_noise_at_work_m),
                MAX_NOISE_M * 1e3,
                (if plane_noise_at_work_m.is_none() { no_plane } else { noisy }).to_owned(),
            ),
            most("temporal_noise", "mm", mm(temporal_noise_at_work_m), MAX_NOISE_M * 1e3, steady.to_owned()),
            least(
                "pixels_across",
                "px",
                Some(pixels_across),
                needed,
                format!(
                    "have blades of {width_mm} mm held at {nearer_m:.2} m or nearer, or choose a mode with more pixels \
                     (sensor.size)"
                ),
            ),
            least(
                "frame_rate",
                "/s",
                self.rate_hz,
                MIN_RATE_HZ,
                "choose a mode with more frames a second (sensor.fps), plug it into a port of its own, and not into a hub"
                    .to_owned(),
            ),
            most(
                "skipped",
                "",
                Some(skipped),
                MAX_SKIPPED,
                "change its cable, and plug it into a port of its own, and not into a hub".to_owned(),
            ),
        ]
    }

    fn to_json(&self, checks: &[Check], args: &QualityArgs, work_m: f64) -> Value {
        let Measured { frames, fill, plane_distance_m, plane_noise_m, temporal_noise_m, .. } = self.measured;
        let checks: Vec<Value> = checks
            .iter()
            .map(|check| {
                let limit = if check.is_least { "min" } else { "max" };
                let advice = (!check.passes()).then_some(&check.advice);
                json!({
                    "check": check.name, "unit": check.unit, "found": check.found, limit: check.limit,
                    "pass": check.passes(), "advice": advice,
                })
            })
            .collect();
        json!({
            "source": self.source, "frames": frames, "skipped_frames": self.skipped, "fill": fill,
            "plane_distance_m": plane_distance_m, "plane_noise_m": plane_noise_m,
            "temporal_noise_m": temporal_noise_m, "blade_width_m": args.blade_width_mm * 1e-3,
            "working_distance_m": work_m, "pixels_across": self.measured.pixels_across, "rate_hz": self.rate_hz,
            "checks": checks, "pass": checks_pass(&checks),
        })
    }

    fn page(&self, checks: &[Check], args: &QualityArgs, work_m: f64) -> String {
        let Measured { frames, plane_distance_m, .. } = self.measured;
        let flat = plane_distance_m.map_or_else(
            || "nothing flat is seen".to_owned(),
            |metres| format!("what is flat is {metres:.2} m away"),
        );
        let mut text = format!(
            "{}: {frames} frames, {} skipped; {flat}; noise as it is at {work_m:.2} m, blades of {} mm\n",
            self.source, self.skipped, args.blade_width_mm
        );
        for check in checks {
            let Check { name, unit, found, limit, is_least, advice } = check;
            let found = found.map_or_else(|| "unknown".to_owned(), |found| format!("{found:.2}{unit}"));
            let bound = if *is_least { "at least" } else { "at most" };
            let verdict = if check.passes() { "pass" } else { "FAIL" };
            // Writing to a text does not fail.
            let _ =
                writeln!(text, "{verdict}  {:15} {found:>9}  {bound} {limit}{unit}", name.replace('_', " "));
            if !check.passes() {
                let _ = writeln!(text, "      {advice}");
            }
        }
        text
    }
}

fn checks_pass(checks: &[Value]) -> bool {
    checks.iter().all(|check| check["pass"] == true)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(measured: Measured, rate_hz: Option<f64>, skipped: u64) -> Vec<(&'static str, bool)> {
        let args = QualityArgs {
            recording: None,
            config: ConfigArgs { config: None, sets: Vec::new() },
            frames: 60,
            blade_width_mm: 6.0,
            distance_m: None,
            json: false,
        };
        let seen = Seen { source: "a sensor".to_owned(), measured, skipped, rate_hz };
        let checks = seen.checks(&args, &Config::default(), 0.6);
        let page = seen.page(&checks, &args, 0.6);
        let json = seen.to_json(&checks, &args, 0.6);
        let failing = checks.iter().filter(|check| !check.passes());
        assert!(failing.clone().all(|check| page.contains(&check.advice)), "{page}");
        assert_eq!(json["pass"], failing.count() == 0, "{json}");
        checks.iter().map(|check| (check.name, check.passes())).collect()
    }

    #[test]
    fn each_measure_passes_or_fails_by_itself() {
        let good = Measured {
            frames: 60,
            fill: 0.97,
            plane_distance_m: Some(1.3),
            plane_noise_m: Some(0.003),
            plane_noise_at_work_m: Some(0.0008),
            temporal_noise_m: Some(0.002),
            temporal_noise_at_work_m: Some(0.0006),
            pixels_across: 5.7,
        };
        assert!(seen(good, Some(30.0), 0).iter().all(|(_, passes)| *passes));
        let failing = |measured, rate_hz, skipped| {
            let checks = seen(measured, rate_hz, skipped);
            let mut failing = checks.into_iter().filter(|(_, passes)| !passes).map(|(name, _)| name);
            (failing.next(), failing.next())
        };
        let of = |measured| failing(measured, Some(30.0), 0);
        assert_eq!(of(Measured { fill: 0.5, ..good }), (Some("fill"), None));
        assert_eq!(of(Measured { plane_noise_at_work_m: Some(0.004), ..good }), (Some("plane_noise"), None));
        assert_eq!(of(Measured { plane_noise_at_work_m: None, ..good }), (Some("plane_noise"), None));
        assert_eq!(
            of(Measured { temporal_noise_at_work_m: Some(0.004), ..good }),
            (Some("temporal_noise"), None)
        );
        assert_eq!(of(Measured { pixels_across: 2.0, ..good }), (Some("pixels_across"), None));
        assert_eq!(failing(good, Some(4.0), 0), (Some("frame_rate"), None));
        assert_eq!(failing(good, Some(30.0), 10), (Some("skipped"), None));
    }
}
