//! Reading Rust source as text, for the laws of `tests/tests/house.rs`: what it names, what it
//! allows, whether it holds anything.

use std::path::{Path, PathBuf};

/// A file longer than this owes an explanation in its module docs: [`LONG_BECAUSE`].
pub const MAX_LINES: usize = 500;
/// How that explanation begins.
pub const LONG_BECAUSE: &str = "This file is long because";

/// Every file with one of `extensions` below `folder`, sorted.
///
/// # Panics
/// If there is none: a law over nothing would hold by accident.
pub fn files_below(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        let entries =
            std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
        for path in entries.map(|entry| entry.expect("a folder is readable").path()) {
            let hidden = path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
            if path.is_dir() && !hidden && !path.ends_with("target") {
                folders.push(path);
            } else if path.extension().is_some_and(|ext| extensions.iter().any(|wanted| ext == *wanted)) {
                found.push(path);
            }
        }
    }
    assert!(!found.is_empty(), "no {extensions:?} below {}", folder.display());
    found.sort();
    found
}

/// `source` with the text of comments, strings and characters blanked, its lines kept.
pub fn code_of(source: &str) -> String {
    let mut code = String::with_capacity(source.len());
    let mut rest = source;
    while let Some(first) = rest.chars().next() {
        let in_word = code.chars().next_back().is_some_and(is_word);
        let length = literal_or_comment(rest, in_word);
        if length > 0 {
            code.extend(rest[..length].chars().map(|c| if c == '\n' { '\n' } else { ' ' }));
            rest = &rest[length..];
        } else {
            code.push(first);
            rest = &rest[first.len_utf8()..];
        }
    }
    code
}

/// Bytes of the comment, string or character that `text` begins with; 0 if it begins with none.
fn literal_or_comment(text: &str, in_word: bool) -> usize {
    if text.starts_with("//") {
        return text.find('\n').unwrap_or(text.len());
    }
    if text.starts_with("/*") {
        return block_comment(text);
    }
    if text.starts_with('\'') {
        return character(text);
    }
    let prefix = if in_word { 0 } else { text.find(|c| !"bcr".contains(c)).unwrap_or(0).min(2) };
    let (prefix, body) = text.split_at(prefix);
    let hashes = if prefix.ends_with('r') { body.find(|c| c != '#').unwrap_or(0) } else { 0 };
    if !body[hashes..].starts_with('"') {
        return 0;
    }
    let opened = prefix.len() + hashes + 1;
    if prefix.ends_with('r') {
        let end = format!("\"{}", "#".repeat(hashes));
        return text[opened..].find(&end).map_or(text.len(), |at| opened + at + end.len());
    }
    let mut escaped = false;
    for (at, c) in text[opened..].char_indices() {
        match c {
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            '"' => return opened + at + 1,
            _ => {}
        }
    }
    text.len()
}

fn block_comment(text: &str) -> usize {
    let (mut depth, mut at) = (0, 0);
    while at < text.len() {
        if text[at..].starts_with("/*") {
            (depth, at) = (depth + 1, at + 2);
        } else if text[at..].starts_with("*/") {
            (depth, at) = (depth - 1, at + 2);
            if depth == 0 {
                return at;
            }
        } else {
            at += text[at..].chars().next().map_or(1, char::len_utf8);
        }
    }
    text.len()
}

/// A character literal, told from a lifetime by its second quote.
fn character(text: &str) -> usize {
    let mut chars = text.char_indices().skip(1);
    match chars.next() {
        Some((_, '\\')) => {
            chars.next();
            chars.find(|(_, c)| *c == '\'').map_or(0, |(at, _)| at + 1)
        }
        Some(_) => chars.next().filter(|(_, c)| *c == '\'').map_or(0, |(at, _)| at + 1),
        None => 0,
    }
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The words (names and keywords) of some code, with their lines, counted from 1.
pub fn words(code: &str) -> impl Iterator<Item = (usize, &str)> {
    code.lines().enumerate().flat_map(|(line, text)| {
        let words = text.split(|c| !is_word(c)).filter(|word| !word.is_empty());
        words.map(move |word| (line + 1, word))
    })
}

/// Where `source` names one of `banned` outside comments, strings and its own unit tests:
/// "line: word" each.
pub fn named(source: &str, banned: &[&str]) -> Vec<String> {
    let code = without_unit_tests(&code_of(source));
    let hits = words(&code).filter(|(_, word)| banned.contains(word));
    hits.map(|(line, word)| format!("{line}: {word}")).collect()
}

/// Code with every `#[cfg(test)] mod … { … }` left out; lines before them keep their numbers.
fn without_unit_tests(code: &str) -> String {
    let mut kept = String::new();
    let mut rest = code;
    while let Some(at) = rest.find("#[cfg(test)]") {
        let (before, tests) = rest.split_at(at);
        kept.push_str(before);
        let after = &tests["#[cfg(test)]".len()..];
        rest = if after.trim_start().starts_with("mod ") { &after[end_of_block(after)..] } else { after };
    }
    kept + rest
}

/// Where the block or statement that begins `code` ends.
fn end_of_block(code: &str) -> usize {
    let mut depth = 0;
    for (at, c) in code.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth == 1 => return at + 1,
            '}' => depth -= 1,
            ';' if depth == 0 => return at + 1,
            _ => {}
        }
    }
    code.len()
}

/// The insides of every `allow(…)` and `expect(…)` attribute of `source`.
pub fn exceptions(source: &str) -> Vec<String> {
    let code = code_of(source);
    let mut found = Vec::new();
    for (at, _) in code.match_indices("#[").chain(code.match_indices("#![")) {
        let attribute = &code[at..];
        let attribute = &attribute[..attribute.find(']').unwrap_or(attribute.len())];
        for opening in ["allow(", "expect("] {
            let inside = attribute.split_once(opening).filter(|(before, _)| !before.ends_with(is_word));
            found.extend(inside.map(|(_, inside)| inside.to_owned()));
        }
    }
    found
}

/// Whether `source` holds at least one item beside comments and attributes.
pub fn holds_something(source: &str) -> bool {
    const ITEMS: [&str; 13] = [
        "fn",
        "struct",
        "enum",
        "union",
        "trait",
        "impl",
        "mod",
        "use",
        "const",
        "static",
        "type",
        "macro_rules",
        "extern",
    ];
    words(&code_of(source)).any(|(_, word)| ITEMS.contains(&word))
}

/// Whether a file of this length explains itself where it must.
pub fn length_is_explained(source: &str) -> bool {
    let docs = source.lines().take_while(|line| line.starts_with("//") || line.is_empty());
    source.lines().count() <= MAX_LINES || docs.into_iter().any(|line| line.contains(LONG_BECAUSE))
}

/// The dependencies of a manifest that do not take their version from the workspace.
pub fn versions_of_its_own(manifest: &toml::Table) -> Vec<String> {
    let mut found = Vec::new();
    let targets = manifest.get("target").and_then(toml::Value::as_table);
    let tables = targets.into_iter().flat_map(|targets| targets.values().filter_map(toml::Value::as_table));
    for table in tables.chain([manifest]) {
        for kind in ["dependencies", "dev-dependencies", "build-dependencies"] {
            let dependencies = table.get(kind).and_then(toml::Value::as_table);
            for (name, value) in dependencies.into_iter().flatten() {
                let from_workspace = value.get("workspace").and_then(toml::Value::as_bool) == Some(true);
                if !from_workspace {
                    found.push(format!("{kind}.{name}"));
                }
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_and_literals_are_not_code() {
        for source in [
            "// wgpu",
            "/* wgpu /* wgpu */ wgpu */",
            "\"wgpu \\\" wgpu\"",
            "r#\"wgpu \" wgpu\"#",
            "b\"wgpu\"",
            "br\"wgpu\"",
            "let quote = '\"'; // wgpu \"",
            "let backslash = '\\\\'; // wgpu",
            "/// [`wgpu`]\nfn a() {}",
            "my_wgpu wgpus",
        ] {
            assert_eq!(named(source, &["wgpu"]), [""; 0], "{source}");
        }
    }

    #[test]
    fn a_banned_word_in_code_is_found_with_its_line() {
        for source in [
            "\nuse wgpu::Device;",
            "/* a */\n let x = '\"'; let y: wgpu::Device; // '\"'",
            "\nfn f<'a>(x: &'a wgpu::Device) {}",
            "\"a\nb\"; wgpu",
            "for\nr in wgpu {}",
        ] {
            assert_eq!(named(source, &["wgpu"]), ["2: wgpu"], "{source}");
        }
    }

    #[test]
    fn unit_tests_may_name_what_their_module_may_not() {
        let tests = "#[cfg(test)]\nmod tests {\n fn f() { fs::read(); }\n}\n";
        assert_eq!(named(tests, &["fs"]), [""; 0]);
        assert_eq!(named(&format!("{tests}use std::fs;"), &["fs"]).len(), 1, "what follows them counts");
        assert_eq!(named("#[cfg(test)]\nuse std::fs;", &["fs"]).len(), 1, "only modules are left out");
    }

    #[test]
    fn an_exception_shows_its_reason_or_the_lack_of_one() {
        let found =
            exceptions("#[allow(a)]\n#![allow(b, reason = \"c\")]\n#[cfg_attr(x, expect(d))]\nx.expect(e)");
        let reasons: Vec<bool> = found.iter().map(|inside| inside.contains("reason")).collect();
        assert_eq!(reasons, [false, false, true], "{found:?}");
    }

    #[test]
    fn a_file_of_comments_holds_nothing() {
        assert!(!holds_something("//! A module with docs alone: use it, fn.\n\n"));
        assert!(!holds_something(""));
        assert!(holds_something("//! Docs.\npub mod a;"));
    }

    #[test]
    fn a_long_file_without_a_word_about_it_is_found() {
        let long = "let a = 1;\n".repeat(MAX_LINES + 1);
        assert!(!length_is_explained(&long));
        assert!(!length_is_explained(&format!("{long}// {LONG_BECAUSE} it says so at its end.")));
        assert!(length_is_explained(&format!("//! {LONG_BECAUSE} of a table.\n{long}")));
        assert!(length_is_explained("fn short() {}"));
    }

    #[test]
    fn a_version_of_its_own_is_found_in_every_table() {
        let manifest = "[dependencies]\na.workspace = true\nb = \"1\"\n[dev-dependencies]\nc = { version = \"1\" }\n\
            [build-dependencies]\nd = { path = \"d\" }\n[target.'cfg(unix)'.dependencies]\ne = { workspace = false }";
        let mut found = versions_of_its_own(&manifest.parse().expect("toml"));
        found.sort();
        assert_eq!(found, ["build-dependencies.d", "dependencies.b", "dependencies.e", "dev-dependencies.c"]);
    }

    #[test]
    #[should_panic(expected = "no [\"rs\"] below")]
    fn a_folder_without_such_files_is_an_error() {
        files_below(tempfile::tempdir().expect("temporary folder").path(), &["rs"]);
    }

    #[test]
    #[should_panic(expected = "No such file")]
    fn a_missing_folder_is_an_error() {
        files_below(Path::new("/no/such/folder"), &["rs"]);
    }
}
