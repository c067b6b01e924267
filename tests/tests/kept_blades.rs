//! Is every blade that was announced there again, whole, whatever becomes of the daemon and its disk?
//! `SWARD_KILLS=1000` kills it so often, instead of 20 times.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use common::library::BladeView;
use serde_json::{Value, json};
use tests::daemon::Daemon;
use tests::log::{Line, listen};
use tests::programs::{DEADLINE, Program, Running, wait_for};
use tests::station::Station;

const FERN: &str = "format = 1\nknots = [\n  { position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004] },\n  { position_m = [0.0, 0.2, 0.0], half_width_m = [0.0, 0.0] },\n]\n";

/// Nothing is captured but by `Capture`.
fn by_hand() -> Vec<(&'static str, String)> {
    vec![("capture.hold_s", "60.0".to_owned()), ("source.loop", "true".to_owned())]
}

/// Captures what the recording shows; it begins with nothing.
fn capture(station: &mut Station) -> Value {
    let answer = wait_for(DEADLINE, || {
        let (reply, _) = station.call("Capture", &json!({}));
        (reply["error"] != "io.sward.Station.NothingHeld").then_some(reply)
    });
    answer.expect("the recording shows something")
}

fn ids(station: &mut Station) -> BTreeSet<String> {
    station.library(0).blades().map(|blade| blade.id().to_string()).collect()
}

fn names(station: &mut Station) -> Vec<String> {
    station.library(0).blades().map(|blade| blade.name().to_owned()).collect()
}

/// The first library that satisfies this.
fn library_with(station: &mut Station, what: impl Fn(&[BladeView<'_>]) -> bool) {
    let start = Instant::now();
    let mut library = station.library(0);
    while !what(&library.blades().collect::<Vec<_>>()) {
        assert!(start.elapsed() < DEADLINE, "it does not come");
        library = station.library(library.generation());
    }
}

/// The real renderer beside a daemon that comes and goes.
struct Meadow {
    _renderer: Running,
    told: Receiver<Line>,
    pictures: u64,
    generation: u64,
    libraries: u64,
}

impl Meadow {
    fn follow(socket: &Path, out: &Path) -> Self {
        let (heard, told) = listen(&["drawn", "new library", "library refused"]);
        // Straight down, where few blades stand: many pictures for the processor.
        let view = ["--pitch-deg", "-89", "--fov-deg", "10", "--size", "64x36"];
        let mut command = Program::Render.command(["--headless", "--frames", "100000000"]);
        command.args(view);
        command.arg("--socket").arg(socket).arg("--out").arg(out);
        let _renderer = Running::follow(command, heard);
        Self { _renderer, told, pictures: 0, generation: 0, libraries: 0 }
    }

    /// The next line; pictures come one after the other, and none shows less than the one before.
    fn hear(&mut self) -> Line {
        let line = self.told.recv_timeout(DEADLINE).expect("the picture does not stop");
        assert!(!line.says("library refused"), "{}", line.text);
        if line.says("drawn") {
            assert_eq!(line.field("index"), Some(self.pictures), "{}", line.text);
            let generation = line.field("generation").expect("it is said");
            assert!(generation >= self.generation, "{} is shown before {}", self.generation, line.text);
            self.pictures += 1;
            self.generation = generation;
        } else {
            self.libraries += 1;
        }
        line
    }

    /// Waits for two pictures after `moment`: the second was begun after it.
    fn goes_on(&mut self, moment: Instant) {
        let mut pictures = 0;
        while pictures < 2 {
            let line = self.hear();
            pictures += u32::from(line.says("drawn") && line.at > moment);
        }
    }
}

#[test]
fn killed_at_any_moment_it_has_every_blade_that_it_announced_and_the_picture_goes_on() {
    let mut folder = tempfile::tempdir().expect("a folder");
    let pictures = tempfile::tempdir().expect("a folder");
    let mut meadow = Meadow::follow(&folder.path().join("station.socket"), pictures.path());
    let (mut announced, mut generation) = (BTreeSet::new(), 0u64);
    let mut grown = 0;
    // Of a round, until it is killed at the latest: time enough to capture on this machine, as it is today.
    let mut longest = Duration::from_millis(400);
    let kills = std::env::var("SWARD_KILLS").map_or(20, |kills| kills.parse().expect("a whole number"));
    for round in 0..kills {
        // Other knots are other blades, so that there is something new to keep in each round.
        let settings = [
            ("source.loop", "true".to_owned()),
            ("source.rate", "0.0".to_owned()),
            ("capture.hold_s", format!("{:?}", 0.05 * (round % 5) as f64)),
            ("refine.knots", (3 + round % 62).to_string()),
            ("refine.distance_weight", format!("{:?}", 0.5 / (1 + round / 310) as f64)),
        ];
        let daemon = Daemon::start_in(folder, &settings);
        let mut reader = daemon.connect();
        let listed = daemon.connect().call("ListBlades", &json!({})).0;
        assert_eq!(listed["parameters"]["refused"], json!([]), "half a blade");
        if !announced.is_empty() {
            let library = reader.library(0);
            let there: BTreeSet<String> = library.blades().map(|blade| blade.id().to_string()).collect();
            let lost: Vec<&String> = announced.difference(&there).collect();
            assert!(lost.is_empty(), "round {round}: {lost:?} are lost");
            assert!(library.generation() > generation, "round {round}: {generation} comes again");
        }
        // Many kills would fill the library, and what the archive takes is not lost.
        if announced.len() > 1000 {
            let mut station = daemon.connect();
            for name in names(&mut station) {
                let (reply, _) = station.call("RemoveBlade", &json!({"name": name}));
                assert!(reply.get("error").is_none(), "{reply}");
            }
            announced.clear();
        }
        let before = announced.len();
        let followed = std::thread::spawn(move || {
            let (mut after, mut seen) = (0, BTreeSet::new());
            while let Ok(library) = reader.try_library(after) {
                after = library.generation();
                seen.extend(library.blades().map(|blade| blade.id().to_string()));
            }
            (after, seen)
        });
        // A moment that is another in each round, and the same in each run of the test.
        let moment = ((round * 7919 + 13) % 397) as f64 / 397.0;
        if round == 0 {
            let start = Instant::now();
            daemon.connect().library_of_at_least(1);
            longest = longest.max(start.elapsed() * 3);
        }
        std::thread::sleep(longest.mul_f64(moment));
        folder = daemon.kill();
        meadow.goes_on(Instant::now());
        let (last, seen) = followed.join().expect("the reader does not panic");
        generation = generation.max(last);
        announced.extend(seen);
        let is_new = announced.len() > before;
        grown += usize::from(is_new);
        // A machine that became busier needs longer.
        let change = if is_new { 0.98 } else { 1.03 };
        longest = longest.mul_f64(change).clamp(Duration::from_millis(400), Duration::from_secs(20));
    }
    assert!(grown as u64 > kills / 4, "only {grown} of {kills} rounds had something new to keep");
    let daemon = Daemon::start_in(folder, &by_hand());
    let library = daemon.connect().library(0);
    while meadow.generation < library.generation() {
        meadow.hear();
    }
    let Meadow { pictures, libraries, .. } = meadow;
    eprintln!(
        "{kills} kills, {grown} of them after something new: {} blades, all there; {pictures} pictures without a stop, {libraries} libraries received",
        library.len()
    );
    assert!(libraries > 2, "the renderer connects again and again: {libraries} libraries");
}

#[test]
fn a_file_goes_live_and_a_broken_one_is_refused_until_it_is_mended() {
    let daemon = Daemon::start(&by_hand());
    let file = daemon.blades().join("fern.toml");
    fs::write(&file, FERN).expect("room");
    let mut station = daemon.connect();
    library_with(&mut station, |blades| blades.len() == 1 && blades[0].length_m() == 0.2);

    fs::write(&file, FERN.replace("[0.0, 0.2", "[0.0, oops")).expect("room");
    let refused = wait_for(DEADLINE, || {
        let listed = daemon.client(&["blades", "list"]);
        listed.stdout.contains("refused: ").then_some(listed.stdout)
    });
    let refused = refused.expect("it is said");
    assert!(refused.contains("fern.toml:4:24: ") && refused.lines().count() == 2, "{refused}");
    assert_eq!(station.library(0).blades().next().expect("the last good one").length_m(), 0.2);

    // Over the old one, as editors do.
    let beside = daemon.blades().join("fern.toml.new");
    fs::write(&beside, FERN.replace("0.2", "0.3")).expect("room");
    fs::rename(&beside, &file).expect("the same folder");
    library_with(&mut station, |blades| blades.len() == 1 && blades[0].length_m() == 0.3);
    assert_eq!(daemon.client(&["blades", "list"]).stdout.lines().count(), 1);

    assert_eq!(daemon.client(&["blades", "restore", "fern"]).code, Some(0));
    assert_eq!(station.library(0).blades().next().expect("fern").length_m(), 0.2, "the swap is undone");
    fs::remove_file(&file).expect("it is there");
    library_with(&mut station, |blades| blades.is_empty());
}

#[test]
fn the_library_is_served_again_after_a_restart_as_it_was() {
    let daemon = Daemon::start(&[("source.rate", "0.0".to_owned())]);
    let mut station = daemon.connect();
    let library = station.library_of_at_least(1);
    let names = names(&mut station);
    assert_eq!(daemon.client(&["blades", "rename", &names[0], "fern"]).code, Some(0));
    assert_eq!(daemon.client(&["blades", "mix", "fern", "2.5"]).code, Some(0));
    assert_eq!(daemon.client(&["blades", "remove", &names[1]]).code, Some(0));
    let before = station.library(0);
    let (folder, finished) = daemon.end();
    assert_eq!(finished.code, Some(0), "{finished:?}");

    // As if the clock had been ahead and were set back.
    let ahead = 8_000_000_000_000_000u64;
    fs::write(folder.path().join("state/generation"), format!("{ahead}\n")).expect("room");
    // The same recording again: what was removed stays so, and nothing comes twice.
    let daemon = Daemon::start_in(folder, &[("source.rate", "0.0".to_owned())]);
    let mut station = daemon.connect();
    wait_for(DEADLINE, || (station.status()["repeats"] == json!(1)).then_some(())).expect("a capture");
    assert_eq!(station.status()["captures"], json!(0), "nothing of it is new");
    let after = station.library(0);
    assert!(after.generation() > ahead && ahead > before.generation());
    assert_eq!(after.len(), library.len() - 1);
    assert_eq!(common::library::library_hash(after.bytes()), common::library::library_hash(before.bytes()));
    let fern = after.blades().find(|blade| blade.name() == "fern").expect("it was renamed");
    assert_eq!(fern.mix(), 2.5);
    assert_eq!(daemon.client(&["blades", "restore", &names[1]]).code, Some(0));
    assert_eq!(station.library(0).len(), library.len());
}

#[test]
fn it_holds_4096_blades_and_the_oldest_goes_to_the_archive() {
    let folder = tempfile::tempdir().expect("a folder");
    let blades = folder.path().join("state/blades");
    fs::create_dir_all(&blades).expect("room");
    for number in 0..4096 {
        let text = FERN.replace("0.2", &format!("{:?}", 0.1 + 1e-5 * f64::from(number)));
        let text = text.replacen("knots", &format!("captured_unix_ns = {number}\nknots"), 1);
        fs::write(blades.join(format!("b{number}.toml")), text).expect("room");
    }
    let daemon = Daemon::start_in(folder, &by_hand());
    let mut station = daemon.connect();
    let library = station.library(0);
    assert_eq!(library.len(), 4096);
    let listed = station.call("ListBlades", &json!({})).0;
    assert_eq!(listed["parameters"]["blades"].as_array().map(Vec::len), Some(4096));

    assert_eq!(daemon.client(&["blades", "list"]).stdout.lines().count(), 4096);
    let drawing = daemon.folder().join("all.svg");
    assert_eq!(daemon.client(&["blades", "export", drawing.to_str().expect("UTF-8")]).code, Some(0));
    let drawing = fs::read_to_string(drawing).expect("it is written");
    assert!(drawing.matches("<path").count() >= 4096, "each blade is drawn");

    fs::write(daemon.blades().join("one-more.toml"), FERN).expect("room");
    library_with(&mut station, |blades| blades.iter().any(|blade| blade.name() == "one-more"));
    let names = names(&mut station);
    assert_eq!((names.len(), names.contains(&"b0".to_owned())), (4096, false));
    assert!(daemon.folder().join("state/archive/b0/000001.toml").exists());
    let (_, finished) = daemon.end();
    assert!(finished.stderr.contains("the library is full"), "{}", finished.stderr);
}

/// A daemon whose state directory is a file system of its own, which `mount` makes; in a namespace, so
/// that nobody needs to be root. `None`, said aloud, where the system allows no namespaces.
fn on_a_disk_of_its_own(mount: &str) -> Option<Daemon> {
    let namespace = ["--user", "--map-root-user", "--mount"];
    let allowed =
        Command::new("unshare").args(namespace).args(["mount", "-t", "tmpfs", "tmpfs", "/mnt"]).status();
    if !allowed.is_ok_and(|status| status.success()) {
        eprintln!("skipped: this machine allows no mount in a namespace of its own");
        return None;
    }
    let folder = tempfile::tempdir().expect("a folder");
    fs::create_dir(folder.path().join("state")).expect("room");
    fs::write(folder.path().join("station.toml"), "refine.knots = 16\n").expect("room");
    let command = Daemon::command(folder.path(), &by_hand());
    let mut inside = Command::new("unshare");
    inside.args(namespace).args(["sh", "-c", &format!("cd \"$1\" && shift && {mount} && exec \"$@\""), "sh"]);
    inside.arg(folder.path()).arg(command.get_program()).args(command.get_args());
    inside.env_remove("STATE_DIRECTORY");
    Some(Daemon::start_command(folder, inside))
}

/// The state directory as that daemon sees it.
fn state_inside(daemon: &mut Daemon) -> std::path::PathBuf {
    let root = format!("/proc/{}/root", daemon.running().id());
    let state = daemon.folder().join("state");
    Path::new(&root).join(state.strip_prefix("/").expect("an absolute path"))
}

#[test]
fn a_full_disk_loses_no_blade_and_what_waits_is_kept_when_there_is_room() {
    let Some(mut daemon) = on_a_disk_of_its_own("mount -t tmpfs -o size=256k tmpfs state") else { return };
    let state = state_inside(&mut daemon);
    let mut station = daemon.connect();
    let reply = capture(&mut station);
    assert!(reply["parameters"]["names"].as_array().is_some_and(|names| !names.is_empty()), "{reply}");
    let before = ids(&mut station);

    let filler = state.join("filler");
    let full = fs::write(&filler, vec![0; 1 << 20]).expect_err("it is small");
    assert_eq!(full.kind(), std::io::ErrorKind::StorageFull);
    // The recording shows the same again, and would give blades that are there already.
    fs::write(daemon.folder().join("station.toml"), "refine.knots = 12\n").expect("room");
    assert_eq!(station.call("Reload", &json!({})).0["parameters"]["changed"], json!(["refine.knots"]));
    let reply = capture(&mut station);
    assert_eq!(reply["error"], "io.sward.Station.CaptureWaits", "{reply}");
    assert!(reply["parameters"]["reason"].as_str().is_some_and(|it| it.contains("No space left")), "{reply}");
    let waits = reply["parameters"]["waiting"].as_u64().expect("a number");
    let status = station.status();
    assert!(waits > 0 && status["waiting"].as_u64() >= Some(waits), "what waits is said: {reply}, {status}");
    assert!(status["store"].as_str().is_some_and(|store| store.contains("No space left")), "{status}");
    assert!(status["waiting"].as_u64() > Some(0), "{status}");
    assert_eq!(ids(&mut station), before, "what was announced stays, and nothing that is not on disk is");
    assert_eq!(
        station.call("SetMix", &json!({"name": "fern", "mix": 1})).0["error"],
        "io.sward.Station.NoSuchBlade"
    );

    fs::remove_file(&filler).expect("it is there");
    library_with(&mut station, |blades| blades.len() > before.len());
    wait_for(DEADLINE, || (station.status()["store"] == "ok").then_some(())).expect("it goes on by itself");
    let after = ids(&mut station);
    assert!(after.is_superset(&before));
    let status = station.status();
    assert_eq!((&status["waiting"], &status["lost"]), (&json!(0), &json!(0)), "{status}");
    let files = fs::read_dir(state.join("blades")).expect("readable").count();
    assert_eq!(files, after.len(), "a file for each blade and nothing else");
}

#[test]
fn of_a_full_disk_it_is_said_once_however_many_blades_wait() {
    let Some(mut daemon) = on_a_disk_of_its_own("mount -t tmpfs -o size=256k tmpfs state") else { return };
    let filler = state_inside(&mut daemon).join("filler");
    fs::write(&filler, vec![0; 1 << 20]).expect_err("it is small");
    let mut station = daemon.connect();
    assert_eq!(capture(&mut station)["error"], "io.sward.Station.CaptureWaits");
    let status = station.status();
    assert!(status["waiting"].as_u64() >= Some(2), "{status}");
    // Each of them is tried again some times meanwhile.
    std::thread::sleep(Duration::from_secs(3));
    assert_eq!(station.status()["waiting"], status["waiting"], "none is lost");
    fs::remove_file(&filler).expect("it is there");
    wait_for(DEADLINE, || (station.status()["store"] == "ok").then_some(())).expect("it goes on by itself");
    assert_eq!(station.status()["waiting"], json!(0));
    let (_, finished) = daemon.end();
    assert_eq!(finished.stderr.matches("the store cannot be written").count(), 1, "{}", finished.stderr);
    assert_eq!(finished.stderr.matches("the store can be written again").count(), 1, "{}", finished.stderr);
}

#[test]
fn a_store_is_made_where_the_folder_around_it_is_there_or_systemds() {
    let folder = tempfile::tempdir().expect("a folder");
    let nowhere = folder.path().join("nowhere");
    let settings = [&by_hand()[..], &[("store.directory", format!("{:?}", nowhere.join("state")))]].concat();
    let daemon = Daemon::start_in(folder, &settings);
    let mut station = daemon.connect();
    let store = station.status()["store"].as_str().unwrap_or_default().to_owned();
    assert!(store.contains("nowhere") && store.contains("mount its disk"), "{store}");
    assert!(!nowhere.exists(), "a path that was mistyped is not made");
    fs::create_dir(&nowhere).expect("room");
    wait_for(DEADLINE, || (station.status()["store"] == "ok").then_some(())).expect("it goes on by itself");
    assert!(nowhere.join("state/blades").is_dir());
    let (folder, _) = daemon.end();

    fs::remove_dir_all(&nowhere).expect("it is there");
    let mut command = Daemon::command(folder.path(), &settings);
    command.env("STATE_DIRECTORY", &nowhere);
    let daemon = Daemon::start_command(folder, command);
    assert_eq!(daemon.connect().status()["store"], "ok");
}

#[test]
fn a_disk_that_is_read_only_is_served_and_written_again_when_it_can_be() {
    let seeded = format!(
        "mount -t tmpfs -o size=1m tmpfs state && mkdir state/blades && printf '{}' > state/blades/fern.toml && mount -o remount,ro state",
        FERN.replace('\n', "\\n")
    );
    let Some(mut daemon) = on_a_disk_of_its_own(&seeded) else { return };
    let mut station = daemon.connect();
    assert_eq!(names(&mut station), ["fern"]);
    let status = station.status();
    assert!(status["store"].as_str().is_some_and(|store| store.contains("Read-only")), "{status}");
    let refused = daemon.client(&["blades", "remove", "fern"]);
    assert_eq!(refused.code, Some(1), "{refused:?}");
    assert!(refused.stderr.contains("Read-only") && refused.stderr.ends_with(".\n"), "{refused:?}");
    let reply = capture(&mut station);
    assert_eq!(reply["error"], "io.sward.Station.CaptureWaits", "{reply}");
    assert_eq!(names(&mut station), ["fern"]);

    // It is tried again some times meanwhile, and said once.
    std::thread::sleep(Duration::from_secs(3));
    let state = daemon.folder().join("state");
    let id = daemon.running().id().to_string();
    let mut remount = Command::new("nsenter");
    remount.args([
        "--target",
        &id,
        "--user",
        "--preserve-credentials",
        "--mount",
        "mount",
        "-o",
        "remount,rw",
    ]);
    assert!(remount.arg(state).status().expect("nsenter runs").success());
    library_with(&mut station, |blades| blades.len() > 1);
    assert_eq!(daemon.client(&["blades", "remove", "fern"]).code, Some(0));
    wait_for(DEADLINE, || (station.status()["store"] == "ok").then_some(())).expect("it goes on by itself");
    let (_, finished) = daemon.end();
    assert_eq!(finished.stderr.matches("it is tried again every second").count(), 1, "{finished:?}");
    assert_eq!(finished.stderr.matches("the store can be written again").count(), 1, "{finished:?}");
}

#[test]
fn two_stations_do_not_share_a_store() {
    let daemon = Daemon::start(&by_hand());
    let other = daemon.folder().join("other.socket");
    let mut command = Daemon::command(daemon.folder(), &by_hand());
    command.args(["--set".to_owned(), format!("service.socket={other:?}")]).env("SWARD_LOG", "off");
    let refused = Running::start(command).finish(DEADLINE);
    assert_eq!(refused.code, Some(1), "{refused:?}");
    assert!(refused.stderr.contains("state directory is in use"), "{refused:?}");
    assert!(!other.exists());
    assert_eq!(Program::Capture.run(["check-config"]).code, Some(0));
}
