//! Paths from surface to surface, on GPUs: kernels that hand on in memory what a path's next part needs (`kernels/gpu/paths.cl`).

use crate::error::Result;
use crate::gpu::opencl::{Buffer, Device, Event, Program};
use crate::layout::{CACHE_PATH, Camera, PATH_QUEUES, PATH_WORDS, STEP_WORDS, Shading};

use super::Traversal;
use super::kernels::{AimPathRays, Grid, IntersectPathRays, SceneOf, ShadePathRays, ShadePathVertices};
use super::source::SURFACE_BYTES;

/// Rays of each path's step for which there is memory: to the sun, to an emitter, one of the mixture, and to two punctual
/// lights. Where more lights are asked, fewer paths are under way together.
pub(super) const STEP_RAYS: usize = 5;

const _: () = assert!(CACHE_PATH + 1 < PATH_QUEUES, "each vertex has a queue");

/// The kernels that whoever follows paths launches for each of their vertices.
#[derive(Debug)]
pub(super) struct PathKernels {
    shade_path_vertices: ShadePathVertices,
    aim_path_rays: AimPathRays,
    intersect_path_rays: IntersectPathRays,
    shade_path_rays: ShadePathRays,
}

/// Memory for paths under way.
#[derive(Debug)]
pub(super) struct PathMemory {
    /// How many there is room for.
    paths: usize,
    /// Those that have come to the next vertex.
    pub queue: Buffer<u32>,
    pub states: Buffer<u32>,
    /// The surface of each one's vertex.
    pub surfaces: Buffer<u32>,
    /// The rays of each one's step.
    pub rays: Buffer<u32>,
}

impl PathKernels {
    pub fn of(program: &Program) -> Result<Self> {
        Ok(PathKernels {
            shade_path_vertices: ShadePathVertices::of(program)?,
            aim_path_rays: AimPathRays::of(program)?,
            intersect_path_rays: IntersectPathRays::of(program)?,
            shade_path_rays: ShadePathRays::of(program)?,
        })
    }

    /// Enqueues the step of paths at a vertex, of `room` at most; `of_eye`: the eye sees it.
    pub fn enqueue(
        &self,
        (scene, camera, shading): (SceneOf, &Camera, &Shading),
        memory: &PathMemory,
        (vertex, of_eye): (u32, bool),
        room: u32,
    ) -> Result<[Event; 4]> {
        let PathMemory { queue, states, surfaces, rays, .. } = memory;
        let (of_paths, of_rays) = (grid(room, 1), grid(room, rays_of_step(shading.lights)));
        let of_eye = u32::from(of_eye);
        Ok([
            self.shade_path_vertices
                .launch(of_paths, scene, camera, shading, of_eye, vertex, room, queue, states, surfaces)?,
            self.aim_path_rays
                .launch(of_rays, scene, shading, vertex, room, queue, states, surfaces, rays)?,
            self.intersect_path_rays
                .launch(of_rays, scene, shading, vertex, room, queue, states, surfaces, rays)?,
            self.shade_path_rays
                .launch(of_rays, scene, shading, vertex, room, queue, states, surfaces, rays)?,
        ])
    }
}

impl PathMemory {
    /// For so many paths and rays of steps.
    pub fn new(device: &Device, paths: usize, rays: usize) -> Result<Self> {
        Ok(PathMemory {
            paths,
            queue: Buffer::new(device, PATH_QUEUES as usize + 2 * paths)?,
            states: Buffer::new(device, paths * PATH_WORDS as usize)?,
            surfaces: Buffer::new(device, paths * SURFACE_BYTES / size_of::<u32>())?,
            rays: Buffer::new(device, rays * STEP_WORDS as usize)?,
        })
    }

    /// Paths that may be under way together where each surface asks so many punctual lights.
    pub fn room(&self, lights: u32) -> u32 {
        let rays = self.rays.len() / STEP_WORDS as usize;
        self.paths.min(rays / rays_of_step(lights)) as u32
    }
}

/// Bytes of memory for so many paths and rays of steps.
pub(super) fn bytes_of(paths: usize, rays: usize) -> u64 {
    let words = PATH_QUEUES as usize + paths * (2 + PATH_WORDS as usize) + rays * STEP_WORDS as usize;
    (words * size_of::<u32>() + paths * SURFACE_BYTES) as u64
}

/// A work-item for each of so many things of so many paths.
pub(super) fn grid(paths: u32, each: usize) -> Grid {
    Grid { items: (paths as usize * each).max(1), group: Traversal::SingleRay.group() }
}

/// Rays of a step where so many punctual lights are asked: `steps_of` in `kernels/gpu/paths.cl`.
pub(super) fn rays_of_step(lights: u32) -> usize {
    lights as usize + 3
}
