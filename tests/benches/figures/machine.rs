//! What it was measured on, and of which programs.

use std::fs;
use std::process::Command;

use tests::programs::Program;

fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).current_dir(tests::root()).output().ok()?;
    let text = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    (output.status.success() && !text.is_empty()).then_some(text)
}

/// The value of a `name : value` line.
fn value(text: &str, name: &str) -> Option<String> {
    let line = text.lines().find(|line| line.starts_with(name))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

/// The file system that holds the state directories.
fn file_system() -> Option<String> {
    let folder = std::env::temp_dir();
    let mounts = fs::read_to_string("/proc/mounts").ok()?;
    let mounts = mounts.lines().filter_map(|line| {
        let mut words = line.split(' ').skip(1);
        Some((words.next()?.to_owned(), words.next()?.to_owned()))
    });
    let holder = mounts.filter(|(at, _)| folder.starts_with(at)).max_by_key(|(at, _)| at.len());
    holder.map(|(_, kind)| kind)
}

/// Date, machine, versions; lines of Markdown.
pub(crate) fn lines() -> String {
    let unknown = || "unknown".to_owned();
    let cpu = fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| value(&text, "model name"));
    let memory = fs::read_to_string("/proc/meminfo").ok().and_then(|text| value(&text, "MemTotal"));
    let memory = memory.and_then(|text| text.trim_end_matches(" kB").parse::<f64>().ok());
    let kernel = fs::read_to_string("/proc/sys/kernel/osrelease").map(|text| text.trim().to_owned());
    let load = fs::read_to_string("/proc/loadavg").ok();
    let load = load.and_then(|text| text.split(' ').next().map(str::to_owned));
    let count = std::thread::available_parallelism().map_or(0, usize::from);
    let versions = [Program::Capture, Program::Render]
        .map(|program| output(&program.path().display().to_string(), &["--version"]).unwrap_or_else(unknown));
    format!(
        "- {}; commit {}; {}\n- {} × {}, {:.0} GiB, Linux {}, load {} at the start\n- blades' files on {}",
        output("date", &["-u", "+%F"]).unwrap_or_else(unknown),
        output("git", &["describe", "--always", "--dirty"]).unwrap_or_else(unknown),
        versions.join(", "),
        count,
        cpu.unwrap_or_else(unknown),
        memory.unwrap_or(0.0) / (1024.0 * 1024.0),
        kernel.unwrap_or_else(|_| unknown()),
        load.unwrap_or_else(unknown),
        file_system().unwrap_or_else(unknown),
    )
}
