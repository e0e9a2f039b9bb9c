//! The OpenCL devices of this machine.
#![allow(unsafe_code)]

use std::sync::{Arc, Mutex};

use opencl3::command_queue::{CL_QUEUE_PROFILING_ENABLE, CommandQueue};
use opencl3::context::{Context, context::CL_CONTEXT_PLATFORM};
use opencl3::device;
use opencl3::device::{
    CL_DEVICE_TYPE_ALL, CL_DEVICE_TYPE_CPU, CL_DEVICE_TYPE_GPU, CL_DEVICE_UUID_KHR, SubDevice,
};
use opencl3::error_codes::ClError;
use opencl3::platform::{Platform, get_platforms};
use opencl3::types::{cl_command_queue_properties, cl_device_id, cl_platform_id};

use super::code;
use super::owned::Owned;
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
    /// Its compiler takes a limit of registers (cl_nv_compiler_options).
    pub limits_registers: bool,
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
    device: device::Device,
    #[serde(skip)]
    from: Platform,
    #[serde(skip)]
    #[expect(dead_code, reason = "held until the last copy goes: it keeps a part of a divided device")]
    part: Option<Arc<Owned<SubDevice>>>,
}

impl DeviceInfo {
    fn kept_by(self, part: SubDevice) -> DeviceInfo {
        DeviceInfo { part: Some(Arc::new(Owned::new(part))), ..self }
    }

    /// Whether both are the same device of the same driver.
    pub fn is(&self, other: &DeviceInfo) -> bool {
        self.device.id() == other.device.id()
    }
}

/// Lists all devices of all platforms, usable or not. No loader or no platform: an empty list.
pub fn list() -> Vec<DeviceInfo> {
    // Loaders and drivers start at the first question, and not all of them stand two at once.
    static ASKING: Mutex<()> = Mutex::new(());
    let _asking = ASKING.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let Ok(platforms) = get_platforms() else { return Vec::new() };
    let mut devices = Vec::new();
    for platform in platforms {
        // A platform without devices (Mesa's, often) answers with an error: skip it.
        let Ok(ids) = platform.get_devices(CL_DEVICE_TYPE_ALL) else {
            continue;
        };
        devices.extend(ids.into_iter().map(|id| describe(platform, device::Device::new(id))));
    }
    devices.iter_mut().enumerate().for_each(|(place, info)| info.place = place);
    devices
}

fn describe(from: Platform, device: device::Device) -> DeviceInfo {
    let extensions = device.extensions().unwrap_or_default();
    let has = |name: &str| extensions.split_whitespace().any(|e| e == name);
    let kind = match device.dev_type().unwrap_or(0) {
        t if t & CL_DEVICE_TYPE_GPU != 0 => "gpu",
        t if t & CL_DEVICE_TYPE_CPU != 0 => "cpu",
        _ => "accelerator",
    };
    DeviceInfo {
        platform: from.name().unwrap_or_default(),
        name: device.name().unwrap_or_default().trim().to_string(),
        driver: device.driver_version().unwrap_or_default().trim().to_string(),
        kind,
        compute_units: device.max_compute_units().unwrap_or(0),
        memory: device.global_mem_size().unwrap_or(0),
        largest_buffer: device.max_mem_alloc_size().unwrap_or(0),
        limits_registers: has("cl_nv_compiler_options"),
        uuid: if has("cl_khr_device_uuid") { uuid(device) } else { None },
        host_unified: device.host_unified_memory().unwrap_or(false),
        external_memory: extensions
            .split_whitespace()
            .filter(|e| e.starts_with("cl_khr_external_memory"))
            .map(str::to_string)
            .collect(),
        unusable: unusable(device).map(str::to_string),
        place: 0,
        device,
        from,
        part: None,
    }
}

/// What the device says that keeps it from being used.
fn unusable(device: device::Device) -> Option<&'static str> {
    if !device.available().unwrap_or(false) {
        Some("the driver says that it is not available")
    } else if !device.compiler_available().unwrap_or(false) {
        Some("its driver has no compiler")
    } else if !device.endian_little().unwrap_or(false) {
        Some("it is big-endian")
    } else {
        None
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
    let parts = info.device.create_sub_devices(&properties).map_err(|error| {
        refused(format!("its driver does not divide it: {}; leave devices.subdivide empty", code(error)))
    })?;
    let part = |(index, (part, &count)): (usize, (SubDevice, &u32))| DeviceInfo {
        name: format!("{} (part {} of {})", info.name, index + 1, units.len()),
        compute_units: count,
        uuid: None,
        place: info.place,
        ..describe(info.from, device::Device::new(part.id())).kept_by(part)
    };
    Ok(parts.into_iter().zip(units).enumerate().map(part).collect())
}

fn uuid(device: device::Device) -> Option<String> {
    let bytes = device.get_data(CL_DEVICE_UUID_KHR).ok()?;
    (bytes.len() == 16).then(|| bytes.iter().map(|b| format!("{b:02x}")).collect())
}

/// An open device: a context and an in-order queue. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Device(Arc<Open>);

/// The queue goes before its context, and that before a part of a divided device.
#[derive(Debug)]
struct Open {
    queue: Owned<CommandQueue>,
    context: Owned<Context>,
    info: DeviceInfo,
    properties_of_queue: cl_command_queue_properties,
}

impl Device {
    /// Opens a device that times what it does: reports tell each stage's time, and devices that share views are balanced
    /// by theirs.
    ///
    /// # Errors
    /// [`Error::Device`] where it is unusable or the driver refuses a context or queue.
    pub fn open(info: &DeviceInfo) -> Result<Device> {
        Self::open_with(info, CL_QUEUE_PROFILING_ENABLE)
    }

    /// The same, of a device that times nothing: drivers have less to do for each launch, and times are 0. For one that traces
    /// alone: what devices share is balanced by their times.
    ///
    /// # Errors
    /// As [`Device::open`].
    pub fn open_untimed(info: &DeviceInfo) -> Result<Device> {
        Self::open_with(info, 0)
    }

    fn open_with(info: &DeviceInfo, properties_of_queue: cl_command_queue_properties) -> Result<Device> {
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
        let properties = [CL_CONTEXT_PLATFORM, info.from.id() as isize, 0];
        let context = Context::from_devices(&[info.device.id()], &properties, None, std::ptr::null_mut())
            .map_err(|e| refused("a context", e))?;
        let context = Owned::new(context);
        // OpenCL 1.2's call, since the newer one does not exist on 1.2 drivers.
        // SAFETY: the context was made for this device.
        let queue = unsafe { CommandQueue::create(&context, info.device.id(), properties_of_queue) }
            .map_err(|e| refused("a queue", e))?;
        let open = Open { queue: Owned::new(queue), context, info: info.clone(), properties_of_queue };
        Ok(Device(Arc::new(open)))
    }

    /// Opens the same device anew, as after a failure.
    ///
    /// # Errors
    /// As [`Device::open`].
    pub fn reopen(&self) -> Result<Device> {
        Self::open_with(self.info(), self.0.properties_of_queue)
    }

    /// Whether it times what it does.
    pub fn is_timed(&self) -> bool {
        self.0.properties_of_queue & CL_QUEUE_PROFILING_ENABLE != 0
    }

    /// What is known of it.
    pub fn info(&self) -> &DeviceInfo {
        &self.0.info
    }

    /// Whether the driver still says that the device is there.
    pub fn is_available(&self) -> bool {
        self.0.info.device.available().unwrap_or(false)
    }

    /// Waits until everything in the queue is done.
    ///
    /// # Errors
    /// [`Error::Device`] with the driver's code: the device is lost or out of memory.
    pub fn finish(&self) -> Result<()> {
        self.queue().finish().map_err(|e| self.failed("could not finish its work", e))
    }

    /// Starts what is in the queue without waiting.
    pub fn flush(&self) -> Result<()> {
        self.queue().flush().map_err(|e| self.failed("could not start its work", e))
    }

    pub(super) fn id(&self) -> cl_device_id {
        self.0.info.device.id()
    }

    pub(super) fn context(&self) -> &Context {
        &self.0.context
    }

    pub(super) fn platform(&self) -> cl_platform_id {
        self.0.info.from.id()
    }

    pub(super) fn queue(&self) -> &CommandQueue {
        &self.0.queue
    }

    /// An [`Error::Device`] that tells what failed.
    pub(super) fn failed(&self, what: &str, error: ClError) -> Error {
        Error::Device {
            device: self.0.info.name.clone(),
            problem: format!(
                "it {what}: {}; run `foveate devices` and choose others with --devices",
                code(error)
            ),
        }
    }
}
