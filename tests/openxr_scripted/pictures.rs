//! What pictures must show of the settings and of the frame: both eyes in one view, stops, a seed of its own.

use std::path::Path;

use fake_runtime::script::{Dump, Script, Session, View};

use super::common;
use super::common::builder::Builder;
use super::views::check_pictures;
use super::{command, finished, possible, run};
use serde_json::json;

/// Frames whose pictures are written out, each into a folder of its own.
fn dumping(folder: &Path, frames: &[u64]) -> Vec<Session> {
    let dump = |frame: &u64| Dump { frame: *frame, folder: folder.join(frame.to_string()) };
    vec![Session { dumps: frames.iter().map(dump).collect(), ..Session::default() }]
}

/// A pair of eyes whose fields of view mirror each other, so that neither can be taken for the other.
fn mirrored(apart: f32) -> Vec<View> {
    let eye = |x, [left, right]: [f32; 2]| View { fov: [left, right, 42.0, -40.0], ..View::eye(x) };
    vec![eye(-apart / 2.0, [-54.0, 36.0]), eye(apart / 2.0, [-36.0, 54.0])]
}

#[test]
fn each_eye_is_shown_its_own_picture() {
    // Far apart, so that they see the square at different places; one view for both is only right near.
    // The device that the runtime makes has ray queries where it lists them.
    let in_hardware = common::ray_queries().map(|_| (0.8, "--set trace.hardware_rays=on"));
    let usual = [(0.8, ""), (0.8, "--stereo per-eye"), (0.002, "--stereo shared")];
    for (apart, more) in usual.into_iter().chain(in_hardware) {
        let folder = tempfile::tempdir().unwrap();
        let sessions = dumping(folder.path(), &[5]);
        let script = Script { views: mirrored(apart), sessions, ..Script::default() };
        let Some(run) = run(&script, 8, more) else { return };
        run.is_clean();
        check_pictures(&run, &folder.path().join("5"), &mirrored(apart));
    }
}

#[test]
fn four_views_are_two_where_one_is_traced_for_both() {
    let script = Script {
        views: mirrored(0.06),
        inset_views: [mirrored(0.06), mirrored(0.06)].concat(),
        ..Script::default()
    };
    let Some(run) = run(&script, 3, "--stereo shared") else { return };
    assert_eq!(run.is_clean().told()["views"].as_array().unwrap().len(), 2);
}

/// The mean of a picture's bytes.
fn brightness(folder: &Path) -> f64 {
    let bytes = std::fs::read(folder.join("view0.raw")).unwrap();
    let colours = bytes.chunks(4).flat_map(|pixel| &pixel[..3]);
    colours.map(|&byte| f64::from(byte)).sum::<f64>() / (bytes.len() as f64 * 0.75)
}

#[test]
fn stops_are_shown() {
    let seen = |stops: &str| {
        let folder = tempfile::tempdir().unwrap();
        let script = Script { sessions: dumping(folder.path(), &[4]), ..Script::default() };
        let run = run(&script, 6, &format!("--exposure={stops}"))?;
        run.is_clean();
        Some(brightness(&folder.path().join("4")))
    };
    let (Some(dark), Some(usual)) = (seen("-3"), seen("0")) else { return };
    assert!(dark < 0.7 * usual, "three stops less: {dark} after {usual}");
}

/// Writes `scene.glb`: a floor in the open, whose light is sampled.
fn write_lit_scene(folder: &Path) {
    let mut builder = Builder::new();
    let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0f32]];
    let (positions, indices) = (builder.floats(&corners), builder.shorts(&[0, 1, 2, 0, 2, 3]));
    let finish = json!({ "baseColorFactor": [0.8, 0.8, 0.8, 1.0], "metallicFactor": 0.0 });
    let material = builder.push("materials", json!({ "pbrMetallicRoughness": finish, "doubleSided": true }));
    let primitive =
        json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": material });
    let half = 0.5f64.sqrt();
    builder.place(primitive, json!({ "rotation": [-half, 0.0, 0.0, half], "scale": [9, 9, 1] }));
    builder.write_glb(folder);
}

#[test]
fn each_frame_has_light_rays_of_its_own() {
    if !possible() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().to_path_buf();
    let script = Script { sessions: dumping(&at, &[4, 5, 6]), ..Script::default() };
    let (mut command, setup) = command(&at, &script, 8, "--exposure=0 --set time.reuse=false");
    write_lit_scene(&at);
    let run = finished(command.output().unwrap(), setup.log(), folder);
    run.is_clean();
    let picture = |frame: u64| std::fs::read(at.join(frame.to_string()).join("view0.raw")).unwrap();
    let differing = |a: &[u8], b: &[u8]| a.iter().zip(b).filter(|(a, b)| a != b).count();
    // The head does not move: all that differs is noise.
    for (a, b) in [(4, 5), (5, 6), (4, 6)] {
        let (a, b) = (picture(a), picture(b));
        assert!(differing(&a, &b) > a.len() / 20, "the same noise in two frames");
    }
}
