//! VK_KHR_ray_tracing_pipeline: triangles, rays and answers in a device's memory, and what traces them there.

mod device;
mod job;
mod pipeline;
mod shaders;
mod structure;

use glam::Vec3;

use device::Device;
use job::Job;
pub use job::Rays;
use pipeline::Pipeline;
use structure::Structure;

/// A device with its pipeline, and what it traces.
pub struct Gpu {
    device: Device,
    job: Job,
    pipeline: Pipeline,
    structure: Option<Structure>,
}

impl Gpu {
    /// The first device that has ray-tracing pipelines and `wanted` in its name, graphics cards first; `None` without one.
    pub fn open(wanted: &str) -> Result<Option<Gpu>, String> {
        let Some(device) = Device::open(wanted)? else { return Ok(None) };
        let job = Job::new(&device)?;
        let pipeline = Pipeline::new(&device, &job)?;
        Ok(Some(Gpu { device, job, pipeline, structure: None }))
    }

    pub fn name(&self) -> &str {
        &self.device.able.name
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
    pub fn trace(&self) -> Result<f64, String> {
        self.pipeline.trace(&self.device, &self.job)
    }

    /// What the last trace has found, ray by ray: a distance, or 1e30 where nothing is hit; of any hit, what it likes.
    /// Answers are then forgotten: a trace that gives none cannot pass with those of another.
    pub fn take_answers(&self) -> Result<Vec<f32>, String> {
        self.job.take_answers(&self.device)
    }
}
