//! The pass that brings a picture to a window.

use bytemuck::{Pod, Zeroable};

use super::LensWarp;
use crate::error::Result;
use crate::gpu::vulkan::{
    BufferRef, Commands, Context, DeviceBuffer, Format, PassPipeline, Rect, Shader, Target,
};

const SHADER: Shader = Shader {
    name: "panel.wgsl",
    words: include_bytes!(concat!(env!("OUT_DIR"), "/panel.spv")),
    buffers: 1,
    push: size_of::<Parameters>() as u32,
};

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Parameters {
    target_centre: [f32; 2],
    units: [f32; 2],
    source_centre: [f32; 2],
    source_units: [f32; 2],
    coefficients: [f32; 4],
    colours: [[f32; 2]; 3],
    corner: [u32; 2],
    size: [u32; 2],
    stride: u32,
    padding: u32,
}

/// Draws pictures through warps.
pub struct PanelPass {
    context: Context,
    pipeline: PassPipeline,
    /// The picture, where the shader can read it; as large as the largest so far.
    copy: Option<DeviceBuffer>,
}

impl PanelPass {
    /// A pass for targets of a format that takes colours as they are.
    ///
    /// # Errors
    /// [`crate::Error::Kernel`] if the driver cannot compile the shader.
    pub fn new(context: &Context, format: Format) -> Result<Self> {
        let pipeline = PassPipeline::new(context, &SHADER, "cover", "through_lens", format)?;
        Ok(PanelPass { context: context.clone(), pipeline, copy: None })
    }

    /// Records drawing `picture`, of format R8G8B8A8, through `warps`, whose rectangles lie in the target
    /// and in the picture.
    ///
    /// # Errors
    /// [`crate::Error::Device`] without memory.
    pub fn record(
        &mut self,
        commands: &mut Commands,
        picture: &Target,
        warps: &[LensWarp],
        target: &Target,
    ) -> Result<()> {
        let bytes = picture.width() as usize * picture.height() as usize * 4;
        let copy = match self.copy.take() {
            Some(copy) if copy.len() >= bytes => copy,
            _ => DeviceBuffer::new(&self.context, bytes)?,
        };
        let buffer = BufferRef::from(&copy);
        self.copy = Some(copy);
        commands.copy_target(picture, &buffer);
        commands.barrier();
        for warp in warps {
            let [x, y, width, height] = warp.target;
            let parameters = parameters(warp, picture);
            let rect = Rect { x, y, width, height };
            commands.draw(&self.pipeline, target, rect, &[Some(&buffer)], bytemuck::bytes_of(&parameters))?;
        }
        Ok(())
    }
}

fn parameters(warp: &LensWarp, picture: &Target) -> Parameters {
    let [left, top, width, height] = warp.source;
    let inside = left + width <= picture.width() && top + height <= picture.height();
    assert!(inside, "{:?} lies in the picture", warp.source);
    let pair = |v: [f64; 2]| v.map(|v| v as f32);
    Parameters {
        target_centre: pair(warp.target_centre),
        units: pair(warp.units),
        source_centre: pair(warp.source_centre),
        source_units: pair(warp.source_units),
        coefficients: warp.coefficients.map(|v| v as f32),
        colours: warp.colours.map(pair),
        corner: [left, top],
        size: [width, height],
        stride: picture.width(),
        padding: 0,
    }
}
