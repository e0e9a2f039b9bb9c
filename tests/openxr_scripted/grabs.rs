//! What the wearer seizes, carries and puts down, as pictures show it.

use std::path::Path;

use fake_runtime::script::{Dump, HandMove, Input, Script, SeenHand, Session, View};
use serde_json::json;

use super::common::builder::Builder;
use super::{REST, command, finished, possible};

/// The right hand before the eyes, in the head's space: from where the runtime holds it, and where that is.
const BEFORE: [f32; 3] = [-0.1, 0.2, -0.3];
const HAND: [f64; 3] = [0.1, -0.1, -0.7];
/// The thing's middle, and half of its side, metres.
const THING: ([f64; 3], f64) = ([HAND[0], REST[1] + HAND[1], HAND[2] - 0.06], 0.05);
const SQUEEZE: &str = "right/input/squeeze/value";

/// A red cube that can be seized, above a grey floor.
fn write_scene(folder: &Path) {
    let mut builder = Builder::new();
    let finish = |r: f64| {
        json!({ "pbrMetallicRoughness": { "baseColorFactor": [r, 0.1, 0.1, 1.0] }, "doubleSided": true,
            "extensions": { "KHR_materials_unlit": {} } })
    };
    let [floor, red] = [0.1, 1.0].map(|r| builder.push("materials", finish(r)));
    let corners = [[-9.0, 0.0, -9.0], [-9.0, 0.0, 9.0], [9.0, 0.0, 9.0], [9.0, 0.0, -9.0f32]];
    let (positions, indices) = (builder.floats(&corners), builder.shorts(&[0, 1, 2, 0, 2, 3]));
    let attributes = json!({ "POSITION": positions });
    let primitive = json!({ "attributes": attributes, "indices": indices, "material": floor });
    builder.place(primitive, json!({}));
    let corners: Vec<[f32; 3]> =
        (0..8).map(|i| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { 1.0 } else { -1.0 })).collect();
    let sides = [0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2];
    let sides = [&sides[..], &[1, 3, 7, 1, 7, 5]].concat();
    let (positions, indices) = (builder.floats(&corners), builder.shorts(&sides));
    let attributes = json!({ "POSITION": positions });
    let primitive = json!({ "attributes": attributes, "indices": indices, "material": red });
    let (place, half) = THING;
    let node = json!({ "translation": place, "scale": [half, half, half], "extras": { "grab": true } });
    builder.place(primitive, node);
    builder.json["extensionsUsed"] = json!(["KHR_materials_unlit"]);
    builder.write_glb(folder);
}

/// What is pressed: where, from which frame to which.
type Pressed<'a> = (&'a str, u64, u64);

/// Where the left eye sees the thing in each of these frames: pixels across and down; nothing where the program cannot
/// be run.
fn seen(profile: &str, pressed: &[Pressed], hands: &[HandMove], frames: &[u64]) -> Option<Vec<[f64; 2]>> {
    let input = |&(path, from, to): &Pressed| Input {
        path: format!("/user/hand/{path}"),
        from,
        to,
        value: [1.0, 0.0],
    };
    let script = Script {
        profile: Some(format!("/interaction_profiles/{profile}")),
        inputs: pressed.iter().map(input).collect(),
        ..Script::default()
    };
    seen_with(script, hands, frames)
}

/// The same with what else a script says of hands.
fn seen_with(script: Script, hands: &[HandMove], frames: &[u64]) -> Option<Vec<[f64; 2]>> {
    if !possible() {
        return None;
    }
    let pictures = tempfile::tempdir().unwrap();
    let dump = |&frame: &u64| Dump { frame, folder: pictures.path().join(frame.to_string()) };
    let held = HandMove { frame: 1, shift: BEFORE, ..HandMove::default() };
    let script = Script {
        hands: [&[held], hands].concat(),
        sessions: vec![Session { dumps: frames.iter().map(dump).collect(), ..Session::default() }],
        ..script
    };
    let folder = tempfile::tempdir().unwrap();
    let count = *frames.iter().max().unwrap() as u32 + 2;
    let (mut command, setup) = command(folder.path(), &script, count, "--set headset.show_hands=false");
    write_scene(folder.path());
    finished(command.output().unwrap(), setup.log(), folder).is_clean();
    let place = |frame: &u64| {
        let bytes = std::fs::read(pictures.path().join(frame.to_string()).join("view0.raw")).unwrap();
        middle(&bytes)
    };
    Some(frames.iter().map(place).collect())
}

/// The middle of what is red.
fn middle(rgba: &[u8]) -> [f64; 2] {
    let width = View::default().size[0] as usize;
    let red = |pixel: &[u8]| pixel[0] > 120 && pixel[0] > pixel[1].saturating_mul(2);
    let found: Vec<usize> = rgba.chunks(4).enumerate().filter(|(_, p)| red(p)).map(|(at, _)| at).collect();
    assert!(found.len() > 8, "{} red pixels", found.len());
    let mean = |value: &dyn Fn(usize) -> usize| {
        found.iter().map(|&at| value(at) as f64 + 0.5).sum::<f64>() / found.len() as f64
    };
    [mean(&|at| at % width), mean(&|at| at / width)]
}

/// The pixel at which the left eye sees a place of the head's space.
fn pixel(place: [f64; 3]) -> [f64; 2] {
    let View { size, fov, .. } = View::default();
    let [_, right, up, _] = fov.map(|angle| f64::from(angle).to_radians().tan());
    let (x, y) = ((place[0] + 0.0315) / -place[2], place[1] / -place[2]);
    [(x / right + 1.0) * 0.5 * f64::from(size[0]), (1.0 - y / up) * 0.5 * f64::from(size[1])]
}

fn assert_at(found: [f64; 2], expected: [f64; 2], what: &str) {
    let off = (found[0] - expected[0]).hypot(found[1] - expected[1]);
    assert!(off < 1.6, "{what}: at {found:?}, not {expected:?}");
}

/// The thing in the head's space as its file has it, and by how much the hand carries it.
const RESTS: [f64; 3] = [HAND[0], HAND[1], HAND[2] - 0.06];
const CARRIED: [f32; 3] = [-0.2, 0.15, 0.0];

fn carried() -> [f64; 3] {
    [0, 1, 2].map(|axis| RESTS[axis] + f64::from(CARRIED[axis]))
}

/// The hand where it has carried the thing, from a frame on.
fn away(frame: u64) -> HandMove {
    HandMove { frame, shift: [0, 1, 2].map(|axis| BEFORE[axis] + CARRIED[axis]), ..HandMove::default() }
}

#[test]
fn a_thing_goes_with_the_hand_that_squeezes_and_stays_where_it_is_let_go() {
    for (profile, squeeze) in [
        ("oculus/touch_controller", SQUEEZE),
        ("valve/index_controller", "right/input/squeeze/force"),
        ("htc/vive_controller", "right/input/squeeze/click"),
    ] {
        let back = HandMove { frame: 16, shift: BEFORE, ..HandMove::default() };
        // What the left hand does, far away, is no matter.
        let left = squeeze.replace("right", "left");
        let pressed = [(squeeze, 6, 12), (left.as_str(), 6, 8)];
        let Some(found) = seen(profile, &pressed, &[away(9), back], &[4, 7, 11, 20]) else { return };
        for (at, expected) in [(0, RESTS), (1, RESTS), (2, carried()), (3, carried())] {
            assert_at(found[at], pixel(expected), &format!("{profile}, picture {at}"));
        }
    }
}

/// Without a controller: the fingers close around it, and open.
#[test]
fn a_bare_hand_seizes_as_it_closes() {
    let is = |frame, closed| SeenHand { frame, closed, ..SeenHand::default() };
    let seen_hands = vec![is(1, false), is(6, true), is(13, false)];
    let script = || Script { seen_hands: seen_hands.clone(), ..Script::default() };
    let back = HandMove { frame: 16, shift: BEFORE, ..HandMove::default() };
    let Some(found) = seen_with(script(), &[away(9), back], &[4, 7, 11, 20]) else { return };
    for (at, expected) in [(0, RESTS), (1, RESTS), (2, carried()), (3, carried())] {
        assert_at(found[at], pixel(expected), &format!("picture {at}"));
    }
    let open = Script { seen_hands: vec![is(1, false)], ..Script::default() };
    assert_at(seen_with(open, &[away(9)], &[13]).unwrap()[0], pixel(RESTS), "an open hand");
}

#[test]
fn nothing_goes_with_a_hand_that_is_open_or_lost_or_too_far() {
    let lost = HandMove { frame: 9, lost: true, ..HandMove::default() };
    let far = HandMove { frame: 2, shift: [BEFORE[0], BEFORE[1] - 0.2, BEFORE[2]], ..HandMove::default() };
    let other = "left/input/squeeze/value";
    let cases: [(&[Pressed], &[HandMove]); 4] = [
        (&[], &[away(9)]),
        (&[(SQUEEZE, 6, 30)], &[lost]),
        (&[(SQUEEZE, 6, 30)], &[far, away(9)]),
        (&[(other, 6, 30)], &[away(9)]),
    ];
    for (index, (pressed, hands)) in cases.into_iter().enumerate() {
        let Some(found) = seen("oculus/touch_controller", pressed, hands, &[13]) else { return };
        assert_at(found[0], pixel(RESTS), &format!("case {index}"));
    }
}

/// The tracked space moves in the scene then; hands do not in it.
#[test]
fn whoever_turns_and_teleports_takes_along_what_they_hold() {
    let go = [("right/input/thumbstick", 9, 10), ("right/input/a/click", 13, 15)];
    let held = [go[0], go[1], (SQUEEZE, 6, 40)];
    let Some(found) = seen("oculus/touch_controller", &held, &[], &[4, 12, 20]) else { return };
    for (at, found) in found.into_iter().enumerate() {
        assert_at(found, pixel(RESTS), &format!("picture {at}"));
    }
    let left = seen("oculus/touch_controller", &go[..1], &[], &[12]).unwrap();
    // The head has turned by 30 degrees to the right, about the middle between the eyes.
    let (sin, cos) = 30f64.to_radians().sin_cos();
    let [x, y, z] = RESTS;
    assert_at(left[0], pixel([x * cos + z * sin, y, z * cos - x * sin]), "left behind");
}
