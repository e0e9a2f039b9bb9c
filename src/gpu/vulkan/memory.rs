//! Buffers.
#![allow(unsafe_code)]

use std::ptr::NonNull;
use std::sync::{Arc, Mutex};

use ash::vk;
use bytemuck::Pod;

use super::context::{Context, lock};
use crate::error::{Error, Result};
use crate::gpu::handle::{self, Handle, VULKAN_TYPE};

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

const ADDRESS: vk::BufferUsageFlags = vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;

/// Who reaches an allocation beside the device.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Reach {
    Device,
    /// The host, from a page boundary on.
    Host,
    /// The host, and other APIs by a handle: the buffer starts where the memory does.
    Exported,
}

impl Allocation {
    /// `wishes` are sets of memory properties, best first; the last is required.
    fn new(context: &Context, size: u64, wishes: &[vk::MemoryPropertyFlags], reach: Reach) -> Result<Self> {
        Self::used_as(context, size, STORAGE, wishes, reach)
    }

    /// Memory of the device that has an address there, where ray queries are switched on.
    pub fn addressed(context: &Context, size: u64, usage: vk::BufferUsageFlags) -> Result<Self> {
        let wishes = [vk::MemoryPropertyFlags::DEVICE_LOCAL, vk::MemoryPropertyFlags::empty()];
        Self::used_as(context, size, usage | ADDRESS, &wishes, Reach::Device)
    }

    fn used_as(
        context: &Context,
        size: u64,
        usage: vk::BufferUsageFlags,
        wishes: &[vk::MemoryPropertyFlags],
        reach: Reach,
    ) -> Result<Self> {
        let device = &context.0.device;
        let size = size.max(16).next_multiple_of(16);
        let exported = reach == Reach::Exported;
        let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(VULKAN_TYPE);
        let mut info = vk::BufferCreateInfo::default().size(size).usage(usage);
        if exported {
            info = info.push_next(&mut external);
        }
        // SAFETY: the size is not zero.
        let buffer = unsafe { device.create_buffer(&info, None) }
            .map_err(|code| context.refused(&format!("a buffer of {size} bytes"), code))?;
        // SAFETY: the buffer was made by this device.
        let needs = unsafe { device.get_buffer_memory_requirements(buffer) };
        // Room to begin at the next page.
        let room = needs.size + if reach == Reach::Host { HOST_ALIGNMENT as u64 } else { 0 };
        let reached = Reached { exported, addressed: usage.contains(ADDRESS) };
        let allocated = allocate_for(context, room, needs.memory_type_bits, wishes, reached);
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
        let offset = match reach {
            Reach::Device => 0,
            Reach::Host => allocation.map(needs.alignment)?,
            Reach::Exported => allocation.map_whole()?,
        };
        // SAFETY: offset and size lie within the memory, aligned as the buffer requires.
        unsafe { device.bind_buffer_memory(buffer, memory, offset) }
            .map_err(|code| context.refused("binding memory", code))?;
        Ok(allocation)
    }

    /// Maps the memory from its start, which is the buffer's.
    fn map_whole(&mut self) -> Result<u64> {
        let device = &self.context.0.device;
        // SAFETY: the memory is visible to the host and not mapped yet.
        let start = unsafe { device.map_memory(self.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty()) }
            .map_err(|code| self.context.refused("mapping memory", code))?;
        self.mapped = NonNull::new(start.cast::<u8>());
        Ok(0)
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
    allocate_for(context, size, types, wishes, Reached::default())
}

/// How memory is reached beside by the device's commands.
#[derive(Clone, Copy, Default)]
struct Reached {
    /// By other APIs.
    exported: bool,
    /// By shaders and builds, by its address.
    addressed: bool,
}

fn allocate_for(
    context: &Context,
    size: u64,
    types: u32,
    wishes: &[vk::MemoryPropertyFlags],
    reached: Reached,
) -> Result<(vk::DeviceMemory, u32)> {
    let memory = &context.0.memory;
    let kinds = &memory.memory_types[..memory.memory_type_count as usize];
    let find = |wish: &vk::MemoryPropertyFlags| {
        (0..kinds.len()).find(|&kind| types & 1 << kind != 0 && kinds[kind].property_flags.contains(*wish))
    };
    let mut code = vk::Result::ERROR_FEATURE_NOT_PRESENT;
    for kind in wishes.iter().filter_map(find) {
        let mut export = vk::ExportMemoryAllocateInfo::default().handle_types(VULKAN_TYPE);
        let mut info = vk::MemoryAllocateInfo::default().allocation_size(size).memory_type_index(kind as u32);
        let mut flags = vk::MemoryAllocateFlagsInfo::default().flags(vk::MemoryAllocateFlags::DEVICE_ADDRESS);
        if reached.exported {
            info = info.push_next(&mut export);
        }
        if reached.addressed {
            info = info.push_next(&mut flags);
        }
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
/// waiting for its commands, OpenCL's by waiting for what its queue does.
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
        let allocation = Allocation::new(context, size as u64, &wishes, Reach::Host)?;
        let buffer = HostBuffer(Arc::new(allocation));
        // SAFETY: the mapping holds `size` bytes, and no one else has it yet.
        unsafe { buffer.as_ptr().write_bytes(0, buffer.len()) };
        Ok(buffer)
    }

    /// A buffer of at least `size` bytes that acceleration structures are built from.
    pub(super) fn build_input(context: &Context, size: usize) -> Result<Self> {
        let base = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        let usage = vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR | ADDRESS;
        let allocation = Allocation::used_as(context, size as u64, usage, &[base], Reach::Host)?;
        Ok(HostBuffer(Arc::new(allocation)))
    }

    /// A buffer that other APIs can use too, on the device's own memory where the host reaches that, and a
    /// handle of its memory. Its address has no alignment of note.
    ///
    /// # Errors
    /// [`Error::Device`] where the device exports no such memory, or has not enough of it.
    pub fn exported(context: &Context, size: usize) -> Result<(Self, Handle)> {
        if !context.report().exports_memory || !exports_storage(context) {
            return Err(context.refused("exporting memory", vk::Result::ERROR_FEATURE_NOT_PRESENT));
        }
        let base = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        let wishes =
            [base | vk::MemoryPropertyFlags::DEVICE_LOCAL, base | vk::MemoryPropertyFlags::HOST_CACHED, base];
        let allocation = Allocation::new(context, size as u64, &wishes, Reach::Exported)?;
        // SAFETY: the memory was allocated for export as this kind of handle, and the extension is enabled
        // wherever it is listed.
        let handle = unsafe { handle::export(&context.0.instance, &context.0.device, allocation.memory) }
            .map_err(|code| context.refused("exporting memory", code))?;
        let buffer = HostBuffer(Arc::new(allocation));
        // SAFETY: the mapping holds the buffer's bytes, and no one else has it yet.
        unsafe { buffer.as_ptr().write_bytes(0, buffer.len()) };
        Ok((buffer, handle))
    }

    /// The same, taken for memory that is not the device's own, whatever it is.
    #[cfg(test)]
    pub fn far(context: &Context, size: usize) -> Result<Self> {
        let HostBuffer(mut allocation) = Self::new(context, size)?;
        Arc::get_mut(&mut allocation).expect("nobody else has it yet").local = false;
        Ok(HostBuffer(allocation))
    }

    /// Bytes: at least those asked for.
    pub fn len(&self) -> usize {
        self.0.size as usize
    }

    /// Never: a buffer has at least 16 bytes.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Its address: a multiple of `HOST_ALIGNMENT`, valid while any clone lives.
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

    /// Copies the values at these places of the buffer.
    ///
    /// # Panics
    /// If one of them lies beyond the buffer.
    pub fn read_at<T: Pod>(&self, places: impl Iterator<Item = usize>) -> Vec<T> {
        let count = self.len() / size_of::<T>();
        let start = self.as_ptr().cast::<T>();
        let _copying = lock(&self.0.copying);
        let read = |place: usize| {
            assert!(place < count, "place {place} is beyond {count} values");
            // SAFETY: the place was just found to lie in the mapping; any bytes are valid ones.
            unsafe { start.add(place).read_unaligned() }
        };
        places.map(read).collect()
    }
}

/// Whether storage buffers can be exported as opaque handles, without an allocation of a kind of its own.
fn exports_storage(context: &Context) -> bool {
    let info = vk::PhysicalDeviceExternalBufferInfo::default().usage(STORAGE).handle_type(VULKAN_TYPE);
    let mut found = vk::ExternalBufferProperties::default();
    // SAFETY: the physical device belongs to the instance, which offers Vulkan 1.1.
    unsafe {
        context.0.instance.get_physical_device_external_buffer_properties(
            context.0.physical_device,
            &info,
            &mut found,
        );
    }
    let features = found.external_memory_properties.external_memory_features;
    features.contains(vk::ExternalMemoryFeatureFlags::EXPORTABLE)
        && !features.contains(vk::ExternalMemoryFeatureFlags::DEDICATED_ONLY)
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
        Ok(DeviceBuffer(Arc::new(Allocation::new(context, size as u64, &wishes, Reach::Device)?)))
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
mod tests;
