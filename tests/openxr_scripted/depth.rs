//! Depths beside pictures: written as they are told, and seen from where the layer says.

use std::path::Path;

use fake_runtime::script::{Dump, Head, Script, Session, View};
use foveate::math::pose::Pose;
use glam::{DQuat, DVec3};
use serde_json::Value;

use super::views::{check_pictures, numbers, uneven};
use super::{REST, Run, SQUARE, run};

/// The frame that is looked at.
const LOOKED_AT: u64 = 5;
/// Half the floor's side, metres.
const FLOOR: f64 = 9.0;

fn script(folder: &Path, head: Head) -> Script {
    let dumps = vec![Dump { frame: LOOKED_AT, folder: folder.into() }];
    let session = Session { dumps, ..Session::default() };
    Script { views: uneven(), head, sessions: vec![session], ..Script::default() }
}

/// The views of the layer of the frame that is looked at.
fn layer(run: &Run) -> Vec<Value> {
    run.frames()[LOOKED_AT as usize - 1].0["layers"][0]["views"].as_array().unwrap().clone()
}

/// How far along a layer's view's axis the scene is in the middle of a pixel; infinite for the sky.
fn distance(view: &Value, [x, y]: [f64; 2]) -> f64 {
    let (pose, fov) = (numbers(&view["pose"]), numbers(&view["fov"]));
    let rotation = DQuat::from_xyzw(pose[0], pose[1], pose[2], pose[3]);
    let eye = Pose { rotation, position: DVec3::from_array(REST) + DVec3::from_slice(&pose[4..7]) };
    let tangent: Vec<f64> = fov.into_iter().map(f64::tan).collect();
    let seen = DVec3::new(
        tangent[0] + (tangent[1] - tangent[0]) * x,
        tangent[2] + (tangent[3] - tangent[2]) * y,
        -1.0,
    );
    let ray = eye.rotation * seen;
    let (middle, half) = (DVec3::from_array(SQUARE.0), SQUARE.1);
    let square = (middle.z - eye.position.z) / ray.z;
    let off = (eye.position + ray * square - middle).abs();
    let floor = -eye.position.y / ray.y;
    let there = eye.position + ray * floor;
    if square > 0.0 && off.x < half && off.y < half {
        square
    } else if floor > 0.0 && there.x.abs() < FLOOR && there.z.abs() < FLOOR {
        floor
    } else {
        f64::INFINITY
    }
}

/// A layer's view with its range of depths, to compare stored depths with.
struct Expected<'a> {
    view: &'a Value,
    width: usize,
    height: usize,
    at_zero: f64,
    at_one: f64,
}

impl Expected<'_> {
    fn of(view: &Value) -> Expected<'_> {
        let depth = &view["depth"];
        let number = |key: &str| depth[key].as_f64().unwrap();
        assert_eq!((number("min_depth"), number("max_depth")), (0.0, 1.0));
        let [width, height] = [2, 3].map(|index| numbers(&depth["rect"])[index] as usize);
        Expected { view, width, height, at_zero: 1.0 / number("near_z"), at_one: 1.0 / number("far_z") }
    }

    /// What is to be stored for a pixel.
    fn at(&self, x: i64, y: i64) -> f64 {
        let place = [(x, self.width), (y, self.height)].map(|(at, all)| (at as f64 + 0.5) / all as f64);
        (1.0 / distance(self.view, place) - self.at_zero) / (self.at_one - self.at_zero)
    }

    fn pixels<'s>(&self, stored: &'s [f32]) -> impl Iterator<Item = (i64, i64, f64)> + 's {
        assert_eq!(stored.len(), self.width * self.height);
        let width = self.width;
        let pixel = move |(index, depth): (usize, &f32)| {
            ((index % width) as i64, (index / width) as i64, f64::from(*depth))
        };
        stored.iter().enumerate().map(pixel)
    }
}

/// The share of a view's pixels whose stored depth lies between those that the scene has around them, as the
/// layer's range of depths says it.
fn share_right(stored: &[f32], view: &Value) -> f64 {
    let expected = Expected::of(view);
    let right = |&(x, y, depth): &(i64, i64, f64)| {
        let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)));
        let around = around.map(|(dx, dy)| expected.at(x + dx, y + dy));
        let (low, high) = around.fold((1.0f64, 0.0f64), |(low, high), e| (low.min(e), high.max(e)));
        (low * 0.999 - 1e-6..=high * 1.001 + 1e-6).contains(&depth)
    };
    expected.pixels(stored).filter(right).count() as f64 / stored.len() as f64
}

/// Where the head rests pixels look aside of their middles by up to half a pixel (`time.pictures`): some see past an edge.
const RIGHT_AT_REST: f64 = 0.998;

/// How far stored depths are from the scene's, on average.
fn mean_error(stored: &[f32], view: &Value) -> f64 {
    let expected = Expected::of(view);
    let errors = expected.pixels(stored).map(|(x, y, depth)| (depth - expected.at(x, y)).abs());
    errors.sum::<f64>() / stored.len() as f64
}

fn stored(folder: &Path, view: usize) -> Vec<f32> {
    let bytes = std::fs::read(folder.join(format!("depth{view}.raw"))).unwrap();
    bytes.chunks(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect()
}

#[test]
fn depths_are_those_of_what_is_seen() {
    let folder = tempfile::tempdir().unwrap();
    let head = Head { yaw_rate: 30.0, velocity: [0.1, 0.0, -0.3], ..Head::default() };
    // Uncorrected, or frames that are late on a busy machine are moved to where the head is by then.
    let uncorrected = "--set headset.late_correction=false";
    let Some(run) = run(&script(folder.path(), head), 8, uncorrected) else { return };
    assert_eq!(run.is_clean().told()["depth_format"], "D32_SFLOAT");
    let views = layer(&run);
    for (index, view) in views.iter().enumerate() {
        assert_eq!(view["depth"]["same_size"], true, "{view}");
        assert_ne!(view["depth"]["swapchain"], view["swapchain"]);
        let depths = stored(folder.path(), index);
        assert!(depths.contains(&0.0) && depths.iter().any(|&depth| depth > 0.01), "sky and floor are there");
        assert_eq!(share_right(&depths, view), 1.0, "view {index}");
        // The same measure tells depths that are wrong.
        let (mirrored, inverse): (Vec<f32>, Vec<f32>) =
            (depths.iter().rev().copied().collect(), depths.iter().map(|depth| 1.0 - depth).collect());
        let twice: Vec<f32> = depths.iter().map(|depth| depth * 0.5).collect();
        for (wrong, name) in [(mirrored, "upside down"), (inverse, "not reversed"), (twice, "twice as far")] {
            assert!(share_right(&wrong, view) < 0.8, "{name}");
        }
    }
}

#[test]
fn late_corrections_move_pictures_and_depths_to_the_pose_that_is_told() {
    let folder = tempfile::tempdir().unwrap();
    // The runtime knows better each time that it is asked: the eyes are seen from two later poses.
    let head = Head { learned_yaw: 1.2, learned_shift: [0.02, 0.03, -0.02], ..Head::default() };
    let Some(run) = run(&script(folder.path(), head), 8, "") else { return };
    run.is_clean();
    check_pictures(&run, folder.path(), &uneven());
    let views = layer(&run);
    let located = run.log.calls("xrLocateViews");
    let first = located.iter().find(|record| record.0["poses"].is_array()).unwrap();
    for (index, view) in views.iter().enumerate() {
        assert_ne!(numbers(&view["pose"]), numbers(&first.0["poses"][index]), "the newest pose is told");
        let depths = stored(folder.path(), index);
        let right = share_right(&depths, view);
        assert!(right > 0.9, "view {index}: {right}");
        let mut uncorrected = view.clone();
        uncorrected["pose"] = first.0["poses"][index].clone();
        let errors = [view, &uncorrected].map(|view| mean_error(&depths, view));
        assert!(errors[0] < 0.7 * errors[1], "view {index}: {errors:?}");
    }
    // With a margin there is something to be seen beyond the edge of what was shown.
    let wide = tempfile::tempdir().unwrap();
    let run = run_with(wide.path(), head, "--set headset.margin=0.1");
    check_pictures(&run, wide.path(), &uneven());
    for (index, view) in layer(&run).iter().enumerate() {
        let right = share_right(&stored(wide.path(), index), view);
        assert!(right > 0.97, "view {index}: {right}");
    }
    let off = tempfile::tempdir().unwrap();
    let run = run_with(off.path(), head, "--set headset.late_correction=false --set headset.margin=0.1");
    for (index, view) in layer(&run).iter().enumerate() {
        let right = share_right(&stored(off.path(), index), view);
        assert!(right > RIGHT_AT_REST, "view {index}: {right}");
    }
}

fn run_with(folder: &Path, head: Head, more: &str) -> Run {
    let run = run(&script(folder, head), 8, more).unwrap();
    run.is_clean();
    run
}

#[test]
fn depths_are_left_out_where_nobody_wants_or_has_them() {
    let usual = Script::default();
    let unlisted = Script { without: vec!["XR_KHR_composition_layer_depth".into()], ..usual.clone() };
    let no_format = Script { formats: vec![43], ..usual.clone() };
    for (script, more) in [
        (&usual, "--set headset.depth=false"),
        (&usual, "--reconstruct k-nn"),
        (&unlisted, ""),
        (&no_format, ""),
    ] {
        let Some(run) = run(script, 4, more) else { return };
        assert!(run.is_clean().told()["depth_format"].is_null(), "{more}");
        // Those of two views and of the board.
        assert_eq!(run.log.calls("xrCreateSwapchain").len(), 3, "{more}");
        assert!(run.layers().iter().all(|(_, views)| views.iter().all(|view| view["depth"].is_null())));
    }
    // Depths of integers serve where there are no floats.
    let coarse = Script { formats: vec![43, 124], ..usual };
    assert_eq!(run(&coarse, 4, "").unwrap().is_clean().told()["depth_format"], "D16_UNORM");
}

#[test]
fn insets_have_depths_too() {
    let folder = tempfile::tempdir().unwrap();
    let inset = |x: f32| View { size: [72, 64], fov: [-14.0, 16.0, 12.0, -11.0], ..View::eye(x) };
    let inset_views = [uneven(), vec![inset(-0.033), inset(0.031)]].concat();
    let script = Script { inset_views, ..script(folder.path(), Head::default()) };
    let Some(run) = run(&script, 8, "") else { return };
    run.is_clean();
    let views = layer(&run);
    assert_eq!(views.len(), 4);
    for (index, view) in views.iter().enumerate() {
        let right = share_right(&stored(folder.path(), index), view);
        assert!(right > RIGHT_AT_REST, "view {index}: {right}");
    }
}
