//! Light for the cache's cells: one kernel where rays travel in packets, and for GPUs several that hand paths on in memory.

use crate::error::Result;
use crate::gpu::opencl::{Buffer, Device, Event, Program};
use crate::layout::{CACHE_PATH, CacheInfo, Camera, PASSED_WORDS, Shading};
use crate::trace::kernels::{
    AddCellLight, BeginCellPaths, Grid, LightCells, ResolveCellVertices, SceneOf, WeighCellPaths,
};
use crate::trace::paths::{self, PathKernels, PathMemory};
use crate::trace::{TracePattern, Traversal};

use super::{Memory, PATHS};

/// Words of memory for what a path finds at its vertices.
const PASSED: usize = (CACHE_PATH * PASSED_WORDS) as usize;

/// The kernels of a variant.
#[derive(Debug)]
pub(super) enum CellLight {
    Packet(LightCells),
    SingleRay(Box<CellPaths>),
}

/// The kernels of `kernels/gpu/cells.cl`, and memory for their paths, made when they are first launched.
#[derive(Debug)]
pub(super) struct CellPaths {
    begin_cell_paths: BeginCellPaths,
    paths: PathKernels,
    resolve_cell_vertices: ResolveCellVertices,
    weigh_cell_paths: WeighCellPaths,
    add_cell_light: AddCellLight,
    memory: Option<(PathMemory, Buffer<u32>)>,
}

/// A view, and what its paths are sent by.
#[derive(Clone, Copy)]
pub(super) struct Seen<'a> {
    pub scene: SceneOf<'a>,
    pub camera: &'a Camera,
    pub shading: &'a Shading,
    pub pattern: &'a TracePattern,
}

impl CellLight {
    pub fn of(program: &Program, traversal: Traversal) -> Result<Self> {
        Ok(match traversal {
            Traversal::Packet => CellLight::Packet(LightCells::of(program)?),
            Traversal::SingleRay => CellLight::SingleRay(Box::new(CellPaths::of(program)?)),
        })
    }

    /// The names of its kernels that may need memory of their own.
    pub fn kernels(traversal: Traversal) -> &'static [&'static str] {
        match traversal {
            Traversal::Packet => &["light_cells"],
            Traversal::SingleRay => &["begin_cell_paths", "resolve_cell_vertices", "add_cell_light"],
        }
    }

    /// Enqueues what brings light to cells.
    pub fn enqueue(
        &mut self,
        device: &Device,
        seen: Seen,
        info: &CacheInfo,
        (memory, counters): (&Memory, &Buffer<u32>),
    ) -> Result<Vec<Event>> {
        match self {
            CellLight::Packet(kernel) => {
                let Memory { keys, cells, sums, touched } = memory;
                let Seen { scene, camera, shading, pattern } = seen;
                let grid = Grid { items: info.paths as usize, group: Traversal::Packet.group() };
                let (samples, count) = (&pattern.samples, pattern.samples.len() as u32);
                let event = kernel.launch(
                    grid, scene, camera, shading, info, samples, count, keys, cells, sums, touched, counters,
                )?;
                Ok(vec![event])
            }
            CellLight::SingleRay(paths) => paths.enqueue(device, seen, info, (memory, counters)),
        }
    }
}

impl CellPaths {
    fn of(program: &Program) -> Result<Self> {
        Ok(CellPaths {
            begin_cell_paths: BeginCellPaths::of(program)?,
            paths: PathKernels::of(program)?,
            resolve_cell_vertices: ResolveCellVertices::of(program)?,
            weigh_cell_paths: WeighCellPaths::of(program)?,
            add_cell_light: AddCellLight::of(program)?,
            memory: None,
        })
    }

    fn enqueue(
        &mut self,
        device: &Device,
        seen: Seen,
        info: &CacheInfo,
        (memory, counters): (&Memory, &Buffer<u32>),
    ) -> Result<Vec<Event>> {
        let Seen { scene, camera, shading, pattern } = seen;
        let room = info.paths;
        if pattern.samples.len() == 0 {
            return Ok(Vec::new());
        }
        let known = self.memory.take().filter(|(own, _)| own.room(shading.lights) >= room);
        let (own, passed) = match known {
            Some(known) => self.memory.insert(known),
            None => self.memory.insert(memory_for(device, shading.lights)?),
        };
        let Memory { keys, cells, sums, touched } = memory;
        let PathMemory { queue, states, surfaces, rays, .. } = &*own;
        let of_paths = paths::grid(room, 1);
        let (samples, count) = (&pattern.samples, pattern.samples.len() as u32);
        let begun = self
            .begin_cell_paths
            .launch(of_paths, scene, camera, info, samples, count, room, queue, states, passed, counters)?;
        let mut events = vec![begun];
        for vertex in 0..=CACHE_PATH {
            let view = (scene, camera, shading);
            events.extend(self.paths.enqueue(view, own, (vertex, vertex == 0), room)?);
            events.push(self.resolve_cell_vertices.launch(
                of_paths, scene, camera, shading, info, vertex, room, queue, states, surfaces, rays, keys,
                cells, passed, counters,
            )?);
        }
        events.push(self.weigh_cell_paths.launch(of_paths, info, room, passed)?);
        let of_cells = paths::grid(room, 2 * CACHE_PATH as usize);
        events.push(
            self.add_cell_light
                .launch(of_cells, scene, camera, info, room, keys, cells, sums, touched, passed, counters)?,
        );
        Ok(events)
    }
}

/// Memory for the paths of a frame, and for what they pass.
fn memory_for(device: &Device, lights: u32) -> Result<(PathMemory, Buffer<u32>)> {
    let paths = PATHS as usize;
    let passed = Buffer::new(device, paths * PASSED)?;
    Ok((PathMemory::new(device, paths, paths * paths::rays_of_step(lights))?, passed))
}

/// The same in bytes, where each surface asks so many punctual lights.
pub(super) fn bytes_under_way(lights: u32) -> u64 {
    let paths = PATHS as usize;
    let passed = paths * PASSED * size_of::<u32>();
    paths::bytes_of(paths, paths * paths::rays_of_step(lights)) + passed as u64
}
