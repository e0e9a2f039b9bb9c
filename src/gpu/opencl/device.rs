//! The OpenCL devices of this machine.
#![allow(unsafe_code)]

use std::sync::{Arc, Mutex};

use cl3::types::{cl_command_queue, cl_context, cl_device_id, cl_platform_id};

use super::code;
use crate::error::{Error, Result};

/// What is known of a device before it is opened.
#[derive(Clone, Debug, serde::Serialize)]
pub struct DeviceInfo {
    /// The platform's name, such as `Portable Computing Language`.
    pub platform: String,
    /// The device's name.
    pub name: String,
    /// The driver's version.
    pub driver: String,
    /// `cpu`, `gpu` or `accelerator`.
    pub kind: &'static str,
    /// Compute units.
    pub compute_units: u32,
    /// Global memory in bytes.
    pub memory: u64,
    /// The largest single buffer in bytes.
    pub largest_buffer: u64,
    /// Double precision is there (cl_khr_fp64).
    pub fp64: bool,
    /// The device's UUID in hexadecimal, where the driver tells it (cl_khr_device_uuid).
    pub uuid: Option<String>,
    /// It shares memory with the host.
    pub host_unified: bool,
    /// The external memory handles that it can import (cl_khr_external_memory*).
    pub external_memory: Vec<String>,
    /// Why it cannot be used; `None` where it can.
    pub unusable: Option<String>,
    /// Its place in [`list`]; a part's is that of the whole.
    #[serde(skip)]
    pub place: usize,
    #[serde(skip)]
    id: Handle,
    #[serde(skip)]
    platform_id: Handle,
}

impl DeviceInfo {
    /// Whether both are the same device of the same driver.
    pub fn is(&self, other: &DeviceInfo) -> bool {
        self.id.0 == other.id.0
    }
}

/// An OpenCL object's address, which is only ever handed back to OpenCL.
#[derive(Clone, Copy, Debug)]
struct Handle(*mut std::ffi::c_void);

// SAFETY: OpenCL's handles may be used from any thread (OpenCL 1.2 specification, appendix A.2);
// only clSetKernelArg on one kernel is not thread-safe, and Kernel is not Sync.
unsafe impl Send for Handle {}
// SAFETY: see above.
unsafe impl Sync for Handle {}

/// Lists all devices of all platforms, usable or not. No loader or no platform: an empty list.
pub fn list() -> Vec<DeviceInfo> {
    // Loaders and drivers start at the first question, and not all of them stand two at once.
    static ASKING: Mutex<()> = Mutex::new(());
    let _asking = ASKING.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let Ok(platforms) = cl3::platform::get_platform_ids() else { return Vec::new() };
    let mut devices = Vec::new();
    for platform in platforms {
        // A platform without devices (Mesa's, often) answers with an error: skip it.
        let Ok(ids) = cl3::device::get_device_ids(platform, cl3::device::CL_DEVICE_TYPE_ALL) else {
            continue;
        };
        devices.extend(ids.into_iter().map(|id| describe(platform, id)));
    }
    devices.iter_mut().enumerate().for_each(|(place, info)| info.place = place);
    devices
}

fn describe(platform: cl_platform_id, id: cl_device_id) -> DeviceInfo {
    use cl3::device as d;
    let text = |what| d::get_device_info(id, what).map(String::from).unwrap_or_default().trim().to_string();
    let number = |what| d::get_device_info(id, what).map(u64::from).unwrap_or(0);
    let small = |what| d::get_device_info(id, what).map(u32::from).unwrap_or(0);
    let extensions = text(d::CL_DEVICE_EXTENSIONS);
    let has = |name: &str| extensions.split_whitespace().any(|e| e == name);
    let kind = match number(d::CL_DEVICE_TYPE) {
        t if t & d::CL_DEVICE_TYPE_GPU != 0 => "gpu",
        t if t & d::CL_DEVICE_TYPE_CPU != 0 => "cpu",
        _ => "accelerator",
    };
    let mut unusable = None;
    if small(d::CL_DEVICE_AVAILABLE) == 0 {
        unusable = Some("the driver says that it is not available".to_string());
    } else if small(d::CL_DEVICE_COMPILER_AVAILABLE) == 0 {
        unusable = Some("its driver has no compiler".to_string());
    } else if small(d::CL_DEVICE_ENDIAN_LITTLE) == 0 {
        unusable = Some("it is big-endian".to_string());
    }
    DeviceInfo {
        platform: cl3::platform::get_platform_info(platform, cl3::platform::CL_PLATFORM_NAME)
            .map(String::from)
            .unwrap_or_default(),
        name: text(d::CL_DEVICE_NAME),
        driver: text(d::CL_DRIVER_VERSION),
        kind,
        compute_units: small(d::CL_DEVICE_MAX_COMPUTE_UNITS),
        memory: number(d::CL_DEVICE_GLOBAL_MEM_SIZE),
        largest_buffer: number(d::CL_DEVICE_MAX_MEM_ALLOC_SIZE),
        fp64: has("cl_khr_fp64"),
        uuid: if has("cl_khr_device_uuid") { uuid(id) } else { None },
        host_unified: small(d::CL_DEVICE_HOST_UNIFIED_MEMORY) != 0,
        external_memory: extensions
            .split_whitespace()
            .filter(|e| e.starts_with("cl_khr_external_memory"))
            .map(str::to_string)
            .collect(),
        unusable,
        place: 0,
        id: Handle(id),
        platform_id: Handle(platform),
    }
}

/// Divides a device into sub-devices with so many compute units each; what is left over stays idle.
///
/// # Errors
/// [`Error::Device`] where the driver does not divide it so.
pub fn subdivide(info: &DeviceInfo, units: &[u32]) -> Result<Vec<DeviceInfo>> {
    let refused = |problem: String| Error::Device { device: info.name.clone(), problem };
    let wanted: u32 = units.iter().sum();
    if units.is_empty() || units.contains(&0) || wanted > info.compute_units {
        return Err(refused(format!(
            "it has {} compute units and cannot be divided into {units:?}; give as many in devices.subdivide",
            info.compute_units
        )));
    }
    const BY_COUNTS: isize = 0x1087;
    let mut properties = vec![BY_COUNTS];
    properties.extend(units.iter().map(|&count| count as isize));
    properties.extend([0, 0]);
    let ids = cl3::device::create_sub_devices(info.id.0, &properties).map_err(|error| {
        refused(format!("its driver does not divide it: {}; leave devices.subdivide empty", code(error)))
    })?;
    let mut parts: Vec<DeviceInfo> = ids.into_iter().map(|id| describe(info.platform_id.0, id)).collect();
    for (index, (part, &count)) in parts.iter_mut().zip(units).enumerate() {
        part.name = format!("{} (part {} of {})", info.name, index + 1, units.len());
        part.compute_units = count;
        part.uuid = None;
        part.place = info.place;
    }
    Ok(parts)
}

fn uuid(id: cl_device_id) -> Option<String> {
    const CL_DEVICE_UUID_KHR: u32 = 0x106A;
    let bytes = cl3::device::get_device_data(id, CL_DEVICE_UUID_KHR).ok()?;
    (bytes.len() == 16).then(|| bytes.iter().map(|b| format!("{b:02x}")).collect())
}

/// An open device: a context and an in-order queue with profiling. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Device(Arc<Open>);

#[derive(Debug)]
struct Open {
    info: DeviceInfo,
    context: Handle,
    queue: Handle,
}

impl Device {
    /// Opens a device.
    ///
    /// # Errors
    /// [`Error::Device`] where it is unusable or the driver refuses a context or queue.
    pub fn open(info: &DeviceInfo) -> Result<Device> {
        let refused = |what: &str, error| Error::Device {
            device: info.name.clone(),
            problem: format!("the driver refuses {what}: {}; leave it out with --devices", code(error)),
        };
        if let Some(why) = &info.unusable {
            return Err(Error::Device {
                device: info.name.clone(),
                problem: format!("it cannot be used: {why}"),
            });
        }
        const CL_CONTEXT_PLATFORM: isize = 0x1084;
        let properties = [CL_CONTEXT_PLATFORM, info.platform_id.0 as isize, 0];
        let context =
            cl3::context::create_context(&[info.id.0], properties.as_ptr(), None, std::ptr::null_mut())
                .map_err(|e| refused("a context", e))?;
        // SAFETY: context and device are valid and belong together. OpenCL 1.2's call is used, since
        // the newer one does not exist on 1.2 drivers.
        #[allow(deprecated)]
        let queue = unsafe {
            cl3::command_queue::create_command_queue(
                context,
                info.id.0,
                cl3::command_queue::CL_QUEUE_PROFILING_ENABLE,
            )
        };
        let queue = queue.map_err(|e| {
            // SAFETY: the context was just created and nothing else refers to it.
            let _ = unsafe { cl3::context::release_context(context) };
            refused("a queue", e)
        })?;
        Ok(Device(Arc::new(Open { info: info.clone(), context: Handle(context), queue: Handle(queue) })))
    }

    /// What is known of it.
    pub fn info(&self) -> &DeviceInfo {
        &self.0.info
    }

    /// Whether the driver still says that the device is there.
    pub fn is_available(&self) -> bool {
        cl3::device::get_device_info(self.id(), cl3::device::CL_DEVICE_AVAILABLE).map(u32::from) == Ok(1)
    }

    /// Waits until everything in the queue is done.
    ///
    /// # Errors
    /// [`Error::Device`] with the driver's code: the device is lost or out of memory.
    pub fn finish(&self) -> Result<()> {
        cl3::command_queue::finish(self.queue()).map_err(|e| self.failed("could not finish its work", e))
    }

    /// Starts what is in the queue without waiting.
    pub fn flush(&self) -> Result<()> {
        cl3::command_queue::flush(self.queue()).map_err(|e| self.failed("could not start its work", e))
    }

    pub(super) fn id(&self) -> cl_device_id {
        self.0.info.id.0
    }

    pub(super) fn context(&self) -> cl_context {
        self.0.context.0
    }

    pub(super) fn platform(&self) -> cl_platform_id {
        self.0.info.platform_id.0
    }

    pub(super) fn queue(&self) -> cl_command_queue {
        self.0.queue.0
    }

    /// An [`Error::Device`] that tells what failed.
    pub(super) fn failed(&self, what: &str, error: i32) -> Error {
        Error::Device {
            device: self.0.info.name.clone(),
            problem: format!(
                "it {what}: {}; run `foveate devices` and choose others with --devices",
                code(error)
            ),
        }
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        // SAFETY: both were created by `Device::open` and are released once. A failed release (device
        // lost) leaves nothing that could be done, so its code is ignored.
        unsafe {
            let _ = cl3::command_queue::release_command_queue(self.queue.0);
            let _ = cl3::context::release_context(self.context.0);
        }
    }
}
