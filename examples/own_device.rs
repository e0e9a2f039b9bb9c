//! A renderer on an application's own Vulkan device: `cargo run --release --example own_device -- scene.glb picture.png`.
//!
//! An engine has an instance, a device and images already. The library takes their handles, draws into an image of the
//! engine's, and leaves all of them as they were.
#![allow(unsafe_code)]

use std::path::Path;

use ash::vk;
use foveate::ash;
use foveate::config::Config;
use foveate::error::{Error, Result};
use foveate::frame::{Loaded, Renderer, ViewRequest};
use foveate::glam::DVec2;
use foveate::gpu::opencl::{Device, device, why_none};
use foveate::gpu::vulkan::{
    Commands, Context, HostBuffer, RawContext, Target, queue_family, sharing_extensions,
};
use foveate::math::view::{FieldOfView, View};
use foveate::reconstruct::Output;
use foveate::scene::default_viewpoint;

const SIZE: (u32, u32) = (320, 200);
const FORMAT: vk::Format = vk::Format::R8G8B8A8_UNORM;

/// What an application has of its own.
struct Engine {
    entry: ash::Entry,
    instance: ash::Instance,
    physical: vk::PhysicalDevice,
    device: ash::Device,
    queue_family: u32,
    image: vk::Image,
    memory: vk::DeviceMemory,
}

fn failed(what: &str) -> impl Fn(vk::Result) -> Error {
    let what = what.to_string();
    move |code| Error::Device { device: "Vulkan".into(), problem: format!("{what} failed ({code})") }
}

impl Engine {
    /// An instance and a device for Vulkan 1.1, with a queue for graphics and compute, and an image to draw into. Where
    /// the device can share memory with OpenCL, it needs extensions for that; without them samples are copied.
    fn new() -> Result<Engine> {
        // SAFETY: the loader is the system's; infos outlive their calls, and all handles are destroyed by `end`.
        unsafe {
            let entry = ash::Entry::load().map_err(|error| Error::NoDevice {
                kind: "Vulkan",
                problem: format!("{error}; install libvulkan1 and a driver"),
            })?;
            let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_1);
            let info = vk::InstanceCreateInfo::default().application_info(&application);
            let instance = entry.create_instance(&info, None).map_err(failed("making an instance"))?;
            let devices = instance.enumerate_physical_devices().map_err(failed("listing devices"))?;
            let usable = devices.into_iter().find_map(|found| Some((found, queue_family(&instance, found)?)));
            let (physical, queue_family) = usable.ok_or_else(|| Error::NoDevice {
                kind: "Vulkan",
                problem: "no device has a queue for graphics and compute; update the driver".into(),
            })?;
            let queues = [vk::DeviceQueueCreateInfo::default()
                .queue_family_index(queue_family)
                .queue_priorities(&[1.0])];
            let sharing = sharing_extensions(&instance, physical);
            let extensions: Vec<_> = sharing.iter().map(|name| name.as_ptr()).collect();
            let info = vk::DeviceCreateInfo::default()
                .queue_create_infos(&queues)
                .enabled_extension_names(&extensions);
            let device =
                instance.create_device(physical, &info, None).map_err(failed("opening the device"))?;
            let (image, memory) = Self::image(&instance, physical, &device)?;
            Ok(Engine { entry, instance, physical, device, queue_family, image, memory })
        }
    }

    /// An image that can be drawn into and copied from, with its memory.
    ///
    /// # Safety
    /// The handles are valid and belong together.
    unsafe fn image(
        instance: &ash::Instance,
        physical: vk::PhysicalDevice,
        device: &ash::Device,
    ) -> Result<(vk::Image, vk::DeviceMemory)> {
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(FORMAT)
            .extent(vk::Extent3D { width: SIZE.0, height: SIZE.1, depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::TRANSFER_SRC);
        // SAFETY: by the function's contract; the memory is as large as the image needs and of a kind that it may have.
        unsafe {
            let image = device.create_image(&info, None).map_err(failed("making an image"))?;
            let needs = device.get_image_memory_requirements(image);
            let kinds = instance.get_physical_device_memory_properties(physical);
            let kind = (0..kinds.memory_type_count).find(|index| needs.memory_type_bits >> index & 1 == 1);
            let info = vk::MemoryAllocateInfo::default()
                .allocation_size(needs.size)
                .memory_type_index(kind.expect("an image has a kind of memory"));
            let memory = device.allocate_memory(&info, None).map_err(failed("memory for an image"))?;
            device.bind_image_memory(image, memory, 0).map_err(failed("binding an image"))?;
            Ok((image, memory))
        }
    }

    /// Brings the image to the layout in which the library draws: an engine would record this with its own work.
    fn prepare(&self) -> Result<()> {
        // SAFETY: nobody else uses the queue; what is made here is destroyed once the queue is idle.
        unsafe {
            let info = vk::CommandPoolCreateInfo::default().queue_family_index(self.queue_family);
            let pool = self.device.create_command_pool(&info, None).map_err(failed("a pool of commands"))?;
            let info = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
            let buffers = self.device.allocate_command_buffers(&info).map_err(failed("commands"))?;
            let begun = self.device.begin_command_buffer(buffers[0], &vk::CommandBufferBeginInfo::default());
            begun.map_err(failed("commands"))?;
            let range = vk::ImageSubresourceRange {
                aspect_mask: vk::ImageAspectFlags::COLOR,
                level_count: 1,
                layer_count: 1,
                ..Default::default()
            };
            let barrier = [vk::ImageMemoryBarrier::default()
                .old_layout(vk::ImageLayout::UNDEFINED)
                .new_layout(vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)
                .dst_access_mask(vk::AccessFlags::COLOR_ATTACHMENT_WRITE)
                .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                .image(self.image)
                .subresource_range(range)];
            let (from, to) =
                (vk::PipelineStageFlags::TOP_OF_PIPE, vk::PipelineStageFlags::COLOR_ATTACHMENT_OUTPUT);
            let flags = vk::DependencyFlags::empty();
            self.device.cmd_pipeline_barrier(buffers[0], from, to, flags, &[], &[], &barrier);
            self.device.end_command_buffer(buffers[0]).map_err(failed("commands"))?;
            let queue = self.device.get_device_queue(self.queue_family, 0);
            let submit = [vk::SubmitInfo::default().command_buffers(&buffers)];
            let sent = self.device.queue_submit(queue, &submit, vk::Fence::null());
            sent.and_then(|()| self.device.queue_wait_idle(queue)).map_err(failed("submitting"))?;
            self.device.destroy_command_pool(pool, None);
        }
        Ok(())
    }

    /// The library's context on the engine's device, whose handles it does not destroy.
    fn context(&self) -> Context {
        let raw = RawContext {
            entry: self.entry.clone(),
            instance: self.instance.clone(),
            physical_device: self.physical,
            device: self.device.clone(),
            queue_family: self.queue_family,
            owned: false,
            ray_queries: false,
        };
        // SAFETY: the handles belong together and outlive the context; the engine submits nothing meanwhile. One that
        // does holds the lock of `Context::queue`.
        unsafe { Context::from_raw(raw) }
    }

    fn end(self) {
        // SAFETY: whatever the library had made is gone.
        unsafe {
            self.device.destroy_image(self.image, None);
            self.device.free_memory(self.memory, None);
            self.device.destroy_device(None);
            self.instance.destroy_instance(None);
        }
    }
}

/// Renders a scene into the engine's image, and reads that: four bytes a pixel.
fn render(engine: &Engine, scene: &Path) -> Result<Vec<u8>> {
    let config = Config::default();
    let loaded = Loaded::from_file(scene, &config)?;
    let context = engine.context();
    let usable = device::list().into_iter().find(|info| info.unusable.is_none());
    let info = usable.ok_or_else(|| Error::NoDevice { kind: "OpenCL", problem: why_none() })?;
    let opencl = Device::open(&info)?;
    let display = foveate::frame::Output::Display;
    let (mut renderer, _) = Renderer::new(&opencl, &context, &loaded, &config, display)?;

    engine.prepare()?;
    let (width, height) = SIZE;
    // SAFETY: the image was made on this device with this format and size, is in the layout, and outlives the target.
    let target = unsafe { Target::from_raw(&context, engine.image, FORMAT, width, height, 0)? };
    let eye = default_viewpoint(&loaded.scene, config.view.fov_y);
    let fov = FieldOfView::symmetric(eye.fov_y, f64::from(width) / f64::from(height));
    let view = View { world_from_eye: eye.world_from_eye, fov, width, height, spacing: Default::default() };
    let request = ViewRequest {
        view,
        gaze: DVec2::new(0.5, 0.5),
        widening: 1.0,
        hidden: None,
        outputs: vec![Output::whole(&target, 0.0)],
    };
    renderer.render_views(&[request], config.trace.seed, &mut |_| None)?;

    let bytes = HostBuffer::new(&context, 4 * (width * height) as usize)?;
    let mut commands = Commands::new(&context)?;
    commands.begin()?;
    commands.copy_target(&target, &(&bytes).into());
    commands.submit()?;
    commands.wait()?;
    Ok(bytes.read(0, bytes.len()))
}

/// Renders `scene` on a device of one's own into the PNG `out`.
///
/// # Errors
/// Where there is no device, or the scene cannot be read.
pub fn run(scene: &Path, out: &Path) -> Result<()> {
    let engine = Engine::new()?;
    let picture = render(&engine, scene);
    engine.end();
    let saved = image::save_buffer(out, &picture?, SIZE.0, SIZE.1, image::ColorType::Rgba8);
    saved.map_err(|error| Error::File { path: out.into(), problem: error.to_string() })
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let mut next = |usual: &str| arguments.next().unwrap_or_else(|| usual.to_string());
    run(Path::new(&next("scene.glb")), Path::new(&next("picture.png")))
}
