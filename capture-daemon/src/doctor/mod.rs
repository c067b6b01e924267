//! The verb `doctor`: everything that can be wrong on a machine, and what to do about it.
//!
//! Each check is a function of what it looks at, and gives findings; nothing is changed but for a file that is
//! written to the store and removed again. What may hang is given a deadline.

mod machine;
mod sensors;
mod socket;
mod source;
mod station;
mod store;
mod systemd;

use std::fmt;
use std::path::Path;
use std::sync::mpsc;
use std::time::{Duration, SystemTime};

use anyhow::{Context, bail};
use common::sentence::print;
use serde::Serialize;

use crate::cli::DoctorArgs;
use crate::config::{self, Config, ConfigError};

/// How long something that may hang is waited for.
const DEADLINE: Duration = Duration::from_secs(5);

/// How a check came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Nothing is wrong.
    Ok,
    /// Something is.
    Trouble,
    /// It does not apply here, or cannot be told.
    Skipped,
}

/// What a check found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// The check, such as `store.space`.
    pub check: &'static str,
    /// How it came out.
    pub verdict: Verdict,
    /// The file, the key or the unit that was looked at; empty where it is the machine.
    #[serde(rename = "where")]
    pub place: String,
    /// What is there.
    pub found: String,
    /// What should be, where that is something else.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected: Option<String>,
    /// What to do then.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

impl Finding {
    fn new(
        check: &'static str,
        verdict: Verdict,
        place: impl fmt::Display,
        found: impl Into<String>,
    ) -> Self {
        let (place, found) = (place.to_string(), found.into());
        Self { check, verdict, place, found, expected: None, remedy: None }
    }

    fn ok(check: &'static str, place: impl fmt::Display, found: impl Into<String>) -> Self {
        Self::new(check, Verdict::Ok, place, found)
    }

    fn skipped(check: &'static str, place: impl fmt::Display, found: impl Into<String>) -> Self {
        Self::new(check, Verdict::Skipped, place, found)
    }

    /// Trouble. `expected` and `remedy` go on after "expected" and a semicolon.
    fn trouble(
        check: &'static str,
        place: impl fmt::Display,
        found: impl Into<String>,
        expected: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let (expected, remedy) = (Some(expected.into()), Some(remedy.into()));
        Self { expected, remedy, ..Self::new(check, Verdict::Trouble, place, found) }
    }

    /// Trouble of which an error tells in a sentence, which may begin with `place` and may end with what was
    /// expected; `expected` where it does not.
    fn told(check: &'static str, place: &str, sentence: &str, expected: &str, remedy: &str) -> Self {
        let found = sentence.strip_prefix(place).and_then(|rest| rest.strip_prefix(": ")).unwrap_or(sentence);
        let told = found.split_once("; expected ").or_else(|| found.split_once(", expected "));
        let (found, expected) = told.unwrap_or((found, expected));
        Self::trouble(check, place, found, expected, remedy)
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = match self.verdict {
            Verdict::Ok => "ok",
            Verdict::Trouble => "TROUBLE",
            Verdict::Skipped => "skipped",
        };
        write!(to, "{verdict:7}  {:16}  ", self.check)?;
        if !self.place.is_empty() {
            write!(to, "{}: ", self.place)?;
        }
        to.write_str(&self.found)?;
        if let Some(expected) = &self.expected {
            write!(to, "; expected {expected}")?;
        }
        if let Some(remedy) = &self.remedy {
            write!(to, "; {remedy}")?;
        }
        Ok(())
    }
}

/// All findings, as JSON shows them.
#[derive(Debug, Serialize)]
struct Report<'a> {
    version: &'static str,
    trouble: usize,
    checks: &'a [Finding],
}

/// `sward-capture doctor`.
///
/// # Errors
/// When a check found trouble, which stdout says, or stdout cannot be written.
pub fn doctor(args: &DoctorArgs) -> anyhow::Result<()> {
    let checks = examine(args);
    let trouble = checks.iter().filter(|finding| finding.verdict == Verdict::Trouble).count();
    if args.json {
        let report = Report { version: env!("CARGO_PKG_VERSION"), trouble, checks: &checks };
        let text = serde_json::to_string(&report).context("the findings cannot be written as JSON")?;
        print(&format!("{text}\n"))?;
    } else {
        print(&checks.iter().map(|finding| format!("{finding}\n")).collect::<String>())?;
    }
    if trouble > 0 {
        bail!("{trouble} of {} checks found trouble; stdout says what to do about each", checks.len());
    }
    Ok(())
}

fn examine(args: &DoctorArgs) -> Vec<Finding> {
    let version = concat!("sward-capture ", env!("CARGO_PKG_VERSION"));
    let mut all = vec![Finding::ok("program", "", version)];
    let now = SystemTime::now();
    let (config, finding) = configuration(args);
    all.push(finding);
    let mut newest_ns = None;
    match config {
        Some(config) => {
            let (of_socket, running) = socket::examine(&config.service.socket, DEADLINE);
            all.extend(machine::names(&config.service));
            let played = running.as_ref().map(|running| running.source.as_str()).filter(|it| *it != "none");
            all.push(source::first_frame(&config, played, DEADLINE));
            let folder = config.store.folder(std::env::var("STATE_DIRECTORY").ok().as_deref());
            let (findings, newest) = store::examine(&folder, config.store.archive_max);
            all.extend(findings);
            newest_ns = newest;
            all.extend(of_socket);
            // The socket of a station under systemd is systemd's own.
            let of_unit = || systemd::station(Path::new("systemctl"), DEADLINE).unwrap_or(1);
            let pid = running.and_then(|running| running.pid);
            let station = pid.map(|pid| if pid == 1 { of_unit() } else { pid });
            let open_files = machine::OpenFiles::of(station);
            all.push(machine::open_files(&open_files, config.service.max_connections));
        }
        None => {
            let parts = ["source", "store", "socket", "limits.files"];
            let unknown = "what the station is to use is not known before the configuration is mended";
            all.extend(parts.map(|check| Finding::skipped(check, "", unknown)));
        }
    }
    all.push(machine::memfd(common::sealed::seal));
    all.push(machine::clock(now, newest_ns));
    all.extend(systemd::units(Path::new("systemctl"), Path::new("/run/systemd/system"), DEADLINE));
    all.extend(sensors::video(Path::new("/dev")));
    all.extend(sensors::usb(Path::new("/sys")));
    all.push(sensors::openni2(&sensors::library_folders()));
    all
}

/// The configuration, where it is valid.
fn configuration(args: &DoctorArgs) -> (Option<Config>, Finding) {
    let place =
        args.config.config.as_deref().map_or("the defaults".into(), |path| path.display().to_string());
    match config::load(args.config.config.as_deref(), &args.config.sets) {
        Ok(mut config) => {
            config.service.socket = args.socket.clone().unwrap_or(config.service.socket);
            (Some(config), Finding::ok("configuration", place, "every key is in its range"))
        }
        Err(error) => {
            let (place, reason) = match &error {
                ConfigError::Unreadable { path, reason } => (path, reason),
                ConfigError::Invalid { place, reason } => (place, reason),
            };
            let expected = "a configuration that sward-capture check-config accepts";
            let remedy = "mend it; man capture-daemon.toml documents every key";
            (None, Finding::told("configuration", place, reason, expected, remedy))
        }
    }
}

/// What `work` gives, unless it takes longer than `deadline`: then its thread is left behind.
fn within<T: Send + 'static>(deadline: Duration, work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    let (done, is_done) = mpsc::channel();
    // Where there can be no thread there is no answer.
    let _ = std::thread::Builder::new().spawn(move || done.send(work()));
    is_done.recv_timeout(deadline).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::ConfigArgs;

    /// Asserts that there is trouble that says each of `words`, and what to do.
    #[track_caller]
    pub(super) fn assert_trouble(finding: &Finding, words: &[&str]) {
        assert_eq!(finding.verdict, Verdict::Trouble, "{finding}");
        let said = finding.to_string();
        for word in words {
            assert!(said.contains(word), "does not say {word:?}: {said}");
        }
        assert!(said.contains("; expected ") && finding.remedy.is_some() && !said.contains('\n'), "{said}");
    }

    fn args(config: Option<&Path>, sets: &[&str]) -> DoctorArgs {
        let sets = sets.iter().map(|set| (*set).to_owned()).collect();
        DoctorArgs {
            socket: None,
            config: ConfigArgs { config: config.map(Path::to_path_buf), sets },
            json: true,
        }
    }

    #[test]
    fn a_broken_configuration_is_found_and_what_needs_one_is_skipped() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("station.toml");
        std::fs::write(&path, "[refine]\nknots = 65\n").expect("room");
        let found = examine(&args(Some(&path), &[]));
        let of = |check: &str| found.iter().find(|finding| finding.check == check).expect("it is checked");
        assert_trouble(of("configuration"), &["station.toml:2:9", "2 to 64", "mend it"]);
        assert_eq!(of("store").verdict, Verdict::Skipped);
        assert_eq!(of("limits.memfd").verdict, Verdict::Ok);
        let (config, finding) = configuration(&args(None, &["refine.knots=12"]));
        assert_eq!((config.map(|config| config.refine.knots), finding.verdict), (Some(12), Verdict::Ok));
    }

    #[test]
    fn what_hangs_is_left_behind() {
        let (_held, never) = mpsc::channel::<()>();
        assert_eq!(within(Duration::from_millis(5), move || never.recv()), None);
        assert_eq!(within(DEADLINE, || 7), Some(7));
    }

    #[test]
    fn what_an_error_tells_is_said_once() {
        let of =
            |sentence| Finding::told("source", "/r", sentence, "a recording", "take another").to_string();
        let said = "TROUBLE  source            /r: it is text; expected a recording; take another";
        assert_eq!(of("/r: it is text"), said);
        assert_eq!(of("it is text; expected a recording"), said);
        assert_eq!(of("/r: it is text, expected a recording"), said);
    }

    #[test]
    fn a_finding_is_a_line_and_an_object() {
        let trouble = Finding::trouble("store.space", "/s", "1 MB is free", "64 MB", "make room");
        assert_eq!(
            trouble.to_string(),
            "TROUBLE  store.space       /s: 1 MB is free; expected 64 MB; make room"
        );
        let json = serde_json::to_value(Finding::ok("clock", "", "set")).expect("JSON");
        assert_eq!(json, serde_json::json!({"check": "clock", "verdict": "ok", "where": "", "found": "set"}));
    }
}
