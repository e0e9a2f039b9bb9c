//! What the wearer's hands do, as OpenXR actions, with bindings suggested for the usual controllers.

use glam::DVec2;
use openxr as xr;

use super::convert;
use super::fault::{Called, Outcome};
use crate::headset::locomotion::Hands;

/// Controllers, with where each action is found on them for who points with the right hand: to go, to turn, to
/// teleport, to point. Paths are those of the OpenXR specification's interaction profiles.
const CONTROLLERS: [(&str, [&str; 4]); 14] = [
    ("valve/index_controller", STICKS),
    ("oculus/touch_controller", STICKS),
    ("meta/touch_plus_controller", STICKS),
    ("meta/touch_controller_plus", STICKS),
    ("meta/touch_pro_controller", STICKS),
    ("facebook/touch_controller_pro", STICKS),
    ("hp/mixed_reality_controller", STICKS),
    ("htc/vive_cosmos_controller", STICKS),
    ("htc/vive_focus3_controller", STICKS),
    ("bytedance/pico4_controller", STICKS),
    (
        "htc/vive_controller",
        ["left/input/trackpad", "right/input/trackpad", "right/input/trigger/value", "right/input/aim/pose"],
    ),
    (
        "microsoft/motion_controller",
        [
            "left/input/thumbstick",
            "right/input/thumbstick",
            "right/input/trigger/value",
            "right/input/aim/pose",
        ],
    ),
    ("ext/hand_interaction_ext", ["", "", "right/input/pinch_ext/value", "right/input/aim/pose"]),
    ("khr/simple_controller", ["", "", "right/input/select/click", "right/input/aim/pose"]),
];

/// Where controllers with sticks and a button A have them.
const STICKS: [&str; 4] =
    ["left/input/thumbstick", "right/input/thumbstick", "right/input/a/click", "right/input/aim/pose"];

/// The same place for who points with the other hand. Controllers that come in pairs call the left one's first button
/// X; Index has an A on both.
fn mirrored(profile: &str, path: &str) -> String {
    let Some((hand, rest)) = path.split_once('/') else { return String::new() };
    let other = if hand == "left" { "right" } else { "left" };
    let rest =
        if profile == "valve/index_controller" { rest.to_string() } else { rest.replace("/a/", "/x/") };
    format!("{other}/{rest}")
}

/// Whether a profile may be named: some have names of their own in an extension, and in OpenXR 1.1 another.
fn is_enabled(instance: &xr::Instance, profile: &str) -> bool {
    let extensions = instance.exts();
    match profile {
        "meta/touch_controller_plus" => extensions.meta_touch_controller_plus.is_some(),
        "facebook/touch_controller_pro" => extensions.fb_touch_controller_pro.is_some(),
        "ext/hand_interaction_ext" => extensions.ext_hand_interaction.is_some(),
        _ => true,
    }
}

/// The actions of a session.
pub struct Actions {
    set: xr::ActionSet,
    go: xr::Action<xr::Vector2f>,
    turn: xr::Action<xr::Vector2f>,
    teleport: xr::Action<bool>,
    aim: xr::Action<xr::Posef>,
    aim_space: xr::Space,
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
        let go = set.create_action("go", "Go", &[]).called("xrCreateAction")?;
        let turn = set.create_action("turn", "Turn", &[]).called("xrCreateAction")?;
        let teleport = set.create_action("teleport", "Teleport", &[]).called("xrCreateAction")?;
        let aim = set.create_action("aim", "Point", &[]).called("xrCreateAction")?;
        for (profile, paths) in CONTROLLERS.into_iter().filter(|(name, _)| is_enabled(instance, name)) {
            let path = |index: usize| {
                let path =
                    if left_handed { mirrored(profile, paths[index]) } else { paths[index].to_string() };
                (!path.is_empty())
                    .then(|| instance.string_to_path(&format!("/user/hand/{path}")).ok())
                    .flatten()
            };
            let bindings: Vec<xr::Binding> = [
                path(0).map(|path| xr::Binding::new(&go, path)),
                path(1).map(|path| xr::Binding::new(&turn, path)),
                path(2).map(|path| xr::Binding::new(&teleport, path)),
                path(3).map(|path| xr::Binding::new(&aim, path)),
            ]
            .into_iter()
            .flatten()
            .collect();
            if let Ok(profile) = instance.string_to_path(&format!("/interaction_profiles/{profile}")) {
                // A profile that the runtime does not know is none that its wearer holds.
                let _ = instance.suggest_interaction_profile_bindings(profile, &bindings);
            }
        }
        let aim_space =
            aim.create_space(session, xr::Path::NULL, xr::Posef::IDENTITY).called("xrCreateActionSpace")?;
        Ok(Actions { set, go, turn, teleport, aim, aim_space })
    }

    /// The set, to be attached and synchronised.
    pub fn set(&self) -> &xr::ActionSet {
        &self.set
    }

    /// What the hands do now; nothing where there are none, or another program has them.
    pub fn hands(&self, session: &xr::Session<xr::Vulkan>, space: &xr::Space, time: xr::Time) -> Hands {
        let stick = |action: &xr::Action<xr::Vector2f>| {
            let state = action.state(session, xr::Path::NULL).ok().filter(|state| state.is_active);
            let stick = state.map_or(DVec2::ZERO, |state| {
                DVec2::new(state.current_state.x.into(), state.current_state.y.into())
            });
            if stick.is_finite() { stick.clamp(DVec2::NEG_ONE, DVec2::ONE) } else { DVec2::ZERO }
        };
        let teleport = self
            .teleport
            .state(session, xr::Path::NULL)
            .is_ok_and(|state| state.is_active && state.current_state && state.changed_since_last_sync);
        let aim = || {
            let active = self.aim.is_active(session, xr::Path::NULL).unwrap_or(false);
            let location = active.then(|| self.aim_space.locate(space, time).ok()).flatten()?;
            let valid = xr::SpaceLocationFlags::ORIENTATION_VALID | xr::SpaceLocationFlags::POSITION_VALID;
            location.location_flags.contains(valid).then(|| convert::pose(&location.pose))
        };
        Hands {
            go: stick(&self.go),
            turn: stick(&self.turn).x,
            teleport,
            aim: if teleport { aim() } else { None },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_other_hand_has_the_same_in_its_own_places() {
        for (profile, path, other) in [
            ("oculus/touch_controller", "right/input/a/click", "left/input/x/click"),
            ("valve/index_controller", "right/input/a/click", "left/input/a/click"),
            ("htc/vive_controller", "left/input/trackpad", "right/input/trackpad"),
            ("ext/hand_interaction_ext", "right/input/aim/pose", "left/input/aim/pose"),
            ("ext/hand_interaction_ext", "", ""),
        ] {
            assert_eq!(mirrored(profile, path), other);
        }
    }
}
