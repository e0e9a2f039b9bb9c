//! Kernel launches with typed arguments.
#![allow(unsafe_code)]

use std::ffi::c_void;

use bytemuck::Pod;
use cl3::types::{cl_event, cl_kernel, cl_mem};

use super::{Buffer, Device};
use crate::error::Result;

/// An argument of a kernel.
#[derive(Clone, Copy, Debug)]
pub enum Arg<'a> {
    /// Global memory.
    Memory(Memory),
    /// A `uint`.
    U32(u32),
    /// A struct or vector passed by value.
    Bytes(&'a [u8]),
}

/// The handle of a buffer that outlives the launch.
#[derive(Clone, Copy, Debug)]
pub struct Memory(cl_mem);

impl<'a> Arg<'a> {
    /// Memory that does not exist, since the scene does not require it: a null pointer.
    pub const NONE: Arg<'static> = Arg::Memory(Memory(std::ptr::null_mut()));

    /// A buffer.
    pub fn buffer<T: Pod>(buffer: &'a Buffer<T>) -> Arg<'a> {
        Arg::Memory(Memory(buffer.memory()))
    }

    /// A buffer that may not exist.
    pub fn optional<T: Pod>(buffer: &'a Option<Buffer<T>>) -> Arg<'a> {
        buffer.as_ref().map_or(Arg::NONE, Arg::buffer)
    }

    /// A struct by value; its layout is in `kernels/shared/types.h`.
    pub fn value<T: Pod>(value: &'a T) -> Arg<'a> {
        Arg::Bytes(bytemuck::bytes_of(value))
    }
}

/// A kernel; released when dropped.
#[derive(Debug)]
pub struct Kernel {
    device: Device,
    kernel: cl_kernel,
}

// SAFETY: handles may move between threads; a kernel is not Sync, since its arguments are state.
unsafe impl Send for Kernel {}

impl Kernel {
    pub(super) fn new(device: Device, kernel: cl_kernel) -> Self {
        Kernel { device, kernel }
    }

    /// Bytes of memory of its own that a work-item needs beside registers, for stacks and spills; 0 where the driver
    /// does not tell.
    pub fn private_bytes(&self) -> u64 {
        const CL_KERNEL_PRIVATE_MEM_SIZE: u32 = 0x11B4;
        cl3::kernel::get_kernel_work_group_info(self.kernel, self.device.id(), CL_KERNEL_PRIVATE_MEM_SIZE)
            .map_or(0, u64::from)
    }

    /// Enqueues the kernel over `items` work-items in groups of `local`; `items` is rounded up to
    /// whole groups, so the kernel checks its range.
    ///
    /// # Errors
    /// [`crate::Error::Device`] with the driver's code.
    pub fn launch(&self, args: &[Arg], items: usize, local: usize) -> Result<Event> {
        for (index, arg) in args.iter().enumerate() {
            let (size, pointer): (usize, *const c_void) = match arg {
                Arg::Memory(memory) => (size_of::<cl_mem>(), std::ptr::from_ref(&memory.0).cast()),
                Arg::U32(value) => (4, std::ptr::from_ref(value).cast()),
                Arg::Bytes(bytes) => (bytes.len(), bytes.as_ptr().cast()),
            };
            // SAFETY: OpenCL copies `size` bytes from `pointer`, which is valid for them.
            unsafe { cl3::kernel::set_kernel_arg(self.kernel, index as u32, size, pointer) }
                .map_err(|e| self.device.failed(&format!("refuses argument {index} of a kernel"), e))?;
        }
        let global = [items.div_ceil(local).max(1) * local];
        let local = [local];
        // SAFETY: one dimension, both arrays are that long; the buffers behind the arguments outlive
        // the launch, since OpenCL retains them.
        let event = unsafe {
            cl3::command_queue::enqueue_nd_range_kernel(
                self.device.queue(),
                self.kernel,
                1,
                std::ptr::null(),
                global.as_ptr(),
                local.as_ptr(),
                0,
                std::ptr::null(),
            )
        }
        .map_err(|e| self.device.failed("refuses a kernel", e))?;
        Ok(Event(event))
    }
}

impl Drop for Kernel {
    fn drop(&mut self) {
        // SAFETY: created by `Program::kernel`, released once.
        let _ = unsafe { cl3::kernel::release_kernel(self.kernel) };
    }
}

/// A launch under way or done.
#[derive(Debug)]
pub struct Event(cl_event);

impl Event {
    /// The time that the device spent on it, in milliseconds; 0 where the driver does not tell.
    /// Call it after [`Device::finish`].
    pub fn device_ms(&self) -> f64 {
        let at = |what| cl3::event::get_event_profiling_info(self.0, what).map(u64::from);
        match (at(cl3::event::CL_PROFILING_COMMAND_START), at(cl3::event::CL_PROFILING_COMMAND_END)) {
            (Ok(start), Ok(end)) => end.saturating_sub(start) as f64 * 1e-6,
            _ => 0.0,
        }
    }
}

impl Drop for Event {
    fn drop(&mut self) {
        // SAFETY: returned by an enqueue, released once.
        let _ = unsafe { cl3::event::release_event(self.0) };
    }
}
