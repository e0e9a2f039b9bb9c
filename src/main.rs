//! foveate: see `foveate --help`.
fn main() {}
