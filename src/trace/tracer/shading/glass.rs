//! Light that comes through the glass of samples, on GPUs.

use super::light_paths::Followed;
use super::{BATCH, Memory, Wavefront, Work, rays_to_sun};
use crate::error::Result;
use crate::gpu::opencl::{Buffer, Program};
use crate::layout;
use crate::trace::Traversal;
use crate::trace::kernels::{FollowGlassRays, GenerateGlassRays, Grid, ResolveGlass};
use crate::trace::tracer::Step;

/// The kernels of `kernels/gpu/glass.cl`.
#[derive(Debug)]
pub(super) struct Glass {
    generate_glass_rays: GenerateGlassRays,
    follow_glass_rays: FollowGlassRays,
    resolve_glass: ResolveGlass,
}

impl Glass {
    pub fn of(program: &Program) -> Result<Self> {
        Ok(Glass {
            generate_glass_rays: GenerateGlassRays::of(program)?,
            follow_glass_rays: FollowGlassRays::of(program)?,
            resolve_glass: ResolveGlass::of(program)?,
        })
    }
}

impl Wavefront {
    /// Enqueues what follows rays through glass.
    pub(super) fn shade_glass(
        &self,
        work: &Work,
        memory: &Memory,
        rays: &Buffer<u32>,
        events: &mut Vec<Step>,
    ) -> Result<()> {
        let Memory { states, paths, .. } = memory;
        let Work { scene, camera, shading, count, counters, .. } = *work;
        let group = Traversal::SingleRay.group();
        let of_samples = Grid { items: count as usize, group };
        let of_rays = Grid { items: count as usize * BATCH, group };
        let Glass { generate_glass_rays, follow_glass_rays, resolve_glass } = &self.glass;
        for first_ray in (0..rays_through_glass(shading)).step_by(BATCH) {
            let entered = generate_glass_rays
                .launch(of_rays, camera, shading, first_ray, count, states, rays, paths)?;
            let followed =
                follow_glass_rays.launch(of_rays, scene, shading, count, states, rays, paths, counters)?;
            events.extend([entered.into(), followed.into()]);
            let of_each = (rays_through_glass(shading) - first_ray).min(BATCH as u32);
            let followed = Followed { states, rays, paths, of_glass: true, first_ray, of_each };
            self.light_paths.enqueue(work, &followed, &memory.followed, events)?;
            let resolved = resolve_glass.launch(of_samples, shading, first_ray, count, states, rays)?;
            events.push(resolved.into());
        }
        Ok(())
    }
}

/// Rays through the glass of a sample: as `rays_through_glass` in `kernels/shared/sample.h`.
fn rays_through_glass(shading: &layout::Shading) -> u32 {
    ((shading.rays - rays_to_sun(shading)) / 2).max(1)
}
