//! What a frame launches on a device: the kernels of pixels, of edges and of samples, each with its arguments.

use super::hardware::Tiles;
use super::pattern::BLOCKS_PER_TILE;
use super::shading::Work;
use super::{Hardware, Pixels, Step, TracePattern, Tracer};
use crate::error::Result;
use crate::foveation::workload::{Part, TILE_PIXELS};
use crate::gpu::opencl::{Buffer, Event};
use crate::layout::{self, HitRecord, MEET_BLENDS, SampleRecord, VisibilityRecord};
use crate::trace::kernels::{Grid, SceneOf};

impl Tracer {
    /// Traces and describes the pixels of all parts, and of the ring of blocks around them where edges want to
    /// know their neighbours: so many tiles of [`Tracer::ring`], and blocks of them. The events of each part, and how many
    /// camera rays there were.
    #[allow(clippy::too_many_arguments)]
    pub(super) fn trace_tiles(
        &self,
        mut hardware: Option<&mut Hardware>,
        camera: &layout::Camera,
        shading: &layout::Shading,
        edge_rays: u32,
        pattern: &TracePattern,
        parts: &[Part],
        (ring, blocks): (u32, u32),
        records: &Buffer<VisibilityRecord>,
    ) -> Result<(Vec<Vec<Step>>, u64)> {
        let starts = parts.iter().enumerate().map(|(index, part)| match index {
            0 => part.first_traced,
            _ => part.tiles.start,
        });
        let (mut events, mut traced) = (Vec::with_capacity(parts.len()), 0);
        for (part, first) in parts.iter().zip(starts) {
            let count = part.tiles.end - first;
            traced += count * TILE_PIXELS;
            let by = hardware.as_deref_mut();
            events.push(self.describe(
                by,
                camera,
                shading,
                edge_rays,
                &pattern.tiles,
                first,
                count,
                records,
            )?);
        }
        if edge_rays > 0 {
            if ring > 0 {
                traced += blocks * TILE_PIXELS / BLOCKS_PER_TILE as u32;
                let around =
                    self.describe(hardware, camera, shading, edge_rays, &self.ring, 0, ring, records)?;
                events[0].extend(around);
            }
            for (part, events) in parts.iter().zip(&mut events) {
                events.push(self.share_edges(camera, edge_rays, pattern, part, records)?.into());
                if self.may_blend {
                    events.push(self.share_blends(camera, pattern, part, records)?.into());
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
        mut hardware: Option<&mut Hardware>,
        camera: &layout::Camera,
        shading: &layout::Shading,
        edge_rays: u32,
        list: &Buffer<u32>,
        first: u32,
        count: u32,
        records: &Buffer<VisibilityRecord>,
    ) -> Result<Vec<Step>> {
        let traversal = self.traversals.pixels;
        let scene = SceneOf(Some(&self.scene), traversal);
        let items = traversal.items_of_blocks(count as usize * BLOCKS_PER_TILE);
        let grid = Grid { items, group: traversal.group() };
        let blends = self.may_blend && edge_rays > 0;
        let seed = if blends { MEET_BLENDS } else { camera.seed };
        let hits = &self.hits;
        let tiles = Tiles { list, first, count };
        let mut events = match hardware.as_deref_mut() {
            Some(by) => by.trace_pixels(&self.device, scene, camera, tiles, hits, seed)?,
            None => {
                vec![self.trace_pixels.launch(grid, scene, camera, list, first, count, hits, seed)?.into()]
            }
        };
        if blends {
            let layers = &self.blends;
            let settled = self.settle_blends.launch(grid, scene, camera, list, first, count, hits, layers)?;
            events.push(settled.into());
        }
        let counters = &self.counters;
        macro_rules! launch {
            ($kernel:expr) => {
                events.push(
                    $kernel
                        .launch(grid, scene, camera, shading, list, first, count, hits, records, counters)?
                        .into(),
                )
            };
        }
        match (&self.trace_sun, hardware.as_deref_mut()) {
            (Some(_), Some(by)) => {
                let view = (camera, shading);
                events.extend(by.trace_sun(&self.device, scene, view, tiles, hits, (records, counters))?);
            }
            (Some(trace_sun), None) => launch!(trace_sun),
            (None, _) => {}
        }
        launch!(self.describe_pixels);
        if let Some(mirrors) = &self.mirrors {
            let pixels = Pixels { scene, camera, shading, tiles, hits, records, counters };
            events.extend(mirrors.enqueue(&self.device, pixels, hardware)?);
        }
        Ok(events)
    }

    /// The pixels of a part's own tiles.
    fn pixels_of(&self, part: &Part) -> Grid {
        let traversal = self.traversals.pixels;
        let items = traversal.items_of_blocks(part.tiles.len() * BLOCKS_PER_TILE);
        Grid { items, group: traversal.group() }
    }

    fn share_blends(
        &self,
        camera: &layout::Camera,
        pattern: &TracePattern,
        part: &Part,
        records: &Buffer<VisibilityRecord>,
    ) -> Result<Event> {
        let (first, count) = (part.tiles.start, part.tiles.len() as u32);
        let grid = self.pixels_of(part);
        self.share_blends.launch(grid, camera, &pattern.tiles, first, count, &self.blends, records)
    }

    pub(super) fn share_edges(
        &self,
        camera: &layout::Camera,
        rays: u32,
        pattern: &TracePattern,
        part: &Part,
        records: &Buffer<VisibilityRecord>,
    ) -> Result<Event> {
        self.share_edges.launch(
            self.pixels_of(part),
            SceneOf(Some(&self.scene), self.traversals.pixels),
            camera,
            rays,
            &pattern.tiles,
            part.tiles.start,
            part.tiles.len() as u32,
            &self.hits,
            records,
            &self.counters,
        )
    }

    pub(super) fn trace_only_samples(
        &self,
        hardware: Option<&mut Hardware>,
        camera: &layout::Camera,
        pattern: &TracePattern,
        part: &Part,
    ) -> Result<Vec<Step>> {
        let traversal = self.traversals.pixels;
        let items = traversal.items_of_samples(part.samples.len(), &self.device);
        let grid = Grid { items, group: traversal.group() };
        let (first, count) = (part.samples.start, part.samples.len() as u32);
        let scene = SceneOf(Some(&self.scene), traversal);
        let (samples, hits) = (&pattern.samples, &self.hits);
        match hardware {
            Some(by) => by.trace_samples(&self.device, scene, camera, samples, (first, count), hits),
            None => {
                let traced = self.trace_samples.launch(grid, scene, camera, samples, first, count, hits)?;
                Ok(vec![traced.into()])
            }
        }
    }

    #[allow(clippy::too_many_arguments)]
    pub(super) fn shade(
        &mut self,
        hardware: Option<&mut Hardware>,
        camera: &layout::Camera,
        shading: &layout::Shading,
        pattern: &TracePattern,
        part: &Part,
        visibility: Option<&Buffer<VisibilityRecord>>,
        records: &Buffer<SampleRecord>,
        (before, past): (&layout::Camera, Option<&Buffer<HitRecord>>),
    ) -> Result<Vec<Step>> {
        let work = Work {
            scene: SceneOf(Some(&self.scene), self.traversals.bundles),
            camera,
            shading,
            samples: &pattern.samples,
            first: part.samples.start,
            count: part.samples.len() as u32,
            hits: &self.hits,
            visibility,
            records,
            before,
            past,
            light: self.light.looked_up(),
            counters: &self.counters,
            glass: self.may_be_glass,
        };
        self.sample_shading.enqueue(&self.device, &work, hardware)
    }
}
