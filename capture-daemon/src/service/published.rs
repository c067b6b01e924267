//! A library that is offered: sealed, never changed again.

use std::io;
use std::os::fd::OwnedFd;

use common::blade::Blade;
use common::library::{LibraryError, encode};
use common::sealed::{SealedError, seal};

/// A library that is offered: sealed, never changed again.
#[derive(Debug)]
pub(crate) struct Published {
    generation: u64,
    blades: usize,
    size: usize,
    memfd: OwnedFd,
}

/// Why a library cannot be published.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PublishError {
    /// It cannot be written as bytes.
    #[error(transparent)]
    Library(#[from] LibraryError),
    /// There is no shared memory for it.
    #[error(transparent)]
    Sealed(#[from] SealedError),
}

impl Published {
    /// Seals `blades` as one generation.
    ///
    /// # Errors
    /// Too many blades, or no memory or descriptor left.
    pub(crate) fn new(generation: u64, blades: &[Blade]) -> Result<Self, PublishError> {
        let bytes = encode(generation, blades)?;
        let memfd = seal("sward-library", &bytes)?;
        Ok(Self { generation, blades: blades.len(), size: bytes.len(), memfd })
    }

    /// Its generation.
    pub(crate) fn generation(&self) -> u64 {
        self.generation
    }

    /// Number of its blades.
    pub(crate) fn blades(&self) -> usize {
        self.blades
    }

    /// Its bytes.
    pub(crate) fn size(&self) -> usize {
        self.size
    }

    /// A descriptor of it for a client.
    ///
    /// # Errors
    /// When none is left.
    pub(crate) fn descriptor(&self) -> io::Result<OwnedFd> {
        self.memfd.try_clone()
    }
}
