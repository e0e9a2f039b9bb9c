//! VK_KHR_ray_tracing_pipeline: a shader that sends rays, one for those that hit and one for those that miss.
#![allow(unsafe_code)]

use ash::{khr, vk};

use super::device::{Device, failed};
use super::job::Job;
use super::shaders::{self, Stage};

/// The pipeline, and where its table of shaders is.
pub struct Pipeline {
    functions: khr::ray_tracing_pipeline::Device,
    pipeline: vk::Pipeline,
    /// One entry for each of [`GROUPS`].
    table: [vk::StridedDeviceAddressRegionKHR; GROUPS.len()],
}

/// The shader of each group; the first two send rays, for the nearest hit and for any.
const GROUPS: [Stage; 4] = [Stage::Closest, Stage::Any, Stage::Missed, Stage::Met];

impl Pipeline {
    /// For a device that has such pipelines.
    pub fn new(device: &Device, job: &Job) -> Result<Pipeline, String> {
        let functions = khr::ray_tracing_pipeline::Device::new(&device.instance, &device.device);
        let mut modules = Vec::new();
        for stage in GROUPS {
            let words = shaders::stage(stage)?;
            let create = vk::ShaderModuleCreateInfo::default().code(&words);
            // SAFETY: the words are a whole module that naga has written.
            let module = unsafe { device.device.create_shader_module(&create, None) };
            modules.push(module.map_err(failed("refuses a shader"))?);
        }
        let stages: Vec<_> = GROUPS
            .iter()
            .zip(modules)
            .map(|(stage, module)| {
                let create = vk::PipelineShaderStageCreateInfo::default();
                create.stage(stage.flag()).module(module).name(stage.name())
            })
            .collect();
        let groups: Vec<_> = (0..).zip(GROUPS).map(|(index, stage)| group(index, stage)).collect();
        let create = [vk::RayTracingPipelineCreateInfoKHR::default()
            .stages(&stages)
            .groups(&groups)
            .max_pipeline_ray_recursion_depth(1)
            .layout(job.layout)];
        // SAFETY: each module has its entry point, and the layout what they read and write.
        let pipelines = unsafe {
            functions.create_ray_tracing_pipelines(
                vk::DeferredOperationKHR::null(),
                vk::PipelineCache::null(),
                &create,
                None,
            )
        };
        let pipeline = pipelines.map_err(|(_, error)| failed("makes no ray-tracing pipeline")(error))?[0];
        let table = table(device, &functions, pipeline)?;
        Ok(Pipeline { functions, pipeline, table })
    }

    /// Traces the job's rays; milliseconds from the launch until that is done.
    pub fn trace(&self, device: &Device, job: &Job) -> Result<f64, String> {
        let [closest, any, missed, met] = &self.table;
        let none = vk::StridedDeviceAddressRegionKHR::default();
        device.submit(|device, commands| {
            // SAFETY: pipeline and table live as long as the process; no shader calls another.
            unsafe {
                let point = vk::PipelineBindPoint::RAY_TRACING_KHR;
                device.cmd_bind_pipeline(commands, point, self.pipeline);
                job.bind(device, commands);
                let send = if job.any() { any } else { closest };
                self.functions.cmd_trace_rays(commands, send, missed, met, &none, job.count(), 1, 1);
            }
        })
    }
}

fn group(index: u32, stage: Stage) -> vk::RayTracingShaderGroupCreateInfoKHR<'static> {
    let group = vk::RayTracingShaderGroupCreateInfoKHR::default()
        .general_shader(vk::SHADER_UNUSED_KHR)
        .closest_hit_shader(vk::SHADER_UNUSED_KHR)
        .any_hit_shader(vk::SHADER_UNUSED_KHR)
        .intersection_shader(vk::SHADER_UNUSED_KHR);
    match stage {
        Stage::Met => {
            group.ty(vk::RayTracingShaderGroupTypeKHR::TRIANGLES_HIT_GROUP).closest_hit_shader(index)
        }
        _ => group.ty(vk::RayTracingShaderGroupTypeKHR::GENERAL).general_shader(index),
    }
}

/// The groups' handles in the device's memory, each at an address that may be a table's start.
fn table(
    device: &Device,
    functions: &khr::ray_tracing_pipeline::Device,
    pipeline: vk::Pipeline,
) -> Result<[vk::StridedDeviceAddressRegionKHR; GROUPS.len()], String> {
    let properties = device.table_properties();
    let handle = properties.shader_group_handle_size as usize;
    let base = u64::from(properties.shader_group_base_alignment);
    let (entry, stride) = (
        (handle as u64).next_multiple_of(u64::from(properties.shader_group_handle_alignment)),
        (handle as u64).next_multiple_of(base),
    );
    // SAFETY: the pipeline has that many groups, and the size is that of their handles.
    let handles = unsafe {
        functions.get_ray_tracing_shader_group_handles(
            pipeline,
            0,
            GROUPS.len() as u32,
            handle * GROUPS.len(),
        )
    }
    .map_err(failed("tells no handles of shaders"))?;
    let usage = vk::BufferUsageFlags::SHADER_BINDING_TABLE_KHR
        | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS
        | vk::BufferUsageFlags::TRANSFER_DST;
    let home = device.buffer(base + stride * GROUPS.len() as u64, usage, false)?;
    let address = device.address(home);
    let start = address.next_multiple_of(base);
    let mut bytes = vec![0u8; home.size as usize];
    let place = |index: usize| start + stride * index as u64;
    for (index, from) in handles.chunks_exact(handle).enumerate() {
        let at = (place(index) - address) as usize;
        bytes[at..at + handle].copy_from_slice(from);
    }
    device.fill(home, &bytes)?;
    let region = |index| {
        let region = vk::StridedDeviceAddressRegionKHR::default().device_address(place(index));
        region.stride(entry).size(entry)
    };
    Ok([region(0), region(1), region(2), region(3)])
}
