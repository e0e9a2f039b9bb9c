//! Mirror rays that ray queries trace, and those to the sun from what they have met.

use super::{Hardware, batches, grid};
use crate::error::Result;
use crate::gpu::opencl::{Buffer, Device, Program};
use crate::layout::Shading;
use crate::trace::hardware::{GROUP, PLANE_OWN_ORIGIN, Rays};
use crate::trace::kernels::{CopyMirrorRays, ResolveMirrorHits};
use crate::trace::tracer::Step;

/// The kernels on both sides of ray queries.
#[derive(Debug)]
pub(super) struct MirrorRays {
    copy_mirror_rays: CopyMirrorRays,
    resolve_mirror_hits: ResolveMirrorHits,
}

/// Which rays are asked for.
#[derive(Clone, Copy)]
pub(in crate::trace) struct MirrorRaysAsked {
    /// Those to where pixels mirror, or what they have met does.
    pub onward: bool,
    /// Those from what they have met to the sun.
    pub to_sun: bool,
}

impl MirrorRays {
    pub fn of(program: &Program) -> Result<Self> {
        Ok(MirrorRays {
            copy_mirror_rays: CopyMirrorRays::of(program)?,
            resolve_mirror_hits: ResolveMirrorHits::of(program)?,
        })
    }
}

impl Hardware {
    /// As the kernels intersect_mirror_rays and trace_mirror_sun, of the first `count` rays.
    pub fn trace_mirror_rays(
        &mut self,
        device: &Device,
        shading: &Shading,
        states: &Buffer<u32>,
        count: u32,
        asked: MirrorRaysAsked,
    ) -> Result<Vec<Step>> {
        let [onward, to_sun] = [asked.onward, asked.to_sun].map(u32::from);
        let each_ray = onward + to_sun;
        let mut steps = Vec::new();
        if each_ray == 0 {
            return Ok(steps);
        }
        let most = (self.rays.most() * GROUP / each_ray as usize).min(count as usize);
        let groups_of = |rays: u32| (each_ray * rays).div_ceil(GROUP as u32);
        self.rays.reserve(Some(device), groups_of(most as u32) as usize)?;
        for (first, count, groups) in batches(count, most, groups_of) {
            let (onward, to_sun) = (onward * count, to_sun * count);
            let grid = grid(groups);
            let MirrorRays { copy_mirror_rays, resolve_mirror_hits } = &self.mirror_rays;
            let (rays, _) = self.rays.buffers()?;
            let copied =
                copy_mirror_rays.launch(grid, shading, first, onward, to_sun, groups, states, rays)?;
            let all = groups * GROUP as u32;
            let origin = (PLANE_OWN_ORIGIN, all);
            let traced = self.rays.trace(Rays { groups, count: all, origin }).map(Step::Elsewhere)?;
            let (rays, _) = self.rays.buffers()?;
            let taken =
                resolve_mirror_hits.launch(grid, shading, first, onward, to_sun, groups, states, rays)?;
            steps.extend([copied.into(), traced, taken.into()]);
        }
        Ok(steps)
    }
}
