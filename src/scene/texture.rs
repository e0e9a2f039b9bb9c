//! Textures as 8-bit RGBA with their mip levels.

mod basis;
mod decode;

use std::sync::{Arc, LazyLock};

use rayon::prelude::*;

pub use decode::Image;

/// How coordinates outside 0..1 are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// Tiled.
    Repeat,
    /// Tiled, every other tile mirrored.
    MirroredRepeat,
    /// The edge goes on.
    ClampToEdge,
}

/// How a texture's texels are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Sampling {
    /// RGB is sRGB-encoded (base colour, emission); else linear.
    pub srgb: bool,
    /// Wrap along u and v.
    pub wrap: [Wrap; 2],
    /// The file asks for NEAREST magnification.
    pub nearest: bool,
}

/// An image with the sampler that reads it. Level 0 is the image; each next one is half as wide and
/// high (rounded down, at least 1) down to 1x1, averaged in linear light.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Texels of all levels, finest first, rows from the top, RGBA bytes. Textures that read one image in
    /// different ways share them.
    pub texels: Arc<Vec<[u8; 4]>>,
    /// Width of level 0.
    pub width: u32,
    /// Height of level 0.
    pub height: u32,
    /// RGB is sRGB-encoded (base colour, emission); else linear.
    pub srgb: bool,
    /// Wrap along u and v.
    pub wrap: [Wrap; 2],
    /// The file asks for NEAREST magnification.
    pub nearest: bool,
}

impl Texture {
    /// Makes the mip levels of an image.
    ///
    /// # Panics
    /// When `image` has no texels or not `width * height` of them.
    pub fn from_image(image: Image, sampling: Sampling) -> Self {
        let (width, height) = (image.width, image.height);
        Self::new(Arc::new(mip_levels(image, sampling.srgb)), [width, height], sampling)
    }

    /// A texture of these texels, as [`mip_levels`] makes them of an image of this width and height.
    pub fn new(texels: Arc<Vec<[u8; 4]>>, [width, height]: [u32; 2], sampling: Sampling) -> Self {
        let Sampling { srgb, wrap, nearest } = sampling;
        Texture { texels, width, height, srgb, wrap, nearest }
    }

    /// Number of levels, down to 1x1.
    pub fn levels(&self) -> u32 {
        32 - self.width.max(self.height).max(1).leading_zeros()
    }

    /// The first texel, the width and the height of a level.
    pub fn level(&self, level: u32) -> (usize, u32, u32) {
        let size = |l: u32| ((self.width >> l).max(1), (self.height >> l).max(1));
        let texels = |l: u32| size(l).0 as usize * size(l).1 as usize;
        let (width, height) = size(level);
        ((0..level).map(texels).sum(), width, height)
    }
}

/// The texels of an image and of all its smaller levels; `srgb` says how its colours are encoded.
///
/// # Panics
/// When `image` has no texels or not `width * height` of them.
pub fn mip_levels(image: Image, srgb: bool) -> Vec<[u8; 4]> {
    let Image { mut texels, width, height } = image;
    assert!(width > 0 && height > 0 && texels.len() == width as usize * height as usize);
    let mut start = 0;
    let (mut w, mut h) = (width, height);
    while (w, h) != (1, 1) {
        let (next_w, next_h) = ((w / 2).max(1), (h / 2).max(1));
        let end = texels.len();
        texels.resize(end + next_w as usize * next_h as usize, [0; 4]);
        let (above, next) = texels.split_at_mut(end);
        halve(&above[start..], [w, h], next, [next_w, next_h], srgb);
        start = end;
        (w, h) = (next_w, next_h);
    }
    texels
}

/// Linear value of each sRGB code (IEC 61966-2-1).
static SRGB_TO_LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|code| {
        let c = code as f64 / 255.0;
        (if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }) as f32
    })
});

/// Linear value of an sRGB code (IEC 61966-2-1).
pub fn srgb_to_linear(code: u8) -> f32 {
    SRGB_TO_LINEAR[code as usize]
}

/// The sRGB code whose encoded value is nearest to that of a linear value.
struct SrgbEncoder {
    /// Linear values at which the code rises to the next one.
    steps: [f32; 256],
    /// The code at each of 4097 evenly spaced linear values: where the search for a code starts.
    starts: Vec<u8>,
}

impl SrgbEncoder {
    fn shared() -> &'static Self {
        static ENCODER: LazyLock<SrgbEncoder> = LazyLock::new(|| {
            let steps: [f32; 256] = std::array::from_fn(|code| {
                let c = (code as f64 + 0.5) / 255.0;
                (if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }) as f32
            });
            let code_at = |i: usize| steps.partition_point(|&step| step <= i as f32 / 4096.0).min(255) as u8;
            SrgbEncoder { steps, starts: (0..=4096).map(code_at).collect() }
        });
        &ENCODER
    }

    /// The code of `linear`, which is in 0..=1.
    fn encode(&self, linear: f32) -> u8 {
        let mut code = self.starts[(linear * 4096.0) as usize];
        while code < 255 && self.steps[code as usize] <= linear {
            code += 1;
        }
        code
    }
}

/// The texels that each texel of a shorter row covers, and how much of it each of them fills.
fn taps(from: u32, to: u32) -> Vec<Vec<(usize, f32)>> {
    let scale = f64::from(from) / f64::from(to);
    let covered = |i: u32| {
        let (start, end) = (f64::from(i) * scale, (f64::from(i) + 1.0) * scale);
        (start as u32..from.min(end.ceil() as u32))
            .map(move |j| (j, end.min(f64::from(j) + 1.0) - start.max(f64::from(j))))
            .filter(|&(_, overlap)| overlap > 1e-9)
            .map(|(j, overlap)| (j as usize, (overlap / scale) as f32))
            .collect()
    };
    (0..to).map(covered).collect()
}

/// Writes one mip level from the one above by area averaging; sizes are (width, height).
fn halve(texels: &[[u8; 4]], from: [u32; 2], out: &mut [[u8; 4]], to: [u32; 2], srgb: bool) {
    let (columns, rows) = (taps(from[0], to[0]), taps(from[1], to[1]));
    let linear: [f32; 256] =
        if srgb { *SRGB_TO_LINEAR } else { std::array::from_fn(|code| code as f32 / 255.0) };
    let encoder = SrgbEncoder::shared();
    let byte = |value: f32| (value * 255.0 + 0.5) as u8;
    let width = from[0] as usize;
    let texel = |row: &[(usize, f32)], column: &[(usize, f32)]| {
        let mut sum = [0.0_f32; 4];
        for &(y, weight_y) in row {
            for &(x, weight_x) in column {
                let (texel, weight) = (texels[y * width + x], weight_x * weight_y);
                (0..3).for_each(|c| sum[c] += weight * linear[texel[c] as usize]);
                sum[3] += weight * f32::from(texel[3]) * (1.0 / 255.0);
            }
        }
        let sum = sum.map(|value| value.clamp(0.0, 1.0));
        let encode = |value| if srgb { encoder.encode(value) } else { byte(value) };
        [encode(sum[0]), encode(sum[1]), encode(sum[2]), byte(sum[3])]
    };
    out.par_chunks_mut(to[0] as usize).zip(&rows).with_min_len(16).for_each(|(line, row)| {
        line.iter_mut().zip(&columns).for_each(|(out, column)| *out = texel(row, column));
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINEAR: Sampling = Sampling { srgb: false, wrap: [Wrap::Repeat; 2], nearest: false };

    fn grey(values: &[u8], width: u32) -> Image {
        Image {
            texels: values.iter().map(|&v| [v, v, v, 255 - v]).collect(),
            width,
            height: values.len() as u32 / width,
        }
    }

    #[test]
    fn every_srgb_code_survives_decoding_and_encoding() {
        for code in 0..=255 {
            assert_eq!(SrgbEncoder::shared().encode(srgb_to_linear(code)), code);
        }
        assert_eq!(SrgbEncoder::shared().encode(0.5), 188);
        assert_eq!(SrgbEncoder::shared().encode(1.0), 255);
    }

    #[test]
    fn levels_are_averaged_in_linear_light_and_alpha_as_it_is() {
        let texture = Texture::from_image(grey(&[0, 255, 255, 0], 2), Sampling { srgb: true, ..LINEAR });
        assert_eq!(texture.texels.len(), 5);
        assert_eq!(texture.texels[4], [188, 188, 188, 128]);
        let texture = Texture::from_image(grey(&[0, 255, 255, 0], 2), LINEAR);
        assert_eq!(texture.texels[4], [128; 4]);
    }

    #[test]
    fn odd_sizes_weigh_every_texel_alike() {
        let texture = Texture::from_image(grey(&[0, 0, 150, 0, 0], 5), LINEAR);
        assert_eq!((texture.levels(), texture.level(1), texture.level(2)), (3, (5, 2, 1), (7, 1, 1)));
        assert_eq!(texture.texels.len(), 8);
        assert_eq!(texture.texels[5][0], texture.texels[6][0]);
        assert_eq!(texture.texels[7][0], 30);
    }

    #[test]
    fn a_constant_image_stays_constant() {
        for srgb in [false, true] {
            let image = Image { texels: vec![[13, 200, 77, 254]; 7 * 12], width: 7, height: 12 };
            let texture = Texture::from_image(image, Sampling { srgb, ..LINEAR });
            assert!(texture.texels.iter().all(|&t| t == [13, 200, 77, 254]));
            let (first, width, height) = texture.level(texture.levels() - 1);
            assert_eq!((first + 1, width, height), (texture.texels.len(), 1, 1));
        }
    }
}
