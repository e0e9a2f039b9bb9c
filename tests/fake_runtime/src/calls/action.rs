//! Actions: bindings, what is pressed, where the eyes look.

use std::collections::BTreeSet;
use std::ffi::c_char;

use openxr_sys::{self as xr, Handle};

use crate::abi::{self, In, Out};
use crate::nested;
use crate::objects::{Action, Object, Queued};
use crate::order::State;
use crate::profiles;
use crate::refusal::{Outcome, Refusal, invalid, wrong};
use crate::runtime::{On, Runtime, enter};

const DONE: Outcome = Ok(xr::Result::SUCCESS);

pub(crate) fn create_set(
    instance: xr::Instance,
    info: In<xr::ActionSetCreateInfo>,
    set: Out<xr::ActionSet>,
) -> xr::Result {
    enter("xrCreateActionSet", On::Instance(instance), |runtime, note| {
        check_name(&abi::text(&info.get()?.action_set_name))?;
        let object = Object::ActionSet { attached: false };
        let handle = runtime.objects.insert(instance.into_raw(), object);
        note.set("made", "ActionSet");
        set.set(xr::ActionSet::from_raw(handle))?;
        DONE
    })
}

pub(crate) fn destroy_set(set: xr::ActionSet) -> xr::Result {
    enter("xrDestroyActionSet", On::ActionSet(set), |runtime, note| runtime.destroy(set.into_raw(), note))
}

pub(crate) fn create(
    set: xr::ActionSet,
    info: In<xr::ActionCreateInfo>,
    action: Out<xr::Action>,
) -> xr::Result {
    enter("xrCreateAction", On::ActionSet(set), |runtime, note| {
        let info = info.get()?;
        let name = abi::text(&info.action_name);
        check_name(&name)?;
        note.set("name", &name);
        if matches!(runtime.objects.get(set.into_raw()), Some(Object::ActionSet { attached: true })) {
            return Err(attached_already());
        }
        let object = Action { set: set.into_raw(), kind: info.action_type, bindings: Vec::new(), name };
        let handle = runtime.objects.insert(set.into_raw(), Object::Action(object));
        note.set("made", "Action");
        action.set(xr::Action::from_raw(handle))?;
        DONE
    })
}

pub(crate) fn destroy(action: xr::Action) -> xr::Result {
    enter("xrDestroyAction", On::Action(action), |runtime, note| runtime.destroy(action.into_raw(), note))
}

pub(crate) fn suggest(
    instance: xr::Instance,
    info: In<xr::InteractionProfileSuggestedBinding>,
) -> xr::Result {
    enter("xrSuggestInteractionProfileBindings", On::Instance(instance), |runtime, note| {
        let info = info.get()?;
        let profile = runtime.path(info.interaction_profile)?.to_string();
        note.set("profile", &profile);
        if profile == profiles::EYES {
            runtime.needs("XR_EXT_eye_gaze_interaction")?;
        }
        if !profiles::known(&profile) {
            return Err(xr::Result::ERROR_PATH_UNSUPPORTED.into());
        }
        if nested::bindings(info).is_empty() {
            return Err(invalid(format!("{profile} without bindings")));
        }
        let mut paths = Vec::new();
        for binding in nested::bindings(info) {
            let path = runtime.path(binding.binding)?.to_string();
            if runtime.script.without_paths.iter().any(|end| path.ends_with(end)) {
                return Err(xr::Result::ERROR_PATH_UNSUPPORTED.into());
            }
            if !profiles::has(&profile, &path) {
                return Err(wrong(xr::Result::ERROR_PATH_UNSUPPORTED, format!("{path} is not of {profile}")));
            }
            let handle = binding.action.into_raw();
            let set = runtime.action(handle)?.set;
            if matches!(runtime.objects.get(set), Some(Object::ActionSet { attached: true })) {
                return Err(attached_already());
            }
            paths.push((handle, path));
        }
        note.set("bindings", paths.iter().map(|(_, path)| path).collect::<Vec<_>>());
        // A later suggestion replaces an earlier one of the same profile.
        for (_, object) in runtime.objects.iter_mut() {
            if let Object::Action(action) = object {
                action.bindings.retain(|(of, _)| *of != profile);
            }
        }
        for (handle, path) in paths {
            if let Some(Object::Action(action)) = runtime.objects.get_mut(handle) {
                action.bindings.push((profile.clone(), path));
            }
        }
        DONE
    })
}

pub(crate) fn attach(session: xr::Session, info: In<xr::SessionActionSetsAttachInfo>) -> xr::Result {
    enter("xrAttachSessionActionSets", On::Session(session), |runtime, _| {
        let sets: BTreeSet<u64> =
            nested::attached_sets(info.get()?).iter().map(|set| set.into_raw()).collect();
        let handle = session.into_raw();
        if runtime.session(handle)?.action_sets.is_some() {
            return Err(attached_already());
        }
        for &set in &sets {
            match runtime.objects.get_mut(set) {
                Some(Object::ActionSet { attached }) => *attached = true,
                _ => return Err(wrong(xr::Result::ERROR_HANDLE_INVALID, format!("no ActionSet {set}"))),
            }
        }
        runtime.session(handle)?.action_sets = Some(sets);
        runtime.queue(Queued::ProfileChanged(handle));
        DONE
    })
}

pub(crate) fn sync(session: xr::Session, info: In<xr::ActionsSyncInfo>) -> xr::Result {
    enter("xrSyncActions", On::Session(session), |runtime, _| {
        let sets = nested::active_sets(info.get()?);
        let session = runtime.session(session.into_raw())?;
        let attached = session.action_sets.clone().unwrap_or_default();
        let sets: BTreeSet<u64> = sets.iter().map(|active| active.action_set.into_raw()).collect();
        if !sets.is_subset(&attached) {
            return Err(wrong(
                xr::Result::ERROR_ACTIONSET_NOT_ATTACHED,
                "an action set is synchronised that the session does not have",
            ));
        }
        if session.state != State::Focused {
            session.synced.clear();
            return Ok(xr::Result::SESSION_NOT_FOCUSED);
        }
        session.synced = sets;
        session.sync_frames = (session.sync_frames.1, session.latest.number);
        DONE
    })
}

pub(crate) fn current_profile(
    session: xr::Session,
    user: xr::Path,
    state: Out<xr::InteractionProfileState>,
) -> xr::Result {
    enter("xrGetCurrentInteractionProfile", On::Session(session), |runtime, _| {
        let hand = runtime.path(user)?.starts_with("/user/hand/");
        if runtime.session(session.into_raw())?.action_sets.is_none() {
            return Err(wrong(xr::Result::ERROR_ACTIONSET_NOT_ATTACHED, "no action sets are attached"));
        }
        let profile = runtime.script.profile.clone().filter(|_| hand);
        let known = profile.and_then(|profile| runtime.paths.iter().position(|path| *path == profile));
        let interaction_profile = known.map_or(xr::Path::NULL, |index| xr::Path::from_raw(index as u64 + 1));
        let ty = xr::InteractionProfileState::TYPE;
        state.write(|next| xr::InteractionProfileState { ty, next, interaction_profile })?;
        DONE
    })
}

pub(crate) fn bound_sources(
    session: xr::Session,
    _info: In<xr::BoundSourcesForActionEnumerateInfo>,
    _capacity: u32,
    count: Out<u32>,
    _sources: Out<xr::Path>,
) -> xr::Result {
    enter("xrEnumerateBoundSourcesForAction", On::Session(session), |_, _| {
        count.set(0)?;
        DONE
    })
}

pub(crate) fn localized_name(
    session: xr::Session,
    _info: In<xr::InputSourceLocalizedNameGetInfo>,
    capacity: u32,
    count: Out<u32>,
    buffer: Out<c_char>,
) -> xr::Result {
    enter("xrGetInputSourceLocalizedName", On::Session(session), |_, _| {
        buffer.fill(capacity, count, vec![0])?;
        DONE
    })
}

pub(crate) fn apply_haptics(
    session: xr::Session,
    info: In<xr::HapticActionInfo>,
    _feedback: In<xr::HapticBaseHeader>,
) -> xr::Result {
    haptics("xrApplyHapticFeedback", session, info)
}

pub(crate) fn stop_haptics(session: xr::Session, info: In<xr::HapticActionInfo>) -> xr::Result {
    haptics("xrStopHapticFeedback", session, info)
}

fn haptics(call: &'static str, session: xr::Session, info: In<xr::HapticActionInfo>) -> xr::Result {
    enter(call, On::Session(session), |runtime, _| {
        let action = runtime.action(info.get()?.action.into_raw())?;
        if action.kind != xr::ActionType::VIBRATION_OUTPUT {
            return Err(wrong(xr::Result::ERROR_ACTION_TYPE_MISMATCH, "the action is no vibration"));
        }
        DONE
    })
}

fn attached_already() -> Refusal {
    wrong(xr::Result::ERROR_ACTIONSETS_ALREADY_ATTACHED, "the action sets are attached already")
}

fn check_name(name: &str) -> Result<(), Refusal> {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_.".contains(c);
    if name.is_empty() || !name.chars().all(allowed) {
        return Err(wrong(xr::Result::ERROR_PATH_FORMAT_INVALID, format!("{name:?} is no name")));
    }
    Ok(())
}

impl Runtime {
    pub fn action(&self, handle: u64) -> Result<&Action, Refusal> {
        match self.objects.get(handle) {
            Some(Object::Action(action)) => Ok(action),
            _ => Err(wrong(xr::Result::ERROR_HANDLE_INVALID, format!("there is no Action {handle}"))),
        }
    }
}
