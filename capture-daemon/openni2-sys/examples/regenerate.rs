//! Prints the bindings of this crate, made from OpenNI2's headers: `src/sys.rs` is what it prints.
//!
//!     cargo run -p openni2-sys --features regenerate --example regenerate -- /usr/include/openni2 \
//!         > capture-daemon/openni2-sys/src/sys.rs

use std::path::PathBuf;
use std::process::ExitCode;

use bindgen::{EnumVariation, Formatter, RustEdition, RustTarget};

/// What stands above the generated code.
const HEAD: &str = "\
//! OpenNI2's C interface, as bindgen makes it of the headers of OpenNI 2.2. This file is long because the headers
//! are.
//!
//! Made by `examples/regenerate.rs`, and never edited; a test compares the two.

#![allow(unsafe_code, missing_docs, reason = \"a C interface, which its headers document\")]
#![allow(non_camel_case_types, non_snake_case, non_upper_case_globals, reason = \"C's names\")]
#![allow(clippy::missing_safety_doc, clippy::undocumented_unsafe_blocks, reason = \"the headers say what holds\")]
#![allow(unused_qualifications, clippy::all, reason = \"generated\")]";

/// What is bound: devices, streams, frames and recorders, but neither colour nor the conversions of coordinates.
const FUNCTIONS: &str = "oni(Initialize|Shutdown|GetDeviceList|ReleaseDeviceList|RegisterDeviceCallbacks|\
    UnregisterDeviceCallbacks|WaitForAnyStream|GetVersion|GetExtendedError|\
    Device(Open|Close|GetSensorInfo|GetInfo|CreateStream|SetProperty|GetProperty|IsPropertySupported|Invoke|\
    IsCommandSupported)|\
    Stream(Destroy|GetSensorInfo|Start|Stop|ReadFrame|SetProperty|GetProperty|IsPropertySupported)|\
    FrameRelease|CreateRecorder|Recorder(AttachStream|Start|Stop|Destroy)|\
    SetLog(MinSeverity|ConsoleOutput|FileOutput))";

/// What bindgen writes above its assertions of sizes and offsets, and the same with its reason.
const BARE_EXCEPTION: &str = "#[allow(clippy::unnecessary_operation, clippy::identity_op)]";
const EXCEPTION: &str =
    "#[allow(clippy::unnecessary_operation, clippy::identity_op, reason = \"generated\")]";

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1);
    let (Some(headers), None) = (arguments.next().map(PathBuf::from), arguments.next()) else {
        eprintln!("regenerate: expected the folder of OpenNI2's headers, such as /usr/include/openni2.");
        return ExitCode::from(2);
    };
    // As old as that of the workspace.
    let rust = RustTarget::stable(85, 0).expect("bindgen knows it");
    let bindings = bindgen::Builder::default()
        .header_contents("openni2.h", "#include <OniCAPI.h>\n")
        // The headers name structs without `struct`, which is C++ alone.
        .clang_args(["-x", "c++"])
        .clang_arg(format!("-I{}", headers.display()))
        .raw_line(HEAD)
        .disable_header_comment()
        .allowlist_function(FUNCTIONS)
        .allowlist_type("Oni.*")
        .allowlist_var(
            "ONI_(STATUS|SENSOR|PIXEL_FORMAT_(DEPTH|SHIFT)|DEVICE|STREAM_PROPERTY|TIMEOUT|VERSION)_.*",
        )
        .blocklist_type(
            "Oni(Grayscale.*|RGB888Pixel|YUV422DoublePixel|.*BufferCallback|GeneralCallback|HardwareVersion)",
        )
        .dynamic_library_name("OpenNi2")
        .dynamic_link_require_all(true)
        .default_enum_style(EnumVariation::Consts)
        .prepend_enum_name(false)
        .generate_comments(false)
        .rust_target(rust)
        .rust_edition(RustEdition::Edition2024)
        .wrap_unsafe_ops(true)
        // Without rustfmt, whose version would matter.
        .formatter(Formatter::Prettyplease)
        .generate();
    match bindings {
        Ok(bindings) => {
            print!("{}", bindings.to_string().replace(BARE_EXCEPTION, EXCEPTION));
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("regenerate: {}: no bindings can be made: {error}", headers.display());
            ExitCode::FAILURE
        }
    }
}
