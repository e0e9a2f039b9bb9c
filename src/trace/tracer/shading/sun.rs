//! Where a part of the sun is hidden from samples, on GPUs.

use super::{Memory, Work, rays_to_sun};
use crate::error::Result;
use crate::gpu::opencl::Program;
use crate::trace::Traversal;
use crate::trace::kernels::{GenerateBlockerRays, GenerateSunRays, Grid, IntersectSunRays, ResolveBlockers};
use crate::trace::tracer::{Hardware, Step};

/// The kernels of `kernels/gpu/sun.cl`.
#[derive(Debug)]
pub(super) struct SunRays {
    generate_sun_rays: GenerateSunRays,
    intersect_sun_rays: IntersectSunRays,
    generate_blocker_rays: GenerateBlockerRays,
    resolve_blockers: ResolveBlockers,
}

impl SunRays {
    pub fn of(program: &Program) -> Result<Self> {
        Ok(SunRays {
            generate_sun_rays: GenerateSunRays::of(program)?,
            intersect_sun_rays: IntersectSunRays::of(program)?,
            generate_blocker_rays: GenerateBlockerRays::of(program)?,
            resolve_blockers: ResolveBlockers::of(program)?,
        })
    }

    /// Enqueues them for samples that there is room for; `hardware` traces the rays that it can.
    pub fn enqueue(
        &self,
        work: &Work,
        memory: &Memory,
        mut hardware: Option<&mut Hardware>,
        events: &mut Vec<Step>,
    ) -> Result<()> {
        let Work { camera, shading, samples, first, count, visibility, counters, .. } = *work;
        let (states, each) = (&memory.states, rays_to_sun(shading));
        let (rays, _) = memory.under_way(hardware.as_deref())?;
        let aimed =
            self.generate_sun_rays.launch(of(each, count), camera, shading, each, count, states, rays)?;
        events.push(aimed.into());
        self.trace(work, memory, each, hardware.as_deref_mut(), events)?;
        let (rays, _) = memory.under_way(hardware.as_deref())?;
        let sought = self.generate_blocker_rays.launch(
            of(1, count),
            camera,
            shading,
            samples,
            first,
            count,
            visibility,
            states,
            rays,
            counters,
        )?;
        events.push(sought.into());
        self.trace(work, memory, 1, hardware.as_deref_mut(), events)?;
        let (rays, _) = memory.under_way(hardware.as_deref())?;
        let taken = self.resolve_blockers.launch(
            of(1, count),
            camera,
            samples,
            first,
            count,
            visibility,
            states,
            rays,
        )?;
        events.push(taken.into());
        Ok(())
    }

    /// Traces `each` rays of a sample.
    fn trace(
        &self,
        work: &Work,
        memory: &Memory,
        each: u32,
        mut hardware: Option<&mut Hardware>,
        events: &mut Vec<Step>,
    ) -> Result<()> {
        let Work { scene, shading, count, .. } = *work;
        if let Some(by) = &mut hardware {
            events.push(by.trace_rays_of(count, each)?);
            if !by.leaves_rays_open() {
                return Ok(());
            }
        }
        let (rays, _) = memory.under_way(hardware.as_deref())?;
        let traced = self.intersect_sun_rays.launch(
            of(each, count),
            scene,
            shading,
            each,
            count,
            &memory.states,
            rays,
        )?;
        events.push(traced.into());
        Ok(())
    }
}

/// A work-item for each of `each` rays of `count` samples.
fn of(each: u32, count: u32) -> Grid {
    Grid { items: each as usize * count as usize, group: Traversal::SingleRay.group() }
}
