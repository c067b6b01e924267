//! The real libOpenNI2, where it is installed.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Its name.
const LIBRARY: &str = "libOpenNI2.so.0";
/// Where Debian's libopenni2-dev puts its headers.
pub const HEADERS: &str = "/usr/include/openni2";

/// Where it is. What is missing is said.
///
/// # Panics
/// If it is not there though `SWARD_REQUIRE_OPENNI2` says that it was installed.
pub fn path() -> Option<PathBuf> {
    let output = Command::new("/sbin/ldconfig").arg("-p").output().ok();
    let list = output.map(|output| String::from_utf8_lossy(&output.stdout).into_owned()).unwrap_or_default();
    let line = list.lines().find(|line| line.trim_start().starts_with(LIBRARY));
    let path = line.and_then(|line| line.split("=> ").nth(1)).map(PathBuf::from);
    found(path.is_some(), LIBRARY, "libopenni2-0").then_some(path).flatten()
}

/// Whether it is installed; says so where it is not.
///
/// # Panics
/// As [`path`].
pub fn is_there() -> bool {
    path().is_some()
}

/// Whether its headers are; says so where they are not.
///
/// # Panics
/// If they are not there though `SWARD_REQUIRE_OPENNI2` says that they were installed.
pub fn has_headers() -> bool {
    found(Path::new(HEADERS).join("Driver/OniDriverAPI.h").exists(), HEADERS, "libopenni2-dev")
}

fn found(is_there: bool, what: &str, package: &str) -> bool {
    if !is_there {
        let is_required = std::env::var_os("SWARD_REQUIRE_OPENNI2").is_some();
        assert!(!is_required, "{what} is not installed (Debian's {package})");
        eprintln!("skipped: {what} is not installed (Debian's {package})");
    }
    is_there
}
