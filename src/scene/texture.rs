//! Textures as 8-bit RGBA with their mip levels.

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

/// An image with the sampler that reads it. Level 0 is the image; each next one is half as wide and
/// high (rounded down, at least 1) down to 1x1, averaged in linear light.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Texels of all levels, finest first, rows from the top, RGBA bytes.
    pub texels: Vec<[u8; 4]>,
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
    /// Number of levels, down to 1x1.
    pub fn levels(&self) -> u32 {
        32 - self.width.max(self.height).max(1).leading_zeros()
    }
}
