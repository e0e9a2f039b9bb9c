//! Where actions are found on the usual controllers.

use openxr as xr;

/// Paths below `/user/hand` on a controller, for who points with the right hand; empty where it has no such thing.
/// They are those of the OpenXR specification's interaction profiles.
#[derive(Clone, Copy)]
pub struct Bindings {
    /// To go.
    pub go: &'static str,
    /// To turn.
    pub turn: &'static str,
    /// What is pressed to go, where touching `go` is not enough.
    pub press_go: &'static str,
    /// What is pressed to turn, where touching `turn` is not enough.
    pub press_turn: &'static str,
    /// To teleport.
    pub teleport: &'static str,
    /// To point.
    pub aim: &'static str,
    /// Back to the start.
    pub recentre: &'static str,
    /// Eyes as high above the ground as at the start.
    pub height: &'static str,
    /// What each hand squeezes to seize things: below `/user/hand/left` and `/user/hand/right`.
    pub squeeze: &'static str,
    /// The menu, which is on the same hand for everybody.
    pub menu: &'static str,
}

/// The hands below `/user/hand`.
pub const HANDS: [&str; 2] = ["left", "right"];

/// Where each hand holds its controller: on all of them.
pub const GRIPS: [&str; 2] = ["left/input/grip/pose", "right/input/grip/pose"];

/// Controllers with sticks, a button A, and a menu on the left.
const STICKS: Bindings = Bindings {
    go: "left/input/thumbstick",
    turn: "right/input/thumbstick",
    press_go: "",
    press_turn: "",
    teleport: "right/input/a/click",
    aim: "right/input/aim/pose",
    recentre: "right/input/thumbstick/click",
    height: "left/input/thumbstick/click",
    squeeze: "input/squeeze/value",
    menu: "left/input/menu/click",
};

/// What has nothing but a button and a menu on either hand.
const SIMPLE: Bindings = Bindings {
    go: "",
    turn: "",
    teleport: "right/input/select/click",
    recentre: "right/input/menu/click",
    height: "",
    squeeze: "",
    ..STICKS
};

/// Controllers by their interaction profiles. Trackpads have to be pressed: a thumb that rests on one walks nowhere.
pub const CONTROLLERS: [(&str, Bindings); 14] = [
    // The left hand's system button is the runtime's, and there is no menu: B is free. A hand that merely lies around it has
    // a value; one that squeezes has a force.
    (
        "valve/index_controller",
        Bindings { menu: "left/input/b/click", squeeze: "input/squeeze/force", ..STICKS },
    ),
    ("oculus/touch_controller", STICKS),
    ("meta/touch_plus_controller", STICKS),
    ("meta/touch_controller_plus", STICKS),
    ("meta/touch_pro_controller", STICKS),
    ("facebook/touch_controller_pro", STICKS),
    ("hp/mixed_reality_controller", STICKS),
    ("htc/vive_cosmos_controller", Bindings { squeeze: "input/squeeze/click", ..STICKS }),
    ("htc/vive_focus3_controller", Bindings { squeeze: "input/squeeze/click", ..STICKS }),
    ("bytedance/pico4_controller", STICKS),
    (
        "htc/vive_controller",
        Bindings {
            go: "left/input/trackpad",
            turn: "right/input/trackpad",
            press_go: "left/input/trackpad/click",
            press_turn: "right/input/trackpad/click",
            teleport: "right/input/trigger/value",
            squeeze: "input/squeeze/click",
            ..SIMPLE
        },
    ),
    (
        "microsoft/motion_controller",
        Bindings { teleport: "right/input/trigger/value", squeeze: "input/squeeze/click", ..STICKS },
    ),
    (
        "ext/hand_interaction_ext",
        Bindings {
            teleport: "right/input/pinch_ext/value",
            recentre: "",
            squeeze: "input/grasp_ext/value",
            menu: "",
            ..SIMPLE
        },
    ),
    ("khr/simple_controller", SIMPLE),
];

/// The same place for who points with the other hand. Controllers that come in pairs call the left one's first button
/// X; Index has an A on both. Menu buttons stay, since many have only one.
pub fn mirrored(profile: &str, path: &str) -> String {
    let Some((hand, rest)) = path.split_once('/') else { return String::new() };
    if rest == "input/menu/click" {
        return path.to_string();
    }
    let other = if hand == "left" { "right" } else { "left" };
    let rest =
        if profile == "valve/index_controller" { rest.to_string() } else { rest.replace("/a/", "/x/") };
    format!("{other}/{rest}")
}

/// Whether a profile may be named: some have names of their own in an extension, and in OpenXR 1.1 another.
pub fn is_enabled(instance: &xr::Instance, profile: &str) -> bool {
    let extensions = instance.exts();
    match profile {
        "meta/touch_controller_plus" => extensions.meta_touch_controller_plus.is_some(),
        "facebook/touch_controller_pro" => extensions.fb_touch_controller_pro.is_some(),
        "ext/hand_interaction_ext" => extensions.ext_hand_interaction.is_some(),
        _ => true,
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
            ("htc/vive_controller", "right/input/menu/click", "right/input/menu/click"),
        ] {
            assert_eq!(mirrored(profile, path), other);
        }
    }

    /// A button with two meanings would do both.
    #[test]
    fn no_place_has_two_meanings() {
        for (profile, places) in CONTROLLERS {
            let Bindings { go, turn, teleport, recentre, height, squeeze, menu, .. } = places;
            for hand in [false, true] {
                let place = |path: &str| if hand { mirrored(profile, path) } else { path.to_string() };
                let mut all: Vec<String> = [go, turn, teleport, recentre, height].map(place).to_vec();
                all.push(menu.to_string());
                let squeezes = HANDS.map(|hand| format!("{hand}/{squeeze}"));
                all.extend(squeezes.into_iter().filter(|_| !squeeze.is_empty()));
                all.retain(|path| !path.is_empty());
                let count = all.len();
                all.sort();
                all.dedup();
                assert_eq!(all.len(), count, "{profile} {hand}");
            }
        }
    }
}
