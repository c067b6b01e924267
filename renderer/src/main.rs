//! `sward-render`.

fn main() {}
