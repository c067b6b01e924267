//! Does the source keep the rules of the house: who depends on whom, what a module may name, where
//! unsafe code lives?

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use tests::root;
use tests::scan::{
    MAX_LINES, code_of, exceptions, files_below, holds_something, length_is_explained, named,
    versions_of_its_own, words,
};

/// Everything that stands visibly at the top of the repository.
const TOP_LEVEL: [&str; 11] = [
    "Cargo.toml",
    "Cargo.lock",
    "capture-daemon",
    "renderer",
    "common",
    "systemd",
    "tests",
    "recordings",
    "README.md",
    "Makefile",
    "LICENSE",
];
/// The modules that may hold unsafe code.
const UNSAFE_MODULES: [&str; 4] = [
    "common/src/sealed.rs",
    "capture-daemon/openni2-sys/src/sys.rs",
    "capture-daemon/src/source/openni2/handles/mod.rs",
    "capture-daemon/src/source/openni2/handles/stream.rs",
];
/// What a stage, the station and the pipeline know nothing of: clock, file, thread, log, runtime.
const IMPURE: [&str; 10] =
    ["Instant", "SystemTime", "fs", "File", "thread", "rayon", "tokio", "tracing", "println", "eprintln"];

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Path below the workspace, for messages and lists.
fn name(path: &Path) -> String {
    path.strip_prefix(root()).expect("below the workspace").display().to_string()
}

fn sources() -> Vec<PathBuf> {
    let folders = ["common", "capture-daemon", "renderer", "tests"];
    folders.iter().flat_map(|folder| files_below(&root().join(folder), &["rs"])).collect()
}

/// Asserts that `wrong` finds nothing in any of `files`; says all that it finds.
fn none(files: impl IntoIterator<Item = PathBuf>, wrong: impl Fn(&Path, &str) -> Vec<String>) {
    let mut found = Vec::new();
    for path in files {
        let source = text(&path);
        found.extend(wrong(&path, &source).into_iter().map(|what| format!("{}: {what}", name(&path))));
    }
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

/// What cargo knows of the workspace on this machine's platform.
fn metadata() -> Value {
    let cargo = std::env::var_os("CARGO").unwrap_or("cargo".into());
    let version = Command::new(&cargo).arg("-vV").output().expect("cargo runs").stdout;
    let version = String::from_utf8(version).expect("UTF-8");
    let host = version.lines().find_map(|line| line.strip_prefix("host: ")).expect("cargo names its host");
    let output = Command::new(&cargo)
        .args(["metadata", "--format-version", "1", "--locked", "--offline", "--filter-platform", host])
        .current_dir(root())
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("cargo writes JSON")
}

/// Names of the packages that the programs of `package` link or are built by, however far down.
fn dependencies_of(metadata: &Value, package: &str) -> BTreeSet<String> {
    let list = |value: &Value| value.as_array().cloned().expect("a list");
    let string = |value: &Value| value.as_str().map(str::to_owned).expect("a string");
    let names: BTreeMap<String, String> =
        list(&metadata["packages"]).iter().map(|p| (string(&p["id"]), string(&p["name"]))).collect();
    let nodes: BTreeMap<String, Value> =
        list(&metadata["resolve"]["nodes"]).into_iter().map(|node| (string(&node["id"]), node)).collect();
    let members: Vec<String> = list(&metadata["workspace_members"]).iter().map(string).collect();
    let start = members.iter().find(|id| names[*id] == package).expect("a member of the workspace");

    let mut seen = BTreeSet::new();
    let mut open = vec![start.clone()];
    while let Some(id) = open.pop() {
        for dependency in list(&nodes[&id]["deps"]) {
            let linked = list(&dependency["dep_kinds"]).iter().any(|kind| kind["kind"] != "dev");
            let id = string(&dependency["pkg"]);
            if linked && seen.insert(id.clone()) {
                open.push(id);
            }
        }
    }
    seen.iter().map(|id| names[id].clone()).collect()
}

#[test]
fn dependencies_point_one_way() {
    let metadata = metadata();
    let banned = [
        ("common", &["tokio", "wgpu", "winit", "capture-daemon", "renderer"][..]),
        ("capture-daemon", &["wgpu", "winit", "renderer"]),
        ("renderer", &["capture-daemon"]),
    ];
    for (package, banned) in banned {
        let found = dependencies_of(&metadata, package);
        assert!(found.contains("serde") && found.contains("blake3"), "{package} depends on {found:?}");
        let wrong: Vec<_> = banned.iter().filter(|name| found.contains(**name)).collect();
        assert!(wrong.is_empty(), "{package} depends on {wrong:?}");
    }
}

#[test]
fn a_dependency_further_down_is_found() {
    let graph = serde_json::json!({
        "workspace_members": ["a"],
        "packages": [
            {"id": "a", "name": "a"}, {"id": "b", "name": "b"}, {"id": "c", "name": "c"}, {"id": "d", "name": "d"}
        ],
        "resolve": {"nodes": [
            {"id": "a", "deps": [
                {"pkg": "b", "dep_kinds": [{"kind": null}]},
                {"pkg": "d", "dep_kinds": [{"kind": "dev"}]},
            ]},
            {"id": "b", "deps": [{"pkg": "c", "dep_kinds": [{"kind": "dev"}, {"kind": "build"}]}]},
            {"id": "c", "deps": []},
            {"id": "d", "deps": []},
        ]},
    });
    let found = dependencies_of(&graph, "a");
    assert_eq!(found.iter().map(String::as_str).collect::<Vec<_>>(), ["b", "c"]);
}

#[test]
fn every_version_and_the_lint_table_stand_once() {
    let manifests = files_below(&root(), &["toml"]).into_iter().filter(|path| path.ends_with("Cargo.toml"));
    let (mut members, mut wrong) = (0, Vec::new());
    for path in manifests {
        let manifest: toml::Table = text(&path).parse().expect("a manifest is TOML");
        if !manifest.contains_key("package") {
            continue;
        }
        members += 1;
        wrong.extend(versions_of_its_own(&manifest).iter().map(|what| format!("{}: {what}", name(&path))));
        let lints = manifest.get("lints").and_then(|lints| lints.get("workspace"));
        if lints.and_then(toml::Value::as_bool) != Some(true) {
            wrong.push(format!("{}: no `[lints] workspace = true`", name(&path)));
        }
    }
    assert!(members >= 4, "{members} members");
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn the_lint_table_denies_unsafe_code_and_wants_docs() {
    let manifest: toml::Table = text(&root().join("Cargo.toml")).parse().expect("a manifest is TOML");
    let lints = &manifest["workspace"]["lints"];
    let level = |tool: &str, lint: &str| lints[tool].get(lint).and_then(toml::Value::as_str);
    assert_eq!(level("rust", "unsafe_code"), Some("deny"));
    assert_eq!(level("clippy", "undocumented_unsafe_blocks"), Some("deny"));
    assert!(level("rust", "missing_docs").is_some(), "missing_docs is off");
}

#[test]
fn the_stages_the_station_and_the_pipeline_know_no_clock_file_thread_log_or_runtime() {
    let source = root().join("capture-daemon/src");
    let mut files = files_below(&source.join("stages"), &["rs"]);
    files.extend([source.join("station.rs"), source.join("pipeline.rs")]);
    none(files, |_, source| named(source, &IMPURE));
}

#[test]
fn the_scene_names_no_gpu() {
    none(files_below(&root().join("renderer/src/scene"), &["rs"]), |_, source| {
        named(source, &["wgpu", "winit"])
    });
}

#[test]
fn unsafe_code_lives_in_the_named_modules_only() {
    for module in UNSAFE_MODULES {
        let source = text(&root().join(module));
        assert!(words(&code_of(&source)).any(|(_, word)| word == "unsafe"), "{module} needs no exception");
    }
    let elsewhere = sources().into_iter().filter(|path| !UNSAFE_MODULES.contains(&name(path).as_str()));
    none(elsewhere, |_, source| {
        let code = code_of(source);
        let found = words(&code).filter(|(_, word)| ["unsafe", "unsafe_code"].contains(word));
        found.map(|(line, word)| format!("{line}: {word}")).collect()
    });
}

#[test]
fn every_exception_to_a_lint_has_a_reason() {
    none(sources(), |_, source| {
        exceptions(source).into_iter().filter(|inside| !inside.contains("reason")).collect()
    });
}

#[test]
fn no_file_is_empty() {
    none(
        sources(),
        |_, source| {
            if holds_something(source) { Vec::new() } else { vec!["holds no item".to_owned()] }
        },
    );
}

#[test]
fn long_files_say_why() {
    let files = ["common", "capture-daemon", "renderer", "tests"];
    let files = files.iter().flat_map(|folder| files_below(&root().join(folder), &["rs", "wgsl"]));
    none(files, |_, source| {
        let lines = source.lines().count();
        let wrong = format!("{lines} lines, more than {MAX_LINES}, and its docs do not say why");
        if length_is_explained(source) { Vec::new() } else { vec![wrong] }
    });
}

#[test]
fn nothing_else_stands_at_the_top() {
    let ignored = text(&root().join(".gitignore"));
    let entries = std::fs::read_dir(root()).expect("the workspace is readable");
    let mut names = entries.map(|entry| entry.expect("readable").file_name().into_string().expect("UTF-8"));
    let known = |name: &str| {
        name.starts_with('.')
            || TOP_LEVEL.contains(&name)
            || ignored.lines().any(|line| line.trim_matches('/') == name)
    };
    assert_eq!(names.find(|name| !known(name)), None);
    assert!(!known("docs") && !known("src"));
}

#[test]
fn what_the_readme_names_is_there() {
    let readme = std::fs::read_to_string(root().join("README.md")).expect("a README");
    let words = readme.split(|c: char| c.is_whitespace() || "()[]`|'\"".contains(c));
    let tops = ["recordings/", "capture-daemon/", "renderer/", "common/", "tests/", "systemd/"];
    let named: Vec<&str> = words.filter(|word| tops.iter().any(|top| word.starts_with(top))).collect();
    assert!(named.len() > 8, "{named:?}");
    let missing: Vec<&&str> = named.iter().filter(|path| !root().join(path).exists()).collect();
    assert!(missing.is_empty(), "the README names {missing:?}");
}
