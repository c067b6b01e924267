//! The machine itself: names, limits, sealed memory, its clock.

use std::fs;
use std::os::fd::OwnedFd;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use common::sealed::{SealedBytes, SealedError};
use rustix::process::{Resource, getrlimit};

use super::Finding;
use crate::config::{ServiceConfig, is_known};

/// A clock that shows less was never set: this was written later.
const EARLIEST: Duration = Duration::from_secs(1_735_689_600);
/// A clock that shows more is wrong: the year 2100.
const LATEST: Duration = Duration::from_secs(4_102_444_800);
/// How much two clocks may differ.
const SLACK: Duration = Duration::from_secs(120);
/// Descriptors that a station needs beside those of its connections.
const OWN_FILES: u64 = 64;

/// Whether the users and groups that the service lets in are known.
pub(super) fn names(service: &ServiceConfig) -> Vec<Finding> {
    let lists = [("service.watch", &service.watch), ("service.change", &service.change)];
    let of_list = |(key, list): (&'static str, &Vec<String>)| {
        let unknown: Vec<&str> =
            list.iter().map(String::as_str).filter(|entry| *entry != "*" && !is_known(entry)).collect();
        if unknown.is_empty() {
            return Finding::ok(key, "", format!("{list:?}, all of them known"));
        }
        let found = format!("this machine knows no {}", unknown.join(", "));
        let expected = "users, and groups with @ before them";
        Finding::trouble(key, "", found, expected, "mend the name, or add the user or group")
    };
    lists.map(of_list).into()
}

/// Whose limit of open descriptors was asked for, and what it is; `None`: there is none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum OpenFiles {
    /// Of the station that runs.
    Station { pid: u32, limit: Option<u64> },
    /// No station runs: of a process that is started here.
    Here(Option<u64>),
    /// One runs, and its limit cannot be read, with the reason.
    Unknown(String),
}

impl OpenFiles {
    /// Of the process with which a station answers, as the socket's credentials name it; `None` where none does.
    pub(super) fn of(station: Option<u32>) -> Self {
        let Some(pid) = station else { return Self::Here(getrlimit(Resource::Nofile).current) };
        let read = |name: &str| fs::read_to_string(format!("/proc/{pid}/{name}"));
        // Where systemd made the socket, it is systemd that is named.
        match (read("comm"), read("limits")) {
            (Ok(name), Ok(limits)) if name.trim() != "systemd" => match open_files_of(&limits) {
                Some(limit) => Self::Station { pid, limit },
                None => Self::Unknown(format!("/proc/{pid}/limits is not understood")),
            },
            (Ok(name), _) => Self::Unknown(format!(
                "the socket is that of process {pid} ({}), and which process the station is cannot be told",
                name.trim()
            )),
            (Err(error), _) => {
                Self::Unknown(format!("the station's process {pid} cannot be looked at: {error}"))
            }
        }
    }
}

/// The soft limit of open files in a process's `limits` (proc(5)); the inner `None`: there is none.
fn open_files_of(limits: &str) -> Option<Option<u64>> {
    let line = limits.lines().find_map(|line| line.strip_prefix("Max open files"))?;
    match line.split_whitespace().next()? {
        "unlimited" => Some(None),
        number => number.parse().ok().map(Some),
    }
}

/// Whether so many descriptors are enough for so many connections: each has two, and one more with a reply.
pub(super) fn open_files(of: &OpenFiles, max_connections: usize) -> Finding {
    const CHECK: &str = "limits.files";
    let needed = OWN_FILES + 3 * max_connections as u64;
    let (place, limit) = match of {
        OpenFiles::Station { pid, limit } => (format!("the station (process {pid})"), limit),
        OpenFiles::Here(limit) => ("a process started here".to_owned(), limit),
        OpenFiles::Unknown(reason) => {
            let found = format!("{reason}; {needed} open files are needed (LimitNOFILE= of the unit)");
            return Finding::skipped(CHECK, "", found);
        }
    };
    match limit {
        Some(limit) if *limit < needed => Finding::trouble(
            CHECK,
            place,
            format!("it may have {limit} open files"),
            format!("{needed}, for service.max_connections = {max_connections}"),
            "raise it (ulimit -n; LimitNOFILE= of the unit) and start the station anew, or lower service.max_connections",
        ),
        Some(limit) => Finding::ok(CHECK, place, format!("{limit} open files, {needed} needed")),
        None => Finding::ok(CHECK, place, format!("no limit of open files, {needed} needed")),
    }
}

/// Whether memory can be sealed and mapped, as libraries are passed on.
pub(super) fn memfd(seal: impl FnOnce(&str, &[u8]) -> Result<OwnedFd, SealedError>) -> Finding {
    const CHECK: &str = "limits.memfd";
    let bytes = [7; 4096];
    let sealed = seal("doctor", &bytes).and_then(|memfd| SealedBytes::map(memfd, bytes.len() as u64));
    let reason = match sealed {
        Ok(mapped) if mapped.as_ref() == bytes => {
            return Finding::ok(CHECK, "", "memory can be sealed and passed on");
        }
        Ok(_) => "it holds other bytes than were written".to_owned(),
        Err(error) => error.to_string(),
    };
    let expected = "a memfd that can be sealed and mapped";
    let remedy = "use Linux 3.17 or newer, and let memfd_create and fcntl through where calls are filtered";
    Finding::trouble(CHECK, "", format!("a library cannot be passed on: {reason}"), expected, remedy)
}

/// Whether the clock is set. `newest_ns`: the time of the newest blade, nanoseconds since 1970.
pub(super) fn clock(now: SystemTime, newest_ns: Option<u64>) -> Finding {
    const CHECK: &str = "clock";
    let since_1970 = now.duration_since(UNIX_EPOCH).unwrap_or_default();
    let shown = humantime::format_rfc3339_seconds(UNIX_EPOCH + since_1970).to_string();
    let remedy = "set it, and let chrony or systemd-timesyncd keep it";
    if !(EARLIEST..LATEST).contains(&since_1970) {
        return Finding::trouble(CHECK, "", format!("it shows {shown}"), "a year from 2025 on", remedy);
    }
    let newest = newest_ns.map(Duration::from_nanos).filter(|newest| *newest > since_1970 + SLACK);
    let Some(newest) = newest else { return Finding::ok(CHECK, "", shown) };
    let newest = humantime::format_rfc3339_seconds(UNIX_EPOCH + newest);
    let found = format!("it shows {shown}, which is before the newest blade was captured ({newest})");
    let remedy = "set it; generations grow nevertheless, but blades' dates are wrong meanwhile";
    Finding::trouble(CHECK, "", found, "a time after that of every blade", remedy)
}

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::super::tests::assert_trouble;
    use super::*;

    #[test]
    fn a_user_that_is_not_there_is_named() {
        let lists = |watch: &[&str]| {
            let watch = watch.iter().map(|name| (*name).to_owned()).collect();
            names(&ServiceConfig { watch, ..ServiceConfig::default() })
        };
        let found = lists(&["*", "root", "@root", "4242", "@4242"]);
        assert!(found.iter().all(|finding| finding.verdict == Verdict::Ok), "{found:?}");
        assert_trouble(&lists(&["root", "@no-such-group"])[0], &["service.watch", "@no-such-group", "mend"]);
        assert_trouble(&lists(&["nobody-of-that-name"])[0], &["nobody-of-that-name"]);
    }

    #[test]
    fn too_few_descriptors_are_trouble() {
        assert_eq!(open_files(&OpenFiles::Here(Some(1024)), 256).verdict, Verdict::Ok);
        assert_eq!(open_files(&OpenFiles::Here(None), 10_000).verdict, Verdict::Ok);
        let few = open_files(&OpenFiles::Station { pid: 77, limit: Some(1024) }, 1000);
        assert_trouble(&few, &["process 77", "1024", "3064", "service.max_connections = 1000"]);
        let unknown = open_files(&OpenFiles::Unknown("nobody knows".to_owned()), 1000);
        assert!(
            unknown.verdict == Verdict::Skipped && unknown.found.contains("nobody knows; 3064"),
            "{unknown:?}"
        );
    }

    #[test]
    fn limits_are_those_of_the_station_that_answers() {
        let limits = "Limit        Soft Limit   Hard Limit   Units\nMax processes  7  8  processes\nMax open files    512       4096      files\n";
        assert_eq!(open_files_of(limits), Some(Some(512)));
        assert_eq!(open_files_of("Max open files   unlimited unlimited files\n"), Some(None));
        assert_eq!(open_files_of("Max open files\n"), None);
        assert!(matches!(OpenFiles::of(None), OpenFiles::Here(_)));
        let own = getrlimit(Resource::Nofile).current;
        let pid = std::process::id();
        assert_eq!(OpenFiles::of(Some(pid)), OpenFiles::Station { pid, limit: own });
        let none = OpenFiles::of(Some(u32::MAX));
        assert!(
            matches!(&none, OpenFiles::Unknown(reason) if reason.contains("cannot be looked at")),
            "{none:?}"
        );
    }

    #[test]
    fn memory_that_cannot_be_sealed_is_trouble() {
        let unsealed = |_: &str, _: &[u8]| Ok(tempfile::tempfile().expect("a file").into());
        assert_trouble(&memfd(unsealed), &["cannot be passed on", "memfd_create"]);
        let other = |name: &str, _: &[u8]| common::sealed::seal(name, &[8; 4096]);
        assert_trouble(&memfd(other), &["other bytes"]);
        assert_eq!(memfd(common::sealed::seal).verdict, Verdict::Ok);
    }

    #[test]
    fn a_clock_that_was_never_set_or_lies_before_a_blade_is_trouble() {
        let at = |seconds| UNIX_EPOCH + Duration::from_secs(seconds);
        assert_trouble(&clock(at(12), None), &["1970-01-01T00:00:12Z", "set it"]);
        assert_trouble(&clock(at(5_000_000_000), None), &["2128"]);
        let (now, second) = (1_800_000_000, 1_000_000_000);
        assert_eq!(clock(at(now), Some((now + 100) * second)).verdict, Verdict::Ok);
        assert_trouble(&clock(at(now), Some((now + 200) * second)), &["2027-01-15", "newest blade"]);
    }
}
