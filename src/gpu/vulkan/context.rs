//! Instance, device and queue.
#![allow(unsafe_code)]

mod messenger;
mod opening;
mod physical;
mod ray_queries;

use std::ffi::{CStr, CString};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ash::vk;

use crate::error::{Error, Result};
use messenger::Messenger;
use opening::{create_instance, load, no_device, open, require_validation_layer};
pub use physical::{DeviceKind, DeviceReport, devices, queue_family, sharing_extensions};
use physical::{report, select};
pub(super) use ray_queries::RayFunctions;
pub use ray_queries::RayQueryFeatures;

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// How to open a context of one's own.
#[derive(Clone, Debug, Default)]
pub struct ContextOptions {
    /// Take the first device whose name contains this, ignoring case; otherwise the preferred kind.
    pub device: Option<String>,
    /// Take only a device with this [`DeviceReport::uuid`].
    pub uuid: Option<[u8; 16]>,
    /// Load the validation layer and keep its messages: see [`Context::validation_messages`].
    pub validation: bool,
    /// Instance extensions to require, for a window's surface.
    pub instance_extensions: Vec<CString>,
    /// Device extensions to require, for a swapchain.
    pub device_extensions: Vec<CString>,
    /// Switch ray queries on, where the device has them: see [`Context::traces_rays`].
    pub ray_queries: bool,
}

/// Handles made elsewhere, as XR_KHR_vulkan_enable2 does.
pub struct RawContext {
    /// The loader that the handles come from.
    pub entry: ash::Entry,
    /// The instance, made for Vulkan 1.1 or later.
    pub instance: ash::Instance,
    /// The device that the runtime asks for.
    pub physical_device: vk::PhysicalDevice,
    /// The logical device, with one queue of `queue_family`.
    pub device: ash::Device,
    /// A family with graphics and compute; its queue 0 is used.
    pub queue_family: u32,
    /// Whether the context destroys device and instance at its end.
    pub owned: bool,
    /// Whether the device was made with [`RayQueryFeatures`].
    pub ray_queries: bool,
}

/// A device with one queue. Clones share it; it ends with the last thing made from it.
#[derive(Clone)]
pub struct Context(pub(super) Arc<Inner>);

pub(super) struct Inner {
    // The loader stays mapped for as long as its functions are used.
    #[cfg_attr(not(feature = "window"), allow(dead_code))]
    pub entry: ash::Entry,
    pub instance: ash::Instance,
    pub physical_device: vk::PhysicalDevice,
    pub device: ash::Device,
    pub queue_family: u32,
    pub queue: Mutex<vk::Queue>,
    pub memory: vk::PhysicalDeviceMemoryProperties,
    pub limits: vk::PhysicalDeviceLimits,
    pub timestamps: bool,
    pub report: DeviceReport,
    /// Exists where ray queries are switched on.
    pub rays: Option<RayFunctions>,
    messenger: Option<Messenger>,
    owned: bool,
}

impl std::fmt::Debug for Context {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Context").field(&self.0.report).finish()
    }
}

impl Context {
    /// Opens the best device: see [`ContextOptions::device`].
    ///
    /// # Errors
    /// [`Error::NoDevice`] without a loader or a usable device, or where the validation layer is
    /// asked for and not installed; [`Error::Device`] if the device cannot be opened.
    pub fn new(options: &ContextOptions) -> Result<Self> {
        let entry = load()?;
        let mut layers = Vec::new();
        let mut extensions: Vec<&CStr> = options.instance_extensions.iter().map(CString::as_c_str).collect();
        if options.validation {
            require_validation_layer(&entry)?;
            layers.push(VALIDATION_LAYER);
            extensions.push(ash::ext::debug_utils::NAME);
        }
        let instance = create_instance(&entry, &layers, &extensions)?;
        let messenger = options.validation.then(|| Messenger::new(&entry, &instance)).transpose();
        let opened = messenger.and_then(|messenger| {
            Ok((messenger, select(&instance, options).and_then(|found| open(&instance, found, options))?))
        });
        match opened {
            Ok((messenger, opened)) => {
                let opening::Opened { physical_device, device, queue_family, ray_queries } = opened;
                let raw = RawContext {
                    entry,
                    instance,
                    physical_device,
                    device,
                    queue_family,
                    owned: true,
                    ray_queries,
                };
                Ok(Self::assemble(raw, messenger))
            }
            Err(error) => {
                // SAFETY: nothing made from the instance is left but a messenger, which it takes along.
                unsafe { instance.destroy_instance(None) };
                Err(error)
            }
        }
    }

    /// Wraps handles made elsewhere.
    ///
    /// # Safety
    /// The handles are valid and belong together; if they are not owned, they outlive the context and
    /// everything made from it; queue 0 of the family exists and is used elsewhere only while
    /// [`Context::queue`]'s lock is held.
    pub unsafe fn from_raw(raw: RawContext) -> Self {
        Self::assemble(raw, None)
    }

    fn assemble(raw: RawContext, messenger: Option<Messenger>) -> Self {
        let RawContext { entry, instance, physical_device, device, queue_family, owned, ray_queries } = raw;
        // SAFETY: the handles are valid and belong together, by the callers' contract.
        let (queue, memory, limits, families) = unsafe {
            (
                device.get_device_queue(queue_family, 0),
                instance.get_physical_device_memory_properties(physical_device),
                instance.get_physical_device_properties(physical_device).limits,
                instance.get_physical_device_queue_family_properties(physical_device),
            )
        };
        let timestamps = families[queue_family as usize].timestamp_valid_bits >= 32;
        let report = report(&instance, physical_device, &[]);
        let rays = ray_queries.then(|| RayFunctions::load(&instance, physical_device, &device));
        Context(Arc::new(Inner {
            entry,
            instance,
            physical_device,
            device,
            queue_family,
            queue: Mutex::new(queue),
            memory,
            limits,
            timestamps,
            report,
            rays,
            messenger,
            owned,
        }))
    }

    /// The device.
    pub fn report(&self) -> &DeviceReport {
        &self.0.report
    }

    /// Whether compute shaders can trace rays through acceleration structures.
    pub fn traces_rays(&self) -> bool {
        self.0.rays.is_some()
    }

    /// What the validation layer has said so far; empty without [`ContextOptions::validation`].
    pub fn validation_messages(&self) -> Vec<String> {
        self.0.messenger.as_ref().map(|messenger| lock(&messenger.messages).clone()).unwrap_or_default()
    }

    /// The queue; no one else submits to it while the guard lives.
    pub fn queue(&self) -> MutexGuard<'_, vk::Queue> {
        lock(&self.0.queue)
    }

    /// The queue's family.
    pub fn queue_family(&self) -> u32 {
        self.0.queue_family
    }

    /// The device's functions, for presenters.
    pub fn device(&self) -> &ash::Device {
        &self.0.device
    }

    /// The instance's functions, for presenters.
    pub fn instance(&self) -> &ash::Instance {
        &self.0.instance
    }

    /// The physical device, for presenters.
    pub fn physical_device(&self) -> vk::PhysicalDevice {
        self.0.physical_device
    }

    /// Bytes that one storage buffer binding can reach.
    pub fn storage_range(&self) -> u64 {
        u64::from(self.0.limits.max_storage_buffer_range)
    }

    /// How many pieces of memory there can be at a time, for all that is made from the context.
    pub fn most_allocations(&self) -> u32 {
        self.0.limits.max_memory_allocation_count
    }

    /// Bytes of the largest memory of the device's own.
    pub fn memory_size(&self) -> u64 {
        let memory = &self.0.memory;
        let heaps = &memory.memory_heaps[..memory.memory_heap_count as usize];
        let local = heaps.iter().filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        local.map(|heap| heap.size).max().unwrap_or(0)
    }

    /// Whether pictures of one format can be copied to those of another by [`super::Commands::blit`].
    pub fn blits(&self, from: vk::Format, to: vk::Format) -> bool {
        let able = |format, feature| {
            // SAFETY: only the physical device is asked.
            let properties = unsafe {
                self.0.instance.get_physical_device_format_properties(self.0.physical_device, format)
            };
            properties.optimal_tiling_features.contains(feature)
        };
        able(from, vk::FormatFeatureFlags::BLIT_SRC) && able(to, vk::FormatFeatureFlags::BLIT_DST)
    }

    /// Pixels across the largest image.
    pub fn image_size_limit(&self) -> u32 {
        self.0.limits.max_image_dimension2_d.min(self.0.limits.max_framebuffer_width)
    }

    /// An [`Error::Device`] that names this device.
    pub(super) fn refused(&self, what: &str, code: vk::Result) -> Error {
        let next = match code {
            vk::Result::ERROR_OUT_OF_HOST_MEMORY | vk::Result::ERROR_OUT_OF_DEVICE_MEMORY => {
                "make the picture or the number of neighbours smaller"
            }
            vk::Result::ERROR_DEVICE_LOST => "start the program again, and update the driver if it returns",
            _ => "update the driver, or choose another device",
        };
        Error::Device {
            device: self.0.report.name.clone(),
            problem: format!("{what} failed ({code}); {next}"),
        }
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        // SAFETY: everything made from the device holds this struct alive and is gone; the handles
        // are destroyed once, children first, and only if they are this context's own.
        unsafe {
            if self.owned {
                self.device.destroy_device(None);
            }
            if let Some(messenger) = &self.messenger {
                messenger.functions.destroy_debug_utils_messenger(messenger.handle, None);
            }
            if self.owned {
                self.instance.destroy_instance(None);
            }
        }
    }
}

/// A mutex that a panic elsewhere has poisoned still guards valid data here.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::super::testing;
    use super::*;

    #[test]
    fn the_validation_layer_is_heard() {
        let Some(context) = testing::context() else { return };
        testing::assert_valid(&context);
        let fault = vk::BufferCreateInfo::default().size(0).usage(vk::BufferUsageFlags::STORAGE_BUFFER);
        // SAFETY: the layer refuses the size; the driver is asked to make nothing of any size.
        unsafe {
            if let Ok(buffer) = context.device().create_buffer(&fault, None) {
                context.device().destroy_buffer(buffer, None);
            }
        }
        let messages = context.validation_messages();
        assert!(messages.iter().any(|message| message.contains("size")), "{messages:?}");
        assert!(std::panic::catch_unwind(|| testing::assert_valid(&context)).is_err());
    }

    #[test]
    fn devices_are_chosen_by_kind_name_and_uuid() {
        let Some(context) = testing::context() else { return };
        let list = devices().unwrap();
        let best = list.iter().filter(|device| device.unusable.is_none()).map(|device| device.kind).min();
        assert_eq!(Some(context.report().kind), best);
        let part = context.report().name[..4].to_uppercase();
        let named = Context::new(&ContextOptions { device: Some(part), ..ContextOptions::default() });
        assert!(named.is_ok());
        let none = ContextOptions { device: Some("no such device".into()), ..ContextOptions::default() };
        let error = Context::new(&none).unwrap_err();
        assert!(matches!(error, Error::NoDevice { .. }), "{error}");
        assert!(error.to_string().contains(&context.report().name), "{error}");
        let of = |uuid| Context::new(&ContextOptions { uuid: Some(uuid), ..ContextOptions::default() });
        let uuid = context.report().uuid;
        assert_eq!(of(uuid).unwrap().report().uuid, uuid);
        let error = of(uuid.map(|byte| !byte)).unwrap_err().to_string();
        assert!(error.contains("none that can be used has the UUID"), "{error}");
        let lacking = ContextOptions {
            device_extensions: vec![c"VK_FOVEATE_nothing".to_owned()],
            ..ContextOptions::default()
        };
        let error = Context::new(&lacking).unwrap_err();
        assert!(error.to_string().contains("it lacks VK_FOVEATE_nothing"), "{error}");
        testing::assert_valid(&context);
    }
}
