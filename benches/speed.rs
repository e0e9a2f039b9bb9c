//! Rays beside other tracers: `cargo bench --bench speed [-- --scenes sponza,organic,town --repetitions 5]`.
//!
//! For each scene the same rays, the same triangles and the same cores, in turns: this program's kernels, Embree
//! (a program of its own in `benches/peers`, compiled here) and the obvhs crate's traversal. Embree is asked one
//! ray and 4, 8 and 16 rays at a time, coherent and incoherent, with its default frequency level and with
//! `simd512`; the fastest way of each kind is then measured. Figures are millions of rays in a second of one core:
//! medians, 10th and 90th percentile; ratios are medians of those of each turn. Prints a table in Markdown and
//! writes it to `out/bench/speed.md`.

#[path = "peers/embree.rs"]
mod embree;
#[path = "peers/obvhs.rs"]
mod obvhs;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use embree::Embree;
use foveate::bench::{Workload, cpu_time, export};
use foveate::bvh::WideBvh;
use foveate::config::{Config, Layers};
use foveate::foveation::{Law, Pattern};
use foveate::frame::Loaded;
use foveate::gpu::opencl::{Device, device};
use foveate::math::view::{FieldOfView, View};
use foveate::metrics::stats::{median, percentile};
use foveate::scene::{default_viewpoint, generate};
use foveate::trace::Traversal;
use foveate::trace::probe::{Probe, RayKind, shape_of};

struct Arguments {
    scenes: Vec<String>,
    repetitions: usize,
    out: PathBuf,
}

fn main() {
    let arguments = arguments();
    std::fs::create_dir_all(&arguments.out).expect("out/bench");
    let info = device::list().into_iter().find(|d| d.unusable.is_none()).expect("an OpenCL device");
    let device = Device::open(&info).expect("the OpenCL device");
    let peer = embree::compile(&arguments.out);
    let mut text = format!("{}, {} compute units\n\n", info.name, info.compute_units);
    text += "| scene | rays | foveate, Mrays per core and second (p10 to p90) | Embree's best | how | ratio (p10 to p90) | obvhs | ratio |\n";
    text += "| --- | --- | --- | --- | --- | --- | --- | --- |\n";
    let mut builds = String::from(
        "\n| scene | tree | build ms | nodes and leaves a ray visits |\n| --- | --- | --- | --- |\n",
    );
    for scene in &arguments.scenes {
        measure(scene, &device, &peer, &arguments, &mut text, &mut builds);
    }
    println!("\n{text}{builds}");
    std::fs::write(arguments.out.join("speed.md"), text + &builds).expect("out/bench/speed.md");
}

fn arguments() -> Arguments {
    let mut arguments = Arguments {
        scenes: ["sponza", "organic", "town"].map(str::to_string).to_vec(),
        repetitions: 5,
        out: PathBuf::from("out/bench"),
    };
    let mut words = std::env::args().skip(1).filter(|word| word != "--bench");
    while let Some(word) = words.next() {
        let value = words.next().unwrap_or_else(|| panic!("{word} needs a value"));
        match word.as_str() {
            "--scenes" => arguments.scenes = value.split(',').map(str::to_string).collect(),
            "--repetitions" => arguments.repetitions = value.parse().expect("a number of repetitions"),
            "--out" => arguments.out = PathBuf::from(value),
            other => panic!("{other} is not known"),
        }
    }
    arguments
}

fn load(scene: &str) -> Loaded {
    let config: Config = Layers::default().finish().expect("the defaults");
    let data =
        std::env::var_os("FOVEATE_TEST_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    let town = |triangles| generate::voxel_town::generate(triangles, 1).expect("a town");
    match scene {
        "demo" => Loaded::from_glb("demo", &generate::demo::generate(), &config),
        "organic" => {
            let bytes = generate::organic::generate(generate::organic::USUAL_TRIANGLES, 1).expect("a glade");
            Loaded::from_glb("organic", &bytes, &config)
        }
        "town" => Loaded::from_glb("town", &town(6_700_000), &config),
        "small-town" => Loaded::from_glb("small town", &town(500_000), &config),
        "sponza" => Loaded::from_file(&data.join("scenes/sponza/Sponza.gltf"), &config),
        path => Loaded::from_file(Path::new(path), &config),
    }
    .unwrap_or_else(|error| panic!("{error}"))
}

/// Milliseconds that processors spent on something.
fn cpu_ms(work: impl FnOnce()) -> f64 {
    let before = cpu_time::of_all_threads().expect("a system that tells how long threads ran");
    work();
    (cpu_time::of_all_threads().expect("as before") - before) as f64 * 1e-6
}

fn measure(
    scene: &str,
    device: &Device,
    peer: &Path,
    arguments: &Arguments,
    text: &mut String,
    builds: &mut String,
) {
    let loaded = load(scene);
    let viewpoint = default_viewpoint(&loaded.scene, 70.0);
    let fov = FieldOfView::symmetric(viewpoint.fov_y, 1.6);
    let view = View {
        world_from_eye: viewpoint.world_from_eye,
        fov,
        width: 1280,
        height: 800,
        spacing: Default::default(),
    };
    let pattern = Pattern::new(&view, &Law::default(), glam::DVec2::splat(0.5), 55_000);
    let shape = shape_of(loaded.scene);
    let (positions, triangles) = (&shape.mesh.positions, &shape.mesh.triangles);
    let start = Instant::now();
    let tree = WideBvh::build(positions, triangles);
    let build_ms = start.elapsed().as_secs_f64() * 1e3;
    let mut probe = Probe::new(device, &shape, &tree, Traversal::for_device(device)).expect("kernels");
    let work = Workload::new(&mut probe, &shape, &tree, view, pattern).expect("rays");
    let file = arguments.out.join("rays.bin");
    export::write(&file, &shape, &work, &probe).expect("a file of rays");
    let rival = obvhs::Obvhs::build(&shape);
    let mut row = |name: &str, ms: f64, cost: String| {
        let _ = writeln!(builds, "| {scene}, {} triangles | {name} | {ms:.0} | {cost} |", triangles.len());
    };
    let cost = tree.cost();
    row("foveate", build_ms, format!("{:.2} + {:.2}", cost.nodes, cost.leaves));
    let (mut moved, mut refitted) = (positions.clone(), tree.clone());
    sway(&mut moved);
    let start = Instant::now();
    let refit = refitted.refit(&moved, triangles).expect("finite vertices");
    let (ms, cost) = (start.elapsed().as_secs_f64() * 1e3, refit.after);
    row("foveate, refitted after everything swayed", ms, format!("{:.2} + {:.2}", cost.nodes, cost.leaves));
    let start = Instant::now();
    let cost = WideBvh::build(&moved, triangles).cost();
    let ms = start.elapsed().as_secs_f64() * 1e3;
    row("foveate, built anew after that", ms, format!("{:.2} + {:.2}", cost.nodes, cost.leaves));
    let cost = rival.cost;
    row(
        "obvhs (PLOC, reinsertion), eight wide",
        rival.build_ms,
        format!("{:.2} + {:.2}", cost.nodes, cost.leaves),
    );
    let mut peers: Vec<Embree> =
        ["", "frequency_level=simd512"].iter().map(|config| Embree::start(peer, &file, config)).collect();
    for quality in ["medium", "high"] {
        let ms = peers[0].build(quality);
        row(&format!("Embree, {quality} quality"), ms, String::new());
    }
    peers[1].build("high");
    for kind in RayKind::ALL {
        let line = compete(kind, &probe, &rival, &work, &mut peers, arguments.repetitions);
        let _ = writeln!(text, "| {scene} | {} {line}", kind.name());
        println!("{scene} {} {line}", kind.name());
    }
}

/// Bends everything as wind bends trees: sideways, with the square of the height, by up to a tenth of it.
fn sway(positions: &mut [glam::Vec3]) {
    let heights = positions.iter().map(|p| p.y);
    let low = heights.clone().fold(f32::INFINITY, f32::min);
    let tall = (heights.fold(f32::NEG_INFINITY, f32::max) - low).max(f32::MIN_POSITIVE);
    for p in positions {
        let share = (p.y - low) / tall;
        p.x += 0.1 * tall * share * share * (0.3 * p.z).sin();
        p.z += 0.1 * tall * share * share * (0.3 * p.x).cos();
    }
}

fn compete(
    kind: RayKind,
    probe: &Probe,
    rival: &obvhs::Obvhs,
    work: &Workload,
    peers: &mut [Embree],
    repetitions: usize,
) -> String {
    let rays = probe.rays(kind) as f64 * 1e-3;
    if rays == 0.0 {
        return "| | | | | | |".to_string();
    }
    probe.trace(kind).expect("a trace");
    let mut ways: Vec<(f64, usize, embree::Way)> = (0..peers.len())
        .flat_map(|peer| embree::Way::all(kind).into_iter().map(move |way| (peer, way)))
        .map(|(peer, way)| {
            let fastest = (0..2).map(|_| peers[peer].trace(&way).cpu_ms).fold(f64::INFINITY, f64::min);
            (fastest, peer, way)
        })
        .collect();
    ways.sort_by(|a, b| a.0.total_cmp(&b.0));
    // The two fastest, since a first look may be wrong.
    ways.truncate(2);
    let (mut own, mut theirs, mut other) = (Vec::new(), vec![Vec::new(); ways.len()], Vec::new());
    for _ in 0..repetitions {
        let run = || {
            probe.trace(kind).expect("a trace");
        };
        own.push(rays / cpu_ms(run));
        for ((_, peer, way), rates) in ways.iter().zip(&mut theirs) {
            let run = peers[*peer].trace(way);
            assert!(run.wrong * 10_000 <= probe.rays(kind), "{way:?} differs in {} rays", run.wrong);
            rates.push(rays / run.cpu_ms);
        }
        other.push(rays / cpu_ms(|| rival.trace(kind, work)));
    }
    let of = |values: &[f64]| median(values).unwrap_or(0.0);
    let best = (0..ways.len()).max_by(|&a, &b| of(&theirs[a]).total_cmp(&of(&theirs[b]))).expect("ways");
    let ratios = |rival: &[f64]| own.iter().zip(rival).map(|(a, b)| a / b).collect::<Vec<f64>>();
    let spread = |values: &[f64]| {
        let at = |p| percentile(values, p).unwrap_or(0.0);
        format!("{:.2} ({:.2} to {:.2})", of(values), at(10.0), at(90.0))
    };
    let (_, peer, way) = &ways[best];
    format!(
        "| {} | {:.2} | {way}{} | {} | {:.2} | {:.2} |",
        spread(&own),
        of(&theirs[best]),
        if *peer == 1 { ", simd512" } else { "" },
        spread(&ratios(&theirs[best])),
        of(&other),
        of(&ratios(&other)),
    )
}
