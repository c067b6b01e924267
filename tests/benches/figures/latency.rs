//! From the last frame of a capture to the first picture that shows its blades.

use std::collections::HashMap;
use std::sync::mpsc::Receiver;
use std::time::Instant;

use serde_json::{Value, json};
use tests::daemon::Daemon;
use tests::log::{Line, listen};
use tests::programs::{DEADLINE, Program, Running};

use crate::table::Table;

/// Captures of each recording.
const CAPTURES: usize = 24;
/// Pixels of the picture: small, since a software rasteriser takes its time for each of them.
const SIZE: &str = "320x180";
/// What the programs say on the way.
const STEPS: &[&str] = &["frame due", "stages done", "announced", "new library", "drawn"];

/// A capture's way into the picture; the moment of each step.
#[derive(Clone, Copy)]
struct Way {
    due: Instant,
    stages_done: Instant,
    announced: Instant,
    received: Option<Instant>,
    drawn: Option<Instant>,
}

/// Measures, and adds rows.
pub(crate) fn measure(table: &mut Table) {
    for recording in ["recordings/held-2.mcap", "recordings/fan-9.mcap"] {
        let path = format!("{:?}", tests::root().join(recording));
        let (ways, pictures) = follow(path);
        let ms = |from: fn(&Way) -> Instant, to: fn(&Way) -> Option<Instant>| {
            let spans =
                ways.iter().filter_map(|way| Some((to(way)?.duration_since(from(way))).as_secs_f64()));
            spans.map(|seconds| 1e3 * seconds).collect::<Vec<f64>>()
        };
        let name = recording.trim_start_matches("recordings/").trim_end_matches(".mcap");
        let whole =
            format!("**{name}: last frame of the capture is due → first picture with its blades is drawn**");
        table.row(&whole, "ms", ms(|way| way.due, |way| way.drawn));
        table.row(
            &format!("{name}: … of that, until the stages are done"),
            "ms",
            ms(|way| way.due, |way| Some(way.stages_done)),
        );
        table.row(
            &format!("{name}: … until the blades are on disk and the library announced"),
            "ms",
            ms(|way| way.stages_done, |way| Some(way.announced)),
        );
        table.row(
            &format!("{name}: … until the renderer has received and checked it"),
            "ms",
            ms(|way| way.announced, |way| way.received),
        );
        let received = |way: &Way| way.received.unwrap_or(way.announced);
        table.row(
            &format!("{name}: … until a picture with it is drawn and read back"),
            "ms",
            ms(received, |way| way.drawn),
        );
        table.row(&format!("{name}: one picture of {SIZE} on its own, software Vulkan"), "ms", pictures);
    }
}

/// Has the daemon play `recording` again and again in real time beside a renderer, until there are
/// enough captures of blades that were not there before. Their ways; and the time of each picture, ms.
fn follow(recording: String) -> (Vec<Way>, Vec<f64>) {
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("station.toml");
    // Other knots are other blades: else a loop shows only what is known.
    let knots =
        |number: usize| std::fs::write(&config, format!("refine.knots = {}\n", 8 + number)).expect("room");
    knots(0);
    let settings = [("source.loop", "true".to_owned()), ("source.recording", recording)];
    let mut command = Daemon::command(folder.path(), &settings);
    command.env(
        "SWARD_LOG",
        "info,capture_daemon::feed=trace,capture_daemon::frames=debug,capture_daemon::keeper=debug",
    );
    let out = folder.path().join("pictures");
    let (heard, told) = listen(STEPS);
    let daemon = Daemon::start_followed(folder, command, heard.clone());
    let mut render = Program::Render.command(["--headless", "--frames", "1000000", "--size", SIZE]);
    render.args(["--wait-blades", "1", "--socket"]).arg(daemon.socket()).arg("--out").arg(&out);
    let renderer = Running::follow(render, heard);

    let mut station = daemon.connect();
    let mut seen = Seen::default();
    // The renderer's first picture is of a library that was there before.
    seen.until(&told, |seen| !seen.drawn.is_empty());
    for number in 1..=CAPTURES {
        knots(number);
        assert_eq!(station.call("Reload", &json!({})).0["error"], Value::Null);
        let before = seen.ways.len();
        seen.until(&told, |seen| seen.ways.len() > before);
        let generation = seen.ways.last().expect("it just came").0;
        seen.until(&told, |seen| seen.drawn.keys().any(|drawn| *drawn >= generation));
    }
    drop((renderer, daemon));
    let first = seen.ways.len() - CAPTURES;
    let ways = seen.ways[first..].iter().map(|(generation, way)| Way {
        received: seen.received.get(generation).copied(),
        drawn: seen.drawn.get(generation).copied(),
        ..*way
    });
    (ways.collect(), seen.pictures_ms)
}

/// What was heard so far.
#[derive(Default)]
struct Seen {
    due: HashMap<u64, Instant>,
    done: Option<(Instant, Instant)>,
    ways: Vec<(u64, Way)>,
    received: HashMap<u64, Instant>,
    /// The first picture of each generation.
    drawn: HashMap<u64, Instant>,
    pictures_ms: Vec<f64>,
}

impl Seen {
    /// Listens until something holds.
    fn until(&mut self, told: &Receiver<Line>, holds: impl Fn(&Self) -> bool) {
        while !holds(self) {
            self.hear(&told.recv_timeout(DEADLINE).expect("both programs are at work"));
        }
    }

    fn hear(&mut self, line: &Line) {
        let generation = || line.field::<u64>("generation").expect("it is said");
        let timestamp = || line.field::<u64>("timestamp_ns").expect("it is said");
        if line.says("frame due") {
            self.due.insert(timestamp(), line.at);
        } else if line.says("stages done") {
            self.done = self.due.get(&timestamp()).map(|due| (*due, line.at));
        } else if line.says("announced") {
            if let Some((due, stages_done)) = self.done.take() {
                let way = Way { due, stages_done, announced: line.at, received: None, drawn: None };
                self.ways.push((generation(), way));
            }
        } else if line.says("new library") {
            self.received.insert(generation(), line.at);
        } else {
            self.drawn.entry(generation()).or_insert(line.at);
            self.pictures_ms.push(1e3 * line.field::<f64>("seconds").expect("it is said"));
        }
    }
}
