//! One fuzz target for each entry: the binary's name says which.
#![no_main]

#[path = "../tests/corpus/entries.rs"]
mod entries;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let (_, entry) = entries::ENTRIES
        .iter()
        .find(|(name, _)| *name == env!("CARGO_BIN_NAME"))
        .expect("each target is an entry");
    entry(bytes);
});
