//! The samples nearest to each pixel and to each sample, found by a processor that traces, for a presenting device that is the
//! same processor: `kernels/cpu/neighbours.cl`. OpenCL's vectors of 16 points take a quarter of the time there that
//! `kernels/neighbours.wgsl` takes, which llvmpipe runs a lane at a time where it reads and writes. Elsewhere the latter is used.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::foveation::Cells;
use crate::gpu::interop::Shared;
use crate::gpu::opencl::{Buffer, Device, Program};
use crate::gpu::vulkan::{BufferRef, Context, DeviceKind};
use crate::layout::VisibilityRecord;
use crate::reference::reconstruct::{self, WeightKind};
use crate::trace::kernels::{Grid, NearestToPixels, NearestToSamples};
use crate::trace::source;

/// Pixels of a block, and samples, that a work-item takes.
const LANES: usize = 16;
/// Work-items of a group.
const GROUP: usize = 8;

/// What is looked for: settings of the reconstruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NeighbourLists {
    /// Neighbours of each pixel.
    pub of_pixel: u32,
    /// Neighbours of each sample, itself included; fewer than 2 for none.
    pub of_sample: u32,
    /// How a pixel's neighbours weigh: kernels know it by its number, 0, 1 or 2.
    pub weights: WeightKind,
}

/// The neighbours of a pattern, in memory that the presenting device reads as long as somebody keeps this.
pub struct Neighbours {
    indices: Shared<u32>,
    weights: Shared<f32>,
    of_samples: Shared<u32>,
    /// What was looked for.
    pub lists: NeighbourLists,
}

impl Neighbours {
    /// Whether a device finds neighbours faster than the presenting device: where both are processors.
    pub fn is_faster_on(device: &Device, context: &Context) -> bool {
        device.info().kind == "cpu" && context.report().kind == DeviceKind::Cpu
    }

    fn new(
        device: &Device,
        context: &Context,
        lists: NeighbourLists,
        pixels: usize,
        samples: usize,
    ) -> Result<Self> {
        // A gaze that moves needs a few more here and there.
        let room = |len: usize| len / 4 * 5 + 16;
        let of_pixels = room(pixels) * lists.of_pixel as usize;
        Ok(Neighbours {
            indices: Shared::new(Some(device), context, of_pixels)?,
            weights: Shared::new(Some(device), context, of_pixels)?,
            of_samples: Shared::new(Some(device), context, room(samples) * lists.of_sample as usize)?,
            lists,
        })
    }

    /// Whether there is room for the lists of so many.
    pub fn fits(&self, pixels: usize, samples: usize) -> bool {
        let NeighbourLists { of_pixel, of_sample, .. } = self.lists;
        pixels * of_pixel as usize <= self.indices.len()
            && samples * of_sample as usize <= self.of_samples.len()
    }

    /// For so many pixels `[neighbour][pixel]`: indices of samples, nearest first, and weights, which sum to 1.
    pub fn of_pixels(&self, pixels: usize) -> [BufferRef; 2] {
        let bytes = pixels * self.lists.of_pixel as usize * size_of::<u32>();
        [self.indices.vulkan().part(0, bytes), self.weights.vulkan().part(0, bytes)]
    }

    /// For so many samples `[neighbour][sample]`: indices of samples, nearest first. None where they were not looked for.
    pub fn of_samples(&self, samples: usize) -> Option<BufferRef> {
        let bytes = samples * self.lists.of_sample as usize * size_of::<u32>();
        (self.lists.of_sample > 1).then(|| self.of_samples.vulkan().part(0, bytes))
    }

    /// Whether the lists of every 97th pixel and sample of a view are the reference's, and weights nearly.
    pub(super) fn are_right(&self, [width, height]: [u32; 2], samples: &[u32]) -> bool {
        let NeighbourLists { of_pixel, of_sample, weights } = self.lists;
        let (pixels, count) = ((width * height) as usize, samples.len());
        let positions: Vec<[u32; 2]> =
            samples.iter().map(|&packed| [packed & 0xffff, packed >> 16]).collect();
        let of_pixels = (0..pixels).step_by(97).all(|pixel| {
            let places = (0..of_pixel as usize).map(|j| j * pixels + pixel);
            let (indices, shares) = (self.indices.at(places.clone()), self.weights.at(places));
            let at = [pixel as u32 % width, pixel as u32 / width];
            let expected = reconstruct::weights(&positions, at, of_pixel as usize, weights);
            let is = |((&index, &share), &(sample, weight)): ((&u32, &f32), &(usize, f64))| {
                index as usize == sample && (f64::from(share) - weight).abs() < 1e-3
            };
            indices.iter().zip(&shares).zip(&expected).all(is)
        });
        let are_those = |sample: usize| {
            let own = self.of_samples.at((0..of_sample as usize).map(|j| j * count + sample));
            let expected = reconstruct::nearest(&positions, positions[sample], own.len());
            own.iter().zip(&expected).all(|(&own, other)| own as usize == other.sample)
        };
        of_pixels && (of_sample < 2 || (0..count).step_by(97).all(are_those))
    }
}

/// Samples of a pattern in a device's memory.
pub(super) struct SampleBuffers<'a> {
    /// The view's width and height in pixels.
    pub size: [u32; 2],
    pub count: usize,
    /// Positions, `x | y << 16`.
    pub samples: &'a Buffer<u32>,
    /// The same with indices, cell by cell.
    pub sorted: &'a Buffer<[u32; 2]>,
    /// The first of each cell, from `first_start` on.
    pub starts: &'a Buffer<u32>,
    pub first_start: u32,
    /// Cells are `1 << shift` pixels wide.
    pub shift: u32,
}

/// The kernels, and the memory of patterns that were looked at before.
pub(super) struct Finder {
    device: Device,
    context: Context,
    lists: NeighbourLists,
    nearest_to_pixels: NearestToPixels,
    nearest_to_samples: NearestToSamples,
    kept: Vec<Arc<Neighbours>>,
}

impl Finder {
    /// Builds the kernels. The device has to see the presenting device's memory.
    ///
    /// # Errors
    /// [`crate::Error::Kernel`] or [`crate::Error::Device`] where the device does not take them.
    pub fn new(device: &Device, context: &Context, lists: NeighbourLists) -> Result<Self> {
        let text = source::neighbours_text(lists.of_pixel, lists.of_sample);
        let program = Program::build(device, "neighbours", &text, "-cl-std=CL1.2")?;
        Ok(Finder {
            device: device.clone(),
            context: context.clone(),
            lists,
            nearest_to_pixels: NearestToPixels::of(&program)?,
            nearest_to_samples: NearestToSamples::of(&program)?,
            kept: Vec::new(),
        })
    }

    /// Puts the searches into the queue. None where lists would be longer than there are samples, or tables longer than one
    /// binding reaches, or where there is no room: then the presenting device has ways of its own.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device fails.
    pub fn find(&mut self, buffers: &SampleBuffers) -> Result<Option<Arc<Neighbours>>> {
        let NeighbourLists { of_pixel, of_sample, weights } = self.lists;
        let [width, height] = buffers.size;
        let (pixels, count) = (width as usize * height as usize, buffers.count);
        let word = size_of::<u32>();
        let pixel = size_of::<VisibilityRecord>().max(word * of_pixel as usize);
        let longest = (pixels * pixel).max(count * word * of_sample as usize);
        if count <= of_pixel.max(of_sample) as usize || longest as u64 > self.context.storage_range() {
            return Ok(None);
        }
        let Ok(found) = self.room(pixels, count) else { return Ok(None) };
        let (Some(indices), Some(pixel_weights), Some(nearest)) =
            (found.indices.opencl(), found.weights.opencl(), found.of_samples.opencl())
        else {
            return Ok(None);
        };
        let SampleBuffers { samples, sorted, starts, first_start, shift, .. } = *buffers;
        let grid = |items: usize| Grid { items, group: GROUP };
        let blocks = width.div_ceil(4) as usize * height.div_ceil(4) as usize;
        let count = count as u32;
        self.nearest_to_pixels.launch(
            grid(blocks),
            width,
            height,
            count,
            shift,
            weights as u32,
            sorted,
            starts,
            first_start,
            indices,
            pixel_weights,
        )?;
        if of_sample > 1 {
            let runs = (count as usize).div_ceil(LANES);
            self.nearest_to_samples.launch(
                grid(runs),
                width,
                height,
                count,
                shift,
                sorted,
                starts,
                first_start,
                samples,
                nearest,
            )?;
        }
        Ok(Some(found))
    }

    /// Memory that nobody keeps.
    fn room(&mut self, pixels: usize, samples: usize) -> Result<Arc<Neighbours>> {
        let is_free = |kept: &Arc<Neighbours>| Arc::strong_count(kept) == 1;
        if let Some(free) = self.kept.iter().find(|kept| is_free(kept) && kept.fits(pixels, samples)) {
            return Ok(free.clone());
        }
        // Views have become larger, or there are more of them.
        self.kept.retain(|kept| !is_free(kept));
        let room = Arc::new(Neighbours::new(&self.device, &self.context, self.lists, pixels, samples)?);
        self.kept.push(room.clone());
        Ok(room)
    }
}

impl Drop for Finder {
    fn drop(&mut self) {
        // Kernels may still write where a pattern was given up; OpenCL does not keep memory that was Vulkan's.
        if self.device.finish().is_err() {
            std::mem::take(&mut self.kept).into_iter().for_each(std::mem::forget);
        }
    }
}

/// A pattern's samples in order for searches, or the searches done.
pub enum PatternTables {
    /// Sorted into cells.
    Cells(Cells),
    /// Neighbours found.
    Neighbours(Arc<Neighbours>),
}

#[cfg(test)]
mod tests;
