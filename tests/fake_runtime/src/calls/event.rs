//! Events.

use openxr_sys::{self as xr, Handle};

use crate::abi::Out;
use crate::objects::Queued;
use crate::order::State;
use crate::refusal::Outcome;
use crate::runtime::{On, enter, now};
use crate::script::EventKind;

const DONE: Outcome = Ok(xr::Result::SUCCESS);

pub(crate) fn poll_event(instance: xr::Instance, event: Out<xr::EventDataBuffer>) -> xr::Result {
    let next = std::ptr::null();
    enter("xrPollEvent", On::Instance(instance), |runtime, note| {
        let Some(queued) = runtime.next_event() else {
            return Ok(xr::Result::EVENT_UNAVAILABLE);
        };
        note.set("event", format!("{queued:?}"));
        let time = xr::Time::from_nanos(now());
        match queued {
            // A session that is gone has no more events.
            Queued::State(session, _) | Queued::ProfileChanged(session) | Queued::Scripted(session, ..)
                if runtime.session(session).is_err() =>
            {
                return Ok(xr::Result::EVENT_UNAVAILABLE);
            }
            Queued::State(session, state) => {
                note.set("state", state);
                runtime.session(session)?.told = state;
                let session = xr::Session::from_raw(session);
                let ty = xr::EventDataSessionStateChanged::TYPE;
                event.event(xr::EventDataSessionStateChanged {
                    ty,
                    next,
                    session,
                    state: state.raw(),
                    time,
                })?;
                if state == State::Exiting {
                    note.set("last", true);
                }
            }
            Queued::ProfileChanged(session) => {
                let ty = xr::EventDataInteractionProfileChanged::TYPE;
                let session = xr::Session::from_raw(session);
                event.event(xr::EventDataInteractionProfileChanged { ty, next, session })?;
            }
            Queued::Scripted(_, EventKind::InstanceLossPending, _) => {
                let ty = xr::EventDataInstanceLossPending::TYPE;
                event.event(xr::EventDataInstanceLossPending { ty, next, loss_time: time })?;
            }
            Queued::Scripted(session, EventKind::VisibilityMask { view, .. }, configuration) => {
                runtime.needs("XR_KHR_visibility_mask").map_err(|_| xr::Result::EVENT_UNAVAILABLE)?;
                event.event(xr::EventDataVisibilityMaskChangedKHR {
                    ty: xr::EventDataVisibilityMaskChangedKHR::TYPE,
                    next,
                    session: xr::Session::from_raw(session),
                    view_configuration_type: configuration,
                    view_index: view,
                })?;
            }
            Queued::Scripted(_, EventKind::ViewSize { .. }, _) => return Ok(xr::Result::EVENT_UNAVAILABLE),
            Queued::Scripted(session, EventKind::Recentred, _) => {
                let origin = runtime.session(session)?.origin;
                event.event(xr::EventDataReferenceSpaceChangePending {
                    ty: xr::EventDataReferenceSpaceChangePending::TYPE,
                    next,
                    session: xr::Session::from_raw(session),
                    reference_space_type: xr::ReferenceSpaceType::LOCAL,
                    change_time: time,
                    pose_valid: true.into(),
                    pose_in_previous_space: origin.to_xr(),
                })?;
            }
            Queued::Scripted(session, EventKind::RefreshRate(rate), _) => {
                runtime.needs("XR_FB_display_refresh_rate").map_err(|_| xr::Result::EVENT_UNAVAILABLE)?;
                let from = std::mem::replace(&mut runtime.session(session)?.refresh_rate, rate);
                event.event(xr::EventDataDisplayRefreshRateChangedFB {
                    ty: xr::EventDataDisplayRefreshRateChangedFB::TYPE,
                    next,
                    from_display_refresh_rate: from,
                    to_display_refresh_rate: rate,
                })?;
            }
        }
        DONE
    })
}
