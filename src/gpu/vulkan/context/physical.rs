//! The devices of this machine, and which of them is taken.
#![allow(unsafe_code)]

use std::collections::BTreeSet;
use std::ffi::{CStr, CString};

use ash::vk;

use super::ContextOptions;
use super::opening::{create_instance, load, no_device};
use super::ray_queries::RayQueryFeatures;
use crate::error::Result;
use crate::gpu::handle;

/// What a device is, in the order in which they are preferred.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A graphics card.
    Discrete,
    /// A GPU that shares the processor's memory.
    Integrated,
    /// A GPU of a virtual machine.
    Virtual,
    /// A software implementation, such as lavapipe.
    Cpu,
    /// Something else.
    Other,
}

impl DeviceKind {
    fn of(kind: vk::PhysicalDeviceType) -> Self {
        match kind {
            vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
            vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
            vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
            vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
            _ => DeviceKind::Other,
        }
    }
}

/// A Vulkan device of this machine.
#[derive(Clone, Debug)]
pub struct DeviceReport {
    /// The driver's name for it.
    pub name: String,
    /// What it is.
    pub kind: DeviceKind,
    /// The highest Vulkan version that it offers, as `major.minor.patch`.
    pub api_version: String,
    /// VkPhysicalDeviceProperties::driverVersion, as the driver counts.
    pub driver_version: u32,
    /// VkPhysicalDeviceIDProperties::deviceUUID, the same in OpenCL's `cl_khr_device_uuid`.
    pub uuid: [u8; 16],
    /// Whether memory of the host can be imported (VK_EXT_external_memory_host).
    pub imports_host_memory: bool,
    /// Whether memory can be exported by opaque handles (VK_KHR_external_memory_fd, on Windows _win32).
    pub exports_memory: bool,
    /// The first extension or feature that it lacks for ray queries; `None` if it has them.
    pub lacks_ray_queries: Option<String>,
    /// Why it cannot be used; `None` if it can.
    pub unusable: Option<String>,
}

/// Every Vulkan device of this machine, usable or not, in the driver's order.
///
/// # Errors
/// [`crate::Error::NoDevice`] where there is no Vulkan loader or it gives no instance.
pub fn devices() -> Result<Vec<DeviceReport>> {
    let entry = load()?;
    let instance = create_instance(&entry, &[], &[])?;
    // SAFETY: the instance is valid and is destroyed once, after its last use.
    unsafe {
        let found = instance.enumerate_physical_devices();
        let reports =
            found.map(|list| list.iter().map(|&device| report(&instance, device, &[])).collect::<Vec<_>>());
        instance.destroy_instance(None);
        reports.map_err(|code| no_device(format!("the devices could not be listed ({code})")))
    }
}

/// The family with graphics and compute, for those who make their own device.
pub fn queue_family(instance: &ash::Instance, device: vk::PhysicalDevice) -> Option<u32> {
    let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    // SAFETY: the device belongs to the instance.
    let families = unsafe { instance.get_physical_device_queue_family_properties(device) };
    families.iter().position(|family| family.queue_flags.contains(wanted)).map(|index| index as u32)
}

/// The extensions to enable on a device, of those it offers, so that its memory can be shared.
pub fn sharing_extensions(instance: &ash::Instance, device: vk::PhysicalDevice) -> Vec<&'static CStr> {
    let wanted = [ash::ext::external_memory_host::NAME, handle::VULKAN_EXTENSION];
    let offered = extensions_of(instance, device);
    wanted.into_iter().filter(|name| offered.contains(*name)).collect()
}

pub(super) fn extensions_of(instance: &ash::Instance, device: vk::PhysicalDevice) -> BTreeSet<CString> {
    // SAFETY: the device belongs to the instance.
    let listed = unsafe { instance.enumerate_device_extension_properties(device) }.unwrap_or_default();
    listed.iter().filter_map(|entry| entry.extension_name_as_c_str().ok().map(CStr::to_owned)).collect()
}

pub(super) fn report(
    instance: &ash::Instance,
    device: vk::PhysicalDevice,
    required: &[CString],
) -> DeviceReport {
    let mut ids = vk::PhysicalDeviceIDProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default();
    // SAFETY: the device belongs to the instance.
    let version = unsafe { instance.get_physical_device_properties(device) }.api_version;
    if version >= vk::API_VERSION_1_1 {
        properties = properties.push_next(&mut ids);
    }
    // SAFETY: as above; the chain holds structs of Vulkan 1.1, which the instance is made for.
    unsafe { instance.get_physical_device_properties2(device, &mut properties) };
    let properties = properties.properties;
    let extensions = extensions_of(instance, device);
    let missing = required.iter().find(|name| !extensions.contains(*name));
    let unusable = if version < vk::API_VERSION_1_1 {
        Some("it offers only Vulkan 1.0, and 1.1 is needed".to_string())
    } else if queue_family(instance, device).is_none() {
        Some("it has no queue for both graphics and compute".to_string())
    } else {
        missing.map(|name| format!("it lacks {}", name.to_string_lossy()))
    };
    DeviceReport {
        name: properties.device_name_as_c_str().unwrap_or(c"unnamed").to_string_lossy().into_owned(),
        kind: DeviceKind::of(properties.device_type),
        api_version: format!(
            "{}.{}.{}",
            vk::api_version_major(version),
            vk::api_version_minor(version),
            vk::api_version_patch(version)
        ),
        driver_version: properties.driver_version,
        uuid: ids.device_uuid,
        imports_host_memory: extensions.contains(ash::ext::external_memory_host::NAME),
        exports_memory: extensions.contains(handle::VULKAN_EXTENSION),
        lacks_ray_queries: match version >= vk::API_VERSION_1_1 {
            true => RayQueryFeatures::lacking(instance, device),
            false => Some("Vulkan 1.1".to_string()),
        },
        unusable,
    }
}

/// The device that the options ask for.
pub(super) fn select(instance: &ash::Instance, options: &ContextOptions) -> Result<vk::PhysicalDevice> {
    // SAFETY: the instance is valid.
    let devices = unsafe { instance.enumerate_physical_devices() }
        .map_err(|code| no_device(format!("the devices could not be listed ({code})")))?;
    let reports: Vec<_> =
        devices.iter().map(|&device| report(instance, device, &options.device_extensions)).collect();
    let named = |report: &DeviceReport| {
        options.device.as_ref().is_none_or(|name| report.name.to_lowercase().contains(&name.to_lowercase()))
            && options.uuid.is_none_or(|uuid| report.uuid == uuid)
    };
    let best = (0..devices.len())
        .filter(|&index| reports[index].unusable.is_none() && named(&reports[index]))
        .min_by_key(|&index| reports[index].kind);
    best.map(|index| devices[index]).ok_or_else(|| no_device(why_none(&reports, options)))
}

fn why_none(reports: &[DeviceReport], options: &ContextOptions) -> String {
    if reports.is_empty() {
        return "the drivers list none; install one, such as mesa-vulkan-drivers".to_string();
    }
    let list: Vec<_> = reports
        .iter()
        .map(|report| match &report.unusable {
            Some(reason) => format!("{} ({reason})", report.name),
            None => report.name.clone(),
        })
        .collect();
    match &options.device {
        _ if options.uuid.is_some() => {
            format!("none that can be used has the UUID that is asked for; there are: {}", list.join(", "))
        }
        Some(name) => format!("none that can be used is named \"{name}\"; there are: {}", list.join(", ")),
        None => format!("there are: {}; update the driver", list.join(", ")),
    }
}
