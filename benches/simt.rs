//! How many lanes of a GPU's warps have something to do: `cargo bench --bench simt [-- --scenes demo,town,FILE]`.
//!
//! The kernels for GPUs trace a frame's light rays on whatever device there is, 32 from each point that a sample of a view of
//! 640 x 400 pixels sees, through a tree that is built for them, and count the steps of each. A table in Markdown: nodes and
//! triangles of a ray; which part of the lanes is busy at nodes, at triangles, and at both, where a node takes three times as
//! long; and how long a ray takes, in tests of triangles. A warp's lanes take a ray each, or a sample's rays one after the
//! other, or the next ray of any sample of their group as soon as they are done, as frames do.

use foveate::bench::Workload;
use foveate::bench::simt::{Steps, bundle_per_lane, ray_per_lane, shared_rays};
use foveate::config::{Config, TraversalConfig};
use foveate::foveation::{Law, Pattern};
use foveate::frame::Loaded;
use foveate::gpu::opencl::{Device, device};
use foveate::math::view::{FieldOfView, View};
use foveate::scene::{default_viewpoint, generate};
use foveate::trace::probe::{COUNTED_STEPS, CountingProbe, shape_of};
use glam::DVec2;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |flag: &str| arguments.iter().position(|a| a == flag).and_then(|at| arguments.get(at + 1));
    let info = device::list().into_iter().find(|d| d.unusable.is_none()).expect("an OpenCL device");
    let device = Device::open(&info).expect("the OpenCL device");
    println!(
        "| scene, light rays | nodes, triangles a ray | a lane a ray | a lane a sample | lanes share rays | a ray takes |"
    );
    println!("|{}", " --- |".repeat(6));
    for name in value("--scenes").map_or("demo,town", String::as_str).split(',') {
        let loaded = load(name);
        let view = view(&loaded);
        let (trees, shape) = (loaded.trees(), shape_of(loaded.scene.clone()));
        let mut counting = CountingProbe::new(&device, &shape, trees).expect("kernels");
        let count = Config::default().foveation.samples.of(view.pixels());
        let pattern = Pattern::new(&view, &Law::default(), DVec2::splat(0.5), count);
        Workload::new(&mut counting.probe, &shape, trees, view, pattern).expect("rays");
        for (kind, nearest) in [("any hit", false), ("nearest hit", true)] {
            let rays = counting.steps(nearest).expect("counts");
            assert!(
                rays.iter().all(|ray| ray.len() < COUNTED_STEPS),
                "rays take more steps than are counted"
            );
            let ways = [ray_per_lane(&rays), bundle_per_lane(&rays), shared_rays(&rays)];
            let per_ray = |sum: u64| format!("{:.1}", sum as f64 / rays.len() as f64);
            let visits = [ways[0].nodes, ways[0].tests].map(per_ray).join(", ");
            let takes = ways.map(|steps| per_ray(steps.time())).join(", ");
            let ways = ways.map(busy).join(" | ");
            let name = name.rsplit('/').next().unwrap_or(name);
            println!("| {name}, {kind} | {visits} | {ways} | {takes} |");
        }
    }
}

fn load(name: &str) -> Loaded {
    let mut config = Config::default();
    config.trace.traversal = TraversalConfig::SingleRay;
    match name {
        "demo" => Loaded::from_glb(name, &generate::demo::generate(), &config),
        "town" => {
            let town = generate::voxel_town::generate(1_000_000, 1).expect("a town");
            Loaded::from_glb(name, &town, &config)
        }
        path => Loaded::from_file(path.as_ref(), &config),
    }
    .expect("the scene")
}

fn view(loaded: &Loaded) -> View {
    let (width, height) = (640, 400);
    let rest = default_viewpoint(&loaded.scene, 70.0).world_from_eye;
    let fov = FieldOfView::symmetric(70f64.to_radians(), f64::from(width) / f64::from(height));
    View { world_from_eye: rest, fov, width, height, spacing: Default::default() }
}

fn busy(steps: Steps) -> String {
    steps.efficiency().map(|share| format!("{:.0} %", share * 100.0)).join(", ")
}
