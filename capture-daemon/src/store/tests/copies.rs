//! Copies of blades, removed blades and their list, weights.

use super::*;

#[test]
fn a_copy_is_another_blade_and_stays_so() {
    let folder = folder();
    let mut store = open(&folder);
    store.keep(&captured(1)).expect("room");
    let text = store.records()[0].to_toml();
    drop_file(&store, "copy", &text);
    assert_eq!(rescan(&mut store), (true, false));
    let id_of = |store: &Store, name: &str| store.live[name].record.blade.id();
    let (own, original) = (id_of(&store, "copy"), captured(1).blade.id());
    assert_ne!(own, original);
    assert_eq!(id_of(&store, captured(1).blade.name()), original);
    let written = fs::read_to_string(store.path("copy")).expect("there");
    let others = |text: &str| {
        text.lines().filter(|line| !line.starts_with("id = ")).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(others(&written), others(&text), "all else stays as it is");
    assert_eq!(rescan(&mut store), (false, false), "it is settled");

    // Another copy after the first has gone elsewhere, and one that comes by an order.
    store.rename("copy", "moss").expect("free");
    drop_file(&store, "copy", &text);
    assert_eq!(rescan(&mut store), (true, false));
    store.put_text("reed", &text).expect("room");
    let ids: HashSet<BladeId> = store.live.values().map(|live| live.record.blade.id()).collect();
    assert_eq!((names(&store).len(), ids.len()), (4, 4));
    drop(store);
    let mut store = open(&folder);
    assert_eq!((id_of(&store, "moss"), store.refused().len()), (own, 0), "also after a restart");
    store.remove("reed").expect("it is there");
    store.restore("reed", 1).expect("it is its own");
    assert_eq!(names(&store).len(), 4, "and takes no other's place");
}

#[test]
fn a_copy_that_cannot_be_written_to_is_refused_with_its_line() {
    let folder = folder();
    let mut store = open(&folder);
    store.keep(&captured(1)).expect("room");
    drop_file(&store, "copy", &store.records()[0].to_toml());
    // Nothing can be renamed onto a folder that is not empty.
    fs::create_dir_all(store.blades_folder().join(".copy.toml.tmp/in/the/way")).expect("room");
    assert_eq!(rescan(&mut store), (false, true));
    let reason = &store.refused()["copy"].reason;
    assert!(reason.contains("copy.toml:4:1: its `id`") && reason.contains("take the line out"), "{reason}");
    fs::remove_dir_all(store.blades_folder().join(".copy.toml.tmp")).expect("it is there");
    assert_eq!(rescan(&mut store), (true, true));
    assert_eq!(names(&store).len(), 2);
}

#[test]
fn what_was_removed_by_whatever_way_is_listed_and_what_was_renamed_is_not() {
    let folder = folder();
    let mut store = open(&folder);
    for name in ["fern", "moss", "reed"] {
        drop_file(
            &store,
            name,
            &DROPPED.replace("0.2", &format!("0.{}", name.len() + name.as_bytes()[0] as usize)),
        );
    }
    rescan(&mut store);
    let removed = |store: &Store| {
        let names = store.removed().into_iter().map(|version| version.record.blade.name().to_owned());
        names.collect::<HashSet<String>>()
    };
    assert_eq!(removed(&store), HashSet::new());
    store.rename("reed", "sedge").expect("free");
    store.remove("moss").expect("it is there");
    fs::remove_file(store.path("fern")).expect("it is there");
    rescan(&mut store);
    assert_eq!(removed(&store), HashSet::from(["fern", "moss"].map(str::to_owned)));
    store.restore("moss", 1).expect("it is in the history");
    assert_eq!(removed(&store), HashSet::from(["fern".to_owned()]));
}

#[test]
fn blades_whose_folder_goes_at_once_are_in_the_history() {
    let folder = folder();
    let mut store = open(&folder);
    store.keep(&captured(1)).expect("room");
    drop_file(&store, "fern", DROPPED);
    rescan(&mut store);
    let blades = store.blades_folder();
    // One that is made after the other is gone may look like it to the system.
    let other = folder.path().join("other");
    fs::create_dir(&other).expect("room");
    fs::remove_dir_all(&blades).expect("it is there");
    fs::rename(&other, &blades).expect("the same disk");
    for _ in 0..3 {
        assert!(matches!(store.rescan(), Err(StoreError::Disk { .. })));
    }
    assert_eq!(names(&store).len(), 2, "they are served meanwhile");
    drop(store);
    let mut store = open(&folder);
    assert!(store.is_empty());
    let removed: Vec<String> = store.removed().iter().map(|it| it.record.blade.name().to_owned()).collect();
    assert_eq!(removed.len(), 2, "{removed:?}");
    for name in &removed {
        store.restore(name, 1).expect("it is in the history");
    }
    assert_eq!(store.blades().into_iter().filter(|blade| blade.id() == captured(1).blade.id()).count(), 1);
    assert_eq!(names(&store).len(), 2);
}

#[test]
fn a_weight_that_the_library_cannot_tell_from_none_is_refused() {
    let folder = folder();
    let mut store = open(&folder);
    drop_file(&store, "fern", DROPPED);
    rescan(&mut store);
    for mix in [1e-50, 1e-40, -0.5, 1_000_001.0, f64::NAN] {
        assert!(matches!(store.set_mix("fern", mix), Err(StoreError::Mix(_))), "{mix}");
    }
    for mix in [1e-30, 0.0, -0.0, 1_000_000.0] {
        store.set_mix("fern", mix).expect("in its range");
        assert_eq!(store.blades()[0].mix().to_bits(), (mix as f32).abs().to_bits());
    }
}
