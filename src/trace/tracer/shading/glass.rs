//! Light that comes through the glass of samples, on GPUs.

use super::light_paths::Followed;
use super::{BATCH, Memory, Wavefront, Work, rays_to_sun};
use crate::error::Result;
use crate::gpu::opencl::{Buffer, Program};
use crate::layout;
use crate::trace::Traversal;
use crate::trace::kernels::{
    CrossGlassSurfaces, GenerateGlassRays, Grid, IntersectGlassRays, ResolveGlass, ShadeGlassHits,
};
use crate::trace::tracer::Step;

/// The kernels of `kernels/gpu/glass.cl`.
#[derive(Debug)]
pub(super) struct Glass {
    generate_glass_rays: GenerateGlassRays,
    intersect_glass_rays: IntersectGlassRays,
    cross_glass_surfaces: CrossGlassSurfaces,
    shade_glass_hits: ShadeGlassHits,
    resolve_glass: ResolveGlass,
}

impl Glass {
    pub fn of(program: &Program) -> Result<Self> {
        Ok(Glass {
            generate_glass_rays: GenerateGlassRays::of(program)?,
            intersect_glass_rays: IntersectGlassRays::of(program)?,
            cross_glass_surfaces: CrossGlassSurfaces::of(program)?,
            shade_glass_hits: ShadeGlassHits::of(program)?,
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
        let glass = &self.glass;
        for first_ray in (0..rays_through_glass(shading)).step_by(BATCH) {
            let entered = glass
                .generate_glass_rays
                .launch(of_rays, camera, shading, first_ray, count, states, rays, paths)?;
            events.push(entered.into());
            for _ in 0..layout::GLASS_STEPS {
                let traced = glass.intersect_glass_rays.launch(of_rays, scene, count, rays, counters)?;
                let crossed = glass.cross_glass_surfaces.launch(of_rays, scene, count, rays)?;
                events.extend([traced.into(), crossed.into()]);
            }
            let seen = glass.shade_glass_hits.launch(of_rays, scene, shading, count, rays, paths)?;
            events.push(seen.into());
            let of_each = (rays_through_glass(shading) - first_ray).min(BATCH as u32);
            let followed = Followed { states, rays, paths, of_glass: true, first_ray, of_each };
            self.light_paths.enqueue(work, &followed, &memory.followed, events)?;
            let resolved = glass.resolve_glass.launch(of_samples, shading, first_ray, count, states, rays)?;
            events.push(resolved.into());
        }
        Ok(())
    }
}

/// Rays through the glass of a sample: as `rays_through_glass` in `kernels/shared/sample.h`.
fn rays_through_glass(shading: &layout::Shading) -> u32 {
    ((shading.rays - rays_to_sun(shading)) / 2).max(1)
}
