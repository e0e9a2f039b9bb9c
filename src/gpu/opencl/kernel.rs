//! Kernel launches with typed arguments. A kernel keeps its arguments from one launch to the next, so that only those that have
//! changed are set: of the thirty that a frame's kernels have, all but a few are the scene's.
#![allow(unsafe_code)]

use std::sync::{Mutex, PoisonError};

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
pub struct Memory {
    handle: cl_mem,
    /// No other buffer's, 0 where there is none: handles of buffers that are gone come again.
    serial: u64,
}

impl<'a> Arg<'a> {
    /// Memory that does not exist, since the scene does not require it: a null pointer.
    pub const NONE: Arg<'static> = Arg::Memory(Memory { handle: std::ptr::null_mut(), serial: 0 });

    /// A buffer.
    pub fn buffer<T: Pod>(buffer: &'a Buffer<T>) -> Arg<'a> {
        Arg::Memory(Memory { handle: buffer.memory(), serial: buffer.serial() })
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

/// What an argument was set to.
#[derive(Debug)]
enum Set {
    Memory(u64),
    U32(u32),
    Bytes(Vec<u8>),
}

impl Set {
    fn of(arg: &Arg) -> Set {
        match *arg {
            Arg::Memory(memory) => Set::Memory(memory.serial),
            Arg::U32(value) => Set::U32(value),
            Arg::Bytes(bytes) => Set::Bytes(bytes.to_vec()),
        }
    }

    fn is(&self, arg: &Arg) -> bool {
        match (self, arg) {
            (Set::Memory(serial), Arg::Memory(memory)) => *serial == memory.serial,
            (Set::U32(known), Arg::U32(value)) => known == value,
            (Set::Bytes(known), Arg::Bytes(bytes)) => known == bytes,
            _ => false,
        }
    }
}

/// A kernel; released when dropped.
#[derive(Debug)]
pub struct Kernel {
    kernel: Owned<kernel::Kernel>,
    device: Device,
    /// Its arguments, as far as they were set. Held while they are set and the kernel is enqueued.
    set: Mutex<Vec<Set>>,
}

impl Kernel {
    pub(super) fn new(device: Device, kernel: kernel::Kernel) -> Self {
        Kernel { device, kernel: Owned::new(kernel), set: Mutex::default() }
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
        let mut set = self.set.lock().unwrap_or_else(PoisonError::into_inner);
        for (index, arg) in args.iter().enumerate() {
            if set.get(index).is_some_and(|set| set.is(arg)) {
                continue;
            }
            self.set_arg(index as u32, arg)?;
            match set.get_mut(index) {
                Some(set) => *set = Set::of(arg),
                None => set.push(Set::of(arg)),
            }
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

    fn set_arg(&self, index: u32, arg: &Arg) -> Result<()> {
        // SAFETY: OpenCL copies the argument, and compares its size with the kernel's. Of bytes whose number is not a type's
        // opencl3 has only the C function.
        unsafe {
            match arg {
                Arg::Memory(memory) => self.kernel.set_arg(index, &memory.handle),
                Arg::U32(value) => self.kernel.set_arg(index, value),
                Arg::Bytes(bytes) => {
                    set_kernel_arg(self.kernel.get(), index, bytes.len(), bytes.as_ptr().cast())
                        .map_err(Into::into)
                }
            }
        }
        .map_err(|e| self.device.failed(&format!("refuses argument {index} of a kernel"), e))
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

    /// The time that the device spent on it, in milliseconds; 0 where the driver does not tell, or the
    /// device times nothing.
    /// Call it when it is done.
    pub fn device_ms(&self) -> f64 {
        match (self.0.profiling_command_start(), self.0.profiling_command_end()) {
            (Ok(start), Ok(end)) => end.saturating_sub(start) as f64 * 1e-6,
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::opencl::{Program, device};

    const SOURCE: &str = "
__kernel void add(__global uint *to, __global const uint *from, uint value, float4 vector)
{
    to[0] += (from ? from[0] : 0u) + value + (uint)vector.y;
}";

    /// Arguments that have changed are set, those that have not stay, and buffers that are gone are not taken for others.
    #[test]
    fn launches_have_their_own_arguments() {
        let Some(info) = device::list().into_iter().find(|info| info.unusable.is_none()) else {
            println!("not run: there is no OpenCL device");
            return;
        };
        let device = Device::open(&info).unwrap();
        let kernel = Program::build(&device, "add", SOURCE, "-cl-std=CL1.2").unwrap().kernel("add").unwrap();
        let to = Buffer::<u32>::zeroed(&device, 1).unwrap();
        let mut expected = 0;
        for step in 0..24u32 {
            // Half of the steps have a buffer, which is gone before the next one's is made.
            let from = step.is_multiple_of(2).then(|| Buffer::from_slice(&device, &[1000 * step]).unwrap());
            let (value, vector) = (step / 3, [0.0, (step / 4) as f32, 0.0, 0.0]);
            let args = [Arg::buffer(&to), Arg::optional(&from), Arg::U32(value), Arg::value(&vector)];
            kernel.launch(&args, 1, 1).unwrap();
            expected += from.map_or(0, |_| 1000 * step) + value + step / 4;
            assert_eq!(to.to_vec().unwrap(), [expected], "step {step}");
        }
    }

    #[test]
    fn buffers_with_one_handle_are_told_apart() {
        let [first, second] = [1, 2].map(|serial| Memory { handle: std::ptr::null_mut(), serial });
        let set = Set::of(&Arg::Memory(first));
        assert!(set.is(&Arg::Memory(first)) && !set.is(&Arg::Memory(second)) && !set.is(&Arg::U32(1)));
    }
}
