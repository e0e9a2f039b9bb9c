//! Rows of a view whose tables one binding reaches.

use std::sync::Arc;

use crate::error::Result;
use crate::gpu::vulkan::{BufferRef, Context, DeviceBuffer};
use crate::layout::VisibilityRecord;
use crate::trace::pattern_maker::Neighbours;

/// Rows of the view whose tables are in buffers of their own, each within one binding's reach.
pub(in crate::reconstruct) struct Band {
    pub first_row: u32,
    pub rows: u32,
    /// `[neighbour][pixel]`: indices of samples, nearest first.
    pub indices: BufferRef,
    /// `[neighbour][pixel]`: weights.
    pub weights: BufferRef,
    /// The samples that the indices name lie in this range.
    pub first_sample: u32,
    pub samples: usize,
    /// Who lends the memory, if it is not this room's: not written to as long as it is kept.
    pub lent: Option<Arc<Neighbours>>,
}

/// A buffer of the device's own.
pub(super) fn device(context: &Context, size: usize) -> Result<BufferRef> {
    Ok(BufferRef::from(&DeviceBuffer::new(context, size)?))
}

/// Rows of each band: as many as one binding reaches, for tables of `k` and for visibility.
pub(super) fn band_rows(context: &Context, (width, height): (u32, u32), k: u32) -> Vec<(u32, u32)> {
    let row = u64::from(width) * u64::from(4 * k).max(size_of::<VisibilityRecord>() as u64);
    // After 64 rows of words a part begins at a multiple of 256 bytes, the most that a device asks for.
    let rows = (context.storage_range() / row / 64 * 64).clamp(64, u64::from(height.next_multiple_of(64)));
    (0..height).step_by(rows as usize).map(|first| (first, (rows as u32).min(height - first))).collect()
}

pub(super) fn empty_bands(context: &Context, size: (u32, u32), k: u32) -> Result<Vec<Band>> {
    band_rows(context, size, k)
        .into_iter()
        .map(|(first_row, rows)| {
            let bytes = size.0 as usize * rows as usize * k as usize * 4;
            Ok(Band {
                first_row,
                rows,
                indices: device(context, bytes)?,
                weights: device(context, bytes)?,
                first_sample: 0,
                samples: 0,
                lent: None,
            })
        })
        .collect()
}
