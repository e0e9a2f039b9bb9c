//! Hands that are seen, from XR_EXT_hand_tracking.

use openxr as xr;

use super::convert;
use super::fault::{Called, Outcome};
use crate::headset::locomotion::Hands;
use crate::math::hand::{self, Joint, Joints, PALM};

/// Profiles of hands without controllers: their own one, and the one that runtimes without it have instead.
const BARE: [&str; 2] =
    ["/interaction_profiles/ext/hand_interaction_ext", "/interaction_profiles/khr/simple_controller"];
/// Thinner and thicker joints than these, in metres, are none of a hand's.
const THINNEST: f64 = 1e-3;
const THICKEST: f64 = 0.1;

/// The trackers of both hands.
pub struct HandTrackers {
    trackers: [xr::HandTracker; 2],
    users: [xr::Path; 2],
    bare: Vec<xr::Path>,
    closed: [bool; 2],
}

impl HandTrackers {
    /// Trackers of the left and the right hand; `None` where the headset does not see hands.
    ///
    /// # Errors
    /// Where the runtime refuses, though it says that it does.
    pub fn new(
        instance: &xr::Instance,
        system: xr::SystemId,
        session: &xr::Session<xr::Vulkan>,
    ) -> Outcome<Option<HandTrackers>> {
        if instance.exts().ext_hand_tracking.is_none()
            || !instance.supports_hand_tracking(system).called("xrGetSystemProperties")?
        {
            return Ok(None);
        }
        let tracker = |hand| session.create_hand_tracker(hand).called("xrCreateHandTrackerEXT");
        let path = |path: &str| instance.string_to_path(path).called("xrStringToPath");
        Ok(Some(HandTrackers {
            trackers: [tracker(xr::Hand::LEFT)?, tracker(xr::Hand::RIGHT)?],
            users: [path("/user/hand/left")?, path("/user/hand/right")?],
            bare: BARE.iter().map(|profile| path(profile)).collect::<Outcome<_>>()?,
            closed: [false; 2],
        }))
    }

    /// Adds hands that are seen at a time to what their actions say. A hand that holds a controller is left to that, even
    /// where the runtime guesses its fingers. A closed hand seizes; one without a grip does so by its palm.
    ///
    /// # Errors
    /// Where session or runtime are lost.
    pub fn see(
        &mut self,
        session: &xr::Session<xr::Vulkan>,
        base: &xr::Space,
        time: xr::Time,
        hands: &mut Hands,
    ) -> Outcome<()> {
        for hand in 0..2 {
            let profile = session.current_interaction_profile(self.users[hand]);
            let profile = profile.called("xrGetCurrentInteractionProfile")?;
            if profile != xr::Path::NULL && !self.bare.contains(&profile) {
                self.closed[hand] = false;
                continue;
            }
            let located = base.locate_hand_joints(&self.trackers[hand], time);
            let located = match located {
                Err(xr::sys::Result::ERROR_TIME_INVALID) => None,
                located => located.called("xrLocateHandJointsEXT")?,
            };
            let joints = located.as_ref().and_then(joints);
            self.closed[hand] = joints.as_ref().is_some_and(|joints| hand::grasps(joints, self.closed[hand]));
            hands.joints[hand] = joints;
            hands.grips[hand] = hands.grips[hand].or(joints.map(|joints| joints[PALM].pose));
            hands.squeezes[hand] |= self.closed[hand];
        }
        Ok(())
    }
}

/// A hand's joints, where all of them are known.
fn joints(located: &xr::HandJointLocations) -> Option<Joints> {
    let valid = xr::SpaceLocationFlags::ORIENTATION_VALID | xr::SpaceLocationFlags::POSITION_VALID;
    let is_known = |joint: &xr::HandJointLocation| {
        let xr::Vector3f { x, y, z } = joint.pose.position;
        joint.location_flags.contains(valid) && [x, y, z, joint.radius].iter().all(|v| v.is_finite())
    };
    if !located.iter().all(is_known) {
        return None;
    }
    Some(located.map(|joint| Joint {
        pose: convert::pose(&joint.pose),
        radius: f64::from(joint.radius).clamp(THINNEST, THICKEST),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hands_are_known_as_a_whole_or_not_at_all() {
        let valid = xr::SpaceLocationFlags::ORIENTATION_VALID | xr::SpaceLocationFlags::POSITION_VALID;
        let joint = xr::HandJointLocation { location_flags: valid, pose: xr::Posef::IDENTITY, radius: 0.01 };
        let all = [joint; xr::HAND_JOINT_COUNT];
        assert!(joints(&all).unwrap().iter().all(|joint| (joint.radius - 0.01).abs() < 1e-8));
        let with = |odd: xr::HandJointLocation| {
            let mut all = all;
            all[17] = odd;
            joints(&all)
        };
        let unplaced = xr::SpaceLocationFlags::ORIENTATION_VALID;
        assert!(with(xr::HandJointLocation { location_flags: unplaced, ..joint }).is_none());
        assert!(with(xr::HandJointLocation { radius: f32::NAN, ..joint }).is_none());
        let mut lost = joint;
        lost.pose.position.y = f32::INFINITY;
        assert!(with(lost).is_none());
        let radius = |radius: f32| with(xr::HandJointLocation { radius, ..joint }).unwrap()[17].radius;
        assert_eq!([radius(0.0), radius(-1.0), radius(7.0)], [THINNEST, THINNEST, THICKEST]);
    }
}
