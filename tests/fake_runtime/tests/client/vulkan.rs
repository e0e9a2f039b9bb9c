//! The application's part of Vulkan.
#![allow(unsafe_code)]

use std::ffi::c_void;
use std::ptr;

use ash::vk::{self, Handle as _};
use openxr::{self as hl, sys};

/// The device that the runtime asks for.
pub struct Vulkan {
    _entry: ash::Entry,
    instance: ash::Instance,
    physical: vk::PhysicalDevice,
    device: ash::Device,
}

impl Vulkan {
    pub fn new(xr: &hl::Instance, system: hl::SystemId, own_device: bool) -> Self {
        // SAFETY: Vulkan's loader; the create infos live during the calls; the handles belong together.
        unsafe {
            let entry = ash::Entry::load().unwrap();
            let get = std::mem::transmute::<
                vk::PFN_vkGetInstanceProcAddr,
                sys::platform::VkGetInstanceProcAddr,
            >(entry.static_fn().get_instance_proc_addr);
            let about = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_1);
            let info = vk::InstanceCreateInfo::default().application_info(&about);
            let made = xr.create_vulkan_instance(system, get, ptr::from_ref(&info).cast()).unwrap().unwrap();
            let instance = ash::Instance::load(entry.static_fn(), vk::Instance::from_raw(made as u64));
            let physical = xr.vulkan_graphics_device(system, made).unwrap();
            let physical = vk::PhysicalDevice::from_raw(physical as u64);
            let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
            let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues);
            let device = if own_device {
                instance.create_device(physical, &info, None).unwrap()
            } else {
                let pointer: *const c_void = ptr::from_ref(&info).cast();
                let physical = physical.as_raw() as *const c_void;
                let made = xr.create_vulkan_device(system, get, physical, pointer).unwrap().unwrap();
                ash::Device::load(instance.fp_v1_0(), vk::Device::from_raw(made as u64))
            };
            Vulkan { _entry: entry, instance, physical, device }
        }
    }

    pub fn binding(&self) -> hl::vulkan::SessionCreateInfo {
        hl::vulkan::SessionCreateInfo {
            instance: self.instance.handle().as_raw() as _,
            physical_device: self.physical.as_raw() as _,
            device: self.device.handle().as_raw() as _,
            queue_family_index: 0,
            queue_index: 0,
        }
    }

    /// Fills an image, which is in the layout `rest` before and after, with a colour.
    pub fn clear(&self, image: vk::Image, rest: vk::ImageLayout, colour: [f32; 4]) {
        let colour = vk::ClearColorValue { float32: colour };
        self.fill(image, rest, vk::ImageAspectFlags::COLOR, |commands, layout, range| {
            // SAFETY: the commands are being recorded; the image is in the layout.
            unsafe { self.device.cmd_clear_color_image(commands, image, layout, &colour, &[range]) };
        });
    }

    /// Fills an image of depths, which waits in the layout of an attachment.
    pub fn clear_depth(&self, image: vk::Image, depth: f32) {
        let rest = vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL;
        let depth = vk::ClearDepthStencilValue { depth, stencil: 0 };
        self.fill(image, rest, vk::ImageAspectFlags::DEPTH, |commands, layout, range| {
            // SAFETY: the commands are being recorded; the image is in the layout.
            unsafe { self.device.cmd_clear_depth_stencil_image(commands, image, layout, &depth, &[range]) };
        });
    }

    /// Runs a command that writes an image, which is in the layout `rest` before and after.
    fn fill(
        &self,
        image: vk::Image,
        rest: vk::ImageLayout,
        aspect_mask: vk::ImageAspectFlags,
        record: impl FnOnce(vk::CommandBuffer, vk::ImageLayout, vk::ImageSubresourceRange),
    ) {
        let range = vk::ImageSubresourceRange {
            aspect_mask,
            base_mip_level: 0,
            level_count: 1,
            base_array_layer: 0,
            layer_count: 1,
        };
        let write = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
        let all = vk::PipelineStageFlags::ALL_COMMANDS;
        let access = vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE;
        let barrier = |from, to| {
            [vk::ImageMemoryBarrier::default()
                .image(image)
                .old_layout(from)
                .new_layout(to)
                .src_access_mask(access)
                .dst_access_mask(access)
                .subresource_range(range)]
        };
        let device = &self.device;
        let none = vk::DependencyFlags::empty();
        // SAFETY: the image is the application's from wait to release; all is done before the pool goes.
        unsafe {
            let pool = device.create_command_pool(&vk::CommandPoolCreateInfo::default(), None).unwrap();
            let info = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
            let commands = device.allocate_command_buffers(&info).unwrap();
            device.begin_command_buffer(commands[0], &vk::CommandBufferBeginInfo::default()).unwrap();
            device.cmd_pipeline_barrier(commands[0], all, all, none, &[], &[], &barrier(rest, write));
            record(commands[0], write, range);
            device.cmd_pipeline_barrier(commands[0], all, all, none, &[], &[], &barrier(write, rest));
            device.end_command_buffer(commands[0]).unwrap();
            let queue = device.get_device_queue(0, 0);
            let submit = vk::SubmitInfo::default().command_buffers(&commands);
            device.queue_submit(queue, &[submit], vk::Fence::null()).unwrap();
            device.queue_wait_idle(queue).unwrap();
            device.destroy_command_pool(pool, None);
        }
    }

    pub fn destroy(&self) {
        // SAFETY: nothing made from them is left.
        unsafe {
            self.device.destroy_device(None);
            self.instance.destroy_instance(None);
        }
    }
}
