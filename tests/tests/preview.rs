//! Does whoever asks see what the station sees, as it sees it, and does capture go on as if nobody did?

use std::collections::BTreeSet;
use std::fs;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

use common::library::library_hash;
use common::preview::{PolylineKind, Preview, SEEN, State};
use common::sealed::SealedBytes;
use glam::Vec2;
use rustix::process::Signal;
use serde_json::{Value, json};
use tests::daemon::Daemon;
use tests::programs::{DEADLINE, Program, Running, wait_for};
use tests::shipped_recording;

const FERN: &str = "format = 1\nknots = [\n  { position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004] },\n  { position_m = [0.0, 0.2, 0.0], half_width_m = [0.0, 0.0] },\n]\n";

type Seen = Preview<SealedBytes>;

/// A station that plays the shipped recording again and again, so many times as fast as it was taken.
fn looping(rate: f64, settings: &[(&str, String)]) -> Daemon {
    let own = [("source.loop", "true".to_owned()), ("source.rate", format!("{rate:?}"))];
    Daemon::start(&[&own[..], settings].concat())
}

/// The events of a replay of the shipped recording.
fn replay() -> Vec<Value> {
    let recording = shipped_recording();
    let finished = Program::Capture.run([Path::new("replay"), &recording, Path::new("--json")]);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    finished.stdout.lines().map(|line| serde_json::from_str(line).expect("JSON Lines")).collect()
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let list = value.as_array().expect("a list");
    assert_eq!(list.len(), N, "{value}");
    std::array::from_fn(|index| list[index].as_f64().expect("a number"))
}

/// What a process has open, by what the kernel calls it.
fn open_files(daemon: &mut Daemon) -> Vec<String> {
    let folder = format!("/proc/{}/fd", daemon.running().id());
    let entries = fs::read_dir(folder).expect("it runs").map(|entry| entry.expect("readable").path());
    // One may be closed meanwhile.
    entries.filter_map(|path| fs::read_link(path).ok()).map(|path| path.display().to_string()).collect()
}

fn previews_open(daemon: &mut Daemon) -> usize {
    open_files(daemon).iter().filter(|name| name.contains("memfd:sward-preview")).count()
}

fn distance_to_line(point: Vec2, line: &[Vec2]) -> f32 {
    let to_segment = |ends: &[Vec2]| {
        let (from, along) = (ends[0], ends[1] - ends[0]);
        let share = (point - from).dot(along) / along.length_squared().max(f32::MIN_POSITIVE);
        point.distance(from + along * share.clamp(0.0, 1.0))
    };
    line.windows(2).map(to_segment).fold(f32::INFINITY, f32::min)
}

#[test]
fn previews_come_frame_by_frame_and_go_through_every_state() {
    let daemon = looping(1.0, &[]);
    let mut station = daemon.connect();
    let mut preview = station.preview(0);
    let first = preview.header().sequence;
    let mut told: Vec<(State, String)> = Vec::new();
    let mut holds = Vec::new();
    let mut seen = 0;
    let told_of = |preview: &Seen| (preview.header().state, preview.code().to_owned());
    // A wait, a hold and a capture; whatever comes first is cut short.
    while told.iter().filter(|told| told.0 == State::Captured).count() < 2 {
        seen += 1;
        let header = *preview.header();
        assert!((header.width, header.height) == (640, 480) && header.window_mm == [300, 900], "{header:?}");
        if told.last() != Some(&told_of(&preview)) {
            told.push(told_of(&preview));
        }
        match header.state {
            State::Settling => holds.push(header.hold),
            State::Captured => assert_eq!(header.hold, 1.0),
            _ => assert_eq!(header.hold, 0.0),
        }
        assert_eq!(header.capture.is_some(), header.state == State::Captured, "{header:?}");
        preview = station.preview(header.sequence);
        assert!(preview.header().sequence > header.sequence);
        let next = *preview.header();
        assert!(next.frame < header.frame || next.timestamp_ns > header.timestamp_ns, "{header:?} {next:?}");
    }
    let frames = preview.header().sequence - first;
    assert!(2 * seen > frames, "{seen} previews of {frames} frames");
    let expected =
        [(State::Waiting, "waiting"), (State::Settling, "hold_still"), (State::Captured, "captured")];
    let start = told.iter().position(|told| told.0 == State::Waiting).expect("it begins with nothing");
    for (index, (state, code)) in told[start..].iter().enumerate() {
        // What the recording shows again was captured before.
        let code = if code == "known" { "captured" } else { code };
        assert_eq!((*state, code), expected[index % 3], "{told:?}");
    }
    assert!(holds.iter().any(|hold| *hold < 0.3) && holds.iter().any(|hold| *hold > 0.7), "{holds:?}");
}

#[test]
fn what_a_loop_shows_again_is_known_and_counted_as_such() {
    // As fast as the stages are, no frame is dropped, so that each time it is the very same.
    let daemon = looping(0.0, &[]);
    let mut station = daemon.connect();
    let preview = station.preview_that(|preview| preview.code() == "known");
    assert_eq!(preview.header().state, State::Captured);
    let status = station.status();
    assert_eq!((&status["captures"], status["repeats"].as_u64() > Some(0)), (&json!(1), true), "{status}");
    let (_, finished) = daemon.end();
    let blades = preview.header().capture.map(|capture| capture.blades as usize);
    assert_eq!(Some(finished.stderr.matches(" captured frame=").count()), blades, "{finished:?}");
}

#[test]
fn what_is_shown_of_a_capture_is_what_a_replay_says_of_it() {
    let events = replay();
    let blades: Vec<&Value> = events.iter().filter(|event| event["event"] == "blade").collect();
    assert!(!blades.is_empty());
    let daemon = looping(1.0, &[]);
    // One that a frame was dropped before, where the machine is busy, is passed over.
    let of_replay = (blades[0]["frame"].as_u64(), blades[0]["timestamp_ns"].as_u64());
    let preview = daemon.connect().preview_that(|preview| {
        let capture = preview.header().capture;
        capture.is_some_and(|capture| (Some(capture.frame), Some(capture.timestamp_ns)) == of_replay)
    });
    let header = preview.header();
    assert_eq!(
        (header.state, header.capture.map(|c| c.blades as usize)),
        (State::Captured, Some(blades.len()))
    );
    assert!(["captured", "known"].contains(&preview.code()), "{}", preview.code());
    assert!(preview.words().contains(&blades.len().to_string()), "{}", preview.words());

    let [fx, fy, cx, cy] = header.camera_px.map(f64::from);
    let width = header.width as usize;
    let depth: Vec<u16> = preview.depth_mm().collect();
    for (blade, label) in blades.iter().zip(1..) {
        let line =
            preview.polylines().find(|line| line.kind() == PolylineKind::Skeleton && line.label() == label);
        let line: Vec<_> = line.expect("each blade has its skeleton").points().collect();
        let mids: Vec<Vec2> = line.iter().map(|point| Vec2::new(point.x, point.y)).collect();
        let knots = blade["knots"].as_array().expect("a list");
        let hausdorff_m = blade["quality"]["hausdorff_m"].as_f64().expect("a number");
        let (mut seen, mut deep, mut of_it) = (0, 0, 0);
        for (index, knot) in knots.iter().enumerate() {
            let [x, y, z] = numbers(&knot["camera_m"]);
            let pixel = Vec2::new((fx * x / z + cx) as f32, (fy * y / z + cy) as f32);
            let near = (hausdorff_m * fx / z) as f32 + 0.5;
            let off = distance_to_line(pixel, &mids);
            assert!(off < near, "knot {index} of blade {label} is {off} px from its skeleton");
            for (knot, end) in [(0, mids[0]), (knots.len() - 1, mids[mids.len() - 1])] {
                assert!(index != knot || pixel.distance(end) < 0.5, "{pixel} is not the end {end}");
            }
            let at = pixel.y.round() as usize * width + pixel.x.round() as usize;
            seen += usize::from(preview.mask()[at] & SEEN != 0);
            deep += usize::from((f64::from(depth[at]) - 1e3 * z).abs() < 12.0);
            of_it += usize::from(u32::from(preview.labels()[at]) == label);
        }
        let most = knots.len() * 3 / 4;
        assert!(seen >= most && deep >= most && of_it >= most, "{seen} {deep} {of_it} of {}", knots.len());
        // Its widest place, as the replay measured it.
        let [x, y, z] = numbers(&knots[knots.len() / 2]["camera_m"]);
        let middle = Vec2::new((fx * x / z + cx) as f32, (fy * y / z + cy) as f32);
        let point = line.iter().min_by(|a, b| {
            let off = |point: &common::preview::Point| middle.distance(Vec2::new(point.x, point.y));
            off(a).total_cmp(&off(b))
        });
        let point = point.expect("it has points");
        let halves: [f64; 2] = numbers(&knots[knots.len() / 2]["half_width_m"]);
        let wide_px = (halves[0] + halves[1]) * fx / z;
        let shown_px = f64::from(point.half_width_left + point.half_width_right);
        // Foreshortened at most: a blade is never narrower than it looks.
        assert!(shown_px < wide_px * 1.15 + 0.5 && shown_px > wide_px * 0.4, "{shown_px} for {wide_px}");
    }
    let inside = |point: &common::preview::Point| {
        (-1.0..=640.0).contains(&point.x) && (-1.0..=480.0).contains(&point.y) && point.half_width_left == 0.0
    };
    let contours: Vec<_> = preview.polylines().filter(|line| line.kind() == PolylineKind::Contour).collect();
    assert!(!contours.is_empty() && contours.iter().all(|line| line.points().all(|point| inside(&point))));
    let labels: BTreeSet<u8> = preview.labels().iter().copied().collect();
    assert!((1..=blades.len() as u8).all(|label| labels.contains(&label)), "{labels:?}");
}

#[test]
fn while_the_hold_runs_contours_are_those_of_the_frame() {
    let daemon = looping(0.3, &[]);
    let preview = daemon.connect().preview_that(|preview| preview.header().state == State::Settling);
    let contours: Vec<_> = preview.polylines().collect();
    assert!(!contours.is_empty() && contours.iter().all(|line| line.kind() == PolylineKind::Contour));
    assert!(preview.labels().iter().all(|label| *label == 0));
    let on_mask = |x: f32, y: f32| {
        let (x, y) = (x.round() as usize, y.round() as usize);
        let near =
            (y.saturating_sub(1)..=y + 1).flat_map(|y| (x.saturating_sub(1)..=x + 1).map(move |x| (x, y)));
        near.filter(|(x, y)| *x < 640 && *y < 480).any(|(x, y)| preview.mask()[y * 640 + x] & SEEN != 0)
    };
    let points: Vec<_> = contours.iter().flat_map(|line| line.points()).collect();
    let on = points.iter().filter(|point| on_mask(point.x, point.y)).count();
    assert!(points.len() > 100 && on * 100 >= points.len() * 99, "{on} of {} points", points.len());
}

#[test]
fn a_source_that_is_over_is_told() {
    let daemon = Daemon::start(&[("source.rate", "0.0".to_owned())]);
    let mut station = daemon.connect();
    let preview = station.preview_that(|preview| preview.header().state == State::NoSource);
    assert_eq!((preview.code(), preview.header().width, preview.polylines().len()), ("call_staff", 0, 0));
    let sequence = preview.header().sequence;
    // From an earlier start, as far as the station can tell.
    assert_eq!(station.preview(sequence + 1000).header().sequence, sequence);
    let negative = station.call("GetPreview", &json!({"after": -1})).0;
    assert_eq!(negative["error"], "io.sward.Station.InvalidSequence", "{negative}");

    let picture = daemon.folder().join("seen.png");
    let shown = daemon.client(&["preview", picture.to_str().expect("UTF-8")]);
    assert_eq!(shown.code, Some(0), "{shown:?}");
    assert!(shown.stdout.contains("call_staff: Please call the staff"), "{shown:?}");
}

#[test]
fn the_picture_shows_depth_mask_and_skeletons() {
    let daemon = looping(0.5, &[]);
    let picture = daemon.folder().join("seen.png");
    let mut looked = || {
        let shown = daemon.client(&["preview", picture.to_str().expect("UTF-8")]);
        assert_eq!((shown.code, shown.stderr.as_str()), (Some(0), ""), "{shown:?}");
        shown.stdout.starts_with("state    captured\n").then_some(shown.stdout)
    };
    let text = wait_for(DEADLINE, &mut looked).expect("it captures");
    for line in ["visitor  ", "frame    ", ", 640×480, ", "% are seen within 300 to 900 mm", "capture  "] {
        assert!(text.contains(line), "no {line:?} in {text}");
    }
    assert!(text.contains("captured: Thank you") || text.contains("known: Thank you"), "{text}");
    let picture = image::open(&picture).expect("a picture").to_rgb8();
    assert_eq!(picture.dimensions(), (1280, 960));
    let count = |is: &dyn Fn([u8; 3]) -> bool| picture.pixels().filter(|pixel| is(pixel.0)).count();
    let (background, midribs) = (count(&|[r, g, b]| b > r && b > g), count(&|rgb| rgb == [255; 3]));
    assert!(background > 600_000 && (200..30_000).contains(&midribs), "{background} {midribs}");

    let missing = daemon.client(&["preview", "/no/such/folder/seen.png"]);
    assert_eq!(missing.code, Some(1), "{missing:?}");
    assert!(missing.stderr.contains("/no/such/folder/seen.png: it cannot be written"), "{missing:?}");
    let only_text = daemon.client(&["preview"]);
    assert!(only_text.code == Some(0) && only_text.stdout.contains("visitor  "), "{only_text:?}");
    assert_eq!(daemon.client(&["preview", "seen.jpg"]).code, Some(2));
}

#[test]
fn nothing_is_made_ready_while_nobody_asks() {
    let mut daemon = looping(4.0, &[]);
    let mut station = daemon.connect();
    let frames =
        |station: &mut tests::station::Station| station.status()["frames"].as_i64().expect("a number");
    let before = frames(&mut station);
    wait_for(DEADLINE, || (frames(&mut station) > before + 60).then_some(())).expect("frames come");
    assert_eq!(previews_open(&mut daemon), 0);
    let preview = station.preview(0);
    assert!(preview.header().sequence > before as u64 + 50, "frames are counted all the same");
    // That of the reply itself is closed a moment after it was sent.
    let kept = wait_for(DEADLINE, || (previews_open(&mut daemon) == 1).then_some(()));
    assert!(kept.is_some(), "one for all readers, until another is asked for");
}

#[test]
fn captures_are_the_same_with_and_without_readers() {
    let events = replay();
    let end = events.last().expect("a replay ends with an event");
    let daemon = Daemon::start(&[("source.rate", "1.0".to_owned())]);
    let socket = daemon.socket();
    let readers: Vec<_> = (0..8)
        .map(|_| {
            let mut station = tests::station::Station::connect(&socket);
            std::thread::spawn(move || {
                let (mut after, mut seen) = (0, 0);
                loop {
                    let preview = station.preview(after);
                    if preview.header().state == State::NoSource {
                        return seen;
                    }
                    (after, seen) = (preview.header().sequence, seen + 1);
                }
            })
        })
        .collect();
    let seen: Vec<u64> =
        readers.into_iter().map(|reader| reader.join().expect("it reads to the end")).collect();
    assert!(seen.iter().all(|seen| *seen > 5), "{seen:?}");
    let mut station = daemon.connect();
    let library = station.library_of_at_least(end["blades"].as_u64().expect("a number") as usize);
    assert_eq!(end["library_hash"].as_str(), Some(library_hash(library.bytes()).as_str()));
    let status = station.status();
    assert_eq!((&status["frames"], &status["captures"]), (&end["frames"], &end["captures"]), "{status}");
}

#[test]
fn a_hundred_readers_of_both_are_served_beside_those_that_stall() {
    let folder = tempfile::tempdir().expect("a folder");
    let blades = folder.path().join("state/blades");
    fs::create_dir_all(&blades).expect("room");
    fs::write(blades.join("fern.toml"), FERN).expect("room");
    let settings = [
        ("capture.hold_s", "60.0".to_owned()),
        ("source.loop", "true".to_owned()),
        ("service.max_connections", "140".to_owned()),
    ];
    let mut daemon = Daemon::start_in(folder, &settings);
    let first = daemon.connect().library(0).generation();
    // They ask for much and read nothing.
    let call = json!({"method": "io.sward.Station.GetPreview", "parameters": {"after": 0}}).to_string();
    let mut stalled: Vec<_> = (0..10).map(|_| daemon.connect()).collect();
    for station in &mut stalled {
        (0..300).for_each(|_| station.send(call.as_bytes()).expect("it fits into the socket"));
    }
    let socket = daemon.socket();
    let readers: Vec<_> = (0..100)
        .map(|number| {
            let mut station = tests::station::Station::connect(&socket);
            std::thread::spawn(move || {
                if number % 2 == 0 {
                    return station.library(first).generation();
                }
                let mut after = 0;
                for _ in 0..20 {
                    let preview = station.preview(after);
                    assert!(preview.header().sequence > after);
                    after = preview.header().sequence;
                }
                after
            })
        })
        .collect();
    let mut station = daemon.connect();
    wait_for(DEADLINE, || (station.status()["clients"].as_i64() >= Some(60)).then_some(()))
        .expect("they come");
    assert_eq!(station.call("SetMix", &json!({"name": "fern", "mix": 3})).0, json!({}));
    let last: Vec<u64> = readers.into_iter().map(|reader| reader.join().expect("it is served")).collect();
    assert!(last.iter().step_by(2).all(|generation| *generation > first), "{last:?}");
    // What was answered is there for who wakes up at last.
    let one = &mut stalled[0];
    let answered =
        (0..100).map(|_| one.reply().expect("it was answered")).filter(|(_, fds)| fds.len() == 1).count();
    assert_eq!(answered, 100);
    drop(stalled);
    wait_for(DEADLINE, || (previews_open(&mut daemon) <= 2).then_some(())).expect("they are given back");
}

#[test]
fn what_a_reader_does_not_take_is_not_kept_for_it() {
    let mut daemon = looping(0.0, &[("mask.near_m", "0.01".to_owned()), ("mask.far_m", "0.02".to_owned())]);
    let (mut greedy, mut station) =
        (UnixStream::connect(daemon.socket()).expect("it listens"), daemon.connect());
    let mut after = 0;
    for _ in 0..150 {
        // Each reply would be of another preview.
        greedy
            .write_all(b"{\"method\":\"io.sward.Station.GetPreview\",\"parameters\":{\"after\":0}}\0")
            .expect("it fits into the socket");
        after = station.preview(after).header().sequence;
    }
    daemon.running().signal(Signal::STOP);
    greedy.set_read_timeout(Some(Duration::from_millis(200))).expect("a socket has a timeout");
    let mut replies = Vec::new();
    // Ends with the timeout, since nothing comes from a station that is stopped.
    let _ = greedy.read_to_end(&mut replies);
    daemon.running().signal(Signal::CONT);
    let kept = replies.iter().filter(|byte| **byte == 0).count();
    assert!((1..50).contains(&kept), "{kept} previews wait for who does not read");
    assert_ne!(station.preview(after).header().sequence, after);
}

#[test]
fn readers_that_are_killed_leave_nothing_behind() {
    let mut daemon = looping(2.0, &[]);
    let watch = |daemon: &Daemon, picture: &Path| {
        let mut command = Program::Capture.command(["preview", "--watch"]);
        command.arg(picture).arg("--socket").arg(daemon.socket());
        let reader = Running::start(command);
        // By then it has mapped one, and holds it.
        wait_for(DEADLINE, || picture.exists().then_some(())).expect("it draws what it sees");
        reader
    };
    let picture = daemon.folder().join("seen.png");
    watch(&daemon, &picture).kill();
    let mut station = daemon.connect();
    let only_we = |station: &mut tests::station::Station| {
        wait_for(DEADLINE, || (station.status()["clients"] == json!(1)).then_some(())).expect("it is gone");
    };
    only_we(&mut station);
    let before = open_files(&mut daemon).len();
    for _ in 0..5 {
        fs::remove_file(&picture).expect("it was drawn");
        watch(&daemon, &picture).kill();
    }
    only_we(&mut station);
    let flat = wait_for(DEADLINE, || (open_files(&mut daemon).len() <= before + 1).then_some(()));
    assert!(flat.is_some(), "{:?}, {before} before", open_files(&mut daemon));
    let preview = station.preview(0);
    assert!(station.preview(preview.header().sequence).header().sequence > preview.header().sequence);
}

#[test]
fn many_previews_leave_nothing_behind() {
    let mut daemon = looping(0.0, &[("mask.near_m", "0.01".to_owned()), ("mask.far_m", "0.02".to_owned())]);
    let kilobytes = |daemon: &mut Daemon| {
        let status = fs::read_to_string(format!("/proc/{}/status", daemon.running().id())).expect("it runs");
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("its memory");
        line.trim().trim_end_matches(" kB").parse::<u64>().expect("a number")
    };
    let mut station = daemon.connect();
    let mut read = |count: u32| {
        let mut after = 0;
        for _ in 0..count {
            after = station.preview(after).header().sequence;
        }
    };
    read(100);
    let (few, before) = (open_files(&mut daemon).len(), kilobytes(&mut daemon));
    read(1000);
    std::thread::sleep(Duration::from_millis(50));
    let flat = wait_for(DEADLINE, || (open_files(&mut daemon).len() <= few + 2).then_some(()));
    assert!(flat.is_some(), "{:?}", open_files(&mut daemon));
    // Frames on their way take some megabytes, or not; previews that were kept would take 1,200.
    assert!(kilobytes(&mut daemon) < before + 65_536, "{} kB, {before} kB before", kilobytes(&mut daemon));
}
