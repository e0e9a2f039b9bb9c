//! Pictures of views whose pixels are farther apart than their pictures': each pixel of the view is shaded once, and the
//! picture's are made between them.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use bytemuck::{Pod, Zeroable};

use super::parameters::{PixelParameters, Rays, encoding};
use super::tables::Tables;
use super::{Frame, NEAREST_DEPTH, Output, shaders};
use crate::error::Result;
use crate::gpu::vulkan::{
    Attachments, BufferRef, Commands, ComputePipeline, Context, DeviceBuffer, PassPipeline,
};

/// Bytes of a shaded pixel.
const SHADED_BYTES: usize = 8;

/// The shaders.
pub(super) struct Magnify {
    shade: ComputePipeline,
    passes: HashMap<Attachments, PassPipeline>,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct MagnifyParameters {
    rays: Rays,
    shift_x: i32,
    shift_y: i32,
    width: u32,
    height: u32,
    exposure: f32,
    encoding: u32,
    nearest_depth: f32,
}

/// Memory for a view's shaded pixels: what it has, where that is large enough.
pub(super) fn room(context: &Context, kept: &mut Option<BufferRef>, pixels: usize) -> Result<BufferRef> {
    let bytes = pixels * SHADED_BYTES;
    match kept {
        Some(buffer) if buffer.size() >= bytes => Ok(buffer.clone()),
        _ => Ok(kept.insert(BufferRef::from(&DeviceBuffer::new(context, bytes)?)).clone()),
    }
}

impl Magnify {
    /// Builds the shader that shades pixels.
    pub fn new(context: &Context) -> Result<Self> {
        let shade = ComputePipeline::new(context, &shaders::RECONSTRUCT, "shade_pixels")?;
        Ok(Magnify { shade, passes: HashMap::new() })
    }

    /// Builds the shader for such targets.
    pub fn require_pass(&mut self, context: &Context, to: Attachments) -> Result<()> {
        if let Entry::Vacant(missing) = self.passes.entry(to) {
            let fragment = if to.depth.is_some() { "magnified_with_depth" } else { "magnified" };
            missing.insert(PassPipeline::new(context, &shaders::MAGNIFY, "cover", fragment, to)?);
        }
        Ok(())
    }

    /// Records shading the view's pixels, with the view's `warp` and to its `shaded`.
    ///
    /// # Panics
    /// If the view's tables are in several bands, or there is no visibility.
    pub fn shade(
        &self,
        commands: &mut Commands,
        tables: &Tables,
        frame: &Frame<'_>,
        parameters: PixelParameters,
        [warp, shaded]: [&BufferRef; 2],
    ) -> Result<()> {
        let [band] = tables.bands() else { panic!("the view is too large to be spaced unevenly") };
        assert!(frame.visibility.is_some(), "a view that is spaced unevenly needs its visibility");
        let buffers = [
            Some(tables.prepared()),
            Some(&band.indices),
            Some(&band.weights),
            Some(tables.positions()),
            frame.visibility.as_ref(),
            Some(tables.nearest().unwrap_or(tables.positions())),
            Some(warp),
            Some(shaded),
        ];
        let groups = [tables.width.div_ceil(64), tables.height, 1];
        commands.dispatch(&self.shade, &buffers, bytemuck::bytes_of(&parameters), groups)?;
        commands.end_stage("shade pixels");
        Ok(())
    }

    /// Records the pass over the picture's pixels of one output.
    ///
    /// # Panics
    /// If it reaches beyond target or picture.
    pub fn draw(
        &self,
        commands: &mut Commands,
        tables: &Tables,
        frame: &Frame<'_>,
        output: &Output<'_>,
        rays: Rays,
        [warp, shaded]: [&BufferRef; 2],
    ) -> Result<()> {
        let picture = frame.view.picture();
        output.require_inside(picture.width, picture.height);
        let [shift_x, shift_y] = output.shift();
        let parameters = MagnifyParameters {
            rays,
            shift_x,
            shift_y,
            width: frame.view.width,
            height: frame.view.height,
            exposure: output.factor(frame.exposure),
            encoding: encoding(output.encoding),
            nearest_depth: NEAREST_DEPTH,
        };
        let (visibility, indices) = (frame.visibility.as_ref(), &tables.bands()[0].indices);
        let buffers = [Some(shaded), visibility, Some(warp), Some(indices), Some(tables.positions())];
        let pass = &self.passes[&output.target.attachments()];
        commands.draw(pass, output.target, output.rect, &buffers, bytemuck::bytes_of(&parameters))
    }
}
