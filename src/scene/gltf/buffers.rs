//! The document's buffers in memory, each file read once, and views of them.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::PathBuf;

use rayon::prelude::*;

use super::Outcome;
use super::json::Document;
use crate::scene::budget::Budget;
use crate::scene::source::{Folder, read_file};

/// Every buffer's bytes.
pub struct Buffers<'a> {
    /// What was read, each file once.
    data: Vec<Cow<'a, [u8]>>,
    /// Which of `data` each buffer is; `None` for one that has no URI and is not the binary chunk, which may
    /// be there for an extension that we do not use.
    of_buffer: Vec<Option<usize>>,
    /// What compressed views stand for.
    views: HashMap<usize, Vec<u8>>,
    /// What accessors of compressed primitives stand for.
    accessors: HashMap<usize, Vec<u8>>,
}

/// Where a buffer's bytes are.
#[derive(Clone, PartialEq, Eq, Hash)]
enum Place {
    Chunk,
    File(PathBuf),
    Data(usize),
}

/// Something to read, and how much of it.
struct Read {
    place: Place,
    length: u64,
    /// A buffer that is read from there.
    buffer: usize,
}

impl<'a> Buffers<'a> {
    /// Reads all buffers; `bin` is the `.glb` file's binary chunk.
    pub fn load(
        document: &Document,
        bin: Option<&'a [u8]>,
        folder: &Folder,
        budget: &Budget,
    ) -> Outcome<Self> {
        let (reads, of_buffer) = reads(document, bin.is_some(), folder)?;
        budget.plan_bytes(reads.iter().map(|read| read.own_bytes(document)).sum())?;
        let read = |read: &Read| -> Outcome<Cow<'a, [u8]>> {
            let bytes = match &read.place {
                Place::Chunk => Ok(Cow::Borrowed(bin.unwrap_or_default())),
                Place::File(path) => {
                    read_file(path, read.length).map(Cow::Owned).map_err(|error| error.to_string())
                }
                Place::Data(index) => {
                    let uri = document.buffers[*index].uri.as_deref().unwrap_or_default();
                    folder.read(uri, read.length).map(Cow::Owned)
                }
            };
            bytes.map_err(|problem| unusable(read.buffer, &problem))
        };
        let data: Vec<Cow<'a, [u8]>> = reads.par_iter().map(read).collect::<Outcome<_>>()?;
        for (index, (buffer, number)) in document.buffers.iter().zip(&of_buffer).enumerate() {
            let there = number.map(|number| data[number].len());
            if let Some(there) = there.filter(|&there| there < buffer.byte_length.0) {
                return Err(format!(
                    "buffer {index} should have {} bytes but has {there}; copy or export it again",
                    buffer.byte_length.0
                ));
            }
        }
        Ok(Buffers { data, of_buffer, views: HashMap::new(), accessors: HashMap::new() })
    }

    /// Takes what compressed views stand for.
    pub fn take_views(&mut self, views: HashMap<usize, Vec<u8>>) {
        self.views = views;
    }

    /// Takes what accessors of compressed primitives stand for, packed tightly.
    pub fn take_accessors(&mut self, accessors: HashMap<usize, Vec<u8>>) {
        self.accessors = accessors;
    }

    /// The elements of an accessor whose primitive was compressed.
    pub fn accessor(&self, index: usize) -> Option<&[u8]> {
        self.accessors.get(&index).map(Vec::as_slice)
    }

    /// The bytes of a buffer view. Its index and its buffer's are in range ([`super::check`]).
    pub fn view(&self, document: &Document, index: usize) -> Outcome<&[u8]> {
        if let Some(bytes) = self.views.get(&index) {
            return Ok(bytes);
        }
        let view = &document.buffer_views[index];
        let what = format!("bufferView {index}");
        self.bytes(document, view.buffer.0, view.byte_offset.0, view.byte_length.0, &what)
    }

    /// So many bytes of a buffer; `what` wants them.
    pub fn bytes(
        &self,
        document: &Document,
        buffer: usize,
        offset: usize,
        length: usize,
        what: &str,
    ) -> Outcome<&[u8]> {
        let bytes = self.of_buffer[buffer].map(|number| &*self.data[number]).ok_or_else(|| {
            format!("buffer {buffer} has neither a URI nor a binary chunk; export the scene again")
        })?;
        let declared = document.buffers[buffer].byte_length.0;
        let end = offset.checked_add(length).filter(|&end| end <= declared.min(bytes.len()));
        end.map(|end| &bytes[offset..end]).ok_or_else(|| {
            format!("{what} reaches beyond the end of buffer {buffer}; export the scene again")
        })
    }
}

impl Read {
    /// Bytes that reading it takes beside those of the scene's main file.
    fn own_bytes(&self, document: &Document) -> u64 {
        match &self.place {
            Place::Chunk => 0,
            // What is not there is not taken, whatever the scene claims.
            Place::File(path) => std::fs::metadata(path).map_or(0, |m| m.len()).min(self.length),
            Place::Data(index) => {
                let uri = document.buffers[*index].uri.as_ref();
                uri.map_or(0, |uri| uri.len() as u64).min(self.length)
            }
        }
    }
}

fn unusable(index: usize, problem: &str) -> String {
    format!("buffer {index} is not usable: {problem}")
}

/// What to read, each place once, and which of these each buffer is.
fn reads(document: &Document, has_chunk: bool, folder: &Folder) -> Outcome<(Vec<Read>, Vec<Option<usize>>)> {
    let (mut reads, mut of_buffer) = (Vec::<Read>::new(), Vec::new());
    let mut known = HashMap::new();
    for (index, buffer) in document.buffers.iter().enumerate() {
        let place = match &buffer.uri {
            Some(uri) if Folder::is_embedded(uri) => Place::Data(index),
            Some(uri) => Place::File(folder.find(uri).map_err(|problem| unusable(index, &problem))?),
            None if index == 0 && has_chunk => Place::Chunk,
            None => {
                of_buffer.push(None);
                continue;
            }
        };
        let length = buffer.byte_length.0 as u64;
        let number = *known.entry(place.clone()).or_insert_with(|| {
            reads.push(Read { place, length, buffer: index });
            reads.len() - 1
        });
        reads[number].length = reads[number].length.max(length);
        of_buffer.push(Some(number));
    }
    Ok((reads, of_buffer))
}
