//! Hands whose joints are seen.

use openxr_sys::{self as xr, Handle};

use crate::abi::{In, Out};
use crate::check::check_time;
use crate::objects::Object;
use crate::refusal::{Outcome, invalid, wrong};
use crate::runtime::{On, enter};
use crate::world;

const DONE: Outcome = Ok(xr::Result::SUCCESS);

pub(crate) fn create(
    session: xr::Session,
    info: In<xr::HandTrackerCreateInfoEXT>,
    tracker: Out<xr::HandTrackerEXT>,
) -> xr::Result {
    enter("xrCreateHandTrackerEXT", On::Session(session), |runtime, note| {
        runtime.needs("XR_EXT_hand_tracking")?;
        let info = info.get()?;
        if info.hand_joint_set != xr::HandJointSetEXT::DEFAULT {
            return Err(wrong(xr::Result::ERROR_VALIDATION_FAILURE, "there is no such set of joints"));
        }
        if runtime.script.seen_hands.is_empty() {
            return Err(xr::Result::ERROR_FEATURE_UNSUPPORTED.into());
        }
        let left = info.hand == xr::HandEXT::LEFT;
        note.set("left", left);
        note.set("made", "HandTracker");
        let handle = runtime.objects.insert(session.into_raw(), Object::HandTracker { left });
        tracker.set(xr::HandTrackerEXT::from_raw(handle))?;
        DONE
    })
}

pub(crate) fn destroy(tracker: xr::HandTrackerEXT) -> xr::Result {
    enter("xrDestroyHandTrackerEXT", On::HandTracker(tracker), |runtime, note| {
        runtime.destroy(tracker.into_raw(), note)
    })
}

pub(crate) fn locate(
    tracker: xr::HandTrackerEXT,
    info: In<xr::HandJointsLocateInfoEXT>,
    locations: Out<xr::HandJointLocationsEXT>,
) -> xr::Result {
    enter("xrLocateHandJointsEXT", On::HandTracker(tracker), |runtime, note| {
        let info = info.get()?;
        let handle = tracker.into_raw();
        let session = runtime.session_of(handle).ok_or_else(|| invalid("the tracker has no session"))?;
        let Some(&Object::HandTracker { left }) = runtime.objects.get(handle) else {
            return Err(invalid("there is no such tracker"));
        };
        note.set("left", left);
        note.set("time", info.time.as_nanos());
        let time = check_time(info.time)?;
        let base = runtime.in_local(session, info.base_space.into_raw(), time)?;
        let (head, frame) = (runtime.head(session, time)?, runtime.session(session)?.latest.number);
        let seen = world::joints(&runtime.script.seen_hands, &runtime.script.hands, left, frame);
        note.set("seen", seen.is_some());
        use xr::SpaceLocationFlags as Flags;
        let location_flags = Flags::ORIENTATION_VALID
            | Flags::POSITION_VALID
            | Flags::ORIENTATION_TRACKED
            | Flags::POSITION_TRACKED;
        let located = base.zip(seen).map(|(base, joints)| {
            joints.map(|(joint, radius)| {
                let pose = base.inverse().then(head).then(joint).to_xr();
                xr::HandJointLocationEXT { location_flags, pose, radius }
            })
        });
        locations.joints(located)?;
        DONE
    })
}
