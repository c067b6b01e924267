//! Does anything crash, hang or take too much memory on bytes that nobody would write?
//!
//! Each target makes its cases from a counter, so that a case is the same on every run and machine.
//! By default each runs a fixed number of them; these variables of the environment change that:
//!
//! - `SWARD_FUZZ_SECONDS`: run each target for so long;
//! - `SWARD_FUZZ_START` and `SWARD_FUZZ_CASES`: the first case, and how many; what a failure prints.
//!
//! The longest run so far, of 2026-11-23 from case 2,000,000 on, four minutes a target beside other work: 2,009 recordings
//! and 1,793 of damaged messages, 1,204 folders, 162,651 blade files, 13,073 configurations, 704,512 previews and 1,854
//! sequences of random depth through the whole chain; nothing was found.

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
