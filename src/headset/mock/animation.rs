//! An animated GIF of a run of pictures.
//!
//! All pictures share one palette, so that what stands still does not flicker, and a fixed pattern of
//! thresholds hides the steps between its colours.

use std::io::Write;

use color_quant::NeuQuant;
use gif::{Encoder, EncodingError, Frame, Repeat};
use image::RgbaImage;

/// Hundredths of a second that each picture shows: 12.5 pictures a second.
const DELAY: u16 = 8;
/// Pixels at most that the palette is learnt from.
const LEARNT_FROM: usize = 300_000;
/// Bytes at least.
const LEARNT_LEAST: usize = 1 << 16;
/// Every which of these the network takes in a cycle: 1 is best, 30 fastest.
const LEARNING_STEP: i32 = 10;
/// How far apart the thresholds of the pattern are spread, in 8-bit steps.
const SPREAD: i32 = 12;
/// Bits of each channel by which a colour's place in the palette is looked up.
const LOOKUP_BITS: u32 = 6;
/// Bayer's 4x4 matrix: "An optimum method for two-level rendition of continuous-tone pictures", 1973.
const BAYER: [[i32; 4]; 4] = [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];

/// Writes opaque pictures, all of one size below 65,536 pixels a side, as an animation that repeats for
/// ever. Writes nothing without pictures.
pub fn write(pictures: &[RgbaImage], out: impl Write) -> Result<(), EncodingError> {
    let Some(first) = pictures.first() else { return Ok(()) };
    let (width, height) = (first.width() as u16, first.height() as u16);
    let palette = Palette::of(pictures);
    let mut encoder = Encoder::new(out, width, height, &palette.colours)?;
    encoder.set_repeat(Repeat::Infinite)?;
    for picture in pictures {
        let buffer = palette.indices(picture).into();
        encoder.write_frame(&Frame { width, height, delay: DELAY, buffer, ..Frame::default() })?;
    }
    Ok(())
}

/// Up to 256 colours.
struct Palette {
    /// Three bytes each.
    colours: Vec<u8>,
    /// The nearest colour for the leading bits of each channel.
    lookup: Vec<u8>,
}

impl Palette {
    /// The palette of all pictures together, by Dekker's network ("Kohonen neural networks for optimal
    /// colour quantization", 1994).
    fn of(pictures: &[RgbaImage]) -> Self {
        let pixels: usize = pictures.iter().map(|picture| picture.as_raw().len() / 4).sum();
        let step = pixels.div_ceil(LEARNT_FROM).max(1);
        let sample: Vec<u8> =
            pictures.iter().flat_map(|picture| picture.pixels()).step_by(step).flat_map(|p| p.0).collect();
        // The network needs more pixels than a few to learn even a few colours.
        let sample = sample.repeat(LEARNT_LEAST.div_ceil(sample.len().max(1)));
        let network = NeuQuant::new(LEARNING_STEP, 256, &sample);
        let most = (1u32 << LOOKUP_BITS) - 1;
        let channel = |entry: u32, place: u32| ((entry >> (place * LOOKUP_BITS) & most) * 255 / most) as u8;
        let lookup = (0..1u32 << (3 * LOOKUP_BITS))
            .map(|i| network.index_of(&[channel(i, 2), channel(i, 1), channel(i, 0), 255]) as u8)
            .collect();
        Palette { colours: network.color_map_rgb(), lookup }
    }

    /// A picture's pixels as numbers of colours.
    fn indices(&self, picture: &RgbaImage) -> Vec<u8> {
        let index = |(x, y, pixel): (u32, u32, &image::Rgba<u8>)| {
            let threshold = (BAYER[y as usize % 4][x as usize % 4] * 2 - 15) * SPREAD / 32;
            let entry = pixel.0[..3].iter().fold(0, |entry, &value| {
                let shifted = (i32::from(value) + threshold).clamp(0, 255) as usize;
                entry << LOOKUP_BITS | shifted >> (8 - LOOKUP_BITS)
            });
            self.lookup[entry]
        };
        picture.enumerate_pixels().map(index).collect()
    }
}

#[cfg(test)]
mod tests {
    use image::Rgba;

    use super::*;

    #[test]
    fn plain_pictures_keep_their_colours() {
        let colours = [[0, 0, 0, 255], [255, 255, 255, 255], [200, 30, 90, 255]].map(Rgba);
        for size in [1, 3, 40] {
            let pictures = colours.map(|colour| RgbaImage::from_pixel(size, size, colour));
            let palette = Palette::of(&pictures);
            for (picture, colour) in pictures.iter().zip(colours) {
                for index in palette.indices(picture) {
                    let shown = &palette.colours[usize::from(index) * 3..][..3];
                    let far = shown.iter().zip(colour.0).any(|(a, b)| a.abs_diff(b) > 12);
                    assert!(!far, "{size}: {shown:?} for {colour:?}");
                }
            }
        }
    }

    #[test]
    fn a_ramp_is_smooth_in_the_mean() {
        let ramp = RgbaImage::from_fn(256, 64, |x, _| Rgba([x as u8, (x / 2) as u8, 255 - x as u8, 255]));
        let palette = Palette::of(std::slice::from_ref(&ramp));
        let indices = palette.indices(&ramp);
        for column in (8..248).step_by(4) {
            let near = (0..64 * 4).map(|i| indices[i / 4 * 256 + column + i % 4]);
            let mean = near.map(|i| f64::from(palette.colours[usize::from(i) * 3])).sum::<f64>() / 256.0;
            assert!((mean - (column as f64 + 1.5)).abs() < 3.0, "{column}: {mean}");
        }
    }

    #[test]
    fn no_pictures_are_no_animation() {
        let mut bytes = Vec::new();
        write(&[], &mut bytes).unwrap();
        assert!(bytes.is_empty());
    }
}
