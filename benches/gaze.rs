//! What a new gaze costs: `cargo bench --bench gaze [-- --repeats 9]`.
//!
//! The gaze jumps from point to point, as eyes do. For each jump the pattern is made anew, and its neighbours are
//! found on the presenting device, and once more by OpenCL where that is for it. Prints the medians in a table in Markdown: the
//! pattern, with samples sorted into cells, on the host and on the first OpenCL device, then the stages on the presenting device, in
//! milliseconds; `all` is from the jump until all is found, with the pattern of the OpenCL device, `all by OpenCL` the same where that
//! finds the neighbours too. Then whole frames with the
//! default settings while the gaze goes around a circle, held for two frames at each point, and the head sways: what frames
//! with a new gaze take, and those after them with the same one; least, and medians in brackets.

use std::time::Instant;

use foveate::config::{Config, Stereo};
use foveate::foveation::{Cells, Law, Pattern};
use foveate::frame::stereo::parallel_eyes;
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::{Device, device};
use foveate::gpu::vulkan::{Context, ContextOptions};
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::metrics::stats::median;
use foveate::reconstruct::{Mode, Reconstruction, Settings};
use foveate::scene::{default_viewpoint, generate};
use foveate::trace::pattern_maker::{PatternMaker, PatternRequest};
use glam::{DQuat, DVec2, DVec3};

/// Where the eye looks, one after the other.
const GAZES: [[f64; 2]; 3] = [[0.5, 0.5], [0.2, 0.7], [0.9, 0.1]];
const STAGES: [&str; 4] = ["upload", "radii", "pixels", "samples"];

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |flag: &str| arguments.iter().position(|a| a == flag).and_then(|at| arguments.get(at + 1));
    let repeats: usize = value("--repeats").map_or(3, |number| number.parse().expect("a number"));
    let context = Context::new(&ContextOptions::default()).expect("a Vulkan device");
    let info = device::list().into_iter().find(|d| d.unusable.is_none()).expect("an OpenCL device");
    let device = Device::open(&info).expect("the OpenCL device");
    let names = (context.report().name.clone(), repeats * GAZES.len());
    println!("{} (OpenCL), {} (Vulkan), medians of {} jumps, ms\n", info.name, names.0, names.1);
    let stages = STAGES.join(" | ");
    println!("| view | samples | method | on the host | on the device | {stages} | all | all by OpenCL |");
    println!("| --- | --- | --- | --- | --- | {} --- | --- |", "--- | ".repeat(STAGES.len()));
    let (guided, k_nearest) = (Mode::default(), Mode::KNearest);
    for (size, count, mode, law) in [
        ((1280, 800), 55_000, guided, Law::default()),
        ((1280, 800), 55_000, guided, Law::LogPolar { alpha: 4.0 }),
        ((1280, 800), 10_240, guided, Law::default()),
        ((1280, 800), 55_000, k_nearest, Law::default()),
        ((640, 800), 27_500, guided, Law::default()),
    ] {
        let row = jumps(&context, &device, size, count, mode, law, repeats);
        let method = if mode == Mode::KNearest { "k-nn" } else { "guided" };
        let name = if law == Law::default() { "" } else { ", log-polar" };
        println!("| {}x{}{name} | {count} | {method} | {row} |", size.0, size.1);
    }
    println!("\n| two eyes, demo | frame, gaze held | frame, new gaze | of it the pattern |");
    println!("| --- | --- | --- | --- |");
    let loaded = Loaded::from_glb("demo", &generate::demo::generate(), &Config::default()).expect("the demo");
    for size in [(320, 300), (640, 800)] {
        println!("| {}x{} each | {} |", size.0, size.1, frames(&context, &loaded, size, repeats));
    }
}

/// Whole frames, with the gaze held and new: their times in milliseconds, and what patterns take.
fn frames(context: &Context, loaded: &Loaded, (width, height): (u32, u32), repeats: usize) -> String {
    let info = device::list().into_iter().find(|d| d.unusable.is_none()).expect("an OpenCL device");
    let device = Device::open(&info).expect("the OpenCL device");
    let (config, output) = (Config::default(), Output::Display);
    let mut renderer = Renderer::new(&device, context, loaded, &config, output).expect("a renderer").0;
    let fov = FieldOfView::symmetric(1.5, f64::from(width) / f64::from(height));
    let rest = default_viewpoint(&loaded.scene, 70.0).world_from_eye;
    let (mut held, mut new, mut pattern) = (Vec::new(), Vec::new(), Vec::new());
    for frame in 0..repeats * 8 + 4 {
        let angle = (frame / 2) as f64 * 0.15;
        let gaze = DVec2::splat(0.5) + DVec2::from_angle(angle) * 0.12;
        // Heads are never quite at rest.
        let sway = DQuat::from_rotation_y(0.002 * (frame as f64 * 0.9).sin());
        let head = rest.then(Pose::new(sway, DVec3::ZERO));
        let eyes = parallel_eyes(head, 0.063, fov, width, height);
        let plan = Plan::stereo(eyes, Stereo::PerEye).expect("two eyes");
        let report = renderer.frame(&plan, &plan.gaze_points(gaze), frame as u32).expect("a frame");
        if frame < 4 {
            continue;
        }
        if frame % 2 == 0 {
            new.push(report.frame_ms);
            pattern.push(report.pattern_ms);
        } else {
            held.push(report.frame_ms);
        }
    }
    let cell = |times: &[f64]| {
        let least = times.iter().copied().fold(f64::INFINITY, f64::min);
        format!("{least:.1} ({:.1})", median(times).unwrap_or(0.0))
    };
    [&held, &new, &pattern].map(|times| cell(times)).join(" | ")
}

/// The cells of one line.
fn jumps(
    context: &Context,
    device: &Device,
    (width, height): (u32, u32),
    count: usize,
    mode: Mode,
    law: Law,
    repeats: usize,
) -> String {
    let across = f64::from(width) / f64::from(height);
    let view = View {
        world_from_eye: Pose::IDENTITY,
        fov: FieldOfView::symmetric(1.4, across),
        width,
        height,
        spacing: Default::default(),
    };
    let settings = Settings { mode, ..Settings::default() };
    let made = || Reconstruction::new(context, settings).expect("shaders");
    let (mut reconstruction, mut by_opencl) = (made(), made());
    let mut maker = PatternMaker::new(device).expect("kernels");
    let mut finding = PatternMaker::with_neighbours(device, context, settings.lists()).expect("kernels");
    let mut times: Vec<Vec<f64>> = vec![Vec::new(); STAGES.len() + 4];
    for jump in 0..=repeats * GAZES.len() {
        let gaze = DVec2::from(GAZES[jump % GAZES.len()]);
        let start = Instant::now();
        let pattern = Pattern::new(&view, &law, gaze, count);
        std::hint::black_box(Cells::new(width, height, &pattern.samples).expect("cells"));
        let on_host = start.elapsed().as_secs_f64() * 1e3;
        let start = Instant::now();
        let wanted = PatternRequest { view, law, gaze, count, hidden: None, lens: None };
        let (pattern, searched) = maker.choose(&wanted).expect("a pattern");
        let on_device = start.elapsed().as_secs_f64() * 1e3;
        let size = (width, height);
        reconstruction.set_sorted_pattern(0, size, &pattern.samples, Some(searched)).expect("neighbours");
        let stages = reconstruction.wait_pattern(0).expect("neighbours");
        let all = start.elapsed().as_secs_f64() * 1e3;
        let start = Instant::now();
        let (pattern, searched) = finding.choose(&wanted).expect("a pattern");
        by_opencl.set_sorted_pattern(0, size, &pattern.samples, Some(searched)).expect("neighbours");
        by_opencl.wait_pattern(0).expect("neighbours");
        let all_by_opencl = start.elapsed().as_secs_f64() * 1e3;
        // Drivers finish building shaders at their first use.
        if jump == 0 {
            continue;
        }
        let found = STAGES.map(|name| stages.iter().filter(|s| s.stage == name).map(|s| s.ms).sum());
        let all = [on_host, on_device].into_iter().chain(found).chain([all, all_by_opencl]);
        times.iter_mut().zip(all).for_each(|(times, ms)| times.push(ms));
    }
    let cell = |times: &Vec<f64>| format!("{:.1}", median(times).unwrap_or(0.0));
    times.iter().map(cell).collect::<Vec<_>>().join(" | ")
}
