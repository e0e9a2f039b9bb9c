//! Paths from what light rays have met, on GPUs: some at a time, from vertex to vertex.

use super::Work;
use crate::error::Result;
use crate::gpu::opencl::{Buffer, Program};
use crate::trace::kernels::{BeginLightPaths, ResolveLightPaths, ResolveLightVertices};
use crate::trace::paths::{self, PathKernels, PathMemory};
use crate::trace::tracer::Step;

/// Kernels of `kernels/gpu/shade.cl`, and those of all paths.
#[derive(Debug)]
pub(super) struct LightPaths {
    begin_light_paths: BeginLightPaths,
    paths: PathKernels,
    resolve_light_vertices: ResolveLightVertices,
    resolve_light_paths: ResolveLightPaths,
}

/// Queued rays of samples under way, whose paths are followed.
pub(super) struct Followed<'a> {
    pub states: &'a Buffer<u32>,
    pub rays: &'a Buffer<u32>,
    /// The queue.
    pub paths: &'a Buffer<u32>,
    /// Whether they have passed glass.
    pub of_glass: bool,
    /// The first one's number among a sample's rays.
    pub first_ray: u32,
    /// How many of a sample's may be queued.
    pub of_each: u32,
}

impl LightPaths {
    pub fn of(program: &Program) -> Result<Self> {
        Ok(LightPaths {
            begin_light_paths: BeginLightPaths::of(program)?,
            paths: PathKernels::of(program)?,
            resolve_light_vertices: ResolveLightVertices::of(program)?,
            resolve_light_paths: ResolveLightPaths::of(program)?,
        })
    }

    /// Enqueues what follows them. How many are queued only the device knows: it finds nothing to do where there are fewer.
    pub fn enqueue(
        &self,
        work: &Work,
        followed: &Followed,
        memory: &PathMemory,
        events: &mut Vec<Step>,
    ) -> Result<()> {
        // Once at least, so that a launch for nothing builds all that a frame may launch.
        let most = (work.count * followed.of_each).max(1);
        let room = memory.room(work.shading.lights).min(most);
        for first in (0..most).step_by(room.max(1) as usize) {
            self.enqueue_some(work, followed, memory, (first, room), events)?;
        }
        Ok(())
    }

    /// The same of `room` of them, from one on.
    fn enqueue_some(
        &self,
        work: &Work,
        followed: &Followed,
        memory: &PathMemory,
        (first, room): (u32, u32),
        events: &mut Vec<Step>,
    ) -> Result<()> {
        let PathMemory { queue, states: path_states, surfaces, rays: step_rays, .. } = memory;
        let Followed { states, rays, paths, first_ray, .. } = *followed;
        let Work { scene, camera, shading, count, counters, .. } = *work;
        let (info, keys, cells) = work.light;
        let (grid, of_glass) = (paths::grid(room, 1), u32::from(followed.of_glass));
        events.push(
            self.begin_light_paths
                .launch(
                    grid,
                    camera,
                    shading,
                    of_glass,
                    first_ray,
                    count,
                    states,
                    rays,
                    paths,
                    first,
                    room,
                    queue,
                    path_states,
                )?
                .into(),
        );
        for vertex in 0..shading.bounces.max(1) {
            let view = (scene, camera, shading);
            let steps = self.paths.enqueue(view, memory, (vertex, false), room)?;
            events.extend(steps.map(Step::from));
            events.push(
                self.resolve_light_vertices
                    .launch(
                        grid,
                        scene,
                        shading,
                        vertex,
                        room,
                        queue,
                        path_states,
                        surfaces,
                        step_rays,
                        counters,
                    )?
                    .into(),
            );
        }
        events.push(
            self.resolve_light_paths
                .launch(
                    grid,
                    scene,
                    camera,
                    shading,
                    of_glass,
                    count,
                    rays,
                    paths,
                    first,
                    room,
                    path_states,
                    info,
                    keys,
                    cells,
                )?
                .into(),
        );
        Ok(())
    }
}
