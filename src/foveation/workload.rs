//! A view's work in order, and where it may be cut.
//!
//! A view's tiles lie along a Hilbert curve, and its samples tile by tile, so that any run of samples is a
//! region. [`Workload`] cuts that order into a part for each device, at multiples of 32 samples: camera rays
//! travel in streams of 32, and none is torn. Each sample, its random numbers and its rays depend on its
//! index alone, so pictures do not depend on how they were split (`tests/fleet/main.rs` compares them bit by
//! bit). With guided reconstruction a part's tiles come with it; a tile with a cut in it is traced by both
//! neighbours and delivered by the first. Edges look at neighbouring pixels, so each device also traces the
//! ring of 8 by 8 pixels' blocks around its part.

use std::ops::Range;

use super::pattern::{Pattern, TILE};

/// Parts begin at multiples of this many samples: camera rays travel in streams of as many, and a stream
/// is never torn, so that the picture does not depend on how it was split.
pub const ALIGNMENT: u32 = 32;

/// Pixels of a tile.
pub const TILE_PIXELS: u32 = TILE * TILE;

/// A part of a view.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Part {
    /// Samples, in the pattern's order.
    pub samples: Range<u32>,
    /// Tiles along the pattern's order whose pixels are this part's to deliver.
    pub tiles: Range<u32>,
    /// The first tile that has to be traced: one before `tiles` where the tile of the first sample is
    /// another part's to deliver.
    pub first_traced: u32,
}

/// A view's tiles along the pattern's order, and the samples in them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Workload {
    /// The first sample of each tile; at the end the number of samples.
    starts: Vec<u32>,
    /// Pixels are work too, as guided reconstruction wants it.
    pub dense: bool,
}

impl Workload {
    /// The work of a pattern; with `dense`, every pixel's beside the samples'.
    pub fn new(pattern: &Pattern, dense: bool) -> Self {
        let mut starts: Vec<u32> =
            pattern.order.iter().map(|&tile| pattern.tiles[tile as usize][0]).collect();
        starts.push(pattern.samples.len() as u32);
        Workload { starts, dense }
    }

    /// The work of tiles with so many samples each.
    pub fn of_counts(counts: &[u32], dense: bool) -> Self {
        let mut starts = vec![0];
        starts.extend(counts.iter().scan(0, |sum, count| {
            *sum += count;
            Some(*sum)
        }));
        Workload { starts, dense }
    }

    /// Number of tiles.
    pub fn tiles(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Number of samples.
    pub fn samples(&self) -> u32 {
        self.starts.last().copied().unwrap_or(0)
    }

    /// The samples of a tile.
    pub fn tile(&self, tile: usize) -> Range<u32> {
        self.starts[tile]..self.starts[tile + 1]
    }

    /// All of it.
    pub fn whole(&self) -> Part {
        Part { samples: 0..self.samples(), tiles: 0..self.tiles() as u32, first_traced: 0 }
    }

    /// The tile that a sample is in; the number of tiles for the samples' end.
    pub fn tile_of(&self, sample: u32) -> u32 {
        if sample >= self.samples() {
            return self.tiles() as u32;
        }
        self.starts.partition_point(|&start| start <= sample) as u32 - 1
    }

    /// The parts between samples where a part is cut: rising, inside `part`.
    pub fn cut(&self, part: &Part, at: &[u32]) -> Vec<Part> {
        let mut parts = Vec::with_capacity(at.len() + 1);
        let (mut sample, mut tile, mut traced) = (part.samples.start, part.tiles.start, part.first_traced);
        for &end in at {
            let inside = self.tile_of(end);
            let next = if inside < self.tiles() as u32 && self.starts[inside as usize] == end {
                inside
            } else {
                inside + 1
            };
            let next = next.clamp(tile, part.tiles.end);
            parts.push(Part { samples: sample..end, tiles: tile..next, first_traced: traced });
            (sample, tile, traced) = (end, next, inside.min(next));
        }
        parts.push(Part {
            samples: sample..part.samples.end,
            tiles: tile..part.tiles.end,
            first_traced: traced,
        });
        parts
    }

    /// `count` parts with about as many samples each, for timing them apart; at least one.
    pub fn slices(&self, part: &Part, count: u32) -> Vec<Part> {
        let length = part.samples.end - part.samples.start;
        let step = length.div_ceil(count.max(1)).next_multiple_of(ALIGNMENT).max(ALIGNMENT);
        let at: Vec<u32> =
            (1..count).map(|i| part.samples.start + i * step).take_while(|&s| s < part.samples.end).collect();
        self.cut(part, &at)
    }
}
