//! Loader, instance and logical device of a context of one's own.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString};

use ash::vk;

use super::physical::{queue_family, report, sharing_extensions};
use super::{ContextOptions, RayQueryFeatures, VALIDATION_LAYER};
use crate::error::{Error, Result};
use crate::free_memory;

/// Loaders and drivers without memory fail in any way.
pub(super) fn no_device(problem: String) -> Error {
    let problem = match free_memory::tight_limit() {
        Some(limit) => format!(
            "{problem}; this process may use {} MiB of memory, which may be the reason: raise the limit (ulimit -v)",
            limit >> 20
        ),
        None => problem,
    };
    Error::NoDevice { kind: "Vulkan", problem }
}

pub(super) fn load() -> Result<ash::Entry> {
    // SAFETY: loading runs the initialisers of the system's Vulkan loader, which is trusted.
    unsafe { ash::Entry::load() }.map_err(|_| {
        no_device(
            "the Vulkan loader is not installed; install libvulkan1 and a driver, such as mesa-vulkan-drivers"
                .to_string(),
        )
    })
}

pub(super) fn require_validation_layer(entry: &ash::Entry) -> Result<()> {
    // SAFETY: only the loader is asked.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }.unwrap_or_default();
    if layers.iter().any(|layer| layer.layer_name_as_c_str() == Ok(VALIDATION_LAYER)) {
        return Ok(());
    }
    Err(no_device("the validation layer is not installed; install vulkan-validationlayers".to_string()))
}

pub(super) fn create_instance(
    entry: &ash::Entry,
    layers: &[&CStr],
    extensions: &[&CStr],
) -> Result<ash::Instance> {
    let application = vk::ApplicationInfo::default()
        .application_name(c"foveate")
        .engine_name(c"foveate")
        .api_version(vk::API_VERSION_1_1);
    let layers: Vec<_> = layers.iter().map(|name| name.as_ptr()).collect();
    let extensions: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
    let info = vk::InstanceCreateInfo::default()
        .application_info(&application)
        .enabled_layer_names(&layers)
        .enabled_extension_names(&extensions);
    // SAFETY: the strings outlive the call.
    unsafe { entry.create_instance(&info, None) }.map_err(|code| {
        no_device(match code {
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => {
                "no driver was found; install one, such as mesa-vulkan-drivers".to_string()
            }
            vk::Result::ERROR_EXTENSION_NOT_PRESENT => {
                "the drivers cannot show windows on this system; use the mock headset".to_string()
            }
            _ => format!("no instance can be made ({code}); check the driver with vulkaninfo"),
        })
    })
}

/// A logical device.
pub(super) struct Opened {
    pub physical_device: vk::PhysicalDevice,
    pub device: ash::Device,
    pub queue_family: u32,
    pub ray_queries: bool,
}

pub(super) fn open(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    options: &ContextOptions,
) -> Result<Opened> {
    let found = report(instance, physical, &[]);
    let family = queue_family(instance, physical)
        .ok_or_else(|| no_device(format!("{} has no queue for graphics and compute", found.name)))?;
    let mut extensions: Vec<&CStr> = options.device_extensions.iter().map(CString::as_c_str).collect();
    extensions.extend(sharing_extensions(instance, physical));
    let ray_queries = options.ray_queries && found.lacks_ray_queries.is_none();
    let mut features = RayQueryFeatures::default();
    extensions.extend(RayQueryFeatures::extensions().iter().filter(|_| ray_queries));
    let extensions: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
    let mut info =
        vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_extension_names(&extensions);
    if ray_queries {
        info = features.require(info);
    }
    // SAFETY: extensions and features are offered by the device, or were checked for; the strings outlive the call.
    let device = unsafe { instance.create_device(physical, &info, None) }.map_err(|code| Error::Device {
        device: found.name,
        problem: format!("it cannot be opened ({code}); close programs that use it, or choose another"),
    })?;
    Ok(Opened { physical_device: physical, device, queue_family: family, ray_queries })
}
