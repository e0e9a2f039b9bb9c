//! Kernel launches with typed arguments.
#![allow(unsafe_code)]

use bytemuck::Pod;
use opencl3::kernel::set_kernel_arg;
use opencl3::types::{cl_event, cl_mem};
use opencl3::{event, kernel};

use super::owned::Owned;
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
    kernel: Owned<kernel::Kernel>,
    device: Device,
}

impl Kernel {
    pub(super) fn new(device: Device, kernel: kernel::Kernel) -> Self {
        Kernel { device, kernel: Owned::new(kernel) }
    }

    /// Bytes of memory of its own that a work-item needs beside registers, for stacks and spills; 0 where the driver
    /// does not tell.
    pub fn private_bytes(&self) -> u64 {
        self.kernel.get_private_mem_size(self.device.id()).unwrap_or(0)
    }

    /// Enqueues the kernel over `items` work-items in groups of `local`; `items` is rounded up to
    /// whole groups, so the kernel checks its range.
    ///
    /// # Errors
    /// [`crate::Error::Device`] with the driver's code.
    pub fn launch(&self, args: &[Arg], items: usize, local: usize) -> Result<Event> {
        for (index, arg) in args.iter().enumerate() {
            let index = index as u32;
            // SAFETY: OpenCL copies the argument, and compares its size with the kernel's. Of bytes whose number is
            // not a type's opencl3 has only the C function.
            unsafe {
                match arg {
                    Arg::Memory(memory) => self.kernel.set_arg(index, &memory.0),
                    Arg::U32(value) => self.kernel.set_arg(index, value),
                    Arg::Bytes(bytes) => {
                        set_kernel_arg(self.kernel.get(), index, bytes.len(), bytes.as_ptr().cast())
                            .map_err(Into::into)
                    }
                }
            }
            .map_err(|e| self.device.failed(&format!("refuses argument {index} of a kernel"), e))?;
        }
        let global = [items.div_ceil(local).max(1) * local];
        let local = [local];
        // SAFETY: one dimension, both arrays are that long; the buffers behind the arguments outlive
        // the launch, since OpenCL retains them.
        let event = unsafe {
            self.device.queue().enqueue_nd_range_kernel(
                self.kernel.get(),
                1,
                std::ptr::null(),
                global.as_ptr(),
                local.as_ptr(),
                &[],
            )
        }
        .map_err(|e| self.device.failed("refuses a kernel", e))?;
        Ok(Event(Owned::new(event)))
    }
}

/// A command under way or done.
#[derive(Debug)]
pub struct Event(Owned<event::Event>);

impl Event {
    pub(super) fn new(event: cl_event) -> Self {
        Event(Owned::new(event::Event::new(event)))
    }

    /// Waits until it is done, and with it all that was put into the queue before.
    ///
    /// # Errors
    /// [`crate::Error::Device`] with the driver's code: the device is lost.
    pub(super) fn wait(&self, device: &Device) -> Result<()> {
        self.0.wait().map_err(|e| device.failed("could not finish its work", e))
    }

    /// The time that the device spent on it, in milliseconds; 0 where the driver does not tell.
    /// Call it when it is done.
    pub fn device_ms(&self) -> f64 {
        match (self.0.profiling_command_start(), self.0.profiling_command_end()) {
            (Ok(start), Ok(end)) => end.saturating_sub(start) as f64 * 1e-6,
            _ => 0.0,
        }
    }
}
