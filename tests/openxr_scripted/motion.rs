//! Motion vectors beside pictures: those of what is seen, from the picture before to this one.

use std::path::Path;

use fake_runtime::script::{Dump, Event, EventKind, Fault, Head, Input, Script, Session};
use foveate::math::pose::Pose;
use glam::{DQuat, DVec2, DVec3};
use serde_json::{Value, json};

use super::common::builder::Builder;
use super::views::{numbers, uneven};
use super::{REST, Run, command, finished, possible, run};

/// Frames that may be looked at, by xrEndFrame: at first, and where the machine is busy, it may be that later ones are
/// expected to be seen no later.
const FRAMES: std::ops::Range<u64> = 6..16;
/// The recommended size: less than the views have.
const SIZE: [u32; 2] = [40, 36];
/// Metres per second of the square, and where it is at first.
const SPEED: f64 = 0.8;
const START: [f64; 3] = [-0.4, 1.75, -3.0];
/// Half the side of the square, metres.
const HALF: f64 = 0.5;
/// How far away the sky is put, metres.
const SKY: f64 = 1e6;
const SYNTHESIS: &str = "XR_EXT_frame_synthesis";
const UNCORRECTED: &str = "--set headset.late_correction=false";

/// A square that glides to the right above a floor.
fn write_scene(folder: &Path) {
    let mut builder = Builder::new();
    let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0f32]];
    let (positions, indices) = (builder.floats(&corners), builder.shorts(&[0, 1, 2, 0, 2, 3]));
    let primitive = json!({ "attributes": { "POSITION": positions }, "indices": indices });
    let half = 0.5f64.sqrt();
    builder.place(primitive.clone(), json!({ "translation": START, "scale": [HALF, HALF, 1.0] }));
    builder.place(primitive, json!({ "rotation": [-half, 0.0, 0.0, half], "scale": [9, 9, 1] }));
    let [x, y, z] = START.map(|at| at as f32);
    let far = x + 1000.0 * SPEED as f32;
    let (input, output) = (builder.floats(&[[0.0], [1000.0]]), builder.floats(&[[x, y, z], [far, y, z]]));
    builder.json["animations"] = json!([{
        "samplers": [{ "input": input, "output": output }],
        "channels": [{ "sampler": 0, "target": { "node": 0, "path": "translation" } }],
    }]);
    builder.write_glb(folder);
}

fn script(folder: &Path, head: Head, more: Script) -> Script {
    let dumps = FRAMES.map(|frame| Dump { frame, folder: folder.join(frame.to_string()) }).collect();
    let sessions = vec![Session { dumps, ..Session::default() }];
    Script { views: uneven(), head, motion_vectors: Some(SIZE), sessions, ..more }
}

/// Runs it before the square that glides.
fn gliding(script: &Script, flags: &str) -> Option<Run> {
    if !possible() {
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    let (mut command, setup) = command(folder.path(), script, FRAMES.end as u32, flags);
    write_scene(folder.path());
    Some(finished(command.output().unwrap(), setup.log(), folder))
}

/// The views of the layers of the frame before one, and of that.
fn layers(run: &Run, frame: u64) -> [Vec<Value>; 2] {
    let frames = run.frames();
    let views = |frame: u64| frames[frame as usize - 1].0["layers"][0]["views"].as_array().unwrap().clone();
    [views(frame - 1), views(frame)]
}

/// For when each frame that was shown was traced, in nanoseconds.
fn instants(run: &Run) -> Vec<i64> {
    let (mut instants, mut asked) = (Vec::new(), None);
    for record in &run.log.0 {
        match record.call() {
            "xrBeginFrame" => asked = None,
            "xrLocateViews" => asked = asked.or(record.0["time"].as_i64()),
            "xrEndFrame" => instants.push(asked.unwrap_or_default()),
            _ => {}
        }
    }
    instants
}

fn pose(numbers: &[f64]) -> Pose {
    let rotation = DQuat::from_xyzw(numbers[0], numbers[1], numbers[2], numbers[3]);
    Pose::new(rotation, DVec3::from_slice(&numbers[4..7]))
}

/// Where a layer's view shows a point of its space, in normalised device coordinates with Y down, and as stored depths
/// have it; `far_z` metres away that is 1.
fn shown(view: &Value, point: DVec3, far_z: f64) -> DVec3 {
    let (pose, fov) = (pose(&numbers(&view["pose"])), numbers(&view["fov"]));
    let [left, right, up, down] = [0, 1, 2, 3].map(|side| fov[side].tan());
    let eye = pose.inverse().transform_point(point);
    let at = DVec2::new(eye.x, eye.y) / -eye.z;
    let across = (at.x - left) / (right - left);
    let down = (at.y - up) / (down - up);
    DVec3::new(2.0 * across - 1.0, 2.0 * down - 1.0, far_z / -eye.z)
}

/// What a view's motion images hold: for each pixel the point that it shows, in the layer's space, and
/// its vector; the sky is far away.
fn pixels(folder: &Path, index: usize, view: &Value) -> Vec<(DVec3, DVec3)> {
    let read = |name: &str| std::fs::read(folder.join(format!("{name}{index}.raw"))).unwrap();
    let (vectors, depths) = (read("motion"), read("motion_depth"));
    let far_z = view["motion"]["far_z"].as_f64().unwrap();
    let [width, height] = [2, 3].map(|side| numbers(&view["rect"])[side]);
    let (pose, fov) = (pose(&numbers(&view["pose"])), numbers(&view["fov"]));
    let [left, right, up, down] = [0, 1, 2, 3].map(|side| fov[side].tan());
    let pixel = |(at, (vector, depth)): (usize, (&[u8], &[u8]))| {
        let part = |at: usize| f64::from(half::f16::from_le_bytes([vector[2 * at], vector[2 * at + 1]]));
        let depth = f64::from(f32::from_le_bytes(depth.try_into().unwrap()));
        let [x, y] = [at as u32 % SIZE[0], at as u32 / SIZE[0]].map(|at| f64::from(at) + 0.5);
        // The picture's pixel in the middle of the motion image's.
        let across = ((x * width / f64::from(SIZE[0])).floor() + 0.5) / width;
        let along = ((y * height / f64::from(SIZE[1])).floor() + 0.5) / height;
        let seen = DVec3::new(left + (right - left) * across, up + (down - up) * along, -1.0);
        let away = if depth > 0.0 { far_z / depth } else { SKY };
        (pose.transform_point(seen * away), DVec3::new(part(0), part(1), part(2)))
    };
    assert_eq!(depths.len(), 4 * (SIZE[0] * SIZE[1]) as usize);
    vectors.chunks(8).zip(depths.chunks(4)).enumerate().map(pixel).collect()
}

/// The share of a view's pixels whose vectors lead from where the last picture showed their points, which `before` tells,
/// to where this one does. `y` is -1 where Y goes up.
fn share_right(
    pixels: &[(DVec3, DVec3)],
    [last, now]: [&Value; 2],
    y: f64,
    before: impl Fn(DVec3) -> DVec3,
) -> f64 {
    let far_z = now["motion"]["far_z"].as_f64().unwrap();
    let right = |(point, vector): &&(DVec3, DVec3)| {
        let moved = shown(now, *point, far_z) - shown(last, before(*point), far_z);
        // Half floats have eleven bits.
        (moved * DVec3::new(1.0, y, 1.0) - *vector).length() < 2e-4 + 2e-3 * moved.length()
    };
    pixels.iter().filter(right).count() as f64 / pixels.len() as f64
}

/// Whether a point is on the square, so many seconds after the beginning.
fn is_on_square(point: DVec3, seconds: f64) -> bool {
    let middle = DVec3::from_array(START) + DVec3::X * SPEED * seconds;
    let off = (point + DVec3::from_array(REST) - middle).abs();
    off.z < 0.02 && off.x < HALF + 0.01 && off.y < HALF + 0.01
}

#[test]
fn vectors_lead_from_the_last_picture_to_this_one() {
    let head = Head { yaw_rate: 30.0, velocity: [0.1, 0.05, -0.3], ..Head::default() };
    let space_warp = Script { without: vec![SYNTHESIS.into()], ..Script::default() };
    for (kind, y, more) in [("synthesis", 1.0, Script::default()), ("space_warp", -1.0, space_warp)] {
        let folder = tempfile::tempdir().unwrap();
        let Some(run) = gliding(&script(folder.path(), head, more), UNCORRECTED) else { return };
        let extension = if y > 0.0 { SYNTHESIS } else { "XR_FB_space_warp" };
        assert_eq!(run.is_clean().told()["motion_vectors"], extension);
        let instants = instants(&run);
        let first = run.frames().iter().position(|frame| frame.0["layers"][0]["views"].is_array()).unwrap();
        let seconds = |frame: u64| (instants[frame as usize - 1] - instants[first]) as f64 * 1e-9;
        let frame = FRAMES.clone().find(|&frame| seconds(frame) > seconds(frame - 1) + 1e-3).unwrap();
        let (step, folder) = (seconds(frame) - seconds(frame - 1), folder.path().join(frame.to_string()));
        let [last, now] = layers(&run, frame);
        for (index, (last, now)) in last.iter().zip(&now).enumerate() {
            assert_eq!(now["motion"]["kind"], kind, "{now}");
            assert!(now["depth"].is_object(), "the layer's own depths stay beside the vectors: {now}");
            assert_eq!(pose(&numbers(&now["motion"]["delta"])), Pose::IDENTITY);
            assert_ne!(now["pose"], last["pose"]);
            let pixels = pixels(&folder, index, now);
            let square = pixels.iter().filter(|(point, _)| is_on_square(*point, seconds(frame))).count();
            let sky = pixels.iter().filter(|(point, _)| point.length() > 0.5 * SKY).count();
            assert!(square > 20 && sky > 20, "{square} {sky}");
            let glides = |point: DVec3| {
                if is_on_square(point, seconds(frame)) { point - DVec3::X * SPEED * step } else { point }
            };
            let right = share_right(&pixels, [last, now], y, glides);
            assert!(right > 0.99, "{kind}, view {index}: {right}");
            // The same measure tells what is wrong.
            let frozen = share_right(&pixels, [last, now], y, |point| point);
            let inverted = share_right(&pixels, [last, now], -y, glides);
            let still = share_right(&pixels, [now, now], y, glides);
            let share = square as f64 / pixels.len() as f64;
            assert!(
                frozen < 1.0 - 0.9 * share && inverted < 0.5 && still < 0.5,
                "{frozen} {inverted} {still}"
            );
        }
    }
}

#[test]
fn vectors_are_of_the_pictures_as_they_are_shown_after_late_corrections() {
    let head = Head { learned_yaw: 1.2, learned_shift: [0.02, 0.03, -0.02], ..Head::default() };
    let folder = tempfile::tempdir().unwrap();
    let script = script(folder.path(), head, Script::default());
    let Some(run) = run(&script, FRAMES.end as u32, "--set headset.margin=0.1") else { return };
    run.is_clean();
    let [last, now] = layers(&run, FRAMES.start);
    for (index, (last, now)) in last.iter().zip(&now).enumerate() {
        let pixels = pixels(&folder.path().join(FRAMES.start.to_string()), index, now);
        // Pixels are moved to where they are seen, which is right to a pixel.
        let right = share_right(&pixels, [last, now], 1.0, |point| point);
        assert!(right > 0.9, "view {index}: {right}");
    }
}

#[test]
fn vectors_are_those_of_each_part_of_a_view_that_serves_both_eyes() {
    let eye = |x: f32, fov| fake_runtime::script::View { fov, ..fake_runtime::script::View::eye(x) };
    let views = vec![eye(-0.03, [-45.0, 30.0, 40.0, -40.0]), eye(0.03, [-30.0, 45.0, 40.0, -40.0])];
    // Eyes that do not turn see alike wherever between them they are said to be.
    let head = Head { velocity: [0.4, 0.1, -0.3], ..Head::default() };
    for stereo in ["shared", "mono"] {
        let folder = tempfile::tempdir().unwrap();
        let script = Script { views: views.clone(), ..script(folder.path(), head, Script::default()) };
        let flags = format!("{UNCORRECTED} --stereo {stereo}");
        let Some(run) = run(&script, FRAMES.end as u32, &flags) else { return };
        run.is_clean();
        let is_elsewhere = |frame: &u64| {
            layers(&run, *frame).iter().all(|views| views.len() == 2) && {
                let [last, now] = layers(&run, *frame).map(|views| numbers(&views[0]["pose"]));
                // By metres that nobody takes for none: on a busy machine frames may be for nearly the same instant.
                last.iter().zip(&now).skip(4).any(|(last, now)| (last - now).abs() > 0.002)
            }
        };
        let frame = FRAMES.clone().find(is_elsewhere).expect("a frame that is seen from elsewhere");
        let [last, now] = layers(&run, frame);
        for (index, (last, now)) in last.iter().zip(&now).enumerate() {
            let pixels = pixels(&folder.path().join(frame.to_string()), index, now);
            let right = share_right(&pixels, [last, now], 1.0, |point| point);
            assert!(right > 0.98, "{stereo}, view {index}: {right}");
            assert!(share_right(&pixels, [now, now], 1.0, |point| point) < 0.7, "{stereo}: no motion");
        }
    }
}

#[test]
fn a_walk_is_told_beside_the_vectors_and_jumps_go_without() {
    let moving = |path: &str, from: u64, value: [f32; 2]| Script {
        profile: Some("/interaction_profiles/oculus/touch_controller".into()),
        inputs: vec![Input { path: format!("/user/hand/{path}/input/thumbstick"), from, to: 30, value }],
        ..Script::default()
    };
    let folder = tempfile::tempdir().unwrap();
    let walked = script(folder.path(), Head::default(), moving("left", 3, [0.0, 1.0]));
    let smooth = format!("{UNCORRECTED} --set headset.walk=smooth");
    let Some(run) = run(&walked, FRAMES.end as u32, &smooth) else { return };
    run.is_clean();
    let delta = |view: &Value| pose(&numbers(&view["motion"]["delta"]));
    let walks = |frame: &u64| delta(&layers(&run, *frame)[1][0]).position.length() > 1e-3;
    let frame = FRAMES.clone().find(walks).unwrap();
    let [last, now] = layers(&run, frame);
    for (index, (last, now)) in last.iter().zip(&now).enumerate() {
        let delta = delta(now);
        assert!(delta.position.z < 0.0 && delta.rotation == DQuat::IDENTITY, "{delta:?}");
        let pixels = pixels(&folder.path().join(frame.to_string()), index, now);
        // Where a point is in the tracked space of the last picture.
        let right = share_right(&pixels, [last, now], 1.0, |point| delta.transform_point(point));
        assert!(right > 0.98, "view {index}: {right}");
        // The sky alone stays.
        assert!(share_right(&pixels, [last, now], 1.0, |point| point) < 0.8 * right);
    }
    // A snap turn is none of what pictures in between could show.
    let turned = script(folder.path(), Head::default(), moving("right", 8, [1.0, 0.0]));
    let run = super::run(&turned, 16, UNCORRECTED).unwrap();
    let has: Vec<bool> =
        run.is_clean().layers().iter().map(|(_, views)| views[0]["motion"].is_object()).collect();
    assert_eq!(has.iter().skip(1).filter(|has| !**has).count(), 1, "{has:?}");
    assert!(!has[0], "the first picture has none before it");
}

#[test]
fn runtimes_that_refuse_vectors_go_without() {
    let offered = Script { motion_vectors: Some(SIZE), ..Script::default() };
    let refuses = |call: &str, from: u64, result: &str| Script {
        faults: vec![Fault { call: call.into(), from, result: result.into(), ..Fault::default() }],
        ..offered.clone()
    };
    let none = Script { motion_vectors: Some([0, 36]), ..Script::default() };
    let no_halves = Script { formats: vec![43, 126], ..offered.clone() };
    let cases = [
        (offered.clone(), "--set headset.motion_vectors=false", ""),
        (offered.clone(), "--reconstruct k-nn", ""),
        (Script::default(), "", ""),
        (none, "", "motion vectors of"),
        (no_halves, "", "offers no R16G16B16A16_SFLOAT"),
        // Colours and depths of two views come first.
        (refuses("xrCreateSwapchain", 5, "ERROR_RUNTIME_FAILURE"), "", "xrCreateSwapchain failed"),
        (refuses("xrEndFrame", 4, "ERROR_VALIDATION_FAILURE"), "", "xrEndFrame refuses motion vectors"),
    ];
    for (script, flags, note) in cases {
        let Some(run) = run(&script, 8, flags) else { return };
        run.is_clean();
        let told = if note.is_empty() { "motion vectors" } else { note };
        assert!(note.is_empty() != run.said.contains(told), "{note}: {}", run.said);
        let layers = run.layers();
        assert!(layers.len() >= 7 && layers.last().unwrap().1[0]["motion"].is_null(), "{flags}");
        let before = note.starts_with("xrEndFrame");
        assert_eq!(run.told()["motion_vectors"].is_null(), !before, "{note}");
    }
}

#[test]
fn after_a_frame_without_a_picture_the_next_has_no_vectors() {
    let mut script = Script { motion_vectors: Some(SIZE), ..Script::default() };
    let hidden =
        fake_runtime::script::FrameRule { from: 6, should_render: Some(false), ..Default::default() };
    script.sessions = vec![Session { frames: vec![hidden], ..Session::default() }];
    let Some(run) = run(&script, 10, "") else { return };
    let frames = shown_and_told(&run);
    let hidden = frames.iter().skip(2).position(|(shown, _)| !shown).unwrap() + 2;
    assert_eq!(frames[hidden - 1..hidden + 3], [(true, true), (false, false), (true, false), (true, true)]);
}

/// Of each picture, and of frames that show none: whether there is a picture, and whether it has vectors.
fn shown_and_told(run: &Run) -> Vec<(bool, bool)> {
    let view = |frame: &&fake_runtime::log::Record| {
        let view = &frame.0["layers"][0]["views"][0];
        (view.is_object(), view["motion"].is_object())
    };
    run.is_clean().frames().iter().map(view).collect()
}

#[test]
fn images_that_the_compositor_keeps_cost_vectors_and_no_picture() {
    // After the board each picture waits for colours and depths of two views, and then for those of their vectors.
    let kept = Fault {
        call: "xrWaitSwapchainImage".into(),
        from: 1 + 8 * 3 + 5,
        result: "TIMEOUT_EXPIRED".into(),
        ..Fault::default()
    };
    let script = Script { motion_vectors: Some(SIZE), faults: vec![kept], ..Script::default() };
    let Some(run) = run(&script, 9, "") else { return };
    let frames = shown_and_told(&run);
    let told = frames.iter().position(|&(_, told)| told).unwrap();
    let kept = told + frames[told..].iter().position(|&(_, told)| !told).unwrap();
    // The picture after it has none before it that its vectors could lead from.
    assert_eq!(frames[kept..kept + 3], [(true, false), (true, false), (true, true)], "{frames:?}");
    let layers = run.layers();
    let motion = layers.iter().flat_map(|(_, views)| views.iter().map(|view| &view["motion"]));
    let chains: Vec<&Value> =
        motion.flat_map(|motion| [&motion["swapchain"], &motion["depth_swapchain"]]).collect();
    let waits = run.log.calls("xrWaitSwapchainImage");
    let late = waits.iter().find(|wait| wait.result() == "TIMEOUT_EXPIRED").unwrap();
    assert!(chains.contains(&&late.0["on"]), "{late:?}");
    let waits: Vec<i64> = waits
        .iter()
        .filter(|wait| chains.contains(&&wait.0["on"]))
        .filter_map(|wait| wait.0["timeout"].as_i64())
        .collect();
    // Less than a frame, though other images are waited for longer.
    assert!(waits.len() > 8 && waits.iter().all(|&wait| wait < 10_000_000), "{waits:?}");
}

#[test]
fn a_tracked_space_that_is_recentred_moves_nothing() {
    let events = vec![Event { frame: 7, event: EventKind::Recentred }];
    let script = Script {
        motion_vectors: Some(SIZE),
        head: Head { position: [0.8, 0.2, 0.5], ..Head::default() },
        sessions: vec![Session { events, ..Session::default() }],
        ..Script::default()
    };
    let Some(run) = run(&script, 12, UNCORRECTED) else { return };
    let layers = run.is_clean().layers();
    let place = |index: usize| pose(&numbers(&layers[index].1[0]["pose"])).position;
    let jump = (1..layers.len()).find(|&index| place(index).distance(place(index - 1)) > 0.5).unwrap();
    let told: Vec<bool> = layers.iter().map(|(_, views)| views[0]["motion"].is_object()).collect();
    assert_eq!(told[jump - 1..jump + 2], [true, false, true], "{told:?}");
}
