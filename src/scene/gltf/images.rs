//! The images that the materials need, decoded in parallel.

use std::collections::HashMap;

use rayon::prelude::*;

use super::Outcome;
use super::buffers::Buffers;
use super::json::Document;
use super::source::Folder;
use crate::scene::texture::Image;

/// Texels that a scene's images may have together: 2 GiB, before mip levels.
const MAX_TEXELS: u64 = 1 << 29;

/// A file that is larger than this is no texture.
const MAX_FILE: u64 = 1 << 30;

/// An image with the range of each channel.
pub struct Decoded {
    /// The texels.
    pub image: Image,
    /// Least value of each channel.
    pub low: [u8; 4],
    /// Greatest value of each channel.
    pub high: [u8; 4],
}

/// Decodes the images of `wanted`, by index.
pub fn load(
    document: &Document,
    buffers: &Buffers<'_>,
    folder: &Folder,
    wanted: &[usize],
) -> Outcome<HashMap<usize, Decoded>> {
    let problem = |index: usize, problem: String| {
        format!("image {index} is not usable: {problem}; convert or export it again")
    };
    let files: Vec<(usize, Vec<u8>, u64)> = wanted
        .par_iter()
        .map(|&index| {
            let bytes = bytes_of(document, buffers, folder, index)?;
            let (width, height) = Image::size_of(&bytes).map_err(|error| problem(index, error))?;
            Ok((index, bytes, u64::from(width) * u64::from(height)))
        })
        .collect::<Outcome<_>>()?;
    let texels: u64 = files.iter().map(|file| file.2).sum();
    if texels > MAX_TEXELS {
        return Err(format!(
            "its images have {texels} texels together, but at most {MAX_TEXELS} are supported; scale them down"
        ));
    }
    files
        .into_par_iter()
        .map(|(index, bytes, _)| {
            let image = Image::decode(&bytes).map_err(|error| problem(index, error))?;
            let (low, high) = image.range();
            Ok((index, Decoded { image, low, high }))
        })
        .collect()
}

fn bytes_of(document: &Document, buffers: &Buffers<'_>, folder: &Folder, index: usize) -> Outcome<Vec<u8>> {
    let image = &document.images[index];
    match (&image.uri, image.buffer_view) {
        (_, Some(view)) => Ok(buffers.view(document, view.0)?.to_vec()),
        (Some(uri), None) => folder.read(uri, MAX_FILE, &format!("image {index}")),
        (None, None) => {
            Err(format!("image {index} has neither a URI nor a bufferView; export the scene again"))
        }
    }
}
