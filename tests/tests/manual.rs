//! Do man pages and completions say all that the command line takes?
//!
//! groff, zsh and fish are used where they are installed; what is skipped says so.

use std::collections::BTreeSet;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command as Process, Output};

use clap::{Command, CommandFactory};
use tests::programs::{Finished, Program};

/// A command and all its verbs that help shows, however deep.
fn all(command: &Command) -> Vec<&Command> {
    let verbs = command.get_subcommands().filter(|verb| !verb.is_hide_set()).flat_map(all);
    std::iter::once(command).chain(verbs).collect()
}

fn name(command: &Command) -> &str {
    command.get_bin_name().unwrap_or_else(|| command.get_name())
}

fn run(program: Program, arguments: &[&str]) -> Finished {
    let finished = program.run(arguments);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    finished
}

/// Runs another program; `None`, said aloud, where it is not installed.
fn tool(name: &str, arguments: &[&str]) -> Option<Output> {
    match Process::new(name).args(arguments).output() {
        Ok(output) => Some(output),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            eprintln!("skipped: {name} is not installed");
            None
        }
        Err(error) => panic!("{name}: {error}"),
    }
}

/// The pages of both programs, in a folder.
fn pages(folder: &Path) -> Vec<PathBuf> {
    let folder = folder.join("man");
    let folder = folder.to_str().expect("UTF-8");
    let written =
        run(Program::Capture, &["man", folder]).stdout + &run(Program::Render, &["--man", folder]).stdout;
    written.lines().map(PathBuf::from).collect()
}

#[test]
fn every_verb_and_option_is_in_the_pages() {
    let folder = tempfile::tempdir().expect("a folder");
    let pages = pages(folder.path());
    let text = |file: &str| {
        let path = pages.iter().find(|path| path.ends_with(file)).unwrap_or_else(|| panic!("no page {file}"));
        fs::read_to_string(path).expect("it was written")
    };
    let option = |long: &str| format!("\\fB\\-\\-{}\\fR", long.replace('-', "\\-"));
    let mut capture = capture_daemon::cli::Cli::command().disable_help_subcommand(true);
    capture.build();
    let mut options = 0;
    for command in all(&capture) {
        let page = text(&format!("{}.1", name(command).replace(' ', "-")));
        for part in ["DESCRIPTION", "OPTIONS", "EXAMPLES"] {
            assert!(page.contains(&format!(".SH {part}\n")), "no {part} in {page}");
        }
        for verb in command.get_subcommands().filter(|verb| !verb.is_hide_set()) {
            let reference = format!("{}-{}(1)", name(command).replace(' ', "-"), verb.get_name());
            assert!(page.contains(&reference.replace('-', "\\-")), "{reference} is not in {page}");
        }
        for argument in command.get_arguments() {
            let shown = match argument.get_long() {
                Some(long) => option(long),
                None => argument.get_value_names().expect("a positional value has a name")[0].to_string(),
            };
            assert!(page.contains(&shown), "{argument} is not in {page}");
            options += 1;
        }
    }
    // The other program is asked what it takes.
    let page = text("sward-render.1");
    let help = run(Program::Render, &["--help"]).stdout;
    let longs: BTreeSet<&str> = help.split_whitespace().filter_map(|word| word.strip_prefix("--")).collect();
    let longs = longs.iter().map(|long| long.trim_matches(|c: char| !c.is_ascii_alphabetic()));
    for long in longs.filter(|long| !long.is_empty()) {
        assert!(page.contains(&option(long)), "{long} is not in {page}");
        options += 1;
    }
    assert!(page.contains("SWARD_SOCKET"), "{page}");
    assert!(options > 60, "{options} options");
    assert!(text("capture-daemon.toml.5").contains("store.archive_max"));
}

#[test]
fn groff_has_nothing_to_say_of_the_pages() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut pages = pages(folder.path());
    let broken = folder.path().join("broken.1");
    fs::write(&broken, ".TH broken 1\n.SH\n.NOSUCH\n").expect("room");
    pages.push(broken.clone());
    for page in &pages {
        let shown = page.to_str().expect("UTF-8");
        let Some(output) = tool("groff", &["-man", "-ww", "-z", "-K", "utf8", "-T", "utf8", shown]) else {
            return;
        };
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(said.is_empty() && output.status.success(), *page != broken, "{shown}: {said}");
    }
}

/// What bash offers after `line`, whose last word is being typed.
fn bash_offers(script: &Path, line: &[&str]) -> Vec<String> {
    let program = line[0];
    let (word, before) = (line[line.len() - 1], line[line.len() - 2]);
    let typed = line.iter().map(|word| format!("'{word}'")).collect::<Vec<_>>().join(" ");
    let code = format!(
        "source '{}'; set -- $(complete -p {program}); while [ \"$1\" != -F ]; do shift; done; \
         COMP_WORDS=({typed}); COMP_CWORD={}; $2 {program} '{word}' '{before}'; \
         printf '%s\\n' \"${{COMPREPLY[@]}}\"",
        script.display(),
        line.len() - 1,
    );
    let output = tool("bash", &["--norc", "-c", &code]).expect("the tests need bash");
    assert!(output.status.success() && output.stderr.is_empty(), "{line:?}: {output:?}");
    let mut offered: Vec<String> =
        String::from_utf8_lossy(&output.stdout).lines().map(|line| line.trim_end().to_owned()).collect();
    offered.sort();
    offered
}

#[test]
fn bash_completes_verbs_options_values_and_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let script = |program: Program, arguments: &[&str], name: &str| {
        let path = folder.path().join(name);
        fs::write(&path, run(program, arguments).stdout).expect("room");
        let checked = tool("bash", &["-n", path.to_str().expect("UTF-8")]).expect("the tests need bash");
        assert!(checked.status.success() && checked.stderr.is_empty(), "{checked:?}");
        path
    };
    let capture = script(Program::Capture, &["completions", "bash"], "capture");
    let offers = |line: &[&str]| bash_offers(&capture, &[&["sward-capture"], line].concat());
    assert_eq!(offers(&["blades", "re"]), ["remove", "rename", "restore"]);
    assert_eq!(offers(&["replay", "--r"]), ["--rate", "--realtime"]);
    assert_eq!(offers(&["synth", "--format", ""]), ["mcap", "png"]);
    assert_eq!(offers(&["completions", "z"]), ["zsh"]);
    let recording = folder.path().join("night.mcap");
    fs::write(&recording, "").expect("room");
    let typed = folder.path().join("ni");
    assert_eq!(
        offers(&["run", "--config", typed.to_str().expect("UTF-8")]),
        [recording.to_str().expect("UTF-8")]
    );

    let render = script(Program::Render, &["--completions", "bash"], "render");
    let offered = bash_offers(&render, &["sward-render", "--he"]);
    assert_eq!(offered, ["--heading-deg", "--headless", "--help"]);
}

#[test]
fn other_shells_understand_their_scripts() {
    let folder = tempfile::tempdir().expect("a folder");
    for (shell, flag) in [("zsh", "-n"), ("fish", "--no-execute")] {
        let scripts = [
            run(Program::Capture, &["completions", shell]).stdout,
            run(Program::Render, &["--completions", shell]).stdout,
        ];
        for (script, option) in scripts.iter().zip(["archive", "fullscreen"]) {
            assert!(script.contains(option) || script.contains("realtime"), "{shell}: {script}");
            let path = folder.path().join(shell);
            fs::write(&path, script).expect("room");
            let check = |path: &Path| tool(shell, &[flag, path.to_str().expect("UTF-8")]);
            let Some(checked) = check(&path) else {
                assert!(std::env::var_os("SWARD_REQUIRE_SHELLS").is_none(), "{shell} was to be installed");
                continue;
            };
            assert!(checked.status.success() && checked.stderr.is_empty(), "{shell}: {checked:?}");
            // Cut short, it is none: the shell does look at it.
            let half = script.trim_end().rsplit_once('(').map_or("", |(half, _)| half);
            fs::write(&path, format!("{half}(")).expect("room");
            let checked = check(&path).expect("it is installed");
            assert!(!checked.status.success(), "{shell} takes half a script: {checked:?}");
        }
    }
}
