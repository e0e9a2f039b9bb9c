//! The pass over the pixels of a view, band by band.
//!
//! **A fragment shader for pixels.** Swapchains of sRGB formats cannot be storage images, but they are always
//! colour targets; on lavapipe both cost the same.

use super::parameters::{PixelParameters, encoding};
use super::settings::PREPARED_BYTES;
use super::tables::{Band, Tables};
use super::{Frame, Mode, Output, Settings};
use crate::error::{Error, Result};
use crate::gpu::vulkan::{BufferRef, Commands, PassPipeline, Rect};
use crate::layout::VisibilityRecord;

/// Records the pass over the pixels of one output, band by band.
pub(super) fn draw(
    commands: &mut Commands,
    pass: &PassPipeline,
    tables: &Tables,
    settings: &Settings,
    frame: &Frame<'_>,
    output: &Output<'_>,
    (parameters, warp): (PixelParameters, &BufferRef),
) -> Result<()> {
    let Rect { x, y, width, height } = output.rect;
    let source_y = output.source[1];
    output.require_inside(tables.width, tables.height);
    let [shift_x, shift_y] = output.shift();
    for band in tables.bands() {
        let first = band.first_row.max(source_y);
        let end = (band.first_row + band.rows).min(source_y + height);
        if first >= end {
            continue;
        }
        let parameters = PixelParameters {
            shift_x,
            shift_y,
            first_row: band.first_row,
            rows: band.rows,
            first_sample: band.first_sample,
            exposure: output.factor(frame.exposure),
            encoding: encoding(output.encoding),
            ..parameters
        };
        let first_sample = band.first_sample as usize;
        let prepared = tables.prepared().part(first_sample * PREPARED_BYTES, band.samples * PREPARED_BYTES);
        let positions = tables.positions().part(first_sample * 4, band.samples * 4);
        let visibility = visible_rows(frame, settings, tables, band)?;
        let buffers = [
            Some(&prepared),
            Some(&band.indices),
            Some(&band.weights),
            Some(&positions),
            visibility.as_ref(),
            Some(tables.nearest().unwrap_or(&positions)),
            Some(warp),
            None,
        ];
        let rect = Rect { x, y: y + first - source_y, width, height: end - first };
        commands.draw(pass, output.target, rect, &buffers, bytemuck::bytes_of(&parameters))?;
    }
    Ok(())
}

/// The band's part of the frame's visibility; none where it is not used.
pub(super) fn visible_rows(
    frame: &Frame<'_>,
    settings: &Settings,
    tables: &Tables,
    band: &Band,
) -> Result<Option<BufferRef>> {
    if settings.mode == Mode::KNearest {
        return Ok(None);
    }
    let row = tables.width as usize * size_of::<VisibilityRecord>();
    let (first, size) = (band.first_row as usize * row, band.rows as usize * row);
    match &frame.visibility {
        Some(visibility) if visibility.size() >= first + size => Ok(Some(visibility.part(first, size))),
        _ => Err(Error::setting(
            "reconstruct",
            "guided reconstruction needs a visibility record for each pixel; trace them, or use k-nn",
        )),
    }
}
