//! Memory of other APIs, as cl_khr_external_memory_opaque_fd and cl_khr_external_memory_win32 bring it in.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_void};

use opencl3::error_codes::{CL_INVALID_OPERATION, ClError};
use opencl3::types::{cl_command_queue, cl_event, cl_mem};

use super::Device;
use crate::error::Result;

/// clEnqueueAcquireExternalMemObjectsKHR, and clEnqueueReleaseExternalMemObjectsKHR.
type Enqueue =
    unsafe extern "C" fn(cl_command_queue, u32, *const cl_mem, u32, *const cl_event, *mut cl_event) -> i32;

/// The two functions that take such memory over and hand it back.
#[derive(Clone, Copy, Debug)]
pub(super) struct Handover {
    acquire: Enqueue,
    release: Enqueue,
}

impl Handover {
    /// Of the device's platform.
    pub(super) fn of(device: &Device) -> Result<Handover> {
        Ok(Handover {
            acquire: function(device, c"clEnqueueAcquireExternalMemObjectsKHR")?,
            release: function(device, c"clEnqueueReleaseExternalMemObjectsKHR")?,
        })
    }

    pub(super) fn acquire(self, device: &Device, memory: cl_mem) -> Result<()> {
        enqueue(self.acquire, device, memory)
            .map_err(|e| device.failed("does not take shared memory over", e))
    }

    pub(super) fn release(self, device: &Device, memory: cl_mem) -> Result<()> {
        enqueue(self.release, device, memory)
            .map_err(|e| device.failed("does not hand shared memory back", e))
    }
}

fn enqueue(function: Enqueue, device: &Device, memory: cl_mem) -> std::result::Result<(), ClError> {
    // SAFETY: one memory object that lives longer than the call; the queue is in order, so no events are needed.
    let error = unsafe {
        function(device.queue().get(), 1, &raw const memory, 0, std::ptr::null(), std::ptr::null_mut())
    };
    if error == 0 { Ok(()) } else { Err(error.into()) }
}

/// A function of an extension. It is asked for from the platform, since loaders do not pass all of them on.
fn function(device: &Device, name: &CStr) -> Result<Enqueue> {
    // opencl3 has no such question: cl3's loader is asked.
    let library = cl3::load_library().as_ref().ok();
    let address = library.and_then(|library| {
        library.clGetExtensionFunctionAddressForPlatform(device.platform(), name.as_ptr())
    });
    let address: *mut c_void = address.unwrap_or(std::ptr::null_mut());
    if address.is_null() {
        return Err(device.failed(&format!("has no {}", name.to_string_lossy()), CL_INVALID_OPERATION.into()));
    }
    // SAFETY: the extension defines functions of these names with this type, and the driver stays loaded.
    Ok(unsafe { std::mem::transmute::<*mut c_void, Enqueue>(address) })
}
