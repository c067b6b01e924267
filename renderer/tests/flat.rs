//! Does a meadow that is drawn for long take no more memory? It needs a Vulkan device, one in software will do; without
//! one it says so, or fails with SWARD_REQUIRE_GPU=1.

mod common;

use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Between the two looks at its memory.
const FRAMES: usize = 150;
/// Most that it may have grown meanwhile: what a driver keeps of its own, which a leak in each frame exceeds.
const GROWTH_KB: u64 = 24 * 1024;

/// A program that is killed when the test is over.
struct Program(Child);

impl Drop for Program {
    fn drop(&mut self) {
        // It may have ended by itself; then there is nothing to kill.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Program {
    /// Waits until it has drawn this frame; `false` when it ends before.
    fn draws(&mut self, folder: &Path, frame: usize) -> bool {
        let deadline = Instant::now() + Duration::from_secs(180);
        while !folder.join(format!("frame-{frame:04}.png")).exists() {
            if self.0.try_wait().expect("it can be waited for").is_some() {
                return false;
            }
            assert!(Instant::now() < deadline, "it hangs before frame {frame}");
            std::thread::sleep(Duration::from_millis(20));
        }
        true
    }

    fn resident_kb(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.0.id())).expect("it runs");
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("its resident memory");
        line.trim().trim_end_matches(" kB").parse().expect("kB")
    }
}

#[test]
fn frame_after_frame_takes_no_more_memory() {
    let folder = tempfile::tempdir().expect("a folder");
    let (library, pictures) = (folder.path().join("meadow.sward"), folder.path().join("pictures"));
    std::fs::write(&library, common::meadow(1)).expect("written");
    for shadows in ["off", "on"] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_sward-render"));
        command.arg("--headless").arg("--library").arg(&library).arg("--out").arg(&pictures);
        command.args(["--frames", "9999", "--size", "64x36", "--tiles", "200", "--shadows", shadows]);
        let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the program runs");
        let mut program = Program(child);
        if !program.draws(&pictures, 60) {
            let required = std::env::var_os("SWARD_REQUIRE_GPU").is_some_and(|value| value == "1");
            assert!(!required, "it draws nothing");
            // Not by a macro, whose output the test harness would hide.
            return writeln!(std::io::stderr(), "skipped: no Vulkan device").expect("stderr is there");
        }
        let before = program.resident_kb();
        assert!(program.draws(&pictures, 60 + FRAMES), "it goes on");
        let after = program.resident_kb();
        assert!(after < before + GROWTH_KB, "{before} kB, then {after} kB with shadows {shadows}");
        drop(program);
        std::fs::remove_dir_all(&pictures).expect("removed");
    }
}
