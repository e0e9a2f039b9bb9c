//! Spaces and views.

use openxr_sys::{self as xr, Handle};

use super::frame::rules;
use crate::abi::{self, In, Out};
use crate::check::{check_pose, check_time};
use crate::objects::{Object, Space};
use crate::refusal::{Outcome, Refusal, invalid, wrong};
use crate::runtime::{On, Runtime, enter};
use crate::script::FrameRule;
use crate::world::{self, Pose};

const DONE: Outcome = Ok(xr::Result::SUCCESS);

pub(crate) fn create_reference(
    session: xr::Session,
    info: In<xr::ReferenceSpaceCreateInfo>,
    space: Out<xr::Space>,
) -> xr::Result {
    enter("xrCreateReferenceSpace", On::Session(session), |runtime, note| {
        let info = info.get()?;
        note.set("space", format!("{:?}", info.reference_space_type));
        if !runtime.reference_spaces().contains(&info.reference_space_type) {
            return Err(xr::Result::ERROR_REFERENCE_SPACE_UNSUPPORTED.into());
        }
        let pose = check_pose(&info.pose_in_reference_space)?;
        let object = Object::Space(Space::Reference(info.reference_space_type, pose));
        let handle = runtime.objects.insert(session.into_raw(), object);
        note.set("made", "Space");
        space.set(xr::Space::from_raw(handle))?;
        DONE
    })
}

pub(crate) fn create_action(
    session: xr::Session,
    info: In<xr::ActionSpaceCreateInfo>,
    space: Out<xr::Space>,
) -> xr::Result {
    enter("xrCreateActionSpace", On::Session(session), |runtime, note| {
        let info = info.get()?;
        let pose = check_pose(&info.pose_in_action_space)?;
        let action = info.action.into_raw();
        if runtime.action(action)?.kind != xr::ActionType::POSE_INPUT {
            return Err(wrong(xr::Result::ERROR_ACTION_TYPE_MISMATCH, "the action is no pose"));
        }
        let object = Object::Space(Space::Action { action, hand: info.subaction_path, pose });
        let handle = runtime.objects.insert(session.into_raw(), object);
        note.set("made", "Space");
        space.set(xr::Space::from_raw(handle))?;
        DONE
    })
}

pub(crate) fn destroy(space: xr::Space) -> xr::Result {
    enter("xrDestroySpace", On::Space(space), |runtime, note| runtime.destroy(space.into_raw(), note))
}

pub(crate) fn bounds(
    session: xr::Session,
    _space: xr::ReferenceSpaceType,
    bounds: Out<xr::Extent2Df>,
) -> xr::Result {
    enter("xrGetReferenceSpaceBoundsRect", On::Session(session), |_, _| {
        bounds.set(xr::Extent2Df { width: 0.0, height: 0.0 })?;
        Ok(xr::Result::SPACE_BOUNDS_UNAVAILABLE)
    })
}

pub(crate) fn locate(
    space: xr::Space,
    base: xr::Space,
    time: xr::Time,
    location: Out<xr::SpaceLocation>,
) -> xr::Result {
    enter("xrLocateSpace", On::Space(space), |runtime, note| {
        let handle = space.into_raw();
        note.set("space", runtime.space_name(space)?);
        note.set("base", runtime.space_name(base)?);
        note.set("time", time.as_nanos());
        let time = check_time(time)?;
        let session = runtime.session_of(handle).ok_or_else(|| invalid("the space has no session"))?;
        let here = runtime.in_local(session, handle, time)?;
        let there = runtime.in_local(session, base.into_raw(), time)?;
        let found = here.zip(there).map(|(here, there)| there.inverse().then(here));
        note.set("pose", found.map(Pose::list));
        if let Some(velocity) = location.chained::<xr::SpaceVelocity>()? {
            velocity.write(|next| xr::SpaceVelocity {
                ty: xr::SpaceVelocity::TYPE,
                next,
                velocity_flags: xr::SpaceVelocityFlags::EMPTY,
                linear_velocity: Default::default(),
                angular_velocity: Default::default(),
            })?;
        }
        if let Some(sample) = location.chained::<xr::EyeGazeSampleTimeEXT>()? {
            sample.write(|next| xr::EyeGazeSampleTimeEXT {
                ty: xr::EyeGazeSampleTimeEXT::TYPE,
                next,
                time: xr::Time::from_nanos(if found.is_some() { time } else { 0 }),
            })?;
        }
        use xr::SpaceLocationFlags as Flags;
        let all = Flags::ORIENTATION_VALID
            | Flags::POSITION_VALID
            | Flags::ORIENTATION_TRACKED
            | Flags::POSITION_TRACKED;
        location.write(|next| xr::SpaceLocation {
            ty: xr::SpaceLocation::TYPE,
            next,
            location_flags: if found.is_some() { all } else { Flags::EMPTY },
            pose: found.unwrap_or(Pose::IDENTITY).to_xr(),
        })?;
        DONE
    })
}

pub(crate) fn locate_views(
    session: xr::Session,
    info: In<xr::ViewLocateInfo>,
    state: Out<xr::ViewState>,
    capacity: u32,
    count: Out<u32>,
    views: Out<xr::View>,
) -> xr::Result {
    enter("xrLocateViews", On::Session(session), |runtime, note| {
        let info = info.get()?;
        let handle = session.into_raw();
        note.set("time", info.display_time.as_nanos());
        note.set("space", runtime.space_name(info.space)?);
        let time = check_time(info.display_time)?;
        let mut all = runtime.views(info.view_configuration_type)?;
        let asks = abi::chained::<xr::ViewLocateFoveatedRenderingVARJO>(info.next, info);
        if let Some(asks) = asks {
            runtime.needs("XR_VARJO_foveated_rendering")?;
            let active = asks.foveated_rendering_active == xr::TRUE;
            note.set("following", active);
            let frame = runtime.session(handle)?.latest.number;
            let gaze = world::gaze_angles(&runtime.script.gaze, frame).filter(|_| active);
            all.iter_mut().skip(2).for_each(|view| world::follow(view, gaze.unwrap_or_default()));
        }
        let base = runtime.in_local(handle, info.space.into_raw(), time)?.unwrap_or(Pose::IDENTITY);
        let head = runtime.head(handle, time)?;
        // The two-call idiom asks for the number of views first.
        let head = if capacity > 0 { runtime.learned(handle)?.then(head) } else { head };
        let head = base.inverse().then(head);
        let located: Vec<(Pose, xr::Fovf)> =
            all.iter().map(|view| (head.then(world::view(view)), world::fov(view))).collect();
        if capacity > 0 {
            let poses: Vec<[f32; 7]> = located.iter().map(|(pose, _)| pose.list()).collect();
            note.set("poses", poses);
            let angles = |fov: &xr::Fovf| [fov.angle_left, fov.angle_right, fov.angle_up, fov.angle_down];
            note.set("fovs", located.iter().map(|(_, fov)| angles(fov)).collect::<Vec<_>>());
        }
        use xr::ViewStateFlags as Flags;
        let session = runtime.session(handle)?;
        let known = |unknown: fn(&FrameRule) -> bool| {
            !rules(&session.script.frames, session.latest.number).any(unknown)
        };
        let (placed, turned) = (known(|rule| rule.unplaced), known(|rule| rule.unturned));
        let flag = |known: bool, flags: Flags| if known { flags } else { Flags::EMPTY };
        state.write(|next| xr::ViewState {
            ty: xr::ViewState::TYPE,
            next,
            view_state_flags: flag(turned, Flags::ORIENTATION_VALID | Flags::ORIENTATION_TRACKED)
                | flag(placed, Flags::POSITION_VALID | Flags::POSITION_TRACKED),
        })?;
        let nowhere = xr::Vector3f { x: f32::NAN, y: 1e30, z: f32::INFINITY };
        views.fill_typed(capacity, count, located, |next, (pose, fov)| {
            let pose = pose.to_xr();
            let position = if placed { pose.position } else { nowhere };
            let orientation = if turned { pose.orientation } else { xr::Quaternionf::default() };
            xr::View { ty: xr::View::TYPE, next, pose: xr::Posef { orientation, position }, fov }
        })?;
        DONE
    })
}

impl Runtime {
    fn space(&self, handle: u64) -> Result<Space, Refusal> {
        match self.objects.get(handle) {
            Some(Object::Space(space)) => Ok(*space),
            _ => Err(wrong(xr::Result::ERROR_HANDLE_INVALID, format!("there is no Space {handle}"))),
        }
    }

    /// By how much the head turns out to be elsewhere than it was said to be when a frame's views were asked
    /// for first.
    fn learned(&mut self, session: u64) -> Result<Pose, Refusal> {
        let head = self.script.head;
        let session = self.session(session)?;
        let (last, times) = session.asked;
        let frame = session.ended_frames;
        session.asked = (frame, if last == frame { times + 1 } else { 0 });
        Ok(world::learned(&head, session.asked.1))
    }

    /// A space's kind, for the log.
    pub fn space_name(&self, space: xr::Space) -> Result<String, Refusal> {
        Ok(match self.space(space.into_raw())? {
            Space::Reference(kind, _) => format!("{kind:?}"),
            Space::Action { action, .. } => self.action(action)?.name.clone(),
        })
    }

    /// Where a space is in the LOCAL space; nothing where it is not tracked.
    pub fn in_local(&mut self, session: u64, handle: u64, time: i64) -> Result<Option<Pose>, Refusal> {
        let (head, origin) = (self.head(session, time)?, self.session(session)?.origin);
        Ok(match self.space(handle)? {
            Space::Reference(kind, pose) => Some(match kind {
                xr::ReferenceSpaceType::VIEW => head.then(pose),
                xr::ReferenceSpaceType::LOCAL => pose,
                xr::ReferenceSpaceType::COMBINED_EYE_VARJO => {
                    let frame = self.session(session)?.latest.number;
                    let Some(gaze) = world::gaze(&self.script.gaze, frame) else { return Ok(None) };
                    head.then(gaze).then(pose)
                }
                _ => origin.inverse().then(Pose::floor(self.script.eye_height)).then(pose),
            }),
            Space::Action { action, hand, pose } => {
                self.action_pose(session, action, hand)?.map(|inner| head.then(inner).then(pose))
            }
        })
    }
}
