//! Does a window show the meadow as soon as there is a daemon, and outlive it?

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use tests::programs::{DEADLINE, Program, Running, wait_for};
use tests::shipped_recording;

const WIDTH: usize = 640;
const HEIGHT: usize = 360;

/// An X server that keeps its screen in a file.
struct Screen {
    display: String,
    file: PathBuf,
    server: Running,
}

impl Drop for Screen {
    /// A server that is killed leaves its socket and its lock behind.
    fn drop(&mut self) {
        if self.server.ended().is_none() {
            self.server.terminate();
            wait_for(DEADLINE, || self.server.ended());
        }
    }
}

impl Screen {
    fn start(folder: &Path) -> Self {
        // The server chooses a free display and says which once its screen is there, not before.
        let said = folder.join("display");
        let mut command = Command::new("sh");
        command.args(["-c", r#"exec Xvfb -displayfd 3 "$@" 3>"$0""#]).arg(&said);
        let screen = format!("{WIDTH}x{HEIGHT}x24");
        command.args(["-screen", "0", &screen, "-nolisten", "tcp", "-fbdir"]).arg(folder);
        let mut server = Running::start(command);
        let number = wait_for(DEADLINE, || {
            assert_eq!(server.ended(), None, "the server runs");
            let number = std::fs::read_to_string(&said).ok()?;
            number.strip_suffix('\n').map(str::to_owned)
        });
        let number = number.expect("the server says its display");
        let file = folder.join("Xvfb_screen0");
        Self { display: format!(":{number}"), file, server }
    }

    /// What it shows, 4 bytes a pixel. The file is an XWD: big-endian numbers, the first the header's
    /// size, the 20th the number of colour map entries of 12 bytes each; then the pixels.
    fn pixels(&self) -> Vec<u8> {
        let bytes = std::fs::read(&self.file).expect("the file is readable");
        let number = |index: usize| {
            let bytes = bytes[4 * index..4 * index + 4].try_into().expect("4 bytes");
            u32::from_be_bytes(bytes) as usize
        };
        bytes[number(0) + 12 * number(19)..][..4 * WIDTH * HEIGHT].to_vec()
    }

    /// Waits for a picture that is not `before` and has not changed for longer than blades take to grow.
    fn next_picture(&self, before: &[u8]) -> Vec<u8> {
        const LOOKS: u32 = 4;
        let (mut last, mut same) = (before.to_vec(), 0);
        let picture = wait_for(DEADLINE, || {
            std::thread::sleep(Duration::from_millis(500));
            let now = self.pixels();
            same = if alike(&now, &last) && !alike(&now, before) { same + 1 } else { 0 };
            last = now;
            (same >= LOOKS).then(|| last.clone())
        });
        picture.expect("the picture changes and settles")
    }
}

/// Whether two pictures show the same: the order in which the GPU draws blades is its own, which few pixels tell.
fn alike(a: &[u8], b: &[u8]) -> bool {
    let differing = a.iter().zip(b).filter(|(a, b)| a.abs_diff(**b) > 8).count();
    a.len() == b.len() && differing * 2000 < a.len()
}

fn colours(pixels: &[u8]) -> usize {
    let mut colours: Vec<&[u8]> = pixels.chunks_exact(4).collect();
    colours.sort_unstable();
    colours.dedup();
    colours.len()
}

#[test]
fn a_window_shows_the_meadow_once_there_is_a_daemon_and_keeps_it_when_the_daemon_dies() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let socket = folder.path().join("station.socket");
    let screen = Screen::start(folder.path());
    let nothing = screen.pixels();
    let mut command =
        Program::Render.command(["--time-scale", "0", "--budget-ms", "0", "--size", "640x360", "--socket"]);
    command.arg(&socket).env("DISPLAY", &screen.display);
    let mut window = Running::start(command);
    let bare = screen.next_picture(&nothing);

    let settings = [format!("source.recording={:?}", shipped_recording()), "source.rate=0.0".to_owned()];
    let mut command =
        Program::Capture.command(["run", "--set", &settings[0], "--set", &settings[1], "--set"]);
    command.arg(format!("service.socket={socket:?}"));
    command.args(["--set".to_owned(), format!("store.directory={:?}", folder.path().join("state"))]);
    let mut daemon = Running::start(command).wait_for_socket(&socket);
    let meadow = screen.next_picture(&bare);
    assert!(colours(&meadow) > 1000, "{} colours are no meadow", colours(&meadow));

    daemon.kill();
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(window.ended(), None, "the renderer outlives the daemon");
    assert!(alike(&screen.pixels(), &meadow), "the meadow stays");
}
