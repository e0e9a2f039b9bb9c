//! View configurations.

use openxr_sys::{self as xr};

use crate::abi::{self, Out};
use crate::refusal::{Outcome, invalid};
use crate::runtime::{On, enter};

const DONE: Outcome = Ok(xr::Result::SUCCESS);

pub(crate) fn enumerate_view_configurations(
    instance: xr::Instance,
    system: xr::SystemId,
    capacity: u32,
    count: Out<u32>,
    types: Out<xr::ViewConfigurationType>,
) -> xr::Result {
    enter("xrEnumerateViewConfigurations", On::Instance(instance), |runtime, _| {
        runtime.check_system(system)?;
        let mut offered = Vec::new();
        // The runtime's favourite comes first.
        if runtime.offers_insets() {
            offered.push(xr::ViewConfigurationType::PRIMARY_STEREO_WITH_FOVEATED_INSET);
        }
        offered.push(xr::ViewConfigurationType::PRIMARY_STEREO);
        types.fill(capacity, count, offered)?;
        DONE
    })
}

pub(crate) fn view_configuration_properties(
    instance: xr::Instance,
    system: xr::SystemId,
    configuration: xr::ViewConfigurationType,
    properties: Out<xr::ViewConfigurationProperties>,
) -> xr::Result {
    enter("xrGetViewConfigurationProperties", On::Instance(instance), |runtime, _| {
        runtime.check_system(system)?;
        runtime.views(configuration)?;
        properties.write(|next| xr::ViewConfigurationProperties {
            ty: xr::ViewConfigurationProperties::TYPE,
            next,
            view_configuration_type: configuration,
            fov_mutable: xr::TRUE,
        })?;
        DONE
    })
}

pub(crate) fn enumerate_views(
    instance: xr::Instance,
    system: xr::SystemId,
    configuration: xr::ViewConfigurationType,
    capacity: u32,
    count: Out<u32>,
    views: Out<xr::ViewConfigurationView>,
) -> xr::Result {
    enter("xrEnumerateViewConfigurationViews", On::Instance(instance), |runtime, _| {
        runtime.check_system(system)?;
        let all: Vec<_> = runtime.views(configuration)?.into_iter().enumerate().collect();
        let filled = capacity.min(all.len() as u32);
        let following = runtime.script.following_insets;
        views.fill_typed(capacity, count, all, |next, (index, view)| {
            let asks = abi::chained_out::<xr::FoveatedViewConfigurationViewVARJO>(next);
            let follows = asks.is_some_and(|asks| asks.foveated_rendering_active == xr::TRUE) && index >= 2;
            let size = following.filter(|_| follows).unwrap_or(view.size);
            xr::ViewConfigurationView {
                ty: xr::ViewConfigurationView::TYPE,
                next,
                recommended_image_rect_width: size[0],
                max_image_rect_width: 4096,
                recommended_image_rect_height: size[1],
                max_image_rect_height: 4096,
                recommended_swapchain_sample_count: 1,
                max_swapchain_sample_count: 1,
            }
        })?;
        for motion in views.chained_each::<xr::FrameSynthesisConfigViewEXT>(filled)? {
            let [width, height] = runtime.motion_vectors("XR_EXT_frame_synthesis")?;
            motion.write(|next| xr::FrameSynthesisConfigViewEXT {
                ty: xr::FrameSynthesisConfigViewEXT::TYPE,
                next,
                recommended_motion_vector_image_rect_width: width,
                recommended_motion_vector_image_rect_height: height,
            })?;
        }
        DONE
    })
}

pub(crate) fn enumerate_blend_modes(
    instance: xr::Instance,
    system: xr::SystemId,
    configuration: xr::ViewConfigurationType,
    capacity: u32,
    count: Out<u32>,
    modes: Out<xr::EnvironmentBlendMode>,
) -> xr::Result {
    enter("xrEnumerateEnvironmentBlendModes", On::Instance(instance), |runtime, _| {
        runtime.check_system(system)?;
        if runtime.views(configuration)?.is_empty() {
            return Err(invalid("the configuration has no views"));
        }
        modes.fill(capacity, count, vec![xr::EnvironmentBlendMode::OPAQUE])?;
        DONE
    })
}
