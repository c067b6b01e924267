//! Where the time of a frame and of a capture goes, beside what OpenCV needs for four of its calls on the
//! same frames, and how much memory a long replay takes: `make bench`.
//!
//! One thread, in that thread's own processor time: what else runs on the machine takes its turns without being
//! counted. Medians; both in turn, so that whatever else the machine does falls on both, and both as often in
//! a row, so that neither is timed mostly on caches that the other one left behind. `SWARD_PYTHON` names a Python
//! with OpenCV; without it that column is empty. Slowness is no error: the table states the ratios, and the
//! targets that they are held against.

mod opencv;
mod preview;

use std::hint::black_box;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use self::opencv::OpenCv;
use anyhow::Context;
use capture_daemon::frame::{CameraPose, DepthFrame};
use capture_daemon::pipeline::{self, PipelineParams};
use capture_daemon::recording;
use capture_daemon::session::{Session, SessionParams};
use capture_daemon::source::SourceError;
use capture_daemon::stages::accumulate::Accumulation;
use capture_daemon::stages::confidence::Evidence;
use capture_daemon::stages::{blade, contour, lift, margin, mask, partition, presence, ribbon, skeleton};
use capture_daemon::synth::{Clip, ClipParams, Family, Scene};
use rustix::time::{ClockId, clock_gettime};

/// Frames that are replayed to see whether memory stays flat.
const REPLAYED: u64 = 10_000;
/// Times in a row that the same is measured, before it is the other one's turn.
const TURN: usize = 10;
/// What it must stay under, MiB.
const MEMORY_MIB: u64 = 96;

fn main() -> anyhow::Result<()> {
    // `cargo test` runs benches too, with nothing to measure; the second process only replays.
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let Some(at) = arguments.iter().position(|argument| argument == "--replay") {
        let recording = arguments.get(at + 1).context("--replay needs a recording")?;
        return replay(Path::new(recording));
    }
    if !arguments.iter().any(|argument| argument == "--bench") {
        return Ok(());
    }
    let clip = fan_of_seven()?;
    let shown = clip.visible();
    let fan: Vec<DepthFrame> = (shown.start..shown.start + 20).map(|index| clip.frame(index)).collect();
    let empty = Clip::new(Scene::new(Family::Empty, 1), ClipParams::default())?.frame(0);
    let mut opencv = OpenCv::start(&[&empty, &fan[18]])?;
    let (of_empty, of_fan) = (0, 1);

    println!("640x480, processor time of one thread, medians\n");
    println!("| what | ms | OpenCV's four calls, ms | ratio | target |");
    println!("|---|---|---|---|---|");
    let params = SessionParams::default();
    // `measure` takes its times once a round; OpenCV's turn comes between.
    let mut in_turn =
        |name: &str, rounds: usize, measure: &mut dyn FnMut(&mut Vec<f64>), frame: usize, target: f64| {
            let (mut ours, mut theirs) = (Vec::new(), Vec::new());
            for _ in 0..rounds {
                measure(&mut ours);
                if let Some(opencv) = &mut opencv {
                    theirs.extend(opencv.times_ms(frame, TURN)?);
                }
            }
            let ms = median(ours);
            let (opencv, ratio) = if theirs.is_empty() {
                ("–".to_owned(), "–".to_owned())
            } else {
                let opencv = median(theirs);
                (format!("{opencv:.3}"), format!("{:.2}", ms / opencv))
            };
            println!("| {name} | {ms:.3} | {opencv} | {ratio} | {target} |");
            anyhow::Ok(())
        };

    let mut session = Session::new(params.clone());
    let mut empty_frames = |times: &mut Vec<f64>| {
        for _ in 0..TURN {
            let start = thread_time();
            black_box(session.push(&empty));
            times.push(ms_since(start));
        }
    };
    in_turn("empty frame", 40, &mut empty_frames, of_empty, 0.7)?;
    let mut captured_early = false;
    let mut settling_frames = |times: &mut Vec<f64>| {
        let mut session = Session::new(params.clone());
        // The first of a hold makes room; the rest is what a frame costs.
        black_box(session.push(&fan[0]));
        for frame in &fan[1..16] {
            let start = thread_time();
            let captured = black_box(session.push(frame));
            times.push(ms_since(start));
            captured_early |= captured.is_some();
        }
    };
    in_turn("settling frame", 20, &mut settling_frames, of_fan, 2.0)?;
    anyhow::ensure!(!captured_early, "a frame that should settle was captured");

    let mut held = Accumulation::like(&fan[0]);
    fan[..17].iter().for_each(|frame| held.add(frame, &params.pipeline.mask));
    let (camera, time) = (fan[0].camera, fan[16].timestamp_ns);
    let capture = || pipeline::capture(&held, &camera, time, &params.pipeline);
    let steps = capture();
    let name = format!("capture of a fan of {} ({} found)", clip.scene().blades.len(), steps.blades.len());
    let mut captures = |times: &mut Vec<f64>| {
        for _ in 0..TURN {
            let start = thread_time();
            black_box(capture());
            times.push(ms_since(start));
        }
    };
    in_turn(&name, 20, &mut captures, of_fan, 15.0)?;
    println!("\n| stage | ms |\n|---|---|");
    println!(
        "| presence (each frame) | {:.3} |",
        median_ms(200, || {
            black_box(presence::presence(&fan[0], &params.pipeline.mask));
        })
    );
    stages(&held, &fan[16], &params.pipeline, steps.blades.len())?;
    preview::times(&fan)?;
    memory()
}

/// Prints the time of each stage of a capture.
fn stages(
    held: &Accumulation,
    frame: &DepthFrame,
    params: &PipelineParams,
    blades: usize,
) -> anyhow::Result<()> {
    let down = params.pose.down_in_image();
    let of_parts =
        partition::PartitionParams { camera: frame.camera, pose: params.pose, ..Default::default() };
    let of_ribbons = ribbon::RibbonParams { down, ..Default::default() };
    let mask = timed("mask", || mask::extract(held, &params.mask));
    let (pieces, blobs) =
        timed("contour", || (contour::trace(&mask, &mask.pieces), contour::trace(&mask, &mask.blobs)));
    let parts: Vec<_> = timed("partition", || {
        pieces.iter().flat_map(|outline| partition::flow(&mask, &mask.pieces, outline, &of_parts)).collect()
    });
    let fields: Vec<_> = timed("distance from the root", || {
        blobs.iter().map(|outline| partition::root_distance(&mask, &mask.blobs, outline, &of_parts)).collect()
    });
    let ribbons = timed("ribbon", || ribbon::grow(&mask, &parts, &fields, &of_ribbons));
    let skeletons: Vec<_> = timed("skeleton", || {
        ribbons
            .iter()
            .filter_map(|ribbon| Some((ribbon, skeleton::trace(&mask, ribbon, &frame.camera)?)))
            .collect()
    });
    let lifted: Vec<_> = timed("lift", || {
        skeletons.iter().map(|(ribbon, s)| (*ribbon, lift::lift(&mask, s, &frame.camera))).collect()
    });
    let window_m = [params.mask.near_m as f32, params.mask.far_m as f32];
    let accepted: Vec<_> = lifted
        .iter()
        .map(|(ribbon, lifted)| {
            let margins = margin::look(&mask, ribbon, window_m);
            let evidence = Evidence::of(ribbon, lifted, &margins, mask.frames, mask.depth_noise_m);
            (lifted, margins, evidence)
        })
        .filter(|(lifted, margins, evidence)| {
            blade::accept(lifted, margins, evidence, &params.accept).is_ok()
        })
        .map(|(lifted, _, evidence)| (lifted, evidence))
        .collect();
    let finished = timed("refine and blade", || {
        blade::finish(&accepted, 0, &CameraPose::default(), &params.refine).0.len()
    });
    anyhow::ensure!(finished == blades, "{finished} blades stage by stage, {blades} in all");
    Ok(())
}

fn timed<T>(name: &str, mut work: impl FnMut() -> T) -> T {
    let ms = median_ms(20, || {
        black_box(work());
    });
    println!("| {name} | {ms:.3} |");
    work()
}

/// The first fan of seven blades of which all are found.
fn fan_of_seven() -> anyhow::Result<Clip> {
    for seed in 1..200 {
        let scene = Scene::new(Family::Fan, seed);
        if scene.blades.len() != 7 {
            continue;
        }
        let clip = Clip::new(scene, ClipParams::default())?;
        let mut session = Session::new(SessionParams::default());
        let capture = clip.frames().find_map(|frame| session.push(&frame));
        if capture.is_some_and(|capture| capture.steps.blades.len() == 7) {
            return Ok(clip);
        }
    }
    anyhow::bail!("no fan of seven blades was captured as one")
}

/// Replays a shipped recording again and again in a process of its own and prints its memory.
fn memory() -> anyhow::Result<()> {
    let recording = Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings/fan-9.mcap");
    let output = Command::new(std::env::current_exe()?).arg("--replay").arg(recording).output()?;
    anyhow::ensure!(
        output.status.success(),
        "the replay failed: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    print!("\n{}", String::from_utf8_lossy(&output.stdout));
    Ok(())
}

fn replay(path: &Path) -> anyhow::Result<()> {
    let mut session = Session::new(SessionParams::default());
    let mut source = recording::open(path, &Default::default())?;
    let (mut early, mut captures) = (0, 0);
    let start = Instant::now();
    while session.frames() < REPLAYED {
        match source.next_frame() {
            Ok(frame) => {
                captures += u32::from(session.push(&frame).is_some());
                if session.frames() == REPLAYED / 10 {
                    early = peak_kib()?;
                }
            }
            Err(SourceError::End) => source = recording::open(path, &Default::default())?,
            Err(error) => anyhow::bail!("{error:?}"),
        }
    }
    let (peak, seconds) = (peak_kib()?, start.elapsed().as_secs_f64());
    let mib = |kib: u64| kib as f64 / 1024.0;
    println!(
        "{REPLAYED} frames replayed with {captures} captures in {seconds:.1} s: peak memory {:.1} MiB \
         ({:.1} MiB after {}), target below {MEMORY_MIB} MiB",
        mib(peak),
        mib(early),
        REPLAYED / 10,
    );
    Ok(())
}

/// The largest resident set of this process so far, KiB.
fn peak_kib() -> anyhow::Result<u64> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).context("no VmHWM")?;
    Ok(line.trim().trim_end_matches("kB").trim().parse()?)
}

fn median_ms(times: usize, mut work: impl FnMut()) -> f64 {
    let measured = (0..times).map(|_| {
        let start = thread_time();
        work();
        ms_since(start)
    });
    median(measured.collect())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Processor time that this thread has taken.
fn thread_time() -> Duration {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(now.tv_sec.unsigned_abs(), now.tv_nsec as u32)
}

fn ms_since(start: Duration) -> f64 {
    (thread_time() - start).as_secs_f64() * 1e3
}
