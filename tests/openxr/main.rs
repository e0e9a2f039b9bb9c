//! `foveate run` on a real OpenXR runtime: Monado with its simulated headset.

#[path = "../common/mod.rs"]
mod common;

mod monado;

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use common::builder::Builder;
use monado::Monado;
use serde_json::{Value, json};

/// Writes `scene.glb`: a red wall at the left, a green one at the right, and a blue floor.
fn write_scene(folder: &Path) {
    let mut builder = Builder::new();
    let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0f32]];
    let (positions, indices) = (builder.floats(&corners), builder.shorts(&[0, 1, 2, 0, 2, 3]));
    let half = 0.5f64.sqrt();
    let walls = [
        ([0.8, 0.05, 0.05], json!({ "translation": [-1.2, 1.5, -3], "scale": [1.0, 1.5, 1.0] })),
        ([0.05, 0.8, 0.05], json!({ "translation": [1.2, 1.5, -3], "scale": [1.0, 1.5, 1.0] })),
        ([0.1, 0.1, 0.9], json!({ "rotation": [-half, 0.0, 0.0, half], "scale": [6, 6, 1] })),
    ];
    for ([r, g, b], place) in walls {
        let finish = json!({ "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0 });
        let material =
            builder.push("materials", json!({ "pbrMetallicRoughness": finish, "doubleSided": true }));
        let primitive =
            json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": material });
        builder.place(primitive, place);
    }
    builder.write_glb(folder);
}

/// The program with what keeps pictures cheap.
fn foveate(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    command.current_dir(folder).args(arguments.split_whitespace());
    command.args(["--samples", "400", "--rays", "2", "--position", "0,1.6,0", "--look-at", "0,1.6,-1"]);
    command
}

fn summary(out: &[u8]) -> Value {
    serde_json::from_slice(out).unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(out)))
}

#[test]
fn two_hundred_frames_are_counted_by_both_sides() {
    if !monado::installed() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path());
    let monado = Monado::start_null(folder.path());
    let mut client = foveate(folder.path(), "run scene.glb --frames 200 --json");
    monado.serve(&mut client);
    let output = client.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let told = summary(&output.stdout);
    assert_eq!((&told["frames"], &told["losses"]), (&json!(200), &json!(0)), "{told}");
    assert!(told["on_time"].as_u64().unwrap() <= 200 && told["dropped"].is_u64(), "{told}");
    assert!(told["runtime"].as_str().unwrap().starts_with("Monado"), "{told}");
    assert_eq!(told["views"].as_array().unwrap().len(), 2, "{told}");
    for key in ["frame_ms", "pose_ms"] {
        assert!(told[key]["p99"].as_f64() >= told[key]["p50"].as_f64(), "{told}");
    }
    // One layer for each picture, one image of each view for each layer, and everything is given back.
    assert_eq!(monado.calls("compositor_layer_sync"), 200);
    for call in ["acquire", "wait", "release"] {
        assert_eq!(monado.calls(&format!("swapchain_{call}_image")), 400, "{call}");
    }
    for (made, ended) in [("swapchain_create", "swapchain_destroy"), ("session_create", "session_destroy")] {
        assert_eq!(monado.calls(made), monado.calls(ended), "{made}");
    }
    assert_eq!((monado.calls("session_begin"), monado.calls("session_end")), (1, 1));
}

#[test]
fn without_a_runtime_one_sentence_says_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path());
    let mut client = foveate(folder.path(), "run scene.glb --frames 3");
    client.env("XR_RUNTIME_JSON", folder.path().join("none.json")).env("XR_LOADER_DEBUG", "none");
    let output = client.stdin(Stdio::null()).output().unwrap();
    assert_eq!((output.status.code(), output.stdout.as_slice()), (Some(1), &b""[..]));
    let said = String::from_utf8(output.stderr).unwrap();
    let last = said.trim_end().lines().last().unwrap();
    assert!(last.starts_with("foveate: no usable OpenXR device: ") && last.contains("install"), "{said}");
}

#[test]
fn a_service_that_dies_and_comes_back_is_waited_for() {
    if !monado::installed() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path());
    let mut monado = Monado::start_null(folder.path());
    let mut client = foveate(folder.path(), "run scene.glb --frames 60 --json");
    monado.serve(&mut client);
    let mut child = client.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    while monado.calls("compositor_layer_sync") < 10 {
        assert!(child.try_wait().unwrap().is_none(), "it ended before its service");
        std::thread::sleep(Duration::from_millis(20));
    }
    monado.kill();
    std::thread::sleep(Duration::from_secs(2));
    assert!(child.try_wait().unwrap().is_none(), "it did not wait for the service");
    monado.restart();
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let told = summary(&output.stdout);
    assert_eq!((&told["frames"], &told["losses"]), (&json!(60), &json!(1)), "{told} {said}");
    assert!(said.contains("waiting for it to come back") && said.contains("is back"), "{said}");
    let counted = monado.calls("compositor_layer_sync");
    assert!((1..=50).contains(&counted), "{counted} pictures after the service came back");
}
