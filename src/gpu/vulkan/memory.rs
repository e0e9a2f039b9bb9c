//! Buffers.
#![allow(unsafe_code)]

use std::ptr::NonNull;
use std::sync::{Arc, Mutex};

use ash::vk;
use bytemuck::Pod;

use super::context::{Context, lock};
use crate::error::{Error, Result};

/// Alignment of every [`HostBuffer`]'s address: a page, which OpenCL implementations ask for to use
/// memory in place.
pub const HOST_ALIGNMENT: usize = 4096;

/// A buffer with its memory.
pub(super) struct Allocation {
    context: Context,
    pub buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    pub size: u64,
    /// Whether the device reads it from its own memory.
    pub local: bool,
    /// Address on the host, where it is mapped.
    mapped: Option<NonNull<u8>>,
    /// Held while the host copies, so that its threads do not race.
    copying: Mutex<()>,
}

// SAFETY: handles may be used on any thread; the host's address is only copied from and to.
unsafe impl Send for Allocation {}
// SAFETY: as above; nothing changes through a shared reference but the buffer's contents, whose
// users are told to order their accesses.
unsafe impl Sync for Allocation {}

impl Drop for Allocation {
    fn drop(&mut self) {
        // SAFETY: commands hold what they use until it is done, so nothing uses these handles.
        unsafe {
            self.context.0.device.destroy_buffer(self.buffer, None);
            self.context.0.device.free_memory(self.memory, None);
        }
    }
}

const STORAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::STORAGE_BUFFER.as_raw()
        | vk::BufferUsageFlags::TRANSFER_SRC.as_raw()
        | vk::BufferUsageFlags::TRANSFER_DST.as_raw(),
);

impl Allocation {
    /// `wishes` are sets of memory properties, best first; the last is required.
    fn new(context: &Context, size: u64, wishes: &[vk::MemoryPropertyFlags], host: bool) -> Result<Self> {
        let device = &context.0.device;
        let size = size.max(16).next_multiple_of(16);
        let info = vk::BufferCreateInfo::default().size(size).usage(STORAGE);
        // SAFETY: the size is not zero.
        let buffer = unsafe { device.create_buffer(&info, None) }
            .map_err(|code| context.refused(&format!("a buffer of {size} bytes"), code))?;
        // SAFETY: the buffer was made by this device.
        let needs = unsafe { device.get_buffer_memory_requirements(buffer) };
        // Room to begin at the next page.
        let room = needs.size + if host { HOST_ALIGNMENT as u64 } else { 0 };
        let allocated = allocate(context, room, needs.memory_type_bits, wishes);
        let (memory, kind) = match allocated {
            Ok(allocated) => allocated,
            Err(error) => {
                // SAFETY: the buffer is not used.
                unsafe { device.destroy_buffer(buffer, None) };
                return Err(error);
            }
        };
        let local = context.0.memory.memory_types[kind as usize]
            .property_flags
            .contains(vk::MemoryPropertyFlags::DEVICE_LOCAL);
        let mut allocation = Allocation {
            context: context.clone(),
            buffer,
            memory,
            size,
            local,
            mapped: None,
            copying: Mutex::new(()),
        };
        let offset = if host { allocation.map(needs.alignment)? } else { 0 };
        // SAFETY: offset and size lie within the memory, aligned as the buffer requires.
        unsafe { device.bind_buffer_memory(buffer, memory, offset) }
            .map_err(|code| context.refused("binding memory", code))?;
        Ok(allocation)
    }

    /// Maps the memory, and returns the offset of its first page boundary.
    fn map(&mut self, alignment: u64) -> Result<u64> {
        let device = &self.context.0.device;
        // SAFETY: the memory is visible to the host and not mapped yet.
        let start = unsafe { device.map_memory(self.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty()) }
            .map_err(|code| self.context.refused("mapping memory", code))?
            .cast::<u8>();
        let offset = start.align_offset(HOST_ALIGNMENT);
        let problem = "its mapped memory is not aligned as it promises; update the driver";
        let refused =
            || Error::Device { device: self.context.report().name.clone(), problem: problem.into() };
        if offset >= HOST_ALIGNMENT || !(offset as u64).is_multiple_of(alignment) {
            return Err(refused());
        }
        // SAFETY: a page more than the buffer needs was allocated.
        self.mapped = NonNull::new(unsafe { start.add(offset) });
        Ok(offset as u64)
    }
}

pub(super) fn allocate(
    context: &Context,
    size: u64,
    types: u32,
    wishes: &[vk::MemoryPropertyFlags],
) -> Result<(vk::DeviceMemory, u32)> {
    let memory = &context.0.memory;
    let kinds = &memory.memory_types[..memory.memory_type_count as usize];
    let find = |wish: &vk::MemoryPropertyFlags| {
        (0..kinds.len()).find(|&kind| types & 1 << kind != 0 && kinds[kind].property_flags.contains(*wish))
    };
    let mut code = vk::Result::ERROR_FEATURE_NOT_PRESENT;
    for kind in wishes.iter().filter_map(find) {
        let info = vk::MemoryAllocateInfo::default().allocation_size(size).memory_type_index(kind as u32);
        // SAFETY: the type is one of the device's.
        match unsafe { context.0.device.allocate_memory(&info, None) } {
            Ok(memory) => return Ok((memory, kind as u32)),
            Err(refusal) => code = refusal,
        }
    }
    Err(context.refused(&format!("allocating {size} bytes"), code))
}

/// Memory that host and device both reach, mapped for its whole life: coherent, no flush needed.
///
/// Clones are the same memory. Who writes it orders that against its readers: the device's by
/// waiting for its commands, OpenCL's by finishing its queue.
#[derive(Clone)]
pub struct HostBuffer(pub(super) Arc<Allocation>);

impl HostBuffer {
    /// A buffer of at least `size` bytes, filled with zeros; cached on the host where possible.
    ///
    /// # Errors
    /// [`Error::Device`] if there is not enough memory.
    pub fn new(context: &Context, size: usize) -> Result<Self> {
        let base = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        let wishes = [
            base | vk::MemoryPropertyFlags::HOST_CACHED | vk::MemoryPropertyFlags::DEVICE_LOCAL,
            base | vk::MemoryPropertyFlags::HOST_CACHED,
            base,
        ];
        let allocation = Allocation::new(context, size as u64, &wishes, true)?;
        let buffer = HostBuffer(Arc::new(allocation));
        // SAFETY: the mapping holds `size` bytes, and no one else has it yet.
        unsafe { buffer.as_ptr().write_bytes(0, buffer.len()) };
        Ok(buffer)
    }

    /// Bytes: at least those asked for.
    pub fn len(&self) -> usize {
        self.0.size as usize
    }

    /// Never: a buffer has at least 16 bytes.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Its address: a multiple of [`HOST_ALIGNMENT`], valid while any clone lives.
    pub fn as_ptr(&self) -> *mut u8 {
        self.0.mapped.map_or(std::ptr::null_mut(), NonNull::as_ptr)
    }

    /// Copies values to the buffer, from a byte offset on.
    ///
    /// # Panics
    /// If they do not fit.
    pub fn write<T: Pod>(&self, offset: usize, values: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let fits = offset.checked_add(bytes.len()).is_some_and(|end| end <= self.len());
        assert!(fits, "{} bytes at {offset} do not fit a buffer of {}", bytes.len(), self.len());
        let _copying = lock(&self.0.copying);
        // SAFETY: the range lies in the mapping, which no reference points into.
        unsafe { self.as_ptr().add(offset).copy_from_nonoverlapping(bytes.as_ptr(), bytes.len()) };
    }

    /// Copies values from the buffer, from a byte offset on.
    ///
    /// # Panics
    /// If the range reaches beyond the buffer.
    pub fn read<T: Pod>(&self, offset: usize, count: usize) -> Vec<T> {
        let size = count.checked_mul(size_of::<T>());
        let end = size.and_then(|size| size.checked_add(offset));
        assert!(end.is_some_and(|end| end <= self.len()), "a read of {count} values at {offset} is too long");
        let mut values = vec![T::zeroed(); count];
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut values);
        let _copying = lock(&self.0.copying);
        // SAFETY: the range lies in the mapping, and any bytes are valid values of T.
        unsafe { bytes.as_mut_ptr().copy_from_nonoverlapping(self.as_ptr().add(offset), bytes.len()) };
        values
    }

    /// Copies every `step`-th of the first `count` values of the buffer.
    ///
    /// # Panics
    /// If they reach beyond the buffer, or `step` is 0.
    pub fn read_sparse<T: Pod>(&self, count: usize, step: usize) -> Vec<T> {
        let fits = count.checked_mul(size_of::<T>()).is_some_and(|end| end <= self.len());
        assert!(fits, "a read of {count} values is too long");
        let start = self.as_ptr().cast::<T>();
        let _copying = lock(&self.0.copying);
        // SAFETY: indices are below `count`, so each value lies in the mapping; any bytes are valid ones.
        (0..count).step_by(step).map(|index| unsafe { start.add(index).read_unaligned() }).collect()
    }
}

/// Memory that only the device reaches. Clones are the same memory.
#[derive(Clone)]
pub struct DeviceBuffer(pub(super) Arc<Allocation>);

impl DeviceBuffer {
    /// A buffer of at least `size` bytes, with undefined contents.
    ///
    /// # Errors
    /// [`Error::Device`] if there is not enough memory.
    pub fn new(context: &Context, size: usize) -> Result<Self> {
        let wishes = [vk::MemoryPropertyFlags::DEVICE_LOCAL, vk::MemoryPropertyFlags::empty()];
        Ok(DeviceBuffer(Arc::new(Allocation::new(context, size as u64, &wishes, false)?)))
    }

    /// Bytes: at least those asked for.
    pub fn len(&self) -> usize {
        self.0.size as usize
    }

    /// Never: a buffer has at least 16 bytes.
    pub fn is_empty(&self) -> bool {
        false
    }
}

/// A buffer of either kind, or a part of it, as shaders and copies use it.
#[derive(Clone)]
pub struct BufferRef {
    pub(super) allocation: Arc<Allocation>,
    pub(super) offset: u64,
    pub(super) size: u64,
}

impl BufferRef {
    /// A part of the buffer: `size` bytes from `offset` on, cut at the buffer's end.
    ///
    /// # Panics
    /// If it begins beyond the end.
    pub fn part(&self, offset: usize, size: usize) -> Self {
        assert!((offset as u64) < self.size, "a part at {offset} lies beyond the {} bytes", self.size);
        let size = (size as u64).clamp(1, self.size - offset as u64);
        BufferRef { allocation: self.allocation.clone(), offset: self.offset + offset as u64, size }
    }

    /// Bytes.
    pub fn size(&self) -> usize {
        self.size as usize
    }

    /// Whether the device reads it from memory of its own.
    pub fn is_device_local(&self) -> bool {
        self.allocation.local
    }
}

impl From<&HostBuffer> for BufferRef {
    fn from(buffer: &HostBuffer) -> Self {
        BufferRef { allocation: buffer.0.clone(), offset: 0, size: buffer.0.size }
    }
}

impl From<&DeviceBuffer> for BufferRef {
    fn from(buffer: &DeviceBuffer) -> Self {
        BufferRef { allocation: buffer.0.clone(), offset: 0, size: buffer.0.size }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Commands, testing};
    use super::*;

    #[test]
    fn bytes_go_to_the_device_and_back() {
        let Some(context) = testing::context() else { return };
        let values: Vec<u32> = (0..5000u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
        let (from, to) =
            (HostBuffer::new(&context, 20_000).unwrap(), HostBuffer::new(&context, 20_000).unwrap());
        assert_eq!(from.as_ptr() as usize % HOST_ALIGNMENT, 0);
        assert_eq!(from.read::<u32>(0, 5000), vec![0; 5000]);
        from.write(0, &values);
        let own = DeviceBuffer::new(&context, 20_000).unwrap();
        let mut commands = Commands::new(&context).unwrap();
        commands.begin().unwrap();
        commands.copy(&(&from).into(), &(&own).into(), 20_000);
        commands.barrier();
        commands.copy(&BufferRef::from(&own).part(4000, 16_000), &(&to).into(), 16_000);
        commands.end_stage("copies");
        commands.submit().unwrap();
        // What is in use stays, whoever else lets go of it.
        drop((from, own));
        assert_eq!(commands.wait().unwrap()[0].stage, "copies");
        assert_eq!(to.read::<u32>(0, 4000), values[1000..]);
        testing::assert_valid(&context);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let Some(context) = testing::context() else { return };
        let buffer = HostBuffer::new(&context, 64).unwrap();
        assert!(std::panic::catch_unwind(|| buffer.write(61, &[0u32])).is_err());
        assert!(std::panic::catch_unwind(|| buffer.read::<u32>(usize::MAX, 1)).is_err());
        assert!(matches!(DeviceBuffer::new(&context, 1 << 46), Err(Error::Device { .. })));
    }
}
