//! The meadow.
