//! Linear pictures, and EXR files of them.

use std::path::Path;

use exr::prelude::{
    Encoding, Image, Layer, LayerAttributes, ReadChannels, ReadLayers, ReadSpecificChannel, SpecificChannels,
    Vec2, WritableImage,
};

use crate::error::{Error, Result};
use crate::whole_file;

/// The most pixels that a picture may have: 32 Mi, 384 MiB of memory.
pub const MAX_PIXELS: usize = 1 << 25;

/// A picture of linear radiance.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels across; at least 1.
    pub width: u32,
    /// Pixels down; at least 1.
    pub height: u32,
    /// Linear RGB (Rec. 709 primaries), rows from the top: `width * height` of them.
    pub pixels: Vec<[f32; 3]>,
}

impl Picture {
    /// A picture from its pixels.
    ///
    /// # Errors
    /// [`Error::Setting`] where the size is 0, above [`MAX_PIXELS`] or not that of `pixels`.
    pub fn new(width: u32, height: u32, pixels: Vec<[f32; 3]>) -> Result<Self> {
        let count = checked_pixels(width as usize, height as usize);
        match count {
            Ok(count) if count == pixels.len() => Ok(Picture { width, height, pixels }),
            Ok(count) => {
                let problem =
                    format!("{width}x{height} needs {count} pixels, and there are {}", pixels.len());
                Err(Error::setting("picture", problem))
            }
            Err(problem) => Err(Error::setting("picture", problem)),
        }
    }

    /// Reads the R, G and B channels of an OpenEXR file's first layer that has them.
    ///
    /// # Errors
    /// [`Error::File`] where the file cannot be read, is not such a picture, or is too large.
    pub fn read_exr(path: &Path) -> Result<Self> {
        let fail = |problem: String| Error::File { path: path.to_path_buf(), problem };
        // The header is judged before anything is allocated for what it announces.
        let header = exr::meta::MetaData::read_from_file(path, false).map_err(|e| exr_error(path, e))?;
        for part in &header.headers {
            checked_pixels(part.layer_size.width(), part.layer_size.height()).map_err(fail)?;
        }
        let image = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .specific_channels()
            .required("R")
            .required("G")
            .required("B")
            .collect_pixels(
                |size: Vec2<usize>, _| (size.width(), vec![[0.0f32; 3]; size.width() * size.height()]),
                |(width, pixels), at: Vec2<usize>, (r, g, b): (f32, f32, f32)| {
                    pixels[at.y() * *width + at.x()] = [r, g, b];
                },
            )
            .first_valid_layer()
            .all_attributes()
            .from_file(path)
            .map_err(|e| exr_error(path, e))?;
        let size = image.layer_data.size;
        let pixels = image.layer_data.channel_data.pixels.1;
        Picture::new(size.width() as u32, size.height() as u32, pixels).map_err(|e| fail(e.to_string()))
    }

    /// Writes an OpenEXR file: R, G and B as 32-bit floats, losslessly compressed; whole or not at all.
    ///
    /// # Errors
    /// [`Error::File`] where the file cannot be written.
    pub fn write_exr(&self, path: &Path) -> Result<()> {
        let width = self.width as usize;
        let channels = SpecificChannels::rgb(|at: Vec2<usize>| {
            let [r, g, b] = self.pixels[at.y() * width + at.x()];
            (r, g, b)
        });
        let layer = Layer::new(
            (width, self.height as usize),
            LayerAttributes::default(),
            Encoding::SMALL_LOSSLESS,
            channels,
        );
        whole_file::write(path, |file| {
            Image::from_layer(layer).write().to_buffered(file).map_err(|error| match error {
                exr::error::Error::Io(error) => Error::writing(path, &error),
                error => exr_error(path, error),
            })
        })
    }

    /// Pixels with a channel that is not a finite number.
    pub fn not_finite(&self) -> usize {
        self.pixels.iter().filter(|pixel| pixel.iter().any(|channel| !channel.is_finite())).count()
    }
}

/// The number of pixels of a size that a picture may have, or what is wrong with it.
pub(super) fn checked_pixels(width: usize, height: usize) -> Result<usize, String> {
    match width.checked_mul(height) {
        Some(0) => Err(format!("{width}x{height} has no pixels; use a picture that has some")),
        Some(count) if count <= MAX_PIXELS => Ok(count),
        _ => Err(format!("{width}x{height} is larger than {MAX_PIXELS} pixels; make it smaller")),
    }
}

fn exr_error(path: &Path, error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::Io(error) => Error::io(path, &error),
        error => {
            let problem = format!("not an OpenEXR picture with R, G and B channels ({error})");
            Error::File { path: path.to_path_buf(), problem }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient() -> Picture {
        let pixels = (0..35).map(|i| [i as f32 * 100.0, 1e-7 * i as f32, -0.5]).collect();
        Picture::new(7, 5, pixels).unwrap()
    }

    #[test]
    fn exr_keeps_every_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("gradient.exr");
        gradient().write_exr(&path).unwrap();
        assert_eq!(Picture::read_exr(&path).unwrap(), gradient());
    }

    #[test]
    fn sizes_are_checked() {
        assert!(Picture::new(2, 2, vec![[0.0; 3]; 3]).is_err());
        assert!(Picture::new(0, 2, vec![]).is_err());
        assert!(Picture::new(u32::MAX, u32::MAX, vec![]).is_err());
        assert!(checked_pixels(usize::MAX, 2).is_err());
    }

    #[test]
    fn bad_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("missing.exr");
        assert!(
            Picture::read_exr(&missing).unwrap_err().to_string().contains("missing.exr: there is no such")
        );
        assert!(gradient().write_exr(&folder.path().join("no/such.exr")).is_err());
        let good = folder.path().join("good.exr");
        gradient().write_exr(&good).unwrap();
        let bytes = std::fs::read(&good).unwrap();
        for length in [0, 3, 20, bytes.len() / 2, bytes.len() - 3] {
            std::fs::write(&good, &bytes[..length]).unwrap();
            assert!(Picture::read_exr(&good).is_err(), "cut to {length} bytes");
        }
    }

    #[test]
    fn announced_size_is_refused_before_it_is_allocated() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("huge.exr");
        gradient().write_exr(&path).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        let name = b"dataWindow\0box2i\0";
        let at = bytes.windows(name.len()).position(|window| window == name).unwrap() + name.len() + 4;
        bytes[at + 8..at + 16].copy_from_slice(&[0xff, 0xff, 0x0f, 0, 0xff, 0xff, 0x0f, 0]);
        std::fs::write(&path, bytes).unwrap();
        let message = Picture::read_exr(&path).unwrap_err().to_string();
        assert!(message.contains("larger than"), "{message}");
    }
}
