//! Insets that follow the eyes, by XR_VARJO_foveated_rendering: as long as the runtime sees the eyes it is asked for
//! fields of view that lie where they look.
#![allow(unsafe_code)]

use glam::DVec3;
use openxr as xr;
use xr::sys;

use super::convert;
use super::fault::Notes;
use crate::headset::Gaze;

/// Whether the headset has insets that can follow the eyes.
pub fn supported(instance: &xr::Instance, system: xr::SystemId) -> bool {
    if instance.exts().varjo_foveated_rendering.is_none() {
        return false;
    }
    let mut follows = sys::SystemFoveatedRenderingPropertiesVARJO {
        ty: sys::SystemFoveatedRenderingPropertiesVARJO::TYPE,
        next: std::ptr::null_mut(),
        supports_foveated_rendering: sys::FALSE,
    };
    let mut system_properties = sys::SystemProperties::out((&raw mut follows).cast());
    // SAFETY: both structs are of the types that they say, and live until the call returns; the extension that the
    // second belongs to is enabled.
    let code = unsafe {
        (instance.fp().get_system_properties)(instance.as_raw(), system, system_properties.as_mut_ptr())
    };
    code == sys::Result::SUCCESS && follows.supports_foveated_rendering == sys::TRUE
}

/// The views of a configuration, with the sizes that are recommended where insets follow the eyes.
pub fn views(
    instance: &xr::Instance,
    system: xr::SystemId,
    kind: xr::ViewConfigurationType,
) -> xr::Result<Vec<xr::ViewConfigurationView>> {
    let mut views = instance.enumerate_view_configuration_views(system, kind)?;
    let follows = sys::FoveatedViewConfigurationViewVARJO {
        ty: sys::FoveatedViewConfigurationViewVARJO::TYPE,
        next: std::ptr::null_mut(),
        foveated_rendering_active: sys::TRUE,
    };
    let mut asks = vec![follows; views.len()];
    // SAFETY: a structure of plain numbers and a pointer.
    let blank: sys::ViewConfigurationView = unsafe { std::mem::zeroed() };
    let mut told: Vec<_> = asks
        .iter_mut()
        .map(|ask| sys::ViewConfigurationView {
            ty: sys::ViewConfigurationView::TYPE,
            next: (&raw mut *ask).cast(),
            ..blank
        })
        .collect();
    let mut count = 0;
    // SAFETY: there are as many views as the capacity says, each with a structure that is chained to it; all live
    // until the call returns. The extension that those belong to is enabled.
    let code = unsafe {
        let ask = instance.fp().enumerate_view_configuration_views;
        ask(instance.as_raw(), system, kind, told.len() as u32, &mut count, told.as_mut_ptr())
    };
    if code != sys::Result::SUCCESS {
        return Err(code);
    }
    for (view, told) in views.iter_mut().zip(&told) {
        view.recommended_image_rect_width = told.recommended_image_rect_width;
        view.recommended_image_rect_height = told.recommended_image_rect_height;
    }
    Ok(views)
}

/// The eyes of a session whose insets follow them.
pub struct Followed {
    eyes: xr::Space,
}

impl Followed {
    /// Asks for the eyes; `None` where they are refused, which is noted. A loss is told by the next call.
    pub fn new(session: &xr::Session<xr::Vulkan>, notes: &mut Notes) -> Option<Followed> {
        let kind = xr::ReferenceSpaceType::COMBINED_EYE_VARJO;
        match session.create_reference_space(kind, xr::Posef::IDENTITY) {
            Ok(eyes) => Some(Followed { eyes }),
            Err(code) => {
                notes.note(format!(
                    "xrCreateReferenceSpace failed ({code:?}): the insets do not follow the eyes"
                ));
                None
            }
        }
    }

    /// Where the eyes look at a time; not valid where the runtime does not see them, or does not let them be seen.
    pub fn look(&self, base: &xr::Space, time: xr::Time) -> Gaze {
        let unseen = Gaze::unseen(time.as_nanos());
        let Ok(location) = self.eyes.locate(base, time) else { return unseen };
        let flags = xr::SpaceLocationFlags::ORIENTATION_VALID | xr::SpaceLocationFlags::ORIENTATION_TRACKED;
        let direction = convert::pose(&location.pose).rotation * DVec3::NEG_Z;
        Gaze { direction, valid: location.location_flags.contains(flags), ..unseen }
    }

    /// Where so many views are at a time, and what they see: the insets where the eyes look, as long as they are seen.
    pub fn locate(
        &self,
        session: &xr::Session<xr::Vulkan>,
        kind: xr::ViewConfigurationType,
        (base, time): (&xr::Space, xr::Time),
        count: usize,
    ) -> xr::Result<(xr::ViewStateFlags, Vec<xr::View>)> {
        let follows = sys::ViewLocateFoveatedRenderingVARJO {
            ty: sys::ViewLocateFoveatedRenderingVARJO::TYPE,
            next: std::ptr::null(),
            foveated_rendering_active: self.look(base, time).valid.into(),
        };
        let info = sys::ViewLocateInfo {
            ty: sys::ViewLocateInfo::TYPE,
            next: (&raw const follows).cast(),
            view_configuration_type: kind,
            display_time: time,
            space: base.as_raw(),
        };
        let mut state = sys::ViewState {
            ty: sys::ViewState::TYPE,
            next: std::ptr::null_mut(),
            view_state_flags: sys::ViewStateFlags::EMPTY,
        };
        let blank = sys::View {
            ty: sys::View::TYPE,
            next: std::ptr::null_mut(),
            pose: xr::Posef::IDENTITY,
            fov: xr::Fovf::default(),
        };
        let (mut views, mut told) = (vec![blank; count], 0);
        // SAFETY: all structs are of the types that they say, there are as many views as the capacity says, and all
        // live until the call returns; the extension that the chained one belongs to is enabled; session and space
        // are alive.
        let code = unsafe {
            let locate = session.instance().fp().locate_views;
            locate(session.as_raw(), &info, &mut state, count as u32, &mut told, views.as_mut_ptr())
        };
        if code.into_raw() < 0 {
            return Err(code);
        }
        let view = |view: &sys::View| xr::View { pose: view.pose, fov: view.fov };
        Ok((state.view_state_flags, views.iter().take(told as usize).map(view).collect()))
    }
}
