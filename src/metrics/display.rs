//! What a screen shows of a picture: exposure, tone mapping, sRGB; and PNG files of it.

use std::path::Path;

use image::codecs::png::PngEncoder;
use image::{ImageEncoder, ImageFormat, ImageReader, Limits};
use rayon::prelude::*;

use super::picture::{self, Picture};
use crate::error::{Error, Result};
use crate::whole_file;

/// A picture as a screen shows it.
#[derive(Clone, Debug, PartialEq)]
pub struct Display {
    /// Pixels across; at least 1.
    pub width: u32,
    /// Pixels down; at least 1.
    pub height: u32,
    /// sRGB codes in 0..1, not rounded to bytes; rows from the top.
    pub pixels: Vec<[f32; 3]>,
}

impl Display {
    /// Exposes by `2^exposure`, tone-maps by [`pbr_neutral`], and encodes.
    pub fn from_picture(picture: &Picture, exposure: f32) -> Self {
        let gain = exposure.exp2();
        let show = |pixel: &[f32; 3]| pbr_neutral(pixel.map(|c| c * gain)).map(srgb_from_linear);
        let pixels = picture.pixels.par_iter().map(show).collect();
        Display { width: picture.width, height: picture.height, pixels }
    }

    /// From four bytes a pixel, sRGB codes and an alpha that is ignored.
    pub fn from_rgba(width: u32, height: u32, rgba: &[u8]) -> Self {
        assert_eq!(rgba.len(), width as usize * height as usize * 4, "four bytes for each pixel");
        let code = |byte: u8| f32::from(byte) / 255.0;
        let pixels = rgba.chunks_exact(4).map(|p| [code(p[0]), code(p[1]), code(p[2])]).collect();
        Display { width, height, pixels }
    }

    /// Reads a PNG file as sRGB codes; alpha is ignored.
    ///
    /// # Errors
    /// [`Error::File`] where the file cannot be read, is not a PNG, or is too large.
    pub fn read_png(path: &Path) -> Result<Self> {
        let fail = |problem: String| Error::File { path: path.to_path_buf(), problem };
        let open = || -> std::io::Result<_> {
            let mut reader = ImageReader::open(path)?;
            reader.set_format(ImageFormat::Png);
            Ok(reader)
        };
        let bad = |e: image::ImageError| fail(format!("not a PNG picture that can be read ({e})"));
        let (width, height) = open().map_err(|e| Error::io(path, &e))?.into_dimensions().map_err(bad)?;
        picture::checked_pixels(width as usize, height as usize).map_err(fail)?;
        let mut reader = open().map_err(|e| Error::io(path, &e))?;
        reader.limits(Limits::default());
        // 16 bits hold PNG's 8 as well, exactly, in half the memory of floats.
        let image = reader.decode().map_err(bad)?.into_rgb16();
        let pixels = image.pixels().map(|pixel| pixel.0.map(|code| f32::from(code) / 65535.0)).collect();
        Ok(Display { width, height, pixels })
    }

    /// Writes a PNG file of 8 bits a channel, whole or not at all.
    ///
    /// # Errors
    /// [`Error::File`] where the file cannot be written.
    pub fn write_png(&self, path: &Path) -> Result<()> {
        let byte = |code: f32| (code.clamp(0.0, 1.0) * 255.0).round() as u8;
        let bytes: Vec<u8> = self.pixels.iter().flatten().map(|&code| byte(code)).collect();
        let kind = image::ExtendedColorType::Rgb8;
        whole_file::write(path, |file| {
            let encoder = PngEncoder::new(file);
            encoder.write_image(&bytes, self.width, self.height, kind).map_err(|error| match error {
                image::ImageError::IoError(error) => Error::writing(path, &error),
                error => Error::File { path: path.to_path_buf(), problem: error.to_string() },
            })
        })
    }
}

/// The Khronos PBR Neutral tone mapper (Khronos Group, 2024): linear RGB of any range to 0..1.
///
/// Base colours up to 0.8 come through as they are, apart from the 0.04 of Fresnel reflection that is taken
/// off; above that, highlights are compressed and lose their saturation. Negative and NaN channels are 0.
pub fn pbr_neutral(color: [f32; 3]) -> [f32; 3] {
    const START: f32 = 0.8 - 0.04;
    const DESATURATION: f32 = 0.15;
    // Above 1e6 the result is white to the last bit, and infinity would become NaN.
    let color = color.map(|c| if c > 0.0 { c.min(1e6) } else { 0.0 });
    let least = color[0].min(color[1]).min(color[2]);
    let offset = if least < 0.08 { least - 6.25 * least * least } else { 0.04 };
    let color = color.map(|c| c - offset);
    let peak = color[0].max(color[1]).max(color[2]);
    if peak < START {
        return color;
    }
    let room = 1.0 - START;
    let new_peak = 1.0 - room * room / (peak + room - START);
    let white = 1.0 - 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    color.map(|c| {
        let c = c * new_peak / peak;
        (c + (new_peak - c) * white).clamp(0.0, 1.0)
    })
}

/// The sRGB code of a linear value, both in 0..1 (IEC 61966-2-1).
pub fn srgb_from_linear(linear: f32) -> f32 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The linear value of an sRGB code, both in 0..1 (IEC 61966-2-1).
pub fn linear_from_srgb(code: f32) -> f32 {
    let code = code.clamp(0.0, 1.0);
    if code <= 0.040_45 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neutral_keeps_base_colours_and_bounds_highlights() {
        let shown = pbr_neutral([0.3, 0.5, 0.7]);
        for (shown, sent) in shown.iter().zip([0.3, 0.5, 0.7]) {
            assert!((shown - (sent - 0.04)).abs() < 1e-6);
        }
        assert_eq!(pbr_neutral([0.0; 3]), [0.0; 3]);
        // By hand: offset 0.04, peak 1.96, new peak 1 - 0.24² / 1.44 = 0.96, grey stays grey.
        assert!((pbr_neutral([2.0; 3])[0] - 0.96).abs() < 1e-6);
        // Red 2: offset 0, peak 2, new peak 1 - 0.0576 / 1.48, mixed with white.
        let peak = 1.0 - 0.0576f32 / 1.48;
        let white = 1.0 - 1.0 / (0.15 * (2.0 - peak) + 1.0);
        let red = pbr_neutral([2.0, 0.0, 0.0]);
        assert!((red[0] - peak).abs() < 1e-6 && (red[1] - peak * white).abs() < 1e-6);
        let mut before = -1.0;
        for step in 0..2000 {
            let grey = pbr_neutral([step as f32 * 0.01; 3])[0];
            assert!(grey >= before && grey <= 1.0);
            before = grey;
        }
        for wild in [[f32::INFINITY; 3], [f32::NAN, -1.0, 1e30], [f32::MAX, 0.0, 0.0]] {
            assert!(pbr_neutral(wild).iter().all(|c| (0.0..=1.0).contains(c)), "{wild:?}");
        }
    }

    #[test]
    fn srgb_goes_there_and_back() {
        for code in 0..=255 {
            let code = code as f32 / 255.0;
            assert!((srgb_from_linear(linear_from_srgb(code)) - code).abs() < 1e-6);
        }
        assert!((linear_from_srgb(0.5) - 0.214_041).abs() < 1e-6);
    }

    #[test]
    fn exposure_doubles_the_light() {
        let picture = |value: f32| Picture::new(1, 1, vec![[value; 3]]).unwrap();
        assert_eq!(Display::from_picture(&picture(0.1), 1.0), Display::from_picture(&picture(0.2), 0.0));
    }

    #[test]
    fn png_keeps_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ramp.png");
        let pixels = (0..=255).map(|i| [i as f32 / 255.0, 0.0, 1.0 - i as f32 / 255.0]).collect();
        let ramp = Display { width: 16, height: 16, pixels };
        ramp.write_png(&path).unwrap();
        let back = Display::read_png(&path).unwrap();
        assert_eq!((back.width, back.height), (16, 16));
        for (a, b) in ramp.pixels.iter().flatten().zip(back.pixels.iter().flatten()) {
            assert!((a - b).abs() < 1e-6);
        }
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        assert!(Display::read_png(&path).unwrap_err().to_string().contains("ramp.png"));
        assert!(Display::read_png(&folder.path().join("none.png")).is_err());
    }

    #[test]
    fn announced_size_is_refused_before_it_is_allocated() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("huge.png");
        Display { width: 1, height: 1, pixels: vec![[0.5; 3]] }.write_png(&path).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
        let crc = crc32(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&crc.to_be_bytes());
        std::fs::write(&path, bytes).unwrap();
        let message = Display::read_png(&path).unwrap_err().to_string();
        assert!(message.contains("larger than"), "{message}");
    }

    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0u32, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
        })
    }
}
