//! The active runtime and its headset.
#![allow(unsafe_code)]

use openxr as xr;

use super::fault::{Called, Fault, Outcome};
use super::{absent, foveated, vulkan, waiter};
use crate::error::Error;
use crate::gpu::vulkan::{Context, ContextOptions};

/// Stereo with a sharp inset for each eye, of OpenXR 1.1 and XR_VARJO_quad_views.
const QUAD: xr::ViewConfigurationType = xr::ViewConfigurationType::PRIMARY_STEREO_WITH_FOVEATED_INSET;

/// A runtime that answers, with a headset.
pub struct Runtime {
    pub(super) instance: xr::Instance,
    pub(super) system: xr::SystemId,
    pub(super) views: xr::ViewConfigurationType,
    pub(super) sizes: Vec<xr::ViewConfigurationView>,
    pub(super) blend: xr::EnvironmentBlendMode,
    /// Whether layers may tell depths.
    pub(super) takes_depth: bool,
    /// Whether there are insets that can follow the eyes.
    pub(super) follows: bool,
    name: String,
}

impl Runtime {
    /// Connects to the active runtime.
    ///
    /// # Errors
    /// [`Fault::Fatal`] with the next step where there is no loader, or a runtime without Vulkan;
    /// [`Fault::Instance`] where there is no runtime, it does not answer, or has no headset now.
    ///
    /// With `insets`, a headset that has a sharp inset for each eye gets four views.
    pub fn connect(insets: bool) -> Outcome<Runtime> {
        if !waiter::settled() {
            return Err(Fault::Instance("xrWaitFrame of the last session has not returned yet".into()));
        }
        // SAFETY: the library of this name is the system's OpenXR loader, which is trusted.
        let entry = unsafe { xr::Entry::load(&()) }.map_err(|_| {
            missing("the OpenXR loader is not installed; install libopenxr-loader1, and SteamVR or Monado")
        })?;
        let offered = entry.enumerate_extensions().map_err(unanswered)?;
        if !offered.khr_vulkan_enable2 {
            return Err(missing("the active runtime lacks XR_KHR_vulkan_enable2; use SteamVR or Monado"));
        }
        let extensions = wanted(&offered);
        let instance = create_instance(&entry, &extensions).map_err(unanswered)?;
        let properties = instance.properties().called("xrGetInstanceProperties")?;
        let name = format!("{} {}", properties.runtime_name, properties.runtime_version);
        let system = instance.system(xr::FormFactor::HEAD_MOUNTED_DISPLAY).map_err(|code| match code {
            xr::sys::Result::ERROR_FORM_FACTOR_UNAVAILABLE => {
                Fault::Instance(format!("{name} finds no headset; plug it in and switch it on"))
            }
            code => Fault::of("xrGetSystem", code),
        })?;
        let views = choose_views(&instance, system, insets)?;
        let sizes = instance
            .enumerate_view_configuration_views(system, views)
            .called("xrEnumerateViewConfigurationViews")?;
        let blend = instance
            .enumerate_environment_blend_modes(system, views)
            .called("xrEnumerateEnvironmentBlendModes")?;
        // Opaque where that is offered, else what the runtime likes best.
        let opaque = xr::EnvironmentBlendMode::OPAQUE;
        let blend = blend.iter().find(|mode| **mode == opaque).or(blend.first()).copied().unwrap_or(opaque);
        let takes_depth = extensions.khr_composition_layer_depth;
        let follows = views == QUAD && foveated::supported(&instance, system);
        Ok(Runtime { instance, system, views, sizes, blend, takes_depth, follows, name })
    }

    /// Makes the Vulkan device that the runtime presents from, with the extensions that `options` ask for.
    ///
    /// # Errors
    /// Where the runtime or the driver refuses, or an extension is missing.
    pub fn open_context(&self, options: &ContextOptions) -> Outcome<Context> {
        vulkan::open(&self.instance, self.system, options)
    }

    /// Name and version.
    pub fn name(&self) -> &str {
        &self.name
    }
}

fn missing(problem: &str) -> Fault {
    Error::NoDevice { kind: "OpenXR", problem: problem.into() }.into()
}

/// No runtime is installed, or it cannot be reached: it may come.
fn unanswered(code: xr::sys::Result) -> Fault {
    Fault::Instance(absent::why(code))
}

/// Of the extensions that are offered, those that this program uses.
fn wanted(offered: &xr::ExtensionSet) -> xr::ExtensionSet {
    let mut wanted = xr::ExtensionSet::default();
    wanted.khr_vulkan_enable2 = true;
    wanted.khr_composition_layer_depth = offered.khr_composition_layer_depth;
    #[cfg(not(windows))]
    {
        wanted.khr_convert_timespec_time = offered.khr_convert_timespec_time;
    }
    #[cfg(windows)]
    {
        wanted.khr_win32_convert_performance_counter_time =
            offered.khr_win32_convert_performance_counter_time;
    }
    wanted.khr_visibility_mask = offered.khr_visibility_mask;
    wanted.ext_eye_gaze_interaction = offered.ext_eye_gaze_interaction;
    wanted.ext_performance_settings = offered.ext_performance_settings;
    wanted.fb_display_refresh_rate = offered.fb_display_refresh_rate;
    wanted.ext_frame_synthesis = offered.ext_frame_synthesis;
    wanted.fb_space_warp = offered.fb_space_warp;
    wanted.varjo_quad_views = offered.varjo_quad_views;
    // An extension of the one before.
    wanted.varjo_foveated_rendering = offered.varjo_foveated_rendering && offered.varjo_quad_views;
    wanted.ext_local_floor = offered.ext_local_floor;
    // Controllers that were no part of OpenXR 1.0.
    wanted.bd_controller_interaction = offered.bd_controller_interaction;
    wanted.ext_hand_tracking = offered.ext_hand_tracking;
    wanted.ext_hand_interaction = offered.ext_hand_interaction;
    wanted.ext_hp_mixed_reality_controller = offered.ext_hp_mixed_reality_controller;
    wanted.fb_touch_controller_pro = offered.fb_touch_controller_pro;
    wanted.htc_vive_cosmos_controller_interaction = offered.htc_vive_cosmos_controller_interaction;
    wanted.htc_vive_focus3_controller_interaction = offered.htc_vive_focus3_controller_interaction;
    wanted.meta_touch_controller_plus = offered.meta_touch_controller_plus;
    wanted
}

/// An instance of OpenXR 1.1, or 1.0 where the runtime is older.
fn create_instance(entry: &xr::Entry, extensions: &xr::ExtensionSet) -> xr::Result<xr::Instance> {
    let create = |minor| {
        let application = xr::ApplicationInfo {
            application_name: "foveate",
            application_version: 1,
            engine_name: "foveate",
            engine_version: 1,
            api_version: xr::Version::new(1, minor, 0),
        };
        entry.create_instance(&application, extensions, &[], &())
    };
    match create(1) {
        Err(xr::sys::Result::ERROR_API_VERSION_UNSUPPORTED) => create(0),
        made => made,
    }
}

/// The best view configuration of those listed.
fn choose_views(
    instance: &xr::Instance,
    system: xr::SystemId,
    insets: bool,
) -> Outcome<xr::ViewConfigurationType> {
    let listed = instance.enumerate_view_configurations(system).called("xrEnumerateViewConfigurations")?;
    [QUAD, xr::ViewConfigurationType::PRIMARY_STEREO]
        .into_iter()
        .find(|kind| listed.contains(kind) && (insets || *kind != QUAD))
        .ok_or_else(|| missing("the headset shows no two views; use one that does"))
}
