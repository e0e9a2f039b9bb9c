//! Global memory of a device.
#![allow(unsafe_code)]

use std::ffi::c_void;
use std::sync::atomic::{AtomicU64, Ordering};

use bytemuck::Pod;
use opencl3::command_queue::{enqueue_fill_buffer, enqueue_write_buffer};
use opencl3::error_codes::CL_INVALID_OPERATION;
use opencl3::memory::{self, ClMem};
use opencl3::types::{CL_BLOCKING, cl_mem};

use super::external::Handover;
use super::owned::Owned;
use super::{Device, Event};
use crate::error::Result;
use crate::gpu::handle::{self, Handle, OPENCL_EXTENSION, OPENCL_TYPE};

/// A buffer of `len` elements of `T`; released when dropped.
#[derive(Debug)]
pub struct Buffer<T> {
    memory: Owned<memory::Buffer<T>>,
    device: Device,
    len: usize,
    serial: u64,
    /// Exists where another API has allocated the memory.
    handover: Option<Handover>,
}

impl<T: Pod> Buffer<T> {
    /// A buffer with a copy of `data`, which kernels only read: what they write to it is undefined. Empty data makes a buffer
    /// of one zeroed element.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device has no room for it.
    pub fn from_slice(device: &Device, data: &[T]) -> Result<Self> {
        Self::copied(device, memory::CL_MEM_READ_ONLY, data)
    }

    /// The same for kernels that write to it, too.
    ///
    /// # Errors
    /// As [`Buffer::from_slice`].
    pub fn changing(device: &Device, data: &[T]) -> Result<Self> {
        Self::copied(device, memory::CL_MEM_READ_WRITE, data)
    }

    fn copied(device: &Device, access: u64, data: &[T]) -> Result<Self> {
        let zero = [T::zeroed()];
        let data = if data.is_empty() { &zero[..] } else { data };
        let flags = access | memory::CL_MEM_COPY_HOST_PTR;
        Self::create(device, flags, data.len(), data.as_ptr() as *mut c_void)
    }

    /// A buffer of `len` elements (at least one) of undefined content.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device has no room for it.
    pub fn new(device: &Device, len: usize) -> Result<Self> {
        Self::create(device, memory::CL_MEM_READ_WRITE, len.max(1), std::ptr::null_mut())
    }

    /// A buffer of `len` elements (at least one) whose bytes are zero.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device has no room for it, or refuses to fill it.
    pub fn zeroed(device: &Device, len: usize) -> Result<Self> {
        let buffer = Self::new(device, len)?;
        buffer.fill_zero()?;
        Ok(buffer)
    }

    /// A buffer that uses memory of the host in place (`CL_MEM_USE_HOST_PTR`).
    ///
    /// # Safety
    /// `host` must be valid for reads and writes of `len` elements for as long as the buffer lives,
    /// and the host must not touch them while the device does.
    pub unsafe fn from_host_memory(device: &Device, host: *mut T, len: usize) -> Result<Self> {
        let flags = memory::CL_MEM_READ_WRITE | memory::CL_MEM_USE_HOST_PTR;
        Self::create(device, flags, len, host.cast())
    }

    /// A buffer at the start of memory that another API has exported by an opaque handle. Kernels may use
    /// it between [`Buffer::acquire`] and [`Buffer::release`].
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device does not list [`OPENCL_EXTENSION`], or refuses the memory.
    ///
    /// # Safety
    /// The memory must hold `len` elements, and nobody else may touch them while the device has acquired them.
    pub unsafe fn from_handle(device: &Device, handle: Handle, len: usize) -> Result<Self> {
        const DEVICE_LIST: u64 = 0x2051;
        if !device.info().external_memory.iter().any(|name| name == OPENCL_EXTENSION) {
            return Err(device.failed("imports no memory by opaque handles", CL_INVALID_OPERATION.into()));
        }
        let handover = Handover::of(device)?;
        // Both lists end with zero.
        let properties = [OPENCL_TYPE, handle::number(&handle), DEVICE_LIST, device.id() as u64, 0, 0];
        // SAFETY: the properties are a list of pairs with its end, and there is no host memory.
        let made = unsafe {
            memory::Buffer::create_with_properties(
                device.context(),
                properties.as_ptr(),
                memory::CL_MEM_READ_WRITE,
                len,
                std::ptr::null_mut(),
            )
        };
        // A handle that was not imported is still ours, and is closed.
        let memory = made.map_err(|error| device.failed("refuses shared memory", error))?;
        handle::imported(handle);
        Ok(Self::of(device, memory, len, Some(handover)))
    }

    /// Takes memory of another API over, before kernels are launched that use it. Nothing else needs it.
    ///
    /// # Errors
    /// [`crate::Error::Device`] with the driver's code.
    pub fn acquire(&self) -> Result<()> {
        self.handover.map_or(Ok(()), |handover| handover.acquire(&self.device, self.memory()))
    }

    /// Hands memory of another API back, after those kernels were launched; it has it when the queue
    /// has come past that.
    ///
    /// # Errors
    /// [`crate::Error::Device`] with the driver's code.
    pub fn release(&self) -> Result<()> {
        self.handover.map_or(Ok(()), |handover| handover.release(&self.device, self.memory()))
    }

    fn create(device: &Device, flags: u64, len: usize, host: *mut c_void) -> Result<Self> {
        let mib = (len * size_of::<T>()) >> 20;
        // SAFETY: `host` is null or valid for `len` elements (this room's callers see to it).
        let memory = unsafe { memory::Buffer::create(device.context(), flags, len, host) }
            .map_err(|e| device.failed(&format!("has no room for a buffer of {mib} MiB"), e))?;
        Ok(Self::of(device, memory, len, None))
    }

    fn of(device: &Device, memory: memory::Buffer<T>, len: usize, handover: Option<Handover>) -> Self {
        static SERIAL: AtomicU64 = AtomicU64::new(1);
        let serial = SERIAL.fetch_add(1, Ordering::Relaxed);
        Buffer { device: device.clone(), memory: Owned::new(memory), len, serial, handover }
    }

    /// Number of elements.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Size in bytes.
    pub fn bytes(&self) -> usize {
        self.len * size_of::<T>()
    }

    /// Has all its bytes zeroed in the queue's order, without waiting for it.
    ///
    /// # Errors
    /// [`crate::Error::Device`] with the driver's code.
    ///
    /// # Panics
    /// If elements are not made of whole words of four bytes.
    pub fn fill_zero(&self) -> Result<()> {
        let pattern = [0u32];
        assert!(self.bytes().is_multiple_of(size_of_val(&pattern)), "elements of {} bytes", size_of::<T>());
        // The C function, as in `write_at`.
        // SAFETY: the range is the buffer; OpenCL copies the pattern before the call returns.
        let event = unsafe {
            enqueue_fill_buffer(
                self.device.queue().get(),
                self.memory(),
                pattern.as_ptr().cast(),
                size_of_val(&pattern),
                0,
                self.bytes(),
                0,
                std::ptr::null(),
            )
        };
        drop(Event::new(event.map_err(|e| self.device.failed("does not clear a buffer", e.into()))?));
        Ok(())
    }

    /// Copies `data` to the buffer's start and waits for it.
    pub fn write(&self, data: &[T]) -> Result<()> {
        self.write_at(0, data)
    }

    /// Copies `data` to the buffer from element `first` on and waits for it.
    pub fn write_at(&self, first: usize, data: &[T]) -> Result<()> {
        let fits = first.checked_add(data.len()).is_some_and(|end| end <= self.len);
        assert!(fits, "write of {} elements at {first} to a buffer of {}", data.len(), self.len);
        if data.is_empty() {
            return Ok(());
        }
        // The C function, since opencl3's takes buffers by exclusive reference, and these are shared: what changes
        // is the device's memory, in the queue's order.
        // SAFETY: the range is inside the buffer, and the call blocks until `data` was read.
        let event = unsafe {
            enqueue_write_buffer(
                self.device.queue().get(),
                self.memory(),
                CL_BLOCKING,
                first * size_of::<T>(),
                size_of_val(data),
                data.as_ptr().cast(),
                0,
                std::ptr::null(),
            )
        };
        let event = event.map_err(|e| self.device.failed("refuses a write", e.into()))?;
        drop(Event::new(event));
        Ok(())
    }

    /// Copies the first `data.len()` elements to `data` and waits for it.
    pub fn read(&self, data: &mut [T]) -> Result<()> {
        self.read_at(0, data)
    }

    /// Copies `data.len()` elements from element `first` on to `data` and waits for it.
    pub fn read_at(&self, first: usize, data: &mut [T]) -> Result<()> {
        let fits = first.checked_add(data.len()).is_some_and(|end| end <= self.len);
        assert!(fits, "read of {} elements at {first} from a buffer of {}", data.len(), self.len);
        if data.is_empty() {
            return Ok(());
        }
        // SAFETY: the range is inside the buffer, and the call blocks until `data` was written.
        let event = unsafe {
            let first = first * size_of::<T>();
            self.device.queue().enqueue_read_buffer(&self.memory, CL_BLOCKING, first, data, &[])
        };
        drop(Owned::new(event.map_err(|e| self.device.failed("refuses a read", e))?));
        Ok(())
    }

    /// The whole content.
    pub fn to_vec(&self) -> Result<Vec<T>> {
        let mut data = vec![T::zeroed(); self.len];
        self.read(&mut data)?;
        Ok(data)
    }

    pub(super) fn device(&self) -> &Device {
        &self.device
    }

    /// A number that no other buffer of this program has or had; not 0.
    pub(super) fn serial(&self) -> u64 {
        self.serial
    }

    pub(super) fn memory(&self) -> cl_mem {
        self.memory.get()
    }
}
