//! `foveate run` on a scripted OpenXR runtime (`tests/fake_runtime/`), which does what Monado cannot, and
//! which finds every call out of order.

#[path = "../common/mod.rs"]
mod common;

mod board;
mod budget;
mod changes;
mod codes;
mod controllers;
mod cycles;
mod depth;
mod extras;
mod faults;
mod frames;
mod grabs;
mod hands;
mod hangs;
#[cfg(unix)]
mod keyboard;
mod losses;
#[cfg(feature = "window")]
mod mirror;
mod moments;
mod motion;
mod pictures;
#[cfg(feature = "window")]
#[path = "../window/screen.rs"]
mod screen;
mod states;
mod times;
mod views;

use std::path::Path;
use std::process::{Child, Command, Output};
use std::time::{Duration, Instant};

use common::builder::Builder;
use fake_runtime::Setup;
use fake_runtime::log::{Log, Record};
use fake_runtime::script::{Script, Session};
use serde_json::{Value, json};
use tempfile::TempDir;

/// What a run left behind.
#[derive(Debug)]
struct Run {
    code: Option<i32>,
    out: String,
    said: String,
    log: Log,
    _folder: TempDir,
}

/// A script with these sessions.
fn sessions(sessions: Vec<Session>) -> Script {
    Script { sessions, ..Script::default() }
}

/// The square that is looked for in pictures: its middle, and half its side, metres.
const SQUARE: ([f64; 3], f64) = ([0.25, 1.75, -3.0], 0.2);

/// Writes `scene.glb`: a red square, and a grey floor far below.
fn write_scene(folder: &Path) {
    let mut builder = Builder::new();
    let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0f32]];
    let (positions, indices) = (builder.floats(&corners), builder.shorts(&[0, 1, 2, 0, 2, 3]));
    let half = 0.5f64.sqrt();
    let (at, side) = SQUARE;
    let parts = [
        ([1.0, 0.0, 0.0], json!({ "translation": at, "scale": [side, side, 1.0] })),
        ([0.3, 0.3, 0.3], json!({ "rotation": [-half, 0.0, 0.0, half], "scale": [9, 9, 1] })),
    ];
    for ([r, g, b], place) in parts {
        let finish = json!({ "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0 });
        let unlit = json!({ "KHR_materials_unlit": {} });
        let material = json!({ "pbrMetallicRoughness": finish, "doubleSided": true, "extensions": unlit });
        let material = builder.push("materials", material);
        let primitive =
            json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": material });
        builder.place(primitive, place);
    }
    builder.json["extensionsUsed"] = json!(["KHR_materials_unlit"]);
    builder.write_glb(folder);
}

/// The eye's place that the wearer's LOCAL space is put at, metres.
const REST: [f64; 3] = [0.0, 1.6, 0.0];

/// Runs the program with few samples until it has shown some frames; nothing where it cannot be run.
fn run(script: &Script, frames: u32, more: &str) -> Option<Run> {
    run_with(script, frames, &format!("{FEW} {more}"))
}

/// The same with the usual settings but these.
fn run_with(script: &Script, frames: u32, flags: &str) -> Option<Run> {
    if !possible() {
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    let (mut command, setup) = command_with(folder.path(), script, frames, flags);
    Some(finished(command.output().unwrap(), setup.log(), folder))
}

/// Few samples: whoever gives their number does not have the display's period held.
const FEW: &str = "--samples 300 --rays 1";

/// The program in a folder with a scene and a runtime of its own, with few samples.
fn command(folder: &Path, script: &Script, frames: u32, more: &str) -> (Command, Setup) {
    command_with(folder, script, frames, &format!("{FEW} {more}"))
}

/// The same with the usual settings but these.
fn command_with(folder: &Path, script: &Script, frames: u32, flags: &str) -> (Command, Setup) {
    write_scene(folder);
    let setup = Setup::new(folder, script);
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    command.current_dir(folder).args(["run", "scene.glb", "--json", "--frames", &frames.to_string()]);
    command.args("--position 0,1.6,0 --look-at 0,1.6,-1".split(' '));
    setup.apply(command.args(flags.split_whitespace()));
    (command, setup)
}

/// Frames that a program in a folder has ended so far.
fn ended(folder: &Path) -> usize {
    let log = folder.join(Script::default().log);
    if log.exists() { Log::read(&log).calls("xrEndFrame").len() } else { 0 }
}

/// Waits until it has ended so many.
fn await_frames(child: &mut Child, folder: &Path, count: usize) {
    let start = Instant::now();
    while ended(folder) < count {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        assert!(start.elapsed() < Duration::from_secs(120), "it shows no frames");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// What a run that has ended left behind.
fn finished(output: Output, log: Log, folder: TempDir) -> Run {
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let (out, said) = (text(output.stdout), text(output.stderr));
    assert!(!said.contains("panicked"), "{said}");
    times::check(&log);
    Run { code: output.status.code(), out, said, log, _folder: folder }
}

/// Whether OpenXR's loader and Vulkan are there; says so where one is missing, which is a failure on machines
/// that promise them (CI=true).
fn possible() -> bool {
    let missing = missing();
    if let Some(missing) = &missing {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "{missing}");
        println!("not run: {missing}");
    }
    missing.is_none()
}

/// What stands in the way: asked of the program itself, which says so in one sentence.
fn missing() -> Option<String> {
    let folder = tempfile::tempdir().unwrap();
    if common::vulkan().is_none() {
        return Some("no Vulkan device".into());
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    write_scene(folder.path());
    command.current_dir(folder.path()).args(["run", "scene.glb", "--frames", "1"]);
    command.env("XR_RUNTIME_JSON", folder.path().join("none.json")).env("XR_LOADER_DEBUG", "none");
    let said = String::from_utf8(command.output().unwrap().stderr).unwrap();
    said.contains("libopenxr-loader1").then(|| "no OpenXR loader".to_string())
}

impl Run {
    /// It ended as it should: no rule broken, nothing left, success.
    fn is_clean(&self) -> &Self {
        assert_eq!(self.log.violations(), Vec::<String>::new(), "{}", self.said);
        assert_eq!(self.log.leftovers(), Vec::<String>::new(), "{}", self.said);
        assert_eq!(self.code, Some(0), "{}", self.said);
        self
    }

    /// What it told at its end.
    fn told(&self) -> Value {
        serde_json::from_str(&self.out).unwrap_or_else(|e| panic!("{e}: {self:?}"))
    }

    /// The frames that were ended, in order.
    fn frames(&self) -> Vec<&Record> {
        let mut frames = self.log.calls("xrEndFrame");
        frames.retain(|frame| frame.result() == "SUCCESS");
        frames
    }

    /// The views of the one layer of each frame that has one.
    fn layers(&self) -> Vec<(&Record, &Vec<Value>)> {
        let frames = self.frames().into_iter();
        frames.filter_map(|frame| Some((frame, frame.0["layers"][0]["views"].as_array()?))).collect()
    }
}
