//! Scenes made by our own code, as binary glTF files in memory. The same arguments always make the same
//! bytes.

pub mod demo;
pub mod glb;
#[cfg(test)]
mod glb_reader;
pub mod material;
pub mod obj;
pub mod organic;
pub mod paint;
pub mod shapes;
pub mod voxel_town;

use std::io::Write;
use std::path::Path;

use crate::error::{Error, Result};
use crate::whole_file;

/// Writes a generated file, whole or not at all; the error names `path`.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    whole_file::write(path, |file| file.write_all(bytes).map_err(|e| Error::writing(path, &e)))
}

/// Mixes numbers into 64 bits that look random (the finaliser of SplitMix64 after each).
pub(crate) fn hash(numbers: &[u64]) -> u64 {
    numbers.iter().fold(0x9e37_79b9_7f4a_7c15, |state, &n| {
        let mut z = (state ^ n).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    })
}

/// A sequence of random numbers that a seed fixes.
pub(crate) struct Random {
    seed: u64,
    drawn: u64,
}

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Random { seed, drawn: 0 }
    }

    /// Uniform in 0..1.
    pub(crate) fn unit(&mut self) -> f32 {
        self.drawn += 1;
        (hash(&[self.seed, self.drawn]) >> 40) as f32 / 16_777_216.0
    }

    /// Uniform in `low..high`.
    pub(crate) fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }
}
