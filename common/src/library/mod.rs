//! The blade library as bytes: one contiguous snapshot, written once, sealed, mapped read-only and
//! validated by whoever receives it.

pub mod layout;
pub mod snapshot;

pub use layout::{LibraryError, encode, library_hash};
pub use snapshot::{BladeView, Snapshot, SnapshotError};
