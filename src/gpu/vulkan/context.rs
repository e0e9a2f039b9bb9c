//! Instance, device and queue.
#![allow(unsafe_code)]

use std::collections::BTreeSet;
use std::ffi::{CStr, CString, c_void};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ash::vk;

use crate::error::{Error, Result};
use crate::free_memory;

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Messages kept of the validation layers; later ones are counted out by the length alone.
const MESSAGES_KEPT: usize = 1000;

/// What a device is, in the order in which they are preferred.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A graphics card.
    Discrete,
    /// A GPU that shares the processor's memory.
    Integrated,
    /// A GPU of a virtual machine.
    Virtual,
    /// A software implementation, such as lavapipe.
    Cpu,
    /// Something else.
    Other,
}

impl DeviceKind {
    fn of(kind: vk::PhysicalDeviceType) -> Self {
        match kind {
            vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
            vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
            vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
            vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
            _ => DeviceKind::Other,
        }
    }
}

/// A Vulkan device of this machine.
#[derive(Clone, Debug)]
pub struct DeviceReport {
    /// The driver's name for it.
    pub name: String,
    /// What it is.
    pub kind: DeviceKind,
    /// The highest Vulkan version that it offers, as `major.minor.patch`.
    pub api_version: String,
    /// VkPhysicalDeviceIDProperties::deviceUUID, the same in OpenCL's `cl_khr_device_uuid`.
    pub uuid: [u8; 16],
    /// Whether memory of the host can be imported (VK_EXT_external_memory_host).
    pub imports_host_memory: bool,
    /// Whether memory can be exported as file descriptors (VK_KHR_external_memory_fd).
    pub exports_fd: bool,
    /// Why it cannot be used; `None` if it can.
    pub unusable: Option<String>,
}

/// How to open a context of one's own.
#[derive(Clone, Debug, Default)]
pub struct ContextOptions {
    /// Take the first device whose name contains this, ignoring case; otherwise the preferred kind.
    pub device: Option<String>,
    /// Load the validation layer and keep its messages: see [`Context::validation_messages`].
    pub validation: bool,
    /// Instance extensions to require, for a window's surface.
    pub instance_extensions: Vec<CString>,
    /// Device extensions to require, for a swapchain.
    pub device_extensions: Vec<CString>,
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
    messenger: Option<Messenger>,
    owned: bool,
}

struct Messenger {
    functions: ash::ext::debug_utils::Instance,
    handle: vk::DebugUtilsMessengerEXT,
    messages: Arc<Mutex<Vec<String>>>,
}

impl std::fmt::Debug for Context {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Context").field(&self.0.report).finish()
    }
}

/// Every Vulkan device of this machine, usable or not, in the driver's order.
///
/// # Errors
/// [`Error::NoDevice`] where there is no Vulkan loader or it gives no instance.
pub fn devices() -> Result<Vec<DeviceReport>> {
    let entry = load()?;
    let instance = create_instance(&entry, &[], &[])?;
    // SAFETY: the instance is valid and is destroyed once, after its last use.
    unsafe {
        let found = instance.enumerate_physical_devices();
        let reports =
            found.map(|list| list.iter().map(|&device| report(&instance, device, &[])).collect::<Vec<_>>());
        instance.destroy_instance(None);
        reports.map_err(|code| no_device(format!("the devices could not be listed ({code})")))
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
            Ok((messenger, (physical_device, device, queue_family))) => {
                let raw = RawContext { entry, instance, physical_device, device, queue_family, owned: true };
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
        let RawContext { entry, instance, physical_device, device, queue_family, owned } = raw;
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
            messenger,
            owned,
        }))
    }

    /// The device.
    pub fn report(&self) -> &DeviceReport {
        &self.0.report
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

impl Messenger {
    fn new(entry: &ash::Entry, instance: &ash::Instance) -> Result<Self> {
        let functions = ash::ext::debug_utils::Instance::new(entry, instance);
        let messages = Arc::new(Mutex::new(Vec::new()));
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
            )
            .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
            .pfn_user_callback(Some(keep_message))
            .user_data(Arc::as_ptr(&messages).cast_mut().cast());
        // SAFETY: the extension is enabled; the user data lives in the messenger's own Arc, which is
        // dropped after the handle is destroyed.
        let handle = unsafe { functions.create_debug_utils_messenger(&info, None) }
            .map_err(|code| no_device(format!("the validation layer cannot be listened to ({code})")))?;
        Ok(Messenger { functions, handle, messages })
    }
}

/// Keeps a validation message.
///
/// # Safety
/// Called by the validation layer: `data` is valid, and `user` is the messages' mutex.
unsafe extern "system" fn keep_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: by the function's contract; the message is a string that ends with a zero.
    let (messages, text) = unsafe {
        let text = (*data).message_as_c_str().map(|text| text.to_string_lossy().into_owned());
        (&*user.cast::<Mutex<Vec<String>>>(), text)
    };
    let mut messages = lock(messages);
    if messages.len() < MESSAGES_KEPT {
        messages.push(text.unwrap_or_default());
    }
    vk::FALSE
}

/// A mutex that a panic elsewhere has poisoned still guards valid data here.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Loaders and drivers without memory fail in any way.
fn no_device(problem: String) -> Error {
    let problem = match free_memory::tight_limit() {
        Some(limit) => format!(
            "{problem}; this process may use {} MiB of memory, which may be the reason: raise the limit (ulimit -v)",
            limit >> 20
        ),
        None => problem,
    };
    Error::NoDevice { kind: "Vulkan", problem }
}

fn load() -> Result<ash::Entry> {
    // SAFETY: loading runs the initialisers of the system's Vulkan loader, which is trusted.
    unsafe { ash::Entry::load() }.map_err(|_| {
        no_device(
            "the Vulkan loader is not installed; install libvulkan1 and a driver, such as mesa-vulkan-drivers"
                .to_string(),
        )
    })
}

fn require_validation_layer(entry: &ash::Entry) -> Result<()> {
    // SAFETY: only the loader is asked.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }.unwrap_or_default();
    if layers.iter().any(|layer| layer.layer_name_as_c_str() == Ok(VALIDATION_LAYER)) {
        return Ok(());
    }
    Err(no_device("the validation layer is not installed; install vulkan-validationlayers".to_string()))
}

fn create_instance(entry: &ash::Entry, layers: &[&CStr], extensions: &[&CStr]) -> Result<ash::Instance> {
    let application = vk::ApplicationInfo::default()
        .application_name(c"foveate")
        .engine_name(c"foveate")
        .api_version(vk::API_VERSION_1_1);
    let layers: Vec<_> = layers.iter().map(|name| name.as_ptr()).collect();
    let extensions: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
    let info = vk::InstanceCreateInfo::default()
        .application_info(&application)
        .enabled_layer_names(&layers)
        .enabled_extension_names(&extensions);
    // SAFETY: the strings outlive the call.
    unsafe { entry.create_instance(&info, None) }.map_err(|code| {
        no_device(match code {
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => {
                "no driver was found; install one, such as mesa-vulkan-drivers".to_string()
            }
            vk::Result::ERROR_EXTENSION_NOT_PRESENT => {
                "the drivers cannot show windows on this system; use the mock headset".to_string()
            }
            _ => format!("no instance can be made ({code}); check the driver with vulkaninfo"),
        })
    })
}

/// The family with graphics and compute, for those who make their own device.
pub fn queue_family(instance: &ash::Instance, device: vk::PhysicalDevice) -> Option<u32> {
    let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    // SAFETY: the device belongs to the instance.
    let families = unsafe { instance.get_physical_device_queue_family_properties(device) };
    families.iter().position(|family| family.queue_flags.contains(wanted)).map(|index| index as u32)
}

/// The extensions to enable on a device, of those it offers, so that its memory can be shared.
pub fn sharing_extensions(instance: &ash::Instance, device: vk::PhysicalDevice) -> Vec<&'static CStr> {
    let wanted = [ash::ext::external_memory_host::NAME, ash::khr::external_memory_fd::NAME];
    let offered = extensions_of(instance, device);
    wanted.into_iter().filter(|name| offered.contains(*name)).collect()
}

fn extensions_of(instance: &ash::Instance, device: vk::PhysicalDevice) -> BTreeSet<CString> {
    // SAFETY: the device belongs to the instance.
    let listed = unsafe { instance.enumerate_device_extension_properties(device) }.unwrap_or_default();
    listed.iter().filter_map(|entry| entry.extension_name_as_c_str().ok().map(CStr::to_owned)).collect()
}

fn report(instance: &ash::Instance, device: vk::PhysicalDevice, required: &[CString]) -> DeviceReport {
    let mut ids = vk::PhysicalDeviceIDProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default();
    // SAFETY: the device belongs to the instance.
    let version = unsafe { instance.get_physical_device_properties(device) }.api_version;
    if version >= vk::API_VERSION_1_1 {
        properties = properties.push_next(&mut ids);
    }
    // SAFETY: as above; the chain holds structs of Vulkan 1.1, which the instance is made for.
    unsafe { instance.get_physical_device_properties2(device, &mut properties) };
    let properties = properties.properties;
    let extensions = extensions_of(instance, device);
    let missing = required.iter().find(|name| !extensions.contains(*name));
    let unusable = if version < vk::API_VERSION_1_1 {
        Some("it offers only Vulkan 1.0, and 1.1 is needed".to_string())
    } else if queue_family(instance, device).is_none() {
        Some("it has no queue for both graphics and compute".to_string())
    } else {
        missing.map(|name| format!("it lacks {}", name.to_string_lossy()))
    };
    DeviceReport {
        name: properties.device_name_as_c_str().unwrap_or(c"unnamed").to_string_lossy().into_owned(),
        kind: DeviceKind::of(properties.device_type),
        api_version: format!(
            "{}.{}.{}",
            vk::api_version_major(version),
            vk::api_version_minor(version),
            vk::api_version_patch(version)
        ),
        uuid: ids.device_uuid,
        imports_host_memory: extensions.contains(ash::ext::external_memory_host::NAME),
        exports_fd: extensions.contains(ash::khr::external_memory_fd::NAME),
        unusable,
    }
}

/// The device that the options ask for.
fn select(instance: &ash::Instance, options: &ContextOptions) -> Result<vk::PhysicalDevice> {
    // SAFETY: the instance is valid.
    let devices = unsafe { instance.enumerate_physical_devices() }
        .map_err(|code| no_device(format!("the devices could not be listed ({code})")))?;
    let reports: Vec<_> =
        devices.iter().map(|&device| report(instance, device, &options.device_extensions)).collect();
    let named = |report: &DeviceReport| {
        options.device.as_ref().is_none_or(|name| report.name.to_lowercase().contains(&name.to_lowercase()))
    };
    let best = (0..devices.len())
        .filter(|&index| reports[index].unusable.is_none() && named(&reports[index]))
        .min_by_key(|&index| reports[index].kind);
    best.map(|index| devices[index]).ok_or_else(|| no_device(why_none(&reports, options)))
}

fn why_none(reports: &[DeviceReport], options: &ContextOptions) -> String {
    if reports.is_empty() {
        return "the drivers list none; install one, such as mesa-vulkan-drivers".to_string();
    }
    let list: Vec<_> = reports
        .iter()
        .map(|report| match &report.unusable {
            Some(reason) => format!("{} ({reason})", report.name),
            None => report.name.clone(),
        })
        .collect();
    match &options.device {
        Some(name) => format!("none that can be used is named \"{name}\"; there are: {}", list.join(", ")),
        None => format!("there are: {}; update the driver", list.join(", ")),
    }
}

fn open(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    options: &ContextOptions,
) -> Result<(vk::PhysicalDevice, ash::Device, u32)> {
    let found = report(instance, physical, &[]);
    let family = queue_family(instance, physical)
        .ok_or_else(|| no_device(format!("{} has no queue for graphics and compute", found.name)))?;
    let mut extensions: Vec<&CStr> = options.device_extensions.iter().map(CString::as_c_str).collect();
    extensions.extend(sharing_extensions(instance, physical));
    let extensions: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
    let info =
        vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_extension_names(&extensions);
    // SAFETY: the extensions are offered by the device, or were checked for; the strings outlive the call.
    let device = unsafe { instance.create_device(physical, &info, None) }.map_err(|code| Error::Device {
        device: found.name,
        problem: format!("it cannot be opened ({code}); close programs that use it, or choose another"),
    })?;
    Ok((physical, device, family))
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
    fn devices_are_chosen_by_kind_and_name() {
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
        let lacking = ContextOptions {
            device_extensions: vec![c"VK_FOVEATE_nothing".to_owned()],
            ..ContextOptions::default()
        };
        let error = Context::new(&lacking).unwrap_err();
        assert!(error.to_string().contains("it lacks VK_FOVEATE_nothing"), "{error}");
        testing::assert_valid(&context);
    }
}
