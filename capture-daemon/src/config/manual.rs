//! The man page of the configuration, from the file that documents every key.

use common::manual::{Page, begin_page};
use roff::{Roff, bold, roman};

/// The shipped file.
const DOCUMENTED: &str = include_str!("../../capture-daemon.toml");

/// `capture-daemon.toml.5`: each key with its default (or an example, where it has none), unit and range.
pub fn page() -> Page {
    let about = "configuration of the capture station sward-capture";
    let mut page = begin_page("capture-daemon.toml", "5", env!("CARGO_PKG_VERSION"), about);
    page.control("SH", ["DESCRIPTION"]).text([roman(
        "A TOML file, which the option --config names; /etc/sward/capture-daemon.toml for the unit \
         sward-capture.service. Every key has a default: a file holds what is to differ from it. A key that is \
         unknown, of another type or out of its range is an error with its line and column. The option --set \
         takes a single key over the file, as in --set mask.far_m=0.8.",
    )]);
    let mut lines = DOCUMENTED.lines();
    // What stands before the first table is about the file.
    let mut section = lines.by_ref().find_map(section_of);
    while let Some(name) = section.take() {
        page.control("SH", [format!("[{name}]").as_str()]);
        let mut comment = String::new();
        for line in lines.by_ref() {
            section = section_of(line);
            if section.is_some() {
                break;
            }
            describe(&mut page, name, line, &mut comment);
        }
    }
    page.control("SH", ["SEE ALSO"]);
    page.text([bold("sward-capture"), roman("(1), "), bold("sward-capture-check-config"), roman("(1)")]);
    Page { file: "capture-daemon.toml.5".to_owned(), text: page.render() }
}

/// The shipped file with the keys that have no default: a value for each key.
pub(super) fn example() -> String {
    DOCUMENTED.replace("\n#= ", "\n")
}

fn section_of(line: &str) -> Option<&str> {
    line.strip_prefix('[')?.strip_suffix(']')
}

/// Takes a line of a section: of a comment, or the key that the comment before it is about.
fn describe(page: &mut Roff, section: &str, line: &str, comment: &mut String) {
    let example = line.strip_prefix("#= ");
    match example.unwrap_or(line).split_once(" = ") {
        Some((key, value)) if example.is_some() || !line.starts_with('#') => {
            let kind = if example.is_some() { "no default; for example" } else { "default" };
            page.control("TP", []);
            page.text([bold(format!("{section}.{key}")), roman(format!(" ({kind} {value})"))]);
            // Of several keys below one comment, the first has it.
            let said = std::mem::take(comment);
            page.text([roman(if said.is_empty() { "As above." } else { &said })]);
        }
        _ => {
            let text = line.trim_start_matches('#').trim();
            *comment = format!("{comment} {text}").trim().to_owned();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    #[test]
    fn every_key_has_its_place() {
        let page = page().text;
        let all: toml::Table = example().parse().expect("TOML");
        let mut keys = 0;
        for (section, table) in all {
            for (key, value) in table.as_table().expect("a table") {
                let default = toml::Table::try_from(Config::default()).expect("TOML");
                let default = default[&section].get(key);
                let value = value.to_string().replace('-', "\\-");
                let shown = format!("\\fB{section}.{key}\\fR (");
                let line = page.lines().find(|line| line.starts_with(&shown));
                let line = line.unwrap_or_else(|| panic!("{shown} has no place in\n{page}"));
                assert_eq!(line.contains("(default "), default.is_some(), "{line}");
                // Numbers may be written in another way, as modes are.
                assert!(line.contains(&value) || key == "socket_mode", "{line} does not say {value}");
                keys += 1;
            }
        }
        assert!(keys > 30, "{keys} keys");
        assert!(!page.contains("\\fR (no default; for example \"\")"), "{page}");
    }
}
