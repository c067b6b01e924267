//! Is a good sensor told from a bad one, with what to do about it?

use capture_daemon::source::faulty::FaultKind;
use serde_json::{Value, json};
use tests::faulty::Faulty;
use tests::programs::{DEADLINE, Finished, Program, Running};
use tests::shipped_recording;

fn quality(arguments: &[String]) -> Finished {
    let mut command = Program::Capture.command(["quality"]);
    command.args(arguments).env("SWARD_LOG", "off");
    Running::start(command).finish(DEADLINE)
}

/// The verdict, and what failed.
fn judged(arguments: &[String]) -> (Finished, Value, Vec<String>) {
    let finished = quality(&[arguments, &["--json".to_owned()]].concat());
    let json: Value = serde_json::from_str(&finished.stdout).unwrap_or_else(|_| panic!("{finished:?}"));
    let checks = json["checks"].as_array().expect("a list").clone();
    let failing = checks.iter().filter(|check| check["pass"] == false);
    assert!(failing.clone().all(|check| check["advice"].is_string()), "{json}");
    let failing = failing.map(|check| check["check"].as_str().expect("a name").to_owned()).collect();
    (finished, json, failing)
}

fn words(arguments: &[&str]) -> Vec<String> {
    arguments.iter().map(|argument| (*argument).to_owned()).collect()
}

#[test]
fn a_shipped_recording_is_good_enough_and_its_noise_that_of_its_model() {
    let path = shipped_recording().display().to_string();
    let (finished, json, failing) = judged(&words(&[&path, "--frames", "20"]));
    assert_eq!((finished.code, failing), (Some(0), vec![]), "{json}");
    assert_eq!(
        (&json["pass"], &json["frames"], &json["skipped_frames"]),
        (&json!(true), &json!(20), &json!(0))
    );
    let number = |field: &str| json[field].as_f64().unwrap_or_else(|| panic!("{field}: {json}"));
    assert!((number("rate_hz") - 30.0).abs() < 0.1, "{json}");
    assert!((number("plane_distance_m") - 1.3).abs() < 0.02, "{json}");
    // 0.6·(1.2 + 1.9·(z − 0.4)²) mm at 1.3 m, and what the steps of the disparity add.
    assert!((0.0016..0.0032).contains(&number("plane_noise_m")), "{json}");
    assert!((0.0012..0.0032).contains(&number("temporal_noise_m")), "{json}");
    assert!((0.8..1.0).contains(&number("fill")), "{json}");
    assert!((number("pixels_across") - 570.0 * 0.006 / 0.6).abs() < 0.1, "{json}");

    let page = quality(&words(&[&path, "--frames", "20"])).stdout;
    assert_eq!(page.matches("pass  ").count(), 6, "{page}");
    let (finished, json, failing) = judged(&words(&[&path, "--blade-width-mm", "2", "--distance-m", "0.8"]));
    assert_eq!((finished.code, failing), (Some(1), words(&["pixels_across"])), "{json}");
    let page = quality(&words(&[&path, "--blade-width-mm", "2", "--distance-m", "0.8"]));
    assert!(page.stdout.contains("FAIL  pixels across") && page.stdout.contains("held at 0.4"), "{page:?}");
    assert!(page.stderr.lines().count() == 1, "{page:?}");
}

#[test]
fn a_sensor_that_is_noisy_or_gives_nothing_fails_and_says_what_to_do() {
    let faulty = Faulty::on("row-3.mcap");
    let few = |more: &[&str]| [faulty.arguments(), words(&["--frames", "20"]), words(more)].concat();
    let (finished, json, failing) = judged(&few(&[]));
    assert_eq!((finished.code, failing), (Some(0), vec![]), "{json}");
    assert!(json["source"].as_str().is_some_and(|name| name.contains("faulty sensor")), "{json}");

    // It was begun long ago, so that all frames are as noisy.
    faulty.befalls(&[(-1000.0, FaultKind::Noise { to_mm: 40.0, for_s: 2000.0 })]);
    let (finished, json, failing) = judged(&few(&[]));
    assert_eq!((finished.code, failing), (Some(1), words(&["plane_noise", "temporal_noise"])), "{json}");

    faulty.befalls(&[(-1000.0, FaultKind::Unplug { for_s: 9000.0 })]);
    let absent = quality(&few(&[]));
    assert_eq!(absent.code, Some(4), "{absent:?}");
    assert!(absent.stderr.contains("not plugged in") && absent.stderr.lines().count() == 1, "{absent:?}");
}

#[test]
fn exit_codes_are_those_of_the_house() {
    assert_eq!(quality(&words(&["/no/such.mcap"])).code, Some(3));
    assert_eq!(quality(&words(&["--frames", "2"])).code, Some(2));
    let none = quality(&[]);
    assert!(none.code == Some(2) && none.stderr.contains("source.recording"), "{none:?}");
}
