//! A view's samples and tiles on a device, and the ring of blocks around parts of it.

use crate::foveation::pattern::TILE;
use crate::foveation::workload::Part;
use crate::gpu::opencl::Buffer;

/// Work-items of `trace_pixels`, `describe_pixels` and `share_edges` for a tile: `BLOCKS_PER_TILE` of tiles.h.
pub(in crate::trace) const BLOCKS_PER_TILE: usize = 4;
/// Where a tile's number says which of its blocks are left out: `LEFT_OUT_SHIFT` of tiles.h.
const LEFT_OUT_SHIFT: u32 = 28;
/// A tile's blocks, one bit each, row by row.
const ALL_BLOCKS: u32 = 0b1111;
/// Which blocks of a tile's neighbours touch it: of those to its left, in its column, to its right; of those above
/// it, in its row, below.
const LEFT_RIGHT: [u32; 3] = [0b1010, ALL_BLOCKS, 0b0101];
const UPPER_LOWER: [u32; 3] = [0b1100, ALL_BLOCKS, 0b0011];
/// Work-items of `pack_visibility` for a tile: its rows.
pub(super) const ROWS_PER_TILE: usize = TILE as usize;

/// A view's samples and tiles in a device's memory.
#[derive(Debug)]
pub struct TracePattern {
    pub(in crate::trace) samples: Buffer<u32>,
    pub(super) tiles: Buffer<u32>,
    pub(super) order: Vec<u32>,
    pub(super) tiles_x: u32,
    pub(super) whole: Part,
}

/// The blocks that touch tiles which parts that follow each other deliver, and that none of them traces.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Ring {
    /// The blocks' tiles, each with those of its blocks left out that touch none.
    pub tiles: Vec<u32>,
    /// How many blocks there are.
    pub blocks: u32,
}

impl TracePattern {
    /// All of it.
    pub fn whole(&self) -> &Part {
        &self.whole
    }

    /// What lies around parts that follow each other.
    pub(super) fn ring(&self, parts: &[Part]) -> Ring {
        let (Some(first), Some(last)) = (parts.first(), parts.last()) else { return Ring::default() };
        if first.first_traced == 0 && last.tiles.end as usize == self.order.len() {
            // Around the whole view there is nothing, and this is asked for in each frame.
            return Ring::default();
        }
        let (across, down) = (self.tiles_x, self.order.len() as u32 / self.tiles_x.max(1));
        let mut traced = vec![false; self.order.len()];
        let order = |from: u32| &self.order[from as usize..last.tiles.end as usize];
        order(first.first_traced).iter().for_each(|&tile| traced[tile as usize] = true);
        let mut wanted: Vec<u32> = vec![0; self.order.len()];
        let mut ring = Vec::new();
        for &tile in order(first.tiles.start) {
            let (tile_x, tile_y) = (tile % across, tile / across);
            for y in tile_y.saturating_sub(1)..(tile_y + 2).min(down) {
                for x in tile_x.saturating_sub(1)..(tile_x + 2).min(across) {
                    let next = y * across + x;
                    if traced[next as usize] {
                        continue;
                    }
                    let blocks = &mut wanted[next as usize];
                    if *blocks == 0 {
                        ring.push(next);
                    }
                    *blocks |= LEFT_RIGHT[(x + 1 - tile_x) as usize] & UPPER_LOWER[(y + 1 - tile_y) as usize];
                }
            }
        }
        let count = ring.iter().map(|&tile| wanted[tile as usize].count_ones()).sum();
        ring.iter_mut().for_each(|tile| *tile |= (!wanted[*tile as usize] & ALL_BLOCKS) << LEFT_OUT_SHIFT);
        Ring { tiles: ring, blocks: count }
    }
}
