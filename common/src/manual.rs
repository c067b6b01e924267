//! Man pages and shell completions of a program, from the definition of its command line alone.
//!
//! What `--help` says in paragraphs that begin with `Example:` or `Exit code` has sections of its own in
//! a page, as readers of man pages expect.

use std::ffi::OsString;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::Command;
pub use clap_complete::Shell;
use clap_mangen::Man;
use roff::{Roff, bold, roman};

mod lint;

pub use lint::faults;

/// How a paragraph of help begins that is an example.
const EXAMPLE: &str = "Example: ";
/// What all pages belong to.
const MANUAL: &str = "Sward";

/// A man page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Page {
    /// Its file's name, such as `sward-capture-run.1`.
    pub file: String,
    /// Its text, for `man`.
    pub text: String,
}

/// The verb that a command line is for, with the program's name before it, as far as it names one: what stands after
/// its name is not looked at. `arguments`: without the program's own name.
pub fn verb_of(program: &Command, arguments: impl IntoIterator<Item = OsString>) -> (String, Command) {
    let (mut name, mut command) = (program.get_name().to_owned(), program);
    for argument in arguments {
        let Some(verb) = command.find_subcommand(&argument) else { break };
        name = format!("{name} {}", verb.get_name());
        command = verb;
    }
    (name, command.clone())
}

/// A script that completes the command line of a program, which has a name, in a shell.
pub fn completions(mut command: Command, shell: Shell) -> String {
    let name = command.get_name().to_owned();
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command, &name, &mut script);
    let script = String::from_utf8_lossy(&script).into_owned();
    if shell != Shell::Bash {
        return script;
    }
    // Of a program with a hyphen in its name, no verb's options are completed: the script calls it by two names
    // (clap-rs/clap#6421).
    script.replace(&name.replace('-', "__subcmd__"), &name.replace('-', "__"))
}

/// A page for a program and one for each of its verbs, in section 1.
///
/// # Errors
/// None that a text in memory could have.
pub fn pages(command: Command) -> io::Result<Vec<Page>> {
    let mut command = command.disable_help_subcommand(true);
    command.build();
    let source = format!("sward {}", command.get_version().unwrap_or_default());
    let mut pages = Vec::new();
    let mut open = vec![(command, None)];
    while let Some((command, above)) = open.pop() {
        pages.push(page(&command, above, &source)?);
        let name = name_of(&command).to_owned();
        let verbs = command.get_subcommands().filter(|verb| !verb.is_hide_set());
        open.extend(verbs.map(|verb| (verb.clone(), Some(name.clone()))));
    }
    pages.sort_by(|a, b| a.file.cmp(&b.file));
    Ok(pages)
}

/// All that a program says of itself or of a verb, in paragraphs.
fn about(command: &Command) -> String {
    command.get_long_about().or_else(|| command.get_about()).map(ToString::to_string).unwrap_or_default()
}

/// The examples of a program or a verb, each a command line.
fn examples(command: &Command) -> Vec<String> {
    let about = about(command);
    about.split("\n\n").filter_map(|paragraph| paragraph.strip_prefix(EXAMPLE)).map(str::to_owned).collect()
}

/// The name that its page has, with those of the verbs before it.
fn name_of(command: &Command) -> &str {
    command.get_display_name().unwrap_or_else(|| command.get_name())
}

fn page(command: &Command, above: Option<String>, source: &str) -> io::Result<Page> {
    let said = about(command);
    let (exit, description): (Vec<&str>, Vec<&str>) = said
        .split("\n\n")
        .filter(|paragraph| !paragraph.starts_with(EXAMPLE))
        .partition(|paragraph| paragraph.starts_with("Exit code"));
    let examples = examples(command);
    let man = Man::new(command.clone().long_about(description.join("\n\n")));
    // A date would make pages of the same source differ.
    let man = man.date("\"\"").source(source).manual(MANUAL);
    let mut text = Vec::new();
    man.render_title(&mut text)?;
    man.render_name_section(&mut text)?;
    man.render_synopsis_section(&mut text)?;
    man.render_description_section(&mut text)?;
    if command.get_subcommands().any(|verb| !verb.is_hide_set()) {
        man.render_subcommands_section(&mut text)?;
    }
    if command.get_arguments().any(|argument| !argument.is_hide_set()) {
        man.render_options_section(&mut text)?;
    }
    let mut rest = Roff::new();
    if !exit.is_empty() {
        rest.control("SH", ["EXIT STATUS"]);
        exit.iter().for_each(|paragraph| {
            rest.text([roman(*paragraph)]);
        });
    }
    if !examples.is_empty() {
        rest.control("SH", ["EXAMPLES"]);
        for example in examples {
            rest.control("PP", []).control("EX", []).text([roman(example)]).control("EE", []);
        }
    }
    if let Some(above) = above {
        rest.control("SH", ["SEE ALSO"]).text([bold(above), roman("(1)")]);
    }
    rest.to_writer(&mut text)?;
    // Each part brings what is needed once.
    let preamble = Roff::new().render();
    let text = String::from_utf8_lossy(&text).replace(&preamble, "");
    Ok(Page { file: man.get_filename(), text: preamble + &text })
}

/// Begins a page that describes no command: its title line and its name.
pub fn begin_page(name: &str, section: &str, version: &str, about: &str) -> Roff {
    let mut page = Roff::new();
    let source = format!("sward {version}");
    page.control("TH", [name, section, "\"\"", &source, MANUAL]);
    page.control("SH", ["NAME"]).text([roman(format!("{name} - {about}"))]);
    page
}

/// Writes pages into a folder, which is made if it is not there; their paths.
///
/// # Errors
/// When one cannot be written; the message begins with its path.
pub fn write_pages(folder: &Path, pages: &[Page]) -> io::Result<Vec<PathBuf>> {
    let refused = |path: &Path, error: io::Error| {
        let what = "cannot be written";
        let remedy = "check the folder and its permissions";
        io::Error::new(error.kind(), format!("{}: {what} ({error}); {remedy}", path.display()))
    };
    std::fs::create_dir_all(folder).map_err(|error| refused(folder, error))?;
    let write = |page: &Page| {
        let path = folder.join(&page.file);
        let written = std::fs::File::create(&path).and_then(|mut file| file.write_all(page.text.as_bytes()));
        written.map(|()| path.clone()).map_err(|error| refused(&path, error))
    };
    pages.iter().map(write).collect()
}

#[cfg(test)]
mod tests {
    use clap::Arg;

    use super::*;

    fn program() -> Command {
        let mow = Command::new("mow").about("Mows").long_about(
            "Mows\n\nAll of it.\n\nExit code 0: mown.\n\nExample: garden mow --height 0.05 'a lawn'",
        );
        let mow = mow.arg(Arg::new("height").long("height").value_name("M").help("Height, metres, 0 to 1"));
        let secret = Command::new("secret").hide(true);
        Command::new("garden").version("1.2").about("A garden").subcommand(mow).subcommand(secret)
    }

    #[test]
    fn each_verb_has_a_page_with_its_parts() {
        let pages = pages(program()).expect("it is text");
        let names: Vec<&str> = pages.iter().map(|page| page.file.as_str()).collect();
        assert_eq!(names, ["garden-mow.1", "garden.1"]);
        let mow = &pages[0].text;
        assert!(mow.contains(".TH garden-mow 1 \"\" \"sward 1.2\" Sward"), "{mow}");
        let at = |part: &str| mow.find(part).unwrap_or_else(|| panic!("no {part:?} in {mow}"));
        let parts = [
            ".SH NAME",
            "Mows",
            ".SH DESCRIPTION",
            "All of it.",
            ".SH OPTIONS",
            "\\fI<M>\\fR",
            "metres, 0 to 1",
            ".SH \"EXIT STATUS\"",
            "0: mown",
            ".SH EXAMPLES",
            "garden mow \\-\\-height 0.05",
            ".SH \"SEE ALSO\"",
        ];
        assert!(parts.map(at).is_sorted(), "{mow}");
        assert_eq!(mow.matches("0: mown").count(), 1, "{mow}");
        assert!(pages[1].text.contains("garden\\-mow(1)") && !pages[1].text.contains("secret"));
    }

    #[test]
    fn each_shell_has_a_script_that_names_the_options() {
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
            let script = completions(program(), shell);
            assert!(script.contains("mow") && script.contains("height"), "{shell}: {script}");
        }
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_named() {
        let file = std::env::current_exe().expect("it runs");
        let refused = write_pages(&file.join("man"), &[]).expect_err("a file is no folder");
        assert!(refused.to_string().starts_with(&file.display().to_string()), "{refused}");
    }
}
