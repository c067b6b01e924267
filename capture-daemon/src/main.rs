//! `sward-capture`.

fn main() {}
