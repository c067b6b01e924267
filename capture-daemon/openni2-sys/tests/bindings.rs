//! Are the bindings those of the headers?

use std::path::{Path, PathBuf};
use std::process::Command;

/// Where Debian's libopenni2-dev puts the headers.
const HEADERS: &str = "/usr/include/openni2";

/// A libclang that bindgen would find.
fn libclang() -> Option<PathBuf> {
    let folders = std::env::var_os("LIBCLANG_PATH").map(PathBuf::from).into_iter();
    let llvm = std::fs::read_dir("/usr/lib").into_iter().flatten().flatten();
    let llvm = llvm.filter(|entry| entry.file_name().as_encoded_bytes().starts_with(b"llvm"));
    let triplet = format!("/usr/lib/{}-linux-gnu", std::env::consts::ARCH);
    let usual = ["/usr/lib".into(), "/usr/lib64".into(), PathBuf::from(triplet)];
    let folders = folders.chain(llvm.map(|entry| entry.path().join("lib"))).chain(usual);
    let mut files = folders.flat_map(|folder| std::fs::read_dir(folder).into_iter().flatten().flatten());
    let is_libclang = |name: &[u8]| name.starts_with(b"libclang.so") || name.starts_with(b"libclang-");
    files.find(|file| is_libclang(file.file_name().as_encoded_bytes())).map(|file| file.path())
}

#[test]
fn the_bindings_are_those_of_the_headers() {
    let is_there = Path::new(HEADERS).join("OniCAPI.h").exists() && libclang().is_some();
    if !is_there {
        let is_required = std::env::var_os("SWARD_REQUIRE_OPENNI2").is_some();
        assert!(!is_required, "there is no {HEADERS} (libopenni2-dev) or no libclang (libclang-14-dev)");
        eprintln!("skipped: there is no {HEADERS} (libopenni2-dev) or no libclang (libclang-14-dev)");
        return;
    }
    let output = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()))
        .args(["run", "--locked", "--quiet", "-p", "openni2-sys", "--features", "regenerate"])
        .args(["--example", "regenerate", "--", HEADERS])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let made = String::from_utf8(output.stdout).expect("UTF-8");
    let kept = include_str!("../src/sys.rs");
    let differs = made.lines().zip(kept.lines()).enumerate().find(|(_, (made, kept))| made != kept);
    assert_eq!(differs, None, "made and kept differ there; see examples/regenerate.rs for the command");
    assert_eq!(made.lines().count(), kept.lines().count());
}
