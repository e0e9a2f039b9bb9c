//! What a new gaze costs: `cargo bench --bench gaze [-- --repeats 9]`.
//!
//! The gaze jumps from point to point, as eyes do. For each jump the pattern is made anew, and its neighbours are
//! found on the presenting device. Prints the medians in a table in Markdown: `pattern` on the host, then the
//! stages on the device, in milliseconds; `all` is from the jump until all is found.

use std::time::Instant;

use foveate::foveation::{Law, Pattern};
use foveate::gpu::vulkan::{Context, ContextOptions};
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::metrics::stats::median;
use foveate::reconstruct::{Mode, Reconstruction, Settings};
use glam::DVec2;

/// Where the eye looks, one after the other.
const GAZES: [[f64; 2]; 3] = [[0.5, 0.5], [0.2, 0.7], [0.9, 0.1]];
const STAGES: [&str; 4] = ["upload", "radii", "pixels", "samples"];

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |flag: &str| arguments.iter().position(|a| a == flag).and_then(|at| arguments.get(at + 1));
    let repeats: usize = value("--repeats").map_or(3, |number| number.parse().expect("a number"));
    let context = Context::new(&ContextOptions::default()).expect("a Vulkan device");
    println!("{} (Vulkan), medians of {} jumps, ms\n", context.report().name, repeats * GAZES.len());
    println!("| view | samples | method | pattern | {} | all |", STAGES.join(" | "));
    println!("| --- | --- | --- | --- | {} --- |", "--- | ".repeat(STAGES.len()));
    let (guided, k_nearest) = (Mode::default(), Mode::KNearest);
    for (size, count, mode, law) in [
        ((1280, 800), 55_000, guided, Law::default()),
        ((1280, 800), 55_000, guided, Law::LogPolar { alpha: 4.0 }),
        ((1280, 800), 10_240, guided, Law::default()),
        ((1280, 800), 55_000, k_nearest, Law::default()),
        ((640, 800), 27_500, guided, Law::default()),
    ] {
        let row = jumps(&context, size, count, mode, law, repeats);
        let method = if mode == Mode::KNearest { "k-nn" } else { "guided" };
        let name = if law == Law::default() { "" } else { ", log-polar" };
        println!("| {}x{}{name} | {count} | {method} | {row} |", size.0, size.1);
    }
}

/// The cells of one line.
fn jumps(
    context: &Context,
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
    let mut reconstruction =
        Reconstruction::new(context, Settings { mode, ..Settings::default() }).expect("shaders");
    let mut times: Vec<Vec<f64>> = vec![Vec::new(); STAGES.len() + 2];
    for jump in 0..=repeats * GAZES.len() {
        let gaze = DVec2::from(GAZES[jump % GAZES.len()]);
        let start = Instant::now();
        let pattern = Pattern::new(&view, &law, gaze, count);
        let made = start.elapsed().as_secs_f64() * 1e3;
        reconstruction.set_pattern(0, width, height, &pattern.samples).expect("a pattern");
        let stages = reconstruction.wait_pattern(0).expect("neighbours");
        let all = start.elapsed().as_secs_f64() * 1e3;
        // Drivers finish building shaders at their first use.
        if jump == 0 {
            continue;
        }
        let found = STAGES.map(|name| stages.iter().filter(|s| s.stage == name).map(|s| s.ms).sum());
        let all = [made].into_iter().chain(found).chain([all]);
        times.iter_mut().zip(all).for_each(|(times, ms)| times.push(ms));
    }
    let cell = |times: &Vec<f64>| format!("{:.1}", median(times).unwrap_or(0.0));
    times.iter().map(cell).collect::<Vec<_>>().join(" | ")
}
