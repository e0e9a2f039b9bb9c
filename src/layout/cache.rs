//! The cache of light as kernels see it.

use super::kernel_type::shared_structs;

shared_structs! {

/// What is known of a cell of the cache of light.
pub struct CacheCell {
    /// Mean radiance that its surfaces send.
    pub radiance: [f32; 3],
    /// How many samples that is the mean of, older ones counting less; negative: a wall parts it, and smaller cells count.
    pub samples: f32,
    /// The frame in which it was last passed by a path.
    pub frame: u32,
    /// The frame in which it was first.
    pub born: u32,
}

/// What paths bring to a cell in a frame: integers of two words, the low one first.
pub struct CacheSum {
    /// Radiance in units of 2^-30 of [`CacheInfo::scale`].
    pub red: [u32; 2],
    /// See `red`.
    pub green: [u32; 2],
    /// See `red`.
    pub blue: [u32; 2],
    /// Paths.
    pub count: u32,
    /// Bit 0: a wall was found in the cell; bit 1: it was passed, although a wall parts it.
    pub parted: u32,
}

/// The cache in a frame.
pub struct CacheInfo {
    /// Counts frames from 1 on.
    pub frame: u32,
    /// Paths that bring light in this frame.
    pub paths: u32,
    /// No cell is smaller than half of this: metres.
    pub least: f32,
    /// A radiance of the scene's order of magnitude.
    pub scale: f32,
    /// The most radiance that rays may find on a surface; infinite where no sun shines.
    pub most: f32,
    /// After so many frames samples count half as much.
    pub half_life: f32,
    /// After so many frames without a path a cell is given up.
    pub lifetime: u32,
}
}
