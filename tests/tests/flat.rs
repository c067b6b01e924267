//! Does the station stay as small as it was, however often it publishes? `SWARD_PUBLISHES=100000`
//! publishes so often, instead of 1,000 times.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use serde_json::json;
use tests::daemon::Daemon;
use tests::process::Process;
use tests::programs::{DEADLINE, wait_for};
use tests::station::Station;

const FERN: &str = "format = 1\nknots = [\n  { position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004] },\n  { position_m = [0.0, 0.2, 0.0], half_width_m = [0.0, 0.0] },\n]\n";
/// Readers that wait for each generation.
const READERS: usize = 4;
/// How often memory and descriptors are looked at.
const LOOKS: usize = 20;
/// Pages that an allocator takes at its leisure, KiB. A leak of 100 bytes a publish is four times as much in the
/// second half of 100,000.
const SLACK_KIB: u64 = 1024;

/// A reader of every generation, until the station goes; counts what it got.
fn reader(mut station: Station, got: Arc<AtomicU64>, is_over: Arc<AtomicBool>) {
    let mut after = 0;
    while !is_over.load(Ordering::Relaxed) {
        let Ok(library) = station.try_library(after) else { return };
        after = library.generation();
        got.fetch_add(1, Ordering::Relaxed);
    }
}

#[test]
fn memory_and_descriptors_are_flat_over_many_publishes() {
    let publishes: usize =
        std::env::var("SWARD_PUBLISHES").map_or(1000, |number| number.parse().expect("a whole number"));
    let folder = tempfile::tempdir().expect("a folder");
    let blades = folder.path().join("state/blades");
    std::fs::create_dir_all(&blades).expect("room");
    for number in 0..16 {
        let text = FERN.replace("0.2", &format!("{:?}", 0.1 + 0.01 * f64::from(number)));
        std::fs::write(blades.join(format!("b{number}.toml")), text).expect("room");
    }
    // Nothing is held at that distance: frames that are added up for a capture take memory too.
    let settings = [
        ("source.rate", "0.0".to_owned()),
        ("mask.near_m", "0.01".to_owned()),
        ("mask.far_m", "0.02".to_owned()),
    ];
    let mut command = Daemon::command(folder.path(), &settings);
    command.env("SWARD_LOG", "warn");
    let mut daemon = Daemon::start_command(folder, command);
    let process = Process(daemon.running().id());
    let (got, is_over) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicBool::new(false)));
    let readers: Vec<_> = (0..READERS)
        .map(|_| {
            let (station, got, is_over) = (daemon.connect(), Arc::clone(&got), Arc::clone(&is_over));
            std::thread::spawn(move || reader(station, got, is_over))
        })
        .collect();
    let mut station = daemon.connect();
    let first = station.library(0).generation();
    let mut done = 0;
    let mut publish = |count: usize| {
        for _ in 0..count {
            done += 1;
            let (name, mix) = (format!("b{}", done % 16), done % 1000);
            assert_eq!(station.call("SetMix", &json!({"name": name, "mix": mix})).0, json!({}));
        }
    };
    let start = Instant::now();
    // Until the pools of whatever keeps some are full.
    publish(publishes / 10);
    let looks: Vec<(u64, usize)> = (0..LOOKS)
        .map(|_| {
            publish((publishes - publishes / 10) / LOOKS);
            (process.resident_kib(), process.descriptors())
        })
        .collect();
    let seconds = start.elapsed().as_secs_f64();
    is_over.store(true, Ordering::Relaxed);
    // One more, for whoever waits for it.
    publish(1);
    for reader in readers {
        reader.join().expect("a reader gets valid libraries to the end");
    }
    let last = daemon.connect().library(0).generation();
    let (generations, got) = (last - first, got.load(Ordering::Relaxed));
    eprintln!(
        "{generations} generations in {seconds:.1} s, {got} received by {READERS} readers; KiB and descriptors: {looks:?}"
    );
    assert!(generations as usize >= publishes * 9 / 10, "{generations} generations");
    // On a busy machine they get the newest, and not each.
    assert!(got > generations / 10, "the readers are served: {got} of {generations} each");
    let most = |looks: &[(u64, usize)]| looks.iter().map(|look| look.0).max().expect("some");
    let (early, late) = looks.split_at(LOOKS / 2);
    assert!(most(late) <= most(early) + SLACK_KIB, "resident memory grows: {looks:?}");
    // A reply on its way has a descriptor of its own, and there are as many as there are readers.
    let few = looks.iter().map(|look| look.1).min().expect("some");
    assert!(looks.iter().all(|look| look.1 <= few + READERS + 2), "descriptors grow: {looks:?}");
    let settled = wait_for(DEADLINE, || (process.descriptors() <= few).then_some(()));
    assert!(settled.is_some(), "{} descriptors at the end, {few} before", process.descriptors());
}
