//! Is each key known, in its type and range, and does a mistake have its place?

use super::*;

fn check(text: &str, sets: &[&str]) -> Result<Config, String> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("c.toml");
    std::fs::write(&path, text).expect("it is writable");
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    let shown = path.display().to_string();
    load(Some(&path), &sets).map_err(|error| error.to_string().replace(&shown, "c.toml"))
}

#[test]
fn the_shipped_file_documents_exactly_the_defaults() {
    let text = include_str!("../../capture-daemon.toml");
    assert_eq!(check(text, &[]), Ok(Config::default()));
    // Each key of the file stands there as a comment, and is a key.
    let uncommented: String = text
        .lines()
        .map(|line| line.strip_prefix("#= ").unwrap_or(line))
        .fold(String::new(), |all, line| all + line + "\n");
    let both = check(&uncommented, &[]).expect_err("frames come from a recording or from a sensor");
    assert!(both.contains("`sensor.driver`") && both.contains("source.recording"), "{both}");
    let driver = "driver = \"openni2\"\n";
    assert!(uncommented.contains(driver));
    let all_keys = check(&uncommented.replace(driver, ""), &[]).expect("every documented key is known");
    assert!(check(driver, &[]).is_err() && check(&format!("[sensor]\n{driver}"), &[]).is_ok());
    assert_eq!(all_keys.sensor.size, Some([640, 480]));
    assert_eq!(all_keys.camera_model().map(|camera| camera.fx), Some(570.0));
    assert!(all_keys.mask.roi.is_some() && all_keys.source.recording.is_some());
    let given = all_keys.open_options().camera.expect("a camera");
    assert_eq!((given.camera.cy, given.distortion.coefficients()[0]), (239.5, -0.05));
    assert_eq!(check(&all_keys.to_toml(), &[]), Ok(all_keys));
}

#[test]
fn errors_name_file_line_and_column() {
    let error = |text| check(text, &[]).expect_err("invalid");
    let unknown = error("[mask]\nnear_m = 0.4\n  fare_m = 1.0\n");
    assert!(unknown.starts_with("c.toml:3:3: unknown key `mask.fare_m`, expected one of"), "{unknown}");
    let wrong_type = error("[refine]\nknots = \"many\"\n");
    assert!(
        wrong_type.starts_with("c.toml:2:9: `refine.knots` is text (\"many\"), expected a whole number"),
        "{wrong_type}"
    );
    let range = error("[refine]\nknots = 65\n");
    assert_eq!(range, "c.toml:2:9: `refine.knots` = 65 is out of range, expected 2 to 64");
    let syntax = error("[mask\n");
    assert!(syntax.starts_with("c.toml:1:"), "{syntax}");
    let lens = error("camera = { fx = 9, fy = 9, cx = 0, cy = 0, distortion = [1.0] }");
    assert!(lens.starts_with("c.toml:1:57: `camera.distortion`") && lens.contains("plumb_bob"), "{lens}");
    let alone = error("[camera]\ndistortion = [0.1, 0, 0, 0]\n");
    assert!(
        alone.contains(
            "c.toml:2:14: `camera.distortion` = [0.1, 0, 0, 0] is out of range, expected camera.fx"
        ),
        "{alone}"
    );
    let order = error("mask = { near_m = 1.0, far_m = 0.5 }\n");
    assert!(order.starts_with("c.toml:1:32: `mask.far_m` = 0.5 is"), "{order}");
    let nearer = error("# Ours.\n\n[mask]\nnear_m = 1.0\n");
    assert_eq!(nearer, "c.toml:4:10: `mask.far_m` is out of range, expected more than mask.near_m (1)");
    let region = error("[mask]\nroi = [1, 2, 3]\n");
    assert!(
        region.starts_with("c.toml:2:7: `mask.roi` is a list of 3, expected a list of 4 whole numbers"),
        "{region}"
    );
    let table = error("mask = 0.3");
    assert_eq!(table, "c.toml:1:8: `mask` is the number 0.3, expected a table, with keys of its own");
    assert!(!error("x = 1\ny =\n").contains('\n'));
    // Nothing that only this program's source calls so.
    for (table, value) in
        [("mask", "\"x\""), ("camera.fx", "[]"), ("mask.roi", "\"all\""), ("source.loop", "1")]
    {
        let said = check(&format!("{table} = {value}"), &[]).expect_err("invalid");
        assert!(
            !["struct", "f32", "f64", "usize", "Config", "array"].iter().any(|word| said.contains(word)),
            "{said}"
        );
    }
}

#[test]
fn who_is_not_known_here_is_warned_of_with_line_and_column() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("c.toml");
    let text = "[service]\nwatch = [\"*\", \"root\", \"4242\"]\nchange = [\n  \"@root\",\n  \"@no-such-group\",\n]\n";
    std::fs::write(&path, text).expect("it is writable");
    let warnings = |sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
        super::check(Some(&path), &sets).expect("valid").1
    };
    let of_file = warnings(&[]);
    assert_eq!(of_file.len(), 1, "{of_file:?}");
    let place = format!("{}:5:3: `service.change` names \"@no-such-group\"", path.display());
    assert!(of_file[0].starts_with(&place) && of_file[0].contains("no such group"), "{of_file:?}");
    let of_set = warnings(&["service.change=[\"nobody-of-that-name\"]"]);
    assert_eq!(of_set.len(), 1, "{of_set:?}");
    assert!(of_set[0].starts_with("--set ") && of_set[0].contains("no such user"), "{of_set:?}");
}

#[test]
fn what_a_recording_was_made_under_holds_below_all_that_is_given() {
    let made = Config { refine: RefineConfig { knots: 9, ..RefineConfig::default() }, ..Config::default() };
    let recorded = made.capture_toml();
    assert!(!recorded.contains("socket") && recorded.contains("knots = 9"), "{recorded}");
    let load = |file: Option<&std::path::Path>, sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
        load_recorded(Some(&recorded), file, &sets).map_err(|error| error.to_string())
    };
    assert_eq!(load(None, &[]), Ok(made));
    let over = load(None, &["refine.knots=5"]).expect("valid");
    assert_eq!(over.refine.knots, 5);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("c.toml");
    std::fs::write(&path, "mask.far_m = 0.8\n").expect("it is writable");
    let instead = load(Some(&path), &[]).expect("valid");
    assert_eq!((instead.refine.knots, instead.mask.far_m), (16, 0.8));
    let odd = load_recorded(Some("[mask]\nfarther_m = 1.0\n"), None, &[]).expect_err("invalid").to_string();
    assert!(odd.starts_with("the configuration in the recording:2:1: unknown key"), "{odd}");
}

#[test]
fn set_wins_over_the_file() {
    let config = check("[mask]\nnear_m = 0.4\nfar_m = 0.8\n", &["mask.near_m=0.5"]).expect("valid");
    assert_eq!((config.mask.near_m, config.mask.far_m), (0.5, 0.8));
}

#[test]
fn the_service_s_keys_are_in_their_ranges() {
    let error = |text| check(text, &[]).expect_err("invalid");
    assert!(error("service.socket_mode = 0o1777").contains("`service.socket_mode` = 0o1777 is out of range"));
    assert!(error("service.socket_mode = \"rw\"").contains("expected a whole number"));
    assert!(error("service.watch = [\"@\"]").contains("`service.watch`"));
    assert!(error("service.max_connections = 1").contains("expected 2 to 10000"));
    assert!(error("store.directory = \"\"").contains("`store.directory`"));
    assert!(error("store.archive_max = 100001").contains("expected 0 to 100000"));
    assert!(error("store.archive_max = -1").contains("expected a whole number, 0 or more"));
}

#[test]
fn differences_are_named_and_the_hash_follows_what_a_capture_goes_by() {
    let before = Config::default();
    let after = check("mask.near_m = 0.4\nservice.socket = \"/tmp/s\"", &[]).expect("valid");
    assert_eq!(before.differences(&before), Vec::<String>::new());
    assert_eq!(before.differences(&after), ["mask.near_m", "service.socket"]);
    assert!(Config::is_live("mask.near_m") && !Config::is_live("service.socket"));
    assert_ne!(before.capture_hash(), after.capture_hash());
    let elsewhere = StoreConfig { directory: Some("/tmp/s".into()), ..StoreConfig::default() };
    let elsewhere = Config { store: elsewhere, ..before.clone() };
    assert_eq!(before.capture_hash(), elsewhere.capture_hash());
}

#[test]
fn the_state_directory_is_the_configurations_then_systemds() {
    let folder = |store: &StoreConfig, given| store.folder(given).display().to_string();
    let unset = StoreConfig::default();
    assert_eq!(folder(&unset, None), "/var/lib/sward");
    assert_eq!(folder(&unset, Some("")), "/var/lib/sward");
    assert_eq!(folder(&unset, Some("/var/lib/private/sward:/var/lib/other")), "/var/lib/private/sward");
    let set = StoreConfig { directory: Some("/tmp/s".into()), ..unset };
    assert_eq!(folder(&set, Some("/var/lib/other")), "/tmp/s");
}

#[test]
fn a_bad_set_names_the_argument() {
    let error = |set| check("", &[set]).expect_err("invalid");
    assert!(error("mask.nears=1").contains("--set 'mask.nears=1', column 6: unknown key `mask.nears`"));
    assert!(error("service.socket=/tmp/x").contains("text needs quotes"));
    assert!(error("refine.knots=1").starts_with("--set 'refine.knots=1', column 14: `refine.knots` = 1 is"));
    assert!(error("nonsense").contains("--set 'nonsense'"));
    assert!(
        error("").contains("it sets nothing, expected key=value") && error("# far").contains("sets nothing")
    );
    let list = error("service.change=\"x\"");
    assert!(
        list.starts_with("--set 'service.change=\"x\"', column 16: ") && !list.contains("needs quotes"),
        "{list}"
    );
    let camera = error("camera.fx=500");
    assert!(
        camera.contains("column 1: `camera` is incomplete, expected all of fx, fy, cx and cy"),
        "{camera}"
    );
    assert!(error("mask.near_m=nan").contains("out of range"));
}
