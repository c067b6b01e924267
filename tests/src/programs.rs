//! The two programs, as a user runs them: with a deadline, their output kept, and killed when the
//! test that started them is over.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Once;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use crate::root;

/// How long a program may take before it counts as hung.
pub const DEADLINE: Duration = Duration::from_secs(60);

/// One of the two programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// `sward-capture`.
    Capture,
    /// `sward-render`.
    Render,
}

impl Program {
    /// Its file, built from the sources as they are.
    pub fn path(self) -> PathBuf {
        static BUILT: Once = Once::new();
        let test = std::env::current_exe().expect("a test has a path");
        let profile = test.ancestors().nth(2).expect("a test lies in target/<profile>/deps");
        // In the small machine they are as they were packed.
        BUILT.call_once(|| {
            if !crate::vm::is_inside() {
                build(profile)
            }
        });
        profile.join(match self {
            Self::Capture => "sward-capture",
            Self::Render => "sward-render",
        })
    }

    /// The program with arguments, run from the workspace's folder, without a display.
    pub fn command<A: AsRef<OsStr>>(self, arguments: impl IntoIterator<Item = A>) -> Command {
        let mut command = Command::new(self.path());
        command.args(arguments).current_dir(root()).stdin(Stdio::null());
        for variable in
            ["DISPLAY", "WAYLAND_DISPLAY", "SWARD_LOG", "NOTIFY_SOCKET", "LISTEN_FDS", "STATE_DIRECTORY"]
        {
            command.env_remove(variable);
        }
        // Where it is not set, Vulkan drivers that look for a display complain on stderr.
        command.env("XDG_RUNTIME_DIR", std::env::temp_dir());
        command
    }

    /// Runs it to its end.
    pub fn run<A: AsRef<OsStr>>(self, arguments: impl IntoIterator<Item = A>) -> Finished {
        Running::start(self.command(arguments)).finish(DEADLINE)
    }
}

/// Has cargo bring the programs up to date: it alone knows whether they are.
fn build(profile: &Path) {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()));
    cargo.args(["build", "--locked", "--quiet", "--workspace", "--bins"]).current_dir(root());
    if profile.ends_with("release") {
        cargo.arg("--release");
    }
    assert!(cargo.status().expect("cargo runs").success(), "the programs do not build");
}

/// What a program left behind.
#[derive(Clone, Debug)]
pub struct Finished {
    /// Its exit code; `None`: killed by a signal.
    pub code: Option<i32>,
    /// What it wrote to stdout.
    pub stdout: String,
    /// What it wrote to stderr.
    pub stderr: String,
}

/// A program at work; killed when dropped.
#[derive(Debug)]
pub struct Running {
    child: Child,
    stdout: Option<JoinHandle<String>>,
    stderr: Option<JoinHandle<String>>,
}

fn collect(pipe: impl Read + Send + 'static, heard: impl Fn(&str) + Send + 'static) -> JoinHandle<String> {
    std::thread::spawn(move || {
        let mut pipe = BufReader::new(pipe);
        let mut text = String::new();
        let mut line = Vec::new();
        while pipe.read_until(b'\n', &mut line).expect("a pipe is readable") > 0 {
            let read = String::from_utf8_lossy(&line);
            heard(read.trim_end_matches('\n'));
            text.push_str(&read);
            line.clear();
        }
        text
    })
}

impl Running {
    /// Starts a command and keeps what it writes.
    pub fn start(command: Command) -> Self {
        Self::follow(command, |_| {})
    }

    /// The same; `heard` is called with each line that it writes, to either pipe, as soon as it is there.
    pub fn follow(mut command: Command, heard: impl Fn(&str) + Clone + Send + 'static) -> Self {
        let mut child = command
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| panic!("{command:?}: {error}"));
        let stdout = child.stdout.take().map(|pipe| collect(pipe, heard.clone()));
        let stderr = child.stderr.take().map(|pipe| collect(pipe, heard));
        Self { child, stdout, stderr }
    }

    /// Waits for its end.
    ///
    /// # Panics
    /// If it does not end within `deadline`; it is killed then, and the message shows what it wrote.
    pub fn finish(mut self, deadline: Duration) -> Finished {
        let status = wait_for(deadline, || self.ended());
        if status.is_none() {
            self.kill();
        }
        let finished = Finished {
            code: status.and_then(|status| status.code()),
            stdout: self.stdout.take().expect("taken once").join().expect("the reader does not panic"),
            stderr: self.stderr.take().expect("taken once").join().expect("the reader does not panic"),
        };
        assert!(status.is_some(), "still running after {deadline:?}: {finished:?}");
        finished
    }

    /// Its exit status if it has ended.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().expect("a child can be waited for")
    }

    /// Waits until `socket` answers.
    ///
    /// # Panics
    /// If the program ends before, or takes longer than [`DEADLINE`]; the message shows what it wrote.
    pub fn wait_for_socket(mut self, socket: &Path) -> Self {
        let answers = wait_for(DEADLINE, || {
            let connected = std::os::unix::net::UnixStream::connect(socket).is_ok();
            (connected || self.ended().is_some()).then_some(connected)
        });
        if answers != Some(true) {
            self.kill();
            panic!("{} does not answer: {:?}", socket.display(), self.finish(DEADLINE));
        }
        self
    }

    /// Asks it to end (SIGTERM).
    pub fn terminate(&self) {
        self.signal(Signal::TERM);
    }

    /// Sends it a signal.
    pub fn signal(&self, signal: Signal) {
        let id = i32::try_from(self.id()).ok().and_then(Pid::from_raw).expect("a process has an id");
        kill_process(id, signal).expect("it has not been waited for");
    }

    /// Its process id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Kills it and waits for its end.
    pub fn kill(&mut self) {
        // It may have ended by itself: nothing to kill then.
        let _ = self.child.kill();
        self.child.wait().expect("a child can be waited for");
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Asks until there is an answer, at most for `deadline`.
pub fn wait_for<T>(deadline: Duration, mut ask: impl FnMut() -> Option<T>) -> Option<T> {
    let start = Instant::now();
    loop {
        let answer = ask();
        if answer.is_some() || start.elapsed() > deadline {
            return answer;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str) -> Running {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        Running::start(command)
    }

    #[test]
    fn output_and_exit_code_are_kept() {
        let finished = shell("echo out; echo err >&2; exit 3").finish(DEADLINE);
        assert_eq!((finished.code, &*finished.stdout, &*finished.stderr), (Some(3), "out\n", "err\n"));
        assert_eq!(shell("kill -9 $$").finish(DEADLINE).code, None);
    }

    #[test]
    #[should_panic(expected = "still running after")]
    fn a_program_that_hangs_is_killed_and_shown() {
        shell("echo here; exec sleep 1000").finish(Duration::from_millis(100));
    }

    #[test]
    #[should_panic(expected = "does not answer")]
    fn a_program_that_ends_before_its_socket_answers_is_shown() {
        drop(shell("exit 1").wait_for_socket(Path::new("/no/such/socket")));
    }

    #[test]
    fn a_program_that_is_asked_to_end_may_do_so_in_its_own_way() {
        let mut running = shell("trap 'exit 5' TERM; echo ready; while :; do sleep 0.01; done");
        std::thread::sleep(Duration::from_millis(200));
        assert_eq!(running.ended(), None);
        running.terminate();
        assert_eq!(running.finish(DEADLINE).code, Some(5));
    }

    #[test]
    fn a_dropped_program_is_gone() {
        let running = shell("exec sleep 1000");
        let process = PathBuf::from(format!("/proc/{}", running.child.id()));
        assert!(process.exists());
        drop(running);
        assert!(!process.exists());
    }
}
