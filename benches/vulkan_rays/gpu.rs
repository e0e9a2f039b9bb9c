//! A Vulkan device with ray queries: an acceleration structure, rays and answers in its memory. What is made lives
//! as long as the process.
#![allow(unsafe_code)]

use std::ffi::CStr;
use std::time::Instant;

use ash::{khr, vk};
use bytemuck::{Pod, cast_slice};
use glam::Vec3;

/// Groups in a row; `ROW` of rays.wgsl is this times 64.
const GROUPS_ACROSS: u32 = 1024;
const GROUP: u32 = 64;

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

struct Loaded {
    answers: Buffer,
    push: [u32; 8],
    count: u32,
    any: bool,
}

#[derive(Clone, Copy)]
struct Buffer {
    buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    size: u64,
}

pub struct Gpu {
    /// The loader's functions end with it.
    _entry: ash::Entry,
    device: ash::Device,
    structures: khr::acceleration_structure::Device,
    memory: vk::PhysicalDeviceMemoryProperties,
    name: String,
    /// What scratch memory is aligned to.
    alignment: u64,
    queue: vk::Queue,
    commands: vk::CommandBuffer,
    fence: vk::Fence,
    layout: vk::PipelineLayout,
    pipelines: [vk::Pipeline; 2],
    set: vk::DescriptorSet,
    structure: vk::AccelerationStructureKHR,
    loaded: Option<Loaded>,
}

/// What went wrong, in a sentence.
fn failed(what: &'static str) -> impl Fn(vk::Result) -> String {
    move |error| format!("Vulkan {what}: {error}")
}

const EXTENSIONS: [&CStr; 3] =
    [khr::acceleration_structure::NAME, khr::ray_query::NAME, khr::deferred_host_operations::NAME];

impl Gpu {
    /// The first device that has ray queries and `wanted` in its name, graphics cards first; `None` without one.
    pub fn open(wanted: &str) -> Result<Option<Gpu>, String> {
        // SAFETY: the loader's library is not unloaded, since the entry is kept.
        let Ok(entry) = (unsafe { ash::Entry::load() }) else { return Ok(None) };
        let app = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_2);
        let create = vk::InstanceCreateInfo::default().application_info(&app);
        // SAFETY: all pointers of the structure live until the call returns.
        let instance = match unsafe { entry.create_instance(&create, None) } {
            Ok(instance) => instance,
            Err(vk::Result::ERROR_INCOMPATIBLE_DRIVER) => return Ok(None),
            Err(error) => return Err(failed("gives no instance")(error)),
        };
        // SAFETY: the instance is valid.
        let all = unsafe { instance.enumerate_physical_devices() }.map_err(failed("lists no devices"))?;
        let mut able: Vec<_> = all.into_iter().filter_map(|d| able(&instance, d, wanted)).collect();
        able.sort_by_key(|(rank, ..)| *rank);
        let Some((_, physical, name, alignment)) = able.into_iter().next() else { return Ok(None) };
        let device = logical(&instance, physical)?;
        // SAFETY: queue 0 of family 0 was asked for.
        let queue = unsafe { device.get_device_queue(0, 0) };
        let pool =
            vk::CommandPoolCreateInfo::default().flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: the device is valid, and family 0 exists.
        let pool = unsafe { device.create_command_pool(&pool, None) }.map_err(failed("gives no pool"))?;
        let one = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
        // SAFETY: the pool was just made.
        let commands =
            unsafe { device.allocate_command_buffers(&one) }.map_err(failed("gives no commands"))?[0];
        // SAFETY: the device is valid.
        let fence = unsafe { device.create_fence(&vk::FenceCreateInfo::default(), None) }
            .map_err(failed("gives no fence"))?;
        let (layout, pipelines, set) = program(&device)?;
        Ok(Some(Gpu {
            structures: khr::acceleration_structure::Device::new(&instance, &device),
            // SAFETY: the physical device is the instance's.
            memory: unsafe { instance.get_physical_device_memory_properties(physical) },
            _entry: entry,
            device,
            name,
            alignment,
            queue,
            commands,
            fence,
            layout,
            pipelines,
            set,
            structure: vk::AccelerationStructureKHR::null(),
            loaded: None,
        }))
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// Builds the acceleration structure; milliseconds that it took, the copies to the device apart.
    pub fn build(&mut self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<f64, String> {
        let usage = vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR
            | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
        let vertices = self.upload(positions, usage)?;
        let indices = self.upload(triangles, usage)?;
        let start = Instant::now();
        let data = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
            .vertex_format(vk::Format::R32G32B32_SFLOAT)
            .vertex_data(self.address(vertices))
            .vertex_stride(12)
            .max_vertex(positions.len().saturating_sub(1) as u32)
            .index_type(vk::IndexType::UINT32)
            .index_data(self.address(indices));
        let bottom = self.structure_of(
            vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL,
            vk::GeometryTypeKHR::TRIANGLES,
            vk::AccelerationStructureGeometryDataKHR { triangles: data },
            triangles.len() as u32,
        )?;
        let info = vk::AccelerationStructureDeviceAddressInfoKHR::default().acceleration_structure(bottom);
        // SAFETY: the structure was just built.
        let reference = unsafe { self.structures.get_acceleration_structure_device_address(&info) };
        // One instance: the identity, visible to every mask, as VkAccelerationStructureInstanceKHR lays it out.
        let mut instance = [0u32; 16];
        for axis in 0..3 {
            instance[axis * 5] = 1f32.to_bits();
        }
        instance[12] = 0xff << 24;
        instance[13] = vk::GeometryInstanceFlagsKHR::TRIANGLE_FACING_CULL_DISABLE.as_raw() << 24;
        instance[14..].copy_from_slice(&[reference as u32, (reference >> 32) as u32]);
        let instances = self.upload(&[instance], usage)?;
        let data = vk::AccelerationStructureGeometryInstancesDataKHR::default().data(self.address(instances));
        self.structure = self.structure_of(
            vk::AccelerationStructureTypeKHR::TOP_LEVEL,
            vk::GeometryTypeKHR::INSTANCES,
            vk::AccelerationStructureGeometryDataKHR { instances: data },
            1,
        )?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    fn structure_of(
        &self,
        level: vk::AccelerationStructureTypeKHR,
        kind: vk::GeometryTypeKHR,
        data: vk::AccelerationStructureGeometryDataKHR,
        count: u32,
    ) -> Result<vk::AccelerationStructureKHR, String> {
        let geometry = [vk::AccelerationStructureGeometryKHR::default()
            .geometry_type(kind)
            .geometry(data)
            .flags(vk::GeometryFlagsKHR::OPAQUE)];
        let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(level)
            .flags(vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_TRACE)
            .mode(vk::BuildAccelerationStructureModeKHR::BUILD)
            .geometries(&geometry);
        let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
        // SAFETY: one geometry, one count.
        unsafe {
            self.structures.get_acceleration_structure_build_sizes(
                vk::AccelerationStructureBuildTypeKHR::DEVICE,
                &info,
                &[count],
                &mut sizes,
            );
        }
        let storage = vk::BufferUsageFlags::ACCELERATION_STRUCTURE_STORAGE_KHR
            | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
        let home = self.buffer(sizes.acceleration_structure_size, storage, false)?;
        let create = vk::AccelerationStructureCreateInfoKHR::default()
            .buffer(home.buffer)
            .size(sizes.acceleration_structure_size)
            .ty(level);
        // SAFETY: the buffer is as large as was asked for.
        let structure = unsafe { self.structures.create_acceleration_structure(&create, None) }
            .map_err(failed("makes no acceleration structure"))?;
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
        let scratch = self.buffer(sizes.build_scratch_size + self.alignment, usage, false)?;
        // SAFETY: the buffer has the usage that lets its address be asked for.
        let address = unsafe { self.address(scratch).device_address };
        info.dst_acceleration_structure = structure;
        info.scratch_data =
            vk::DeviceOrHostAddressKHR { device_address: address.next_multiple_of(self.alignment) };
        let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count);
        self.submit(|device, commands| {
            // SAFETY: everything that the build reads and writes lives until it is done, in `submit`; the barrier
            // lets what follows read it.
            unsafe {
                self.structures.cmd_build_acceleration_structures(commands, &[info], &[&[range]]);
                let barrier = vk::MemoryBarrier::default()
                    .src_access_mask(vk::AccessFlags::ACCELERATION_STRUCTURE_WRITE_KHR)
                    .dst_access_mask(vk::AccessFlags::ACCELERATION_STRUCTURE_READ_KHR);
                device.cmd_pipeline_barrier(
                    commands,
                    vk::PipelineStageFlags::ACCELERATION_STRUCTURE_BUILD_KHR,
                    vk::PipelineStageFlags::ALL_COMMANDS,
                    vk::DependencyFlags::empty(),
                    &[barrier],
                    &[],
                    &[],
                );
            }
        })?;
        self.free(scratch);
        Ok(structure)
    }

    /// Brings rays to the device.
    pub fn load(&mut self, rays: &Rays) -> Result<(), String> {
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let none = [[0f32; 3]];
        let origins = self.upload(if rays.origins.is_empty() { &none } else { rays.origins }, usage)?;
        let directions = self.upload(rays.directions, usage)?;
        let count = rays.directions.len() as u32;
        let answers = self.buffer(u64::from(count) * 4, usage | vk::BufferUsageFlags::TRANSFER_SRC, false)?;
        let infos = [origins, directions, answers]
            .map(|buffer| [vk::DescriptorBufferInfo::default().buffer(buffer.buffer).range(vk::WHOLE_SIZE)]);
        let structures = [self.structure];
        let mut write =
            vk::WriteDescriptorSetAccelerationStructureKHR::default().acceleration_structures(&structures);
        let mut first = vk::WriteDescriptorSet::default()
            .dst_set(self.set)
            .descriptor_type(vk::DescriptorType::ACCELERATION_STRUCTURE_KHR)
            .push_next(&mut write);
        first.descriptor_count = 1;
        let mut writes = vec![first];
        for (index, info) in infos.iter().enumerate() {
            writes.push(
                vk::WriteDescriptorSet::default()
                    .dst_set(self.set)
                    .dst_binding(index as u32 + 1)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .buffer_info(info),
            );
        }
        // SAFETY: nothing that uses the set is under way: every submission is waited for.
        unsafe { self.device.update_descriptor_sets(&writes, &[]) };
        let [x, y, z] = rays.eye.map(f32::to_bits);
        self.loaded = Some(Loaded {
            answers,
            push: [x, y, z, count, rays.rays_per_origin, 0, 0, 0],
            count,
            any: rays.any,
        });
        Ok(())
    }

    /// Traces the loaded rays; milliseconds from the launch until that is done.
    pub fn trace(&self) -> Result<f64, String> {
        let loaded = self.loaded.as_ref().ok_or("no rays are loaded")?;
        let groups = loaded.count.div_ceil(GROUP);
        let (across, down) = (groups.min(GROUPS_ACROSS), groups.div_ceil(GROUPS_ACROSS));
        self.submit(|device, commands| {
            // SAFETY: the set's buffers and the pipelines live as long as the process.
            unsafe {
                let pipeline = self.pipelines[usize::from(loaded.any)];
                device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, pipeline);
                device.cmd_bind_descriptor_sets(
                    commands,
                    vk::PipelineBindPoint::COMPUTE,
                    self.layout,
                    0,
                    &[self.set],
                    &[],
                );
                let bytes: &[u8] = cast_slice(&loaded.push);
                device.cmd_push_constants(commands, self.layout, vk::ShaderStageFlags::COMPUTE, 0, bytes);
                device.cmd_dispatch(commands, across, down, 1);
            }
        })
    }

    /// What the last trace has found.
    pub fn answers(&self) -> Result<Vec<f32>, String> {
        let loaded = self.loaded.as_ref().ok_or("no rays are loaded")?;
        let size = loaded.answers.size;
        let landing = self.buffer(size, vk::BufferUsageFlags::TRANSFER_DST, true)?;
        self.copy(loaded.answers, landing)?;
        let mut answers = vec![0f32; loaded.count as usize];
        // SAFETY: the memory is mapped for its whole size, and nothing writes it any more.
        unsafe {
            let pointer = self
                .device
                .map_memory(landing.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())
                .map_err(failed("maps no memory"))?;
            std::ptr::copy_nonoverlapping(pointer.cast(), answers.as_mut_ptr(), answers.len());
            self.device.unmap_memory(landing.memory);
        }
        self.free(landing);
        Ok(answers)
    }

    fn upload<T: Pod>(&self, values: &[T], usage: vk::BufferUsageFlags) -> Result<Buffer, String> {
        let bytes: &[u8] = cast_slice(values);
        let size = bytes.len().max(4) as u64;
        let staging = self.buffer(size, vk::BufferUsageFlags::TRANSFER_SRC, true)?;
        // SAFETY: the memory is mapped for its whole size, which is at least that of the bytes.
        unsafe {
            let pointer = self
                .device
                .map_memory(staging.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())
                .map_err(failed("maps no memory"))?;
            std::ptr::copy_nonoverlapping(bytes.as_ptr(), pointer.cast(), bytes.len());
            self.device.unmap_memory(staging.memory);
        }
        let buffer = self.buffer(size, usage | vk::BufferUsageFlags::TRANSFER_DST, false)?;
        self.copy(staging, buffer)?;
        self.free(staging);
        Ok(buffer)
    }

    fn copy(&self, from: Buffer, to: Buffer) -> Result<f64, String> {
        self.submit(|device, commands| {
            let region = vk::BufferCopy::default().size(from.size.min(to.size));
            // SAFETY: both buffers are at least that large; `submit` waits.
            unsafe { device.cmd_copy_buffer(commands, from.buffer, to.buffer, &[region]) };
        })
    }

    fn buffer(&self, size: u64, usage: vk::BufferUsageFlags, mapped: bool) -> Result<Buffer, String> {
        let create = vk::BufferCreateInfo::default().size(size.max(4)).usage(usage);
        // SAFETY: the device is valid.
        let buffer =
            unsafe { self.device.create_buffer(&create, None) }.map_err(failed("makes no buffer"))?;
        // SAFETY: the buffer was just made.
        let needs = unsafe { self.device.get_buffer_memory_requirements(buffer) };
        let wanted = if mapped {
            vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT
        } else {
            vk::MemoryPropertyFlags::DEVICE_LOCAL
        };
        let kind = (0..self.memory.memory_type_count)
            .find(|&index| {
                let flags = self.memory.memory_types[index as usize].property_flags;
                needs.memory_type_bits >> index & 1 == 1 && flags.contains(wanted)
            })
            .ok_or("Vulkan has no memory of the kind that a buffer needs")?;
        let mut flags = vk::MemoryAllocateFlagsInfo::default().flags(vk::MemoryAllocateFlags::DEVICE_ADDRESS);
        let mut allocate =
            vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(kind);
        if usage.contains(vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS) {
            allocate = allocate.push_next(&mut flags);
        }
        // SAFETY: the buffer and its memory belong together, and the memory is as large as it asks for.
        let memory = unsafe {
            let memory =
                self.device.allocate_memory(&allocate, None).map_err(failed("has not enough memory"))?;
            self.device.bind_buffer_memory(buffer, memory, 0).map_err(failed("binds no memory"))?;
            memory
        };
        Ok(Buffer { buffer, memory, size: size.max(4) })
    }

    fn free(&self, buffer: Buffer) {
        // SAFETY: every submission that used it was waited for, and its handles are not kept.
        unsafe {
            self.device.destroy_buffer(buffer.buffer, None);
            self.device.free_memory(buffer.memory, None);
        }
    }

    fn address(&self, buffer: Buffer) -> vk::DeviceOrHostAddressConstKHR {
        let info = vk::BufferDeviceAddressInfo::default().buffer(buffer.buffer);
        // SAFETY: callers made the buffer with SHADER_DEVICE_ADDRESS.
        vk::DeviceOrHostAddressConstKHR {
            device_address: unsafe { self.device.get_buffer_device_address(&info) },
        }
    }

    /// Records, submits and waits; milliseconds from the submission to its end.
    fn submit(&self, record: impl FnOnce(&ash::Device, vk::CommandBuffer)) -> Result<f64, String> {
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: one thread uses queue and commands, and the last submission was waited for.
        unsafe {
            self.device.begin_command_buffer(self.commands, &begin).map_err(failed("records nothing"))?;
            record(&self.device, self.commands);
            self.device.end_command_buffer(self.commands).map_err(failed("records nothing"))?;
            let buffers = [self.commands];
            let submit = [vk::SubmitInfo::default().command_buffers(&buffers)];
            let start = Instant::now();
            self.device.queue_submit(self.queue, &submit, self.fence).map_err(failed("takes no work"))?;
            self.device.wait_for_fences(&[self.fence], true, u64::MAX).map_err(failed("lost the device"))?;
            let ms = start.elapsed().as_secs_f64() * 1e3;
            self.device.reset_fences(&[self.fence]).map_err(failed("resets no fence"))?;
            Ok(ms)
        }
    }
}

/// Rank, name and alignment of scratch memory of a device that can.
fn able(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    wanted: &str,
) -> Option<(u32, vk::PhysicalDevice, String, u64)> {
    let mut structures = vk::PhysicalDeviceAccelerationStructurePropertiesKHR::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut structures);
    // SAFETY: the physical device is the instance's; unknown structures in the chain are ignored.
    let extensions = unsafe {
        instance.get_physical_device_properties2(physical, &mut properties);
        instance.enumerate_device_extension_properties(physical).ok()?
    };
    let (kind, version) = (properties.properties.device_type, properties.properties.api_version);
    let name = properties.properties.device_name_as_c_str().ok()?.to_string_lossy().into_owned();
    let has = |name: &&CStr| extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(*name));
    // SAFETY: as above.
    let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
    let computes = families.first()?.queue_flags.contains(vk::QueueFlags::COMPUTE);
    let fits = EXTENSIONS.iter().all(has) && computes && version >= vk::API_VERSION_1_2;
    let named = name.to_lowercase().contains(&wanted.to_lowercase());
    let rank = match kind {
        vk::PhysicalDeviceType::DISCRETE_GPU => 0,
        vk::PhysicalDeviceType::INTEGRATED_GPU => 1,
        _ => 2,
    };
    let alignment = u64::from(structures.min_acceleration_structure_scratch_offset_alignment).max(1);
    (fits && named).then_some((rank, physical, name, alignment))
}

fn logical(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Result<ash::Device, String> {
    let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
    let names = EXTENSIONS.map(CStr::as_ptr);
    let mut addresses = vk::PhysicalDeviceBufferDeviceAddressFeatures::default().buffer_device_address(true);
    let mut structures =
        vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default().acceleration_structure(true);
    let mut queries = vk::PhysicalDeviceRayQueryFeaturesKHR::default().ray_query(true);
    let create = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&names)
        .push_next(&mut addresses)
        .push_next(&mut structures)
        .push_next(&mut queries);
    // SAFETY: all pointers of the structures live until the call returns.
    unsafe { instance.create_device(physical, &create, None) }.map_err(failed("opens no device"))
}

type Program = (vk::PipelineLayout, [vk::Pipeline; 2], vk::DescriptorSet);

/// The shader's two entry points, with a set for what they read and write.
fn program(device: &ash::Device) -> Result<Program, String> {
    let words = spirv(include_str!("rays.wgsl"))?;
    let kinds = [
        vk::DescriptorType::ACCELERATION_STRUCTURE_KHR,
        vk::DescriptorType::STORAGE_BUFFER,
        vk::DescriptorType::STORAGE_BUFFER,
        vk::DescriptorType::STORAGE_BUFFER,
    ];
    let bindings: Vec<_> = (0..)
        .zip(kinds)
        .map(|(binding, kind)| {
            vk::DescriptorSetLayoutBinding::default()
                .binding(binding)
                .descriptor_type(kind)
                .descriptor_count(1)
                .stage_flags(vk::ShaderStageFlags::COMPUTE)
        })
        .collect();
    let sizes = kinds.map(|kind| vk::DescriptorPoolSize::default().ty(kind).descriptor_count(1));
    let push = [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(32)];
    // SAFETY: every structure lives until its call returns, and handles are used with the device that made them.
    unsafe {
        let create = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        let sets =
            [device.create_descriptor_set_layout(&create, None).map_err(failed("makes no set layout"))?];
        let create = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(&push);
        let layout = device.create_pipeline_layout(&create, None).map_err(failed("makes no layout"))?;
        let create = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        let pool = device.create_descriptor_pool(&create, None).map_err(failed("makes no pool"))?;
        let allocate = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&sets);
        let set = device.allocate_descriptor_sets(&allocate).map_err(failed("makes no set"))?[0];
        let create = vk::ShaderModuleCreateInfo::default().code(&words);
        let module = device.create_shader_module(&create, None).map_err(failed("refuses a shader"))?;
        let creates = [c"closest", c"any"].map(|name| {
            let stage = vk::PipelineShaderStageCreateInfo::default()
                .stage(vk::ShaderStageFlags::COMPUTE)
                .module(module)
                .name(name);
            vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout)
        });
        let pipelines = device
            .create_compute_pipelines(vk::PipelineCache::null(), &creates, None)
            .map_err(|(_, error)| failed("makes no pipeline")(error))?;
        Ok((layout, [pipelines[0], pipelines[1]], set))
    }
}

fn spirv(source: &str) -> Result<Vec<u32>, String> {
    use naga::back::spv;
    use naga::valid::{Capabilities, ValidationFlags, Validator};
    let module = naga::front::wgsl::parse_str(source).map_err(|error| error.emit_to_string(source))?;
    let info = Validator::new(ValidationFlags::all(), Capabilities::IMMEDIATES | Capabilities::RAY_QUERY)
        .validate(&module)
        .map_err(|error| error.emit_to_string(source))?;
    let options = spv::Options {
        lang_version: (1, 4),
        flags: spv::WriterFlags::empty(),
        force_loop_bounding: false,
        ray_query_initialization_tracking: false,
        ..spv::Options::default()
    };
    spv::write_vec(&module, &info, &options, None).map_err(|error| error.to_string())
}
