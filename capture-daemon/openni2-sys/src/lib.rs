//! OpenNI2's C interface: types, constants, and [`OpenNi2`], the table of its functions in a library that is opened at
//! run time, so that the programs build and start where there is none.
//!
//! Nothing here is safe to call; `capture_daemon::source::openni2` has the handles that are.

#[rustfmt::skip]
mod sys;

pub use sys::*;

/// Why the library cannot be opened.
pub type LoadError = libloading::Error;
