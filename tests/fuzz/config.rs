//! Configurations with damage, as a file and as arguments.

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use capture_daemon::config::load;
use tests::root;

use tests::random::Random;

use crate::mutate::{change, change_text};

/// The documented file, with its keys that have no default switched on.
static SEED: LazyLock<String> = LazyLock::new(|| {
    let path = root().join("capture-daemon/capture-daemon.toml");
    let text = fs::read_to_string(path).expect("the documented configuration");
    text.lines().map(|line| line.strip_prefix("#= ").unwrap_or(line).to_owned() + "\n").collect()
});

/// A `key=value` argument, more or less.
fn set(random: &mut Random) -> String {
    let mut table = "";
    let mut keys = Vec::new();
    for line in SEED.lines().filter(|line| !line.starts_with('#')) {
        match line.strip_prefix('[').and_then(|line| line.strip_suffix(']')) {
            Some(name) if !line.contains('=') => table = name,
            _ if line.contains('=') => keys.push(format!("{table}.{line}")),
            _ => {}
        }
    }
    let key = random.pick(&keys).clone();
    change_text(&key, random).trim_end().to_owned()
}

pub(crate) fn case(random: &mut Random, folder: &Path) {
    // Mostly without its comments, so that changes hit keys.
    let mut text: String =
        SEED.lines().filter(|line| !line.starts_with('#')).map(|line| line.to_owned() + "\n").collect();
    if random.once_in(8) {
        text = SEED.clone();
    }
    for _ in 0..1 + random.below(3) {
        text = change_text(&text, random);
    }
    let mut bytes = text.clone().into_bytes();
    if random.once_in(4) {
        change(&mut bytes, &[], random);
    }
    let path = folder.join("station.toml");
    fs::write(&path, bytes).expect("a temporary file");
    let sets: Vec<String> = (0..random.below(3)).map(|_| set(random)).collect();
    match load(Some(&path), &sets) {
        Ok(config) => {
            let again = folder.join("again.toml");
            fs::write(&again, config.to_toml()).expect("a temporary file");
            assert_eq!(load(Some(&again), &[]).as_ref(), Ok(&config), "what is written is read");
        }
        Err(error) => {
            let said = error.to_string();
            assert!(!said.contains('\n') && !said.is_empty(), "one sentence: {said:?}");
        }
    }
}
