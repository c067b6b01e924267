//! Does the store keep what it was given, whatever people and disks do to it?

use std::fs;

use common::blade::Knot;
use glam::Vec3;
use tempfile::TempDir;

use super::record::{Measured, Provenance};
use super::*;

mod copies;
mod history;

const DROPPED: &str = "# Mine.\nformat = 1\nmix = 0.5 # half\nknots = [\n  { position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004] },\n  { position_m = [0.0, 0.2, 0.0], half_width_m = [0.0, 0.0] },\n]\n";

fn captured(number: u64) -> Record {
    let knots: Vec<Knot> = (0..4)
        .map(|i| Knot {
            position: Vec3::new(0.0, 0.05 * i as f32, 0.001 * number as f32),
            half_width_left: 0.002,
            across: Vec3::X,
            half_width_right: 0.003,
        })
        .collect();
    let id = BladeId::of(number, 0, &knots);
    let name = format!("blade-{}", &id.to_string()[..8]);
    let measured =
        Measured { pixels_across: 8.0, hausdorff_m: 1e-4, length_error_m: 1e-3, width_error_m: 1e-4 };
    Record {
        blade: Blade::new(id, name, knots, [0.15, 0.005], number, 0.9).expect("valid"),
        pinned: false,
        sequence: None,
        measured: Some(measured),
        provenance: Provenance { source: Some("a test".to_owned()), ..Provenance::default() },
    }
}

fn open(folder: &TempDir) -> Store {
    let mut store = Store::open_with(folder.path(), 1, 4, 2).expect("it opens");
    store.prepare().expect("it can be written");
    store
}

fn names(store: &Store) -> Vec<String> {
    store.blades().iter().map(|blade| blade.name().to_owned()).collect()
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a folder")
}

fn drop_file(store: &Store, name: &str, text: &str) {
    fs::write(store.blades_folder().join(format!("{name}.toml")), text).expect("room");
}

/// A change of `library`, of `refused`.
fn rescan(store: &mut Store) -> (bool, bool) {
    let load::Changes { library, refused } = store.rescan().expect("the folder is there");
    (library, refused)
}

#[test]
fn blades_are_there_again_in_their_order() {
    let folder = folder();
    let mut store = open(&folder);
    for number in [30, 10, 20] {
        assert_eq!(store.keep(&captured(number)).expect("room"), Kept::New);
    }
    assert_eq!(store.keep(&captured(10)).expect("room"), Kept::Known);
    let before = store.blades();
    assert_eq!(before.iter().map(Blade::captured_unix_ns).collect::<Vec<_>>(), [30, 10, 20]);
    drop(store);
    let mut store = open(&folder);
    assert_eq!(store.blades(), before);
    assert_eq!(rescan(&mut store), (false, false));
    store.keep(&captured(5)).expect("room");
    assert_eq!(names(&store).last(), Some(&captured(5).blade.name().to_owned()), "new ones come last");
}

#[test]
fn a_second_station_is_refused() {
    let folder = folder();
    let _first = open(&folder);
    assert!(matches!(Store::open(folder.path(), 1, 2), Err(OpenError::InUse(_))));
}

#[test]
fn what_a_killed_station_left_half_done_is_no_blade() {
    let folder = folder();
    let store = open(&folder);
    fs::write(store.blades_folder().join(".fern.toml.tmp"), "format =").expect("room");
    drop(store);
    let store = open(&folder);
    assert!(store.is_empty() && store.refused().is_empty());
    assert!(!store.blades_folder().join(".fern.toml.tmp").exists());
}

#[test]
fn a_dropped_file_goes_live_and_a_broken_one_keeps_the_last_good() {
    let folder = folder();
    let mut store = open(&folder);
    drop_file(&store, "fern", DROPPED);
    assert_eq!(rescan(&mut store), (true, false));
    assert_eq!(rescan(&mut store), (false, false));
    let good = store.blades();

    drop_file(&store, "fern", &DROPPED.replace("0.2", "oops"));
    assert_eq!(rescan(&mut store), (false, true));
    assert_eq!(rescan(&mut store), (false, false), "said once");
    let reason = &store.refused()["fern"].reason;
    assert!(reason.contains("fern.toml:6:24: ") && !reason.contains('\n'), "{reason}");
    assert_eq!(store.blades(), good);

    // Also when the station is started while the file is broken.
    drop(store);
    let mut store = open(&folder);
    assert_eq!(store.blades()[0].knots(), good[0].knots());
    assert!(store.refused().contains_key("fern"));

    drop_file(&store, "fern", &DROPPED.replace("0.2", "0.3"));
    assert_eq!(rescan(&mut store), (true, true));
    assert!(store.refused().is_empty());
    assert_eq!(store.blades()[0].length_m(), 0.3);

    fs::remove_file(store.blades_folder().join("fern.toml")).expect("it is there");
    assert_eq!(rescan(&mut store), (true, false));
    assert!(store.is_empty());
}

#[test]
fn a_broken_file_that_is_removed_takes_the_blade_with_it() {
    let folder = folder();
    let mut store = open(&folder);
    drop_file(&store, "fern", DROPPED);
    rescan(&mut store);
    drop_file(&store, "fern", "green");
    rescan(&mut store);
    fs::remove_file(store.blades_folder().join("fern.toml")).expect("it is there");
    assert_eq!(rescan(&mut store), (true, true));
    assert!(store.is_empty() && store.refused().is_empty());
    store.restore("fern", 1).expect("the last good one is in the history");
    assert_eq!(names(&store), ["fern"]);
}

#[test]
fn a_name_is_had_by_one() {
    let folder = folder();
    let mut store = open(&folder);
    store.keep(&captured(1)).expect("room");
    store.keep(&captured(2)).expect("room");
    let [a, b] = [1, 2].map(|number| captured(number).blade.name().to_owned());
    assert!(matches!(store.rename(&a, &b), Err(StoreError::Taken(_))));
    assert!(matches!(store.rename(&a, "../a"), Err(StoreError::Name(_))));
    assert!(matches!(store.rename("../a", "b"), Err(StoreError::Name(_))));
    assert!(matches!(store.rename("moss", "fern"), Err(StoreError::NotFound(_))));
    store.rename(&a, "fern").expect("free");
    assert_eq!(names(&store), ["fern".to_owned(), b]);
    assert_eq!(store.blades()[0].id(), captured(1).blade.id(), "it is the same blade");
    assert_eq!(store.keep(&captured(1)).expect("room"), Kept::Known);
    assert_eq!(rescan(&mut store), (false, false));
}

#[test]
fn a_mix_weight_is_set_and_the_rest_of_the_file_stays() {
    let folder = folder();
    let mut store = open(&folder);
    drop_file(&store, "fern", DROPPED);
    rescan(&mut store);
    let before = store.blades()[0].captured_unix_ns();
    store.set_mix("fern", 0.1).expect("valid");
    let fern = &store.blades()[0];
    assert_eq!((fern.mix(), fern.captured_unix_ns()), (0.1, before));
    let file = fs::read_to_string(store.blades_folder().join("fern.toml")).expect("text");
    assert_eq!(file, DROPPED.replace("mix = 0.5", "mix = 0.1"));
    for bad in [-1.0, f64::NAN, f64::INFINITY, 1e300] {
        assert!(matches!(store.set_mix("fern", bad), Err(StoreError::Mix(_))));
    }
    drop_file(&store, "fern", "green");
    assert!(matches!(store.set_mix("fern", 1.0), Err(StoreError::Refused { .. })), "not read yet");
    rescan(&mut store);
    assert!(matches!(store.set_mix("fern", 1.0), Err(StoreError::Refused { .. })), "broken");
    assert_eq!(fs::read(store.blades_folder().join("fern.toml")).expect("there"), b"green");
}

#[test]
fn the_oldest_that_is_not_pinned_goes_to_the_archive() {
    let folder = folder();
    let mut store = open(&folder);
    for number in 1..=4 {
        store.keep(&captured(number)).expect("room");
    }
    let first = captured(1).blade.name().to_owned();
    let pinned = store.records()[0].to_toml().replace("pinned = false", "pinned = true");
    drop_file(&store, &first, &pinned);
    rescan(&mut store);
    store.keep(&captured(5)).expect("the second goes");
    drop_file(&store, "fern", DROPPED);
    assert_eq!(rescan(&mut store), (true, false));
    let expected: Vec<String> = [1, 4, 5].map(|number| captured(number).blade.name().to_owned()).into();
    assert_eq!(names(&store), [&expected[..], &["fern".to_owned()]].concat());
    assert!(store.archive.folder().join(captured(2).blade.name()).join("000001.toml").exists());

    store.restore(captured(3).blade.name(), 1).expect("it is in the archive");
    assert_eq!(names(&store).len(), 4);
    for name in names(&store) {
        let text = fs::read_to_string(store.path(&name)).expect("text");
        drop_file(
            &store,
            &name,
            &text.replace("pinned = false", "pinned = true").replace("mix = 0.5", "pinned = true"),
        );
    }
    rescan(&mut store);
    assert!(matches!(store.keep(&captured(9)), Err(StoreError::AllPinned)));
    assert_eq!(names(&store).len(), 4);
}

#[test]
fn a_folder_with_too_many_blades_is_read_up_to_what_fits() {
    let folder = folder();
    let store = open(&folder);
    for number in 1..=6 {
        let record = Record { sequence: Some(number), ..captured(number) };
        drop_file(&store, record.blade.name(), &record.to_toml());
    }
    drop(store);
    let store = open(&folder);
    let expected: Vec<String> = (3..=6).map(|number| captured(number).blade.name().to_owned()).collect();
    assert_eq!(names(&store), expected);
    assert_eq!(fs::read_dir(store.archive.folder()).expect("there").count(), 2);
}

#[test]
fn another_folder_in_its_place_is_not_an_empty_library() {
    let folder = folder();
    let mut store = open(&folder);
    store.keep(&captured(1)).expect("room");
    let aside = folder.path().join("aside");
    fs::rename(store.blades_folder(), &aside).expect("moved");
    assert!(store.rescan().is_err());
    fs::create_dir(store.blades_folder()).expect("room");
    let error = store.rescan().expect_err("it is another one").to_string();
    assert!(error.contains("another folder"), "{error}");
    assert!(store.keep(&captured(2)).is_err() && store.probe().is_err());
    assert_eq!(names(&store).len(), 1);
    fs::remove_dir(store.blades_folder()).expect("empty");
    fs::rename(aside, store.blades_folder()).expect("moved back");
    assert_eq!(rescan(&mut store), (false, false));
    store.keep(&captured(2)).expect("room");
}

#[test]
fn a_folder_that_comes_late_is_read_then() {
    let folder = folder();
    let place = folder.path().join("state");
    fs::write(&place, "a file where the folder should be").expect("room");
    let mut store = Store::open_with(&place, 1, 4, 2).expect("that is no reason to stay down");
    assert!(store.prepare().is_err() && store.keep(&captured(1)).is_err());
    fs::remove_file(&place).expect("it is there");
    fs::create_dir_all(place.join("blades")).expect("room");
    fs::write(place.join("blades/fern.toml"), DROPPED).expect("room");
    store.prepare().expect("it is a folder now");
    assert_eq!(names(&store), ["fern"]);
}

#[test]
fn a_blade_that_is_put_there_replaces_its_name_or_makes_room_once_it_is_on_disk() {
    let folder = folder();
    let mut store = open(&folder);
    for number in [1, 2, 3, 4] {
        store.keep(&captured(number)).expect("room");
    }
    let full = names(&store);
    // Nothing can be written over a folder.
    let blocked = store.blades_folder().join("fern.toml");
    fs::create_dir(&blocked).expect("room");
    let refused = store.put_text("fern", DROPPED).expect_err("it cannot be written");
    assert!(refused.is_disk(), "{refused}");
    assert_eq!(names(&store), full, "nobody went to the archive for it");
    fs::remove_dir(&blocked).expect("it is empty");

    assert!(matches!(store.put_text("fern", "format = 1\nknots = 7\n"), Err(StoreError::Refused { .. })));
    store.put_text("fern", DROPPED).expect("room");
    assert_eq!(names(&store).len(), 4);
    assert!(names(&store).contains(&"fern".to_owned()) && !names(&store).contains(&full[0]));

    let broader = DROPPED.replace("0.004", "0.007");
    store.put_text("fern", &broader).expect("room");
    assert_eq!(names(&store).len(), 4, "what is replaced makes its own room");
    let width = |store: &Store| {
        let fern = store.blades().into_iter().find(|blade| blade.name() == "fern");
        fern.expect("there").max_width_m()
    };
    assert_eq!(width(&store), 0.014);
    store.restore("fern", 1).expect("the one before");
    assert_eq!(width(&store), 0.008);
}

#[test]
fn the_archive_holds_so_many_and_the_oldest_go() {
    let folder = folder();
    let mut store = open(&folder);
    let archived = |store: &Store| {
        let mut names: Vec<String> = archive::files(store.archive.folder())
            .iter()
            .filter_map(|path| Some(path.parent()?.file_name()?.to_str()?.to_owned()))
            .collect();
        names.sort();
        names
    };
    let of = |numbers: &[u64]| {
        let mut names: Vec<String> =
            numbers.iter().map(|number| captured(*number).blade.name().to_owned()).collect();
        names.sort();
        names
    };
    for number in 1..=7 {
        store.keep(&captured(number)).expect("room");
    }
    assert_eq!(archived(&store), of(&[2, 3]), "two of the three that had to go");
    let first = captured(1).blade.name().to_owned();
    assert!(matches!(store.restore(&first, 1), Err(StoreError::NoHistory(_))), "it is gone for good");
    assert!(!store.archive.folder().join(&first).exists(), "and its folder with it");
    // What is restored leaves room.
    store.restore(captured(2).blade.name(), 1).expect("it is in the archive");
    assert_eq!(archived(&store), of(&[3, 4]));

    // A limit that was lowered holds from the next start on.
    drop(store);
    let store = Store::open_with(folder.path(), 1, 4, 1).expect("it opens");
    assert_eq!(archived(&store), of(&[4]));
    drop(store);
    let mut store = Store::open_with(folder.path(), 1, 4, 0).expect("it opens");
    store.keep(&captured(8)).expect("room");
    assert_eq!(archived(&store), Vec::<String>::new());
    assert_eq!(names(&store).len(), 4);
}

#[test]
fn generations_grow_though_the_clock_was_set_back_years() {
    let folder = folder();
    let open_at = |now_us| {
        let mut store = Store::open_with(folder.path(), now_us, 4, 2).expect("it opens");
        store.prepare().expect("it can be written");
        [store.next_generation(), store.next_generation()]
    };
    let year_us = 31_557_600_000_000;
    let mut before = 0;
    // The clock of a machine without a battery begins in 1970.
    for now_us in [60 * year_us, 59 * year_us, 0, 1, 60 * year_us + 1] {
        let [first, second] = open_at(now_us);
        assert!(before < first && first < second, "{first} after {before}, at {now_us} us");
        before = second;
    }
}

#[test]
fn a_clock_that_steps_back_changes_neither_the_order_nor_who_goes_first() {
    let folder = folder();
    let mut store = open(&folder);
    // In years, as the clock said: ahead, mended, without a battery, mended again.
    let order = [2100, 2026, 1, 1970, 2027];
    for number in order {
        assert_eq!(store.keep(&captured(number)).expect("room"), Kept::New);
    }
    let expected: Vec<String> = order[1..].iter().map(|n| captured(*n).blade.name().to_owned()).collect();
    assert_eq!(names(&store), expected, "the one that came first made room");
    drop(store);
    let mut store = Store::open_with(folder.path(), 0, 4, 2).expect("it opens");
    assert_eq!(names(&store), expected);
    assert_eq!(store.keep(&captured(1)).expect("room"), Kept::Known);
    store.keep(&captured(3)).expect("room");
    assert!(!names(&store).contains(&expected[0]) && names(&store).contains(&expected[1]));
    store.restore(captured(2100).blade.name(), 1).expect("it is in the archive, with its time ahead");
    assert_eq!(names(&store).len(), 4);
}

#[test]
fn a_file_whose_name_is_not_utf8_is_refused_for_that_and_keeps_nothing_out() {
    use std::os::unix::ffi::OsStrExt;
    let folder = folder();
    let mut store = open(&folder);
    let name = std::ffi::OsStr::from_bytes(b"f\xe9rn.toml");
    fs::write(store.blades_folder().join(name), DROPPED).expect("room");
    drop_file(&store, "moss", DROPPED);
    assert_eq!(rescan(&mut store), (true, true));
    let reasons =
        |store: &Store| store.refused().values().map(|refused| refused.reason.clone()).collect::<Vec<_>>();
    assert_eq!(reasons(&store).len(), 1);
    assert!(
        reasons(&store)[0].contains("not UTF-8") && reasons(&store)[0].contains("rename"),
        "{:?}",
        reasons(&store)
    );
    assert_eq!(rescan(&mut store), (false, false), "and is said once");
    assert_eq!(names(&store), ["moss"]);
    drop(store);

    let mut store = open(&folder);
    assert_eq!((names(&store), reasons(&store).len()), (vec!["moss".to_owned()], 1));
    fs::rename(store.blades_folder().join(name), store.blades_folder().join("fern.toml")).expect("there");
    assert_eq!(rescan(&mut store), (true, true));
    assert_eq!((store.refused().len(), names(&store).len()), (0, 2));
}

#[test]
fn a_reason_is_one_line_and_not_long_whatever_a_file_is_called() {
    let folder = folder();
    let mut store = open(&folder);
    for name in ["a\nb".to_owned(), "x".repeat(200)] {
        drop_file(&store, &name, DROPPED);
    }
    // Hidden, as all whose names begin with a dot.
    drop_file(&store, "", DROPPED);
    assert_eq!(rescan(&mut store), (false, true));
    let reasons: Vec<&str> = store.refused().values().map(|refused| refused.reason.as_str()).collect();
    assert_eq!(reasons.len(), 2, "{reasons:?}");
    for reason in reasons {
        assert!(!reason.contains('\n') && reason.contains("expected 1 to 48 bytes"), "{reason}");
        assert!(reason.matches('x').count() < 300, "{reason}");
    }
}
