//! PNG, JPEG, WebP, BMP, TGA and KTX2 files to texels, without more memory than these take.

use std::io::Cursor;

use image::{ColorType, ImageDecoder, ImageFormat, ImageReader};

use super::basis;

/// An image as decoded: rows from the top, RGBA bytes, as encoded in its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// `width * height` texels.
    pub texels: Vec<[u8; 4]>,
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
}

impl Image {
    /// Longest edge that is accepted.
    pub const MAX_EDGE: u32 = 16_384;

    /// Width and height of a file, from its header alone; what is wrong with it otherwise.
    pub fn size_of(bytes: &[u8]) -> Result<(u32, u32), String> {
        let (width, height) = match basis::is_ktx2(bytes) {
            true => basis::size_of(bytes)?,
            false => reader(bytes)?.into_dimensions().map_err(damaged)?,
        };
        if width == 0 || height == 0 || width.max(height) > Self::MAX_EDGE {
            return Err(format!(
                "it is {width}x{height}, but 1 to {} texels an edge are supported",
                Self::MAX_EDGE
            ));
        }
        Ok((width, height))
    }

    /// Decodes a file; what is wrong with it otherwise.
    ///
    /// Texels with up to 8 bits a channel are decoded to where they stay, with room for smaller levels.
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        let (width, height) = Self::size_of(bytes)?;
        if basis::is_ktx2(bytes) {
            return basis::decode(bytes, 0).map(|(image, _)| image);
        }
        let mut reader = reader(bytes)?;
        reader.no_limits();
        let decoder = reader.into_decoder().map_err(damaged)?;
        let count = width as usize * height as usize;
        let channels = match decoder.color_type() {
            ColorType::L8 => 1,
            ColorType::La8 => 2,
            ColorType::Rgb8 => 3,
            ColorType::Rgba8 => 4,
            _ => return Self::convert(decoder),
        };
        if decoder.total_bytes() != (count * channels) as u64 {
            return Err("its header contradicts itself".into());
        }
        let mut texels = room(count)?;
        texels.resize(count, [0; 4]);
        let buffer: &mut [u8] = bytemuck::cast_slice_mut(&mut texels);
        decoder.read_image(&mut buffer[..count * channels]).map_err(damaged)?;
        spread(&mut texels, channels);
        Ok(Image { texels, width, height })
    }

    /// The same with width and height halved so many times. Files that hold smaller levels are read at one of
    /// these.
    pub fn decode_halved(bytes: &[u8], times: u32) -> Result<Self, String> {
        if times > 0 && basis::is_ktx2(bytes) {
            Self::size_of(bytes)?;
            let (image, level) = basis::decode(bytes, times)?;
            return Ok(image.halved(times - level));
        }
        Ok(Self::decode(bytes)?.halved(times))
    }

    /// Decodes texels of other kinds, which become RGBA bytes by way of a second copy.
    fn convert(decoder: impl ImageDecoder) -> Result<Self, String> {
        let rgba = image::DynamicImage::from_decoder(decoder).map_err(damaged)?.into_rgba8();
        let (width, height) = rgba.dimensions();
        let mut texels = room(width as usize * height as usize)?;
        texels.extend_from_slice(bytemuck::cast_slice::<u8, [u8; 4]>(rgba.as_raw()));
        Ok(Image { texels, width, height })
    }

    /// The image with its width and height halved so many times, by averages of its values as they are.
    pub fn halved(self, times: u32) -> Self {
        (0..times).fold(self, |image, _| {
            let size = [image.width, image.height];
            let half = size.map(|edge| (edge / 2).max(1));
            let mut texels = vec![[0; 4]; half[0] as usize * half[1] as usize];
            super::halve(&image.texels, size, &mut texels, half, false);
            Image { texels, width: half[0], height: half[1] }
        })
    }

    /// The least and the greatest value of each channel.
    pub fn range(&self) -> ([u8; 4], [u8; 4]) {
        self.texels.iter().fold(([255; 4], [0; 4]), |(low, high), texel| {
            (std::array::from_fn(|c| low[c].min(texel[c])), std::array::from_fn(|c| high[c].max(texel[c])))
        })
    }
}

/// Room for so many texels and those of all smaller levels.
pub(super) fn room(count: usize) -> Result<Vec<[u8; 4]>, String> {
    let mut texels = Vec::new();
    texels.try_reserve_exact(count / 3 * 4 + 64).map_err(|_| "there is too little memory for it")?;
    Ok(texels)
}

/// Makes RGBA of texels of fewer channels, which lie at the start of the same memory.
fn spread(texels: &mut [[u8; 4]], channels: usize) {
    if channels == 4 {
        return;
    }
    for i in (0..texels.len()).rev() {
        let bytes: &[u8] = bytemuck::cast_slice(texels);
        let read = |channel: usize| bytes[i * channels + channel];
        texels[i] = match channels {
            1 => [read(0), read(0), read(0), 255],
            2 => [read(0), read(0), read(0), read(1)],
            _ => [read(0), read(1), read(2), 255],
        };
    }
}

fn reader(bytes: &[u8]) -> Result<ImageReader<Cursor<&[u8]>>, String> {
    use ImageFormat::{Bmp, Jpeg, Png, Tga, WebP};
    match image::guess_format(bytes) {
        Ok(format @ (Png | Jpeg | WebP | Bmp)) => Ok(ImageReader::with_format(Cursor::new(bytes), format)),
        Ok(format) => Err(format!(
            "it is a {} file, but PNG, JPEG, WebP, BMP, TGA and KTX2 are read",
            format.to_mime_type()
        )),
        Err(_) if is_targa(bytes) => Ok(ImageReader::with_format(Cursor::new(bytes), Tga)),
        Err(_) => Err("it is neither PNG nor JPEG, WebP, BMP, TGA or KTX2".into()),
    }
}

/// Whether a file's header makes sense as Truevision's, which has no signature.
fn is_targa(bytes: &[u8]) -> bool {
    matches!(
        bytes,
        [_, 0 | 1, 1 | 2 | 3 | 9 | 10 | 11, _, _, _, _, _, _, _, _, _, _, _, _, _, 8 | 15 | 16 | 24 | 32, ..]
    )
}

fn damaged(error: image::ImageError) -> String {
    format!("it cannot be decoded ({error})")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encode(image: impl Into<image::DynamicImage>, format: ImageFormat) -> Vec<u8> {
        let mut file = Cursor::new(Vec::new());
        image.into().write_to(&mut file, format).unwrap();
        file.into_inner()
    }

    #[test]
    fn every_kind_of_texel_becomes_rgba() {
        use image::{GrayAlphaImage, GrayImage, ImageBuffer, Luma, LumaA, Rgb, RgbImage, Rgba, RgbaImage};
        let value = |x: u32, y: u32, c: u32| (x * 40 + y * 90 + c * 11) as u8;
        let grey = GrayImage::from_fn(5, 3, |x, y| Luma([value(x, y, 0)]));
        let grey_alpha = GrayAlphaImage::from_fn(5, 3, |x, y| LumaA([value(x, y, 0), value(x, y, 3)]));
        let rgb = RgbImage::from_fn(5, 3, |x, y| Rgb([0, 1, 2].map(|c| value(x, y, c))));
        let rgba = RgbaImage::from_fn(5, 3, |x, y| Rgba([0, 1, 2, 3].map(|c| value(x, y, c))));
        let deep = ImageBuffer::from_fn(5, 3, |x, y| Luma([u16::from(value(x, y, 0)) * 257]));
        let files: [(Vec<u8>, [Option<u32>; 4]); 8] = [
            (encode(grey, ImageFormat::Png), [Some(0), Some(0), Some(0), None]),
            (encode(grey_alpha, ImageFormat::Png), [Some(0), Some(0), Some(0), Some(3)]),
            (encode(rgb, ImageFormat::Png), [Some(0), Some(1), Some(2), None]),
            (encode(rgba.clone(), ImageFormat::Png), [Some(0), Some(1), Some(2), Some(3)]),
            (encode(rgba.clone(), ImageFormat::Bmp), [Some(0), Some(1), Some(2), Some(3)]),
            (encode(rgba.clone(), ImageFormat::Tga), [Some(0), Some(1), Some(2), Some(3)]),
            (encode(rgba, ImageFormat::WebP), [Some(0), Some(1), Some(2), Some(3)]),
            (encode(deep, ImageFormat::Png), [Some(0), Some(0), Some(0), None]),
        ];
        for (kind, (file, channels)) in files.iter().enumerate() {
            let image = Image::decode(file).unwrap();
            assert_eq!((image.width, image.height, image.texels.len()), (5, 3, 15));
            for (i, texel) in image.texels.iter().enumerate() {
                let (x, y) = (i as u32 % 5, i as u32 / 5);
                assert_eq!(*texel, channels.map(|c| c.map_or(255, |c| value(x, y, c))), "{kind} at {x}, {y}");
            }
        }
    }

    #[test]
    fn sizes_are_limited() {
        let blank = |width, height| encode(image::GrayImage::new(width, height), ImageFormat::Png);
        assert!(Image::size_of(&blank(16_385, 1)).unwrap_err().contains("16385x1"));
        assert_eq!(Image::size_of(&blank(16_384, 2)), Ok((16_384, 2)));
    }

    #[test]
    fn other_files_are_refused_with_a_reason() {
        assert!(Image::decode(b"GIF89a").unwrap_err().contains("image/gif"));
        assert!(Image::decode(b"hello").unwrap_err().contains("neither PNG nor JPEG"));
        assert!(Image::decode(b"\x89PNG\r\n\x1a\nrubbish").unwrap_err().contains("cannot be decoded"));
    }
}
