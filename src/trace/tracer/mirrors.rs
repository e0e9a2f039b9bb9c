//! What pixels mirror, on GPUs: kernels that hand rays on in memory (`kernels/gpu/mirrors.cl`), where ray queries may trace them.

use super::Step;
use super::hardware::{Hardware, MirrorRaysAsked, Tiles, batches};
use super::shading::RESIDENT;
use crate::error::Result;
use crate::foveation::workload::TILE_PIXELS;
use crate::gpu::opencl::{Buffer, Device, DeviceInfo, Program};
use crate::layout::{Camera, HitRecord, Shading, VisibilityRecord};
use crate::trace::Traversal;
use crate::trace::kernels::{
    GenerateMirrorRays, Grid, IntersectMirrorRays, ResolveMirrors, SceneOf, ShadeMirrorHits, TraceMirrorSun,
};

/// Words of memory of a ray under way: `MirrorRay` in `kernels/gpu/mirrors.cl`.
const MIRROR_RAY_WORDS: usize = 34;
/// Rays that a pixel sends at most: `LOBE_RAYS` in `kernels/shared/glossy.h`.
const RAYS: usize = 4;

/// The kernels, and memory for the rays of some tiles.
#[derive(Debug)]
pub(in crate::trace) struct Mirrors {
    generate_mirror_rays: GenerateMirrorRays,
    intersect_mirror_rays: IntersectMirrorRays,
    shade_mirror_hits: ShadeMirrorHits,
    /// Where there is a sun.
    trace_mirror_sun: Option<TraceMirrorSun>,
    resolve_mirrors: ResolveMirrors,
    memory: Memory,
}

#[derive(Debug)]
struct Memory {
    /// How many tiles there is room for together.
    tiles: usize,
    states: Buffer<u32>,
    /// How many rays are under way, for each of the batches that a view may have.
    queue: Buffer<u32>,
}

/// Rays under way, of one of the batches.
#[derive(Clone, Copy)]
struct UnderWay<'a> {
    device: &'a Device,
    batch: u32,
    /// At least as many as there are.
    most: usize,
}

/// Pixels of a view, and what is written of them.
#[derive(Clone, Copy)]
pub(in crate::trace) struct Pixels<'a> {
    pub scene: SceneOf<'a>,
    pub camera: &'a Camera,
    pub shading: &'a Shading,
    pub tiles: Tiles<'a>,
    pub hits: &'a Buffer<HitRecord>,
    pub records: &'a Buffer<VisibilityRecord>,
    pub counters: &'a Buffer<u32>,
}

impl Mirrors {
    /// The names of its kernels that may need memory of their own.
    pub const KERNELS: [&str; 4] =
        ["generate_mirror_rays", "intersect_mirror_rays", "shade_mirror_hits", "trace_mirror_sun"];

    /// `sun`: whether scenes may have one.
    pub fn of(program: &Program, device: &Device, sun: bool) -> Result<Self> {
        Ok(Mirrors {
            generate_mirror_rays: GenerateMirrorRays::of(program)?,
            intersect_mirror_rays: IntersectMirrorRays::of(program)?,
            shade_mirror_hits: ShadeMirrorHits::of(program)?,
            trace_mirror_sun: sun.then(|| TraceMirrorSun::of(program)).transpose()?,
            resolve_mirrors: ResolveMirrors::of(program)?,
            memory: Memory::new(device, 1, 1)?,
        })
    }

    /// Makes room for views of so many tiles.
    pub fn reserve(&mut self, device: &Device, tiles: usize) -> Result<()> {
        let most = tiles_under_way(device.info());
        let together = tiles.min(most);
        if self.memory.tiles < together || self.memory.queue.len() < tiles.div_ceil(together.max(1)) {
            let room = together.next_power_of_two().min(most);
            // What is queued keeps the old one as long as it needs it.
            self.memory = Memory::new(device, room, tiles.div_ceil(room).next_power_of_two())?;
        }
        Ok(())
    }

    /// Enqueues the kernels, for some of the tiles for which there is room at a time; `hardware` traces the rays of those that
    /// want it.
    pub fn enqueue(
        &self,
        device: &Device,
        pixels: Pixels,
        mut hardware: Option<&mut Hardware>,
    ) -> Result<Vec<Step>> {
        let mut steps = Vec::new();
        self.memory.queue.fill_zero()?;
        let all = pixels.tiles.count;
        let parts = batches(all, self.memory.tiles, |tiles| tiles);
        // Without tiles once, for no work.
        let parts = if all == 0 { vec![(0, 0, 0)] } else { parts };
        for (batch, (first, count, _)) in parts.into_iter().enumerate() {
            let tiles = Tiles { first: pixels.tiles.first + first, count, ..pixels.tiles };
            let by = hardware.as_deref_mut();
            self.enqueue_some(device, Pixels { tiles, ..pixels }, batch as u32, by, &mut steps)?;
        }
        Ok(steps)
    }

    /// Enqueues the kernels for tiles for which there is room.
    fn enqueue_some(
        &self,
        device: &Device,
        pixels: Pixels,
        batch: u32,
        hardware: Option<&mut Hardware>,
        steps: &mut Vec<Step>,
    ) -> Result<()> {
        let Memory { states, queue, .. } = &self.memory;
        let Pixels { scene, camera, shading, hits, records, counters, .. } = pixels;
        let Tiles { list, first, count } = pixels.tiles;
        let items = (count as usize * TILE_PIXELS as usize).max(1);
        let of_pixels = Grid { items, group: Traversal::SingleRay.group() };
        let generated = self.generate_mirror_rays.launch(
            of_pixels, scene, camera, shading, list, first, count, hits, records, counters, states, queue,
            batch,
        )?;
        steps.push(generated.into());
        // Whoever waits for rays that are traced elsewhere anyway can know how many there are.
        let most = match &hardware {
            Some(_) => queue.start_read(batch as usize, 1)?.into_memory()?[0] as usize,
            None => items * RAYS,
        };
        let rays = UnderWay { device, batch, most };
        if most > 0 { self.follow(pixels, rays, hardware, steps) } else { Ok(()) }
    }

    /// Enqueues what finds out what rays bring.
    fn follow(
        &self,
        pixels: Pixels,
        rays: UnderWay,
        mut hardware: Option<&mut Hardware>,
        steps: &mut Vec<Step>,
    ) -> Result<()> {
        let Memory { states, queue, .. } = &self.memory;
        let Pixels { scene, camera, shading, records, counters, .. } = pixels;
        let (batch, grid) = (rays.batch, rays.grid());
        let onward = MirrorRaysAsked { onward: true, to_sun: false };
        self.trace(pixels, rays, onward, hardware.as_deref_mut(), steps)?;
        if shading.bounces > 0 || shading.cached > 0 {
            // What is met in a mirror may be one too, and what that shows is not.
            for onward in [true, false] {
                let may_mirror = u32::from(onward);
                let shaded = self
                    .shade_mirror_hits
                    .launch(grid, scene, camera, shading, states, queue, batch, may_mirror, counters)?;
                steps.push(shaded.into());
                let asked = MirrorRaysAsked { onward, to_sun: self.trace_mirror_sun.is_some() };
                self.trace(pixels, rays, asked, hardware.as_deref_mut(), steps)?;
            }
        }
        let resolved = self.resolve_mirrors.launch(grid, scene, shading, states, queue, batch, records)?;
        steps.push(resolved.into());
        Ok(())
    }

    /// Enqueues what traces rays: where `hardware` does, kernels get what it leaves open.
    fn trace(
        &self,
        pixels: Pixels,
        rays: UnderWay,
        asked: MirrorRaysAsked,
        hardware: Option<&mut Hardware>,
        steps: &mut Vec<Step>,
    ) -> Result<()> {
        let Memory { states, queue, .. } = &self.memory;
        let Pixels { scene, shading, .. } = pixels;
        let UnderWay { device, batch, most } = rays;
        if let Some(by) = hardware {
            steps.extend(by.trace_mirror_rays(device, shading, states, most as u32, asked)?);
            if !by.leaves_rays_open() {
                return Ok(());
            }
        }
        let grid = rays.grid();
        if asked.onward {
            let met = self.intersect_mirror_rays.launch(grid, scene, shading, states, queue, batch)?;
            steps.push(met.into());
        }
        if let Some(kernel) = self.trace_mirror_sun.as_ref().filter(|_| asked.to_sun) {
            steps.push(kernel.launch(grid, scene, shading, states, queue, batch)?.into());
        }
        Ok(())
    }
}

impl UnderWay<'_> {
    /// A work-item for each.
    fn grid(&self) -> Grid {
        Grid { items: self.most, group: Traversal::SingleRay.group() }
    }
}

/// Tiles whose rays are under way together at most: four pixels for each lane that a graphics card can have resident, within a
/// thirty-second of its memory.
fn tiles_under_way(info: &DeviceInfo) -> usize {
    if info.kind == "cpu" {
        return 256;
    }
    let lanes = 4 * RESIDENT * u64::from(info.compute_units) / u64::from(TILE_PIXELS);
    let room = info.memory / 32 / bytes_of(1);
    lanes.min(room).max(16) as usize
}

/// Bytes of memory for the rays of so many tiles.
fn bytes_of(tiles: usize) -> u64 {
    (tiles * TILE_PIXELS as usize * RAYS * MIRROR_RAY_WORDS * size_of::<u32>()) as u64
}

/// The memory that is needed at most, in bytes.
pub(super) fn bytes_under_way(info: &DeviceInfo) -> u64 {
    bytes_of(tiles_under_way(info))
}

impl Memory {
    fn new(device: &Device, tiles: usize, batches: usize) -> Result<Self> {
        let rays = tiles * TILE_PIXELS as usize * RAYS;
        Ok(Memory {
            tiles,
            states: Buffer::new(device, rays * MIRROR_RAY_WORDS)?,
            queue: Buffer::new(device, batches)?,
        })
    }
}
