//! Can everything be undone that people do to blades?

use super::*;

#[test]
fn a_swap_can_be_undone_and_done_again() {
    let folder = folder();
    let mut store = open(&folder);
    drop_file(&store, "fern", DROPPED);
    rescan(&mut store);
    drop_file(&store, "fern", &DROPPED.replace("0.2", "0.3"));
    rescan(&mut store);
    let length = |store: &Store| store.blades()[0].length_m();
    for expected in [0.2, 0.3, 0.2] {
        store.restore("fern", 1).expect("there is an earlier one");
        assert_eq!(length(&store), expected);
        assert_eq!(rescan(&mut store), (false, false));
    }
    drop(store);
    assert_eq!(length(&open(&folder)), 0.2);
}

/// Length and weight of what a name can go back to, the newest first, and the name that it got.
fn earlier(store: &Store, name: &str) -> Vec<(f32, f32, Option<String>)> {
    let all = store.earlier(name).into_iter();
    all.map(|it| (it.record.blade.length_m(), it.record.blade.mix(), it.renamed_to)).collect()
}

#[test]
fn a_weight_can_be_undone_and_a_version_brings_its_own() {
    let folder = folder();
    let mut store = open(&folder);
    drop_file(&store, "fern", DROPPED);
    rescan(&mut store);
    let captured = store.blades()[0].captured_unix_ns();
    store.set_mix("fern", 2.0).expect("valid");
    store.set_mix("fern", 2.0).expect("valid");
    assert_eq!(earlier(&store, "fern"), [(0.2, 0.5, None)], "the same weight is nothing new");
    drop_file(&store, "fern", &DROPPED.replace("0.2", "0.3").replace("mix = 0.5", "mix = 3"));
    rescan(&mut store);
    drop_file(&store, "fern", &DROPPED.replace("0.2", "0.3").replace("mix = 0.5", "mix = 4"));
    rescan(&mut store);
    assert_eq!(earlier(&store, "fern"), [(0.3, 3.0, None), (0.2, 2.0, None), (0.2, 0.5, None)]);
    assert!(matches!(store.restore("fern", 4), Err(StoreError::NoHistory(_))));
    assert!(matches!(store.restore("fern", 0), Err(StoreError::NoHistory(_))));

    store.restore("fern", 3).expect("it is there");
    let fern = |store: &Store| (store.blades()[0].length_m(), store.blades()[0].mix());
    assert_eq!((fern(&store), store.blades()[0].captured_unix_ns()), ((0.2, 0.5), captured));
    assert_eq!(rescan(&mut store), (false, false));
    store.restore("fern", 1).expect("what it was before that");
    assert_eq!(fern(&store), (0.3, 4.0));
    drop(store);
    assert_eq!(earlier(&open(&folder), "fern").len(), 3);
}

#[test]
fn a_renaming_is_undone_by_the_old_name_and_done_again_by_the_new_one() {
    let folder = folder();
    let mut store = open(&folder);
    store.keep(&captured(1)).expect("room");
    drop_file(&store, "fern", DROPPED);
    rescan(&mut store);
    let blade = captured(1).blade.name().to_owned();
    // One has an id of its own, the other one that is made of its name.
    for name in [blade.as_str(), "fern"] {
        store.rename(name, "moss").expect("free");
        store.set_mix("moss", 7.0).expect("valid");
        drop(store);
        store = open(&folder);
        assert_eq!(earlier(&store, name).pop().and_then(|it| it.2).as_deref(), Some("moss"));
        assert_eq!(store.keep(&captured(1)).expect("room"), Kept::Known);
        store.restore(name, 1).expect("it is undone");
        assert!(!names(&store).contains(&"moss".to_owned()) && names(&store).len() == 2);
        let back = store.blades().into_iter().find(|it| it.name() == name).expect("it is there");
        assert_eq!(back.mix(), 7.0, "as it is now");
        store.restore("moss", 1).expect("it is done again");
        assert!(!names(&store).contains(&name.to_owned()) && names(&store).len() == 2);
        assert_eq!(rescan(&mut store), (false, false));
        store.remove("moss").expect("it is there");
        store.restore("moss", 1).expect("it was removed");
        store.rename("moss", &format!("{name}-2")).expect("free");
        assert!(store.refused().is_empty());
    }
}

#[test]
fn a_renaming_is_undone_over_many_names_and_over_one_that_has_the_name_now() {
    let folder = folder();
    let mut store = open(&folder);
    drop_file(&store, "fern", DROPPED);
    rescan(&mut store);
    store.rename("fern", "moss").expect("free");
    store.rename("moss", "lichen").expect("free");
    let taller = DROPPED.replace("0.2", "0.3");
    store.put_text("fern", &taller).expect("room");
    store.restore("fern", 1).expect("the one that is lichen now");
    assert_eq!(names(&store), ["fern"]);
    assert_eq!(store.blades()[0].length_m(), 0.2);
    store.restore("fern", 1).expect("the one that had the name meanwhile");
    assert_eq!((names(&store).len(), store.blades()[0].length_m()), (1, 0.3));

    // Where what was renamed has become another or is gone, it comes back as it was.
    store.rename("fern", "moss").expect("free");
    store.put_text("moss", &DROPPED.replace("0.2", "0.4")).expect("room");
    store.restore("fern", 1).expect("as it was");
    let lengths = |store: &Store| store.blades().iter().map(|it| it.length_m()).collect::<Vec<_>>();
    assert_eq!(lengths(&store).len(), 2);
    assert!(lengths(&store).contains(&0.3) && lengths(&store).contains(&0.4));
}

#[test]
fn what_was_replaced_is_not_brought_back_by_a_loop() {
    let folder = folder();
    let mut store = open(&folder);
    store.keep(&captured(1)).expect("room");
    let name = captured(1).blade.name().to_owned();
    store.put_text(&name, DROPPED).expect("room");
    assert_eq!(store.keep(&captured(1)).expect("room"), Kept::Known);
    drop(store);
    let mut store = open(&folder);
    assert_eq!(store.keep(&captured(1)).expect("room"), Kept::Known, "nor after a restart");
    store.restore(&name, 1).expect("it is in the history");
    assert_eq!(store.blades()[0].id(), captured(1).blade.id());
}

#[test]
fn what_was_removed_stays_so_until_it_is_restored() {
    let folder = folder();
    let mut store = open(&folder);
    store.keep(&captured(1)).expect("room");
    let name = captured(1).blade.name().to_owned();
    store.remove(&name).expect("it is there");
    assert!(store.is_empty());
    assert!(matches!(store.remove(&name), Err(StoreError::NotFound(_))));
    drop(store);
    let mut store = open(&folder);
    assert_eq!(store.keep(&captured(1)).expect("room"), Kept::Known, "a loop does not bring it back");
    store.restore(&name, 1).expect("it is in the history");
    assert_eq!(names(&store), std::slice::from_ref(&name));
    assert!(matches!(store.restore(&name, 1), Err(StoreError::NoHistory(_))));
    assert!(matches!(store.restore("moss", 1), Err(StoreError::NoHistory(_))));
}
