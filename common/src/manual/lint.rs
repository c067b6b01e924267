//! What a reader of a program's help would miss.

use std::any::TypeId;
use std::path::PathBuf;

use clap::{Arg, Command};

/// One of these says what a number counts.
const UNITS: [&str; 16] = [
    "metres",
    "millimetres",
    "seconds",
    "degrees",
    "pixels",
    "times",
    "real time",
    "bytes",
    "blades",
    "clips",
    "frames",
    "pictures",
    "level",
    "whole number",
    "errors of the sensor",
    "seconds of the meadow's time",
];
/// One of these says how far it goes.
const RANGES: [&str; 5] = [" to ", "or more", "at most", "from 0 on", "above 0"];

/// Faults in the definition of a command line: a verb without an `Example:` that it would take itself, a value
/// without help, without possible values, or, where it is neither text nor a path, without unit and range. None:
/// an empty list. For tests, as [`Command::debug_assert`] is.
pub fn faults(program: &Command) -> Vec<String> {
    let mut program = program.clone().disable_help_subcommand(true);
    program.build();
    let mut faults = Vec::new();
    let mut open = vec![&program];
    while let Some(command) = open.pop() {
        let name = command.get_bin_name().unwrap_or_else(|| command.get_name());
        let examples = super::examples(command);
        if examples.is_empty() {
            faults.push(format!("{name} has no example"));
        }
        for example in examples {
            // No example has a space within quotes.
            let words = example.split(' ').map(|word| word.trim_matches('\''));
            if let Err(error) = program.clone().try_get_matches_from(words) {
                faults.push(format!("{name}: {example:?} is refused: {error}"));
            }
            if !example.starts_with(name) {
                faults.push(format!("{name}: {example:?} is of something else"));
            }
        }
        let of_value =
            |argument: &Arg| missing(argument).map(|what| format!("{name} {argument} has no {what}"));
        faults.extend(command.get_arguments().filter_map(of_value));
        open.extend(command.get_subcommands());
    }
    faults
}

/// What is missing for someone who is to give this value.
fn missing(argument: &Arg) -> Option<&'static str> {
    let help = argument.get_long_help().or_else(|| argument.get_help()).map(ToString::to_string);
    let Some(help) = help.filter(|help| !help.is_empty()) else { return Some("help") };
    let kind = argument.get_value_parser().type_id();
    let is_word = kind == TypeId::of::<String>() || kind == TypeId::of::<PathBuf>();
    let takes_values = argument.get_num_args().is_some_and(|range| range.takes_values());
    if is_word || !takes_values || !argument.get_possible_values().is_empty() {
        return None;
    }
    let lower = help.to_lowercase();
    if !UNITS.iter().any(|unit| lower.contains(unit)) {
        return Some("unit");
    }
    let has_digit = help.contains(|c: char| c.is_ascii_digit());
    (!has_digit || !RANGES.iter().any(|range| lower.contains(range))).then_some("range")
}

#[cfg(test)]
mod tests {
    use clap::value_parser;

    use super::*;

    fn program(about: &'static str, help: &'static str) -> Command {
        let height = Arg::new("height").long("height").value_parser(value_parser!(u32)).help(help);
        Command::new("mow").long_about(about).arg(height)
    }

    #[test]
    fn what_is_missing_is_named() {
        let good = "Mows\n\nExample: mow --height 3";
        let faults_of = |about, help| faults(&program(about, help));
        assert_eq!(faults_of(good, "How tall, metres, 0 to 3"), Vec::<String>::new());
        assert_eq!(faults_of(good, ""), ["mow --height <height> has no help"]);
        assert_eq!(faults_of(good, "How tall, 0 to 3"), ["mow --height <height> has no unit"]);
        assert_eq!(faults_of(good, "How tall, metres"), ["mow --height <height> has no range"]);
        assert_eq!(faults_of("Mows", "How tall, metres, 0 to 3"), ["mow has no example"]);
        let wrong = faults_of("Mows\n\nExample: mow --width 3", "How tall, metres, 0 to 3");
        assert!(wrong.len() == 1 && wrong[0].contains("--width"), "{wrong:?}");
        let other = faults_of("Mows\n\nExample: sow --height 3", "How tall, metres, 0 to 3");
        assert!(other.len() == 1 && other[0].contains("something else"), "{other:?}");
    }
}
