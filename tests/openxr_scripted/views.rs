//! Views as the headset has them: canted, uneven, of different sizes, four of them.

use std::path::Path;

use fake_runtime::script::{Dump, Fault, Gaze, Head, Script, Session, View};
use foveate::math::pose::Pose;
use glam::{DQuat, DVec3};
use serde_json::Value;

use super::common::validation;
use super::{REST, Run, SQUARE, command, finished, possible, run};

/// The frame that is looked at.
const LOOKED_AT: u64 = 5;

/// An uneven pair of views, the left one canted outwards and taller.
pub fn uneven() -> Vec<View> {
    vec![
        View {
            size: [112, 96],
            fov: [-52.0, 38.0, 41.0, -47.0],
            position: [-0.033, 0.001, 0.002],
            turn: [9.0, 2.0, 3.0],
            ..View::default()
        },
        View {
            size: [88, 104],
            fov: [-37.0, 49.0, 44.0, -39.0],
            position: [0.031, -0.002, 0.0],
            turn: [-8.0, -1.0, -4.0],
            ..View::default()
        },
    ]
}

/// The mean place of red pixels, and how many there are.
fn red_square(path: &Path, width: usize) -> (f64, f64, f64) {
    let bytes = std::fs::read(path).unwrap();
    let (mut x, mut y, mut count) = (0.0, 0.0, 0.0);
    for (index, pixel) in bytes.chunks(4).enumerate() {
        if pixel[0] > 120 && pixel[1] < 60 && pixel[2] < 60 {
            x += (index % width) as f64 + 0.5;
            y += (index / width) as f64 + 0.5;
            count += 1.0;
        }
    }
    (x / count, y / count, count)
}

pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

/// Where the square's middle is in a layer's view, by the pose and field of view that were told.
fn expected(view: &Value, width: f64, height: f64) -> (f64, f64) {
    let pose = numbers(&view["pose"]);
    let rotation = DQuat::from_xyzw(pose[0], pose[1], pose[2], pose[3]);
    let eye =
        Pose { rotation, position: DVec3::from_slice(REST.as_slice()) + DVec3::from_slice(&pose[4..7]) };
    let seen = eye.rotation.conjugate() * (DVec3::from_array(SQUARE.0) - eye.position);
    let (x, y) = (seen.x / -seen.z, seen.y / -seen.z);
    let fov: Vec<f64> = numbers(&view["fov"]).into_iter().map(f64::tan).collect();
    (width * (x - fov[0]) / (fov[1] - fov[0]), height * (fov[2] - y) / (fov[2] - fov[3]))
}

/// Each view of the layer has its own picture, and the square is in it where it must be.
pub fn check_pictures(run: &Run, folder: &Path, views: &[View]) {
    let frame = &run.frames()[LOOKED_AT as usize - 1].0;
    let layer = frame["layers"][0]["views"].as_array().unwrap();
    assert_eq!(layer.len(), views.len());
    for (index, (told, view)) in layer.iter().zip(views).enumerate() {
        let [width, height] = view.size.map(f64::from);
        assert_eq!(numbers(&told["rect"])[2..], [width, height], "view {index}");
        for (told, given) in numbers(&told["fov"]).iter().zip(view.fov) {
            assert!((told.to_degrees() - f64::from(given)).abs() < 1e-3, "view {index}: {told}");
        }
        let (x, y, count) = red_square(&folder.join(format!("view{index}.raw")), view.size[0] as usize);
        let (right_x, right_y) = expected(told, width, height);
        assert!(count > 10.0, "view {index} does not show the square");
        assert!(
            (x - right_x).abs() < 1.0 && (y - right_y).abs() < 1.0,
            "view {index}: the square is at {x:.1}, {y:.1}, not at {right_x:.1}, {right_y:.1}"
        );
    }
}

fn dumping(folder: &Path) -> Vec<Session> {
    let dump = Dump { frame: LOOKED_AT, folder: folder.into() };
    vec![Session { dumps: vec![dump], ..Session::default() }]
}

#[test]
fn canted_and_uneven_views_are_shown_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let head = Head { yaw_rate: 3.0, velocity: [0.02, 0.01, 0.0], ..Head::default() };
    let script = Script { views: uneven(), head, sessions: dumping(folder.path()), ..Script::default() };
    let Some(run) = run(&script, 8, "") else { return };
    assert_eq!(run.is_clean().told()["frames"], 8);
    check_pictures(&run, folder.path(), &uneven());
    let reversed: Vec<View> = uneven().into_iter().rev().collect();
    let swapped = std::panic::catch_unwind(|| check_pictures(&run, folder.path(), &reversed));
    assert!(swapped.is_err(), "the comparer takes eyes that are swapped");
}

#[test]
fn khronos_layers_find_no_fault_on_either_side() {
    if !possible() || !validation::installed() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().to_path_buf();
    // Eyes, hands and hidden corners are asked for too, and a second session comes after the first.
    let lost = Fault { call: "xrEndFrame".into(), from: 12, result: "ERROR_SESSION_LOST".into(), to: 0 };
    let sessions = vec![Session { faults: vec![lost], ..Session::default() }, dumping(&at).remove(0)];
    let views = uneven().into_iter().map(|view| View { hidden_corner: 0.2, ..view }).collect();
    let script = Script {
        views,
        sessions,
        eye_tracker: true,
        gaze: vec![Gaze { frame: 1, yaw: 10.0, ..Gaze::default() }],
        profile: Some("/interaction_profiles/oculus/touch_controller".into()),
        head: Head { learned_yaw: 1.0, ..Head::default() },
        ..Script::default()
    };
    let (mut command, setup) = command(&at, &script, 24, "");
    let output = command.envs(validation::environment(&at)).output().unwrap();
    let printed = [&output.stdout[..], &output.stderr].concat();
    let printed = String::from_utf8_lossy(&printed);
    assert_eq!(validation::messages(&at, &printed), Vec::<String>::new());
    let run = finished(output, setup.log(), folder);
    assert_eq!((&run.is_clean().told()["frames"], &run.told()["losses"]), (&24.into(), &1.into()));
}

#[test]
fn foveated_insets_are_shown_where_the_runtime_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let inset = |x: f32, turn: f32| View {
        size: [72, 64],
        fov: [-14.0, 16.0, 12.0, -11.0],
        turn: [turn, 0.0, 0.0],
        ..View::eye(x)
    };
    let views = [uneven(), vec![inset(-0.033, -4.0), inset(0.031, -3.0)]].concat();
    let script = Script {
        views: uneven(),
        inset_views: views.clone(),
        sessions: dumping(folder.path()),
        ..Script::default()
    };
    let Some(run) = run(&script, 8, "") else { return };
    let told = run.is_clean().told();
    assert_eq!(told["views"].as_array().unwrap().len(), 4, "{told}");
    check_pictures(&run, folder.path(), &views);
}

/// The insets' fields of view, in radians, in a frame's layer.
fn insets(views: &[Value]) -> Vec<Vec<f64>> {
    views[2..].iter().map(|view| numbers(&view["fov"])).collect()
}

#[test]
fn insets_follow_the_eyes_as_long_as_the_runtime_sees_them() {
    let folder = tempfile::tempdir().unwrap();
    let inset = |x: f32| View { size: [72, 64], fov: [-14.0, 16.0, 12.0, -11.0], ..View::eye(x) };
    let wide = |x: f32| View::eye(x);
    // Gaze is granted late, moves in each frame, and is withdrawn.
    let looking = |frame: u64| {
        let (yaw, pitch) = (6.0 * (frame as f32).sin(), 4.0 * (1.7 * frame as f32).cos());
        Gaze { frame, yaw, pitch, lost: frame == 20 }
    };
    let dump = |frame: u64| Dump { frame, folder: folder.path().join(frame.to_string()) };
    let session = Session { dumps: [4, 12, 13, 26].map(dump).to_vec(), ..Session::default() };
    let script = Script {
        inset_views: vec![wide(-0.0315), wide(0.0315), inset(-0.0315), inset(0.0315)],
        following_insets: Some([56, 48]),
        eye_tracker: true,
        gaze: (8..=20).map(looking).collect(),
        head: Head { learned_yaw: 0.5, ..Head::default() },
        sessions: vec![session],
        ..Script::default()
    };
    let without = Script { without: vec!["XR_EXT_eye_gaze_interaction".into()], ..script.clone() };
    for script in [&script, &without] {
        let Some(run) = run(script, 26, "") else { return };
        let told = run.is_clean().told();
        assert_eq!(
            (&told["views"][1]["width"], &told["views"][2]["width"]),
            (&96.into(), &56.into()),
            "{told}"
        );
        let fixed = [-14.0f64, 16.0, 12.0, -11.0].map(f64::to_radians);
        let mut moved = Vec::new();
        for (frame, views) in run.layers() {
            let number = frame.0["frame"].as_u64().unwrap();
            let still =
                insets(views).iter().all(|fov| fov.iter().zip(fixed).all(|(a, b)| (a - b).abs() < 1e-5));
            // The frame after one may be waited for already as its poses are asked for.
            assert!(still || (7..=20).contains(&number), "{number}: {views:?}");
            assert!(!still || !(9..=18).contains(&number), "{number}: {views:?}");
            moved.push(insets(views));
        }
        let places = moved.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!(places > 9, "the insets are at {places} places only");
        // What is seen in each view is what its field of view says.
        for frame in [4, 12, 13, 26] {
            let ended = &run.frames()[frame - 1].0;
            for (index, view) in ended["layers"][0]["views"].as_array().unwrap().iter().enumerate() {
                let size = numbers(&view["rect"]);
                let picture = folder.path().join(format!("{frame}/view{index}.raw"));
                let (x, y, count) = red_square(&picture, size[2] as usize);
                let (right_x, right_y) = expected(view, size[2], size[3]);
                assert!(
                    count > 10.0 && (x - right_x).abs() < 1.0 && (y - right_y).abs() < 1.0,
                    "frame {frame}, view {index}: {x:.1}, {y:.1}, not {right_x:.1}, {right_y:.1}"
                );
            }
        }
        // Where the eyes look is where the wide views are sharp, too: in the end, straight ahead again.
        assert!(told["views"].as_array().unwrap().len() == 4);
    }
    // Who does not want to be followed is not, and neither are those whose headset does not see their eyes.
    let blind = Script { eye_tracker: false, ..script.clone() };
    for (script, flags) in [(&script, "--set headset.eye_tracking=false"), (&blind, "")] {
        let run = super::run(script, 14, flags).unwrap();
        assert_eq!(run.is_clean().told()["views"][2]["width"], 72);
        let places = run.layers().iter().map(|(_, views)| insets(views)).collect::<Vec<_>>();
        assert!(places.windows(2).all(|pair| pair[0] == pair[1]), "{places:?}");
    }
}

#[test]
fn poses_in_layers_are_those_that_the_runtime_gave() {
    let head = Head { yaw_rate: 60.0, velocity: [0.3, 0.0, -0.2], ..Head::default() };
    let Some(run) = run(&Script { head, ..Script::default() }, 12, "") else { return };
    run.is_clean();
    let located = run.log.calls("xrLocateViews");
    let given: Vec<Vec<Vec<f64>>> = located
        .iter()
        .filter_map(|record| Some(record.0["poses"].as_array()?.iter().map(numbers).collect()))
        .collect();
    let layers = run.layers();
    assert_eq!(layers.len(), 12);
    for (frame, views) in layers {
        let shown: Vec<Vec<f64>> = views.iter().map(|view| numbers(&view["pose"])).collect();
        let close = |a: &Vec<f64>, b: &Vec<f64>| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        let same = |poses: &&Vec<Vec<f64>>| poses.iter().zip(&shown).all(|(a, b)| close(a, b));
        assert_eq!(given.iter().filter(same).count().min(1), 1, "{frame:?}");
    }
}
