//! The head of a block of bytes that another process made: what every one of ours begins with, and the numbers in
//! it.

/// What the bytes of one kind begin with.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Head {
    /// Of what it is the head, with its article.
    pub(crate) of: &'static str,
    /// The first bytes.
    pub(crate) magic: [u8; 8],
    /// Where the version of the layout stands, a `u32`, and which it is.
    pub(crate) version: (usize, u32),
    /// Where the size of the header stands, a `u32`, and what it is, bytes.
    pub(crate) size: (usize, usize),
}

/// Why some bytes have not the head that they should have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HeadError {
    /// Shorter than the header.
    #[error("{found} bytes; {of} has at least {expected}")]
    TooShort {
        /// Of what it is the head.
        of: &'static str,
        /// Bytes there.
        found: usize,
        /// Bytes of the header.
        expected: usize,
    },
    /// The first bytes are not the magic.
    #[error("the first 8 bytes are {found:02x?}, expected \"{}\"", String::from_utf8_lossy(expected))]
    Magic {
        /// What they are.
        found: [u8; 8],
        /// What they should be.
        expected: [u8; 8],
    },
    /// A layout version of another time.
    #[error("layout version {found}, expected {expected}")]
    Version {
        /// By the header.
        found: u32,
        /// The only one that is read.
        expected: u32,
    },
    /// Another size of the header.
    #[error("header size {found}, expected {expected}")]
    HeaderSize {
        /// By the header.
        found: u32,
        /// As it is.
        expected: usize,
    },
}

impl Head {
    /// Whether `bytes` begin so.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub(crate) fn check(&self, bytes: &[u8]) -> Result<(), HeadError> {
        let Self { of, magic, version: (version_at, version), size: (size_at, size) } = *self;
        if bytes.len() < size {
            return Err(HeadError::TooShort { of, found: bytes.len(), expected: size });
        }
        let found = array(bytes, 0);
        if found != magic {
            return Err(HeadError::Magic { found, expected: magic });
        }
        let found = u32_at(bytes, version_at);
        if found != version {
            return Err(HeadError::Version { found, expected: version });
        }
        let found = u32_at(bytes, size_at);
        if found as usize != size {
            return Err(HeadError::HeaderSize { found, expected: size });
        }
        Ok(())
    }
}

/// `N` bytes from `at` on, which must be there.
pub(crate) fn array<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    bytes[at..at + N].try_into().expect("a slice of N bytes")
}

/// The number at `at`, which must be there.
pub(crate) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(array(bytes, at))
}

/// The number at `at`, which must be there.
pub(crate) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(array(bytes, at))
}

/// The number at `at`, which must be there.
pub(crate) fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(array(bytes, at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_with_a_head_is_said() {
        let head = Head { of: "a lawn", magic: *b"GREENSWD", version: (8, 2), size: (12, 16) };
        let bytes = *b"GREENSWD\x02\0\0\0\x10\0\0\0";
        assert_eq!(head.check(&bytes), Ok(()));
        let wrong = |at: usize, byte: u8| {
            let mut bytes = bytes;
            bytes[at] = byte;
            head.check(&bytes).expect_err("it is wrong").to_string()
        };
        assert_eq!(
            head.check(&bytes[..15]).expect_err("short").to_string(),
            "15 bytes; a lawn has at least 16"
        );
        assert!(wrong(0, b'b').ends_with("expected \"GREENSWD\""), "{}", wrong(0, b'b'));
        assert_eq!(wrong(8, 3), "layout version 3, expected 2");
        assert_eq!(wrong(12, 17), "header size 17, expected 16");
    }
}
