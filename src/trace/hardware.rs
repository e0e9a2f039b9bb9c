//! Rays in hardware: ray queries of Vulkan find what the kernels' rays hit, where the OpenCL device and the one that presents
//! use the same memory.
//!
//! Kernels for GPUs hand rays on in memory anyway (`kernels/gpu/shade.cl`). Here a compute shader (`kernels/rays.wgsl`) reads
//! them from there, traces them through an acceleration structure of the scene's triangles, and writes what became of them in
//! place, as the kernels would have: light rays of both kinds, rays to the sun from pixels and from samples, camera rays of
//! pixels and of samples, rays of mirrors and those to the sun from what mirrors show. What lays rays out and takes what was
//! found stays OpenCL's (`kernels/gpu/hardware.cl`, and for samples `shade.cl` and `sun.cl`), and so do rays that are not handed over: those of edges, glass,
//! punctual lights, paths and the cache of light.
//!
//! Acceleration structures know no textures. Triangles that let rays pass by their alpha are no hits there: rays that meet
//! one before any other are left open, and the kernels trace them. So every scene is traced, whatever its materials, and what
//! differs is rounding at edges. Triangles have the same names, their places in leaf order, and instances are placed by the
//! same matrices.
//!
//! **Scenes that move.** What stays, and each shape that is kept once, is built once. Instances that move are placed elsewhere
//! in the top level, which is built anew for each instant that rays are traced at, where anything has moved. Parts whose
//! vertices are others at each instant, small ones that move as a whole among them, have bottom levels that are built anew
//! too, fast rather than good, from the corners that the kernels' own leaves have, whoever has deformed them: a kernel gathers
//! those into memory that both APIs use. So rays meet the triangles that the kernels' rays meet, to the bit. Parts that have
//! not moved since they were built are not built again. What is hidden or flattened is placed nowhere. All of it stays in the
//! same memory, and is built in front of the first rays of an instant, by the same commands.
//!
//! Both APIs are waited for by the host, between the kernels that lay rays out, the shader and the kernels that take them. How many
//! rays mirrors send is read there.

mod moving;
mod queries;
mod structure;

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use super::{SceneData, SceneState};
use crate::error::{Error, Result};
use crate::gpu::interop::Shared;
use crate::gpu::opencl::{Buffer, Device};
use crate::gpu::vulkan::{BufferRef, Commands, Context, RayPipeline, Shader};
use crate::waiting::Limits;
pub use queries::{Answer, Asked, RayQueries};
use structure::{Structure, Top};

/// Rays of a group, which lie together: `kernels/gpu/shade.cl` has as many of a sample.
pub(super) const GROUP: usize = 32;
/// Words of memory of a ray under way: planes in `kernels/gpu/shade.cl`.
pub(super) const RAY_WORDS: usize = 18;
/// The plane behind them: where the rays of a sample start.
pub(super) const PLANE_ORIGIN: u32 = RAY_WORDS as u32;
/// The first plane of where rays start that are no sample's: `PLANE_OWN_ORIGIN` of `kernels/gpu/hardware.cl`.
pub(super) const PLANE_OWN_ORIGIN: u32 = 5;

/// Work-items of a group of the shader, and groups in a row: `ROW` of `kernels/rays.wgsl` is their product.
const ITEMS: u32 = 64;
const GROUPS_ACROSS: u32 = 1024;

const SHADER: Shader = Shader {
    name: "rays.wgsl",
    words: include_bytes!(concat!(env!("OUT_DIR"), "/rays.spv")),
    buffers: 4,
    push: size_of::<Job>() as u32,
};

/// The shader as drivers get it: what is measured of it depends on it.
pub(crate) fn shader_words() -> &'static [u8] {
    SHADER.words
}

/// As `Job` of `kernels/rays.wgsl`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Job {
    stride: u32,
    rays: u32,
    origin: u32,
    origins: u32,
}

/// Rays in memory, for both to use.
struct Batch {
    /// Whose kernels use them; none where the host does.
    device: Option<Device>,
    /// How many groups of rays there is room for.
    groups: usize,
    rays: Shared<u32>,
    queue: Shared<u32>,
}

/// Some rays of a batch.
#[derive(Clone, Copy)]
pub(super) struct Rays {
    /// Groups that the batch is divided into: planes have [`GROUP`] words for each.
    pub groups: u32,
    /// How many of them are traced, from the first on.
    pub count: u32,
    /// The first plane of their origins, and how many of these there are: ray i leaves origin i modulo that.
    pub origin: (u32, u32),
}

/// A scene in a device that traces rays, and memory for rays under way.
pub(super) struct HardwareRays {
    context: Context,
    pipeline: RayPipeline,
    commands: Commands,
    structure: Structure,
    batch: Option<Batch>,
    /// Groups of rays under way at most.
    most: usize,
}

impl std::fmt::Debug for HardwareRays {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("HardwareRays").field("context", &self.context).finish_non_exhaustive()
    }
}

impl HardwareRays {
    /// Builds the acceleration structure of a scene, which kernels of `device` move; `most` is how many groups of rays are under
    /// way at most.
    ///
    /// # Errors
    /// [`Error::Device`] where the device has no ray queries switched on, has no room for it, refuses the shader, or is lost.
    pub fn new(context: &Context, device: Option<&Device>, data: &SceneData, most: usize) -> Result<Self> {
        if !context.traces_rays() {
            let problem = "it has no ray queries switched on; open it with ContextOptions::ray_queries";
            return Err(Error::Device { device: context.report().name.clone(), problem: problem.into() });
        }
        let plane_bytes = (GROUP * RAY_WORDS + 3) as u64 * size_of::<u32>() as u64;
        let mut rays = HardwareRays {
            context: context.clone(),
            pipeline: RayPipeline::new(context, &SHADER, "intersect_rays")?,
            commands: Commands::new(context)?,
            structure: Structure::of(context, device, data)?,
            batch: None,
            most: most.min((context.storage_range() / plane_bytes) as usize).max(1),
        };
        rays.build_moving()?;
        Ok(rays)
    }

    /// Builds what moves once, so that it is known that the device can.
    fn build_moving(&mut self) -> Result<()> {
        if let Top::Moving(moving) = &mut self.structure.top {
            self.commands.begin()?;
            moving.renew(&mut self.commands);
            self.commands.submit()?;
            self.commands.wait_within(Limits::BUILDING)?;
            moving.renewed();
        }
        Ok(())
    }

    /// Takes another instant of the scene in, for the next rays. `gather` has kernels write the corners of the triangles at some
    /// places, nine floats for each, where some are elsewhere.
    ///
    /// # Errors
    /// Those of `gather`, and [`Error::Device`] where the devices cannot hand memory on.
    pub fn move_to(
        &mut self,
        state: &SceneState,
        gather: impl FnOnce(Range<u32>, &Buffer<f32>) -> Result<()>,
    ) -> Result<()> {
        match &mut self.structure.top {
            Top::Still(_) => Ok(()),
            Top::Moving(moving) => moving.move_to(state, gather),
        }
    }

    /// Groups of rays that go together at most.
    pub fn most(&self) -> usize {
        self.most
    }

    /// Makes room for so many groups, [`HardwareRays::most`] of them at most; nothing is under way.
    ///
    /// # Errors
    /// [`Error::Device`] where there is no room.
    pub fn reserve(&mut self, device: Option<&Device>, groups: usize) -> Result<()> {
        if self.batch.as_ref().is_none_or(|batch| batch.groups < groups) {
            self.let_go();
            let groups = groups.next_power_of_two().min(self.most);
            let shared = |words| Shared::new(device, &self.context, words);
            let batch = Batch {
                device: device.cloned(),
                groups,
                rays: shared(groups * (GROUP * RAY_WORDS + 3))?,
                queue: shared(1 + groups * GROUP)?,
            };
            batch.acquire()?;
            self.batch = Some(batch);
        }
        Ok(())
    }

    /// Frees the memory of rays.
    fn let_go(&mut self) {
        if let Some(batch) = self.batch.take() {
            let device = batch.device.clone();
            free(batch, || device.as_ref().map_or(Ok(()), Device::finish));
        }
    }

    /// The rays, and the queue of those that met a surface, as kernels take them.
    ///
    /// # Errors
    /// [`Error::Device`] where the devices share no memory.
    pub fn buffers(&self) -> Result<(&Buffer<u32>, &Buffer<u32>)> {
        let buffers = self.batch.as_ref().and_then(Batch::buffers);
        buffers.ok_or_else(|| Error::Device {
            device: self.context.report().name.clone(),
            problem: "it shares no memory with the device that traces; set trace.hardware_rays=off".into(),
        })
    }

    /// Waits for the kernels that lay rays out, has them traced where the scene is now, and waits for that: how long it took in
    /// milliseconds.
    ///
    /// # Errors
    /// [`Error::Device`] where either device is lost.
    pub fn trace(&mut self, rays: Rays) -> Result<f64> {
        let Some(batch) = &self.batch else { return Ok(0.0) };
        batch.release()?;
        batch.device.as_ref().map_or(Ok(()), Device::finish)?;
        let stride = rays.groups * GROUP as u32;
        let (plane, origins) = rays.origin;
        let job = Job { stride, rays: rays.count, origin: plane * stride, origins };
        let groups = rays.count.div_ceil(ITEMS);
        let (across, down) = (groups.clamp(1, GROUPS_ACROSS), groups.div_ceil(GROUPS_ACROSS));
        let Structure { top, placed, places } = &mut self.structure;
        let buffers: [&BufferRef; 4] =
            [&batch.rays.vulkan(), &batch.queue.vulkan(), &(&*placed).into(), &(&*places).into()];
        self.commands.begin()?;
        if let Top::Moving(moving) = top
            && moving.renew(&mut self.commands)
        {
            self.commands.end_stage("acceleration structures");
        }
        let (buffers, bytes) = (buffers.map(Some), bytemuck::bytes_of(&job));
        self.commands.trace(&self.pipeline, top.level(), &buffers, bytes, [across, down, 1])?;
        self.commands.end_stage("rays");
        self.commands.submit()?;
        let ms = self.commands.wait()?.iter().map(|stage| stage.ms).sum();
        if let Top::Moving(moving) = top {
            moving.renewed();
        }
        batch.acquire()?;
        Ok(ms)
    }
}

impl Drop for HardwareRays {
    fn drop(&mut self) {
        self.let_go();
        if let Top::Moving(moving) = &mut self.structure.top {
            moving.let_go();
        }
    }
}

/// Frees memory that kernels write, which OpenCL does not keep for what is in its queue: `finish` waits for them. It is left
/// to those of a device that has failed, which may write to it yet.
fn free<T>(memory: T, finish: impl FnOnce() -> Result<()>) {
    if finish().is_err() {
        std::mem::forget(memory);
    }
}

impl Batch {
    fn buffers(&self) -> Option<(&Buffer<u32>, &Buffer<u32>)> {
        Some((self.rays.opencl()?, self.queue.opencl()?))
    }

    fn acquire(&self) -> Result<()> {
        self.buffers().map_or(Ok(()), |(rays, queue)| rays.acquire().and_then(|()| queue.acquire()))
    }

    fn release(&self) -> Result<()> {
        self.buffers().map_or(Ok(()), |(rays, queue)| rays.release().and_then(|()| queue.release()))
    }
}
