//! Does each fault of a sensor have its fate, and is nothing else harmed by any number of them? `SWARD_SOAK_S=3600` has
//! them befall the station at random for so long, instead of half a minute.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use capture_daemon::source::faulty::FaultKind;
use serde_json::{Value, json};
use tests::daemon::Daemon;
use tests::faulty::{Faulty, count, wait_until};
use tests::process::Process;
use tests::programs::{DEADLINE, wait_for};
use tests::random::Random;
use tests::station::Station;

/// A station on a sensor that is well, and has captured.
fn start(faulty: &Faulty, more: &[(&'static str, &str)]) -> Daemon {
    let mut settings = faulty.settings();
    settings.extend(more.iter().map(|(key, value)| (*key, (*value).to_owned())));
    let daemon = Daemon::start(&settings);
    captures_on(&mut daemon.connect());
    daemon
}

/// Waits until it captures something from now on; how long that took.
fn captures_on(station: &mut Station) -> Duration {
    let start = Instant::now();
    let before = count(&station.status(), "captures");
    wait_until(station, "it captures", |status| count(status, "captures") > before);
    start.elapsed()
}

fn is_absent(status: &Value) -> bool {
    status["sensor"].as_str().is_some_and(|said| said.contains("not plugged in"))
}

#[test]
fn unplugged_it_is_waited_for_and_captures_again_soon_after_its_return() {
    let faulty = Faulty::on("row-3.mcap");
    let daemon = start(&faulty, &[]);
    let mut station = daemon.connect();
    let before = station.status();
    faulty.befalls(&[(0.0, FaultKind::Unplug { for_s: 1000.0 })]);
    let gone = wait_until(&mut station, "it is gone", is_absent);
    assert_eq!(
        (&gone["state"], count(&gone, "sensor_failures")),
        (&json!("no_source"), count(&before, "sensor_failures") + 1)
    );
    let told = station.preview_that(|preview| preview.code() == "reconnecting");
    assert!(told.words().contains("camera is being connected again"), "{}", told.words());
    assert_eq!(station.call("Capture", &json!({})).0["error"], "io.sward.Station.NoFrames");
    faulty.befalls(&[]);
    eprintln!("{:?} from its return to the next capture", captures_on(&mut station));
    station.preview_that(|preview| preview.code() != "reconnecting");
    assert_eq!(station.status()["sensor"], "ok");
}

#[test]
fn a_driver_that_hangs_crashes_or_loses_its_sensor_is_killed_and_another_one_goes_on() {
    let faulty = Faulty::on("row-3.mcap");
    let daemon = start(&faulty, &[]);
    let mut station = daemon.connect();
    let faults = [
        (FaultKind::Hang, "sensor_silences"),
        (FaultKind::Crash, "sensor_deaths"),
        (FaultKind::Reset, "sensor_failures"),
        // Longer than the deadline, so that its process is killed.
        (FaultKind::Stall { for_s: 1.5 }, "sensor_silences"),
    ];
    for (kind, counted) in faults {
        let before = station.status();
        faulty.befalls(&[(0.0, kind)]);
        let after = wait_until(&mut station, "it is counted", |status| {
            count(status, counted) > count(&before, counted)
        });
        let seen = after["sensor_starts"].as_i64() >= before["sensor_starts"].as_i64();
        assert!(seen && after["store"] == "ok", "{after}");
        eprintln!("{kind:?}: {:?} until the next capture", captures_on(&mut station));
    }
}

#[test]
fn a_stall_that_is_shorter_than_the_deadline_costs_nothing_but_its_frames() {
    let faulty = Faulty::on("row-3.mcap");
    let daemon = start(&faulty, &[("sensor.deadline_s", "20.0")]);
    let mut station = daemon.connect();
    let before = station.status();
    faulty.befalls(&[(0.1, FaultKind::Stall { for_s: 1.0 })]);
    std::thread::sleep(Duration::from_millis(1200));
    captures_on(&mut station);
    let after = station.status();
    for same in ["sensor_starts", "sensor_silences", "sensor_deaths", "sensor_failures", "skipped_frames"] {
        assert_eq!(before[same], after[same], "{same}: {after}");
    }
}

#[test]
fn bad_frames_are_skipped_and_lost_ones_counted_and_the_sensor_is_left_alone() {
    let faulty = Faulty::on("row-3.mcap");
    let daemon = start(&faulty, &[]);
    let mut station = daemon.connect();
    let before = station.status();
    faulty.befalls(&[
        (0.3, FaultKind::Zero { frames: 7 }),
        (0.9, FaultKind::Short { frames: 5 }),
        (1.5, FaultKind::Lost { frames: 6 }),
        (2.1, FaultKind::Torn { frames: 4 }),
    ]);
    let more = |status: &Value, field: &str| count(status, field) - count(&before, field);
    wait_until(&mut station, "they are counted", |status| {
        more(status, "skipped_frames") >= 12 && more(status, "lost_frames") >= 6
    });
    std::thread::sleep(Duration::from_secs(1));
    captures_on(&mut station);
    let after = station.status();
    assert_eq!(more(&after, "skipped_frames"), 12, "{after}");
    assert_eq!((more(&after, "sensor_starts"), after["sensor"].as_str()), (0, Some("ok")), "{after}");
    let (_, finished) = daemon.end();
    let said = finished.stderr.matches("frames were skipped").count();
    assert_eq!(said, 1, "once a minute: {}", finished.stderr);
}

#[test]
fn a_clock_that_steps_ends_no_hold_and_noise_no_station() {
    let faulty = Faulty::on("row-3.mcap");
    let daemon = start(&faulty, &[]);
    let mut station = daemon.connect();
    for step_s in [-7200.0, 7200.0] {
        let before = station.preview(0).header().timestamp_ns;
        faulty.befalls(&[(0.0, FaultKind::Clock { step_s })]);
        let stepped = |timestamp_ns: u64| {
            let moved_s = (timestamp_ns as f64 - before as f64) * 1e-9;
            (moved_s - step_s).abs() < 600.0
        };
        station.preview_that(|preview| stepped(preview.header().timestamp_ns));
        captures_on(&mut station);
        // The next script's clock is well again: a step the other way.
        faulty.befalls(&[]);
        captures_on(&mut station);
    }
    faulty.befalls(&[(0.0, FaultKind::Noise { to_mm: 60.0, for_s: 2.0 })]);
    std::thread::sleep(Duration::from_secs(2));
    captures_on(&mut station);
    assert_eq!(station.status()["sensor"], "ok");
}

#[test]
fn of_a_burst_what_finds_no_room_is_counted_and_the_others_come() {
    let faulty = Faulty::on("row-3.mcap");
    let daemon = start(&faulty, &[]);
    let mut station = daemon.connect();
    let before = station.status();
    faulty.befalls(&[(0.3, FaultKind::Burst { frames: 25 })]);
    std::thread::sleep(Duration::from_millis(1500));
    captures_on(&mut station);
    let after = station.status();
    assert_eq!(after["sensor_starts"], before["sensor_starts"], "{after}");
    let came =
        ["frames", "dropped_frames", "lost_frames"].map(|field| count(&after, field) - count(&before, field));
    assert!(came[0] > 8, "some come: {came:?}");
}

/// What befalls it next, and for how long it is away.
fn any_fault(random: &mut Random) -> (FaultKind, f64) {
    let for_s = random.within(0.3, 4.0);
    let frames = 1 + random.below(20) as u64;
    match random.below(12) {
        0 | 1 => (FaultKind::Unplug { for_s }, for_s),
        2 => (FaultKind::Stall { for_s }, for_s),
        3 => (FaultKind::Hang, 0.0),
        4 => (FaultKind::Crash, 0.0),
        5 => (FaultKind::Reset, 0.0),
        6 => (FaultKind::Torn { frames }, 0.0),
        7 => (FaultKind::Short { frames }, 0.0),
        8 => (FaultKind::Zero { frames }, 0.0),
        9 => (FaultKind::Burst { frames }, 0.0),
        10 => (FaultKind::Clock { step_s: random.within(-30.0, 30.0) }, 0.0),
        _ => (FaultKind::Noise { to_mm: random.within(1.0, 40.0), for_s }, for_s),
    }
}

/// The library's ids.
fn ids(station: &mut Station) -> BTreeSet<String> {
    station.library(0).blades().map(|blade| blade.id().to_string()).collect()
}

#[test]
fn whatever_befalls_the_sensor_no_blade_is_lost_and_the_station_stays_as_small() {
    let seconds: f64 = std::env::var("SWARD_SOAK_S").map_or(30.0, |text| text.parse().expect("seconds"));
    let faulty = Faulty::on("row-3.mcap");
    // Each process of the sensor lasts a moment only, so waits that double would grow to a minute.
    let more = [
        ("record.ring_s", "2.0"),
        ("record.max_mb", "50.0"),
        ("record.save_on", "[\"sensor\", \"dropped\"]"),
    ];
    let mut daemon = start(&faulty, &more);
    let process = Process(daemon.running().id());
    let mut station = daemon.connect();
    let mut random = Random::new(97);
    let start = Instant::now();
    let (mut kinds, mut returns_ms, mut looks) = (BTreeMap::new(), Vec::new(), Vec::new());
    let mut announced = BTreeSet::new();
    let mut is_first = true;
    while is_first || start.elapsed().as_secs_f64() < seconds {
        is_first = false;
        let (kind, away_s) = any_fault(&mut random);
        *kinds.entry(format!("{kind:?}").split(' ').next().unwrap_or_default().to_owned()).or_insert(0) += 1;
        faulty.befalls(&[(0.0, kind)]);
        std::thread::sleep(Duration::from_secs_f64(away_s + 0.05));
        // A driver that hangs is noticed at the deadline, and what was unplugged is told as such.
        if matches!(kind, FaultKind::Hang) {
            wait_until(&mut station, "its driver is killed", |status| status["state"] == "no_source");
            let told = station.preview_that(|preview| preview.header().width == 0);
            assert!(["reconnecting", "call_staff"].contains(&told.code()), "{}", told.code());
        }
        returns_ms.push(captures_on(&mut station).as_millis());
        let shown = station.preview_that(|preview| preview.header().width > 0);
        assert!(!["reconnecting", "call_staff"].contains(&shown.code()), "{}", shown.code());
        // It streams for as long as it takes to be trusted again.
        std::thread::sleep(Duration::from_millis(1200));
        let held = ids(&mut station);
        assert!(held.is_superset(&announced), "a blade is lost");
        announced = held;
        if announced.len() > 500 {
            let names: Vec<String> =
                station.library(0).blades().map(|blade| blade.name().to_owned()).collect();
            for name in names {
                let (reply, _) = station.call("RemoveBlade", &json!({"name": name}));
                assert!(reply.get("error").is_none(), "{reply}");
            }
            announced = ids(&mut station);
        }
        looks.push((process.resident_kib(), process.descriptors()));
    }
    // The last second's frames may still become blades.
    faulty.befalls(&[(0.0, FaultKind::Unplug { for_s: 1000.0 })]);
    wait_until(&mut station, "it is gone", is_absent);
    let status = wait_until(&mut station, "all is kept", |status| count(status, "waiting") == 0);
    assert_eq!((count(&status, "lost"), count(&status, "refused_files")), (0, 0), "{status}");
    announced = ids(&mut station);
    let (folder, finished) = daemon.end();
    assert!(finished.code == Some(0) && !finished.stderr.contains("panicked"), "{finished:?}");
    let hours = start.elapsed().as_secs_f64() / 3600.0;
    let slowest = returns_ms.iter().max();
    eprintln!(
        "{hours:.3} h, {kinds:?}: captures again after {slowest:?} ms at most, {returns_ms:?}; KiB and descriptors {looks:?}; {status}"
    );
    // Each blade is whole on disk.
    let daemon = Daemon::start_in(folder, &[]);
    let mut station = daemon.connect();
    let again = wait_for(DEADLINE, || Some(ids(&mut station)).filter(|again| again.is_superset(&announced)));
    assert!(again.is_some(), "blades are missing after a restart");
    assert_eq!(count(&station.status(), "refused_files"), 0);
    // Of many looks: those of the second half are no larger than of the first.
    if looks.len() >= 20 {
        let (early, late) = looks.split_at(looks.len() / 2);
        let memory = |looks: &[(u64, usize)]| looks.iter().map(|look| look.0).max().unwrap_or(0);
        let descriptors = |looks: &[(u64, usize)]| looks.iter().map(|look| look.1).max().unwrap_or(0);
        assert!(memory(late) <= memory(early) + 16 * 1024, "memory grows: {looks:?}");
        assert!(descriptors(late) <= descriptors(early) + 4, "descriptors grow: {looks:?}");
    }
}
