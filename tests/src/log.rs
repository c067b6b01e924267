//! What the programs log, as they log it: lines with `name=value` fields and the moment they came, all
//! on this process's clock, so that lines of both programs can be set beside each other.

use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Instant;

/// A line of a log.
#[derive(Clone, Debug)]
pub struct Line {
    /// When it was read. The pipe that it came through makes it a little later than when it was written.
    pub at: Instant,
    /// The line without its end.
    pub text: String,
}

impl Line {
    /// The value of a field, if the line has it and it reads as one.
    pub fn field<T: std::str::FromStr>(&self, name: &str) -> Option<T> {
        let mut words = self.text.split_ascii_whitespace();
        words.find_map(|word| word.strip_prefix(name)?.strip_prefix('=')?.parse().ok())
    }

    /// Whether it says this.
    pub fn says(&self, what: &str) -> bool {
        self.text.contains(what)
    }
}

/// The lines that hold one of some words, of as many programs as are given the ear.
pub fn listen(words: &'static [&'static str]) -> (impl Fn(&str) + Clone + Send + 'static, Receiver<Line>) {
    let (tell, told): (Sender<Line>, _) = channel();
    let heard = move |line: &str| {
        let at = Instant::now();
        if words.iter().any(|word| line.contains(word)) {
            // Nobody may listen any more.
            let _ = tell.send(Line { at, text: line.to_owned() });
        } else if line.ends_with(".png") {
            // Nobody looks at the pictures of a renderer whose log is followed, and there are many.
            let _ = std::fs::remove_file(Path::new(line));
        }
    };
    (heard, told)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_read_and_lines_are_chosen() {
        let (heard, told) = listen(&["drawn"]);
        heard("2026-01-01T00:00:00Z  INFO drawn index=3 seconds=1.5e-2 generation=77");
        heard("2026-01-01T00:00:00Z  INFO new library generation=78");
        let line = told.try_recv().expect("the first is chosen");
        assert_eq!((line.field("index"), line.field("generation")), (Some(3), Some(77u64)));
        assert_eq!((line.field("seconds"), line.field::<u8>("generations")), (Some(0.015), None));
        assert!(line.says("drawn") && told.try_recv().is_err());
    }
}
