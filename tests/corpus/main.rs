//! Saved inputs of the fuzz targets (`fuzz/corpus`), and small changes of them, through everything that reads bytes of
//! others: `make fuzz` looks for more.

mod entries;
mod seeds;

use std::path::{Path, PathBuf};

use entries::{ENTRIES, Entry};
use foveate::reference::Random;

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(name)
}

/// The saved inputs of an entry with their names, in order.
fn saved(name: &str) -> Vec<(String, Vec<u8>)> {
    let files = std::fs::read_dir(folder(name)).unwrap_or_else(|error| panic!("fuzz/corpus/{name}: {error}"));
    let mut inputs: Vec<_> = files
        .map(|file| {
            let file = file.unwrap();
            (file.file_name().to_string_lossy().into_owned(), std::fs::read(file.path()).unwrap())
        })
        .collect();
    inputs.sort();
    inputs
}

fn below(random: &mut Random, count: usize) -> usize {
    (random.uniform() * count as f64) as usize % count.max(1)
}

/// Changes bytes, cuts, or repeats a part.
fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..=below(random, 4) {
        let at = below(random, bytes.len());
        match below(random, 8) {
            _ if bytes.is_empty() => bytes.push(0),
            0 => bytes.truncate(at),
            1 => bytes.extend_from_within(at..bytes.len().min(at + 32)),
            2 => bytes[at] = 0xFF,
            3 => bytes[at] ^= 1 << below(random, 8),
            _ => bytes[at] = below(random, 256) as u8,
        }
    }
}

/// Feeds an entry with its saved inputs and so many changes of each; returns how many inputs that were.
fn feed(name: &str, entry: Entry, changes: usize) -> usize {
    let inputs = saved(name);
    let mut random = Random::new(7);
    for (file, bytes) in &inputs {
        let taken = entry(bytes);
        // Seeds say by their names whether they are what they claim.
        assert!(!file.starts_with("good") || taken, "{name}/{file} is refused");
        assert!(!file.starts_with("bad") || !taken, "{name}/{file} is taken");
        for _ in 0..changes {
            let mut bytes = bytes.clone();
            damage(&mut bytes, &mut random);
            entry(&bytes);
        }
    }
    assert!(inputs.iter().any(|(file, _)| file.starts_with("good")), "{name} has no good seed");
    inputs.len() * (changes + 1)
}

#[test]
fn saved_inputs_and_their_neighbours_do_no_harm() {
    for (name, entry) in ENTRIES {
        let start = std::time::Instant::now();
        let fed = feed(name, entry, if name == "tree" { 20 } else { 60 });
        println!("{name}: {fed} inputs in {:.1} s", start.elapsed().as_secs_f64());
    }
}

/// The same with many more changes of each input, for machines without what `make fuzz` needs.
#[test]
#[ignore = "takes long"]
fn long_way_from_saved_inputs() {
    for (name, entry) in ENTRIES {
        let start = std::time::Instant::now();
        let fed = feed(name, entry, if name == "tree" { 200 } else { 5000 });
        println!("{name}: {fed} inputs in {:.1} s", start.elapsed().as_secs_f64());
    }
}

/// Each entry is a target of `fuzz/`, and has a folder of seeds; nothing else has.
#[test]
fn every_entry_is_a_fuzz_target() {
    let manifest = std::fs::read_to_string(folder("").join("../Cargo.toml")).unwrap();
    let targets = manifest.matches("[[bin]]").count();
    assert_eq!(targets, ENTRIES.len());
    let mut folders: Vec<_> =
        std::fs::read_dir(folder("")).unwrap().map(|f| f.unwrap().file_name()).collect();
    folders.sort();
    let mut names = ENTRIES.map(|(name, _)| name);
    names.sort_unstable();
    assert_eq!(folders, names);
    for name in names {
        assert!(manifest.contains(&format!("name = \"{name}\"")), "{name}");
    }
}

/// `cargo test --test corpus write_seeds -- --ignored` makes the good and bad seeds anew.
#[test]
#[ignore = "writes fuzz/corpus"]
fn write_seeds() {
    for (name, file, bytes) in seeds::all() {
        std::fs::create_dir_all(folder(name)).unwrap();
        std::fs::write(folder(name).join(file), bytes).unwrap();
    }
}
