//! Copies between host and device that take their turn in the queue, while the host goes on.
#![allow(unsafe_code)]

use bytemuck::Pod;
use opencl3::command_queue::{enqueue_read_buffer, enqueue_write_buffer};
use opencl3::types::{CL_NON_BLOCKING, cl_command_queue, cl_event};

use super::{Buffer, Device, Event};
use crate::error::Result;

/// A copy under way, with what keeps the host's side of it: `M` is not touched before the copy is done. Dropping it
/// waits for that.
#[derive(Debug)]
pub struct Transfer<M> {
    /// None where there is nothing to copy.
    event: Option<Event>,
    device: Device,
    /// None once it was handed back.
    memory: Option<M>,
}

impl<M> Transfer<M> {
    /// Waits until it is done, and with it all that was put into the queue before.
    ///
    /// # Errors
    /// [`crate::Error::Device`] with the driver's code: the device is lost.
    pub fn wait(&self) -> Result<()> {
        self.event.as_ref().map_or(Ok(()), |event| event.wait(&self.device))
    }

    /// The device's time for it: see [`Event::device_ms`]. Call it when it is done.
    pub fn device_ms(&self) -> f64 {
        self.event.as_ref().map_or(0.0, Event::device_ms)
    }

    /// Waits, and hands the host's side back.
    ///
    /// # Errors
    /// As [`Transfer::wait`]. The memory is never freed then, since the device may still use it.
    pub fn into_memory(mut self) -> Result<M> {
        let done = self.wait();
        let memory = self.memory.take();
        match (done, memory) {
            (Ok(()), Some(memory)) => Ok(memory),
            (done, memory) => {
                std::mem::forget(memory);
                Err(done.err().unwrap_or_else(|| unreachable!("memory is handed back once, here")))
            }
        }
    }
}

impl<M> Drop for Transfer<M> {
    fn drop(&mut self) {
        if let Some(memory) = self.memory.take()
            && self.wait().is_err()
        {
            std::mem::forget(memory);
        }
    }
}

impl<T: Pod> Buffer<T> {
    /// Starts copying `count` elements from element `first` on.
    ///
    /// # Errors
    /// [`crate::Error::Device`] with the driver's code.
    pub fn start_read(&self, first: usize, count: usize) -> Result<Transfer<Vec<T>>> {
        let mut data = vec![T::zeroed(); count];
        let to = data.as_mut_ptr();
        // SAFETY: a vector that is moved keeps its elements where they are.
        unsafe { self.start_read_to(first, count, to, data) }
    }

    /// The same to `to`, which `memory` keeps.
    ///
    /// # Errors
    /// As [`Buffer::start_read`].
    ///
    /// # Safety
    /// `to` must be valid for writes of `count` elements for as long as `memory` lives, wherever that is moved, and
    /// nobody may touch them before the copy is done.
    pub unsafe fn start_read_to<M>(
        &self,
        first: usize,
        count: usize,
        to: *mut T,
        memory: M,
    ) -> Result<Transfer<M>> {
        let fits = first.checked_add(count).is_some_and(|end| end <= self.len());
        assert!(fits, "read of {count} elements at {first} from a buffer of {}", self.len());
        let (at, bytes) = (first * size_of::<T>(), count * size_of::<T>());
        let start = |queue| {
            let (list, none) = (std::ptr::null(), 0);
            // SAFETY: the range is inside the buffer, and `to` is valid until the copy is done, by the caller's contract
            // and since the transfer keeps `memory` until then.
            unsafe {
                enqueue_read_buffer(queue, self.memory(), CL_NON_BLOCKING, at, bytes, to.cast(), none, list)
            }
        };
        self.start(memory, bytes, "a read", start)
    }

    /// Starts copying elements to the buffer's start.
    ///
    /// # Errors
    /// [`crate::Error::Device`] with the driver's code.
    pub fn start_write(&self, data: Vec<T>) -> Result<Transfer<Vec<T>>> {
        assert!(data.len() <= self.len(), "write of {} elements to a buffer of {}", data.len(), self.len());
        let (from, bytes) = (data.as_ptr(), size_of_val(&data[..]));
        let start = |queue| {
            let (list, none) = (std::ptr::null(), 0);
            // SAFETY: the range is inside the buffer, and the elements, which a vector that is moved keeps where they are,
            // live and stay as they are until the copy is done.
            unsafe {
                enqueue_write_buffer(queue, self.memory(), CL_NON_BLOCKING, 0, bytes, from.cast(), none, list)
            }
        };
        self.start(data, bytes, "a write", start)
    }

    fn start<M>(
        &self,
        memory: M,
        bytes: usize,
        what: &str,
        start: impl FnOnce(cl_command_queue) -> std::result::Result<cl_event, i32>,
    ) -> Result<Transfer<M>> {
        let device = self.device().clone();
        let refused = |code: i32| device.failed(&format!("refuses {what}"), code.into());
        let event = match bytes {
            0 => None,
            _ => Some(Event::new(start(device.queue().get()).map_err(refused)?)),
        };
        Ok(Transfer { event, device, memory: Some(memory) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::opencl::device;

    /// Copies, fills and reads take their turns: each sees what those before it have left, whenever it is waited for.
    #[test]
    fn transfers_keep_their_order() {
        let Some(info) = device::list().into_iter().find(|info| info.unusable.is_none()) else {
            println!("not run: there is no OpenCL device");
            return;
        };
        let device = Device::open(&info).unwrap();
        let buffer = Buffer::<u32>::zeroed(&device, 5000).unwrap();
        let zeroed = buffer.start_read(0, 5000).unwrap();
        let mut steps = Vec::new();
        for step in 1..=20u32 {
            let written = buffer.start_write((0..4000).map(|i| i * step).collect()).unwrap();
            let read = buffer.start_read(1000, 3000).unwrap();
            buffer.fill_zero().unwrap();
            steps.push((step, written, read, buffer.start_read(3999, 1).unwrap()));
        }
        // Waited for in the opposite order, and some not at all.
        for (step, written, read, filled) in steps.into_iter().rev().filter(|(step, ..)| step % 3 != 0) {
            assert_eq!(filled.into_memory().unwrap(), [0]);
            assert!(read.into_memory().unwrap().iter().zip(1000..).all(|(&found, i)| found == i * step));
            assert_eq!(written.into_memory().unwrap()[3999], 3999 * step);
        }
        assert_eq!(zeroed.into_memory().unwrap(), vec![0; 5000]);
        let nothing = buffer.start_read(5000, 0).unwrap();
        nothing.wait().unwrap();
        assert_eq!(nothing.device_ms(), 0.0);
        assert!(nothing.into_memory().unwrap().is_empty());
        buffer.start_write(Vec::new()).unwrap().wait().unwrap();
    }
}
