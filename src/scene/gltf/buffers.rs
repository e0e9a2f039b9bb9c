//! The document's buffers in memory, and views of them.

use std::borrow::Cow;

use rayon::prelude::*;

use super::Outcome;
use super::json::Document;
use super::source::Folder;

/// Every buffer's bytes; `None` for one that has no URI and is not the binary chunk, which may be
/// there for an extension that we do not use.
pub struct Buffers<'a> {
    data: Vec<Option<Cow<'a, [u8]>>>,
}

impl<'a> Buffers<'a> {
    /// Reads all buffers; `bin` is the `.glb` file's binary chunk.
    pub fn load(document: &Document, bin: Option<&'a [u8]>, folder: &Folder) -> Outcome<Self> {
        let data = document
            .buffers
            .par_iter()
            .enumerate()
            .map(|(index, buffer)| {
                let length = buffer.byte_length.0;
                let bytes: Cow<'a, [u8]> = match (&buffer.uri, bin) {
                    (Some(uri), _) => folder.read(uri, length as u64, &format!("buffer {index}"))?.into(),
                    (None, Some(bin)) if index == 0 => bin.into(),
                    (None, _) => return Ok(None),
                };
                if bytes.len() < length {
                    return Err(format!(
                        "buffer {index} should have {length} bytes but has {}; copy or export it again",
                        bytes.len()
                    ));
                }
                Ok(Some(bytes))
            })
            .collect::<Outcome<_>>()?;
        Ok(Buffers { data })
    }

    /// The bytes of a buffer view. Its index and its buffer's are in range ([`super::check`]).
    pub fn view(&self, document: &Document, index: usize) -> Outcome<&[u8]> {
        let view = &document.buffer_views[index];
        let buffer = view.buffer.0;
        let bytes = self.data[buffer].as_deref().ok_or_else(|| {
            format!("buffer {buffer} has neither a URI nor a binary chunk; export the scene again")
        })?;
        let declared = document.buffers[buffer].byte_length.0;
        let end = view
            .byte_offset
            .0
            .checked_add(view.byte_length.0)
            .filter(|&end| end <= declared.min(bytes.len()));
        match end {
            Some(end) => Ok(&bytes[view.byte_offset.0..end]),
            None => Err(format!(
                "bufferView {index} reaches beyond the end of buffer {buffer}; export the scene again"
            )),
        }
    }
}
