//! A daemon in a folder of its own: its socket, its state, its configuration.

use std::ffi::OsString;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

use crate::programs::{DEADLINE, Finished, Program, Running};
use crate::shipped_recording;
use crate::station::Station;

/// A daemon at work; killed when dropped.
#[derive(Debug)]
pub struct Daemon {
    folder: TempDir,
    running: Running,
}

impl Daemon {
    /// Starts one on the shipped recording, or a sensor that the settings name, with other settings over that: key and
    /// TOML value.
    ///
    /// # Panics
    /// If its socket does not answer.
    pub fn start(settings: &[(&str, String)]) -> Self {
        Self::start_in(tempfile::tempdir().expect("a temporary folder"), settings)
    }

    /// The same in a folder that may hold what an earlier one left.
    ///
    /// # Panics
    /// If its socket does not answer.
    pub fn start_in(folder: TempDir, settings: &[(&str, String)]) -> Self {
        let command = Self::command(folder.path(), settings);
        Self::start_command(folder, command)
    }

    /// What starts a daemon in `folder`.
    ///
    /// # Panics
    /// If the folder cannot be opened to other users.
    pub fn command(folder: &Path, settings: &[(&str, String)]) -> Command {
        // Tests connect as other users, too.
        std::fs::set_permissions(folder, PermissionsExt::from_mode(0o755)).expect("it is ours");
        let has_sensor = settings.iter().any(|(key, _)| *key == "sensor.driver");
        let recording = (!has_sensor).then(|| ("source.recording", format!("{:?}", shipped_recording())));
        let own = [
            ("service.socket", format!("{:?}", folder.join("station.socket"))),
            ("store.directory", format!("{:?}", folder.join("state"))),
        ];
        let mut arguments: Vec<OsString> = vec!["run".into()];
        if folder.join("station.toml").exists() {
            arguments.extend(["--config".into(), folder.join("station.toml").into()]);
        }
        for (key, value) in recording.iter().chain(&own).chain(settings) {
            arguments.extend(["--set".into(), format!("{key}={value}").into()]);
        }
        Program::Capture.command(arguments)
    }

    /// Starts what [`Self::command`] gave, or something made of it.
    ///
    /// # Panics
    /// If its socket does not answer.
    pub fn start_command(folder: TempDir, command: Command) -> Self {
        Self::start_followed(folder, command, |_| {})
    }

    /// The same; `heard` is called with each line that it writes.
    ///
    /// # Panics
    /// If its socket does not answer.
    pub fn start_followed(
        folder: TempDir,
        command: Command,
        heard: impl Fn(&str) + Clone + Send + 'static,
    ) -> Self {
        let socket = folder.path().join("station.socket");
        let running = Running::follow(command, heard).wait_for_socket(&socket);
        // It listens before all is read; who is answered finds it ready.
        Station::connect(&socket).status();
        Self { folder, running }
    }

    /// Its folder.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Its socket.
    pub fn socket(&self) -> PathBuf {
        self.folder().join("station.socket")
    }

    /// Where its blades' files are.
    pub fn blades(&self) -> PathBuf {
        self.folder().join("state/blades")
    }

    /// A connection to it.
    pub fn connect(&self) -> Station {
        Station::connect(&self.socket())
    }

    /// Its process.
    pub fn running(&mut self) -> &mut Running {
        &mut self.running
    }

    /// Kills it as a power failure would; gives its folder back.
    pub fn kill(mut self) -> TempDir {
        self.running.kill();
        self.folder
    }

    /// Asks it to end, and waits for that; its folder and what it left behind.
    pub fn end(self) -> (TempDir, Finished) {
        self.running.terminate();
        (self.folder, self.running.finish(DEADLINE))
    }

    /// Runs `sward-capture` with these arguments and its socket.
    pub fn client(&self, arguments: &[&str]) -> Finished {
        let mut command = Program::Capture.command(arguments);
        command.arg("--socket").arg(self.socket()).env("SWARD_LOG", "off");
        Running::start(command).finish(DEADLINE)
    }
}
