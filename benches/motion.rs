//! What moving things cost: `cargo bench --bench motion [-- --frames 20]`.
//!
//! First what brings a scene to a frame's instant, without any rays, on the host and until a device has it: a thousand
//! turning balls of a thousand triangles each, and a skinned and morphed tube of 100,000 triangles, deformed by the host and
//! by the device. Then frames of that tube after ten seconds of motion on its refitted tree beside a fresh one, and of the
//! demo scene moving beside frozen, frame by frame in turn. Prints tables in Markdown.

#[path = "../tests/common/mod.rs"]
mod common;

use std::path::Path;
use std::time::Instant;

use foveate::bench::cpu_time;
use foveate::bvh::Parted;
use foveate::config::{Config, Samples};
use foveate::frame::{FrameReport, Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::{Device, device};
use foveate::gpu::vulkan::{Context, ContextOptions};
use foveate::math::view::{FieldOfView, View};
use foveate::metrics::stats::median;
use foveate::scene::{default_viewpoint, generate};
use foveate::trace::{DeformedBy, MovingScene, Tracer};

use common::moving::{balls, tube_of};

/// The instant that frames are compared at, in seconds, and frames from one to the next.
const SECONDS: f64 = 10.0;
const PERIOD: f64 = 1.0 / 90.0;

fn main() {
    let mut frames = 20;
    let mut words = std::env::args().skip(1).filter(|word| word != "--bench");
    while let Some(word) = words.next() {
        let value = words.next().unwrap_or_else(|| panic!("{word} needs a value"));
        match word.as_str() {
            "--frames" => frames = value.parse().expect("a number of frames"),
            other => panic!("{other} is not known"),
        }
    }
    let folder = tempfile::tempdir().expect("a folder for scenes");
    let write = |name: &str, builder: common::builder::Builder| {
        let below = folder.path().join(name);
        std::fs::create_dir(&below).expect("a folder for a scene");
        builder.write_glb(&below)
    };
    let (balls, tube) = (write("balls", balls(1000)), write("tube", tube_of(201, 250)));
    let info = device::list().into_iter().find(|d| d.unusable.is_none()).expect("an OpenCL device");
    let machine = Machine {
        device: Device::open(&info).expect("the device"),
        context: Context::new(&ContextOptions::default()).expect("a Vulkan device"),
    };
    println!(
        "| what moves | triangles | to an instant, least | median | and on the device | median | processor time |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    machine.update("1000 rigid balls", &balls, frames, &[DeformedBy::Host]);
    machine.update(
        "a tube on 8 joints with 2 morph targets",
        &tube,
        frames,
        &[DeformedBy::Host, DeformedBy::Devices],
    );
    println!("\n| frames of 640x400 | camera rays, least | shading, least | frame, least | median |");
    println!("| --- | --- | --- | --- | --- |");
    machine.refitted(&tube, frames);
    machine.demo(frames);
}

fn config(time: f64) -> Config {
    let mut config = Config::default();
    (config.scene.animation, config.scene.time) = ("all".into(), time);
    config.foveation.samples = Samples::Count(14_000);
    config
}

/// A scene that is brought to instants, and how long each took in milliseconds.
struct Side {
    moving: MovingScene,
    tracer: Tracer,
    host: Vec<f64>,
    /// With the device.
    whole: Vec<f64>,
    /// Nanoseconds of processors.
    spent: u64,
}

impl Side {
    fn of(device: &Device, loaded: &Loaded, parted: &Parted, by: DeformedBy) -> Side {
        let moving = MovingScene::new(&loaded.scene, loaded.trees(), parted, by).expect("a moving scene");
        let tracer =
            Tracer::new(device, &loaded.scene, loaded.trees(), &loaded.environment).expect("a tracer");
        Side { moving, tracer, host: Vec::new(), whole: Vec::new(), spent: 0 }
    }

    fn bring_to(&mut self, time: f64, device: &Device) {
        let (start, before) = (Instant::now(), cpu_time::of_all_threads());
        let state = self.moving.at(time);
        self.host.push(start.elapsed().as_secs_f64() * 1e3);
        self.tracer.move_to(&state).expect("the device");
        device.finish().expect("the device");
        self.whole.push(start.elapsed().as_secs_f64() * 1e3);
        let after = cpu_time::of_all_threads();
        // A thread that has ended meanwhile, as one that built a tree, takes its time along.
        self.spent += after.zip(before).map_or(0, |(after, before)| after.saturating_sub(before));
    }
}

struct Machine {
    device: Device,
    context: Context,
}

impl Machine {
    fn renderer(&self, loaded: &Loaded, config: &Config) -> Renderer {
        Renderer::new(&self.device, &self.context, loaded, config, Output::Display).expect("a renderer").0
    }

    /// A scene that each of some brings to the same instants in turn: on the host alone, and until the device has it.
    fn update(&self, name: &str, path: &Path, frames: usize, all: &[DeformedBy]) {
        let loaded = Loaded::moving_from_file(path, &config(0.0)).expect("the scene");
        let parted = loaded.parted.as_ref().expect("moving parts");
        let mut sides: Vec<_> = all.iter().map(|&by| Side::of(&self.device, &loaded, parted, by)).collect();
        for frame in 0..frames {
            sides.iter_mut().for_each(|side| side.bring_to(frame as f64 * PERIOD, &self.device));
        }
        for (side, by) in sides.iter().zip(all) {
            let [host, whole] = [&side.host, &side.whole].map(|times| {
                (times.iter().copied().fold(f64::INFINITY, f64::min), median(times).unwrap_or(0.0))
            });
            println!(
                "| {name}, by {by:?} | {} | {:.1} ms | {:.1} ms | {:.1} ms | {:.1} ms | {:.1} ms |",
                loaded.scene.triangles(),
                host.0,
                host.1,
                whole.0,
                whole.1,
                side.spent as f64 * 1e-6 / frames as f64,
            );
        }
    }

    /// The tube's tree after ten seconds of motion, and one built there.
    fn refitted(&self, path: &Path, frames: usize) {
        let moving = Loaded::moving_from_file(path, &config(0.0)).expect("the scene");
        let fresh = Loaded::moving_from_file(path, &config(SECONDS)).expect("the scene");
        let mut renderers = [&moving, &fresh].map(|loaded| self.renderer(loaded, &config(0.0)));
        (0..(SECONDS * 30.0) as u32).for_each(|step| renderers[0].show_at(f64::from(step) / 30.0));
        renderers[0].show_at(SECONDS);
        renderers[1].show_at(0.0);
        let reports = in_turn(&mut renderers, &plan(&fresh), frames, |_, _| ());
        tell("tube, refitted for 10 s", &reports[0]);
        tell("tube, fresh tree", &reports[1]);
    }

    fn demo(&self, frames: usize) {
        let bytes = generate::demo::generate();
        let moving = Loaded::moving_from_glb("demo", &bytes, &config(0.0)).expect("the demo scene");
        let frozen = Loaded::from_glb("demo", &bytes, &config(0.0)).expect("the demo scene");
        let mut renderers = [&moving, &frozen].map(|loaded| self.renderer(loaded, &config(0.0)));
        let step = |renderer: &mut Renderer, frame: usize| renderer.show_at(frame as f64 * PERIOD);
        let reports = in_turn(&mut renderers, &plan(&frozen), frames, step);
        tell("demo, moving", &reports[0]);
        tell("demo, frozen", &reports[1]);
    }
}

fn plan(loaded: &Loaded) -> Plan {
    let from = default_viewpoint(&loaded.scene, 60.0);
    let (width, height) = (640, 400);
    let fov = FieldOfView::symmetric(from.fov_y, f64::from(width) / f64::from(height));
    Plan::mono(View { world_from_eye: from.world_from_eye, fov, width, height, spacing: Default::default() })
}

/// Frames of two renderers in turn, after some that do not count.
fn in_turn(
    renderers: &mut [Renderer; 2],
    plan: &Plan,
    frames: usize,
    step: impl Fn(&mut Renderer, usize),
) -> [Vec<FrameReport>; 2] {
    const WARM: usize = 3;
    let mut reports = [Vec::new(), Vec::new()];
    for frame in 0..frames + WARM {
        for (renderer, reports) in renderers.iter_mut().zip(&mut reports) {
            step(renderer, frame);
            reports.push(renderer.frame(plan, &[], frame as u32).expect("a frame"));
        }
    }
    reports.map(|list| list.into_iter().skip(WARM).collect())
}

fn tell(name: &str, reports: &[FrameReport]) {
    let times = |of: &dyn Fn(&FrameReport) -> f64| reports.iter().map(of).collect::<Vec<_>>();
    let least = |of: &dyn Fn(&FrameReport) -> f64| times(of).into_iter().fold(f64::INFINITY, f64::min);
    println!(
        "| {name} | {:.1} ms | {:.1} ms | {:.1} ms | {:.1} ms |",
        least(&|r| r.stages.trace),
        least(&|r| r.stages.shade),
        least(&|r| r.frame_ms),
        median(&times(&|r| r.frame_ms)).unwrap_or(0.0),
    );
}
