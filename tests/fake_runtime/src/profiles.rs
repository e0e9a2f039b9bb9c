//! Interaction profiles, with the inputs that OpenXR gives them.

/// Each profile's inputs on both hands, and those on one only.
struct Profile {
    name: &'static str,
    both: &'static [&'static str],
    left: &'static [&'static str],
    right: &'static [&'static str],
}

/// What every hand has.
const POSES: [&str; 3] = ["input/grip/pose", "input/aim/pose", "output/haptic"];

/// The eyes' profile.
pub(crate) const EYES: &str = "/interaction_profiles/ext/eye_gaze_interaction";
const GAZE: &str = "/user/eyes_ext/input/gaze_ext/pose";

const PROFILES: [Profile; 6] = [
    Profile {
        name: "bytedance/pico4_controller",
        both: &[
            "system/click",
            "squeeze/click",
            "squeeze/value",
            "trigger/value",
            "trigger/touch",
            "thumbstick",
            "thumbstick/x",
            "thumbstick/y",
            "thumbstick/click",
            "thumbstick/touch",
        ],
        left: &["x/click", "x/touch", "y/click", "y/touch", "menu/click"],
        right: &["a/click", "a/touch", "b/click", "b/touch"],
    },
    Profile { name: "khr/simple_controller", both: &["select/click", "menu/click"], left: &[], right: &[] },
    Profile {
        name: "htc/vive_controller",
        both: &[
            "system/click",
            "squeeze/click",
            "menu/click",
            "trigger/click",
            "trigger/value",
            "trackpad",
            "trackpad/x",
            "trackpad/y",
            "trackpad/click",
            "trackpad/touch",
        ],
        left: &[],
        right: &[],
    },
    Profile {
        name: "microsoft/motion_controller",
        both: &[
            "menu/click",
            "squeeze/click",
            "trigger/value",
            "thumbstick",
            "thumbstick/x",
            "thumbstick/y",
            "thumbstick/click",
            "trackpad",
            "trackpad/x",
            "trackpad/y",
            "trackpad/click",
            "trackpad/touch",
        ],
        left: &[],
        right: &[],
    },
    Profile {
        name: "oculus/touch_controller",
        both: &[
            "squeeze/value",
            "trigger/value",
            "trigger/touch",
            "thumbstick",
            "thumbstick/x",
            "thumbstick/y",
            "thumbstick/click",
            "thumbstick/touch",
            "thumbrest/touch",
        ],
        left: &["x/click", "x/touch", "y/click", "y/touch", "menu/click"],
        right: &["a/click", "a/touch", "b/click", "b/touch", "system/click"],
    },
    Profile {
        name: "valve/index_controller",
        both: &[
            "system/click",
            "system/touch",
            "a/click",
            "a/touch",
            "b/click",
            "b/touch",
            "squeeze/value",
            "squeeze/force",
            "trigger/click",
            "trigger/value",
            "trigger/touch",
            "thumbstick",
            "thumbstick/x",
            "thumbstick/y",
            "thumbstick/click",
            "thumbstick/touch",
            "trackpad",
            "trackpad/x",
            "trackpad/y",
            "trackpad/force",
            "trackpad/touch",
        ],
        left: &[],
        right: &[],
    },
];

fn find(profile: &str) -> Option<&'static Profile> {
    let name = profile.strip_prefix("/interaction_profiles/")?;
    PROFILES.iter().find(|known| known.name == name)
}

/// Whether the runtime knows a profile, which it need not.
pub(crate) fn known(profile: &str) -> bool {
    profile == EYES || find(profile).is_some()
}

/// Whether a profile has a path. A path that stops before its last part stands for the whole component.
pub(crate) fn has(profile: &str, path: &str) -> bool {
    if profile == EYES {
        return path == GAZE;
    }
    let Some(known) = find(profile) else { return false };
    let (side, rest) = match path.strip_prefix("/user/hand/").and_then(|path| path.split_once('/')) {
        Some(("left", rest)) => (known.left, rest),
        Some(("right", rest)) => (known.right, rest),
        _ => return false,
    };
    let component =
        |have: &&str, wanted: &str| have.split_once('/').is_some_and(|(whole, _)| whole == wanted);
    let input =
        |wanted: &str| known.both.iter().chain(side).any(|have| *have == wanted || component(have, wanted));
    POSES.iter().any(|pose| *pose == rest || component_of(pose) == rest)
        || rest.strip_prefix("input/").is_some_and(input)
}

/// `input/grip` of `input/grip/pose`.
fn component_of(pose: &str) -> &str {
    pose.rsplit_once('/').map_or(pose, |(whole, _)| whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_have_their_own_inputs_only() {
        let touch = "/interaction_profiles/oculus/touch_controller";
        assert!(has(touch, "/user/hand/left/input/x/click") && !has(touch, "/user/hand/right/input/x/click"));
        assert!(
            has(touch, "/user/hand/right/input/thumbstick") && has(touch, "/user/hand/left/input/aim/pose")
        );
        assert!(has(touch, "/user/hand/left/output/haptic") && !has(touch, "/user/hand/left/input/trackpad"));
        assert!(!has(touch, "/user/eyes_ext/input/gaze_ext/pose") && has(EYES, GAZE));
        assert!(has("/interaction_profiles/khr/simple_controller", "/user/hand/left/input/select"));
        assert!(!has("/interaction_profiles/khr/simple_controller", "/user/hand/left/input/sel"));
        assert!(known(EYES) && known(touch) && !known("/interaction_profiles/of/nobody"));
        assert!(!has("/interaction_profiles/of/nobody", "/user/hand/left/input/select/click"));
    }
}
