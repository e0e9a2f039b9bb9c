//! How many lanes of a GPU's warps have something to do: `cargo bench --bench simt [-- --scenes demo,town,FILE]`.
//!
//! The kernels for GPUs trace a frame's light rays on whatever device there is, 32 from each point that a sample of a view of
//! 640 x 400 pixels sees, and count the nodes and triangles of each. A table in Markdown: nodes and triangles of a ray, and
//! which part of the lanes is busy at nodes, at triangles, and at both, where a node takes three times as long. A warp's lanes
//! take a ray each, or a sample's rays one after the other; then they wait for each other after each ray, or each begins its
//! next ray at once. After a node they test all its triangles before the next one, or so many at most, as frames do.

use foveate::bench::Workload;
use foveate::bench::simt::{BURST, Steps, bundle_per_lane, ray_per_lane, refilled_lanes};
use foveate::config::Config;
use foveate::foveation::{Law, Pattern};
use foveate::frame::Loaded;
use foveate::gpu::opencl::{Device, device};
use foveate::math::view::{FieldOfView, View};
use foveate::scene::{default_viewpoint, generate};
use foveate::trace::probe::{COUNTED_NODES, CountingProbe, shape_of};
use glam::DVec2;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |flag: &str| arguments.iter().position(|a| a == flag).and_then(|at| arguments.get(at + 1));
    let info = device::list().into_iter().find(|d| d.unusable.is_none()).expect("an OpenCL device");
    let device = Device::open(&info).expect("the OpenCL device");
    println!(
        "| scene, light rays | nodes, triangles a ray | a lane a sample | a lane a ray, {BURST} tests at most \
         | a lane a sample, {BURST} tests | its next ray at once | with 1 test | with {BURST} tests |"
    );
    println!("|{}", " --- |".repeat(8));
    for name in value("--scenes").map_or("demo,town", String::as_str).split(',') {
        let loaded = load(name);
        let view = view(&loaded);
        let (trees, shape) = (loaded.trees(), shape_of(loaded.scene.clone()));
        let mut counting = CountingProbe::new(&device, &shape, trees).expect("kernels");
        let count = Config::default().foveation.samples.of(view.pixels());
        let pattern = Pattern::new(&view, &Law::default(), DVec2::splat(0.5), count);
        Workload::new(&mut counting.probe, &shape, trees, view, pattern).expect("rays");
        for (kind, nearest) in [("any hit", false), ("nearest hit", true)] {
            let rays = counting.tests(nearest).expect("counts");
            assert!(
                rays.iter().all(|ray| ray.len() < COUNTED_NODES),
                "rays visit more nodes than are counted"
            );
            let Steps { nodes, tests, .. } = ray_per_lane(&rays, 1);
            let per_ray =
                [nodes, tests].map(|sum| format!("{:.1}", sum as f64 / rays.len() as f64)).join(", ");
            let ways = [
                bundle_per_lane(&rays, u8::MAX),
                ray_per_lane(&rays, BURST),
                bundle_per_lane(&rays, BURST),
                refilled_lanes(&rays, u8::MAX),
                refilled_lanes(&rays, 1),
                refilled_lanes(&rays, BURST),
            ];
            let ways = ways.map(busy).join(" | ");
            let name = name.rsplit('/').next().unwrap_or(name);
            println!("| {name}, {kind} | {per_ray} | {ways} |");
        }
    }
}

fn load(name: &str) -> Loaded {
    let config = Config::default();
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
