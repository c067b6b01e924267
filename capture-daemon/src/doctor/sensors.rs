//! Sensors that are plugged in, and whether they may be opened.

use std::fs;
use std::io::Read;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

use super::Finding;
use crate::source::access;
use crate::source::profile::Profile;

/// Whether the video devices below `dev` may be opened.
pub(super) fn video(dev: &Path) -> Vec<Finding> {
    const CHECK: &str = "sensors.video";
    let is_video = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        name.strip_prefix("video").is_some_and(|number| number.parse::<u16>().is_ok())
    };
    let entries = fs::read_dir(dev).into_iter().flatten().flatten();
    let mut nodes: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(is_video).collect();
    nodes.sort();
    if nodes.is_empty() {
        return vec![Finding::skipped(CHECK, dev.join("video*").display(), "no camera is plugged in")];
    }
    let of_node = |path: &PathBuf| {
        let is_device = fs::metadata(path).is_ok_and(|metadata| metadata.file_type().is_char_device());
        if !is_device {
            let remedy = "remove it, and see whether udev runs";
            return Finding::trouble(CHECK, path.display(), "it is no device", "a camera's device", remedy);
        }
        let may = "it may be opened; sward-capture devices says whether it gives depth";
        opened(CHECK, path.display().to_string(), path, may)
    };
    nodes.iter().map(of_node).collect()
}

/// Whether a node may be opened, which is `found` then.
fn opened(check: &'static str, place: String, node: &Path, found: &str) -> Finding {
    match access::trouble(node) {
        None => Finding::ok(check, place, found),
        Some((found, remedy)) => {
            Finding::trouble(check, place, found, "the right to read and write it", remedy)
        }
    }
}

/// Whether the sensors of known kinds may be opened by their USB nodes, by which OpenNI2 reads some of them; `sys` being
/// `/sys`.
pub(super) fn usb(sys: &Path) -> Vec<Finding> {
    const CHECK: &str = "sensors.usb";
    let sensors = access::known_sensors(sys);
    let of_sensor = |(profile, node): &(&Profile, PathBuf)| {
        let place = format!("{} at {}", profile.name, node.display());
        opened(CHECK, place, node, "it may be opened")
    };
    // The kernel reads the others, by nodes that are checked above.
    let mut sensors = sensors.iter().filter(|(profile, _)| profile.is_read_by_openni2).peekable();
    if sensors.peek().is_none() {
        let place = sys.join("bus/usb/devices");
        return vec![Finding::skipped(CHECK, place.display(), "no sensor of OpenNI2 is plugged in")];
    }
    sensors.map(of_sensor).collect()
}

/// Where a library may lie.
pub(super) fn library_folders() -> Vec<PathBuf> {
    let named = |variable| std::env::var_os(variable).unwrap_or_default();
    let mut folders: Vec<PathBuf> = std::env::split_paths(&named("LD_LIBRARY_PATH")).collect();
    folders.extend(["OPENNI2_REDIST", "OPENNI2_REDIST64"].map(|variable| named(variable).into()));
    let triplet = format!("{}-linux-gnu", std::env::consts::ARCH);
    for root in ["/usr/local/lib", "/usr/lib", "/lib"] {
        folders.extend([root.into(), Path::new(root).join(&triplet)]);
    }
    folders.push("/usr/lib64".into());
    folders.retain(|folder| !folder.as_os_str().is_empty());
    folders
}

/// Whether OpenNI2 is installed, in one of these folders.
pub(super) fn openni2(folders: &[PathBuf]) -> Finding {
    const CHECK: &str = "sensors.openni2";
    let names = ["libOpenNI2.so", "libOpenNI2.so.0"];
    let mut paths = folders.iter().flat_map(|folder| names.map(|name| folder.join(name)));
    let Some(path) = paths.find(|path| path.symlink_metadata().is_ok()) else {
        return Finding::skipped(
            CHECK,
            "libOpenNI2.so",
            "it is not installed; its sensors and .oni recordings need it",
        );
    };
    let mut magic = [0; 4];
    match fs::File::open(&path).and_then(|mut file| file.read_exact(&mut magic)) {
        Ok(()) if magic == *b"\x7fELF" => Finding::ok(CHECK, path.display(), "it is installed"),
        read => {
            let found =
                read.err().map_or("it is no library".into(), |error| format!("it cannot be read: {error}"));
            Finding::trouble(CHECK, path.display(), found, "a shared library", "install OpenNI2 again")
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::super::Verdict;
    use super::super::tests::assert_trouble;
    use super::*;

    #[test]
    fn a_node_that_is_no_device_is_trouble() {
        let dev = tempfile::tempdir().expect("a folder");
        fs::write(dev.path().join("video-notes"), "").expect("room");
        assert_eq!(video(dev.path())[0].verdict, Verdict::Skipped);
        // Whoever may open this one may open it in any place.
        symlink("/dev/null", dev.path().join("video0")).expect("room");
        fs::write(dev.path().join("video1"), "").expect("room");
        let found = video(dev.path());
        assert_eq!((found.len(), found[0].verdict), (2, Verdict::Ok), "{found:?}");
        assert_trouble(&found[1], &["video1", "no device"]);
    }

    #[test]
    fn a_library_that_is_none_is_trouble() {
        let folder = tempfile::tempdir().expect("a folder");
        let folders = [folder.path().to_path_buf()];
        assert_eq!(openni2(&folders).verdict, Verdict::Skipped);
        let library = folder.path().join("libOpenNI2.so");
        fs::write(&library, "not a library").expect("room");
        assert_trouble(&openni2(&folders), &["libOpenNI2.so", "no library", "install"]);
        fs::remove_file(&library).expect("it is there");
        symlink("nowhere", &library).expect("room");
        assert_trouble(&openni2(&folders), &["cannot be read"]);
        fs::remove_file(&library).expect("it is there");
        symlink(std::env::current_exe().expect("it runs"), &library).expect("room");
        assert_eq!(openni2(&folders).verdict, Verdict::Ok);
    }
}
