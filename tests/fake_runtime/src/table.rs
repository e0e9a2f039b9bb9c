//! The functions that the loader finds by name.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_char};
use std::mem;

use openxr_sys::{self as xr, pfn};

use crate::abi::Argument;
use crate::calls::{
    action, action_state, configuration, event, extension, frame, graphics, hand_tracking, instance, session,
    space, swapchain,
};
use crate::clock::Reading;

/// For each call its name, its type, its arguments as OpenXR declares them, and what does its work.
macro_rules! table {
    ($($(#[$system:meta])? $name:literal $kind:ident ($($argument:ident: $raw:ty),*) => $work:path;)*) => {
        fn find(name: &[u8]) -> Option<pfn::VoidFunction> {
            match name {
                $($(#[$system])? $name => {
                    unsafe extern "system" fn call($($argument: $raw),*) -> xr::Result {
                        // SAFETY: these are the arguments of a call that has not returned.
                        unsafe { $work($(Argument::from_raw($argument)),*) }
                    }
                    let typed: pfn::$kind = call;
                    // SAFETY: the loader turns it back into the type that belongs to the name.
                    Some(unsafe { mem::transmute::<pfn::$kind, pfn::VoidFunction>(typed) })
                })*
                _ => None,
            }
        }
    };
}

table! {
    b"xrEnumerateApiLayerProperties" EnumerateApiLayerProperties
        (a: u32, b: *mut u32, c: *mut xr::ApiLayerProperties) => instance::enumerate_api_layers;
    b"xrEnumerateInstanceExtensionProperties" EnumerateInstanceExtensionProperties
        (a: *const c_char, b: u32, c: *mut u32, d: *mut xr::ExtensionProperties) => instance::enumerate_extensions;
    b"xrCreateInstance" CreateInstance
        (a: *const xr::InstanceCreateInfo, b: *mut xr::Instance) => instance::create;
    b"xrDestroyInstance" DestroyInstance (a: xr::Instance) => instance::destroy;
    b"xrGetInstanceProperties" GetInstanceProperties
        (a: xr::Instance, b: *mut xr::InstanceProperties) => instance::properties;
    b"xrGetSystem" GetSystem
        (a: xr::Instance, b: *const xr::SystemGetInfo, c: *mut xr::SystemId) => instance::get_system;
    b"xrGetSystemProperties" GetSystemProperties
        (a: xr::Instance, b: xr::SystemId, c: *mut xr::SystemProperties) => instance::system_properties;
    b"xrResultToString" ResultToString
        (a: xr::Instance, b: xr::Result, c: *mut c_char) => instance::result_to_string;
    b"xrStructureTypeToString" StructureTypeToString
        (a: xr::Instance, b: xr::StructureType, c: *mut c_char) => instance::type_to_string;
    b"xrStringToPath" StringToPath
        (a: xr::Instance, b: *const c_char, c: *mut xr::Path) => instance::string_to_path;
    b"xrPathToString" PathToString
        (a: xr::Instance, b: xr::Path, c: u32, d: *mut u32, e: *mut c_char) => instance::path_to_string;
    b"xrPollEvent" PollEvent (a: xr::Instance, b: *mut xr::EventDataBuffer) => event::poll_event;
    b"xrEnumerateViewConfigurations" EnumerateViewConfigurations
        (a: xr::Instance, b: xr::SystemId, c: u32, d: *mut u32, e: *mut xr::ViewConfigurationType)
        => configuration::enumerate_view_configurations;
    b"xrGetViewConfigurationProperties" GetViewConfigurationProperties
        (a: xr::Instance, b: xr::SystemId, c: xr::ViewConfigurationType, d: *mut xr::ViewConfigurationProperties)
        => configuration::view_configuration_properties;
    b"xrEnumerateViewConfigurationViews" EnumerateViewConfigurationViews
        (a: xr::Instance, b: xr::SystemId, c: xr::ViewConfigurationType, d: u32, e: *mut u32,
         f: *mut xr::ViewConfigurationView) => configuration::enumerate_views;
    b"xrEnumerateEnvironmentBlendModes" EnumerateEnvironmentBlendModes
        (a: xr::Instance, b: xr::SystemId, c: xr::ViewConfigurationType, d: u32, e: *mut u32,
         f: *mut xr::EnvironmentBlendMode) => configuration::enumerate_blend_modes;

    b"xrCreateSession" CreateSession
        (a: xr::Instance, b: *const xr::SessionCreateInfo, c: *mut xr::Session) => session::create;
    b"xrDestroySession" DestroySession (a: xr::Session) => session::destroy;
    b"xrBeginSession" BeginSession (a: xr::Session, b: *const xr::SessionBeginInfo) => session::begin;
    b"xrEndSession" EndSession (a: xr::Session) => session::end;
    b"xrRequestExitSession" RequestExitSession (a: xr::Session) => session::request_exit;
    b"xrEnumerateReferenceSpaces" EnumerateReferenceSpaces
        (a: xr::Session, b: u32, c: *mut u32, d: *mut xr::ReferenceSpaceType)
        => session::enumerate_reference_spaces;

    b"xrWaitFrame" WaitFrame
        (a: xr::Session, b: *const xr::FrameWaitInfo, c: *mut xr::FrameState) => frame::wait;
    b"xrBeginFrame" BeginFrame (a: xr::Session, b: *const xr::FrameBeginInfo) => frame::begin;
    b"xrEndFrame" EndFrame (a: xr::Session, b: *const xr::FrameEndInfo) => frame::end;

    b"xrEnumerateSwapchainFormats" EnumerateSwapchainFormats
        (a: xr::Session, b: u32, c: *mut u32, d: *mut i64) => swapchain::enumerate_formats;
    b"xrCreateSwapchain" CreateSwapchain
        (a: xr::Session, b: *const xr::SwapchainCreateInfo, c: *mut xr::Swapchain) => swapchain::create;
    b"xrDestroySwapchain" DestroySwapchain (a: xr::Swapchain) => swapchain::destroy;
    b"xrEnumerateSwapchainImages" EnumerateSwapchainImages
        (a: xr::Swapchain, b: u32, c: *mut u32, d: *mut xr::SwapchainImageBaseHeader)
        => swapchain::enumerate_images;
    b"xrAcquireSwapchainImage" AcquireSwapchainImage
        (a: xr::Swapchain, b: *const xr::SwapchainImageAcquireInfo, c: *mut u32) => swapchain::acquire;
    b"xrWaitSwapchainImage" WaitSwapchainImage
        (a: xr::Swapchain, b: *const xr::SwapchainImageWaitInfo) => swapchain::wait;
    b"xrReleaseSwapchainImage" ReleaseSwapchainImage
        (a: xr::Swapchain, b: *const xr::SwapchainImageReleaseInfo) => swapchain::release;

    b"xrCreateReferenceSpace" CreateReferenceSpace
        (a: xr::Session, b: *const xr::ReferenceSpaceCreateInfo, c: *mut xr::Space) => space::create_reference;
    b"xrCreateActionSpace" CreateActionSpace
        (a: xr::Session, b: *const xr::ActionSpaceCreateInfo, c: *mut xr::Space) => space::create_action;
    b"xrDestroySpace" DestroySpace (a: xr::Space) => space::destroy;
    b"xrLocateSpace" LocateSpace
        (a: xr::Space, b: xr::Space, c: xr::Time, d: *mut xr::SpaceLocation) => space::locate;
    b"xrLocateViews" LocateViews
        (a: xr::Session, b: *const xr::ViewLocateInfo, c: *mut xr::ViewState, d: u32, e: *mut u32,
         f: *mut xr::View) => space::locate_views;
    b"xrGetReferenceSpaceBoundsRect" GetReferenceSpaceBoundsRect
        (a: xr::Session, b: xr::ReferenceSpaceType, c: *mut xr::Extent2Df) => space::bounds;

    b"xrCreateActionSet" CreateActionSet
        (a: xr::Instance, b: *const xr::ActionSetCreateInfo, c: *mut xr::ActionSet) => action::create_set;
    b"xrDestroyActionSet" DestroyActionSet (a: xr::ActionSet) => action::destroy_set;
    b"xrCreateAction" CreateAction
        (a: xr::ActionSet, b: *const xr::ActionCreateInfo, c: *mut xr::Action) => action::create;
    b"xrDestroyAction" DestroyAction (a: xr::Action) => action::destroy;
    b"xrSuggestInteractionProfileBindings" SuggestInteractionProfileBindings
        (a: xr::Instance, b: *const xr::InteractionProfileSuggestedBinding) => action::suggest;
    b"xrAttachSessionActionSets" AttachSessionActionSets
        (a: xr::Session, b: *const xr::SessionActionSetsAttachInfo) => action::attach;
    b"xrSyncActions" SyncActions (a: xr::Session, b: *const xr::ActionsSyncInfo) => action::sync;
    b"xrGetActionStateBoolean" GetActionStateBoolean
        (a: xr::Session, b: *const xr::ActionStateGetInfo, c: *mut xr::ActionStateBoolean)
        => action_state::get_boolean;
    b"xrGetActionStateFloat" GetActionStateFloat
        (a: xr::Session, b: *const xr::ActionStateGetInfo, c: *mut xr::ActionStateFloat) => action_state::get_float;
    b"xrGetActionStateVector2f" GetActionStateVector2f
        (a: xr::Session, b: *const xr::ActionStateGetInfo, c: *mut xr::ActionStateVector2f)
        => action_state::get_vector;
    b"xrGetActionStatePose" GetActionStatePose
        (a: xr::Session, b: *const xr::ActionStateGetInfo, c: *mut xr::ActionStatePose) => action_state::get_pose;
    b"xrGetCurrentInteractionProfile" GetCurrentInteractionProfile
        (a: xr::Session, b: xr::Path, c: *mut xr::InteractionProfileState) => action::current_profile;
    b"xrEnumerateBoundSourcesForAction" EnumerateBoundSourcesForAction
        (a: xr::Session, b: *const xr::BoundSourcesForActionEnumerateInfo, c: u32, d: *mut u32,
         e: *mut xr::Path) => action::bound_sources;
    b"xrGetInputSourceLocalizedName" GetInputSourceLocalizedName
        (a: xr::Session, b: *const xr::InputSourceLocalizedNameGetInfo, c: u32, d: *mut u32, e: *mut c_char)
        => action::localized_name;
    b"xrApplyHapticFeedback" ApplyHapticFeedback
        (a: xr::Session, b: *const xr::HapticActionInfo, c: *const xr::HapticBaseHeader)
        => action::apply_haptics;
    b"xrStopHapticFeedback" StopHapticFeedback
        (a: xr::Session, b: *const xr::HapticActionInfo) => action::stop_haptics;

    b"xrGetVulkanGraphicsRequirements2KHR" GetVulkanGraphicsRequirements2KHR
        (a: xr::Instance, b: xr::SystemId, c: *mut xr::GraphicsRequirementsVulkanKHR)
        => graphics::requirements;
    b"xrCreateVulkanInstanceKHR" CreateVulkanInstanceKHR
        (a: xr::Instance, b: *const xr::VulkanInstanceCreateInfoKHR, c: *mut xr::platform::VkInstance,
         d: *mut xr::platform::VkResult) => graphics::create_instance;
    b"xrGetVulkanGraphicsDevice2KHR" GetVulkanGraphicsDevice2KHR
        (a: xr::Instance, b: *const xr::VulkanGraphicsDeviceGetInfoKHR, c: *mut xr::platform::VkPhysicalDevice)
        => graphics::physical_device;
    b"xrCreateVulkanDeviceKHR" CreateVulkanDeviceKHR
        (a: xr::Instance, b: *const xr::VulkanDeviceCreateInfoKHR, c: *mut xr::platform::VkDevice,
         d: *mut xr::platform::VkResult) => graphics::create_device;

    b"xrGetVisibilityMaskKHR" GetVisibilityMaskKHR
        (a: xr::Session, b: xr::ViewConfigurationType, c: u32, d: xr::VisibilityMaskTypeKHR,
         e: *mut xr::VisibilityMaskKHR) => extension::visibility_mask;
    b"xrEnumerateDisplayRefreshRatesFB" EnumerateDisplayRefreshRatesFB
        (a: xr::Session, b: u32, c: *mut u32, d: *mut f32) => extension::enumerate_rates;
    b"xrGetDisplayRefreshRateFB" GetDisplayRefreshRateFB (a: xr::Session, b: *mut f32) => extension::get_rate;
    b"xrRequestDisplayRefreshRateFB" RequestDisplayRefreshRateFB
        (a: xr::Session, b: f32) => extension::request_rate;
    b"xrCreateHandTrackerEXT" CreateHandTrackerEXT
        (a: xr::Session, b: *const xr::HandTrackerCreateInfoEXT, c: *mut xr::HandTrackerEXT)
        => hand_tracking::create;
    b"xrDestroyHandTrackerEXT" DestroyHandTrackerEXT (a: xr::HandTrackerEXT) => hand_tracking::destroy;
    b"xrLocateHandJointsEXT" LocateHandJointsEXT
        (a: xr::HandTrackerEXT, b: *const xr::HandJointsLocateInfoEXT, c: *mut xr::HandJointLocationsEXT)
        => hand_tracking::locate;
    b"xrPerfSettingsSetPerformanceLevelEXT" PerfSettingsSetPerformanceLevelEXT
        (a: xr::Session, b: xr::PerfSettingsDomainEXT, c: xr::PerfSettingsLevelEXT) => extension::performance;
    #[cfg(unix)]
    b"xrConvertTimespecTimeToTimeKHR" ConvertTimespecTimeToTimeKHR
        (a: xr::Instance, b: *const Reading, c: *mut xr::Time) => extension::reading_to_time;
    #[cfg(unix)]
    b"xrConvertTimeToTimespecTimeKHR" ConvertTimeToTimespecTimeKHR
        (a: xr::Instance, b: xr::Time, c: *mut Reading) => extension::time_to_reading;
    #[cfg(windows)]
    b"xrConvertWin32PerformanceCounterToTimeKHR" ConvertWin32PerformanceCounterToTimeKHR
        (a: xr::Instance, b: *const Reading, c: *mut xr::Time) => extension::reading_to_time;
    #[cfg(windows)]
    b"xrConvertTimeToWin32PerformanceCounterKHR" ConvertTimeToWin32PerformanceCounterKHR
        (a: xr::Instance, b: xr::Time, c: *mut Reading) => extension::time_to_reading;
}

unsafe extern "system" fn get_instance_proc_addr(
    _instance: xr::Instance,
    name: *const c_char,
    function: *mut Option<pfn::VoidFunction>,
) -> xr::Result {
    if name.is_null() || function.is_null() {
        return xr::Result::ERROR_VALIDATION_FAILURE;
    }
    // SAFETY: neither is null; the name ends with a zero and the place may be written, by OpenXR's contract.
    unsafe {
        let name = CStr::from_ptr(name).to_bytes();
        let found = match name {
            b"xrGetInstanceProcAddr" => {
                Some(mem::transmute::<pfn::GetInstanceProcAddr, pfn::VoidFunction>(get_instance_proc_addr))
            }
            _ => find(name),
        };
        function.write(found);
        if found.is_some() { xr::Result::SUCCESS } else { xr::Result::ERROR_FUNCTION_UNSUPPORTED }
    }
}

/// Where the loader starts.
///
/// # Safety
/// Called by the OpenXR loader, with its structures.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn xrNegotiateLoaderRuntimeInterface(
    info: *const xr::NegotiateLoaderInfo,
    request: *mut xr::NegotiateRuntimeRequest,
) -> xr::Result {
    if info.is_null() || request.is_null() {
        return xr::Result::ERROR_INITIALIZATION_FAILED;
    }
    // SAFETY: not null, and the loader's.
    let (info, request) = unsafe { (&*info, &mut *request) };
    if info.min_interface_version > 1 || info.max_interface_version < 1 {
        return xr::Result::ERROR_INITIALIZATION_FAILED;
    }
    request.runtime_interface_version = 1;
    request.runtime_api_version = xr::Version::new(1, 1, 0).min(info.max_api_version);
    request.get_instance_proc_addr = Some(get_instance_proc_addr);
    xr::Result::SUCCESS
}
