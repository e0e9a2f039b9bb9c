//! What the wearer does with controllers, seen in where the eyes are then and in what is shown.

use fake_runtime::script::{Input, Script};

use super::extras::first_eye;
use super::{Run, run};

const TOUCH: &str = "oculus/touch_controller";

/// A touch controller on which something is done.
fn touching(path: &str, value: [f32; 2], from: u64, to: u64) -> Script {
    using(TOUCH, &[(path, value, from, to)])
}

/// A controller on which things are done: where, how far to the right and ahead, from which frame to which.
fn using(profile: &str, done: &[(&str, [f32; 2], u64, u64)]) -> Script {
    let input = |&(path, value, from, to): &(&str, _, _, _)| Input {
        path: format!("/user/hand/{path}"),
        from,
        to,
        value,
    };
    Script {
        profile: Some(format!("/interaction_profiles/{profile}")),
        inputs: done.iter().map(input).collect(),
        ..Script::default()
    }
}

#[test]
fn sticks_turn_and_move_the_wearer() {
    let right = "right/input/thumbstick";
    let Some(turned) = run(&touching(right, [1.0, 0.0], 4, 9), 14, "") else { return };
    let (_, yaw) = first_eye(&turned);
    assert!((yaw + 30.0).abs() < 0.1, "one snap turn to the right, not {yaw}");
    let left = "left/input/thumbstick";
    let walked = run(&touching(left, [0.0, 1.0], 4, 30), 20, "--set headset.walk=smooth").unwrap();
    let (place, yaw) = first_eye(&walked);
    assert!(place[2] < -0.1 && (place[1] - 1.6).abs() < 1e-3 && yaw.abs() < 0.1, "{place:?} {yaw}");
    let stays = run(&touching(left, [0.0, 1.0], 4, 30), 20, "--set headset.walk=off").unwrap();
    assert!(first_eye(&stays).0[2].abs() < 1e-3);
    // With the other hand.
    let left_handed = "--set headset.walk=smooth --set headset.hand=left";
    let (_, yaw) = first_eye(&run(&touching(left, [1.0, 0.0], 4, 9), 14, left_handed).unwrap());
    assert!((yaw + 30.0).abs() < 0.1, "one snap turn to the right, not {yaw}");
    let (place, _) = first_eye(&run(&touching(right, [0.0, 1.0], 4, 30), 20, left_handed).unwrap());
    assert!(place[2] < -0.1, "{place:?}");
}

#[test]
fn a_press_teleports_to_where_the_hand_points() {
    let Some(run) = run(&touching("right/input/a/click", [1.0, 0.0], 5, 8), 12, "") else { return };
    let (place, _) = first_eye(&run);
    // The hand is 1.3 m above the floor, 0.4 m ahead, and points 30 degrees down.
    let ahead = 0.4 + 1.3 / 30f64.to_radians().tan();
    assert!((place[2] + ahead).abs() < 0.01 && (place[1] - 1.6).abs() < 0.01, "{place:?}, {ahead}");
    let x = touching("left/input/x/click", [1.0, 0.0], 5, 8);
    let (other, _) = first_eye(&super::run(&x, 12, "--set headset.hand=left").unwrap());
    assert!((other[2] + ahead).abs() < 0.01, "{other:?}, {ahead}");
}

/// Whoever has walked and turned is at the start again, and faces ahead.
#[test]
fn the_turning_stick_pressed_leads_back_to_the_start() {
    let gone = [("left/input/thumbstick", [0.3, 1.0], 4, 14), ("right/input/thumbstick", [1.0, 0.0], 8, 10)];
    let smooth = "--set headset.walk=smooth";
    let Some(before) = run(&using(TOUCH, &gone), 22, smooth) else { return };
    let (place, yaw) = first_eye(&before);
    assert!(place[2] < -0.1 && yaw < -20.0, "{place:?} {yaw}");
    for (hand, more) in [("right", ""), ("left", " --set headset.hand=left")] {
        let press = format!("{hand}/input/thumbstick/click");
        let done = [gone[0], gone[1], (press.as_str(), [1.0, 0.0], 17, 18)];
        let (place, yaw) = first_eye(&run(&using(TOUCH, &done), 22, &format!("{smooth}{more}")).unwrap());
        assert!(place[2].abs() < 1e-3 && (place[1] - 1.6).abs() < 1e-3, "{place:?}");
        assert!((place[0] + 0.0315).abs() < 1e-3 && yaw.abs() < 0.1, "{place:?} {yaw}");
    }
}

/// Eyes of someone who sits are as high as at the start, which is 1.6 m above the ground; back at the start they sit.
#[test]
fn the_going_stick_pressed_resets_the_height_of_the_eyes() {
    let press = ("left/input/thumbstick/click", [1.0, 0.0], 5, 6);
    let back = ("right/input/thumbstick/click", [1.0, 0.0], 9, 10);
    for (done, height) in [(vec![], 1.2), (vec![press], 1.6), (vec![press, back], 1.2)] {
        let script = Script { eye_height: 1.2, ..using(TOUCH, &done) };
        let Some(run) = run(&script, 14, "") else { return };
        let (place, _) = first_eye(&run);
        assert!((place[1] - height).abs() < 1e-3, "{place:?}, not {height}");
    }
}

/// Frames whose pictures come with the menu's board above them.
fn with_menu(run: &Run) -> Vec<usize> {
    let frames = run.is_clean().frames();
    let menu = |layers: &serde_json::Value| {
        let layers = layers.as_array();
        layers.is_some_and(|layers| layers.len() == 2 && layers[1]["quad"].is_object())
    };
    (0..frames.len()).filter(|&frame| menu(&frames[frame].0["layers"])).collect()
}

#[test]
fn the_menu_button_opens_a_board_over_the_picture_and_closes_it() {
    for (profile, button) in [
        (TOUCH, "left/input/menu/click"),
        ("valve/index_controller", "left/input/b/click"),
        ("khr/simple_controller", "left/input/menu/click"),
    ] {
        let once = (button, [1.0, 0.0], 6, 7);
        let Some(opened) = run(&using(profile, &[once]), 16, "") else { return };
        let shown = with_menu(&opened);
        assert!(shown.len() >= 8 && shown.windows(2).all(|pair| pair[1] == pair[0] + 1), "{shown:?}");
        let closed = with_menu(&run(&using(profile, &[once, (button, [1.0, 0.0], 10, 11)]), 16, "").unwrap());
        assert_eq!(closed, shown[..4], "{profile}");
    }
}

/// A thumb rests on a trackpad nearly all the time.
#[test]
fn a_trackpad_walks_only_while_it_is_pressed() {
    let thumb = ("left/input/trackpad", [0.0, 1.0], 4, 30);
    let press = ("left/input/trackpad/click", [1.0, 0.0], 4, 30);
    let smooth = "--set headset.walk=smooth";
    let Some(rests) = run(&using("htc/vive_controller", &[thumb]), 20, smooth) else { return };
    assert!(first_eye(&rests).0[2].abs() < 1e-3, "{:?}", first_eye(&rests));
    let walks = run(&using("htc/vive_controller", &[thumb, press]), 20, smooth).unwrap();
    assert!(first_eye(&walks).0[2] < -0.1, "{:?}", first_eye(&walks));
}

/// A profile may lack what is not about moving: the rest of it is used all the same.
#[test]
fn a_runtime_that_refuses_one_place_still_moves_the_wearer() {
    let mut script = touching("right/input/thumbstick", [1.0, 0.0], 4, 9);
    script.without_paths = vec!["thumbstick/click".into()];
    let Some(turned) = run(&script, 14, "") else { return };
    let (_, yaw) = first_eye(&turned);
    assert!((yaw + 30.0).abs() < 0.1, "{yaw}");
}
