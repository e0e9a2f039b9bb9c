//! What foveation costs and gains: `cargo bench --bench frame [-- --scenes demo,town,sponza --passes 16]`.
//!
//! For each scene one 1280x800 view is rendered by three methods, interleaved A B C A B C, and
//! compared with a converged reference made here: `full` (one sample at each pixel), `k-nn` and
//! `guided` with 55,000 samples, all with 32 light rays a sample. Prints a table in Markdown and
//! writes the pictures to `out/bench`.

use std::path::{Path, PathBuf};

use foveate::config::{Config, Layers};
use foveate::frame::{FrameReport, Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::{Device, device};
use foveate::gpu::vulkan::{Context, ContextOptions};
use foveate::math::view::{FieldOfView, View};
use foveate::metrics::metric::Viewing;
use foveate::metrics::stats::{median, percentile};
use foveate::metrics::{Display, Picture, compare};
use foveate::scene::{default_viewpoint, generate};

const WIDTH: u32 = 1280;
const HEIGHT: u32 = 800;

/// The methods: name and settings.
const METHODS: [(&str, &[&str]); 3] = [
    ("full", &["foveation.samples=full", "reconstruction.method=k-nn"]),
    ("k-nn", &["foveation.samples=55000", "reconstruction.method=k-nn"]),
    ("guided", &["foveation.samples=55000", "reconstruction.method=guided"]),
];

struct Arguments {
    scenes: Vec<String>,
    passes: u32,
    repetitions: usize,
    set: Vec<String>,
    out: PathBuf,
}

struct Machine {
    device: Device,
    context: Context,
}

/// What a method reached.
struct Row {
    scene: String,
    method: &'static str,
    frames: Vec<FrameReport>,
    psnr: f64,
    flip: f64,
    relmse: f64,
}

fn main() {
    let arguments = arguments();
    let context = Context::new(&ContextOptions::default()).expect("a Vulkan device");
    let info = device::list().into_iter().find(|d| d.unusable.is_none()).expect("an OpenCL device");
    let machine = Machine { device: Device::open(&info).expect("the OpenCL device"), context };
    std::fs::create_dir_all(&arguments.out).expect("out/bench");
    println!("{} (OpenCL), {} (Vulkan)\n", info.name, machine.context.report().name);
    let rows: Vec<Row> =
        arguments.scenes.iter().flat_map(|scene| measure(scene, &machine, &arguments)).collect();
    print_table(&rows);
}

fn arguments() -> Arguments {
    let mut arguments = Arguments {
        scenes: ["demo", "town", "sponza"].map(str::to_string).to_vec(),
        passes: 16,
        repetitions: 3,
        set: Vec::new(),
        out: PathBuf::from("out/bench"),
    };
    let mut words = std::env::args().skip(1).filter(|word| word != "--bench");
    while let Some(word) = words.next() {
        let value = words.next().unwrap_or_else(|| panic!("{word} needs a value"));
        match word.as_str() {
            "--scenes" => arguments.scenes = value.split(',').map(str::to_string).collect(),
            "--passes" => arguments.passes = value.parse().expect("a number of passes"),
            "--repetitions" => arguments.repetitions = value.parse().expect("a number of repetitions"),
            "--set" => arguments.set.push(value),
            "--out" => arguments.out = PathBuf::from(value),
            other => panic!("{other} is not known"),
        }
    }
    arguments
}

fn config(arguments: &Arguments, scene: &str, method: &[&str]) -> Config {
    let mut layers = Layers::default();
    // The sun reaches into Sponza's court only from high above.
    let scene_settings: &[&str] = match scene {
        "sponza" => &["environment.sun_elevation=75", "environment.sun_azimuth=10", "view.exposure=1"],
        _ => &[],
    };
    for assignment in scene_settings.iter().chain(method) {
        layers.assign(assignment).expect("a setting");
    }
    arguments.set.iter().for_each(|assignment| layers.assign(assignment).expect("a setting"));
    layers.finish().expect("settings that fit").without_reuse()
}

fn load(scene: &str, config: &Config) -> Loaded {
    match scene {
        "demo" => Loaded::from_glb("demo", &generate::demo::generate(), config),
        "town" => {
            let town = generate::voxel_town::generate(1_000_000, 1).expect("a town");
            Loaded::from_glb("town", &town, config)
        }
        "sponza" => Loaded::from_file(&test_data().join("scenes/sponza/Sponza.gltf"), config),
        path => Loaded::from_file(Path::new(path), config),
    }
    .unwrap_or_else(|error| panic!("{error}"))
}

fn test_data() -> PathBuf {
    std::env::var_os("FOVEATE_TEST_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from)
}

fn measure(scene: &str, machine: &Machine, arguments: &Arguments) -> Vec<Row> {
    let full = config(arguments, scene, METHODS[0].1);
    let loaded = load(scene, &full);
    let viewpoint = default_viewpoint(&loaded.scene, full.view.fov_y);
    let fov = FieldOfView::symmetric(viewpoint.fov_y, f64::from(WIDTH) / f64::from(HEIGHT));
    let view = View {
        world_from_eye: viewpoint.world_from_eye,
        fov,
        width: WIDTH,
        height: HEIGHT,
        spacing: Default::default(),
    };
    let plan = Plan::mono(view);

    let mut renderers: Vec<Renderer> = METHODS
        .iter()
        .map(|(_, settings)| renderer(machine, &loaded, &config(arguments, scene, settings)))
        .collect();
    // Warm: drivers finish building kernels at the first launch.
    for renderer in &mut renderers[1..] {
        renderer.frame(&plan, &[], 0).expect("a frame");
    }
    let mut frames: Vec<Vec<FrameReport>> = vec![Vec::new(); METHODS.len()];
    for repetition in 0..arguments.repetitions {
        for (renderer, frames) in renderers.iter_mut().zip(&mut frames) {
            frames.push(renderer.frame(&plan, &[], repetition as u32).expect("a frame"));
        }
    }
    let pictures: Vec<Picture> = renderers.iter().map(picture).collect();
    let reference = reference(&mut renderers[0], &plan, arguments.passes);

    let exposure = full.view.exposure.fixed() as f32;
    let pixels_per_degree = f64::from(HEIGHT) / viewpoint.fov_y.to_degrees();
    save(arguments, scene, "reference", &reference, exposure);
    METHODS
        .iter()
        .zip(frames)
        .zip(&pictures)
        .map(|((&(method, _), frames), picture)| {
            save(arguments, scene, method, picture, exposure);
            let score =
                compare(picture, &reference, Viewing { exposure, pixels_per_degree }).expect("a comparison");
            Row {
                scene: scene.to_string(),
                method,
                frames,
                psnr: score.psnr,
                flip: score.flip,
                relmse: score.relmse,
            }
        })
        .collect()
}

fn renderer(machine: &Machine, loaded: &Loaded, config: &Config) -> Renderer {
    Renderer::new(&machine.device, &machine.context, loaded, config, Output::Radiance).expect("a renderer").0
}

fn picture(renderer: &Renderer) -> Picture {
    let bytes = renderer.picture().expect("the picture");
    let floats: &[f32] = bytemuck::cast_slice(&bytes);
    Picture::new(WIDTH, HEIGHT, floats.chunks_exact(4).map(|p| [p[0], p[1], p[2]]).collect())
        .expect("a picture")
}

/// The mean of `passes` full pictures with rays through random points of their pixels.
fn reference(renderer: &mut Renderer, plan: &Plan, passes: u32) -> Picture {
    renderer.set_jitter(true);
    let mut sum = vec![[0.0f64; 3]; (WIDTH * HEIGHT) as usize];
    for pass in 0..passes {
        renderer.frame(plan, &[], 1000 + pass).expect("a frame");
        for (total, pixel) in sum.iter_mut().zip(picture(renderer).pixels) {
            (0..3).for_each(|c| total[c] += f64::from(pixel[c]) / f64::from(passes));
        }
    }
    Picture::new(WIDTH, HEIGHT, sum.iter().map(|p| p.map(|c| c as f32)).collect()).expect("a picture")
}

fn save(arguments: &Arguments, scene: &str, name: &str, picture: &Picture, exposure: f32) {
    let stem = Path::new(scene).file_stem().unwrap_or_default().to_string_lossy().to_string();
    let path = arguments.out.join(format!("{stem}-{name}.png"));
    Display::from_picture(picture, exposure).write_png(&path).expect("a PNG file");
}

fn print_table(rows: &[Row]) {
    println!(
        "| scene | method | samples | frame ms, median (p10 to p90) | trace | shade | share | reconstruct | reconstruct and share / frame | speed-up over full | of the reduction | PSNR dB | FLIP | relMSE |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for row in rows {
        let full =
            rows.iter().find(|r| r.scene == row.scene && r.method == "full").expect("full is measured");
        let stage = |value: fn(&FrameReport) -> f64| {
            median(&row.frames.iter().map(value).collect::<Vec<_>>()).unwrap_or(0.0)
        };
        let times = |row: &Row| row.frames.iter().map(|f| f.frame_ms).collect::<Vec<_>>();
        let (mine, theirs) = (median(&times(row)).unwrap_or(0.0), median(&times(full)).unwrap_or(0.0));
        let samples = row.frames[0].samples;
        let reduction = full.frames[0].samples as f64 / samples as f64;
        println!(
            "| {} | {} | {} | {:.0} ({:.0} to {:.0}) | {:.0} | {:.0} | {:.1} | {:.0} | {:.1} % | {:.2} | {:.2} | {:.2} | {:.4} | {:.5} |",
            row.scene,
            row.method,
            samples,
            mine,
            percentile(&times(row), 10.0).unwrap_or(0.0),
            percentile(&times(row), 90.0).unwrap_or(0.0),
            stage(|f| f.stages.trace),
            stage(|f| f.stages.shade),
            stage(|f| f.stages.share),
            stage(|f| f.stages.reconstruct),
            100.0 * stage(|f| (f.stages.share + f.stages.reconstruct) / f.frame_ms),
            theirs / mine,
            theirs / mine / reduction,
            row.psnr,
            row.flip,
            row.relmse
        );
    }
}
