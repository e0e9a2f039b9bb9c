//! `foveate bench`: how fast a scene's rays are traced here.

use std::fmt::Write;
use std::path::PathBuf;
use std::time::Instant;

use serde::Serialize;

use super::machine;
use super::options::{Options, RayOptions, eye_fov};
use super::output;
use crate::bench::{Rate, Rates, Workload, export};
use crate::bvh::wide::Cost;
use crate::bvh::{TreeFor, Trees, WideBvh};
use crate::config::{Config, Layers, TraversalConfig};
use crate::error::Result;
use crate::foveation::Pattern;
use crate::frame::Loaded;
use crate::frame::load::tree_for;
use crate::gpu::opencl::{Device, device};
use crate::math::view::View;
use crate::scene::{Environment, Features, Instancing, Scene};
use crate::trace::Traversal;
use crate::trace::probe::{Probe, RayKind, shape_of};
use crate::trace::warm::{KernelTimes, kernel_times};
use crate::whole_file;

/// Arguments of `foveate bench`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A scene: .gltf, .glb or .obj.
    scene: PathBuf,
    /// How many times every kind of ray is traced; the median counts.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repetitions: u32,
    /// Tell also how long a first start takes: build the kernels and the tree with nothing in a cache.
    #[arg(long)]
    cold: bool,
    /// Write triangles, rays and answers to a file, for other tracers to be measured on the same.
    #[arg(long, value_name = "FILE")]
    export: Option<PathBuf>,
    #[command(flatten)]
    pub(super) options: RayOptions,
}

#[derive(Serialize)]
struct Report {
    scene: String,
    triangles: usize,
    bvh: Tree,
    view: Asked,
    devices: Vec<Measured>,
}

#[derive(Serialize)]
struct Tree {
    nodes: usize,
    depth: u32,
    /// What a ray visits on average, by the surface area heuristic.
    cost: Cost,
    /// To build the tree, or to find it in the cache.
    ready_ms: f64,
    cached: bool,
    /// To build it, where it was not in the cache, or `--cold` asked for it.
    build_ms: Option<f64>,
    /// To fit its boxes to vertices that have moved.
    refit_ms: Option<f64>,
}

#[derive(Serialize)]
struct Asked {
    width: u32,
    height: u32,
    samples: usize,
    bundles: usize,
}

#[derive(Serialize)]
struct Measured {
    device: String,
    platform: String,
    driver: String,
    traversal: Traversal,
    bytes_per_triangle: f64,
    kernels: KernelTimes,
    device_bytes: usize,
    rays: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    kind: RayKind,
    #[serde(flatten)]
    rate: Rate,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let mut config = args.options.config_over(Layers::default())?;
    if let Some(path) = &args.export {
        // Others build their own trees.
        config.scene.instancing = Instancing::Flat;
        whole_file::check_kind(path, export::MAGIC, "file of rays")?;
    }
    let devices = open(&config)?;
    let loaded = super::render::load(&args.scene, &config)?;
    let view = view(args, &config, &loaded)?;
    let count = config.foveation.samples.of(view.pixels());
    let gaze = args.options.look.gaze.unwrap_or(glam::DVec2::splat(0.5));
    let pattern = Pattern::new(&view, &config.foveation.law, gaze, count);
    let ready_ms = loaded.steps.iter().find(|step| step.name == "bvh").map_or(0.0, |step| step.ms);
    let cached = loaded.bvh_was_cached;
    let build_ms = match (cached, args.cold) {
        (false, _) => Some(ready_ms),
        (true, true) => Some(time_to_build(tree_for(&config), &loaded.scene)),
        (true, false) => None,
    };
    let bench = Bench {
        features: Features::required_by(&loaded.scene, &loaded.environment),
        environment: loaded.environment,
        shape: shape_of(loaded.scene),
        bvh: loaded.bvh,
        shapes: loaded.shapes,
    };
    let mut probes = bench.probes(&devices, config.trace.traversal)?;
    let work = Workload::new(&mut probes[0], &bench.shape, bench.trees(), view, pattern)?;
    probes[1..].iter_mut().try_for_each(|probe| work.load(probe))?;
    if let Some(path) = &args.export {
        export::write(path, &bench.shape, &work, &probes[0])?;
    }
    let rates = measure(&probes, args.repetitions)?;
    let report = Report {
        scene: args.scene.display().to_string(),
        triangles: bench.shape.triangles(),
        bvh: Tree { ready_ms, cached, build_ms, refit_ms: bench.time_to_refit(), ..bench.tree() },
        view: Asked {
            width: view.width,
            height: view.height,
            samples: work.pattern.samples.len(),
            bundles: work.bundles.origins.len(),
        },
        devices: probes
            .iter()
            .zip(&rates)
            .map(|(probe, rates)| bench.measured(probe, rates, args.cold))
            .collect::<Result<_>>()?,
    };
    if args.options.config.json { output::print_json(&report) } else { output::print_line(&report.text()) }
}

/// The devices that were asked for, or every usable one.
fn open(config: &Config) -> Result<Vec<Device>> {
    let infos = device::list();
    machine::open(&infos, &config.devices, &[0; 16])
}

fn view(args: &Args, config: &Config, loaded: &Loaded) -> Result<View> {
    let (world_from_eye, fov_y) = args.options.view.viewpoint(&loaded.scene, config)?;
    let (width, height) = (config.view.width, config.view.height);
    Ok(View {
        world_from_eye,
        fov: eye_fov(fov_y, width, height),
        width,
        height,
        spacing: Default::default(),
    })
}

fn time_to_build(tree_for: TreeFor, scene: &Scene) -> f64 {
    let start = Instant::now();
    drop(WideBvh::build_for(tree_for, &scene.mesh.positions, &scene.mesh.triangles, &|_| ()));
    start.elapsed().as_secs_f64() * 1e3
}

/// Every kind on every device in turn, again and again; a first time that does not count.
fn measure(probes: &[Probe], repetitions: u32) -> Result<Vec<Rates>> {
    let mut rates = vec![Rates::default(); probes.len()];
    let bar = output::progress(u64::from(repetitions) + 1, "repetitions");
    for repetition in 0..=repetitions {
        for (probe, rates) in probes.iter().zip(&mut rates) {
            for kind in RayKind::ALL {
                if repetition == 0 { probe.trace(kind).map(drop)? } else { rates.run(probe, kind)? }
            }
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(rates)
}

struct Bench {
    shape: Scene,
    bvh: WideBvh,
    shapes: Vec<WideBvh>,
    environment: Environment,
    features: Features,
}

impl Bench {
    /// Every variant of the kernels on every device, or the one that settings ask for.
    fn probes(&self, devices: &[Device], traversal: TraversalConfig) -> Result<Vec<Probe>> {
        let wanted = traversal.forced().map_or_else(|| Traversal::ALL.to_vec(), |forced| vec![forced]);
        devices
            .iter()
            .flat_map(|device| wanted.iter().map(move |&traversal| (device, traversal)))
            .map(|(device, traversal)| Probe::new(device, &self.shape, self.trees(), traversal))
            .collect()
    }

    fn trees(&self) -> Trees<'_> {
        Trees { world: &self.bvh, shapes: &self.shapes }
    }

    /// Bytes of nodes, vertices in leaf order, and what hits need to know of a triangle.
    fn bytes_per_triangle(&self, probe: &Probe) -> f64 {
        probe.scene().tree_bytes() as f64 / self.shape.triangles().max(1) as f64
    }

    fn tree(&self) -> Tree {
        Tree {
            nodes: self.bvh.nodes.len() + self.shapes.iter().map(|tree| tree.nodes.len()).sum::<usize>(),
            depth: self.trees().depth(),
            cost: self.bvh.cost(),
            ready_ms: 0.0,
            cached: false,
            build_ms: None,
            refit_ms: None,
        }
    }

    /// None where shapes are kept once: what is refitted is one tree.
    fn time_to_refit(&self) -> Option<f64> {
        if !self.shapes.is_empty() {
            return None;
        }
        let mut tree = self.bvh.clone();
        let start = Instant::now();
        // The loader has refused what is not finite.
        let _ = tree.refit(&self.shape.mesh.positions, &self.shape.mesh.triangles);
        Some(start.elapsed().as_secs_f64() * 1e3)
    }

    fn measured(&self, probe: &Probe, rates: &Rates, cold: bool) -> Result<Measured> {
        let device = probe.device();
        let info = device.info();
        let sun = self.environment.sun.is_some();
        Ok(Measured {
            device: info.name.clone(),
            platform: info.platform.clone(),
            driver: info.driver.clone(),
            traversal: probe.traversal(),
            bytes_per_triangle: self.bytes_per_triangle(probe),
            kernels: kernel_times(
                device,
                &Features { sun, ..self.features },
                self.bvh.depth(),
                probe.traversal(),
                cold,
            )?,
            device_bytes: probe.bytes().iter().map(|b| b.bytes).sum(),
            rays: rates.summary().into_iter().map(|(kind, rate)| Row { kind, rate }).collect(),
        })
    }
}

impl Report {
    fn text(&self) -> String {
        let mut text = format!(
            "{}: {} triangles, tree of {} nodes, {} deep, ready in {:.0} ms{}{}\n{}x{} pixels, {} samples, {} of which see something and send 32 rays\n",
            self.scene,
            self.triangles,
            self.bvh.nodes,
            self.bvh.depth,
            self.bvh.ready_ms,
            if self.bvh.cached { " from the cache" } else { "" },
            self.bvh.refit_ms.map_or_else(String::new, |ms| format!(", refitted in {ms:.0} ms")),
            self.view.width,
            self.view.height,
            self.view.samples,
            self.view.bundles
        );
        for device in &self.devices {
            device.describe(&mut text);
        }
        text.trim_end().to_string()
    }
}

impl Measured {
    fn describe(&self, text: &mut String) {
        let cold = self.kernels.cold_ms.map_or(String::new(), |ms| format!("{ms:.0} ms cold, "));
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{} ({}), rays {}, {:.0} bytes a triangle and {:.0} MiB in all: kernels {cold}{:.0} ms warm; {:.3} ms to launch and wait for a frame's",
            self.device,
            self.platform,
            self.traversal.name(),
            self.bytes_per_triangle,
            self.device_bytes as f64 / 1_048_576.0,
            self.kernels.warm_ms,
            self.kernels.launch_ms
        );
        for Row { kind, rate } in &self.rays {
            let each = rate.mrays_per_cpu_second.map_or(String::new(), |r| format!(", {r:.2} a core"));
            let _ = writeln!(
                text,
                "  {:<17} {:>9} rays {:>9.2} ms ({:.2} to {:.2}) {:>8.2} Mrays/s{each}",
                kind.name(),
                rate.rays,
                rate.ms,
                rate.ms_p10,
                rate.ms_p90,
                rate.mrays_per_second
            );
        }
    }
}
