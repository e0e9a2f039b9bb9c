//! Memory that OpenCL writes and Vulkan reads: the samples on their way from one to the other.
//!
//! Where a probe at start proves that both see the same bytes, nothing is copied: a mapped Vulkan
//! allocation is given to OpenCL as its own (`CL_MEM_USE_HOST_PTR`). Elsewhere the results are read
//! back into that allocation, which is affordable since only samples cross, never pictures.
#![allow(unsafe_code)]

use bytemuck::Pod;

use super::opencl::{Arg, Buffer, Device, Program};
use super::vulkan::{BufferRef, Commands, Context, HostBuffer};
use crate::error::Result;

/// How samples get from OpenCL to Vulkan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sharing {
    /// Both use the same memory.
    ZeroCopy,
    /// Results are copied.
    Staged,
}

impl std::fmt::Display for Sharing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Sharing::ZeroCopy => "zero-copy",
            Sharing::Staged => "staged",
        })
    }
}

/// `len` elements that OpenCL devices deliver and Vulkan reads.
pub struct Shared<T> {
    // Declared before `host`: OpenCL lets go of the memory before it is freed.
    opencl: Option<Buffer<T>>,
    host: HostBuffer,
    len: usize,
}

impl<T: Pod> Shared<T> {
    /// Allocates memory that Vulkan reads; `direct` is the OpenCL device that writes it in place, where there
    /// is one ([`probe`] tells).
    ///
    /// # Errors
    /// [`crate::Error::Device`] where either device has no room.
    pub fn new(direct: Option<&Device>, context: &Context, len: usize) -> Result<Self> {
        let len = len.max(1);
        let host = HostBuffer::new(context, len * size_of::<T>())?;
        let opencl = direct
            // SAFETY: the mapping is at least that long and lives as long as `host`, which is dropped after
            // the buffer; the host reads it only after the device has finished.
            .map(|device| unsafe { Buffer::from_host_memory(device, host.as_ptr().cast(), len) })
            .transpose()?;
        Ok(Shared { opencl, host, len })
    }

    /// What the device that writes in place writes to.
    pub fn opencl(&self) -> Option<&Buffer<T>> {
        self.opencl.as_ref()
    }

    /// What Vulkan reads from.
    pub fn vulkan(&self) -> BufferRef {
        BufferRef::from(&self.host)
    }

    /// Elements.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Copies what a device without access has delivered to its place, from element `first` on.
    ///
    /// # Panics
    /// If it does not fit.
    pub fn write(&self, first: usize, values: &[T]) {
        self.host.write(first * size_of::<T>(), values);
    }

    /// Every `step`-th of the first `count` elements, as they were delivered.
    pub fn sparse(&self, count: usize, step: usize) -> Vec<T> {
        self.host.read_sparse(count, step)
    }
}

/// Elements of the probe's pattern: more than a page, and no round number.
const PROBE: usize = 5003;

const PROBE_SOURCE: &str = "
__kernel void probe(__global uint *out, uint count, uint seed)
{
    uint i = (uint)get_global_id(0);
    if (i < count)
        out[i] = (i ^ seed) * 2654435761u + seed;
}";

/// Finds out whether both devices can use one memory, by writing a pattern with one and reading it
/// with the other, twice. Anything but the right bytes means [`Sharing::Staged`].
pub fn probe(device: &Device, context: &Context) -> Sharing {
    // Only a device that says it shares the host's memory is asked: elsewhere a driver may hold a
    // copy of its own behind the pointer, and be right or wrong from one launch to the next.
    let proven =
        device.info().host_unified && (0..2).all(|seed| sees_the_same(device, context, seed + 1) == Ok(true));
    if proven { Sharing::ZeroCopy } else { Sharing::Staged }
}

/// Whether Vulkan reads what OpenCL wrote. An error's text is all that is left of an error here, since
/// it only means that memory is not shared.
fn sees_the_same(device: &Device, context: &Context, seed: u32) -> std::result::Result<bool, String> {
    let run = || -> Result<bool> {
        let program = Program::build(device, "probe", PROBE_SOURCE, "-cl-std=CL1.2")?;
        let kernel = program.kernel("probe")?;
        let shared: Shared<u32> = Shared::new(Some(device), context, PROBE)?;
        kernel.launch(&[Arg::optional(&shared.opencl), Arg::U32(PROBE as u32), Arg::U32(seed)], PROBE, 64)?;
        device.finish()?;
        let copy = HostBuffer::new(context, PROBE * 4)?;
        let mut commands = Commands::new(context)?;
        commands.begin()?;
        commands.copy(&shared.vulkan(), &BufferRef::from(&copy), PROBE * 4);
        commands.submit()?;
        commands.wait()?;
        let expected = |i: usize| ((i as u32) ^ seed).wrapping_mul(2_654_435_761).wrapping_add(seed);
        Ok(copy.read::<u32>(0, PROBE).iter().enumerate().all(|(i, &value)| value == expected(i)))
    };
    run().map_err(|e| e.to_string())
}
