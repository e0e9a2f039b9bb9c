//! Instance, system, paths and events.

use std::collections::{BTreeSet, VecDeque};
use std::ffi::c_char;

use openxr_sys::{self as xr, Handle};

use crate::abi::{self, In, Out};
use crate::clock;
use crate::nested;
use crate::objects::{Instance, Object};
use crate::refusal::{Outcome, wrong};
use crate::runtime::{On, SYSTEM, enter};
use crate::script::Script;

const DONE: Outcome = Ok(xr::Result::SUCCESS);

/// What can be listed, with the extension's version.
const EXTENSIONS: [(&str, u32); 13] = [
    ("XR_KHR_vulkan_enable2", 2),
    ("XR_KHR_composition_layer_depth", 6),
    ("XR_KHR_visibility_mask", 2),
    (clock::EXTENSION, 1),
    ("XR_EXT_eye_gaze_interaction", 2),
    ("XR_EXT_hand_tracking", 4),
    ("XR_EXT_performance_settings", 4),
    ("XR_EXT_local_floor", 1),
    ("XR_EXT_frame_synthesis", 1),
    ("XR_FB_display_refresh_rate", 1),
    ("XR_FB_space_warp", 2),
    ("XR_VARJO_quad_views", 1),
    ("XR_VARJO_foveated_rendering", 3),
];

/// What a script's runtime lists.
fn listed(script: &Script) -> Vec<(&'static str, u32)> {
    let insets = !script.inset_views.is_empty();
    let listed = |name: &str| {
        let there = match name {
            "XR_VARJO_quad_views" => insets,
            "XR_VARJO_foveated_rendering" => insets && script.following_insets.is_some(),
            "XR_EXT_frame_synthesis" | "XR_FB_space_warp" => script.motion_vectors.is_some(),
            _ => true,
        };
        there && !script.without.iter().any(|w| w == name)
    };
    EXTENSIONS.into_iter().filter(|&(name, _)| listed(name)).collect()
}

pub(crate) fn enumerate_api_layers(
    _capacity: u32,
    count: Out<u32>,
    _layers: Out<xr::ApiLayerProperties>,
) -> xr::Result {
    enter("xrEnumerateApiLayerProperties", On::Nothing, |_, _| {
        count.set(0)?;
        DONE
    })
}

pub(crate) fn enumerate_extensions(
    _layer: In<c_char>,
    capacity: u32,
    count: Out<u32>,
    properties: Out<xr::ExtensionProperties>,
) -> xr::Result {
    enter("xrEnumerateInstanceExtensionProperties", On::Nothing, |runtime, _| {
        properties.fill_typed(capacity, count, listed(&runtime.script), |next, (name, version)| {
            xr::ExtensionProperties {
                ty: xr::ExtensionProperties::TYPE,
                next,
                extension_name: abi::characters(name),
                extension_version: version,
            }
        })?;
        DONE
    })
}

pub(crate) fn create(info: In<xr::InstanceCreateInfo>, instance: Out<xr::Instance>) -> xr::Result {
    enter("xrCreateInstance", On::Nothing, |runtime, note| {
        let info = info.get()?;
        let application = &info.application_info;
        let version = application.api_version;
        let extensions: BTreeSet<String> = nested::extensions(info).into_iter().collect();
        note.set("application", abi::text(&application.application_name));
        note.set("api_version", version.to_string());
        note.set("extensions", &extensions);
        if version.major() != 1 || version.minor() > runtime.script.minor_version {
            return Err(xr::Result::ERROR_API_VERSION_UNSUPPORTED.into());
        }
        let listed = listed(&runtime.script);
        if let Some(unknown) = extensions.iter().find(|&e| !listed.iter().any(|(name, _)| name == e)) {
            return Err(wrong(xr::Result::ERROR_EXTENSION_NOT_PRESENT, format!("{unknown} is not listed")));
        }
        if runtime.objects.iter().any(|(_, object)| matches!(object, Object::Instance(_))) {
            return Err(xr::Result::ERROR_LIMIT_REACHED.into());
        }
        runtime.lost = false;
        runtime.vulkan = Default::default();
        let minor_version = version.minor();
        let object = Object::Instance(Instance { extensions, minor_version, events: VecDeque::new() });
        let handle = runtime.objects.insert(0, object);
        note.set("made", "Instance");
        instance.set(xr::Instance::from_raw(handle))?;
        DONE
    })
}

pub(crate) fn destroy(instance: xr::Instance) -> xr::Result {
    enter("xrDestroyInstance", On::Instance(instance), |runtime, note| {
        runtime.destroy(instance.into_raw(), note)
    })
}

pub(crate) fn properties(instance: xr::Instance, properties: Out<xr::InstanceProperties>) -> xr::Result {
    enter("xrGetInstanceProperties", On::Instance(instance), |_, _| {
        properties.write(|next| xr::InstanceProperties {
            ty: xr::InstanceProperties::TYPE,
            next,
            runtime_version: xr::Version::new(0, 0, 1),
            runtime_name: abi::characters("Scripted test runtime"),
        })?;
        DONE
    })
}

pub(crate) fn get_system(
    instance: xr::Instance,
    info: In<xr::SystemGetInfo>,
    system: Out<xr::SystemId>,
) -> xr::Result {
    enter("xrGetSystem", On::Instance(instance), |_, _| {
        if info.get()?.form_factor != xr::FormFactor::HEAD_MOUNTED_DISPLAY {
            return Err(xr::Result::ERROR_FORM_FACTOR_UNSUPPORTED.into());
        }
        system.set(xr::SystemId::from_raw(SYSTEM))?;
        DONE
    })
}

pub(crate) fn system_properties(
    instance: xr::Instance,
    system: xr::SystemId,
    properties: Out<xr::SystemProperties>,
) -> xr::Result {
    enter("xrGetSystemProperties", On::Instance(instance), |runtime, _| {
        runtime.check_system(system)?;
        if let Some(gaze) = properties.chained::<xr::SystemEyeGazeInteractionPropertiesEXT>()? {
            runtime.needs("XR_EXT_eye_gaze_interaction")?;
            gaze.write(|next| xr::SystemEyeGazeInteractionPropertiesEXT {
                ty: xr::SystemEyeGazeInteractionPropertiesEXT::TYPE,
                next,
                supports_eye_gaze_interaction: runtime.script.eye_tracker.into(),
            })?;
        }
        if let Some(follows) = properties.chained::<xr::SystemFoveatedRenderingPropertiesVARJO>()? {
            runtime.needs("XR_VARJO_foveated_rendering")?;
            follows.write(|next| xr::SystemFoveatedRenderingPropertiesVARJO {
                ty: xr::SystemFoveatedRenderingPropertiesVARJO::TYPE,
                next,
                supports_foveated_rendering: runtime.script.eye_tracker.into(),
            })?;
        }
        if let Some(hands) = properties.chained::<xr::SystemHandTrackingPropertiesEXT>()? {
            runtime.needs("XR_EXT_hand_tracking")?;
            hands.write(|next| xr::SystemHandTrackingPropertiesEXT {
                ty: xr::SystemHandTrackingPropertiesEXT::TYPE,
                next,
                supports_hand_tracking: (!runtime.script.seen_hands.is_empty()).into(),
            })?;
        }
        if let Some(motion) = properties.chained::<xr::SystemSpaceWarpPropertiesFB>()? {
            let [width, height] = runtime.motion_vectors("XR_FB_space_warp")?;
            motion.write(|next| xr::SystemSpaceWarpPropertiesFB {
                ty: xr::SystemSpaceWarpPropertiesFB::TYPE,
                next,
                recommended_motion_vector_image_rect_width: width,
                recommended_motion_vector_image_rect_height: height,
            })?;
        }
        properties.write(|next| xr::SystemProperties {
            ty: xr::SystemProperties::TYPE,
            next,
            system_id: system,
            vendor_id: 0x46_4f_56,
            system_name: abi::characters("Scripted headset"),
            graphics_properties: xr::SystemGraphicsProperties {
                max_swapchain_image_height: 4096,
                max_swapchain_image_width: 4096,
                max_layer_count: 16,
            },
            tracking_properties: xr::SystemTrackingProperties {
                orientation_tracking: xr::TRUE,
                position_tracking: xr::TRUE,
            },
        })?;
        DONE
    })
}

fn name_of(
    call: &'static str,
    instance: xr::Instance,
    name: String,
    to: Out<[c_char; xr::MAX_RESULT_STRING_SIZE]>,
) -> xr::Result {
    enter(call, On::Instance(instance), |_, _| {
        to.set(abi::characters(&name))?;
        DONE
    })
}

pub(crate) fn result_to_string(instance: xr::Instance, value: xr::Result, buffer: Out<c_char>) -> xr::Result {
    name_of("xrResultToString", instance, format!("XR_{value:?}"), buffer.array())
}

pub(crate) fn type_to_string(
    instance: xr::Instance,
    value: xr::StructureType,
    buffer: Out<c_char>,
) -> xr::Result {
    name_of("xrStructureTypeToString", instance, format!("XR_TYPE_{value:?}"), buffer.array())
}

pub(crate) fn string_to_path(instance: xr::Instance, text: In<c_char>, path: Out<xr::Path>) -> xr::Result {
    enter("xrStringToPath", On::Instance(instance), |runtime, note| {
        let text = text.text()?;
        note.set("path", &text);
        let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_./".contains(c);
        if !text.starts_with('/') || text.len() < 2 || text.ends_with('/') || !text.chars().all(allowed) {
            return Err(wrong(xr::Result::ERROR_PATH_FORMAT_INVALID, format!("{text} is no path")));
        }
        let known = runtime.paths.iter().position(|path| *path == text);
        let index = known.unwrap_or_else(|| {
            runtime.paths.push(text);
            runtime.paths.len() - 1
        });
        path.set(xr::Path::from_raw(index as u64 + 1))?;
        DONE
    })
}

pub(crate) fn path_to_string(
    instance: xr::Instance,
    path: xr::Path,
    capacity: u32,
    count: Out<u32>,
    buffer: Out<c_char>,
) -> xr::Result {
    enter("xrPathToString", On::Instance(instance), |runtime, _| {
        let text = runtime.path(path)?;
        let characters = text.bytes().chain([0]).map(|byte| byte as c_char).collect();
        buffer.fill(capacity, count, characters)?;
        DONE
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_vectors_are_listed_where_they_are_scripted() {
        let motion = |script: &Script| {
            let of_motion = |(name, _): &(&str, u32)| name.ends_with("synthesis") || name.ends_with("warp");
            listed(script).into_iter().filter(of_motion).collect::<Vec<_>>()
        };
        assert_eq!(motion(&Script::default()), []);
        let script = Script { motion_vectors: Some([24, 20]), ..Script::default() };
        assert_eq!(motion(&script), [("XR_EXT_frame_synthesis", 1), ("XR_FB_space_warp", 2)]);
        let script = Script { without: vec!["XR_EXT_frame_synthesis".into()], ..script };
        assert_eq!(motion(&script), [("XR_FB_space_warp", 2)]);
    }
}
