//! Handles by which one driver hands memory to another: on Unix file descriptors, on Windows its own handles, which both
//! APIs call opaque. What each API calls them stands here, so that no other file asks for the system.
#![allow(unsafe_code)]

use ash::vk;

#[cfg(unix)]
mod system {
    use super::vk;
    use std::os::fd::{AsRawFd, FromRawFd, IntoRawFd, OwnedFd};

    /// Owns a handle.
    pub type Handle = OwnedFd;
    pub use ash::khr::external_memory_fd::NAME as VULKAN_EXTENSION;
    /// What Vulkan calls it.
    pub const VULKAN_TYPE: vk::ExternalMemoryHandleTypeFlags = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;
    /// What an OpenCL device lists that imports it.
    pub const OPENCL_EXTENSION: &str = "cl_khr_external_memory_opaque_fd";
    /// CL_EXTERNAL_MEMORY_HANDLE_OPAQUE_FD_KHR.
    pub const OPENCL_TYPE: u64 = 0x2060;

    pub unsafe fn export(
        instance: &ash::Instance,
        device: &ash::Device,
        memory: vk::DeviceMemory,
    ) -> Result<Handle, vk::Result> {
        let functions = ash::khr::external_memory_fd::Device::new(instance, device);
        let info = vk::MemoryGetFdInfoKHR::default().memory(memory).handle_type(VULKAN_TYPE);
        // SAFETY: by the caller's contract; Vulkan hands the descriptor over to the caller.
        unsafe { functions.get_memory_fd(&info).map(|fd| OwnedFd::from_raw_fd(fd)) }
    }

    pub fn number(handle: &Handle) -> u64 {
        handle.as_raw_fd() as u64
    }

    pub fn imported(handle: Handle) {
        // Who imports a descriptor owns and closes it.
        let _ = handle.into_raw_fd();
    }
}

#[cfg(windows)]
mod system {
    use super::vk;
    use std::os::windows::io::{AsRawHandle, FromRawHandle, OwnedHandle};

    /// Owns a handle.
    pub type Handle = OwnedHandle;
    pub use ash::khr::external_memory_win32::NAME as VULKAN_EXTENSION;
    /// What Vulkan calls it.
    pub const VULKAN_TYPE: vk::ExternalMemoryHandleTypeFlags =
        vk::ExternalMemoryHandleTypeFlags::OPAQUE_WIN32;
    /// What an OpenCL device lists that imports it.
    pub const OPENCL_EXTENSION: &str = "cl_khr_external_memory_win32";
    /// CL_EXTERNAL_MEMORY_HANDLE_OPAQUE_WIN32_KHR.
    pub const OPENCL_TYPE: u64 = 0x2061;

    pub unsafe fn export(
        instance: &ash::Instance,
        device: &ash::Device,
        memory: vk::DeviceMemory,
    ) -> Result<Handle, vk::Result> {
        let functions = ash::khr::external_memory_win32::Device::new(instance, device);
        let info = vk::MemoryGetWin32HandleInfoKHR::default().memory(memory).handle_type(VULKAN_TYPE);
        // SAFETY: by the caller's contract; Vulkan hands the handle over to the caller.
        unsafe {
            functions
                .get_memory_win32_handle(&info)
                .map(|handle| OwnedHandle::from_raw_handle(handle as *mut std::ffi::c_void))
        }
    }

    pub fn number(handle: &Handle) -> u64 {
        handle.as_raw_handle() as u64
    }

    pub fn imported(handle: Handle) {
        // The memory outlives the handle, which whoever asked for it closes.
        drop(handle);
    }
}

pub use system::{Handle, OPENCL_EXTENSION, OPENCL_TYPE, VULKAN_EXTENSION, VULKAN_TYPE};

/// A handle of a device's memory.
///
/// # Errors
/// Vulkan's code where the driver refuses.
///
/// # Safety
/// The memory is the device's and was allocated for export as [`VULKAN_TYPE`], and [`VULKAN_EXTENSION`] is enabled.
pub unsafe fn export(
    instance: &ash::Instance,
    device: &ash::Device,
    memory: vk::DeviceMemory,
) -> Result<Handle, vk::Result> {
    // SAFETY: by the caller's contract.
    unsafe { system::export(instance, device, memory) }
}

/// A handle as a number, as OpenCL takes it.
pub fn number(handle: &Handle) -> u64 {
    system::number(handle)
}

/// Lets go of a handle whose memory was imported.
pub fn imported(handle: Handle) {
    system::imported(handle);
}
