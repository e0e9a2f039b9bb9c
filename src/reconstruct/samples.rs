//! The pass over the samples: what is not finite is taken out; guided, each is averaged with its neighbours.
//!
//! **Filtering at the samples.** Guided reconstruction averages 24 neighbours, but not at each pixel: each
//! sample is averaged with its neighbours once (`filter_samples`), and a pixel then needs only its 4 nearest.
//! There are about 19 times fewer samples than pixels, so the wide filter costs little. It leaves each sample
//! in 32 bytes, of which most pixels read 16: light as R9 G9 B8 with an exponent. Holes are filled at the
//! same place, and a pixel that finds no sample on its surface looks at the neighbours of its nearest one.

use super::parameters::{FilterParameters, PackedSpacing, Rays};
use super::settings::PREPARED_BYTES;
use super::tables::Tables;
use super::{Mode, Settings, shaders};
use crate::error::Result;
use crate::gpu::vulkan::{BufferRef, Commands, ComputePipeline, Context};
use crate::layout::SampleRecord;

/// Samples that one dispatch of a pass without neighbours takes.
const SAMPLES_AT_ONCE: usize = 1 << 21;

pub(super) struct Prepare {
    take: ComputePipeline,
    filter: Option<ComputePipeline>,
}

impl Prepare {
    pub fn new(context: &Context, settings: &Settings) -> Result<Self> {
        let pipeline = |entry| ComputePipeline::new(context, &shaders::FILTER, entry);
        Ok(match settings.mode {
            Mode::KNearest => Prepare { take: pipeline("take_radiance")?, filter: None },
            Mode::Guided(guided) if guided.neighbours == 1 => {
                Prepare { take: pipeline("take_records")?, filter: None }
            }
            Mode::Guided(_) => {
                Prepare { take: pipeline("take_records")?, filter: Some(pipeline("filter_samples")?) }
            }
        })
    }

    /// Records the pass over the samples.
    pub fn record(
        &self,
        commands: &mut Commands,
        tables: &Tables,
        settings: &Settings,
        samples: &BufferRef,
        dropped: &BufferRef,
        (rays, spacing, pixel_width, least_expected): (Rays, PackedSpacing, f32, f32),
    ) -> Result<()> {
        let guided = settings.guided();
        let mut parameters = FilterParameters {
            rays,
            spacing,
            count: tables.count as u32,
            neighbours: tables.neighbours,
            normal_power: guided.normal_power,
            plane_tolerance: guided.plane_tolerance,
            first_deviation: guided.first_deviation,
            second_deviation: guided.second_deviation,
            pixel_width,
            least_expected,
        };
        if let (Some(filter), Some(nearest)) = (&self.filter, tables.nearest()) {
            let buffers = [
                Some(samples),
                Some(tables.prepared()),
                Some(dropped),
                Some(tables.positions()),
                Some(nearest),
            ];
            let groups = [parameters.count.div_ceil(64), 1, 1];
            return commands.dispatch(filter, &buffers, bytemuck::bytes_of(&parameters), groups);
        }
        let stride = PREPARED_BYTES;
        for first in (0..tables.count).step_by(SAMPLES_AT_ONCE) {
            let count = SAMPLES_AT_ONCE.min(tables.count - first);
            parameters.count = count as u32;
            let size = size_of::<SampleRecord>();
            let from = samples.part(first * size, count * size);
            let to = tables.prepared().part(first * stride, count * stride);
            let buffers = [Some(&from), Some(&to), Some(dropped), None, None];
            let groups = [parameters.count.div_ceil(64), 1, 1];
            commands.dispatch(&self.take, &buffers, bytemuck::bytes_of(&parameters), groups)?;
        }
        Ok(())
    }
}
