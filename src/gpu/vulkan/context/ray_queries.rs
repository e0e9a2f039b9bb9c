//! What a device needs so that compute shaders can trace rays: VK_KHR_ray_query over VK_KHR_acceleration_structure, with what
//! these require beyond Vulkan 1.1, for which instances are made.
#![allow(unsafe_code)]

use std::ffi::CStr;

use ash::{khr, vk};

use super::physical::extensions_of;

/// In the order in which a missing one is told.
const EXTENSIONS: [&CStr; 7] = [
    khr::ray_query::NAME,
    khr::acceleration_structure::NAME,
    khr::deferred_host_operations::NAME,
    khr::buffer_device_address::NAME,
    ash::ext::descriptor_indexing::NAME,
    khr::spirv_1_4::NAME,
    khr::shader_float_controls::NAME,
];

/// The features that are switched on with a logical device.
pub struct RayQueryFeatures {
    addresses: vk::PhysicalDeviceBufferDeviceAddressFeatures<'static>,
    structures: vk::PhysicalDeviceAccelerationStructureFeaturesKHR<'static>,
    queries: vk::PhysicalDeviceRayQueryFeaturesKHR<'static>,
}

impl Default for RayQueryFeatures {
    fn default() -> Self {
        RayQueryFeatures {
            addresses: vk::PhysicalDeviceBufferDeviceAddressFeatures::default().buffer_device_address(true),
            structures: vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default()
                .acceleration_structure(true),
            queries: vk::PhysicalDeviceRayQueryFeaturesKHR::default().ray_query(true),
        }
    }
}

impl RayQueryFeatures {
    /// The extensions to enable beside.
    pub fn extensions() -> &'static [&'static CStr] {
        &EXTENSIONS
    }

    /// Asks for them where a logical device is made.
    pub fn require<'a>(&'a mut self, info: vk::DeviceCreateInfo<'a>) -> vk::DeviceCreateInfo<'a> {
        info.push_next(&mut self.addresses).push_next(&mut self.structures).push_next(&mut self.queries)
    }

    /// The first extension or feature that a device of Vulkan 1.1 or later lacks for ray queries; `None` where it has them.
    pub fn lacking(instance: &ash::Instance, device: vk::PhysicalDevice) -> Option<String> {
        let extensions = extensions_of(instance, device);
        if let Some(name) = EXTENSIONS.into_iter().find(|name| !extensions.contains(*name)) {
            return Some(name.to_string_lossy().into_owned());
        }
        let mut addresses = vk::PhysicalDeviceBufferDeviceAddressFeatures::default();
        let mut structures = vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default();
        let mut queries = vk::PhysicalDeviceRayQueryFeaturesKHR::default();
        let mut features = vk::PhysicalDeviceFeatures2::default()
            .push_next(&mut addresses)
            .push_next(&mut structures)
            .push_next(&mut queries);
        // SAFETY: the device belongs to the instance, and lists the extensions whose structures are in the chain.
        unsafe { instance.get_physical_device_features2(device, &mut features) };
        let switches = [
            (queries.ray_query, "the feature rayQuery"),
            (structures.acceleration_structure, "the feature accelerationStructure"),
            (addresses.buffer_device_address, "the feature bufferDeviceAddress"),
        ];
        switches.into_iter().find(|(on, _)| *on == vk::FALSE).map(|(_, name)| name.to_string())
    }
}

/// The functions of a device that traces rays, and its limits.
pub(in crate::gpu::vulkan) struct RayFunctions {
    pub structures: khr::acceleration_structure::Device,
    pub addresses: khr::buffer_device_address::Device,
    /// What the address of scratch memory is a multiple of.
    pub scratch_alignment: u64,
    pub most_triangles: u64,
    pub most_instances: u64,
}

impl RayFunctions {
    pub fn load(instance: &ash::Instance, physical: vk::PhysicalDevice, device: &ash::Device) -> Self {
        let mut limits = vk::PhysicalDeviceAccelerationStructurePropertiesKHR::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut limits);
        // SAFETY: the physical device is the instance's, and lists the extension of the structure in the chain.
        unsafe { instance.get_physical_device_properties2(physical, &mut properties) };
        RayFunctions {
            structures: khr::acceleration_structure::Device::new(instance, device),
            addresses: khr::buffer_device_address::Device::new(instance, device),
            scratch_alignment: u64::from(limits.min_acceleration_structure_scratch_offset_alignment).max(1),
            most_triangles: limits.max_primitive_count,
            most_instances: limits.max_instance_count,
        }
    }
}
