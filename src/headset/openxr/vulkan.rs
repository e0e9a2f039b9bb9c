//! The Vulkan device that the runtime presents from, made through XR_KHR_vulkan_enable2.
#![allow(unsafe_code)]

use std::ffi::CString;

use ash::vk::{self, Handle};
use openxr as xr;

use super::fault::{Called, Fault, Outcome};
use crate::error::Error;
use crate::gpu::vulkan::{
    Context, ContextOptions, RawContext, RayQueryFeatures, queue_family, sharing_extensions,
};

/// Makes instance and device as the runtime wants them, with the extensions that windows need. The runtime submits to the
/// context's queue where XR_KHR_vulkan_enable2 lets it, in xrBeginFrame, xrEndFrame, xrAcquireSwapchainImage and
/// xrReleaseSwapchainImage: they are called with [`Context::queue`] held, since threads that trace submit rays at any time.
pub fn open(instance: &xr::Instance, system: xr::SystemId, options: &ContextOptions) -> Outcome<Context> {
    let wanted = xr::Version::new(1, 1, 0);
    let offered =
        instance.graphics_requirements::<xr::Vulkan>(system).called("xrGetVulkanGraphicsRequirements2KHR")?;
    if offered.min_api_version_supported > xr::Version::new(1, 3, u32::MAX)
        || wanted.major() > offered.max_api_version_supported.major()
    {
        return Err(missing(format!(
            "the OpenXR runtime wants Vulkan {} to {}; update this program or the runtime",
            offered.min_api_version_supported, offered.max_api_version_supported
        )));
    }
    let least = offered.min_api_version_supported.max(wanted);
    // SAFETY: loading runs the initialisers of the system's Vulkan loader, which is trusted.
    let entry = unsafe { ash::Entry::load() }.map_err(|_| {
        missing("the Vulkan loader is not installed; install libvulkan1 and your GPU's driver".into())
    })?;
    let raw_instance = create_instance(&entry, instance, (system, least), &options.instance_extensions)?;
    // SAFETY: the handle is a valid instance made with this loader.
    let vulkan = unsafe { ash::Instance::load(entry.static_fn(), raw_instance) };
    match create_device(&entry, &vulkan, (instance, system), options) {
        Ok((physical_device, device, queue_family, ray_queries)) => {
            let raw = RawContext {
                entry,
                instance: vulkan,
                physical_device,
                device,
                queue_family,
                owned: true,
                ray_queries,
            };
            // SAFETY: the handles are valid, belong together, and are nobody else's to destroy; the
            // runtime uses the queue in calls only that are made while its lock is held.
            Ok(unsafe { Context::from_raw(raw) })
        }
        Err(fault) => {
            // SAFETY: nothing was made from the instance.
            unsafe { vulkan.destroy_instance(None) };
            Err(fault)
        }
    }
}

fn missing(problem: String) -> Fault {
    Error::NoDevice { kind: "Vulkan", problem }.into()
}

fn refused(what: &str, code: i32) -> Fault {
    missing(format!(
        "the OpenXR runtime could not make a Vulkan {what} ({}); check the GPU's driver with vulkaninfo",
        vk::Result::from_raw(code)
    ))
}

fn create_instance(
    entry: &ash::Entry,
    instance: &xr::Instance,
    (system, version): (xr::SystemId, xr::Version),
    extensions: &[CString],
) -> Outcome<vk::Instance> {
    // SAFETY: only the loader is asked.
    let offered = unsafe { entry.enumerate_instance_extension_properties(None) }.unwrap_or_default();
    require(extensions, &offered)?;
    let extensions: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
    let application = vk::ApplicationInfo::default()
        .application_name(c"foveate")
        .engine_name(c"foveate")
        .api_version(vk::make_api_version(0, version.major().into(), version.minor().into(), 0));
    let info =
        vk::InstanceCreateInfo::default().application_info(&application).enabled_extension_names(&extensions);
    // SAFETY: the loader's own function, under the same calling convention by another name; the info
    // outlives the call.
    let made = unsafe {
        let get = std::mem::transmute::<
            vk::PFN_vkGetInstanceProcAddr,
            xr::sys::platform::VkGetInstanceProcAddr,
        >(entry.static_fn().get_instance_proc_addr);
        instance.create_vulkan_instance(system, get, (&raw const info).cast())
    };
    let handle = made.called("xrCreateVulkanInstanceKHR")?.map_err(|code| refused("instance", code))?;
    Ok(vk::Instance::from_raw(handle as _))
}

fn create_device(
    entry: &ash::Entry,
    vulkan: &ash::Instance,
    (instance, system): (&xr::Instance, xr::SystemId),
    options: &ContextOptions,
) -> Outcome<(vk::PhysicalDevice, ash::Device, u32, bool)> {
    // SAFETY: the instance was made by xrCreateVulkanInstanceKHR.
    let physical = unsafe { instance.vulkan_graphics_device(system, vulkan.handle().as_raw() as _) }
        .called("xrGetVulkanGraphicsDevice2KHR")?;
    let physical = vk::PhysicalDevice::from_raw(physical as _);
    let family = queue_family(vulkan, physical).ok_or_else(|| {
        missing("the OpenXR runtime's has no queue for graphics and compute; update the GPU's driver".into())
    })?;
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
    // SAFETY: the device belongs to the instance.
    let offered = unsafe { vulkan.enumerate_device_extension_properties(physical) }.unwrap_or_default();
    require(&options.device_extensions, &offered)?;
    let ray_queries = options.ray_queries && RayQueryFeatures::lacking(vulkan, physical).is_none();
    let mut features = RayQueryFeatures::default();
    let of_rays = RayQueryFeatures::extensions().iter().filter(|_| ray_queries);
    let sharing = sharing_extensions(vulkan, physical);
    let own = options.device_extensions.iter().map(|name| name.as_ptr());
    let extensions: Vec<_> = own.chain(sharing.iter().chain(of_rays).map(|name| name.as_ptr())).collect();
    let mut info =
        vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_extension_names(&extensions);
    if ray_queries {
        info = features.require(info);
    }
    // SAFETY: as for the instance; the extensions are offered by the device.
    let made = unsafe {
        let get = std::mem::transmute::<
            vk::PFN_vkGetInstanceProcAddr,
            xr::sys::platform::VkGetInstanceProcAddr,
        >(entry.static_fn().get_instance_proc_addr);
        instance.create_vulkan_device(system, get, physical.as_raw() as _, (&raw const info).cast())
    };
    let handle = made.called("xrCreateVulkanDeviceKHR")?.map_err(|code| refused("device", code))?;
    // SAFETY: the handle is a valid device of this instance.
    let device = unsafe { ash::Device::load(vulkan.fp_v1_0(), vk::Device::from_raw(handle as _)) };
    Ok((physical, device, family, ray_queries))
}

/// Whether windows can be shown with what is offered.
fn require(wanted: &[CString], offered: &[vk::ExtensionProperties]) -> Outcome<()> {
    let has = |name: &CString| offered.iter().any(|entry| entry.extension_name_as_c_str() == Ok(name));
    wanted.iter().find(|name| !has(name)).map_or(Ok(()), |name| {
        Err(missing(format!(
            "the OpenXR runtime's shows no windows ({} is missing); leave --mirror out",
            name.to_string_lossy()
        )))
    })
}

/// A session that presents from the context's device, which outlives it.
pub fn session(
    instance: &xr::Instance,
    system: xr::SystemId,
    context: &Context,
) -> Outcome<(xr::Session<xr::Vulkan>, xr::FrameWaiter, xr::FrameStream<xr::Vulkan>)> {
    let info = xr::vulkan::SessionCreateInfo {
        instance: context.instance().handle().as_raw() as _,
        physical_device: context.physical_device().as_raw() as _,
        device: context.device().handle().as_raw() as _,
        queue_family_index: context.queue_family(),
        queue_index: 0,
    };
    let _queue = context.queue();
    // SAFETY: the handles were made for this system through this instance, and live as long as the guard.
    unsafe { instance.create_session_with_guard::<xr::Vulkan>(system, &info, Box::new(context.clone())) }
        .called("xrCreateSession")
}
