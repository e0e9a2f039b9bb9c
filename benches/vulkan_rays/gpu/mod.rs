//! Vulkan's own ways to trace rays: triangles, rays and answers in a device's memory, and what traces them there.

mod device;
mod job;
mod pipeline;
mod queries;
mod shaders;
mod structure;

use glam::Vec3;

use device::Device;
use job::Job;
pub use job::Rays;
use pipeline::Pipeline;
use queries::Queries;
use structure::Structure;

/// One of Vulkan's ways to trace rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// VK_KHR_ray_query in a compute shader.
    Queries,
    /// VK_KHR_ray_tracing_pipeline.
    Pipeline,
}

impl Way {
    pub const ALL: [Way; 2] = [Way::Queries, Way::Pipeline];

    pub fn name(self) -> &'static str {
        match self {
            Way::Queries => "ray queries",
            Way::Pipeline => "the ray-tracing pipeline",
        }
    }

    pub fn extension(self) -> &'static str {
        match self {
            Way::Queries => "VK_KHR_ray_query",
            Way::Pipeline => "VK_KHR_ray_tracing_pipeline",
        }
    }
}

pub struct Gpu {
    device: Device,
    job: Job,
    queries: Option<Queries>,
    pipeline: Option<Pipeline>,
    structure: Option<Structure>,
}

impl Gpu {
    /// The first device that has any of the ways and `wanted` in its name, graphics cards first; `None` without one.
    pub fn open(wanted: &str) -> Result<Option<Gpu>, String> {
        let Some(device) = Device::open(wanted)? else { return Ok(None) };
        let job = Job::new(&device)?;
        let queries = device.able.queries.then(|| Queries::new(&device, &job)).transpose()?;
        let pipeline = device.able.pipelines.then(|| Pipeline::new(&device, &job)).transpose()?;
        Ok(Some(Gpu { device, job, queries, pipeline, structure: None }))
    }

    pub fn name(&self) -> &str {
        &self.device.able.name
    }

    pub fn has(&self, way: Way) -> bool {
        match way {
            Way::Queries => self.queries.is_some(),
            Way::Pipeline => self.pipeline.is_some(),
        }
    }

    /// Builds the acceleration structure; milliseconds that it took, the copies to the device apart.
    pub fn build(&mut self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<f64, String> {
        Ok(self.structure.insert(Structure::build(&self.device, positions, triangles)?).build_ms)
    }

    /// Brings rays to the device.
    pub fn load(&mut self, rays: &Rays) -> Result<(), String> {
        let structure = self.structure.as_ref().ok_or("no acceleration structure is built")?;
        self.job.load(&self.device, structure, rays)
    }

    /// Traces the loaded rays; milliseconds from the launch until that is done.
    pub fn trace(&self, way: Way) -> Result<f64, String> {
        let missing = || format!("{} has no {}", self.name(), way.extension());
        match way {
            Way::Queries => self.queries.as_ref().ok_or_else(missing)?.trace(&self.device, &self.job),
            Way::Pipeline => self.pipeline.as_ref().ok_or_else(missing)?.trace(&self.device, &self.job),
        }
    }

    /// What the last trace has found, ray by ray: a distance, or 1e30 where nothing is hit; of any hit, what it likes.
    /// Answers are then forgotten: a way that gives none cannot pass with those of another.
    pub fn take_answers(&self) -> Result<Vec<f32>, String> {
        self.job.take_answers(&self.device)
    }
}
