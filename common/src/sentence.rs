//! Errors are one sentence on stderr: what, where, what was expected, what to do.

use std::error::Error;
use std::io::{self, Write};

/// What a parser of command lines says in paragraphs, as one sentence without its full stop: its
/// usage and its pointers to the help are left out.
pub fn of_paragraphs(text: &str) -> String {
    let paragraphs = text.split("\n\n");
    let said = paragraphs.filter(|part| !part.starts_with("Usage") && !part.starts_with("For more"));
    let words = said.collect::<Vec<_>>().join("; ");
    let words = words.trim_start_matches("error: ").split_whitespace().collect::<Vec<_>>().join(" ");
    // What the standard library calls a number, and the parser a verb.
    words
        .replace("invalid float literal", "expected a number")
        .replace("cannot parse float from empty string", "expected a number")
        .replace("invalid digit found in string", "expected a whole number")
        .replace("cannot parse integer from empty string", "expected a whole number")
        .replace("unrecognized subcommand", "unknown verb")
        .replace("similar subcommand", "similar verb")
}

/// What went wrong and why, with its full stop: each cause of a chain of errors that the ones before
/// it have not told already.
pub fn of_causes<'a>(chain: impl Iterator<Item = &'a (dyn Error + 'static)>) -> String {
    let mut sentence = String::new();
    for cause in chain.map(ToString::to_string) {
        if sentence.is_empty() {
            sentence = cause;
        } else if !sentence.contains(&cause) {
            sentence = format!("{sentence}: {cause}");
        }
    }
    format!("{}.", sentence.trim_end_matches('.'))
}

/// So many of something: "1 blade", "2 blades"; of nouns whose plural only adds an s.
pub fn counted(number: u64, noun: &str) -> String {
    if number == 1 { format!("1 {noun}") } else { format!("{number} {noun}s") }
}

/// Says on stderr what is wrong; where that is closed too, the exit code has to do.
pub fn complain(program: &str, sentence: &str) {
    let _closed = writeln!(io::stderr(), "{program}: {sentence}");
}

/// Writes to stdout. Whoever closed it has seen enough.
///
/// # Errors
/// When stdout cannot be written for another reason, such as a full disk.
pub fn print(text: &str) -> io::Result<()> {
    print_on(text).map(drop)
}

/// Writes to stdout; whether somebody reads on.
///
/// # Errors
/// As [`print()`].
pub fn print_on(text: &str) -> io::Result<bool> {
    let mut stdout = io::stdout();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(io::Error::new(error.kind(), format!("stdout cannot be written: {error}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paragraphs_become_one_sentence() {
        let text = "error: unexpected argument '--a' found\n\n  tip: a similar argument exists: '--b'\n\n\
            Usage: program --b\n\nFor more information, try '--help'.\n";
        let sentence = "unexpected argument '--a' found; tip: a similar argument exists: '--b'";
        assert_eq!(of_paragraphs(text), sentence);
        let number =
            "error: invalid value 'x' for '<N>': invalid digit found in string\n\nFor more information\n";
        assert_eq!(of_paragraphs(number), "invalid value 'x' for '<N>': expected a whole number");
    }

    #[test]
    fn one_is_no_plural() {
        assert_eq!([0, 1, 2].map(|number| counted(number, "blade")), ["0 blades", "1 blade", "2 blades"]);
    }

    #[test]
    fn a_cause_that_was_told_is_not_told_again() {
        #[derive(Debug, thiserror::Error)]
        #[error("{told}")]
        struct Link {
            told: &'static str,
            source: Option<Box<Link>>,
        }
        let link = |told, source| Link { told, source };
        let last = link("no space", None);
        let middle = link("cannot write: no space", Some(Box::new(last)));
        let first = link("the clip is lost", Some(Box::new(middle)));
        let chain = std::iter::successors(Some(&first as &(dyn Error + 'static)), |error| {
            let error: &(dyn Error + 'static) = *error;
            error.source()
        });
        assert_eq!(of_causes(chain), "the clip is lost: cannot write: no space.");
    }
}
