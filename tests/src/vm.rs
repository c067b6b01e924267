//! A small machine with a kernel of its own, for tests of what a kernel does: a test program boots it once, with itself and
//! the station's program in it, and there runs the very same tests.
//!
//! The kernel is Debian's, unpacked by `.ci/setup.sh` to `target/vm`; the processor is emulated (qemu's TCG), since a nested
//! `/dev/kvm` may exist and hang. Where one of these is not there, the tests are skipped and say so;
//! `SWARD_REQUIRE_VM=1` makes it a failure.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use cpio::newc::Builder;
use tempfile::TempDir;

use crate::programs::{Program, Running};
use crate::{root, shipped_recording};

/// Set within the machine.
const INSIDE: &str = "SWARD_IN_VM";
/// Longest run of the machine.
const DEADLINE: Duration = Duration::from_secs(240);
/// Modules that the tests need; what these need is loaded, too.
const MODULES: [&str; 2] = ["uvcvideo", "vhci-hcd"];
/// Processors and memory of the machine.
const SIZE: [&str; 4] = ["-smp", "2", "-m", "768"];
/// Programs and files of this machine that are in there at the same places.
const HOST_FILES: [&str; 3] =
    ["/bin/udevadm", "/lib/udev/rules.d/50-udev-default.rules", "/lib/udev/rules.d/60-persistent-v4l.rules"];

/// Where `.ci/setup.sh` unpacks the kernel.
fn kernel() -> PathBuf {
    root().join("target/vm")
}

/// A shipped recording of a single blade, which is in the machine, too.
pub fn recording() -> PathBuf {
    root().join("recordings/single-1.mcap")
}

/// Whether this is the machine.
pub fn is_inside() -> bool {
    std::env::var_os(INSIDE).is_some()
}

/// Runs a test of this program by its name within the machine: there `body`, here the boot, once for all tests of the
/// program, and then what came of it.
///
/// # Panics
/// If it failed there; with what it said.
pub fn test(name: &str, body: impl FnOnce()) {
    static RUN: OnceLock<Option<Outcome>> = OnceLock::new();
    if is_inside() {
        return body();
    }
    let Some(outcome) = RUN.get_or_init(run) else { return };
    let passed = outcome.results.get(name);
    assert!(passed == Some(&true), "{name} did not pass in the machine ({passed:?}):\n{}", outcome.said);
}

/// What came of the tests.
struct Outcome {
    results: BTreeMap<String, bool>,
    said: String,
}

/// What is not here that the machine is made of.
fn missing() -> Vec<&'static str> {
    let is_there = |path: &str| Path::new(path).exists();
    let runs = |program: &str| Command::new(program).arg("--version").output().is_ok();
    let needs = [
        (cfg!(target_arch = "x86_64"), "a processor of the kind amd64"),
        (kernel().join("vmlinux").exists(), "a kernel in target/vm (make vm-test unpacks one)"),
        (runs("qemu-system-x86_64"), "qemu-system-x86_64 (Debian's qemu-system-x86)"),
        (is_there("/bin/busybox"), "/bin/busybox (Debian's busybox-static)"),
        (HOST_FILES.iter().all(|path| is_there(path)), "udev (Debian's udev)"),
        (runs("strip"), "strip (Debian's binutils)"),
    ];
    needs.iter().filter(|(is_there, _)| !is_there).map(|(_, what)| *what).collect()
}

/// Boots the machine; `None`, said, where it cannot be.
fn run() -> Option<Outcome> {
    let missing = missing();
    if !missing.is_empty() {
        let missing = missing.join(", ");
        let is_required = std::env::var_os("SWARD_REQUIRE_VM").is_some_and(|value| value == "1");
        assert!(!is_required, "not here: {missing}; and SWARD_REQUIRE_VM=1");
        eprintln!("skipped: not here: {missing}");
        return None;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let start = Instant::now();
    let disk = folder.path().join("initramfs");
    pack(&disk, &folder).expect("room for the machine");
    let [console, said] = ["console", "said"].map(|name| folder.path().join(name));
    let mut command = Command::new("qemu-system-x86_64");
    command.args([
        "-machine",
        "q35,accel=tcg",
        "-cpu",
        "max",
        "-nodefaults",
        "-no-user-config",
        "-no-reboot",
    ]);
    command.args(SIZE).args(["-display", "none", "-kernel"]).arg(kernel().join("vmlinux"));
    command.arg("-initrd").arg(&disk);
    command.args(["-append", "console=ttyS0 panic=-1 quiet mitigations=off nokaslr"]);
    for port in [&console, &said] {
        command.arg("-serial").arg(format!("file:{}", port.display()));
    }
    let packed = start.elapsed();
    let mut machine = Running::start(command);
    let ended = crate::programs::wait_for(DEADLINE, || machine.ended());
    machine.kill();
    let read = |path: &Path| String::from_utf8_lossy(&fs::read(path).unwrap_or_default()).into_owned();
    let said = read(&said).replace('\r', "");
    let console = read(&console);
    let qemu =
        if ended.is_some() { machine.finish(DEADLINE).stderr } else { "it did not end in time".to_owned() };
    println!("the machine was packed in {packed:?} and ran until {:?}", start.elapsed());
    let results = results(&said);
    Some(Outcome { results, said: format!("{said}\nconsole: {console}\nqemu: {qemu}") })
}

/// What libtest said of each test.
fn results(said: &str) -> BTreeMap<String, bool> {
    let result = |line: &str| {
        let (name, result) = line.strip_prefix("test ")?.split_once(" ... ")?;
        Some((name.to_owned(), result == "ok"))
    };
    said.lines().filter_map(result).collect()
}

/// Writes all that is in the machine.
fn pack(disk: &Path, scratch: &TempDir) -> io::Result<()> {
    let mut archive = Archive { out: io::BufWriter::new(fs::File::create(disk)?), known: BTreeSet::new() };
    let program = std::env::current_exe()?;
    archive.file("/init", &root().join("tests/vm/init"))?;
    archive.file("/bin/busybox", Path::new("/bin/busybox"))?;
    for (index, path) in [&*program, &Program::Capture.path()].into_iter().enumerate() {
        // What a debugger wants of them is most of their bytes.
        let stripped = scratch.path().join(format!("program-{index}"));
        let status = Command::new("strip").arg("-o").arg(&stripped).arg(path).status()?;
        assert!(status.success(), "{} cannot be stripped", path.display());
        archive.program(path, &stripped)?;
    }
    for path in HOST_FILES.map(Path::new) {
        archive.program(path, path)?;
    }
    archive.program(Path::new("/lib/udev/v4l_id"), Path::new("/lib/udev/v4l_id"))?;
    archive.link("/lib/systemd/systemd-udevd", "/bin/udevadm")?;
    let rules = root().join("systemd/rules.d");
    for entry in fs::read_dir(rules)? {
        let entry = entry?;
        let place = Path::new("/etc/udev/rules.d").join(entry.file_name());
        archive.file(place.to_str().expect("UTF-8"), &entry.path())?;
    }
    for recording in [shipped_recording(), recording()] {
        archive.file(recording.to_str().expect("UTF-8"), &recording)?;
    }
    // As Debian's rules for OpenNI2, which come after ours, would have it.
    let debian =
        "SUBSYSTEM==\"usb\", ATTR{idVendor}==\"1d27\", MODE:=\"0666\", OWNER:=\"root\", GROUP:=\"video\"\n";
    archive.text("/lib/udev/rules.d/60-libopenni2-0.rules", debian)?;
    archive.text("/etc/passwd", "root:x:0:0::/:/bin/sh\nvisitor:x:1000:1000::/:/bin/sh\n")?;
    let groups = ["root:x:0:", "tty:x:5:", "video:x:44:", "visitor:x:1000:"];
    archive.text("/etc/group", &(groups.join("\n") + "\n"))?;

    let modules = in_order(&kernel().join("modules"), &MODULES);
    let mut names = String::new();
    for module in &modules {
        let name = module.file_name().and_then(|name| name.to_str()).expect("UTF-8");
        archive.file(&format!("/modules/{name}"), module)?;
        let _ = write!(names, "/modules/{name} ");
    }
    let filter: Vec<String> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let settings = format!(
        "modules='{names}'\nprogram='{}'\nfolder='{}'\nfilter='{}'\n",
        program.display(),
        root().display(),
        filter.join(" ")
    );
    archive.text("/settings", &settings)?;
    archive.end()
}

/// The files of modules, what each needs before it.
fn in_order(folder: &Path, wanted: &[&str]) -> Vec<PathBuf> {
    let files = crate::scan::files_below(folder, &["ko"]);
    let same = |name: &str| name.replace('-', "_");
    let file = |name: &str| {
        let is_it = |path: &&PathBuf| {
            path.file_stem().is_some_and(|stem| same(&stem.to_string_lossy()) == same(name))
        };
        files.iter().find(is_it).unwrap_or_else(|| panic!("no module {name} below {}", folder.display()))
    };
    let mut ordered: Vec<PathBuf> = Vec::new();
    let mut open: Vec<(PathBuf, bool)> =
        wanted.iter().rev().map(|name| (file(name).clone(), false)).collect();
    while let Some((path, is_ready)) = open.pop() {
        if ordered.contains(&path) {
            continue;
        }
        if is_ready {
            ordered.push(path);
            continue;
        }
        let needs = needs(&fs::read(&path).expect("readable"));
        open.push((path, true));
        open.extend(needs.iter().rev().map(|name| (file(name).clone(), false)));
    }
    ordered
}

/// The modules that a module needs, by what it says of itself.
fn needs(module: &[u8]) -> Vec<String> {
    const SAYS: &[u8] = b"\0depends=";
    let Some(at) = module.windows(SAYS.len()).position(|window| window == SAYS) else { return Vec::new() };
    let rest = &module[at + SAYS.len()..];
    let end = rest.iter().position(|byte| *byte == 0).unwrap_or(rest.len());
    let names = String::from_utf8_lossy(&rest[..end]).into_owned();
    names.split(',').filter(|name| !name.is_empty()).map(str::to_owned).collect()
}

/// The shared libraries that a program is linked with, as this machine finds them.
fn libraries(program: &Path) -> Vec<PathBuf> {
    let output = Command::new("ldd").arg(program).output().expect("ldd runs").stdout;
    let text = String::from_utf8_lossy(&output).into_owned();
    let path =
        |line: &str| line.split_ascii_whitespace().find(|word| word.starts_with('/')).map(PathBuf::from);
    text.lines().filter_map(path).collect()
}

/// An archive of files, as the kernel unpacks it at boot.
struct Archive<W: io::Write> {
    out: W,
    known: BTreeSet<PathBuf>,
}

/// Kinds of entries, as in `stat`'s mode.
const FILE: u32 = 0o100_755;
const FOLDER: u32 = 0o040_755;
const LINK: u32 = 0o120_777;

impl<W: io::Write> Archive<W> {
    fn entry(&mut self, place: &Path, mode: u32, bytes: &[u8]) -> io::Result<()> {
        if !self.known.insert(place.to_owned()) {
            return Ok(());
        }
        if let Some(parent) = place.parent().filter(|parent| *parent != Path::new("/")) {
            self.entry(parent, FOLDER, &[])?;
        }
        let name = place.strip_prefix("/").unwrap_or(place).to_str().expect("UTF-8");
        let mut entry = Builder::new(name)
            .mode(mode)
            .ino(self.known.len() as u32)
            .write(&mut self.out, bytes.len() as u32);
        entry.write_all(bytes)?;
        entry.finish().map(|_| ())
    }

    fn text(&mut self, place: &str, text: &str) -> io::Result<()> {
        self.entry(Path::new(place), FILE, text.as_bytes())
    }

    fn link(&mut self, place: &str, target: &str) -> io::Result<()> {
        self.entry(Path::new(place), LINK, target.as_bytes())
    }

    fn file(&mut self, place: &str, of: &Path) -> io::Result<()> {
        self.entry(Path::new(place), FILE, &fs::read(of)?)
    }

    /// A program and its libraries. `of`: its bytes.
    fn program(&mut self, place: &Path, of: &Path) -> io::Result<()> {
        self.entry(place, FILE, &fs::read(of)?)?;
        for library in libraries(place) {
            self.entry(&library, FILE, &fs::read(&library)?)?;
        }
        Ok(())
    }

    fn end(mut self) -> io::Result<()> {
        cpio::newc::trailer(&mut self.out)?;
        self.out.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_read_as_libtest_writes_them() {
        let said = "ready\ntest a ... ok\ntest b ... FAILED\n\nfailures:\n---- b stdout ----\ntest result: FAILED. 1";
        assert_eq!(results(said), BTreeMap::from([("a".to_owned(), true), ("b".to_owned(), false)]));
    }

    #[test]
    fn modules_are_loaded_after_what_they_need() {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, says) in [("a-b", "c,d_e"), ("c", "d_e"), ("d-e", ""), ("z", "")] {
            let module = format!("ELF\0license=GPL\0depends={says}\0rest");
            fs::write(folder.path().join(format!("{name}.ko")), module).expect("room");
        }
        let names: Vec<String> = in_order(folder.path(), &["a_b"])
            .iter()
            .map(|path| path.file_stem().expect("a name").to_string_lossy().into_owned())
            .collect();
        assert_eq!(names, ["d-e", "c", "a-b"]);
    }
}
