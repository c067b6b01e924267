//! What both programs of Sward link, and nothing more: what a blade is, the library's bytes and how
//! they cross a process border, one strand's dynamics, and the refinement that both sides use.
//!
//! Invariant: no async runtime and no GPU here (`tests/tests/house.rs` holds the crate to it).

pub mod blade;
pub mod geometry;
mod head;
pub mod library;
#[cfg(feature = "manual")]
pub mod manual;
pub mod preview;
pub mod protocol;
pub mod refine;
pub mod sealed;
pub mod sentence;
pub mod station;
pub mod strand;

pub use head::HeadError;
