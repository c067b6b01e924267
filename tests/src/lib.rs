//! What the cross-crate tests share: where the programs are and how to run them.
