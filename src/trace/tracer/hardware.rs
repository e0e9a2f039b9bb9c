//! Rays that ray queries trace, and the kernels on both sides of them: `kernels/gpu/hardware.cl`.

mod mirrors;

use super::Step;
use super::shading::samples_under_way;
use crate::error::Result;
use crate::foveation::workload::TILE_PIXELS;
use crate::gpu::opencl::{Buffer, Device, Program};
use crate::gpu::vulkan::Context;
use crate::layout::{Camera, HitRecord, Shading, VisibilityRecord};
use crate::scene::Features;
use crate::trace::hardware::{GROUP, HardwareRays, PLANE_ORIGIN, PLANE_OWN_ORIGIN, Rays};
use crate::trace::kernels::{
    GatherCorners, GeneratePixelRays, GeneratePixelSunRays, GenerateSampleRays, Grid, ResolvePixelHits,
    ResolvePixelSun, ResolveSampleHits, SceneOf,
};
use crate::trace::{SceneBuffers, SceneData, SceneState, Traversal};
use mirrors::MirrorRays;
pub(super) use mirrors::MirrorRaysAsked;

/// Groups of rays of a tile.
const GROUPS_PER_TILE: usize = TILE_PIXELS as usize / GROUP;

/// Tiles `first..first + count` of a list.
#[derive(Clone, Copy)]
pub(in crate::trace) struct Tiles<'a> {
    pub list: &'a Buffer<u32>,
    pub first: u32,
    pub count: u32,
}

/// What traces a scene's rays in place of the kernels that do else.
#[derive(Debug)]
pub(in crate::trace) struct Hardware {
    rays: HardwareRays,
    generate_pixel_rays: GeneratePixelRays,
    resolve_pixel_hits: ResolvePixelHits,
    generate_sample_rays: GenerateSampleRays,
    resolve_sample_hits: ResolveSampleHits,
    generate_pixel_sun_rays: GeneratePixelSunRays,
    resolve_pixel_sun: ResolvePixelSun,
    mirror_rays: MirrorRays,
    gather_corners: GatherCorners,
    /// Whether rays may meet triangles with alpha, which kernels look at.
    alpha: bool,
}

impl Hardware {
    pub fn new(
        device: &Device,
        context: &Context,
        data: &SceneData,
        program: &Program,
        features: Features,
    ) -> Result<Self> {
        let most = samples_under_way(device.info()).max(GROUPS_PER_TILE);
        Ok(Hardware {
            rays: HardwareRays::new(context, Some(device), data, most)?,
            generate_pixel_rays: GeneratePixelRays::of(program)?,
            resolve_pixel_hits: ResolvePixelHits::of(program)?,
            generate_sample_rays: GenerateSampleRays::of(program)?,
            resolve_sample_hits: ResolveSampleHits::of(program)?,
            generate_pixel_sun_rays: GeneratePixelSunRays::of(program)?,
            resolve_pixel_sun: ResolvePixelSun::of(program)?,
            mirror_rays: MirrorRays::of(program)?,
            gather_corners: GatherCorners::of(program)?,
            alpha: features.alpha,
        })
    }

    /// Has the next rays traced where a scene is that was brought to another instant.
    pub fn move_to(&mut self, scene: &SceneBuffers, state: &SceneState) -> Result<()> {
        let kernel = &self.gather_corners;
        self.rays.move_to(state, |places, corners| scene.gather_corners(kernel, places, corners))
    }

    /// How many samples can have their light rays under way.
    pub fn most_samples(&self) -> usize {
        self.rays.most()
    }

    /// Makes room for the light rays of so many samples.
    pub fn reserve(&mut self, device: &Device, samples: usize) -> Result<()> {
        self.rays.reserve(Some(device), samples)
    }

    /// The rays under way, and the queue of those that met a surface.
    pub fn rays(&self) -> Result<(&Buffer<u32>, &Buffer<u32>)> {
        self.rays.buffers()
    }

    /// Whether kernels have to trace some rays afterwards.
    pub fn leaves_rays_open(&self) -> bool {
        self.alpha
    }

    /// Traces `each` rays of so many samples, which were laid out with where they start.
    pub fn trace_rays_of(&mut self, samples: u32, each: u32) -> Result<Step> {
        self.trace(Rays { groups: samples, count: samples * each, origin: (PLANE_ORIGIN, samples) })
    }

    fn trace(&mut self, rays: Rays) -> Result<Step> {
        self.rays.trace(rays).map(Step::Elsewhere)
    }

    /// As the kernel trace_pixels.
    pub fn trace_pixels(
        &mut self,
        device: &Device,
        scene: SceneOf,
        camera: &Camera,
        tiles: Tiles,
        hits: &Buffer<HitRecord>,
        seed: u32,
    ) -> Result<Vec<Step>> {
        let mut steps = Vec::new();
        for (first, count, groups) in self.batches_of_tiles(device, tiles.count)? {
            let first = tiles.first + first;
            let (rays, _) = self.rays.buffers()?;
            let grid = grid(groups);
            let aimed =
                self.generate_pixel_rays.launch(grid, camera, tiles.list, first, count, groups, rays)?;
            let origin = (PLANE_OWN_ORIGIN, 1);
            let traced = self.trace(Rays { groups, count: groups * GROUP as u32, origin })?;
            let (rays, _) = self.rays.buffers()?;
            let list = tiles.list;
            let taken = self
                .resolve_pixel_hits
                .launch(grid, scene, camera, list, first, count, groups, rays, hits, seed)?;
            steps.extend([aimed.into(), traced, taken.into()]);
        }
        Ok(steps)
    }

    fn batches_of_tiles(&mut self, device: &Device, count: u32) -> Result<Vec<(u32, u32, u32)>> {
        let each = (self.rays.most() / GROUPS_PER_TILE).min(count as usize);
        self.rays.reserve(Some(device), each * GROUPS_PER_TILE)?;
        Ok(batches(count, each, |tiles| tiles * GROUPS_PER_TILE as u32))
    }

    /// As the kernel trace_samples, for samples `first..first + count`.
    pub fn trace_samples(
        &mut self,
        device: &Device,
        scene: SceneOf,
        camera: &Camera,
        samples: &Buffer<u32>,
        (start, count): (u32, u32),
        hits: &Buffer<HitRecord>,
    ) -> Result<Vec<Step>> {
        let each = (self.rays.most() * GROUP).min(count as usize);
        self.rays.reserve(Some(device), each.div_ceil(GROUP))?;
        let mut steps = Vec::new();
        for (first, count, groups) in batches(count, each, |samples| samples.div_ceil(GROUP as u32)) {
            let first = start + first;
            let (rays, _) = self.rays.buffers()?;
            let grid = grid(groups);
            let aimed =
                self.generate_sample_rays.launch(grid, camera, samples, first, count, groups, rays)?;
            let traced = self.trace(Rays { groups, count, origin: (PLANE_OWN_ORIGIN, 1) })?;
            let (rays, _) = self.rays.buffers()?;
            let taken = self
                .resolve_sample_hits
                .launch(grid, scene, camera, samples, first, count, groups, rays, hits)?;
            steps.extend([aimed.into(), traced, taken.into()]);
        }
        Ok(steps)
    }

    /// As the kernel trace_sun.
    pub fn trace_sun(
        &mut self,
        device: &Device,
        scene: SceneOf,
        (camera, shading): (&Camera, &Shading),
        tiles: Tiles,
        hits: &Buffer<HitRecord>,
        (records, counters): (&Buffer<VisibilityRecord>, &Buffer<u32>),
    ) -> Result<Vec<Step>> {
        let list = tiles.list;
        let mut steps = Vec::new();
        for (first, count, groups) in self.batches_of_tiles(device, tiles.count)? {
            let first = tiles.first + first;
            let (rays, _) = self.rays.buffers()?;
            let grid = grid(groups);
            let aimed = self
                .generate_pixel_sun_rays
                .launch(grid, scene, camera, shading, list, first, count, groups, hits, rays)?;
            let all = groups * GROUP as u32;
            let traced = self.trace(Rays { groups, count: all, origin: (PLANE_OWN_ORIGIN, all) })?;
            let (rays, _) = self.rays.buffers()?;
            let taken = self.resolve_pixel_sun.launch(
                grid, scene, camera, shading, list, first, count, groups, hits, rays, records, counters,
            )?;
            steps.extend([aimed.into(), traced, taken.into()]);
        }
        Ok(steps)
    }
}

/// Batches of `count` things, at most `most` in each: the first, how many, and how many groups of rays those have.
pub(super) fn batches(count: u32, most: usize, groups: impl Fn(u32) -> u32) -> Vec<(u32, u32, u32)> {
    let most = most.max(1) as u32;
    let batch = |first: u32| (first, most.min(count - first));
    let starts = (0..count).step_by(most as usize);
    starts.map(batch).map(|(first, count)| (first, count, groups(count))).collect()
}

/// A work-item for each ray of so many groups.
fn grid(groups: u32) -> Grid {
    Grid { items: groups as usize * GROUP, group: Traversal::SingleRay.group() }
}
