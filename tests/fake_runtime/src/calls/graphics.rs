//! XR_KHR_vulkan_enable2.

use ash::vk::Handle as _;
use openxr_sys as xr;

use crate::abi::{In, Out};
use crate::refusal::{Outcome, invalid, wrong};
use crate::runtime::{On, enter};
use crate::vulkan;

const DONE: Outcome = Ok(xr::Result::SUCCESS);
const EXTENSION: &str = "XR_KHR_vulkan_enable2";

pub(crate) fn requirements(
    instance: xr::Instance,
    system: xr::SystemId,
    requirements: Out<xr::GraphicsRequirementsVulkanKHR>,
) -> xr::Result {
    enter("xrGetVulkanGraphicsRequirements2KHR", On::Instance(instance), |runtime, _| {
        runtime.needs(EXTENSION)?;
        runtime.check_system(system)?;
        runtime.vulkan.requirements_told = true;
        requirements.write(|next| xr::GraphicsRequirementsVulkanKHR {
            ty: xr::GraphicsRequirementsVulkanKHR::TYPE,
            next,
            min_api_version_supported: xr::Version::new(1, 0, 0),
            max_api_version_supported: xr::Version::new(1, 4, 0),
        })?;
        DONE
    })
}

pub(crate) fn create_instance(
    instance: xr::Instance,
    info: In<xr::VulkanInstanceCreateInfoKHR>,
    vulkan_instance: Out<xr::platform::VkInstance>,
    result: Out<xr::platform::VkResult>,
) -> xr::Result {
    enter("xrCreateVulkanInstanceKHR", On::Instance(instance), |runtime, _| {
        runtime.needs(EXTENSION)?;
        let info = info.get()?;
        runtime.check_system(info.system_id)?;
        let function =
            info.pfn_get_instance_proc_addr.ok_or_else(|| invalid("vkGetInstanceProcAddr is missing"))?;
        match vulkan::create_instance(function, info) {
            Ok(made) => {
                runtime.vulkan.function = Some(function);
                runtime.vulkan.instances.push(made.as_raw());
                result.set(0)?;
                vulkan_instance.set(made.as_raw() as _)?;
            }
            Err(code) => result.set(code.as_raw())?,
        }
        DONE
    })
}

pub(crate) fn physical_device(
    instance: xr::Instance,
    info: In<xr::VulkanGraphicsDeviceGetInfoKHR>,
    device: Out<xr::platform::VkPhysicalDevice>,
) -> xr::Result {
    enter("xrGetVulkanGraphicsDevice2KHR", On::Instance(instance), |runtime, _| {
        runtime.needs(EXTENSION)?;
        let info = info.get()?;
        runtime.check_system(info.system_id)?;
        let handle = info.vulkan_instance as u64;
        let function = runtime.vulkan.function.filter(|_| runtime.vulkan.instances.contains(&handle));
        let function =
            function.ok_or_else(|| invalid("the Vulkan instance does not come from the runtime"))?;
        let found = vulkan::physical_devices(function, ash::vk::Instance::from_raw(handle));
        let first = found.ok().and_then(|devices| devices.first().copied());
        let first = first.ok_or(xr::Result::ERROR_RUNTIME_FAILURE)?;
        runtime.vulkan.physical = Some(first.as_raw());
        device.set(first.as_raw() as _)?;
        DONE
    })
}

pub(crate) fn create_device(
    instance: xr::Instance,
    info: In<xr::VulkanDeviceCreateInfoKHR>,
    device: Out<xr::platform::VkDevice>,
    result: Out<xr::platform::VkResult>,
) -> xr::Result {
    enter("xrCreateVulkanDeviceKHR", On::Instance(instance), |runtime, _| {
        runtime.needs(EXTENSION)?;
        let info = info.get()?;
        runtime.check_system(info.system_id)?;
        let function =
            info.pfn_get_instance_proc_addr.ok_or_else(|| invalid("vkGetInstanceProcAddr is missing"))?;
        if runtime.vulkan.physical != Some(info.vulkan_physical_device as u64) {
            return Err(wrong(
                xr::Result::ERROR_GRAPHICS_DEVICE_INVALID,
                "not the physical device of xrGetVulkanGraphicsDevice2KHR",
            ));
        }
        let parent = runtime.vulkan.instances.last().copied().unwrap_or_default();
        match vulkan::create_device(function, ash::vk::Instance::from_raw(parent), info) {
            Ok(made) => {
                runtime.vulkan.devices.push(made.as_raw());
                result.set(0)?;
                device.set(made.as_raw() as _)?;
            }
            Err(code) => result.set(code.as_raw())?,
        }
        DONE
    })
}
