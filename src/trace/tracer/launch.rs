//! What a frame launches on a device: the kernels of pixels, of edges and of samples, each with its arguments.

use super::pattern::BLOCKS_PER_TILE;
use super::{TracePattern, Tracer};
use crate::error::Result;
use crate::foveation::workload::{Part, TILE_PIXELS};
use crate::gpu::opencl::{Arg, Buffer, Event, Kernel};
use crate::layout::{self, MEET_BLENDS, SampleRecord, VisibilityRecord};

impl Tracer {
    /// Traces and describes the pixels of all parts, and of the ring of blocks around them where edges want to
    /// know their neighbours. The events of each part, and how many camera rays there were.
    pub(super) fn trace_tiles(
        &self,
        camera: &layout::Camera,
        shading: &layout::Shading,
        edge_rays: u32,
        pattern: &TracePattern,
        parts: &[Part],
        records: &Buffer<VisibilityRecord>,
    ) -> Result<(Vec<Vec<Event>>, u64)> {
        let starts = parts.iter().enumerate().map(|(index, part)| match index {
            0 => part.first_traced,
            _ => part.tiles.start,
        });
        let (mut events, mut traced) = (Vec::with_capacity(parts.len()), 0);
        for (part, first) in parts.iter().zip(starts) {
            let count = part.tiles.end - first;
            traced += count * TILE_PIXELS;
            events.push(self.describe(camera, shading, edge_rays, &pattern.tiles, first, count, records)?);
        }
        if edge_rays > 0 {
            let (ring, blocks) = pattern.ring(parts);
            if !ring.is_empty() {
                traced += blocks * TILE_PIXELS / BLOCKS_PER_TILE as u32;
                let list = Buffer::from_slice(&self.device, &ring)?;
                let around =
                    self.describe(camera, shading, edge_rays, &list, 0, ring.len() as u32, records)?;
                events[0].extend(around);
            }
            for (part, events) in parts.iter().zip(&mut events) {
                events.push(self.share_edges(camera, edge_rays, pattern, part, records)?);
                if self.may_blend {
                    events.push(self.share_blends(camera, pattern, part, records)?);
                }
            }
        }
        let pixels = u64::from(camera.width) * u64::from(camera.height);
        Ok((events, u64::from(traced).min(pixels)))
    }

    /// Finds the hits of the pixels of tiles `first..first + count` of a list, and describes them. Where neighbours
    /// are known, as edges need them, BLEND surfaces are shared between pixels.
    #[allow(clippy::too_many_arguments)]
    fn describe(
        &self,
        camera: &layout::Camera,
        shading: &layout::Shading,
        edge_rays: u32,
        list: &Buffer<u32>,
        first: u32,
        count: u32,
        records: &Buffer<VisibilityRecord>,
    ) -> Result<Vec<Event>> {
        let tiles = [Arg::buffer(list), Arg::U32(first), Arg::U32(count)];
        let group = self.traversals.pixels.group();
        let items = self.traversals.pixels.items_of_blocks(count as usize * BLOCKS_PER_TILE);
        let mut args = self.scene.args(self.traversals.pixels);
        args.push(Arg::value(camera));
        args.extend(tiles);
        args.push(Arg::buffer(&self.hits));
        let blends = self.may_blend && edge_rays > 0;
        args.push(Arg::U32(if blends { MEET_BLENDS } else { camera.seed }));
        let mut events = vec![self.trace_pixels.launch(&args, items, group)?];
        if blends {
            args.pop();
            args.push(Arg::buffer(&self.alphas));
            events.push(self.settle_blends.launch(&args, items, group)?);
        }
        let mut args = self.scene.args(self.traversals.pixels);
        args.extend([Arg::value(camera), Arg::value(shading)]);
        args.extend(tiles);
        args.extend([Arg::buffer(&self.hits), Arg::buffer(records), Arg::buffer(&self.counters)]);
        events.push(self.describe_pixels.launch(&args, items, group)?);
        Ok(events)
    }

    /// Launches a kernel over the pixels of a part's own tiles.
    fn launch_pixels(&self, kernel: &Kernel, args: &[Arg<'_>], part: &Part) -> Result<Event> {
        let traversal = self.traversals.pixels;
        kernel.launch(args, traversal.items_of_blocks(part.tiles.len() * BLOCKS_PER_TILE), traversal.group())
    }

    fn share_blends(
        &self,
        camera: &layout::Camera,
        pattern: &TracePattern,
        part: &Part,
        records: &Buffer<VisibilityRecord>,
    ) -> Result<Event> {
        let args = [
            Arg::value(camera),
            Arg::buffer(&pattern.tiles),
            Arg::U32(part.tiles.start),
            Arg::U32(part.tiles.len() as u32),
            Arg::buffer(&self.alphas),
            Arg::buffer(records),
        ];
        self.launch_pixels(&self.share_blends, &args, part)
    }

    pub(super) fn share_edges(
        &self,
        camera: &layout::Camera,
        rays: u32,
        pattern: &TracePattern,
        part: &Part,
        records: &Buffer<VisibilityRecord>,
    ) -> Result<Event> {
        let mut args = self.scene.args(self.traversals.pixels);
        args.extend([
            Arg::value(camera),
            Arg::U32(rays),
            Arg::buffer(&pattern.tiles),
            Arg::U32(part.tiles.start),
            Arg::U32(part.tiles.len() as u32),
            Arg::buffer(&self.hits),
            Arg::buffer(records),
            Arg::buffer(&self.counters),
        ]);
        self.launch_pixels(&self.share_edges, &args, part)
    }

    pub(super) fn trace_only_samples(
        &self,
        camera: &layout::Camera,
        pattern: &TracePattern,
        part: &Part,
    ) -> Result<Event> {
        let mut args = self.scene.args(self.traversals.pixels);
        args.extend([
            Arg::value(camera),
            Arg::buffer(&pattern.samples),
            Arg::U32(part.samples.start),
            Arg::U32(part.samples.len() as u32),
            Arg::buffer(&self.hits),
        ]);
        let traversal = self.traversals.pixels;
        let items = traversal.items_of_samples(part.samples.len(), &self.device);
        self.trace_samples.launch(&args, items, traversal.group_of_streams())
    }

    pub(super) fn shade(
        &self,
        camera: &layout::Camera,
        shading: &layout::Shading,
        pattern: &TracePattern,
        part: &Part,
        visibility: Option<&Buffer<VisibilityRecord>>,
        samples: &Buffer<SampleRecord>,
    ) -> Result<Event> {
        let mut args = self.scene.args(self.traversals.bundles);
        args.extend([
            Arg::value(camera),
            Arg::value(shading),
            Arg::buffer(&pattern.samples),
            Arg::U32(part.samples.start),
            Arg::U32(part.samples.len() as u32),
            Arg::buffer(&self.hits),
            visibility.map_or(Arg::NONE, Arg::buffer),
            Arg::buffer(samples),
        ]);
        args.extend(self.light.args());
        args.push(Arg::buffer(&self.counters));
        let traversal = self.traversals.bundles;
        let items = traversal.items_of_streams(part.samples.len(), &self.device);
        self.shade_samples.launch(&args, items, traversal.group_of_streams())
    }
}
