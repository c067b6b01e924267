//! Sensors that can be plugged in and out: a driver of our own (`tests/sensor/driver.cpp`) within the real libOpenNI2, in
//! a folder of its own, so that no other test and no real sensor is seen.

use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use tempfile::TempDir;

use crate::openni2::{self, HEADERS};
use crate::root;

/// A folder with the library, the driver, and what is plugged in. All is unplugged when this is dropped.
#[derive(Debug)]
pub struct Sensors {
    folder: TempDir,
}

/// The driver, built once for all tests of a program.
fn driver() -> &'static Path {
    static BUILT: OnceLock<(TempDir, PathBuf)> = OnceLock::new();
    let (_, path) = BUILT.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("libSward.so.0");
        let built = Command::new("c++")
            .args(["-std=c++17", "-O1", "-fPIC", "-shared", "-pthread", "-I", HEADERS, "-o"])
            .arg(&path)
            .arg(root().join("tests/sensor/driver.cpp"))
            .arg("-ldl")
            .output()
            .expect("a C++ compiler runs");
        assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
        (folder, path)
    });
    path
}

impl Sensors {
    /// No sensor yet; `None`, said, where OpenNI2 or its headers are not installed.
    ///
    /// # Panics
    /// If they should be, or the driver does not build.
    pub fn new() -> Option<Self> {
        let library = openni2::path().filter(|_| openni2::has_headers())?;
        let folder = tempfile::tempdir().expect("a temporary folder");
        let drivers = folder.path().join("OpenNI2/Drivers");
        std::fs::create_dir_all(&drivers).expect("a folder of ours");
        std::fs::create_dir(folder.path().join("sensors")).expect("a folder of ours");
        std::fs::copy(driver(), drivers.join("libSward.so.0")).expect("room");
        // It looks for drivers beside the path that it is opened by.
        symlink(library, folder.path().join("libOpenNI2.so.0")).expect("a folder of ours");
        Some(Self { folder })
    }

    /// The library's path, for `sensor.openni2_library`.
    pub fn library(&self) -> PathBuf {
        self.folder.path().join("libOpenNI2.so.0")
    }

    /// Plugs a sensor in at a port. `words`: what it is and does; the driver says which there are.
    ///
    /// # Panics
    /// If there is no room.
    pub fn plug(&self, port: &str, words: &str) {
        let sensors = self.folder.path().join("sensors");
        let hidden = sensors.join(format!(".{port}"));
        std::fs::write(&hidden, words).expect("room");
        std::fs::rename(hidden, sensors.join(port)).expect("the same folder");
    }

    /// Unplugs what is at a port.
    ///
    /// # Panics
    /// If nothing is.
    pub fn unplug(&self, port: &str) {
        std::fs::remove_file(self.folder.path().join("sensors").join(port)).expect("it is plugged in");
    }
}

/// Frame `k`, from 0, of a sensor of this size, as the driver makes it, not mirrored.
pub fn picture(k: u32, width: usize, height: usize) -> Vec<u16> {
    let pixel = |x: usize, y: usize| {
        let is_read = !(x + y + k as usize).is_multiple_of(97);
        if is_read { (400 + (7 * k as usize + 3 * x + 5 * y) % 8000) as u16 } else { 0 }
    };
    (0..height).flat_map(|y| (0..width).map(move |x| pixel(x, y))).collect()
}
