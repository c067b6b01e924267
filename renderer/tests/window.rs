//! Does the window fill a kiosk's screen, is it steered, resized and hidden without harm, does what it loses come
//! back, and does it end with a word when the display does? These need Xvfb and weston; without them they say so, or
//! fail with SWARD_REQUIRE_GPU=1.

mod common;

use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const WIDTH: usize = 320;
const HEIGHT: usize = 180;
/// How long anything may take before it counts as hung.
const DEADLINE: Duration = Duration::from_secs(90);

/// A process that is killed when the test is over.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended by itself; then there is nothing to kill.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Process {
    /// Its exit code, once it has ended; `None` when a signal ended it.
    fn end(&mut self) -> Option<i32> {
        let end = wait_for(|| self.0.try_wait().expect("it can be waited for"));
        end.expect("it ends").code()
    }

    /// What it says from now on, as it says it.
    fn listen(&mut self) -> Arc<Mutex<String>> {
        let stderr = self.0.stderr.take().expect("stderr is piped");
        let said = Arc::new(Mutex::new(String::new()));
        let heard = Arc::clone(&said);
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                heard.lock().expect("nobody panics with it").push_str(&(line + "\n"));
            }
        });
        said
    }

    fn said(&mut self) -> String {
        let mut text = String::new();
        let mut pipe = self.0.stderr.take().expect("stderr is piped");
        pipe.read_to_string(&mut text).expect("text");
        text
    }
}

fn wait_for<T>(mut what: impl FnMut() -> Option<T>) -> Option<T> {
    let deadline = Instant::now() + DEADLINE;
    while Instant::now() < deadline {
        if let Some(found) = what() {
            return Some(found);
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    None
}

/// An X server with a screen in memory, and the display's name.
struct Screen {
    server: Process,
    display: String,
}

impl Screen {
    fn start(folder: &Path) -> Option<Self> {
        let said = folder.join("display");
        let mut command = Command::new("sh");
        // The server chooses a free display and says which once its screen is there.
        command.args(["-c", r#"exec Xvfb -displayfd 3 "$@" 3>"$0""#]).arg(&said);
        command.args(["-screen", "0", &format!("{WIDTH}x{HEIGHT}x24"), "-nolisten", "tcp", "-fbdir"]);
        command.arg(folder).stdout(Stdio::null()).stderr(Stdio::null());
        let mut server = Process(command.spawn().expect("sh is there"));
        let number = wait_for(|| {
            if server.0.try_wait().expect("it can be waited for").is_some() {
                return Some(None);
            }
            let number = std::fs::read_to_string(&said).ok()?;
            number.strip_suffix('\n').map(|number| Some(number.to_owned()))
        });
        match number.flatten() {
            Some(number) => Some(Self { server, display: format!(":{number}") }),
            None => {
                skip("Xvfb");
                None
            }
        }
    }

    /// What it shows, blue, green, red and nothing for each pixel. The file is an XWD: big-endian numbers,
    /// the first the header's size, the 20th the number of colour map entries of 12 bytes each.
    fn pixels(folder: &Path) -> Vec<u8> {
        let bytes = std::fs::read(folder.join("Xvfb_screen0")).expect("the screen's file");
        let number = |index: usize| {
            let bytes = bytes[4 * index..4 * index + 4].try_into().expect("4 bytes");
            u32::from_be_bytes(bytes) as usize
        };
        bytes[number(0) + 12 * number(19)..][..4 * WIDTH * HEIGHT].to_vec()
    }

    fn window(&self, folder: &Path, options: &[&str]) -> Process {
        open_window(folder, options, |command| {
            command.env("DISPLAY", &self.display).env_remove("WAYLAND_DISPLAY")
        })
    }
}

fn open_window(folder: &Path, options: &[&str], on: impl Fn(&mut Command) -> &mut Command) -> Process {
    let library = folder.join("meadow.sward");
    std::fs::write(&library, common::meadow(1)).expect("written");
    let mut command = Command::new(env!("CARGO_BIN_EXE_sward-render"));
    command.arg("--library").arg(&library).args(options).env("XDG_RUNTIME_DIR", folder);
    on(&mut command).stdout(Stdio::null()).stderr(Stdio::piped());
    Process(command.spawn().expect("the program runs"))
}

fn colours(pixels: &[u8]) -> usize {
    pixels.chunks_exact(4).collect::<std::collections::HashSet<_>>().len()
}

/// Whether the four corners and the middle of the screen have something other than black.
fn fills(pixels: &[u8]) -> bool {
    let at = |x: usize, y: usize| pixels[4 * (y * WIDTH + x)..][..3] != [0, 0, 0];
    let (right, bottom) = (WIDTH - 2, HEIGHT - 2);
    [(1, 1), (right, 1), (1, bottom), (right, bottom), (WIDTH / 2, HEIGHT / 2)]
        .iter()
        .all(|(x, y)| at(*x, *y))
}

fn says(said: &Mutex<String>, words: &str) {
    let found = wait_for(|| said.lock().expect("nobody panics with it").contains(words).then_some(()));
    assert!(found.is_some(), "{words:?} in {}", said.lock().expect("nobody panics with it"));
}

fn loses_both_and_goes_on(said: &Mutex<String>) {
    for words in ["surface was lost", "device was lost", "drawing again"] {
        says(said, words);
    }
}

fn skip(what: &str) {
    let required = std::env::var_os("SWARD_REQUIRE_GPU").is_some_and(|value| value == "1");
    assert!(!required, "{what} does not run");
    // Not by a macro, whose output the test harness would hide.
    writeln!(std::io::stderr(), "skipped: no {what}").expect("stderr is there");
}

#[test]
fn a_kiosk_fills_the_screen_takes_no_keys_and_ends_with_the_display() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(screen) = Screen::start(folder.path()) else { return };
    let mut window = screen.window(folder.path(), &["--kiosk", "--size", "64x64"]);
    let shown = wait_for(|| {
        let pixels = Screen::pixels(folder.path());
        (colours(&pixels) > 1000 && fills(&pixels)).then_some(())
    });
    assert!(shown.is_some(), "the meadow fills the screen");

    // Without xdotool, keys are simply not tried.
    let typed = Command::new("xdotool").args(["key", "Escape"]).env("DISPLAY", &screen.display).status();
    if typed.is_ok_and(|status| status.success()) {
        std::thread::sleep(Duration::from_secs(1));
        assert_eq!(window.0.try_wait().expect("it can be waited for"), None, "Esc ends no kiosk");
    }

    drop(screen.server);
    assert_eq!(window.end(), Some(1), "systemd starts it again");
    let said = window.said();
    assert!(said.contains(&screen.display) || said.contains("display has ended"), "{said}");
    assert!(!said.contains("panicked"), "{said}");
}

#[test]
fn a_lost_surface_and_a_lost_device_come_back() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(screen) = Screen::start(folder.path()) else { return };
    let options = ["--size", "300x170", "--lose", "surface@5", "--lose", "device@10"];
    let mut window = screen.window(folder.path(), &options);
    let said = window.listen();
    loses_both_and_goes_on(&said);
    let moves = || {
        let before = Screen::pixels(folder.path());
        wait_for(|| {
            let pixels = Screen::pixels(folder.path());
            (pixels != before && colours(&pixels) > 1000).then_some(())
        })
    };
    assert!(moves().is_some() && moves().is_some(), "the meadow goes on");
    assert_eq!(window.0.try_wait().expect("it can be waited for"), None);
}

/// A Wayland display without a screen, `sward` in this folder. Its backend has another name since weston 12.
fn weston(folder: &Path) -> Option<Process> {
    ["headless-backend.so", "headless"].iter().find_map(|backend| {
        let mut command = Command::new("weston");
        command.arg(format!("--backend={backend}")).args(["--socket=sward", "--width=320", "--height=180"]);
        command.args(["--idle-time=0", "--no-config"]).env("XDG_RUNTIME_DIR", folder);
        let mut weston = Process(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().ok()?);
        let there = wait_for(|| {
            let ended = weston.0.try_wait().expect("it can be waited for").is_some();
            (ended || folder.join("sward").exists()).then_some(!ended)
        });
        (there == Some(true)).then_some(weston)
    })
}

#[test]
fn under_wayland_too_what_is_lost_comes_back_and_the_end_of_the_display_is_told() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(weston) = weston(folder.path()) else { return skip("weston") };
    let options = ["--size", "300x170", "--lose", "surface@5", "--lose", "device@10"];
    let mut window = open_window(folder.path(), &options, |command| {
        command.env("WAYLAND_DISPLAY", "sward").env_remove("DISPLAY")
    });
    let said = window.listen();
    loses_both_and_goes_on(&said);
    assert_eq!(window.0.try_wait().expect("it can be waited for"), None);
    drop(weston);
    assert_eq!(window.end(), Some(1), "systemd starts it again");
    says(&said, "display has ended");
    assert!(!said.lock().expect("nobody panics with it").contains("panicked"));
}

#[test]
fn a_window_is_steered_resized_hidden_and_closed() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(screen) = Screen::start(folder.path()) else { return };
    let options = ["--size", "300x170", "--time-scale", "0"];
    let mut window = screen.window(folder.path(), &options);
    let do_it = |arguments: &[&str]| {
        let mut command = Command::new("xdotool");
        command.args(arguments).env("DISPLAY", &screen.display).stdout(Stdio::null()).stderr(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    };
    let meadow = wait_for(|| {
        let pixels = Screen::pixels(folder.path());
        (colours(&pixels) > 1000).then_some(pixels)
    });
    let before = meadow.expect("the meadow shows");
    if !do_it(&["search", "--sync", "--onlyvisible", "--name", "Sward"]) {
        return writeln!(std::io::stderr(), "skipped: no xdotool").expect("stderr is there");
    }
    let find = ["search", "--name", "Sward"];
    let with = |more: &[&'static str]| do_it(&[&find[..], more].concat());
    // Without a window manager, nobody gives a window the keys.
    assert!(with(&["windowfocus", "keydown", "w"]), "a key is held");
    let moved = wait_for(|| (Screen::pixels(folder.path()) != before).then_some(()));
    assert!(moved.is_some(), "W moves the eye, in a meadow that stands still");
    with(&["keyup", "w"]);

    assert!(with(&["windowsize", "200", "90"]) && with(&["windowsize", "310", "175"]), "sizes change");
    assert!(with(&["windowunmap"]), "hidden");
    std::thread::sleep(Duration::from_millis(500));
    assert!(with(&["windowmap"]), "and shown");
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!(window.0.try_wait().expect("it can be waited for"), None, "it lives through all that");
    assert!(with(&["windowfocus", "key", "Escape"]), "a key");
    assert_eq!(window.end(), Some(0), "Esc closes it");
}
