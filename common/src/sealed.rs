//! The sealed memfd: how bytes cross a process border in Sward. Written with `pwrite`, sealed
//! against every change, mapped read-only. The only unsafe code of this crate.
//!
//! Since nothing can write, grow or shrink the file once it is sealed, a mapping of it is plain
//! immutable memory: no lock, no torn read, no SIGBUS.

#![allow(unsafe_code, reason = "mapping a file is unsafe; the seals make it sound")]

use std::fs::File;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::FileExt;

use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, fcntl_get_seals, memfd_create};

const SEALS: SealFlags =
    SealFlags::SEAL.union(SealFlags::SHRINK).union(SealFlags::GROW).union(SealFlags::WRITE);

/// Why a sealed memfd cannot be made or mapped.
#[derive(Debug, thiserror::Error)]
pub enum SealedError {
    /// The system refused.
    #[error("cannot {action} shared memory: {source}")]
    Io {
        /// What was tried.
        action: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// The file that was received can still be changed by its sender.
    #[error("the shared memory received is not sealed (seals {found:#x}, expected {expected:#x})", expected = SEALS.bits())]
    NotSealed {
        /// The seals it has.
        found: u32,
    },
    /// Larger than the receiver accepts.
    #[error("the shared memory received has {found} bytes; at most {limit} are accepted")]
    TooLarge {
        /// Its bytes.
        found: u64,
        /// The receiver's limit.
        limit: u64,
    },
}

fn io_error(action: &'static str) -> impl Fn(io::Error) -> SealedError {
    move |source| SealedError::Io { action, source }
}

/// Puts `bytes` into a new memfd and seals it against shrinking, growing, writing and unsealing.
///
/// # Errors
/// When the system has no memory or no file descriptor left.
pub fn seal(name: &str, bytes: &[u8]) -> Result<OwnedFd, SealedError> {
    let fd = memfd_create(name, MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING)
        .map_err(|error| io_error("create")(error.into()))?;
    let file = File::from(fd);
    file.set_len(bytes.len() as u64).map_err(io_error("size"))?;
    file.write_all_at(bytes, 0).map_err(io_error("write"))?;
    fcntl_add_seals(&file, SEALS).map_err(|error| io_error("seal")(error.into()))?;
    Ok(file.into())
}

/// Bytes of a sealed memfd, mapped read-only.
#[derive(Debug)]
pub struct SealedBytes(Option<memmap2::Mmap>);

impl SealedBytes {
    /// Maps a sealed memfd of at most `limit` bytes.
    ///
    /// # Errors
    /// When it lacks a seal, is too large, or cannot be mapped.
    pub fn map(fd: impl AsFd, limit: u64) -> Result<Self, SealedError> {
        let seals = fcntl_get_seals(&fd).map_err(|error| io_error("check the seals of")(error.into()))?;
        if !seals.contains(SEALS) {
            return Err(SealedError::NotSealed { found: seals.bits() });
        }
        let file = File::from(fd.as_fd().try_clone_to_owned().map_err(io_error("hold"))?);
        let found = file.metadata().map_err(io_error("measure"))?.len();
        if found > limit {
            return Err(SealedError::TooLarge { found, limit });
        }
        if found == 0 {
            return Ok(Self(None));
        }
        // SAFETY: the seals checked above forbid writing, shrinking and growing for ever, so the
        // mapped bytes cannot change and every page of them stays there.
        let map = unsafe { memmap2::Mmap::map(&file) }.map_err(io_error("map"))?;
        Ok(Self(Some(map)))
    }
}

impl AsRef<[u8]> for SealedBytes {
    fn as_ref(&self) -> &[u8] {
        self.0.as_deref().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sealed_bytes_come_back_and_cannot_be_altered() {
        let fd = seal("test", b"meadow").expect("memfd");
        let file = File::from(fd.try_clone().expect("dup"));
        let denied = Some(rustix::io::Errno::PERM.raw_os_error());
        assert_eq!(file.write_all_at(b"x", 0).map_err(|e| e.raw_os_error()), Err(denied));
        assert_eq!(file.set_len(0).map_err(|e| e.raw_os_error()), Err(denied));
        assert_eq!(file.set_len(100).map_err(|e| e.raw_os_error()), Err(denied));
        assert!(fcntl_add_seals(&file, SealFlags::SEAL).is_err());
        // SAFETY: the mapping is expected to fail, and is dropped at once if it does not.
        assert!(unsafe { memmap2::MmapMut::map_mut(&file) }.is_err(), "no writable mapping");
        let bytes = SealedBytes::map(&fd, 100).expect("sealed");
        assert_eq!(bytes.as_ref(), b"meadow");
    }

    #[test]
    fn what_can_still_change_is_refused() {
        let fd = memfd_create("open", MemfdFlags::ALLOW_SEALING).expect("memfd");
        assert!(matches!(SealedBytes::map(&fd, 100), Err(SealedError::NotSealed { .. })));
        let regular = tempfile_without_seals();
        assert!(SealedBytes::map(&regular, 100).is_err(), "a regular file has no seals");
        let large = seal("large", &[0; 101]).expect("memfd");
        assert!(matches!(SealedBytes::map(&large, 100), Err(SealedError::TooLarge { found: 101, .. })));
    }

    fn tempfile_without_seals() -> File {
        File::open(std::env::current_exe().expect("a test has a path")).expect("it is readable")
    }
}
