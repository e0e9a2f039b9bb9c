//! Rays and answers in a device's memory, in the set that shaders read and write.
#![allow(unsafe_code)]

use ash::vk;
use bytemuck::cast_slice;

use super::device::{Buffer, Device, failed};
use super::structure::Structure;

/// Rays to be traced.
pub struct Rays<'a> {
    /// Where rays start that have no origin of their own.
    pub eye: [f32; 3],
    /// Origins of so many rays each.
    pub origins: &'a [[f32; 3]],
    pub rays_per_origin: u32,
    /// One for each ray.
    pub directions: &'a [[f32; 3]],
    /// Whether anything is hit is enough.
    pub any: bool,
}

/// What shaders read and write: `pipeline.wgsl`.
pub struct Job {
    pub layout: vk::PipelineLayout,
    set: vk::DescriptorSet,
    loaded: Option<Loaded>,
}

struct Loaded {
    answers: Buffer,
    push: [u32; 8],
    count: u32,
    any: bool,
}

const STAGE: vk::ShaderStageFlags = vk::ShaderStageFlags::RAYGEN_KHR;
const KINDS: [vk::DescriptorType; 4] = [
    vk::DescriptorType::ACCELERATION_STRUCTURE_KHR,
    vk::DescriptorType::STORAGE_BUFFER,
    vk::DescriptorType::STORAGE_BUFFER,
    vk::DescriptorType::STORAGE_BUFFER,
];

impl Job {
    /// One without rays.
    pub fn new(device: &Device) -> Result<Job, String> {
        let bindings: Vec<_> = (0..)
            .zip(KINDS)
            .map(|(binding, kind)| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(kind)
                    .descriptor_count(1)
                    .stage_flags(STAGE)
            })
            .collect();
        let sizes = KINDS.map(|kind| vk::DescriptorPoolSize::default().ty(kind).descriptor_count(1));
        let push = [vk::PushConstantRange::default().stage_flags(STAGE).size(32)];
        let device = &device.device;
        // SAFETY: every structure lives until its call returns, and handles are used with the device that made them.
        unsafe {
            let create = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
            let sets = [device
                .create_descriptor_set_layout(&create, None)
                .map_err(failed("makes no set layout"))?];
            let create =
                vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(&push);
            let layout = device.create_pipeline_layout(&create, None).map_err(failed("makes no layout"))?;
            let create = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
            let pool = device.create_descriptor_pool(&create, None).map_err(failed("makes no pool"))?;
            let allocate = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&sets);
            let set = device.allocate_descriptor_sets(&allocate).map_err(failed("makes no set"))?[0];
            Ok(Job { layout, set, loaded: None })
        }
    }

    /// Brings rays to the device.
    pub fn load(&mut self, device: &Device, structure: &Structure, rays: &Rays) -> Result<(), String> {
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let none = [[0f32; 3]];
        let origins = device.upload(if rays.origins.is_empty() { &none } else { rays.origins }, usage)?;
        let directions = device.upload(rays.directions, usage)?;
        let count = rays.directions.len() as u32;
        let copied = vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
        let answers = device.buffer(u64::from(count) * 4, usage | copied, false)?;
        let infos = [origins, directions, answers]
            .map(|buffer| [vk::DescriptorBufferInfo::default().buffer(buffer.buffer).range(vk::WHOLE_SIZE)]);
        let structures = [structure.handle];
        let mut write =
            vk::WriteDescriptorSetAccelerationStructureKHR::default().acceleration_structures(&structures);
        let mut first = vk::WriteDescriptorSet::default()
            .dst_set(self.set)
            .descriptor_type(KINDS[0])
            .push_next(&mut write);
        first.descriptor_count = 1;
        let mut writes = vec![first];
        for (binding, info) in (1..).zip(&infos) {
            writes.push(
                vk::WriteDescriptorSet::default()
                    .dst_set(self.set)
                    .dst_binding(binding)
                    .descriptor_type(KINDS[binding as usize])
                    .buffer_info(info),
            );
        }
        // SAFETY: nothing that uses the set is under way: every submission is waited for.
        unsafe { device.device.update_descriptor_sets(&writes, &[]) };
        if let Some(last) = self.loaded.take() {
            device.free(last.answers);
        }
        let [x, y, z] = rays.eye.map(f32::to_bits);
        let push = [x, y, z, count, rays.rays_per_origin, 0, 0, 0];
        self.loaded = Some(Loaded { answers, push, count, any: rays.any });
        self.forget(device)
    }

    /// The number of loaded rays.
    pub fn count(&self) -> u32 {
        self.loaded.as_ref().map_or(0, |loaded| loaded.count)
    }

    /// Whether anything that the loaded rays hit is enough.
    pub fn any(&self) -> bool {
        self.loaded.as_ref().is_some_and(|loaded| loaded.any)
    }

    /// Lets shaders that are launched next see the rays.
    pub fn bind(&self, device: &ash::Device, commands: vk::CommandBuffer) {
        let point = vk::PipelineBindPoint::RAY_TRACING_KHR;
        let Some(loaded) = &self.loaded else { return };
        // SAFETY: the set's buffers and the layout live as long as the process.
        unsafe {
            device.cmd_bind_descriptor_sets(commands, point, self.layout, 0, &[self.set], &[]);
            let bytes: &[u8] = cast_slice(&loaded.push);
            device.cmd_push_constants(commands, self.layout, STAGE, 0, bytes);
        }
    }

    /// What the last trace has found, which is then forgotten.
    pub fn take_answers(&self, device: &Device) -> Result<Vec<f32>, String> {
        let loaded = self.loaded.as_ref().ok_or("no rays are loaded")?;
        let answers = device.download(loaded.answers, loaded.count as usize)?;
        self.forget(device)?;
        Ok(answers)
    }

    fn forget(&self, device: &Device) -> Result<(), String> {
        let Some(loaded) = &self.loaded else { return Ok(()) };
        device.fill(loaded.answers, &vec![f32::NAN; loaded.count as usize])
    }
}
