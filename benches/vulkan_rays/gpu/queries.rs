//! VK_KHR_ray_query in a compute shader.
#![allow(unsafe_code)]

use ash::vk;

use super::device::{Device, failed};
use super::job::Job;
use super::shaders;

/// Groups in a row; `ROW` of queries.wgsl is this times 64.
const GROUPS_ACROSS: u32 = 1024;
const GROUP: u32 = 64;

/// The shader's two entry points.
pub struct Queries([vk::Pipeline; 2]);

impl Queries {
    /// For a device that has ray queries.
    pub fn new(device: &Device, job: &Job) -> Result<Queries, String> {
        let device = &device.device;
        let words = shaders::queries()?;
        let create = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: the words are a whole module that naga has written.
        let module =
            unsafe { device.create_shader_module(&create, None) }.map_err(failed("refuses a shader"))?;
        let creates = [c"closest", c"any"].map(|name| {
            let stage = vk::PipelineShaderStageCreateInfo::default()
                .stage(vk::ShaderStageFlags::COMPUTE)
                .module(module)
                .name(name);
            vk::ComputePipelineCreateInfo::default().stage(stage).layout(job.layout)
        });
        // SAFETY: the module has both entry points, and the layout what they read and write.
        let pipelines = unsafe { device.create_compute_pipelines(vk::PipelineCache::null(), &creates, None) }
            .map_err(|(_, error)| failed("makes no pipeline")(error))?;
        Ok(Queries([pipelines[0], pipelines[1]]))
    }

    /// Traces the job's rays; milliseconds from the launch until that is done.
    pub fn trace(&self, device: &Device, job: &Job) -> Result<f64, String> {
        let groups = job.count().div_ceil(GROUP);
        let (across, down) = (groups.min(GROUPS_ACROSS), groups.div_ceil(GROUPS_ACROSS));
        device.submit(|device, commands| {
            // SAFETY: the pipelines live as long as the process.
            unsafe {
                let pipeline = self.0[usize::from(job.any())];
                device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, pipeline);
                job.bind(device, commands, vk::PipelineBindPoint::COMPUTE);
                device.cmd_dispatch(commands, across, down, 1);
            }
        })
    }
}
