//! OpenCV's four calls, timed in a Python of its own that waits for its turns.

use std::io::{BufRead, BufReader, Lines, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::Context;
use capture_daemon::frame::DepthFrame;

/// The Python at work; it ends when this goes.
pub(crate) struct OpenCv {
    child: Child,
    asked: Option<ChildStdin>,
    answers: Lines<BufReader<ChildStdout>>,
    _frames: tempfile::TempDir,
}

impl OpenCv {
    /// Starts it with the frames that it will be asked for; none without `SWARD_PYTHON`.
    pub(crate) fn start(frames: &[&DepthFrame]) -> anyhow::Result<Option<Self>> {
        let Ok(python) = std::env::var("SWARD_PYTHON") else {
            println!("SWARD_PYTHON is not set: nothing is compared with OpenCV.\n");
            return Ok(None);
        };
        let folder = tempfile::tempdir()?;
        let mut command = Command::new(python);
        command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/opencv.py"));
        for (index, frame) in frames.iter().enumerate() {
            let path = folder.path().join(index.to_string());
            let bytes: Vec<u8> = frame.depth.iter().flat_map(|counts| counts.to_le_bytes()).collect();
            std::fs::write(&path, bytes)?;
            command.arg(frame.width.to_string()).arg(path);
        }
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .context("SWARD_PYTHON cannot be run")?;
        let asked = child.stdin.take();
        let answers = BufReader::new(child.stdout.take().context("it has no output")?).lines();
        let mut opencv = Self { child, asked, answers, _frames: folder };
        let version = opencv.answer()?;
        println!("OpenCV {version}: threshold, 3x3 opening, connectedComponents, findContours\n");
        Ok(Some(opencv))
    }

    /// Milliseconds that the four calls on a frame take, `times` times.
    pub(crate) fn times_ms(&mut self, frame: usize, times: usize) -> anyhow::Result<Vec<f64>> {
        let asked = self.asked.as_mut().context("it is at its end")?;
        writeln!(asked, "{frame} {times}")?;
        asked.flush()?;
        let answer: Vec<f64> = self.answer()?.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        anyhow::ensure!(answer.len() == times, "benches/opencv.py printed {} times", answer.len());
        Ok(answer)
    }

    fn answer(&mut self) -> anyhow::Result<String> {
        Ok(self.answers.next().context("benches/opencv.py ended: see above")??)
    }
}

impl Drop for OpenCv {
    fn drop(&mut self) {
        // Without more to read it ends by itself; nobody is left to be told how.
        self.asked = None;
        let _ = self.child.wait();
    }
}
