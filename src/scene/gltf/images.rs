//! The images that the materials need, each decoded once, in parallel. One that is not usable is told, and
//! something visible stands in for it.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

use rayon::prelude::*;

use super::Outcome;
use super::buffers::Buffers;
use super::json::Document;
use super::made;
use crate::scene::budget::Budget;
use crate::scene::source::{Folder, read_file, shorten};
use crate::scene::texture::Image;

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
    /// Shown in place of an image that is not usable.
    pub stand_in: bool,
}

/// Where an image's bytes are; images of one place are the same image.
#[derive(Clone, PartialEq, Eq, Hash)]
enum Place {
    View(usize),
    File(PathBuf),
    Data(usize),
    Made(Made),
}

/// An image that is put together from files ([`super::json::MadeImage`]).
#[derive(Clone, PartialEq, Eq, Hash)]
struct Made {
    color: Option<PathBuf>,
    alpha: Option<PathBuf>,
    height: Option<u64>,
}

/// Images by the document's indices; those of one place are one.
pub type ByIndex = HashMap<usize, Arc<Decoded>>;

/// Looks images up.
pub struct Images<'a> {
    /// The document that names them.
    pub document: &'a Document,
    /// Its buffers.
    pub buffers: &'a Buffers<'a>,
    /// Where its files are.
    pub folder: &'a Folder,
}

impl Images<'_> {
    /// Decodes the images of `wanted`, by index; several of the same place share one decoded image. Tells
    /// which were not usable, and why.
    ///
    /// # Errors
    /// Where they do not fit into `budget`.
    pub fn load(&self, wanted: &[usize], budget: &Budget) -> Outcome<(ByIndex, Vec<String>)> {
        let places: Vec<Outcome<Place>> = wanted.iter().map(|&index| self.place(index)).collect();
        let mut distinct: Vec<&Place> = Vec::new();
        let mut numbers = HashMap::new();
        for place in places.iter().flatten() {
            numbers.entry(place).or_insert_with(|| {
                distinct.push(place);
                distinct.len() - 1
            });
        }
        // Files are read twice, for the size and for the texels, so that not all are held at once.
        let sizes: Vec<Outcome<u64>> = distinct.par_iter().map(|place| self.texels_of(place)).collect();
        let texels: Vec<u64> = sizes.iter().map(|size| *size.as_ref().unwrap_or(&0)).collect();
        let halvings = budget.plan_textures(&texels)?;
        let decode = |i: usize| {
            let decoded = sizes[i].clone().and_then(|_| self.decode(distinct[i], halvings[i]));
            decoded.map(Arc::new)
        };
        let scaled = halvings.iter().filter(|&&halvings| halvings > 0).count();
        // Where memory is scarce, only one at a time is there in its full size.
        let decoded: Vec<Outcome<Arc<Decoded>>> = match scaled {
            0 => (0..distinct.len()).into_par_iter().map(decode).collect(),
            _ => (0..distinct.len()).map(decode).collect(),
        };

        let (mut images, mut warnings) = (HashMap::new(), Vec::new());
        if scaled > 0 {
            let most = 1 << halvings.iter().max().unwrap_or(&0);
            warnings.push(format!(
                "{scaled} textures were scaled down, by up to {most} in width and height, to fit into memory"
            ));
        }
        let stand_in = Arc::new(Decoded::stand_in());
        for (&index, place) in wanted.iter().zip(&places) {
            let found = place.as_ref().map_err(Clone::clone).and_then(|p| decoded[numbers[p]].clone());
            images.insert(
                index,
                found.unwrap_or_else(|problem| {
                    warnings.push(format!(
                        "{} is not usable: {problem}; a checkerboard stands in for its colours",
                        self.name(index)
                    ));
                    stand_in.clone()
                }),
            );
        }
        Ok((images, warnings))
    }

    fn place(&self, index: usize) -> Outcome<Place> {
        let image = &self.document.images[index];
        if let Some(made) = &image.made {
            let color = (!made.white).then(|| self.find(&made.file)).transpose()?;
            let alpha = made.alpha.as_ref().map(|alpha| self.find(alpha)).transpose()?;
            return Ok(Place::Made(Made { color, alpha, height: made.height }));
        }
        match (&image.uri, image.buffer_view) {
            (_, Some(view)) => Ok(Place::View(view.0)),
            (Some(uri), None) if Folder::is_embedded(uri) => Ok(Place::Data(index)),
            (Some(uri), None) => Ok(Place::File(self.folder.find(uri)?)),
            (None, None) => Err("it has neither a URI nor a bufferView".into()),
        }
    }

    /// A file by a name that may have been made elsewhere: as it is, else beside the scene.
    fn find(&self, name: &str) -> Outcome<PathBuf> {
        let base = name.rsplit(['/', '\\']).next().unwrap_or(name);
        self.folder.find_path(name).or_else(|problem| self.folder.find_path(base).map_err(|_| problem))
    }

    fn bytes(&self, place: &Place) -> Outcome<Cow<'_, [u8]>> {
        match place {
            Place::View(view) => self.buffers.view(self.document, *view).map(Cow::Borrowed),
            Place::File(path) => read_file(path, MAX_FILE).map(Cow::Owned).map_err(|error| error.to_string()),
            Place::Data(index) => {
                let uri = self.document.images[*index].uri.as_deref().unwrap_or_default();
                self.folder.read(uri, MAX_FILE).map(Cow::Owned)
            }
            Place::Made(made) => {
                let path = made.color.as_ref().or(made.alpha.as_ref()).ok_or("it has no file")?;
                self.bytes(&Place::File(path.clone()))
            }
        }
    }

    fn texels_of(&self, place: &Place) -> Outcome<u64> {
        let (width, height) = Image::size_of(&self.bytes(place)?)?;
        Ok(u64::from(width) * u64::from(height))
    }

    fn decode(&self, place: &Place, halvings: u32) -> Outcome<Decoded> {
        let bytes = self.bytes(place)?;
        let image = match place {
            Place::Made(made) => self.make(made, &bytes)?.halved(halvings),
            _ => Image::decode_halved(&bytes, halvings)?,
        };
        let (low, high) = image.range();
        Ok(Decoded { image, low, high, stand_in: false })
    }

    /// An image of several files, the first of which is given.
    fn make(&self, made: &Made, bytes: &[u8]) -> Outcome<Image> {
        let mut image = Image::decode(bytes)?;
        match &made.alpha {
            Some(path) if made.color.as_ref() != Some(path) => {
                let mask = Image::decode(&self.bytes(&Place::File(path.clone()))?)?;
                made::cut_out(&mut image, &mask, made.color.is_none());
            }
            Some(_) => made::cut_out_itself(&mut image),
            None => {}
        }
        if let Some(height) = made.height {
            made::normals_of_heights(&mut image, f64::from_bits(height));
        }
        Ok(image)
    }

    /// An image as an operator may know it.
    fn name(&self, index: usize) -> String {
        let image = &self.document.images[index];
        let uri = image.uri.as_deref().filter(|uri| !Folder::is_embedded(uri));
        let file = image.made.as_ref().map(|made| made.file.as_str());
        match file.or(uri).or(image.name.as_deref()) {
            Some(name) => format!("image {index} ({:?})", shorten(name)),
            None => format!("image {index}"),
        }
    }
}

impl Decoded {
    /// A checkerboard that nobody takes for a texture.
    fn stand_in() -> Self {
        const SIZE: u32 = 16;
        let texel = |i: u32| match (i % SIZE / 4 + i / SIZE / 4) % 2 {
            0 => [255, 0, 255, 255],
            _ => [40, 40, 40, 255],
        };
        let image = Image { texels: (0..SIZE * SIZE).map(texel).collect(), width: SIZE, height: SIZE };
        let (low, high) = image.range();
        Decoded { image, low, high, stand_in: true }
    }
}
