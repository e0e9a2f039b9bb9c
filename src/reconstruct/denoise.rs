//! Light without its noise: `kernels/denoise.wgsl`.
//!
//! **A width that follows noise.** Sparse samples are averaged over 24 neighbours, and where that leaves more noise than is
//! seen, over neighbours' neighbours: up to 0.2 JOD are gained with 8 rays, and nothing with 128. Samples of less noise, among them
//! more and more of a view at rest, are passed by. Where each pixel has a sample, there is detail of a pixel's size to lose: means over
//! 5 x 5 pixels that lie 1, 2 and 4 apart take the neighbours' place, as far as rays' variance and second differences say that
//! there is noise. The former alone took edges for noise at 1024 rays of the tests' still life as the latter alone did: 0.017 and
//! 0.027 off, both 0.008. Views of more pixels than one binding reaches stay as noisy as they are.

use bytemuck::{Pod, Zeroable};

use super::parameters::{PackedSpacing, Rays};
use super::settings::GuidedSettings;
use super::shaders;
use super::tables::Tables;
use crate::error::Result;
use crate::gpu::vulkan::{BufferRef, Commands, ComputePipeline, Context};
use crate::layout::SampleRecord;

/// How many pixels those lie apart that each pass averages.
const STRIDES: [u32; 3] = [1, 2, 4];
/// Pixels across and down a work-group.
const GROUP: u32 = 8;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct DenoiseParameters {
    rays: Rays,
    spacing: PackedSpacing,
    width: u32,
    height: u32,
    count: u32,
    neighbours: u32,
    stride: u32,
    measures: u32,
    normal_power: f32,
    plane_tolerance: f32,
    pixel_width: f32,
    least_expected: f32,
}

pub(super) struct Denoise {
    guided: GuidedSettings,
    pixels: ComputePipeline,
    samples: ComputePipeline,
}

impl Denoise {
    pub fn new(context: &Context, guided: GuidedSettings) -> Result<Self> {
        let pipeline = |entry| ComputePipeline::new(context, &shaders::DENOISE, entry);
        Ok(Denoise { guided, pixels: pipeline("denoise_pixels")?, samples: pipeline("denoise_samples")? })
    }

    /// Records the passes over what [`super::samples::Prepare`] has written of `samples`.
    pub fn record(
        &self,
        context: &Context,
        commands: &mut Commands,
        tables: &mut Tables,
        samples: &BufferRef,
        (rays, spacing, pixel_width, least_expected): (Rays, PackedSpacing, f32, f32),
    ) -> Result<()> {
        let (width, height) = (tables.width, tables.height);
        let reached =
            |_: &&BufferRef| (tables.count * size_of::<SampleRecord>()) as u64 <= context.storage_range();
        let sample_of_pixel = tables.sample_of_pixel().filter(reached).cloned();
        let nearest = tables.nearest().cloned();
        let parameters = DenoiseParameters {
            rays,
            spacing,
            width,
            height,
            count: tables.count as u32,
            neighbours: tables.neighbours,
            stride: 1,
            measures: 0,
            normal_power: self.guided.normal_power,
            plane_tolerance: self.guided.plane_tolerance,
            pixel_width,
            least_expected,
        };
        let positions = tables.positions().clone();
        let mut run = |pipeline, indices: &BufferRef, parameters: DenoiseParameters, groups| {
            commands.barrier();
            let [noisy, prepared] = tables.next_prepared(context)?;
            let buffers = [Some(&noisy), Some(&prepared), Some(samples), Some(indices), Some(&positions)];
            commands.dispatch(pipeline, &buffers, bytemuck::bytes_of(&parameters), groups)
        };
        if let Some(sample_of_pixel) = sample_of_pixel {
            let groups = [width.div_ceil(GROUP), height.div_ceil(GROUP), 1];
            for (pass, stride) in STRIDES.into_iter().enumerate() {
                let parameters = DenoiseParameters { stride, measures: u32::from(pass == 0), ..parameters };
                run(&self.pixels, &sample_of_pixel, parameters, groups)?;
            }
        } else if let Some(nearest) = nearest {
            run(&self.samples, &nearest, parameters, [parameters.count.div_ceil(GROUP * GROUP), 1, 1])?;
        }
        Ok(())
    }
}
