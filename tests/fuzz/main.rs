//! Does anything crash, hang or take too much memory on bytes that nobody would write?
//!
//! Each target makes its cases from a counter, so that a case is the same on every run and machine.
//! By default each runs a fixed number of them; these variables of the environment change that:
//!
//! - `SWARD_FUZZ_SECONDS`: run each target for so long;
//! - `SWARD_FUZZ_START` and `SWARD_FUZZ_CASES`: the first case, and how many; what a failure prints.

mod blades;
mod chain;
mod config;
mod driver;
mod messages;
mod mutate;
mod pictures;
mod previews;
mod recordings;
mod seeds;

use driver::run;

/// Counts what is allocated, so that a case that takes too much is found. What zstd and lz4 allocate is
/// not seen: they bound it themselves.
#[global_allocator]
static ALLOCATED: peak_alloc::PeakAlloc = peak_alloc::PeakAlloc;

#[test]
fn damaged_recordings() {
    run("damaged_recordings", 500, recordings::case);
}

#[test]
fn whole_recordings_of_damaged_messages() {
    run("whole_recordings_of_damaged_messages", 500, messages::case);
}

#[test]
fn damaged_folders() {
    run("damaged_folders", 500, pictures::case);
}

#[test]
fn damaged_configurations() {
    run("damaged_configurations", 800, config::case);
}

#[test]
fn damaged_blade_files() {
    run("damaged_blade_files", 2000, blades::case);
}

#[test]
fn damaged_previews() {
    run("damaged_previews", 4000, previews::case);
}

#[test]
fn the_whole_chain_on_random_depth() {
    run("the_whole_chain_on_random_depth", 300, chain::case);
}
