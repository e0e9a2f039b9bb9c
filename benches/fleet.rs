//! What sharing a frame costs and gains: `cargo bench --bench fleet [-- --frames 12 --factor 3]`.
//!
//! First the cost of balancing itself, for fleets of 2, 4 and 16 devices on a view of 1280x800 pixels with
//! 55,000 samples. Then frames of the demo scene on one half of the first OpenCL device, on both halves, and
//! on both where the second does all its work `factor` times, frame by frame in turn. Times are the
//! devices' own. Prints tables in Markdown.

#[path = "../tests/fleet/slow.rs"]
mod slow;

use std::sync::Arc;
use std::time::Instant;

use foveate::bench::cpu_time;
use foveate::config::{Config, Samples};
use foveate::foveation::{Law, Pattern, Workload};
use foveate::frame::balance::{Balancer, Observation, Slice};
use foveate::frame::{FrameReport, Loaded, Output, Plan, Renderer, Scheduler};
use foveate::gpu::opencl::{Device, device};
use foveate::gpu::vulkan::{Context, ContextOptions};
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::metrics::stats::{median, percentile};
use foveate::scene::{default_viewpoint, generate};
use foveate::trace::{DeviceWorker, Fleet, Opener, SceneData, Traversal, Worker};
use glam::DVec2;

/// Frames that do not count: shares settle, and drivers finish building kernels.
const WARM: usize = 5;

fn main() {
    let (mut frames, mut factor) = (12, 3);
    let mut words = std::env::args().skip(1).filter(|word| word != "--bench");
    while let Some(word) = words.next() {
        let value = words.next().unwrap_or_else(|| panic!("{word} needs a value"));
        match word.as_str() {
            "--frames" => frames = value.parse().expect("a number of frames"),
            "--factor" => factor = value.parse().expect("a number of times"),
            other => panic!("{other} is not known"),
        }
    }
    balancing();
    sharing(frames, factor);
}

fn view(world_from_eye: Pose, fov_y: f64, width: u32, height: u32) -> View {
    let fov = FieldOfView::symmetric(fov_y, f64::from(width) / f64::from(height));
    View { world_from_eye, fov, width, height, spacing: Default::default() }
}

/// Splitting and observing, without any device.
fn balancing() {
    println!("| devices | balancing a view, median | p99 |");
    println!("| --- | --- | --- |");
    let view = view(Pose::IDENTITY, 1.2, 1280, 800);
    let pattern = Pattern::new(&view, &Law::default(), DVec2::splat(0.5), 55_000);
    let workload = Workload::new(&pattern, true);
    let seen: Vec<f32> = (0..workload.tiles()).map(|tile| (tile % 7) as f32 / 6.0).collect();
    for devices in [2, 4, 16] {
        let mut balancer = Balancer::new(devices);
        let mut times = Vec::new();
        for frame in 0..2000u32 {
            let start = Instant::now();
            let parts = balancer.split(0, &workload);
            let mut spent = start.elapsed();
            let slices = |part| {
                let slices = workload.slices(part, 4).into_iter();
                let ms = |part: &foveate::foveation::Part| {
                    part.samples.len() as f64 * 1e-3 * (1.0 + f64::from(frame % 5) * 0.01)
                };
                slices.map(|part| Slice { pixels_ms: 0.5, samples_ms: ms(&part), part }).collect()
            };
            let observed: Vec<Observation> = parts
                .iter()
                .map(|(device, part)| Observation { device: *device, slices: slices(part), overhead_ms: 0.1 })
                .collect();
            let start = Instant::now();
            balancer.observe(0, &workload, &seen, &observed);
            spent += start.elapsed();
            times.push(spent.as_secs_f64() * 1e3);
        }
        println!(
            "| {devices} | {:.3} ms | {:.3} ms |",
            median(&times).unwrap_or(0.0),
            percentile(&times, 99.0).unwrap_or(0.0)
        );
    }
}

fn sharing(frames: usize, factor: u32) {
    let context = Context::new(&ContextOptions::default()).expect("a Vulkan device");
    let info = device::list().into_iter().find(|d| d.unusable.is_none()).expect("an OpenCL device");
    let half = info.compute_units / 2;
    let parts = device::subdivide(&info, &[half, half]).expect("a device that can be divided");
    let parts: Vec<Device> = parts.iter().map(|part| Device::open(part).expect("a part")).collect();
    let mut config = Config::default().without_reuse();
    config.foveation.samples = Samples::Count(55_000);
    let loaded = Loaded::from_glb("demo", &generate::demo::generate(), &config).expect("the demo scene");
    let data = Arc::new(
        SceneData::pack(&loaded.scene, &loaded.bvh, &loaded.environment).expect("a scene that can be packed"),
    );
    let eye = default_viewpoint(&loaded.scene, config.view.fov_y);
    let plan = Plan::mono(view(eye.world_from_eye, eye.fov_y, 1280, 800));

    let opener = |index: usize, times: u32| -> (String, Opener) {
        let (device, data) = (parts[index].clone(), data.clone());
        let open: Opener = Box::new(move |_| {
            let worker = DeviceWorker::new(&device, &data, Traversal::for_device(&device).into(), false)?;
            Ok(Box::new(slow::Slow { worker, times }) as Box<dyn Worker>)
        });
        (parts[index].info().name.clone(), open)
    };
    let renderer = |openers: Vec<(String, Opener)>| {
        let scheduler = Scheduler::new(Fleet::new(openers).expect("devices"), None);
        Renderer::with_scheduler(scheduler, &context, &loaded, &config, Output::Display)
            .expect("a renderer")
            .0
    };
    let mut fleets = [
        ("one half", renderer(vec![opener(0, 1)])),
        ("two halves", renderer(vec![opener(0, 1), opener(1, 1)])),
        ("two halves, one of them slowed", renderer(vec![opener(0, 1), opener(1, factor)])),
    ];
    let mut reports: [Vec<FrameReport>; 3] = Default::default();
    let mut spent: [Vec<f64>; 3] = Default::default();
    for frame in 0..WARM + frames {
        for (((_, renderer), reports), spent) in fleets.iter_mut().zip(&mut reports).zip(&mut spent) {
            let before = cpu_time::of_all_threads();
            let report = renderer.frame(&plan, &[], frame as u32).expect("a frame");
            let after = cpu_time::of_all_threads();
            if frame >= WARM {
                reports.push(report);
                spent.push(after.zip(before).map_or(f64::NAN, |(after, before)| (after - before) as f64));
            }
        }
    }
    println!("\n{}: 2 of {half} units; the slowed one does its work {factor} times\n", info.name);
    println!(
        "| devices | slowest device, ms | speed-up | all devices' time over one's | spread | shares | processor time |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    let of = |reports: &[FrameReport], value: &dyn Fn(&FrameReport) -> f64| {
        median(&reports.iter().map(value).collect::<Vec<_>>()).unwrap_or(0.0)
    };
    let busy = |f: &FrameReport| f.devices.iter().map(|d| d.busy_ms()).collect::<Vec<_>>();
    let most = |f: &FrameReport| busy(f).into_iter().fold(0.0, f64::max);
    let one = of(&reports[0], &most);
    let one_spent = median(&spent[0]).unwrap_or(0.0);
    for (((name, _), reports), spent) in fleets.iter().zip(&reports).zip(&spent) {
        let least = |f: &FrameReport| busy(f).into_iter().fold(f64::INFINITY, f64::min);
        let share = |device: usize| of(reports, &|f| f.devices[device].samples as f64 / f.samples as f64);
        let shares: Vec<String> =
            (0..reports[0].devices.len()).map(|d| format!("{:.0} %", 100.0 * share(d))).collect();
        println!(
            "| {name} | {:.0} | {:.2} | {:.2} | {:.1} % | {} | {:.3} |",
            of(reports, &most),
            one / of(reports, &most),
            of(reports, &|f| busy(f).iter().sum::<f64>()) / one,
            100.0 * of(reports, &|f| (most(f) - least(f)) / most(f)),
            shares.join(", "),
            median(spent).unwrap_or(f64::NAN) / one_spent
        );
    }
}
