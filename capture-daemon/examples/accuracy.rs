//! Prints how true the capture is, family by family:
//! `accuracy [clips] [first seed] [family]... [--size WxH] [--markdown FILE]`.
//!
//! `--size`: columns and rows of the pictures in pixels, each 16 to 1280; 640x480 without it.
//!
//! Each column is explained under the table. Clips are measured on all processors; the result does
//! not depend on how many there are.

use std::fmt::Write as _;
use std::process::ExitCode;

use capture_daemon::session::SessionParams;
use capture_daemon::synth::accuracy::{Summary, measure};
use capture_daemon::synth::{ClipParams, FAMILIES, Family, Scene, parse_size, sweep};

/// What is to be measured.
#[derive(Debug, PartialEq)]
struct Asked {
    clips: u64,
    first: u64,
    /// None: all families.
    families: Vec<Family>,
    /// Columns and rows, pixels.
    size: (usize, usize),
    markdown: Option<String>,
}

impl Asked {
    /// Reads the arguments.
    ///
    /// # Errors
    /// One sentence of what is wrong with them.
    fn of(mut arguments: impl Iterator<Item = String>) -> Result<Self, String> {
        let ClipParams { width, height, .. } = ClipParams::default();
        let (families, size) = (Vec::new(), (width, height));
        let mut asked = Self { clips: 20, first: 1, families, size, markdown: None };
        let mut numbers = 0;
        while let Some(argument) = arguments.next() {
            if argument == "--markdown" {
                let file =
                    arguments.next().ok_or("--markdown: expected a file after it, such as table.md")?;
                asked.markdown = Some(file);
            } else if argument == "--size" {
                let size = arguments.next().ok_or("--size: expected a size after it, such as 512x424")?;
                asked.size = parse_size(&size).map_err(|wrong| format!("--size: {wrong}"))?;
            } else if let Ok(number) = argument.parse() {
                match numbers {
                    0 => asked.clips = number,
                    1 => asked.first = number,
                    _ => {
                        return Err(format!(
                            "{argument}: expected two numbers at most, clips and first seed"
                        ));
                    }
                }
                numbers += 1;
            } else {
                let family = FAMILIES.into_iter().find(|family| family.name() == argument);
                let known = FAMILIES.map(Family::name).join(", ");
                let unknown = || format!("{argument}: unknown family, expected one of {known}");
                asked.families.push(family.ok_or_else(unknown)?);
            }
        }
        if asked.clips == 0 || asked.first.checked_add(asked.clips).is_none() {
            return Err(format!("{} clips from seed {}: expected 1 or more", asked.clips, asked.first));
        }
        Ok(asked)
    }
}

fn main() -> ExitCode {
    let Asked { clips, first, families, size: (width, height), markdown } = match Asked::of(
        std::env::args().skip(1),
    ) {
        Ok(asked) => asked,
        Err(wrong) => {
            eprintln!(
                "accuracy: {wrong}; accuracy [clips] [first seed] [family]... [--size WxH] [--markdown FILE]"
            );
            return ExitCode::from(2);
        }
    };
    let wanted = |family: &Family| families.is_empty() || families.contains(family);
    let mut table = format!("{}\n", Summary::MARKDOWN_HEAD);
    for family in FAMILIES.into_iter().filter(wanted) {
        let summary = Summary::of(&sweep(first..first + clips, |seed| {
            let clip = ClipParams {
                width,
                height,
                frames: Scene::new(family, seed).frames(),
                ..ClipParams::default()
            };
            measure(family, seed, clip, &SessionParams::default()).expect("valid parameters")
        }));
        println!("{:10}  {summary}", family.name());
        writeln!(table, "{}", summary.markdown_row(family.name())).expect("text has room");
    }
    if let Some(path) = markdown {
        let last = first + clips.saturating_sub(1);
        let text =
            format!("{table}\nSeeds {first} to {last}, {width}×{height} pixels. {}\n", Summary::LEGEND);
        if let Err(error) = std::fs::write(&path, text) {
            eprintln!("accuracy: {path}: cannot be written ({error}); check the folder");
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(line: &str) -> Result<Asked, String> {
        Asked::of(line.split_whitespace().map(str::to_owned))
    }

    #[test]
    fn a_family_that_there_is_not_is_named_with_those_that_there_are() {
        let wrong = asked("foo").expect_err("no family");
        assert!(wrong.contains("foo: unknown family") && wrong.contains("single, row, toward"), "{wrong}");
        assert!(asked("1 2 3").is_err() && asked("--markdown").is_err() && asked("0").is_err());
        let row = asked("200 9000 row --markdown table.md").expect("right");
        assert_eq!((row.clips, row.first, row.families), (200, 9000, vec![Family::Row]));
        assert_eq!(row.markdown.as_deref(), Some("table.md"));
        assert_eq!((row.size, asked("--size 512x424").expect("right").size), ((640, 480), (512, 424)));
        for wrong in ["--size", "--size 5x5", "--size wide"] {
            assert!(asked(wrong).is_err(), "{wrong}");
        }
    }
}
