//! Shading of samples: one kernel where rays travel in packets, and for GPUs several that hand light rays on in memory.

mod glass;
mod light_paths;
mod sun;

use super::{Hardware, Step};
use crate::error::Result;
use crate::gpu::opencl::{Buffer, Device, DeviceInfo, Program};
use crate::layout::{self, HitRecord, SampleRecord, VisibilityRecord};
use crate::trace::Traversal;
use crate::trace::hardware::{GROUP, RAY_WORDS};
use crate::trace::kernels::{
    BeginSamples, EndSamples, GenerateLightRays, Grid, IntersectLightRays, ResolveLight, SceneOf,
    ShadeLightHits, ShadePunctual, ShadeSamples,
};
use crate::trace::light_cache::LookedUp;
use crate::trace::paths::{self, PathMemory, STEP_RAYS, rays_of_step};
use crate::trace::source::STATE_BYTES;
use glass::Glass;
use light_paths::{Followed, LightPaths};
use sun::SunRays;

/// Light rays of a sample that are under way together.
const BATCH: usize = GROUP;
/// Paths of a sample that are followed together.
const PATHS: usize = 4;
/// Work-items that a unit of a graphics card can have resident at most: NVIDIA's limit from compute capability 7.0 on, but for
/// 7.5 and 8.x, which have fewer.
pub(super) const RESIDENT: u64 = 2048;

/// The kernels of a variant, and what they need in a device's memory.
#[derive(Debug)]
pub(in crate::trace) enum SampleShading {
    Packet(ShadeSamples),
    SingleRay(Box<Wavefront>),
}

/// What is shaded: samples `first..first + count` of a list, into their records.
pub(in crate::trace) struct Work<'a> {
    pub scene: SceneOf<'a>,
    pub camera: &'a layout::Camera,
    pub shading: &'a layout::Shading,
    pub samples: &'a Buffer<u32>,
    pub first: u32,
    pub count: u32,
    pub hits: &'a Buffer<HitRecord>,
    pub visibility: Option<&'a Buffer<VisibilityRecord>>,
    pub records: &'a Buffer<SampleRecord>,
    /// How the view's frame before was seen, and its pixels' hits.
    pub before: &'a layout::Camera,
    pub past: Option<&'a Buffer<HitRecord>>,
    pub light: LookedUp<'a>,
    pub counters: &'a Buffer<u32>,
    /// Whether samples may see glass.
    pub glass: bool,
}

impl SampleShading {
    pub fn of(program: &Program, traversal: Traversal) -> Result<Self> {
        Ok(match traversal {
            Traversal::Packet => SampleShading::Packet(ShadeSamples::of(program)?),
            Traversal::SingleRay => SampleShading::SingleRay(Box::new(Wavefront::of(program)?)),
        })
    }

    /// The names of its kernels that may need memory of their own.
    pub fn kernels(traversal: Traversal) -> &'static [&'static str] {
        match traversal {
            Traversal::Packet => &["shade_samples"],
            Traversal::SingleRay => &[
                "intersect_sun_rays",
                "intersect_light_rays",
                "shade_light_hits",
                "shade_path_vertices",
                "aim_path_rays",
                "intersect_path_rays",
                "shade_path_rays",
                "shade_punctual",
                "intersect_glass_rays",
                "cross_glass_surfaces",
                "shade_glass_hits",
            ],
        }
    }

    /// Enqueues the kernels; `hardware` traces the rays of those that want it.
    pub fn enqueue(
        &mut self,
        device: &Device,
        work: &Work,
        hardware: Option<&mut Hardware>,
    ) -> Result<Vec<Step>> {
        match self {
            SampleShading::Packet(kernel) => {
                let items = Traversal::Packet.items_of_streams(work.count as usize, device);
                let grid = Grid { items, group: Traversal::Packet.group() };
                let (info, keys, cells) = work.light;
                let event = kernel.launch(
                    grid,
                    work.scene,
                    work.camera,
                    work.before,
                    work.shading,
                    work.samples,
                    work.first,
                    work.count,
                    work.hits,
                    work.visibility,
                    work.records,
                    work.past,
                    info,
                    keys,
                    cells,
                    work.counters,
                )?;
                Ok(vec![event.into()])
            }
            SampleShading::SingleRay(wavefront) => wavefront.enqueue(device, work, hardware),
        }
    }
}

/// The kernels of `kernels/gpu/shade.cl`.
#[derive(Debug)]
pub(in crate::trace) struct Wavefront {
    begin_samples: BeginSamples,
    sun_rays: SunRays,
    generate_light_rays: GenerateLightRays,
    intersect_light_rays: IntersectLightRays,
    shade_light_hits: ShadeLightHits,
    light_paths: LightPaths,
    resolve_light: ResolveLight,
    shade_punctual: ShadePunctual,
    glass: Glass,
    end_samples: EndSamples,
    memory: Option<Memory>,
}

/// Samples and light rays under way.
#[derive(Debug)]
struct Memory {
    /// How many samples there is room for.
    samples: usize,
    states: Buffer<u32>,
    rays: Buffer<u32>,
    queue: Buffer<u32>,
    /// Those of them that paths are followed for.
    paths: Buffer<u32>,
    /// Some of those paths, which are under way together.
    followed: PathMemory,
}

impl Wavefront {
    fn of(program: &Program) -> Result<Self> {
        Ok(Wavefront {
            begin_samples: BeginSamples::of(program)?,
            sun_rays: SunRays::of(program)?,
            generate_light_rays: GenerateLightRays::of(program)?,
            intersect_light_rays: IntersectLightRays::of(program)?,
            shade_light_hits: ShadeLightHits::of(program)?,
            light_paths: LightPaths::of(program)?,
            resolve_light: ResolveLight::of(program)?,
            shade_punctual: ShadePunctual::of(program)?,
            glass: Glass::of(program)?,
            end_samples: EndSamples::of(program)?,
            memory: None,
        })
    }

    fn enqueue(
        &mut self,
        device: &Device,
        work: &Work,
        mut hardware: Option<&mut Hardware>,
    ) -> Result<Vec<Step>> {
        let most = samples_under_way(device.info());
        let most = hardware.as_ref().map_or(most, |by| by.most_samples().min(most));
        let needed = (work.count as usize).min(most).max(1);
        let suits =
            |memory: &Memory| memory.samples >= needed && memory.followed.room(work.shading.lights) > 0;
        if !self.memory.as_ref().is_some_and(suits) {
            // What is queued keeps the old one as long as it needs it.
            self.memory = None;
            let room = needed.next_power_of_two().min(most);
            self.memory = Some(Memory::new(device, room, work.shading.lights, hardware.is_none())?);
        }
        if let Some(by) = &mut hardware {
            by.reserve(device, needed)?;
        }
        let mut steps = Vec::new();
        let mut done = 0;
        while steps.is_empty() || done < work.count {
            let count = (work.count - done).min(most as u32);
            let part = Work { first: work.first + done, count, ..*work };
            self.enqueue_some(&part, hardware.as_deref_mut(), &mut steps)?;
            done += count;
        }
        Ok(steps)
    }

    /// Enqueues shading of samples for which there is memory.
    fn enqueue_some(
        &self,
        work: &Work,
        mut hardware: Option<&mut Hardware>,
        events: &mut Vec<Step>,
    ) -> Result<()> {
        let Some(memory) = &self.memory else { return Ok(()) };
        let Memory { states, .. } = memory;
        let Work {
            scene,
            camera,
            before,
            shading,
            samples,
            first,
            count,
            hits,
            visibility,
            records,
            past,
            counters,
            ..
        } = *work;
        let group = Traversal::SingleRay.group();
        let of_samples = Grid { items: count as usize, group };
        let of_rays = Grid { items: count as usize * BATCH, group };
        events.push(
            self.begin_samples
                .launch(
                    of_samples, scene, camera, before, shading, samples, first, count, hits, visibility,
                    records, past, states,
                )?
                .into(),
        );
        let to_sun = rays_to_sun(shading);
        if to_sun > 0 {
            self.sun_rays.enqueue(work, memory, hardware.as_deref_mut(), events)?;
        }
        for first_ray in (0..shading.rays - to_sun).step_by(BATCH) {
            let (rays, queue) = memory.under_way(hardware.as_deref())?;
            events.push(
                self.generate_light_rays
                    .launch(
                        of_rays,
                        scene,
                        camera,
                        shading,
                        first_ray,
                        count,
                        states,
                        rays,
                        queue,
                        &memory.paths,
                    )?
                    .into(),
            );
            let left = match &mut hardware {
                Some(by) => {
                    events.push(by.trace_rays_of(count, BATCH as u32)?);
                    by.leaves_rays_open()
                }
                None => true,
            };
            let (rays, queue) = memory.under_way(hardware.as_deref())?;
            if left {
                let traced =
                    self.intersect_light_rays.launch(of_samples, scene, count, states, rays, queue)?;
                events.push(traced.into());
            }
            self.shade_hits(work, memory, (rays, queue), first_ray, events)?;
            events.push(
                self.resolve_light.launch(of_samples, scene, shading, count, states, rays, counters)?.into(),
            );
        }
        if shading.lights > 0 {
            events.push(
                self.shade_punctual.launch(of_samples, scene, shading, count, states, counters)?.into(),
            );
        }
        if work.glass {
            let (rays, _) = memory.under_way(hardware.as_deref())?;
            self.shade_glass(work, memory, rays, events)?;
        }
        events.push(
            self.end_samples
                .launch(
                    of_samples, camera, shading, samples, first, count, visibility, states, records, counters,
                )?
                .into(),
        );
        Ok(())
    }

    /// Enqueues what looks at the surfaces that light rays have met.
    fn shade_hits(
        &self,
        work: &Work,
        memory: &Memory,
        (rays, queue): (&Buffer<u32>, &Buffer<u32>),
        first_ray: u32,
        events: &mut Vec<Step>,
    ) -> Result<()> {
        let Memory { states, paths, .. } = memory;
        let Work { scene, camera, shading, count, .. } = *work;
        let (info, keys, cells) = work.light;
        let grid = of_hits(count);
        // Where nothing is known of what surfaces send, paths are followed for all that was queued.
        let knows_some = shading.bounces == 0 || shading.emitters > 0;
        if knows_some {
            events.push(
                self.shade_light_hits
                    .launch(
                        grid, scene, camera, shading, count, states, rays, queue, info, keys, cells, paths,
                    )?
                    .into(),
            );
        }
        if shading.bounces > 0 || shading.cached > 0 {
            let paths = if knows_some { paths } else { queue };
            let of_each = rays_that_meet(shading, first_ray);
            let followed = Followed { states, rays, paths, of_glass: false, first_ray, of_each };
            self.light_paths.enqueue(work, &followed, &memory.followed, events)?;
        }
        Ok(())
    }
}

/// Of 32 rays of a sample from number `first_ray` on, those that may meet a surface whose light is not known: with the cache those
/// that `is_looking` in `kernels/shared/sample.h` has look for surfaces: a quarter, and of fewer rays all at most.
fn rays_that_meet(shading: &layout::Shading, first_ray: u32) -> u32 {
    let rays = (shading.rays - rays_to_sun(shading) - first_ray).min(BATCH as u32);
    let fewer = if shading.fewer_rays < shading.rays { shading.fewer_rays } else { 0 };
    if shading.cached > 0 { rays.min((BATCH as u32 / 4).max(fewer)) } else { rays }
}

/// A work-item for each of the lanes that look at what so many samples' rays have met.
fn of_hits(samples: u32) -> Grid {
    Grid { items: samples as usize, group: Traversal::SingleRay.group() }
}

/// Rays of a sample that look at the sun's disc: as `rays_to_sun` in `kernels/shared/sample.h`.
fn rays_to_sun(shading: &layout::Shading) -> u32 {
    if shading.guided == 0 { 0 } else { ((shading.rays as f32 * shading.sun_share) as u32).min(32) }
}

/// Samples that are under way together at most: one for each lane that a graphics card can have resident, within a sixteenth
/// of its memory; for processors as many as their caches hold.
pub(super) fn samples_under_way(info: &DeviceInfo) -> usize {
    if info.kind == "cpu" {
        return 1024;
    }
    let room = info.memory / 16 / bytes_of(1024) * 1024;
    (RESIDENT * u64::from(info.compute_units)).min(room).max(4096) as usize
}

/// Bytes of memory for so many samples under way.
fn bytes_of(samples: usize) -> u64 {
    let words = samples * BATCH * (RAY_WORDS + 2);
    (samples * STATE_BYTES + words * size_of::<u32>()) as u64
        + paths::bytes_of(samples * PATHS, samples * PATHS * paths::STEP_RAYS)
}

/// The memory that is needed at most, in bytes.
pub(super) fn bytes_under_way(info: &DeviceInfo) -> u64 {
    bytes_of(samples_under_way(info))
}

impl Memory {
    /// The rays under way, and the queue of those that met a surface.
    fn under_way<'a>(&'a self, hardware: Option<&'a Hardware>) -> Result<(&'a Buffer<u32>, &'a Buffer<u32>)> {
        hardware.map_or(Ok((&self.rays, &self.queue)), Hardware::rays)
    }

    /// Without rays where they lie in memory of others.
    fn new(device: &Device, samples: usize, lights: u32, with_rays: bool) -> Result<Self> {
        let rays = if with_rays { samples * BATCH } else { 0 };
        Ok(Memory {
            samples,
            states: Buffer::new(device, samples * STATE_BYTES / size_of::<u32>())?,
            rays: Buffer::new(device, rays * RAY_WORDS)?,
            queue: Buffer::new(device, 1 + rays)?,
            paths: Buffer::new(device, 1 + samples * BATCH)?,
            followed: PathMemory::new(
                device,
                samples * PATHS,
                (samples * PATHS * STEP_RAYS).max(rays_of_step(lights)),
            )?,
        })
    }
}
