//! What the wearer's hands do, as OpenXR actions.

use glam::DVec2;
use openxr as xr;

use super::bindings::{CONTROLLERS, GRIPS, HANDS, is_enabled, mirrored};
use super::convert;
use super::fault::{Called, Outcome};
use crate::headset::locomotion::Hands;
use crate::math::pose::Pose;

/// The actions of a session.
pub struct Actions {
    set: xr::ActionSet,
    go: Stick,
    turn: Stick,
    teleport: xr::Action<bool>,
    recentre: xr::Action<bool>,
    height: xr::Action<bool>,
    menu: xr::Action<bool>,
    aim: Place,
    /// Of the left and the right hand.
    grips: [Place; 2],
    /// The same.
    squeezes: [xr::Action<bool>; 2],
}

/// Where a hand is.
struct Place {
    action: xr::Action<xr::Posef>,
    space: xr::Space,
}

/// A stick, or a trackpad that counts while it is pressed.
struct Stick {
    push: xr::Action<xr::Vector2f>,
    press: xr::Action<bool>,
}

impl Actions {
    /// Makes the actions and suggests bindings, for who points with the right hand or the left; controllers that a runtime does not
    /// know are left out. The set is still to be attached.
    ///
    /// # Errors
    /// Where session or runtime are lost.
    pub fn new(
        instance: &xr::Instance,
        session: &xr::Session<xr::Vulkan>,
        left_handed: bool,
    ) -> Outcome<Actions> {
        let set = instance
            .create_action_set("wearer", "Moving through the scene", 0)
            .called("xrCreateActionSet")?;
        let button = |name, label| set.create_action::<bool>(name, label, &[]).called("xrCreateAction");
        let stick = |name, label| set.create_action(name, label, &[]).called("xrCreateAction");
        let go = Stick { push: stick("go", "Go")?, press: button("press_go", "Press to go")? };
        let turn = Stick { push: stick("turn", "Turn")?, press: button("press_turn", "Press to turn")? };
        let place = |name, label| -> Outcome<Place> {
            let action = set.create_action(name, label, &[]).called("xrCreateAction")?;
            let space = action.create_space(session, xr::Path::NULL, xr::Posef::IDENTITY);
            Ok(Place { action, space: space.called("xrCreateActionSpace")? })
        };
        let aim = place("aim", "Point")?;
        let grips = [place("left_grip", "Left hand")?, place("right_grip", "Right hand")?];
        let actions = Actions {
            go,
            turn,
            teleport: button("teleport", "Teleport")?,
            recentre: button("recentre", "Back to the start")?,
            height: button("height", "Reset the height of the eyes")?,
            menu: button("menu", "Menu")?,
            aim,
            grips,
            squeezes: [
                button("left_squeeze", "Left hand seizes")?,
                button("right_squeeze", "Right hand seizes")?,
            ],
            set,
        };
        actions.suggest(instance, left_handed);
        Ok(actions)
    }

    fn suggest(&self, instance: &xr::Instance, left_handed: bool) {
        for (profile, at) in CONTROLLERS.into_iter().filter(|(name, _)| is_enabled(instance, name)) {
            let fixed = |path: &str| {
                let bound =
                    (!path.is_empty()).then(|| instance.string_to_path(&format!("/user/hand/{path}")));
                bound.and_then(Result::ok)
            };
            let path = |path: &str| if left_handed { fixed(&mirrored(profile, path)) } else { fixed(path) };
            let squeezed =
                |hand| if at.squeeze.is_empty() { None } else { fixed(&format!("{hand}/{}", at.squeeze)) };
            let moving = [
                path(at.go).map(|path| xr::Binding::new(&self.go.push, path)),
                path(at.turn).map(|path| xr::Binding::new(&self.turn.push, path)),
                path(at.press_go).map(|path| xr::Binding::new(&self.go.press, path)),
                path(at.press_turn).map(|path| xr::Binding::new(&self.turn.press, path)),
                path(at.teleport).map(|path| xr::Binding::new(&self.teleport, path)),
                path(at.aim).map(|path| xr::Binding::new(&self.aim.action, path)),
            ];
            let more = [
                path(at.recentre).map(|path| xr::Binding::new(&self.recentre, path)),
                path(at.height).map(|path| xr::Binding::new(&self.height, path)),
                fixed(at.menu).map(|path| xr::Binding::new(&self.menu, path)),
                fixed(GRIPS[0]).map(|path| xr::Binding::new(&self.grips[0].action, path)),
                fixed(GRIPS[1]).map(|path| xr::Binding::new(&self.grips[1].action, path)),
                squeezed(HANDS[0]).map(|path| xr::Binding::new(&self.squeezes[0], path)),
                squeezed(HANDS[1]).map(|path| xr::Binding::new(&self.squeezes[1], path)),
            ];
            let Ok(profile) = instance.string_to_path(&format!("/interaction_profiles/{profile}")) else {
                continue;
            };
            let moving: Vec<xr::Binding> = moving.into_iter().flatten().collect();
            let all: Vec<xr::Binding> = moving.iter().copied().chain(more.into_iter().flatten()).collect();
            // One path that a runtime does not know costs all of a profile's: what moves goes before the rest. A
            // profile that it does not know is none that its wearer holds.
            let _ = instance
                .suggest_interaction_profile_bindings(profile, &all)
                .or_else(|_| instance.suggest_interaction_profile_bindings(profile, &moving));
        }
    }

    /// The set, to be attached and synchronised.
    pub fn set(&self) -> &xr::ActionSet {
        &self.set
    }

    /// What the hands do now; nothing where there are none, or another program has them.
    pub fn hands(&self, session: &xr::Session<xr::Vulkan>, space: &xr::Space, time: xr::Time) -> Hands {
        let held = self.teleport.state(session, xr::Path::NULL).ok().filter(|state| state.is_active);
        let aiming = held.is_some_and(|state| state.current_state);
        let teleport = held.is_some_and(|state| !state.current_state && state.changed_since_last_sync);
        let place = |of: &Place| of.locate(session, space, time);
        Hands {
            go: self.go.pushed(session),
            turn: self.turn.pushed(session).x,
            teleport,
            aiming,
            aim: if teleport || aiming { place(&self.aim) } else { None },
            grips: [place(&self.grips[0]), place(&self.grips[1])],
            squeezes: [held_down(&self.squeezes[0], session), held_down(&self.squeezes[1], session)],
            recentre: pressed(&self.recentre, session),
            height: pressed(&self.height, session),
            ..Hands::default()
        }
    }

    /// Whether the menu was asked for, just now.
    pub fn menu(&self, session: &xr::Session<xr::Vulkan>) -> bool {
        pressed(&self.menu, session)
    }
}

/// Whether a button is pressed.
fn held_down(button: &xr::Action<bool>, session: &xr::Session<xr::Vulkan>) -> bool {
    button.state(session, xr::Path::NULL).is_ok_and(|state| state.is_active && state.current_state)
}

/// Whether a button has just been pressed.
fn pressed(button: &xr::Action<bool>, session: &xr::Session<xr::Vulkan>) -> bool {
    let state = button.state(session, xr::Path::NULL);
    state.is_ok_and(|state| state.is_active && state.current_state && state.changed_since_last_sync)
}

impl Place {
    /// Where it is at a time; nothing where it is not tracked.
    fn locate(&self, session: &xr::Session<xr::Vulkan>, space: &xr::Space, time: xr::Time) -> Option<Pose> {
        let active = self.action.is_active(session, xr::Path::NULL).unwrap_or(false);
        let location = active.then(|| self.space.locate(space, time).ok()).flatten()?;
        let valid = xr::SpaceLocationFlags::ORIENTATION_VALID | xr::SpaceLocationFlags::POSITION_VALID;
        location.location_flags.contains(valid).then(|| convert::pose(&location.pose))
    }
}

impl Stick {
    /// How far it is pushed to the right and ahead, each -1 to 1.
    fn pushed(&self, session: &xr::Session<xr::Vulkan>) -> DVec2 {
        let rests = self.press.state(session, xr::Path::NULL);
        if rests.is_ok_and(|press| press.is_active && !press.current_state) {
            return DVec2::ZERO;
        }
        let state = self.push.state(session, xr::Path::NULL).ok().filter(|state| state.is_active);
        let push = state.map_or(DVec2::ZERO, |state| {
            DVec2::new(state.current_state.x.into(), state.current_state.y.into())
        });
        if push.is_finite() { push.clamp(DVec2::NEG_ONE, DVec2::ONE) } else { DVec2::ZERO }
    }
}
