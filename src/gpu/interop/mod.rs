//! Memory that OpenCL writes and Vulkan reads: the samples on their way from one to the other.
//!
//! Where a probe at start proves that both see the same bytes, nothing is copied: a mapped Vulkan allocation
//! is given to OpenCL as its own (`CL_MEM_USE_HOST_PTR`) by devices that use the host's memory, and imported
//! from an opaque file descriptor where both APIs list that for one and the same device. Elsewhere the
//! results are read back into that allocation, which is affordable since only samples cross, never pictures, and for
//! which the host does not wait.
//!
//! Two records of `src/layout/records.rs` cross:
//!
//! - `SampleRecord`, 48 bytes for each sample: diffuse and specular light with the surface's own colours
//!   divided out, depth, normal, and where that matters what reflection was expected and where light comes
//!   from. With k-NN: the radiance alone.
//! - `VisibilityRecord`, 28 bytes for each pixel, guided only: normal, depth, base colour with metalness and
//!   roughness, emitted light, the normal with its map, the reflection that is expected.
//!
//! and, where the same processor traces and presents, the neighbours of new patterns
//! (`src/trace/pattern_maker/neighbours.rs`). At 1280x800 with 55,000 samples the records are 2.6 MB and 28.7 MB. No picture crosses: reconstruction runs where
//! it is shown, and writes the target itself. [`probe`] decides at start, by writing a pattern with one and
//! reading it with the other, whether memory is shared. Devices that say they use the host's memory are given
//! the mapping in place. Others import it by an opaque handle (`HostBuffer::exported`, `Buffer::from_handle`;
//! `src/gpu/handle.rs` has what each system calls it), where OpenCL lists cl_khr_external_memory_opaque_fd or
//! on Windows cl_khr_external_memory_win32, Vulkan exports such memory, and both mean the same device by its
//! UUID; kernels then run between an acquire and a release. No driver that the project has met lists that:
//! what is tested is the choice, on Unix Vulkan's side, and that OpenCL's refuses; Windows' handles are
//! compiled and no more. Where the probe fails, samples are copied, and `foveate devices` says why.
#![allow(unsafe_code)]

use bytemuck::Pod;

use super::handle::OPENCL_EXTENSION;
use super::opencl::{Arg, Buffer, Device, Program, Transfer};
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

/// How OpenCL gets at memory that Vulkan has allocated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    /// It uses the mapping in place.
    HostMemory,
    /// It imports a handle of it.
    Handle,
}

/// What both sides say of themselves.
struct Facts {
    uses_host_memory: bool,
    imports_memory: bool,
    exports_memory: bool,
    is_one_device: bool,
}

impl Facts {
    fn of(device: &Device, context: &Context) -> Facts {
        let (info, report) = (device.info(), context.report());
        let uuid: String = report.uuid.iter().map(|byte| format!("{byte:02x}")).collect();
        Facts {
            uses_host_memory: info.host_unified,
            imports_memory: info.external_memory.iter().any(|name| name == OPENCL_EXTENSION),
            exports_memory: report.exports_memory,
            is_one_device: info.uuid.as_ref() == Some(&uuid),
        }
    }

    /// The way to try, or why there is none. Only a device that says it shares the host's memory is asked to use
    /// that in place: elsewhere a driver may hold a copy of its own behind the pointer, and be right or wrong from
    /// one launch to the next.
    fn way(&self) -> std::result::Result<Way, &'static str> {
        match self {
            Facts { uses_host_memory: true, .. } => Ok(Way::HostMemory),
            Facts { imports_memory: false, .. } => Err("OpenCL's driver imports no memory by opaque handles"),
            Facts { exports_memory: false, .. } => Err("Vulkan's driver exports no memory by opaque handles"),
            Facts { is_one_device: false, .. } => Err("OpenCL and Vulkan use different devices"),
            _ => Ok(Way::Handle),
        }
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
        let size = len * size_of::<T>();
        let way = direct.and_then(|device| Some((device, Facts::of(device, context).way().ok()?)));
        let (host, opencl) = match way {
            None => (HostBuffer::new(context, size)?, None),
            Some((device, Way::HostMemory)) => {
                let host = HostBuffer::new(context, size)?;
                // SAFETY: the mapping is at least that long and lives as long as `host`, which is dropped after
                // the buffer; the host reads it only after the device is done with it.
                let opencl = unsafe { Buffer::from_host_memory(device, host.as_ptr().cast(), len) }?;
                (host, Some(opencl))
            }
            Some((device, Way::Handle)) => {
                let (host, handle) = HostBuffer::exported(context, size)?;
                // SAFETY: the memory is at least that long; Vulkan and the host read it only after the device
                // is done with it and has released it.
                let opencl = unsafe { Buffer::from_handle(device, handle, len) }?;
                (host, Some(opencl))
            }
        };
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

    /// Starts copying `count` elements of a device's own memory to the same places here, as the queue comes to it. Who
    /// reads them waits for that before.
    ///
    /// # Errors
    /// [`crate::Error::Device`] with the driver's code.
    ///
    /// # Panics
    /// If they do not fit.
    pub fn start_copy(&self, from: &Buffer<T>, first: usize, count: usize) -> Result<Transfer<BufferRef>> {
        let fits = first.checked_add(count).is_some_and(|end| end <= self.len);
        assert!(fits, "{count} elements at {first} do not fit {}", self.len);
        // SAFETY: the range lies in the mapping, which lives as long as any reference to the buffer; the host and Vulkan
        // read it when the transfer is done. A device that is given up as late may still write the values that others have
        // written in its place; the next frame has another target then (`Scheduler::losses`).
        unsafe {
            let to = self.host.as_ptr().cast::<T>().add(first);
            from.start_read_to(first, count, to, self.vulkan())
        }
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

    /// The elements at these places, as they were delivered.
    ///
    /// # Panics
    /// If one of them lies beyond the memory.
    pub fn at(&self, places: impl Iterator<Item = usize>) -> Vec<T> {
        self.host.read_at(places)
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
    explain(device, context).0
}

/// [`probe`], and why, in a few words.
pub fn explain(device: &Device, context: &Context) -> (Sharing, String) {
    let way = match Facts::of(device, context).way() {
        Ok(way) => way,
        Err(why) => return (Sharing::Staged, why.to_string()),
    };
    let what = match way {
        Way::HostMemory => "in the host's memory",
        Way::Handle => "in memory that Vulkan exports and OpenCL imports",
    };
    for seed in 1..=2 {
        match sees_the_same(device, context, seed) {
            Ok(true) => {}
            Ok(false) => {
                return (Sharing::Staged, format!("{what} one reads other bytes than the other wrote"));
            }
            Err(problem) => return (Sharing::Staged, format!("{what} it fails: {problem}")),
        }
    }
    (Sharing::ZeroCopy, what.to_string())
}

/// Whether Vulkan reads what OpenCL wrote. An error's text is all that is left of an error here, since
/// it only means that memory is not shared.
fn sees_the_same(device: &Device, context: &Context, seed: u32) -> std::result::Result<bool, String> {
    let run = || -> Result<bool> {
        let program = Program::build(device, "probe", PROBE_SOURCE, "-cl-std=CL1.2")?;
        let kernel = program.kernel("probe")?;
        let shared: Shared<u32> = Shared::new(Some(device), context, PROBE)?;
        let Some(buffer) = shared.opencl() else { return Ok(false) };
        buffer.acquire()?;
        kernel.launch(&[Arg::buffer(buffer), Arg::U32(PROBE as u32), Arg::U32(seed)], PROBE, 64)?;
        buffer.release()?;
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

#[cfg(test)]
mod tests {
    use super::super::{opencl, vulkan};
    use super::*;

    #[test]
    fn extensions_and_identity_decide_what_is_tried() {
        let all = || Facts {
            uses_host_memory: false,
            imports_memory: true,
            exports_memory: true,
            is_one_device: true,
        };
        assert_eq!(all().way(), Ok(Way::Handle));
        assert_eq!(Facts { uses_host_memory: true, ..all() }.way(), Ok(Way::HostMemory));
        for (facts, why) in [
            (Facts { imports_memory: false, ..all() }, "imports"),
            (Facts { exports_memory: false, ..all() }, "exports"),
            (Facts { is_one_device: false, ..all() }, "different"),
        ] {
            assert!(facts.way().unwrap_err().contains(why));
        }
    }

    /// Drivers for processors import nothing: they refuse what Vulkan exports, and close it.
    #[test]
    fn a_driver_that_imports_nothing_refuses_what_vulkan_exports() {
        let Some(context) = vulkan::testing::context() else { return };
        let infos = opencl::device::list();
        let imports =
            |info: &&opencl::DeviceInfo| info.external_memory.iter().any(|name| name == OPENCL_EXTENSION);
        let Some(info) = infos.iter().find(|info| info.unusable.is_none() && !imports(info)) else {
            println!("not run: there is no OpenCL device that imports nothing");
            return;
        };
        let Ok((_memory, handle)) = HostBuffer::exported(&context, 4096) else {
            println!("not run: {} exports no memory", context.report().name);
            return;
        };
        let device = Device::open(info).unwrap();
        // SAFETY: the memory holds 1024 numbers, and nobody else uses it.
        let refused = unsafe { Buffer::<u32>::from_handle(&device, handle, 1024) };
        assert!(refused.unwrap_err().to_string().contains("opaque handles"));
        let (sharing, why) = explain(&device, &context);
        println!("{sharing}: {why}");
        assert!(!why.is_empty());
        vulkan::testing::assert_valid(&context);
    }
}
