//! What is done already: one file for each part of a measurement, written whole, in a folder whose name
//! stands for everything that the parts depend on. A run that was interrupted goes on from there.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};
use crate::metrics::Picture;
use crate::whole_file;

/// Files of one measurement.
pub struct Store {
    folder: PathBuf,
}

impl Store {
    /// Opens the folder `parts/<key>` below `out`, and makes it where it is not there.
    pub fn open(out: &Path, key: &str) -> Result<Store> {
        let folder = out.join("parts").join(key);
        std::fs::create_dir_all(&folder).map_err(|e| Error::writing(&folder, &e))?;
        Ok(Store { folder })
    }

    /// The file of a part.
    pub fn path(&self, name: &str, ending: &str) -> PathBuf {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '.' || c == '-' { c } else { '_' };
        self.folder.join(format!("{}.{ending}", name.chars().map(plain).collect::<String>()))
    }

    /// The file of a frame of a sequence, the first being 0, in a folder of its own: what other programs compare.
    ///
    /// # Errors
    /// [`Error::File`] where the folder cannot be made.
    pub fn frame(&self, name: &str, motion: &str, frame: usize) -> Result<PathBuf> {
        let folder = self.path(&format!("sequence {name} {motion}"), "frames");
        std::fs::create_dir_all(&folder).map_err(|e| Error::writing(&folder, &e))?;
        Ok(folder.join(format!("frame_{frame:04}.png")))
    }

    /// A part that was written; none where it is missing or not readable: then it is made anew.
    pub fn read<T: DeserializeOwned>(&self, name: &str) -> Option<T> {
        let bytes = self.bytes(name, "json")?;
        serde_json::from_slice(&bytes).ok()
    }

    /// The bytes of a part's file.
    pub fn bytes(&self, name: &str, ending: &str) -> Option<Vec<u8>> {
        std::fs::read(self.path(name, ending)).ok()
    }

    /// Writes a part.
    pub fn write(&self, name: &str, part: &impl Serialize) -> Result<()> {
        let path = self.path(name, "json");
        let bytes = serde_json::to_vec(part).map_err(|e| Error::writing(&path, &e.into()))?;
        write_bytes(&path, &bytes)
    }

    /// Writes bytes under a part's name.
    pub fn write_bytes(&self, name: &str, ending: &str, bytes: &[u8]) -> Result<()> {
        write_bytes(&self.path(name, ending), bytes)
    }

    /// Writes a linear picture.
    pub fn write_picture(&self, name: &str, picture: &Picture) -> Result<()> {
        picture.write_exr(&self.path(name, "exr"))
    }
}

/// Tells whether a measurement's files can be written to `out`: what is there under their names may be those of an
/// earlier one alone.
///
/// # Errors
/// [`Error::File`] where another kind of file has one of their names, or it cannot be written.
pub fn check_reports(out: &Path) -> Result<()> {
    const BEGINNINGS: [(&str, &[u8]); 6] = [
        ("report.json", b"{\n  \"scene\":"),
        ("points.csv", b"name,axis,"),
        ("sequences.csv", b"name,motion,"),
        ("front.toml", b"# The Pareto front of "),
        ("comparison.md", b"| scene | method |"),
        ("report.html", b"<!doctype html>"),
    ];
    if !out.exists() {
        return Ok(());
    }
    BEGINNINGS.into_iter().try_for_each(|(name, beginning)| {
        whole_file::check_kind(&out.join(name), beginning, "report of a measurement")
    })
}

/// Writes a file whole or not at all.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    whole_file::write(path, |file| file.write_all(bytes).map_err(|e| Error::writing(path, &e)))
}

/// A name for content: FNV-1a of 64 bits (Fowler, Noll and Vo), in hexadecimal digits.
#[derive(Clone, Copy)]
pub struct Fingerprint(u64);

impl Default for Fingerprint {
    fn default() -> Self {
        Fingerprint(0xcbf2_9ce4_8422_2325)
    }
}

impl Fingerprint {
    /// Takes bytes in.
    pub fn add(mut self, bytes: &[u8]) -> Self {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
        self
    }

    /// The name.
    pub fn name(self) -> String {
        format!("{:016x}", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_found_again_and_damaged_ones_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), "key").unwrap();
        assert_eq!(store.read::<Vec<u32>>("a part, 1/2"), None);
        store.write("a part, 1/2", &vec![1u32, 2]).unwrap();
        let again = Store::open(folder.path(), "key").unwrap();
        assert_eq!(again.read::<Vec<u32>>("a part, 1/2"), Some(vec![1, 2]));
        std::fs::write(again.path("a part, 1/2", "json"), "[1,").unwrap();
        assert_eq!(again.read::<Vec<u32>>("a part, 1/2"), None);
        assert_eq!(Store::open(folder.path(), "other").unwrap().read::<Vec<u32>>("a part, 1/2"), None);
    }

    #[test]
    fn fingerprints_are_fnv() {
        assert_eq!(Fingerprint::default().add(b"foobar").name(), "85944171f73967e8");
    }
}
