//! What the cache of light does from frame to frame:
//! `cargo bench --bench light -- --scene FILE [--position 0,1,0 --look-at 1,1,0 --size 480x300 --frames 40 --passes 24]`.
//!
//! Frames at rest from an empty cache on, compared with paths of four bounces in every pixel, averaged over passes: how
//! bright they are beside these, their relative squared error, and how much they change from one to the next after a blur
//! of 9 pixels, relative to the mean. Then frames with the cache and with direct light only in turns: the least time and
//! the least processor time of each. Tables in Markdown.

use foveate::bench::cpu_time;
use foveate::config::{Config, Indirect, Method, Samples};
use foveate::foveation::Law;
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::{Device, device};
use foveate::gpu::vulkan::{Context, ContextOptions};
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::scene::{default_viewpoint, generate};
use glam::DVec3;

/// Pixels to each side that a blur averages.
const BLUR: usize = 4;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |flag: &str| arguments.iter().position(|a| a == flag).and_then(|at| arguments.get(at + 1));
    let numbers = |flag: &str, between: char| {
        value(flag)
            .map(|text| text.split(between).map(|n| n.parse::<f64>().expect("numbers")).collect::<Vec<_>>())
    };
    let count = |flag: &str, otherwise: u32| value(flag).map_or(otherwise, |n| n.parse().expect("a number"));
    let (frames, passes) = (count("--frames", 40), count("--passes", 24));
    let size = numbers("--size", 'x').unwrap_or_else(|| vec![480.0, 300.0]);
    let mut config = Config::default();
    config.foveation.samples = Samples::Share(55_000.0 / 1_024_000.0);
    let loaded = match value("--scene").map_or("demo", String::as_str) {
        "demo" => Loaded::from_glb("demo", &generate::demo::generate(), &config),
        path => Loaded::from_file(path.as_ref(), &config),
    }
    .expect("the scene");
    let point = |flag: &str| numbers(flag, ',').map(|p| DVec3::new(p[0], p[1], p[2]));
    let rest = default_viewpoint(&loaded.scene, 70.0).world_from_eye;
    let eye = match (point("--position"), point("--look-at")) {
        (Some(from), Some(to)) => Pose::look_at(from, to),
        _ => rest,
    };
    let fov = FieldOfView::symmetric(70f64.to_radians(), size[0] / size[1]);
    let plan = Plan::mono(View {
        world_from_eye: eye,
        fov,
        width: size[0] as u32,
        height: size[1] as u32,
        spacing: Default::default(),
    });

    let context = Context::new(&ContextOptions::default()).expect("a Vulkan device");
    let info = device::list().into_iter().find(|d| d.unusable.is_none()).expect("an OpenCL device");
    let tracer = Device::open(&info).expect("the OpenCL device");
    let open = |config: &Config| {
        Renderer::new(&tracer, &context, &loaded, config, Output::Radiance).expect("a renderer").0
    };
    let truth = reference(&mut open(&exact(&config)), &plan, passes);
    let mean = truth.iter().sum::<f64>() / truth.len() as f64;
    println!(
        "the reference's mean is {mean:.5}\n\n| frame | mean, of the reference's | relMSE | change |\n| --- | --- | --- | --- |"
    );
    let mut cached = open(&config);
    let mut before: Option<Vec<f64>> = None;
    for frame in 1..=frames {
        let picture = shown(&mut cached, &plan, frame);
        let ratio = picture.iter().sum::<f64>() / picture.len() as f64 / mean;
        let blurred = blur(&picture, size[0] as usize);
        let change = before.as_ref().map_or(f64::NAN, |old| distance(old, &blurred) / mean);
        before = Some(blurred);
        if frame <= 4 || frame.is_power_of_two() || frame.is_multiple_of(10) {
            println!(
                "| {frame} | {ratio:.4} | {:.4} | {:.2} % |",
                relative(&picture, &truth, mean),
                change * 100.0
            );
        }
    }
    config.trace.indirect = Indirect::Paths;
    let mut direct = open(&config);
    let still = [1, 2].map(|seed| blur(&shown(&mut direct, &plan, seed), size[0] as usize));
    let change = distance(&still[0], &still[1]) / mean;
    println!("\ndirect light alone changes by {:.2} % of the same mean", change * 100.0);
    let (mut times, mut works) = ([f64::INFINITY; 2], [f64::INFINITY; 2]);
    for round in 0..frames.min(12) {
        for (which, renderer) in [&mut direct, &mut cached].into_iter().enumerate() {
            let start = cpu_time::of_all_threads().unwrap_or(0);
            let report = renderer.frame(&plan, &[], 1000 + round).expect("a frame");
            let work = (cpu_time::of_all_threads().unwrap_or(0) - start) as f64 * 1e-6;
            times[which] = times[which].min(report.frame_ms);
            works[which] = works[which].min(work);
        }
    }
    println!("\n| | frame ms | processor ms |\n| --- | --- | --- |");
    println!(
        "| direct light | {:.1} | {:.1} |\n| with the cache | {:.1} | {:.1} |",
        times[0], works[0], times[1], works[1]
    );
    println!("| ratio | {:.3} | {:.3} |", times[1] / times[0], works[1] / works[0]);
}

fn exact(config: &Config) -> Config {
    let mut config = config.clone();
    config.foveation.samples = Samples::Full;
    config.foveation.law = Law::Full;
    config.reconstruction.method = Method::KNearest;
    config.reconstruction.k = 1;
    config.trace.bounces = 4;
    config
}

/// A frame's luminances.
fn shown(renderer: &mut Renderer, plan: &Plan, seed: u32) -> Vec<f64> {
    renderer.frame(plan, &[], seed).expect("a frame");
    let pixels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&renderer.picture().expect("pixels"));
    let luminance = |p: &[f32; 4]| 0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2];
    pixels.iter().map(|p| f64::from(luminance(p))).collect()
}

fn reference(renderer: &mut Renderer, plan: &Plan, passes: u32) -> Vec<f64> {
    let mut sum: Vec<f64> = Vec::new();
    for pass in 0..passes {
        let picture = shown(renderer, plan, pass);
        sum.resize(picture.len(), 0.0);
        sum.iter_mut().zip(&picture).for_each(|(sum, value)| *sum += value / f64::from(passes));
    }
    sum
}

/// Mean of squared differences relative to the truth, and to a tenth of its mean.
fn relative(picture: &[f64], truth: &[f64], mean: f64) -> f64 {
    let each = picture.iter().zip(truth).map(|(p, t)| (p - t).powi(2) / (t * t + 1e-2 * mean * mean));
    each.sum::<f64>() / truth.len() as f64
}

/// Root of the mean squared difference.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

/// Means of squares of pixels, along rows and then along columns; edges go on.
fn blur(picture: &[f64], width: usize) -> Vec<f64> {
    let height = picture.len() / width;
    let mean = |at: usize, length: usize, value: &dyn Fn(usize) -> f64| {
        let near = (0..=2 * BLUR).map(|i| value((at + i).saturating_sub(BLUR).min(length - 1)));
        near.sum::<f64>() / (2 * BLUR + 1) as f64
    };
    let rows: Vec<f64> =
        (0..picture.len()).map(|i| mean(i % width, width, &|x| picture[i / width * width + x])).collect();
    (0..picture.len()).map(|i| mean(i / width, height, &|y| rows[y * width + i % width])).collect()
}
