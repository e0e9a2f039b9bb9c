//! The runtime's part of Vulkan: instance and device on the application's behalf, real images on its device.
#![allow(unsafe_code)]

use std::mem;

use ash::vk::{self, Handle};
use openxr_sys as xr;

/// What a swapchain's images are like.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    pub format: vk::Format,
    pub width: u32,
    pub height: u32,
    pub layers: u32,
    pub mips: u32,
    pub usage: vk::ImageUsageFlags,
    pub mutable: bool,
}

/// Part of an image's layer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part {
    pub x: i32,
    pub y: i32,
    pub width: u32,
    pub height: u32,
    pub layer: u32,
}

impl Part {
    /// Left, top, width and height, pixels, for the log.
    pub fn rect(self) -> [i32; 4] {
        [self.x, self.y, self.width as i32, self.height as i32]
    }
}

/// An image and its memory.
#[derive(Debug)]
pub(crate) struct Image {
    pub handle: vk::Image,
    memory: vk::DeviceMemory,
    ready: bool,
}

/// A device of the application, and its queue.
pub(crate) struct Gpu {
    device: ash::Device,
    memory: vk::PhysicalDeviceMemoryProperties,
    queue: vk::Queue,
    pool: vk::CommandPool,
}

/// The loader that the application uses.
fn loader(function: xr::platform::VkGetInstanceProcAddr) -> ash::StaticFn {
    // SAFETY: both types describe vkGetInstanceProcAddr.
    let get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr = unsafe { mem::transmute(function) };
    ash::StaticFn { get_instance_proc_addr }
}

/// xrCreateVulkanInstanceKHR's work.
pub(crate) fn create_instance(
    function: xr::platform::VkGetInstanceProcAddr,
    info: &xr::VulkanInstanceCreateInfoKHR,
) -> Result<vk::Instance, vk::Result> {
    // SAFETY: the function is Vulkan's; the create info is the application's, by OpenXR's contract.
    unsafe {
        let entry = ash::Entry::from_static_fn(loader(function));
        let mut instance = vk::Instance::null();
        let create = entry.fp_v1_0().create_instance;
        create(info.vulkan_create_info.cast(), info.vulkan_allocator.cast(), &mut instance)
            .result_with_success(instance)
            .map(|_| instance)
    }
}

/// The devices of an instance.
pub(crate) fn physical_devices(
    function: xr::platform::VkGetInstanceProcAddr,
    instance: vk::Instance,
) -> Result<Vec<vk::PhysicalDevice>, vk::Result> {
    // SAFETY: the instance was made by `create_instance` with this function.
    unsafe { ash::Instance::load(&loader(function), instance).enumerate_physical_devices() }
}

/// xrCreateVulkanDeviceKHR's work.
pub(crate) fn create_device(
    function: xr::platform::VkGetInstanceProcAddr,
    instance: vk::Instance,
    info: &xr::VulkanDeviceCreateInfoKHR,
) -> Result<vk::Device, vk::Result> {
    // SAFETY: as above; the physical device is one of the instance's, as the caller has checked.
    unsafe {
        let create = ash::Instance::load(&loader(function), instance).fp_v1_0().create_device;
        let mut device = vk::Device::null();
        let physical = vk::PhysicalDevice::from_raw(info.vulkan_physical_device as u64);
        create(physical, info.vulkan_create_info.cast(), info.vulkan_allocator.cast(), &mut device)
            .result_with_success(device)
            .map(|_| device)
    }
}

impl Gpu {
    /// The device of a session's graphics binding, which `create_instance` and `create_device` have made.
    pub fn new(
        function: xr::platform::VkGetInstanceProcAddr,
        binding: &xr::GraphicsBindingVulkanKHR,
    ) -> Result<Self, vk::Result> {
        // SAFETY: the handles belong together and live, as the caller has checked and OpenXR asks.
        unsafe {
            let instance =
                ash::Instance::load(&loader(function), vk::Instance::from_raw(binding.instance as u64));
            let device = ash::Device::load(instance.fp_v1_0(), vk::Device::from_raw(binding.device as u64));
            let physical = vk::PhysicalDevice::from_raw(binding.physical_device as u64);
            let memory = instance.get_physical_device_memory_properties(physical);
            let queue = device.get_device_queue(binding.queue_family_index, binding.queue_index);
            let pool = vk::CommandPoolCreateInfo::default().queue_family_index(binding.queue_family_index);
            let pool = device.create_command_pool(&pool, None)?;
            Ok(Gpu { device, memory, queue, pool })
        }
    }

    /// Frees what is the runtime's own; the device is the application's.
    pub fn destroy(&self) {
        // SAFETY: every submission was waited for.
        unsafe { self.device.destroy_command_pool(self.pool, None) };
    }

    fn memory_type(&self, bits: u32, flags: vk::MemoryPropertyFlags) -> Result<u32, vk::Result> {
        (0..self.memory.memory_type_count)
            .find(|&i| {
                bits & (1 << i) != 0 && self.memory.memory_types[i as usize].property_flags.contains(flags)
            })
            .ok_or(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)
    }

    /// A new image, with nothing in it.
    pub fn create_image(&self, shape: &Shape) -> Result<Image, vk::Result> {
        let flags =
            if shape.mutable { vk::ImageCreateFlags::MUTABLE_FORMAT } else { vk::ImageCreateFlags::empty() };
        let info = vk::ImageCreateInfo::default()
            .flags(flags)
            .image_type(vk::ImageType::TYPE_2D)
            .format(shape.format)
            .extent(vk::Extent3D { width: shape.width, height: shape.height, depth: 1 })
            .mip_levels(shape.mips)
            .array_layers(shape.layers)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            // To read it back, whatever the application does with it.
            .usage(shape.usage | vk::ImageUsageFlags::TRANSFER_SRC);
        // SAFETY: the device lives; the memory fits the image.
        unsafe {
            let handle = self.device.create_image(&info, None)?;
            let needs = self.device.get_image_memory_requirements(handle);
            let kind = self.memory_type(needs.memory_type_bits, vk::MemoryPropertyFlags::empty())?;
            let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(kind);
            let memory = self.device.allocate_memory(&info, None)?;
            self.device.bind_image_memory(handle, memory, 0)?;
            Ok(Image { handle, memory, ready: false })
        }
    }

    /// Frees an image once the device is done with it.
    pub fn destroy_image(&self, image: &Image) {
        // SAFETY: the image is this device's and is destroyed once; waiting makes it idle.
        unsafe {
            let _ = self.device.queue_wait_idle(self.queue);
            self.device.destroy_image(image.handle, None);
            self.device.free_memory(image.memory, None);
        }
    }

    /// Brings an image into the layout that the application may expect after xrWaitSwapchainImage.
    pub fn make_ready(&self, image: &mut Image, shape: &Shape) -> Result<(), vk::Result> {
        if mem::replace(&mut image.ready, true) {
            return Ok(());
        }
        let (layout, _) = shape.resting();
        let barrier = shape.barrier(image, vk::ImageLayout::UNDEFINED, layout);
        self.run(|device, commands| {
            // SAFETY: the commands are being recorded; the image lives.
            unsafe { transition(device, commands, barrier) };
        })
    }

    /// Rows of a part of an image, tightly packed.
    pub fn read(
        &self,
        image: &Image,
        shape: &Shape,
        part: Part,
        texel: usize,
    ) -> Result<Vec<u8>, vk::Result> {
        let size = part.width as usize * part.height as usize * texel;
        let (layout, aspect) = shape.resting();
        let source = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
        let there = shape.barrier(image, layout, source);
        let back = shape.barrier(image, source, layout);
        let region = vk::BufferImageCopy::default()
            .image_subresource(vk::ImageSubresourceLayers {
                aspect_mask: aspect,
                mip_level: 0,
                base_array_layer: part.layer,
                layer_count: 1,
            })
            .image_offset(vk::Offset3D { x: part.x, y: part.y, z: 0 })
            .image_extent(vk::Extent3D { width: part.width, height: part.height, depth: 1 });
        let info =
            vk::BufferCreateInfo::default().size(size as u64).usage(vk::BufferUsageFlags::TRANSFER_DST);
        // SAFETY: the buffer is as large as the part, mapped while it is read, and freed once at the end; the
        // part is inside the image, as the caller has checked.
        unsafe {
            let buffer = self.device.create_buffer(&info, None)?;
            let needs = self.device.get_buffer_memory_requirements(buffer);
            let visible = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
            let kind = self.memory_type(needs.memory_type_bits, visible)?;
            let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(kind);
            let memory = self.device.allocate_memory(&info, None)?;
            self.device.bind_buffer_memory(buffer, memory, 0)?;
            self.run(|device, commands| {
                transition(device, commands, there);
                device.cmd_copy_image_to_buffer(commands, image.handle, source, buffer, &[region]);
                transition(device, commands, back);
            })?;
            let mapped = self.device.map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())?;
            let bytes = std::slice::from_raw_parts(mapped.cast::<u8>(), size).to_vec();
            self.device.destroy_buffer(buffer, None);
            self.device.free_memory(memory, None);
            Ok(bytes)
        }
    }

    /// Runs commands on the application's queue, which it must not use during the calls that do this.
    fn run(&self, record: impl FnOnce(&ash::Device, vk::CommandBuffer)) -> Result<(), vk::Result> {
        // SAFETY: the pool and the queue are the device's; the commands are done before they are freed.
        unsafe {
            let info =
                vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
            let commands = self.device.allocate_command_buffers(&info)?;
            let begin =
                vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            self.device.begin_command_buffer(commands[0], &begin)?;
            record(&self.device, commands[0]);
            self.device.end_command_buffer(commands[0])?;
            let submit = vk::SubmitInfo::default().command_buffers(&commands);
            self.device.queue_submit(self.queue, &[submit], vk::Fence::null())?;
            self.device.queue_wait_idle(self.queue)?;
            self.device.free_command_buffers(self.pool, &commands);
            Ok(())
        }
    }
}

/// # Safety
/// The commands are being recorded, and the barrier's image lives.
unsafe fn transition(device: &ash::Device, commands: vk::CommandBuffer, barrier: vk::ImageMemoryBarrier) {
    let all = vk::PipelineStageFlags::ALL_COMMANDS;
    // SAFETY: by the caller's contract.
    unsafe {
        device.cmd_pipeline_barrier(commands, all, all, vk::DependencyFlags::empty(), &[], &[], &[barrier])
    };
}

impl Shape {
    /// The layout in which application and runtime hand an image to each other, and its aspect.
    fn resting(&self) -> (vk::ImageLayout, vk::ImageAspectFlags) {
        if self.usage.contains(vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT) {
            (vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL, vk::ImageAspectFlags::DEPTH)
        } else {
            (vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL, vk::ImageAspectFlags::COLOR)
        }
    }

    fn barrier(
        &self,
        image: &Image,
        from: vk::ImageLayout,
        to: vk::ImageLayout,
    ) -> vk::ImageMemoryBarrier<'static> {
        let all = vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE;
        vk::ImageMemoryBarrier::default()
            .image(image.handle)
            .old_layout(from)
            .new_layout(to)
            .src_access_mask(all)
            .dst_access_mask(all)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .subresource_range(vk::ImageSubresourceRange {
                aspect_mask: self.resting().1,
                base_mip_level: 0,
                level_count: self.mips,
                base_array_layer: 0,
                layer_count: self.layers,
            })
    }
}
