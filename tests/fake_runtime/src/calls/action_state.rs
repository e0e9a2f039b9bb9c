//! What is pressed, and where hands and eyes are.

use openxr_sys::{self as xr, Handle};

use crate::abi::{In, Out};
use crate::objects::Action;
use crate::profiles;
use crate::refusal::{Refusal, wrong};
use crate::runtime::{On, Runtime, enter, now};
use crate::script::{Input, within};
use crate::world::{self, Pose};

/// The state of an input: X and Y, and whether that is new.
#[derive(Clone, Copy, Default)]
struct Value {
    now: [f32; 2],
    changed: bool,
}

/// The value of an action now; nothing where it is not active.
fn state(
    call: &'static str,
    session: xr::Session,
    info: In<xr::ActionStateGetInfo>,
    kind: xr::ActionType,
    answer: impl FnOnce(Option<Value>) -> Result<(), Refusal>,
) -> xr::Result {
    enter(call, On::Session(session), |runtime, note| {
        let info = info.get()?;
        let handle = info.action.into_raw();
        let action = runtime.action(handle)?.clone();
        note.set("action", &action.name);
        if action.kind != kind {
            return Err(wrong(
                xr::Result::ERROR_ACTION_TYPE_MISMATCH,
                format!("{} is no {kind:?}", action.name),
            ));
        }
        let session = session.into_raw();
        if !runtime.session(session)?.action_sets.as_ref().is_some_and(|sets| sets.contains(&action.set)) {
            return Err(wrong(
                xr::Result::ERROR_ACTIONSET_NOT_ATTACHED,
                format!("{} belongs to no attached set", action.name),
            ));
        }
        let value = if kind == xr::ActionType::POSE_INPUT {
            runtime.action_pose(session, handle, info.subaction_path)?.map(|_| Value::default())
        } else {
            runtime.input(session, &action, info.subaction_path)?
        };
        note.set("value", value.map(|value| value.now));
        answer(value)?;
        Ok(xr::Result::SUCCESS)
    })
}

pub(crate) fn get_boolean(
    session: xr::Session,
    info: In<xr::ActionStateGetInfo>,
    out: Out<xr::ActionStateBoolean>,
) -> xr::Result {
    state("xrGetActionStateBoolean", session, info, xr::ActionType::BOOLEAN_INPUT, |value| {
        out.write(|next| xr::ActionStateBoolean {
            ty: xr::ActionStateBoolean::TYPE,
            next,
            current_state: value.is_some_and(|value| value.now[0] > 0.5).into(),
            changed_since_last_sync: value.is_some_and(|value| value.changed).into(),
            last_change_time: xr::Time::from_nanos(now()),
            is_active: value.is_some().into(),
        })
    })
}

pub(crate) fn get_float(
    session: xr::Session,
    info: In<xr::ActionStateGetInfo>,
    out: Out<xr::ActionStateFloat>,
) -> xr::Result {
    state("xrGetActionStateFloat", session, info, xr::ActionType::FLOAT_INPUT, |value| {
        out.write(|next| xr::ActionStateFloat {
            ty: xr::ActionStateFloat::TYPE,
            next,
            current_state: value.map_or(0.0, |value| value.now[0]),
            changed_since_last_sync: value.is_some_and(|value| value.changed).into(),
            last_change_time: xr::Time::from_nanos(now()),
            is_active: value.is_some().into(),
        })
    })
}

pub(crate) fn get_vector(
    session: xr::Session,
    info: In<xr::ActionStateGetInfo>,
    out: Out<xr::ActionStateVector2f>,
) -> xr::Result {
    state("xrGetActionStateVector2f", session, info, xr::ActionType::VECTOR2F_INPUT, |value| {
        let [x, y] = value.unwrap_or_default().now;
        out.write(|next| xr::ActionStateVector2f {
            ty: xr::ActionStateVector2f::TYPE,
            next,
            current_state: xr::Vector2f { x, y },
            changed_since_last_sync: value.is_some_and(|value| value.changed).into(),
            last_change_time: xr::Time::from_nanos(now()),
            is_active: value.is_some().into(),
        })
    })
}

pub(crate) fn get_pose(
    session: xr::Session,
    info: In<xr::ActionStateGetInfo>,
    out: Out<xr::ActionStatePose>,
) -> xr::Result {
    state("xrGetActionStatePose", session, info, xr::ActionType::POSE_INPUT, |value| {
        out.write(|next| xr::ActionStatePose {
            ty: xr::ActionStatePose::TYPE,
            next,
            is_active: value.is_some().into(),
        })
    })
}

impl Runtime {
    /// Whether an action is bound for a hand, and the paths.
    fn bound(&self, action: &Action, profile: &str, hand: xr::Path) -> Result<Vec<String>, Refusal> {
        let prefix = if hand == xr::Path::NULL { "" } else { self.path(hand)? };
        let of = action.bindings.iter().filter(|(of, path)| of == profile && path.starts_with(prefix));
        Ok(of.map(|(_, path)| path.clone()).collect())
    }

    fn input(&mut self, session: u64, action: &Action, hand: xr::Path) -> Result<Option<Value>, Refusal> {
        let Some(profile) = self.script.profile.clone() else { return Ok(None) };
        let paths = self.bound(action, &profile, hand)?;
        let session = self.session(session)?;
        if paths.is_empty() || !session.synced.contains(&action.set) {
            return Ok(None);
        }
        let (before, now) = session.sync_frames;
        let hit = |input: &Input| paths.contains(&input.path);
        let at = |frame: u64| {
            let pressed =
                self.script.inputs.iter().find(|input| within(frame, input.from, input.to) && hit(input));
            pressed.map_or([0.0; 2], |input| input.value)
        };
        Ok(Some(Value { now: at(now), changed: at(now) != at(before) }))
    }

    /// Where a pose action is in the head's space: the eyes, or a hand held out; nothing where it is not active.
    pub fn action_pose(
        &mut self,
        session: u64,
        handle: u64,
        hand: xr::Path,
    ) -> Result<Option<Pose>, Refusal> {
        let action = self.action(handle)?.clone();
        let owner = self.session(session)?;
        let (frame, synced) = (owner.latest.number, owner.synced.contains(&action.set));
        if !synced {
            return Ok(None);
        }
        if !self.bound(&action, profiles::EYES, hand)?.is_empty() {
            return Ok(world::gaze(&self.script.gaze, frame).filter(|_| self.script.eye_tracker));
        }
        let Some(profile) = self.script.profile.clone() else { return Ok(None) };
        let paths = self.bound(&action, &profile, hand)?;
        let left = paths.iter().any(|path| path.contains("/left/"));
        Ok(world::hand(&self.script.hands, left, frame).filter(|_| !paths.is_empty()))
    }
}
