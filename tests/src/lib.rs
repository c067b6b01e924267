//! What the cross-crate tests share: the programs and how to run them, and reading source as text.

pub mod conformance;
pub mod daemon;
pub mod faulty;
pub mod log;
pub mod oni;
pub mod openni2;
pub mod previews;
pub mod process;
pub mod programs;
pub mod random;
pub mod scan;
pub mod sensors;
pub mod station;
pub mod uvc;
pub mod vm;

use std::path::{Path, PathBuf};

/// The workspace's folder.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the crate lies in the workspace").to_owned()
}

/// A shipped recording that shows blades.
pub fn shipped_recording() -> PathBuf {
    root().join("recordings/row-3.mcap")
}
