//! Errors are one sentence on stderr: what, where, what was expected, what to do.

/// What a parser of command lines says in paragraphs, as one sentence without its full stop: its
/// usage and its pointers to the help are left out.
pub fn of_paragraphs(text: &str) -> String {
    let paragraphs = text.split("\n\n");
    let said = paragraphs.filter(|part| !part.starts_with("Usage") && !part.starts_with("For more"));
    let words = said.collect::<Vec<_>>().join("; ");
    words.trim_start_matches("error: ").split_whitespace().collect::<Vec<_>>().join(" ")
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
    }
}
