//! A cpio archive in the kernel's format for its first files ("newc").

use std::collections::BTreeSet;

/// An archive in the making.
#[derive(Default)]
pub struct Archive {
    bytes: Vec<u8>,
    there: BTreeSet<String>,
}

impl Archive {
    pub fn folder(&mut self, path: &str) {
        self.parents(path);
        self.entry(path, 0o040_755, &[]);
    }

    pub fn file(&mut self, path: &str, data: &[u8]) {
        self.parents(path);
        self.entry(path, 0o100_644, data);
    }

    pub fn program(&mut self, path: &str, data: &[u8]) {
        self.parents(path);
        self.entry(path, 0o100_755, data);
    }

    pub fn finish(mut self) -> Vec<u8> {
        self.entry("TRAILER!!!", 0, &[]);
        self.bytes
    }

    fn parents(&mut self, path: &str) {
        for (end, _) in path.match_indices('/') {
            self.entry(&path[..end], 0o040_755, &[]);
        }
    }

    /// Writes an entry that is not there yet.
    fn entry(&mut self, path: &str, mode: u32, data: &[u8]) {
        if !self.there.insert(path.to_string()) {
            return;
        }
        // Number, mode, user, group, links, time, size, devices, length of the name, checksum.
        let number = self.there.len() as u32;
        let fields = [number, mode, 0, 0, 1, 0, data.len() as u32, 0, 0, 0, 0, path.len() as u32 + 1, 0];
        self.bytes.extend(b"070701");
        fields.iter().for_each(|field| self.bytes.extend(format!("{field:08x}").bytes()));
        self.bytes.extend(path.bytes());
        self.bytes.push(0);
        self.pad();
        self.bytes.extend(data);
        self.pad();
    }

    fn pad(&mut self) {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }
}
