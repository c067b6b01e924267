//! The store: its folder, its disk, its blades, its archive.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::Path;

use common::library::layout::MAX_BLADES;
use common::sentence::counted;
use rustix::fs::statvfs;

use super::Finding;
use super::socket::owner;
use crate::mistake::one_line;
use crate::store::archive;
use crate::store::file::{SUFFIX, Signature, blade_name, text, write_atomically};
use crate::store::record::Record;
use crate::store::shelf;

/// Room for a full library, and as much again for what is replaced, bytes.
const MIN_BYTES: u64 = 64 << 20;
/// Files for the same.
const MIN_FILES: u64 = 3 * MAX_BLADES as u64;
/// The check of their number.
const BLADES: &str = "store.blades";
/// Refused files that are named.
const MAX_NAMED: usize = 20;

/// All of it, and the time of the newest blade, nanoseconds since 1970.
pub(super) fn examine(folder: &Path, archive_max: usize) -> (Vec<Finding>, Option<u64>) {
    let mut all = vec![folder_is_there(folder)];
    if !folder.is_dir() {
        return (all, None);
    }
    all.push(writable(folder));
    if let Ok(disk) = statvfs(folder) {
        // Some file systems make files as they are needed, and count none.
        let files = (disk.f_files > 0).then_some(disk.f_favail);
        all.push(space(folder, disk.f_bavail.saturating_mul(disk.f_frsize), files));
    }
    let (blades, newest_ns) = blades(&folder.join("blades"), MAX_BLADES);
    let is_empty = blades.iter().any(|finding| finding.check == BLADES && finding.found.starts_with("0 "));
    all.extend(blades);
    all.push(removed(folder, is_empty));
    all.push(archived(&folder.join("archive"), archive_max));
    (all, newest_ns)
}

fn folder_is_there(folder: &Path) -> Finding {
    const CHECK: &str = "store";
    let place = folder.display();
    let expected = "a folder that the station may write to";
    let remedy = "make it (StateDirectory= of the unit does), or set store.directory to another path";
    match fs::metadata(folder) {
        Ok(metadata) if metadata.is_dir() => Finding::ok(CHECK, place, owner(&metadata)),
        Ok(_) => Finding::trouble(CHECK, place, "it is not a folder", expected, remedy),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            Finding::trouble(CHECK, place, "it is not there yet", expected, remedy)
        }
        Err(error) => Finding::trouble(CHECK, place, error.to_string(), expected, remedy),
    }
}

/// Whether a file can really be put there and on disk, by this user.
fn writable(folder: &Path) -> Finding {
    const CHECK: &str = "store.writable";
    const PROBE: &str = ".doctor";
    let written = write_atomically(folder, PROBE, &[b'#'; 16 * 1024])
        .and_then(|()| fs::remove_file(folder.join(PROBE)));
    match written {
        Ok(()) => Finding::ok(CHECK, folder.display(), "16 KiB were written, put on disk and removed"),
        Err(error) => {
            let (found, remedy) = unwritable(&error);
            let expected = "a folder on a disk with room that may be written";
            Finding::trouble(CHECK, folder.display(), format!("{found}: {error}"), expected, remedy)
        }
    }
}

/// What a refused write means, and what to do.
fn unwritable(error: &io::Error) -> (&'static str, &'static str) {
    match error.kind() {
        ErrorKind::StorageFull => {
            ("the disk is full", "make room on it, or set store.directory to a larger one")
        }
        ErrorKind::QuotaExceeded => {
            ("the user's share of the disk is used up", "make room, raise the quota, or set store.directory")
        }
        ErrorKind::ReadOnlyFilesystem => (
            "the disk is read-only",
            "remount it (the system's log says why), or set store.directory to another one",
        ),
        ErrorKind::PermissionDenied => (
            "this user may not write to it",
            "run this as the station's user, mend its owner and mode, or set store.directory",
        ),
        _ => ("it cannot be written", "mend the disk, or set store.directory to another one"),
    }
}

/// Whether there is room on the disk: bytes, and files where it counts them.
fn space(folder: &Path, bytes: u64, files: Option<u64>) -> Finding {
    const CHECK: &str = "store.space";
    let shown = format!("{} MiB", bytes >> 20);
    let counted = files.map_or_else(String::new, |files| format!(" and {files} files"));
    let found = format!("{shown}{counted} are free");
    if bytes >= MIN_BYTES && files.is_none_or(|files| files >= MIN_FILES) {
        return Finding::ok(CHECK, folder.display(), found);
    }
    let expected = format!("{} MiB and {MIN_FILES} files", MIN_BYTES >> 20);
    let remedy = "make room, lower store.archive_max, or set store.directory to a larger disk";
    Finding::trouble(CHECK, folder.display(), found, expected, remedy)
}

/// The files of the blades, each read as the station reads it; and the newest of their times.
fn blades(folder: &Path, capacity: usize) -> (Vec<Finding>, Option<u64>) {
    const CHECK: &str = "store.blades";
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return (
                vec![Finding::ok(CHECK, folder.display(), "it is not there; the station makes it")],
                None,
            );
        }
        Err(error) => {
            let (found, remedy) = (error.to_string(), "run this as the station's user or as root");
            return (
                vec![Finding::trouble(CHECK, folder.display(), found, "a folder that may be read", remedy)],
                None,
            );
        }
    };
    let (mut good, mut pinned, mut newest_ns, mut refused) = (0, 0, None, Vec::new());
    for entry in entries.flatten() {
        let file = entry.file_name();
        let shown = file.to_string_lossy();
        let Some(name) = blade_name(&shown) else { continue };
        let path = entry.path();
        if file.to_str().is_none() {
            let reason = format!("{}: the name of this file is not UTF-8", one_line(&path));
            refused.push((reason, "rename it: a blade is called as its file".to_owned()));
            continue;
        }
        let modified_ns = Signature::of(&path).map_or(0, |seen| seen.modified_unix_ns());
        let read = text(&path).map_err(|error| error.to_string());
        let read = read
            .and_then(|text| Record::parse(name, &text, modified_ns).map_err(|error| format!(":{error}")));
        match read {
            Ok(record) => {
                good += 1;
                pinned += usize::from(record.pinned);
                newest_ns = newest_ns.max(Some(record.blade.captured_unix_ns()));
            }
            Err(reason) => {
                let served = if has_last_good(folder, name) {
                    "the last good blade of that name is served meanwhile"
                } else {
                    "no blade of that name is served meanwhile"
                };
                refused.push((
                    format!("{}{reason}", one_line(&path)),
                    format!("mend the file or remove it; {served}"),
                ));
            }
        }
    }
    refused.sort();
    let mut all = vec![count(folder, good, pinned, capacity)];
    let more = refused.len().saturating_sub(MAX_NAMED);
    for (reason, remedy) in refused.iter().take(MAX_NAMED) {
        all.push(Finding::trouble(
            "store.refused",
            reason,
            "this file is no blade",
            "a blade's file",
            remedy,
        ));
    }
    if more > 0 {
        let found = format!("{more} more files are no blades");
        let remedy = "see sward-capture blades list, or the log";
        all.push(Finding::trouble("store.refused", folder.display(), found, "blades' files", remedy));
    }
    (all, newest_ns)
}

/// Whether the history beside the folder of blades has a blade that stands in for a file of this name.
fn has_last_good(blades: &Path, name: &str) -> bool {
    blades.parent().is_some_and(|store| shelf::newest_of_name(&store.join("history"), name).is_some())
}

/// What was removed and could come back.
fn removed(store: &Path, is_empty: bool) -> Finding {
    const CHECK: &str = "store.history";
    let (blades, history) = (store.join("blades"), store.join("history"));
    let is_there = |name: &String| blades.join(format!("{name}{SUFFIX}")).exists();
    let gone = shelf::names(&history).into_iter().filter(|name| !is_there(name));
    let gone = gone.filter(|name| shelf::newest_of_name(&history, name).is_some()).count();
    let found = format!("{} whose name no file has now", counted(gone as u64, "removed blade"));
    if is_empty && gone > 0 {
        let remedy = "where nobody meant to remove them all, start the station and run sward-capture blades restore --all";
        let found = format!("{found}, and no blade is left");
        return Finding::trouble(CHECK, history.display(), found, "blades in the library", remedy);
    }
    let hint = if gone > 0 { "; sward-capture blades restore brings them back" } else { "" };
    Finding::ok(CHECK, history.display(), format!("{found}{hint}"))
}

/// Whether a library holds them all.
fn count(folder: &Path, blades: usize, pinned: usize, capacity: usize) -> Finding {
    const CHECK: &str = BLADES;
    let found = format!("{}, {pinned} of them pinned", counted(blades as u64, "blade"));
    if pinned >= capacity {
        let remedy = "set pinned = false in some of their files, or remove some";
        let expected = format!("fewer than {capacity} pinned ones, so that a new one finds room");
        return Finding::trouble(CHECK, folder.display(), found, expected, remedy);
    }
    if blades > capacity {
        let remedy = "start the station, which moves the oldest to the archive";
        return Finding::trouble(CHECK, folder.display(), found, format!("{capacity} at most"), remedy);
    }
    let full = if blades == capacity { "; it is full: the oldest go to the archive" } else { "" };
    Finding::ok(CHECK, folder.display(), format!("{found}, of {capacity}{full}"))
}

fn archived(folder: &Path, limit: usize) -> Finding {
    const CHECK: &str = "store.archive";
    let files = archive::files(folder);
    let bytes: u64 = files.iter().filter_map(|path| fs::metadata(path).ok()).map(|it| it.len()).sum();
    let held = counted(files.len() as u64, "blade");
    let found = format!("{held}, {} MiB, of {limit} at most", bytes >> 20);
    if files.len() <= limit {
        return Finding::ok(CHECK, folder.display(), found);
    }
    let remedy = "start the station anew, which deletes the oldest; or raise store.archive_max";
    Finding::trouble(CHECK, folder.display(), found, format!("{limit} at most"), remedy)
}

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::super::tests::assert_trouble;
    use super::*;

    const FERN: &str = "format = 1\ncaptured_unix_ns = 5000\nknots = [\n  { position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004] },\n  { position_m = [0.0, 0.2, 0.0], half_width_m = [0.0, 0.0] },\n]\n";

    #[test]
    fn a_folder_that_is_missing_or_none_is_trouble() {
        let place = tempfile::tempdir().expect("a folder");
        let lost = place.path().join("lost");
        let (found, _) = examine(&lost, 10);
        assert_eq!(found.len(), 1, "nothing else can be said of it");
        assert_trouble(&found[0], &["lost", "not there", "store.directory"]);
        fs::write(&lost, "").expect("room");
        assert_trouble(&examine(&lost, 10).0[0], &["not a folder"]);
        // Nothing can be written to a folder that is a file, whoever we are.
        assert_trouble(&writable(&lost), &["cannot be written"]);
    }

    #[test]
    fn why_a_disk_refuses_is_said_in_words() {
        for (errno, found) in [
            (rustix::io::Errno::NOSPC, "full"),
            (rustix::io::Errno::ROFS, "read-only"),
            (rustix::io::Errno::ACCESS, "this user"),
            (rustix::io::Errno::DQUOT, "share"),
            (rustix::io::Errno::IO, "cannot be written"),
        ] {
            assert!(unwritable(&errno.into()).0.contains(found), "{errno}");
        }
    }

    #[test]
    fn a_probe_leaves_nothing_behind() {
        let place = tempfile::tempdir().expect("a folder");
        assert_eq!(writable(place.path()).verdict, Verdict::Ok);
        assert_eq!(fs::read_dir(place.path()).expect("it is there").count(), 0);
    }

    #[test]
    fn a_disk_without_room_is_trouble() {
        let of = |bytes, files| space(Path::new("/s"), bytes, files);
        assert_eq!(of(MIN_BYTES, None).verdict, Verdict::Ok);
        assert_trouble(&of(MIN_BYTES - 1, Some(1 << 30)), &["63 MiB", "expected 64 MiB", "make room"]);
        assert_trouble(&of(1 << 40, Some(100)), &["100 files"]);
    }

    #[test]
    fn files_that_are_no_blades_are_named_with_their_place() {
        let place = tempfile::tempdir().expect("a folder");
        let blades = place.path().join("blades");
        fs::create_dir(&blades).expect("room");
        fs::write(blades.join("fern.toml"), FERN).expect("room");
        fs::write(blades.join("broken.toml"), FERN.replace("0.2", "oops")).expect("room");
        fs::write(blades.join("notes.txt"), "no blade's file").expect("room");
        let (found, newest_ns) = examine(place.path(), 10);
        let of = |check: &str| found.iter().find(|finding| finding.check == check).expect("it is checked");
        assert_trouble(of("store.refused"), &["broken.toml:5:24", "mend", "no blade of that name is served"]);
        assert_eq!((of("store.blades").verdict, newest_ns), (Verdict::Ok, Some(5000)));
        assert!(of("store.blades").found.starts_with("1 blade, 0 of them pinned, of 4096"), "{found:?}");
        assert_eq!(
            found.iter().filter(|finding| finding.verdict == Verdict::Trouble).count(),
            1,
            "{found:?}"
        );
        // Where its history has a blade, that one stands in for it.
        let shelf = place.path().join("history/broken");
        fs::create_dir_all(&shelf).expect("room");
        fs::write(shelf.join("000001.toml"), FERN).expect("room");
        let (found, _) = examine(place.path(), 10);
        let refused = found.iter().find(|finding| finding.check == "store.refused").expect("it is checked");
        assert_trouble(refused, &["the last good blade of that name is served"]);
    }

    #[test]
    fn an_emptied_library_is_trouble_and_the_way_back_is_said() {
        let place = tempfile::tempdir().expect("a folder");
        let [blades, shelf] = ["blades", "history/fern"].map(|name| place.path().join(name));
        fs::create_dir(&blades).expect("room");
        let history = || {
            let (found, _) = examine(place.path(), 10);
            found.into_iter().find(|finding| finding.check == "store.history").expect("it is checked")
        };
        assert_eq!(history().verdict, Verdict::Ok, "there never was a blade");
        fs::create_dir_all(&shelf).expect("room");
        fs::write(shelf.join("000001.toml"), FERN).expect("room");
        assert_trouble(&history(), &["1 removed blade", "no blade is left", "restore --all"]);
        fs::write(blades.join("moss.toml"), FERN).expect("room");
        assert!(history().verdict == Verdict::Ok && history().found.contains("restore"), "{}", history());
        fs::write(blades.join("fern.toml"), FERN).expect("room");
        assert!(history().found.starts_with("0 removed blades"), "{}", history());
    }

    #[test]
    fn a_file_whose_name_is_not_utf8_is_named_as_that() {
        use std::os::unix::ffi::OsStrExt;
        let place = tempfile::tempdir().expect("a folder");
        let blades = place.path().join("blades");
        fs::create_dir(&blades).expect("room");
        let name = std::ffi::OsStr::from_bytes(b"f\xffrn.toml");
        fs::write(blades.join(name), FERN).expect("room");
        let (found, _) = examine(place.path(), 10);
        let refused = found.iter().find(|finding| finding.check == "store.refused").expect("it is checked");
        assert_trouble(refused, &["not UTF-8", "rename it"]);
    }

    #[test]
    fn more_blades_than_a_library_or_an_archive_holds_are_trouble() {
        let place = tempfile::tempdir().expect("a folder");
        let of = |blades, pinned| count(Path::new("/s"), blades, pinned, 3);
        assert_eq!(of(3, 2).verdict, Verdict::Ok);
        assert!(of(3, 2).found.contains("full"));
        assert_trouble(&of(4, 0), &["4 blades", "3 at most"]);
        assert_trouble(&of(3, 3), &["3 of them pinned", "pinned = false"]);
        for name in ["fern", "moss"] {
            let shelf = place.path().join("archive").join(name);
            fs::create_dir_all(&shelf).expect("room");
            fs::write(shelf.join("000001.toml"), FERN).expect("room");
        }
        let archive = place.path().join("archive");
        assert_eq!(archived(&archive, 2).verdict, Verdict::Ok);
        assert_trouble(&archived(&archive, 1), &["2 blades", "store.archive_max"]);
    }
}
