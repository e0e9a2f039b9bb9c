//! `foveate run` on a real OpenXR runtime: Monado with its simulated headset.

#[path = "../common/mod.rs"]
mod common;

mod monado;
mod window;

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use common::builder::Builder;
use common::validation;
use foveate::config::{Config, Indirect, OperatingPoint, Samples};
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::{Device, device};
use foveate::gpu::vulkan::{Context, ContextOptions};
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::metrics::Display;
use glam::{DQuat, DVec2, DVec3};
use monado::Monado;
use serde_json::{Value, json};
use window::{EYE_HEIGHT, EYE_WIDTH, RemoteEye, SCREEN, Screen};

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
    command.stdin(Stdio::null());
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
    // The board that comes first, one layer for each picture, an image of colours and one of depths of each view for each layer, and
    // everything is given back.
    assert_eq!(told["depth_format"], "D32_SFLOAT", "{told}");
    assert_eq!(monado.calls("compositor_layer_sync"), 201);
    for call in ["acquire", "wait", "release"] {
        assert_eq!(monado.calls(&format!("swapchain_{call}_image")), 801, "{call}");
    }
    for (made, ended) in [("swapchain_create", "swapchain_destroy"), ("session_create", "session_destroy")] {
        assert_eq!(monado.calls(made), monado.calls(ended), "{made}");
    }
    assert_eq!((monado.calls("session_begin"), monado.calls("session_end")), (1, 1));
}

#[test]
fn khronos_layers_find_no_fault() {
    if !monado::installed() || !validation::installed() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path());
    let monado = Monado::start_null(folder.path());
    let mut client = foveate(folder.path(), "run scene.glb --frames 30 --json");
    monado.serve(&mut client);
    let output = client.envs(validation::environment(folder.path())).output().unwrap();
    let printed = [&output.stdout[..], &output.stderr].concat();
    let printed = String::from_utf8_lossy(&printed);
    assert_eq!(validation::messages(folder.path(), &printed), Vec::<String>::new());
    assert!(output.status.success(), "{printed}");
    assert_eq!(summary(&output.stdout)["frames"], 30);
}

#[test]
fn the_displays_period_is_held() {
    if !monado::installed() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path());
    let monado = Monado::start_null(folder.path());
    // Frames are far faster than this front says, so that there is time for more.
    let point = |samples: f64, rays: u32, frame_ms: f64| OperatingPoint {
        samples,
        rays,
        ..OperatingPoint::of(&Config::default(), 1, frame_ms, 4.0 + samples)
    };
    let front = json!({ "budget": { "front": [point(0.002, 1, 1e4), point(0.2, 32, 2e4)] } });
    std::fs::write(folder.path().join("front.toml"), toml::to_string(&front).unwrap()).unwrap();
    let mut client = foveate(
        folder.path(),
        "run scene.glb --frames 40 --json --config front.toml --target-ms display --width 128 --height 64",
    );
    monado.serve(&mut client);
    let output = client.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let budget = summary(&output.stdout)["budget"].clone();
    let (first, last) = (&budget["first"], &budget["last"]);
    // Monado's null compositor shows 20 pictures a second.
    let target = last["target_ms"].as_f64().unwrap();
    assert!((target - 45.0).abs() < 0.5, "{budget}");
    let work = |held: &Value| held["samples"].as_f64().unwrap() * held["rays"].as_f64().unwrap();
    assert!(first["position"] == 0.0 && work(last) > 1.2 * work(first), "{budget}");
    assert!(budget["within"].as_f64().is_some_and(|share| (0.0..=1.0).contains(&share)), "{budget}");
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
    let names = last.contains("XR_RUNTIME_JSON names ") && last.contains("none.json, which does not exist");
    assert!(last.starts_with("foveate: no usable OpenXR device: ") && names, "{said}");
    assert!(last.ends_with("correct the variable, or unset it"), "{said}");
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
    while monado.calls("compositor_layer_sync") < 11 {
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
    // A service that is just starting may take a session and lose it.
    let losses = told["losses"].as_u64().unwrap();
    assert!(told["frames"] == 60 && (1..=3).contains(&losses), "{told} {said}");
    assert!(said.contains("waiting for it to come back") && said.contains("is back"), "{said}");
    let counted = monado.calls("compositor_layer_sync");
    // The tenth picture may have been on its way when the service died: then nobody has counted it as shown. A board
    // comes before each first one.
    assert!((2..=52).contains(&counted), "{counted} layers after the service came back");
}

/// The left eye's angles to left, right, up and down: wider outwards and downwards.
const FOV: [f32; 4] = [-0.9, 0.6, 0.7, -0.8];

/// The part of a picture of both eyes that an eye sees.
fn half(window: &Display, right: bool) -> Display {
    let start = if right { EYE_WIDTH as usize } else { 0 };
    let rows = window.pixels.chunks(2 * EYE_WIDTH as usize);
    let pixels = rows.flat_map(|row| row[start..start + EYE_WIDTH as usize].to_vec()).collect();
    Display { width: EYE_WIDTH, height: EYE_HEIGHT, pixels }
}

/// What a screen shows of the scene to an eye, by this program's own renderer: black beyond the eye's
/// field of view. Pixels at its edge, where the compositor blends, are left out: `None`.
fn expected(folder: &Path, view: &Value) -> Vec<Option<[f32; 3]>> {
    let numbers = |key: &str| -> Vec<f64> { serde_json::from_value(view[key].clone()).unwrap() };
    let (position, rotation, fov) = (numbers("position"), numbers("rotation"), numbers("fov"));
    let world_from_eye = Pose::new(DQuat::from_slice(&rotation), DVec3::from_slice(&position));
    let [across, up] = SCREEN;
    let screen = FieldOfView { left: -across, right: across, up, down: -up };
    let view = View {
        world_from_eye,
        fov: screen,
        width: EYE_WIDTH,
        height: EYE_HEIGHT,
        spacing: Default::default(),
    };
    let context = Context::new(&ContextOptions::default()).unwrap();
    let devices = device::list();
    let device = Device::open(devices.iter().find(|device| device.unusable.is_none()).unwrap()).unwrap();
    let mut config = Config::default();
    config.foveation.samples = Samples::Full;
    config.trace.indirect = Indirect::Paths;
    let loaded = Loaded::from_file(&folder.join("scene.glb"), &config).unwrap();
    let mut renderer = Renderer::new(&device, &context, &loaded, &config, Output::Display).unwrap().0;
    renderer.frame(&Plan::mono(view), &[], 7).unwrap();
    let picture = Display::from_rgba(EYE_WIDTH, EYE_HEIGHT, &renderer.picture().unwrap());
    let edges = [fov[0], fov[1], fov[2], fov[3]].map(|degrees| degrees.to_radians().tan());
    let pixel = |(index, &pixel): (usize, &[f32; 3])| {
        let at = DVec2::new((index as u32 % EYE_WIDTH) as f64, (index as u32 / EYE_WIDTH) as f64);
        let ahead = view.eye_direction(at + 0.5);
        let inside = [ahead.x - edges[0], edges[1] - ahead.x, edges[2] - ahead.y, ahead.y - edges[3]];
        let nearest = inside.into_iter().fold(f64::INFINITY, f64::min);
        if nearest.abs() < 0.012 { None } else { Some(if nearest > 0.0 { pixel } else { [0.0; 3] }) }
    };
    picture.pixels.iter().enumerate().map(pixel).collect()
}

/// Mean absolute difference of what is shown from what is expected, where anything is.
fn difference(shown: &[[f32; 3]], expected: &[Option<[f32; 3]>]) -> f64 {
    let pairs = shown.iter().zip(expected).filter_map(|(shown, expected)| Some((shown, (*expected)?)));
    let apart: Vec<f64> = pairs
        .map(|(a, b)| (0..3).map(|channel| f64::from((a[channel] - b[channel]).abs())).sum::<f64>() / 3.0)
        .collect();
    assert!(apart.len() > shown.len() / 2, "most pixels are compared");
    apart.iter().sum::<f64>() / apart.len() as f64
}

#[test]
fn the_wearer_sees_what_is_rendered_from_the_same_eyes() {
    if !monado::installed() || !window::installed() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path());
    let screen = Screen::start();
    let (port, settings) = window::remote_settings(folder.path(), &screen);
    let monado = Monado::start(folder.path(), &settings);
    let mirrored = [-FOV[1], -FOV[0], FOV[2], FOV[3]];
    let eyes = [(FOV, -0.04), (mirrored, 0.04)].map(|(fov, x)| RemoteEye { fov, position: [x, 0.0, 0.0] });
    let turn = (0.1f32.sin(), 0.1f32.cos());
    let _headset = window::send(port, eyes, ([0.0, turn.0, 0.0, turn.1], [0.2, 1.55, 0.1]));

    let mut client = foveate(folder.path(), "run scene.glb --json --width 960 --height 540");
    // A picture that nothing came before has no light of earlier frames, and its own exposure.
    client.args(["--samples", "20000", "--rays", "16", "--exposure", "0", "--set", "trace.indirect=paths"]);
    monado.serve(&mut client);
    let child = client.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let start = Instant::now();
    while monado.calls("compositor_layer_sync") < 8 {
        assert!(start.elapsed() < Duration::from_secs(120), "{}", monado.log());
        std::thread::sleep(Duration::from_millis(100));
    }
    let window = screen.window();
    // Ctrl-C ends it, and it tells where the eyes were.
    Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let told = summary(&output.stdout);
    assert!(told["frames"].as_u64().unwrap() >= 7, "{told}");
    let fov = told["views"][0]["fov"][0].as_f64().unwrap();
    assert!((fov - f64::from(FOV[0]).to_degrees()).abs() < 0.01, "the headset's own field of view: {told}");

    let wanted = [0, 1].map(|eye| expected(folder.path(), &told["views"][eye]));
    let shown = [false, true].map(|right| half(&window, right).pixels);
    for eye in [0, 1] {
        let same = difference(&shown[eye], &wanted[eye]);
        assert!(same < 0.02, "eye {eye} differs by {same}");
        // The same measure tells pictures that are wrong: the other eye's, mirrored, and sRGB encoded twice.
        let mirrored: Vec<_> =
            shown[eye].chunks(EYE_WIDTH as usize).flat_map(|row| row.iter().rev().copied()).collect();
        let encoded: Vec<_> = shown[eye].iter().map(|pixel| pixel.map(|c| c.powf(1.0 / 2.2))).collect();
        for (wrong, name) in [(&shown[1 - eye], "other"), (&mirrored, "mirrored"), (&encoded, "encoded")] {
            let differs = difference(wrong, &wanted[eye]);
            assert!(differs > 2.0 * same.max(0.01), "{name}: {differs}, as it is {same}");
        }
    }
}

/// What docs/headsets.md tells users to type starts a service that answers, with no display and no terminal.
#[test]
fn the_documented_line_starts_monado() {
    if !monado::installed() {
        return;
    }
    let page =
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/headsets.md")).unwrap();
    let line = page.lines().find_map(|line| line.strip_prefix("    ")?.strip_suffix(" monado-service"));
    let settings: Vec<(&'static str, String)> = line
        .expect("the line")
        .split(' ')
        .map(|word| word.split_once('=').expect("a variable"))
        .map(|(name, value)| (&*name.to_string().leak(), value.to_string()))
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let _monado = Monado::start_bare(folder.path(), &settings);
}
