//! Where the eyes look, from XR_EXT_eye_gaze_interaction.
#![allow(unsafe_code)]

use glam::DVec3;
use openxr as xr;
use xr::sys;

use super::convert;
use super::fault::{Called, Outcome};
use crate::headset::Gaze;

/// The eye tracker of a session.
pub struct EyeTracker {
    set: xr::ActionSet,
    action: xr::Action<xr::Posef>,
    space: xr::Space,
}

/// Whether the headset has an eye tracker that the runtime lends.
pub fn supported(instance: &xr::Instance, system: xr::SystemId) -> bool {
    if instance.exts().ext_eye_gaze_interaction.is_none() {
        return false;
    }
    let mut gaze = sys::SystemEyeGazeInteractionPropertiesEXT {
        ty: sys::SystemEyeGazeInteractionPropertiesEXT::TYPE,
        next: std::ptr::null_mut(),
        supports_eye_gaze_interaction: sys::FALSE,
    };
    let mut system_properties = sys::SystemProperties::out((&raw mut gaze).cast());
    // SAFETY: both structs are of the types that they say, and live until the call returns; the
    // extension that the second belongs to is enabled.
    let code = unsafe {
        (instance.fp().get_system_properties)(instance.as_raw(), system, system_properties.as_mut_ptr())
    };
    code == sys::Result::SUCCESS && gaze.supports_eye_gaze_interaction == sys::TRUE
}

impl EyeTracker {
    /// Makes the action; its set is still to be attached. `None` where the runtime refuses the binding.
    ///
    /// # Errors
    /// Where session or runtime are lost.
    pub fn new(instance: &xr::Instance, session: &xr::Session<xr::Vulkan>) -> Outcome<Option<EyeTracker>> {
        let set = instance.create_action_set("eyes", "Where the eyes look", 0).called("xrCreateActionSet")?;
        let action = set.create_action("gaze", "Gaze", &[]).called("xrCreateAction")?;
        let path = |path: &str| instance.string_to_path(path).called("xrStringToPath");
        let profile = path("/interaction_profiles/ext/eye_gaze_interaction")?;
        let binding = xr::Binding::new(&action, path("/user/eyes_ext/input/gaze_ext/pose")?);
        if instance.suggest_interaction_profile_bindings(profile, &[binding]).is_err() {
            return Ok(None);
        }
        let space = action
            .create_space(session, xr::Path::NULL, xr::Posef::IDENTITY)
            .called("xrCreateActionSpace")?;
        Ok(Some(EyeTracker { set, action, space }))
    }

    /// The set, to be attached and synchronised.
    pub fn set(&self) -> &xr::ActionSet {
        &self.set
    }

    /// The newest look of the tracker for a display time.
    ///
    /// # Errors
    /// Where session or runtime are lost.
    pub fn look(&self, session: &xr::Session<xr::Vulkan>, base: &xr::Space, time: xr::Time) -> Outcome<Gaze> {
        let unseen = Gaze::unseen(time.as_nanos());
        if !self.action.is_active(session, xr::Path::NULL).called("xrGetActionStatePose")? {
            return Ok(unseen);
        }
        let mut sample = sys::EyeGazeSampleTimeEXT {
            ty: sys::EyeGazeSampleTimeEXT::TYPE,
            next: std::ptr::null_mut(),
            time: xr::Time::from_nanos(0),
        };
        let mut location = sys::SpaceLocation {
            ty: sys::SpaceLocation::TYPE,
            next: (&raw mut sample).cast(),
            location_flags: sys::SpaceLocationFlags::EMPTY,
            pose: xr::Posef::IDENTITY,
        };
        // SAFETY: both spaces are of this session and alive; both structs are of the types that they say
        // and live until the call returns; the extension that the second belongs to is enabled.
        let code = unsafe {
            (session.instance().fp().locate_space)(self.space.as_raw(), base.as_raw(), time, &mut location)
        };
        match code {
            sys::Result::SUCCESS => {}
            sys::Result::ERROR_TIME_INVALID => return Ok(unseen),
            code => return Err(super::fault::Fault::of("xrLocateSpace", code)),
        }
        let direction = convert::pose(&location.pose).rotation * DVec3::NEG_Z;
        let valid = location.location_flags.contains(sys::SpaceLocationFlags::ORIENTATION_VALID);
        // Runtimes that do not fill the sample's time mean the time that they were asked for.
        let time = if sample.time.as_nanos() > 0 { sample.time } else { time };
        Ok(Gaze { time: time.as_nanos(), direction, valid })
    }
}
