//! A Vulkan device with ray-tracing pipelines: its queue and its memory. What is made lives as long as the process.
#![allow(unsafe_code)]

use std::ffi::CStr;
use std::time::Instant;

use ash::{khr, vk};
use bytemuck::{Pod, cast_slice};

#[derive(Clone, Copy)]
pub struct Buffer {
    pub buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    pub size: u64,
}

pub struct Device {
    /// The loader's functions end with it.
    _entry: ash::Entry,
    pub instance: ash::Instance,
    pub device: ash::Device,
    pub able: Able,
    memory: vk::PhysicalDeviceMemoryProperties,
    queue: vk::Queue,
    commands: vk::CommandBuffer,
    fence: vk::Fence,
}

/// A device that has acceleration structures and ray-tracing pipelines.
#[derive(Clone)]
pub struct Able {
    physical: vk::PhysicalDevice,
    rank: u32,
    pub name: String,
    /// What scratch memory of a build is aligned to.
    pub scratch_alignment: u64,
}

/// What went wrong, in a sentence.
pub fn failed(what: &'static str) -> impl Fn(vk::Result) -> String {
    move |error| format!("Vulkan {what}: {error}")
}

impl Device {
    /// The first device that has ray-tracing pipelines and `wanted` in its name, graphics cards first; `None` without one.
    pub fn open(wanted: &str) -> Result<Option<Device>, String> {
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
        let able = all.into_iter().filter_map(|physical| able(&instance, physical));
        let named = able.filter(|able| able.name.to_lowercase().contains(&wanted.to_lowercase()));
        let Some(able) = named.min_by_key(|able| able.rank) else { return Ok(None) };
        let device = logical(&instance, &able)?;
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
        Ok(Some(Device {
            // SAFETY: the physical device is the instance's.
            memory: unsafe { instance.get_physical_device_memory_properties(able.physical) },
            _entry: entry,
            instance,
            device,
            able,
            queue,
            commands,
            fence,
        }))
    }

    /// What the ray-tracing pipeline's table of shaders looks like here.
    pub fn table_properties(&self) -> vk::PhysicalDeviceRayTracingPipelinePropertiesKHR<'static> {
        let mut table = vk::PhysicalDeviceRayTracingPipelinePropertiesKHR::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut table);
        // SAFETY: the physical device is the instance's; unknown structures in the chain are ignored.
        unsafe { self.instance.get_physical_device_properties2(self.able.physical, &mut properties) };
        table.p_next = std::ptr::null_mut();
        table
    }

    /// A buffer with a copy of `values`.
    pub fn upload<T: Pod>(&self, values: &[T], usage: vk::BufferUsageFlags) -> Result<Buffer, String> {
        let size = size_of_val(values) as u64;
        let buffer = self.buffer(size, usage | vk::BufferUsageFlags::TRANSFER_DST, false)?;
        self.fill(buffer, values)?;
        Ok(buffer)
    }

    /// Copies `values` to the start of a buffer that is a copy's target.
    pub fn fill<T: Pod>(&self, buffer: Buffer, values: &[T]) -> Result<(), String> {
        let bytes: &[u8] = cast_slice(values);
        assert!(bytes.len() as u64 <= buffer.size);
        let staging = self.buffer(buffer.size, vk::BufferUsageFlags::TRANSFER_SRC, true)?;
        // SAFETY: the memory is mapped for its whole size, which is at least that of the bytes.
        unsafe {
            let pointer = self.map(staging)?;
            std::ptr::copy_nonoverlapping(bytes.as_ptr(), pointer, bytes.len());
            self.device.unmap_memory(staging.memory);
        }
        self.copy(staging, buffer)?;
        self.free(staging);
        Ok(())
    }

    /// The first floats of a buffer that is a copy's source.
    pub fn download(&self, buffer: Buffer, count: usize) -> Result<Vec<f32>, String> {
        let mut values = vec![0f32; count];
        assert!(size_of_val(&values[..]) as u64 <= buffer.size);
        let landing = self.buffer(buffer.size, vk::BufferUsageFlags::TRANSFER_DST, true)?;
        self.copy(buffer, landing)?;
        // SAFETY: the memory is mapped for its whole size, and nothing writes it any more.
        unsafe {
            let pointer = self.map(landing)?;
            std::ptr::copy_nonoverlapping(pointer.cast(), values.as_mut_ptr(), values.len());
            self.device.unmap_memory(landing.memory);
        }
        self.free(landing);
        Ok(values)
    }

    fn map(&self, buffer: Buffer) -> Result<*mut u8, String> {
        // SAFETY: the memory is the host's to see, and not mapped already: callers unmap it.
        unsafe { self.device.map_memory(buffer.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty()) }
            .map(<*mut _>::cast)
            .map_err(failed("maps no memory"))
    }

    fn copy(&self, from: Buffer, to: Buffer) -> Result<f64, String> {
        self.submit(|device, commands| {
            let region = [vk::BufferCopy::default().size(from.size.min(to.size))];
            let barrier = vk::MemoryBarrier::default()
                .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
                .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::HOST_READ);
            // SAFETY: both buffers are as large as the region, and live until the copy is done, in `submit`.
            unsafe {
                device.cmd_copy_buffer(commands, from.buffer, to.buffer, &region);
                device.cmd_pipeline_barrier(
                    commands,
                    vk::PipelineStageFlags::ALL_COMMANDS,
                    vk::PipelineStageFlags::ALL_COMMANDS | vk::PipelineStageFlags::HOST,
                    vk::DependencyFlags::empty(),
                    &[barrier],
                    &[],
                    &[],
                );
            }
        })
    }

    /// A buffer of undefined content; `mapped` for the host to see.
    pub fn buffer(&self, size: u64, usage: vk::BufferUsageFlags, mapped: bool) -> Result<Buffer, String> {
        let size = size.max(4);
        let create = vk::BufferCreateInfo::default().size(size).usage(usage);
        // SAFETY: the device is valid, and the size is not zero.
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
        Ok(Buffer { buffer, memory, size })
    }

    pub fn free(&self, buffer: Buffer) {
        // SAFETY: every submission that used it was waited for, and its handles are not kept.
        unsafe {
            self.device.destroy_buffer(buffer.buffer, None);
            self.device.free_memory(buffer.memory, None);
        }
    }

    /// The address of a buffer that was made with SHADER_DEVICE_ADDRESS.
    pub fn address(&self, buffer: Buffer) -> vk::DeviceAddress {
        let info = vk::BufferDeviceAddressInfo::default().buffer(buffer.buffer);
        // SAFETY: callers made the buffer with SHADER_DEVICE_ADDRESS.
        unsafe { self.device.get_buffer_device_address(&info) }
    }

    /// Records, submits and waits; milliseconds from the submission to its end.
    pub fn submit(&self, record: impl FnOnce(&ash::Device, vk::CommandBuffer)) -> Result<f64, String> {
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

/// What a device can, where it has ray-tracing pipelines.
fn able(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Option<Able> {
    let mut structures = vk::PhysicalDeviceAccelerationStructurePropertiesKHR::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut structures);
    // SAFETY: the physical device is the instance's; unknown structures in the chain are ignored.
    let (extensions, families) = unsafe {
        instance.get_physical_device_properties2(physical, &mut properties);
        let extensions = instance.enumerate_device_extension_properties(physical).ok()?;
        (extensions, instance.get_physical_device_queue_family_properties(physical))
    };
    let (kind, version) = (properties.properties.device_type, properties.properties.api_version);
    let name = properties.properties.device_name_as_c_str().ok()?.to_string_lossy().into_owned();
    let has = |name: &CStr| extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name));
    let computes = families.first()?.queue_flags.contains(vk::QueueFlags::COMPUTE);
    let wanted = EXTENSIONS.into_iter().all(has);
    let rank = match kind {
        vk::PhysicalDeviceType::DISCRETE_GPU => 0,
        vk::PhysicalDeviceType::INTEGRATED_GPU => 1,
        _ => 2,
    };
    let scratch_alignment = u64::from(structures.min_acceleration_structure_scratch_offset_alignment).max(1);
    let fits = wanted && computes && version >= vk::API_VERSION_1_2;
    fits.then_some(Able { physical, rank, name, scratch_alignment })
}

const EXTENSIONS: [&CStr; 3] =
    [khr::acceleration_structure::NAME, khr::deferred_host_operations::NAME, khr::ray_tracing_pipeline::NAME];

fn logical(instance: &ash::Instance, able: &Able) -> Result<ash::Device, String> {
    let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
    let names = EXTENSIONS.map(CStr::as_ptr);
    let mut addresses = vk::PhysicalDeviceBufferDeviceAddressFeatures::default().buffer_device_address(true);
    let mut structures =
        vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default().acceleration_structure(true);
    let mut pipelines = vk::PhysicalDeviceRayTracingPipelineFeaturesKHR::default().ray_tracing_pipeline(true);
    let create = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&names)
        .push_next(&mut addresses)
        .push_next(&mut structures)
        .push_next(&mut pipelines);
    // SAFETY: all pointers of the structures live until the call returns.
    unsafe { instance.create_device(able.physical, &create, None) }.map_err(failed("opens no device"))
}
