//! What is wrong with a TOML text, in the language of whoever wrote it: keys by their whole path, values as TOML
//! has them, and what is expected as the documented text shows it.

use std::path::Path;

use toml::de::{DeTable, DeValue};

/// Longest part of a text that is said again, characters.
const MAX_ECHO_CHARS: usize = 60;

/// One step from a table or a list to what it holds.
#[derive(Clone, Debug, PartialEq)]
enum Step {
    Key(String),
    Item(usize),
}

/// The reason of an error that reading `text` gave, in one sentence without its full stop. `example`: TOML in which
/// each key has a value as it may be.
pub(crate) fn reason(error: &toml::de::Error, text: &str, example: &str) -> String {
    let message = error.message();
    let said = || {
        message
            .replace('\n', ", ")
            .replace("unknown field", "unknown key")
            .replace("missing field", "missing key")
    };
    let (Some(span), Ok(document)) = (error.span(), DeTable::parse(text)) else { return said() };
    if let Some(rest) = message.strip_prefix("unknown field `") {
        let key = key_at(document.get_ref(), span.start).map(|steps| path(&steps));
        let rest = rest.split_once('`').map_or("", |(_, rest)| rest);
        return key.map_or_else(said, |key| format!("unknown key `{key}`{rest}"));
    }
    let of_value = ["invalid type", "invalid value", "invalid length", "unknown variant"];
    if !of_value.iter().any(|kind| message.starts_with(kind)) {
        return said();
    }
    let Some((steps, value)) = value_at(document.get_ref(), span.start) else { return said() };
    let listed = message.strip_prefix("unknown variant").and_then(|rest| rest.split_once(", expected "));
    // Of a list that is always as long.
    let length =
        message.rsplit_once("an array of length ").and_then(|(_, length)| length.trim_end().parse().ok());
    let documented = || {
        let parsed = DeTable::parse(example).ok()?;
        Some(expected(at(parsed.get_ref(), &steps)?, example, length))
    };
    match listed.map(|(_, choice)| choice.to_owned()).or_else(documented) {
        Some(expected) => format!("`{}` is {}, expected {expected}", path(&steps), found(value)),
        None => said(),
    }
}

/// Where a document sets `key` (a dotted path), if it does: the bytes of its value.
pub(crate) fn place_of(key: &str, text: &str) -> Option<std::ops::Range<usize>> {
    let document = DeTable::parse(text).ok()?;
    let mut table = document.get_ref();
    let mut parts = key.split('.').peekable();
    while let Some(part) = parts.next() {
        let (name, value) = table.iter().find(|(name, _)| name.get_ref() == part)?;
        match (parts.peek(), value.get_ref()) {
            // A table begins where it is named first.
            (None, DeValue::Table(_)) => return Some(name.span()),
            (None, _) => return Some(value.span()),
            (Some(_), DeValue::Table(inner)) => table = inner,
            _ => return None,
        }
    }
    None
}

/// Where a document says `item` in the list of texts that `key` is, if it does: its bytes.
pub(crate) fn place_of_item(key: &str, item: &str, text: &str) -> Option<std::ops::Range<usize>> {
    let document = DeTable::parse(text).ok()?;
    let start = place_of(key, text)?.start;
    let (_, list) = value_at(document.get_ref(), start)?;
    let DeValue::Array(items) = list else { return None };
    let is_meant = |value: &&toml::Spanned<DeValue<'_>>| matches!(value.get_ref(), DeValue::String(text) if text == item);
    items.iter().find(is_meant).map(toml::Spanned::span)
}

/// As much of a text as an error may say again.
pub(crate) fn echo(text: &str) -> String {
    let mut chars = text.chars();
    let begin: String = chars.by_ref().take(MAX_ECHO_CHARS).collect();
    let begin = begin.split_whitespace().collect::<Vec<_>>().join(" ");
    if chars.next().is_some() { format!("{begin}...") } else { begin }
}

/// A path on one line, whatever characters it has.
pub(crate) fn one_line(path: &Path) -> String {
    let text = path.display().to_string();
    text.chars()
        .map(|c| if c.is_control() { c.escape_default().to_string() } else { c.to_string() })
        .collect()
}

fn path(steps: &[Step]) -> String {
    let mut path = String::new();
    for step in steps {
        match step {
            Step::Key(key) if path.is_empty() => path.push_str(key),
            Step::Key(key) => path = format!("{path}.{key}"),
            // From 0, as elsewhere where knots are counted.
            Step::Item(index) => path = format!("{path}[{index}]"),
        }
    }
    echo(&path)
}

/// The way to the key that begins at a byte.
fn key_at(table: &DeTable<'_>, byte: usize) -> Option<Vec<Step>> {
    table.iter().find_map(|(name, value)| {
        let below = if name.span().start == byte { Vec::new() } else { key_within(value.get_ref(), byte)? };
        Some([vec![Step::Key(name.get_ref().to_string())], below].concat())
    })
}

fn key_within(value: &DeValue<'_>, byte: usize) -> Option<Vec<Step>> {
    match value {
        DeValue::Table(table) => key_at(table, byte),
        DeValue::Array(items) => items.iter().enumerate().find_map(|(index, item)| {
            Some([vec![Step::Item(index)], key_within(item.get_ref(), byte)?].concat())
        }),
        _ => None,
    }
}

/// The value that begins at a byte, the outermost of several, and the way to it. A table in brackets begins with
/// these.
fn value_at<'a, 'b>(table: &'b DeTable<'a>, byte: usize) -> Option<(Vec<Step>, &'b DeValue<'a>)> {
    table.iter().find_map(|(name, value)| {
        let (below, value) = value_within(value, byte)?;
        Some(([vec![Step::Key(name.get_ref().to_string())], below].concat(), value))
    })
}

fn value_within<'a, 'b>(
    value: &'b toml::Spanned<DeValue<'a>>,
    byte: usize,
) -> Option<(Vec<Step>, &'b DeValue<'a>)> {
    if value.span().start == byte {
        return Some((Vec::new(), value.get_ref()));
    }
    match value.get_ref() {
        DeValue::Table(table) => value_at(table, byte),
        DeValue::Array(items) => items.iter().enumerate().find_map(|(index, item)| {
            let (below, value) = value_within(item, byte)?;
            Some(([vec![Step::Item(index)], below].concat(), value))
        }),
        _ => None,
    }
}

/// What the example has there. All items of a list are as its first.
fn at<'a, 'b>(table: &'b DeTable<'a>, steps: &[Step]) -> Option<&'b toml::Spanned<DeValue<'a>>> {
    let (Step::Key(first), rest) = steps.split_first()? else { return None };
    let mut value = table.iter().find(|(name, _)| name.get_ref() == first)?.1;
    for step in rest {
        value = match (step, value.get_ref()) {
            (Step::Key(key), DeValue::Table(table)) => {
                table.iter().find(|(name, _)| name.get_ref() == key)?.1
            }
            (Step::Item(_), DeValue::Array(items)) => items.iter().next()?,
            _ => return None,
        };
    }
    Some(value)
}

fn found(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("text ({:?})", echo(text)),
        DeValue::Integer(number) => format!("the whole number {number}"),
        DeValue::Float(number) => format!("the number {}", number.as_str()),
        DeValue::Boolean(flag) => flag.to_string(),
        DeValue::Datetime(time) => format!("a date or time ({time})"),
        DeValue::Array(items) => format!("a list of {}", items.len()),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

/// What a value is to be that is like this one of `example`. `length`: of a list that is always as long.
fn expected(value: &toml::Spanned<DeValue<'_>>, example: &str, length: Option<usize>) -> String {
    let shown = echo(example.get(value.span()).unwrap_or_default());
    match value.get_ref() {
        DeValue::String(_) => format!("text in quotes, such as {shown}"),
        DeValue::Integer(_) => format!("a whole number, 0 or more, such as {shown}"),
        DeValue::Float(_) => format!("a number, such as {shown}"),
        DeValue::Boolean(_) => "true or false".to_owned(),
        DeValue::Datetime(_) => format!("a date or time, such as {shown}"),
        DeValue::Array(items) => {
            let kind = match items.iter().next().map(toml::Spanned::get_ref) {
                Some(DeValue::Integer(_)) => "whole numbers",
                Some(DeValue::Float(_)) => "numbers",
                Some(DeValue::String(_)) => "texts in quotes",
                Some(DeValue::Table(_)) => "tables",
                _ => return "a list in brackets".to_owned(),
            };
            let count = length.map_or_else(String::new, |length| format!("{length} "));
            format!("a list of {count}{kind}, such as {shown}")
        }
        DeValue::Table(_) => "a table, with keys of its own".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXAMPLE: &str = "[mow]\nheight_m = 0.05\nrows = 3\narea = [0, 0, 8, 6]\nwhen = \"dawn\"\nloud = false\nbeds = [ { x = 0.5 } ]\nwho = [\"*\"]\n";

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only whether it can be read is asked")]
    struct Lawn {
        mow: Mow,
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields, default)]
    #[derive(Default)]
    struct Mow {
        height_m: f32,
        rows: usize,
        area: [usize; 4],
        when: Option<When>,
        loud: bool,
        beds: Vec<Bed>,
        who: Vec<String>,
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum When {
        Dawn,
        Dusk,
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only whether it can be read is asked")]
    struct Bed {
        x: f32,
    }

    fn wrong(text: &str) -> String {
        let error = toml::from_str::<Lawn>(text).expect_err("it is wrong");
        reason(&error, text, EXAMPLE)
    }

    #[test]
    fn types_are_those_of_the_file() {
        toml::from_str::<Lawn>(EXAMPLE).expect("the example is right");
        for (text, expected) in [
            ("mow = 3", "`mow` is the whole number 3, expected a table, with keys of its own"),
            (
                "[mow]\nheight_m = \"tall\"",
                "`mow.height_m` is text (\"tall\"), expected a number, such as 0.05",
            ),
            (
                "mow.rows = -1",
                "`mow.rows` is the whole number -1, expected a whole number, 0 or more, such as 3",
            ),
            ("mow.rows = 1.5", "`mow.rows` is the number 1.5, expected a whole number, 0 or more, such as 3"),
            (
                "[mow]\narea = [1, 2]",
                "`mow.area` is a list of 2, expected a list of 4 whole numbers, such as [0, 0, 8, 6]",
            ),
            (
                "[mow]\narea = 7",
                "`mow.area` is the whole number 7, expected a list of 4 whole numbers, such as [0, 0, 8, 6]",
            ),
            (
                "[mow]\narea = [1, true, 2, 3]",
                "`mow.area[1]` is true, expected a whole number, 0 or more, such as 0",
            ),
            ("mow.loud = 1", "`mow.loud` is the whole number 1, expected true or false"),
            (
                "mow.beds = [{ x = 1.0 }, { x = [] }]",
                "`mow.beds[1].x` is a list of 0, expected a number, such as 0.5",
            ),
            (
                "mow.who = \"*\"",
                "`mow.who` is text (\"*\"), expected a list of texts in quotes, such as [\"*\"]",
            ),
            ("mow.when = \"noon\"", "`mow.when` is text (\"noon\"), expected `dawn` or `dusk`"),
            (
                "[mow]\nwidth = 1",
                "unknown key `mow.width`, expected one of `height_m`, `rows`, `area`, `when`, `loud`, `beds`, `who`",
            ),
            ("mow.beds = [{ y = 1.0 }]", "unknown key `mow.beds[0].y`, expected `x`"),
        ] {
            assert_eq!(wrong(text), expected);
        }
        assert_eq!(wrong("mow.beds = [{}]"), "missing key `x`");
        assert!(wrong(&format!("mow.rows = \"{}\"", "x".repeat(5000))).len() < 300);
    }

    #[test]
    fn a_value_has_its_place() {
        let place = |key| place_of(key, "[mow]\nrows = 3\nbeds = [ { x = 1 } ]\n").map(|span| span.start);
        assert_eq!([place("mow.rows"), place("mow.beds"), place("mow.who")], [Some(13), Some(22), None]);
        assert_eq!(place_of("mow", "mow.rows = 3"), Some(0..3));
    }
}
