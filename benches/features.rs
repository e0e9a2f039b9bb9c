//! What it gains that kernels are built for what a scene requires: `cargo bench --bench features [-- --rounds 9]`.
//!
//! The demo scene and a town are stripped of all that a feature would be needed for. Their samples are then
//! traced by kernels that have no feature, one of them, and all, in turn; each is compared with the bare
//! kernels of the same round, by the processor time of the whole program where the system tells it, else by
//! device time. Memory is what the scene takes on a device where the feature's buffers exist and say
//! nothing new (white vertex colours, textures that nothing uses) against what it takes without them. Building is
//! processor time of a build that nothing was kept of. Prints a table in Markdown.

use foveate::bench::cpu_time;
use foveate::bvh::WideBvh;
use foveate::config::Config;
use foveate::foveation::Pattern;
use foveate::gpu::opencl::{Buffer, Device, device};
use foveate::layout::{SampleRecord, VisibilityRecord};
use foveate::math::view::{FieldOfView, View};
use foveate::metrics::stats::{median, percentile};
use foveate::scene::texture::{Texture, Wrap};
use foveate::scene::{
    AlphaMode, Environment, Features, Glass, Material, Scene, TextureRef, default_viewpoint, generate,
};
use foveate::trace::{SceneData, Settings, TracePattern, Tracer, Traversal, warm};
use glam::{DVec2, Vec3, Vec4};
use std::path::Path;

const WIDTH: u32 = 640;
const HEIGHT: u32 = 400;
const SAMPLES: usize = 14_000;
/// A feature is worth its name if it gains this much somewhere.
const WORTH: f64 = 0.03;
/// Rounds that do not count.
const WARM: usize = 1;

/// Each feature alone, and all of them.
fn variants() -> Vec<(&'static str, Features)> {
    let none = Features::default();
    vec![
        ("textures", Features { textures: true, ..none }),
        ("normal maps", Features { normal_maps: true, ..none }),
        ("alpha", Features { alpha: true, ..none }),
        ("vertex colours", Features { vertex_colors: true, ..none }),
        ("sun", Features { sun: true, ..none }),
        ("emitters", Features { emitters: true, ..none }),
        ("layers", Features { layers: true, ..none }),
        ("glass", Features { glass: true, alpha: true, ..none }),
        ("glossy", Features { glossy: true, ..none }),
        (
            "all of them",
            Features {
                textures: true,
                normal_maps: true,
                alpha: true,
                vertex_colors: true,
                sun: true,
                emitters: true,
                layers: true,
                glass: true,
                glossy: true,
                instances: false,
            },
        ),
    ]
}

/// What was found for one scene: for each variant its time over the bare kernels', and its memory likewise.
struct Found {
    scene: &'static str,
    times: Vec<Vec<f64>>,
    memory: Vec<f64>,
}

fn main() {
    let mut rounds = 9;
    let mut words = std::env::args().skip(1).filter(|word| word != "--bench");
    while let Some(word) = words.next() {
        match (word.as_str(), words.next()) {
            ("--rounds", Some(value)) => rounds = value.parse().expect("a number of rounds"),
            (other, _) => panic!("{other} is not known, or needs a value"),
        }
    }
    let info = device::list().into_iter().find(|d| d.unusable.is_none()).expect("an OpenCL device");
    let device = Device::open(&info).expect("the OpenCL device");
    let town = generate::voxel_town::generate(100_000, 1).expect("a town");
    let scenes = [("demo", generate::demo::generate()), ("town", town)];
    let found = scenes.map(|(name, glb)| {
        let scene = bare(Scene::from_glb(Path::new(name), &glb).expect("a scene"));
        measure(&device, name, &scene, rounds)
    });
    let builds = builds(&device);
    print(&info.name, &found, &builds);
}

/// The scene with nothing in it that a feature is for.
fn bare(mut scene: Scene) -> Scene {
    for material in &mut scene.materials {
        *material = Material {
            base_color: material.base_color,
            metallic: material.metallic,
            roughness: material.roughness,
            double_sided: material.double_sided,
            ..Material::default()
        };
    }
    scene.textures.clear();
    scene.lights.clear();
    scene.mesh.colors.clear();
    scene
}

/// The scene with what requires features and changes nothing else.
fn pretend(mut scene: Scene, features: &Features) -> Scene {
    if features.textures || features.normal_maps {
        scene.textures.push(Texture {
            width: 1,
            height: 1,
            texels: vec![[255; 4]].into(),
            wrap: [Wrap::Repeat; 2],
            srgb: false,
            nearest: true,
        });
    }
    let unused = |change: &dyn Fn(&mut Material)| {
        let mut material = Material::default();
        change(&mut material);
        material
    };
    if features.normal_maps {
        let texture = Some(TextureRef {
            texture: 0,
            uv_slot: 0,
            matrix: glam::Mat2::IDENTITY,
            offset: glam::Vec2::ZERO,
        });
        scene.materials.push(unused(&|m| m.normal_texture = texture));
    }
    if features.alpha {
        scene.materials.push(unused(&|m| m.alpha = AlphaMode::Blend));
    }
    if features.glass {
        let glass =
            Glass { transmission: 1.0, texture: None, ior: 1.5, solid: false, attenuation: Vec3::ZERO };
        scene.materials.push(unused(&|m| m.glass = Some(glass)));
    }
    if features.layers {
        scene.materials.push(unused(&|m| m.layers = Some(Default::default())));
    }
    if features.vertex_colors {
        scene.mesh.colors = vec![Vec4::ONE; scene.mesh.positions.len()];
    }
    scene
}

struct Variant {
    tracer: Tracer,
    pattern: TracePattern,
    samples: Buffer<SampleRecord>,
    visibility: Buffer<VisibilityRecord>,
}

impl Variant {
    /// Processor time of a trace, else its device time; only ratios count.
    fn trace(&mut self, view: &View, settings: &Settings) -> f64 {
        let before = cpu_time::of_all_threads();
        let (tracer, records) = (&mut self.tracer, Some(&self.visibility));
        let work = tracer.enqueue(view, settings, &self.pattern, &self.samples, records).expect("a trace");
        let traced = tracer.finish(work).expect("a trace");
        match (before, cpu_time::of_all_threads()) {
            (Some(before), Some(after)) if after > before => (after - before) as f64,
            _ => traced.trace_ms + traced.shade_ms,
        }
    }
}

fn measure(device: &Device, name: &'static str, scene: &Scene, rounds: usize) -> Found {
    let config = Config::default().without_reuse();
    let light = Environment::constant(Vec3::ONE);
    let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let traversal = Traversal::for_device(device);
    let none = Features::default();
    assert_eq!(Features::required_by(scene, &light), none);
    let eye = default_viewpoint(scene, config.view.fov_y);
    let fov = FieldOfView::symmetric(eye.fov_y, f64::from(WIDTH) / f64::from(HEIGHT));
    let view = View {
        world_from_eye: eye.world_from_eye,
        fov,
        width: WIDTH,
        height: HEIGHT,
        spacing: Default::default(),
    };
    let pattern = Pattern::new(&view, &config.foveation.law, DVec2::splat(0.5), SAMPLES);
    let open = |features: &Features| {
        let tracer =
            Tracer::with_features(device, scene, &bvh, &light, features, traversal).expect("kernels");
        Variant {
            pattern: tracer.pattern(&pattern).expect("a pattern"),
            samples: Buffer::new(device, pattern.samples.len()).expect("memory"),
            visibility: Buffer::new(device, view.pixels()).expect("memory"),
            tracer,
        }
    };
    let mut without = open(&none);
    let mut with: Vec<Variant> = variants().iter().map(|(_, features)| open(features)).collect();
    let mut times = vec![Vec::new(); with.len()];
    for round in 0..WARM + rounds {
        let settings = Settings {
            rays: config.trace.rays,
            bounces: config.trace.bounces,
            cached: false,
            edge_rays: config.trace.edge_rays,
            guided: true,
            seed: round as u32,
            jitter: false,
            fewer_rays: None,
            turn: foveate::trace::Turn::ALL,
            turn_in_motion: foveate::trace::Turn::ALL,
        };
        let bare = without.trace(&view, &settings);
        for (variant, times) in with.iter_mut().zip(&mut times) {
            let time = variant.trace(&view, &settings);
            if round >= WARM {
                times.push(time / bare);
            }
        }
    }
    let bytes = |scene: &Scene| -> f64 {
        let data = SceneData::pack(scene, &bvh, &light).expect("a scene that can be packed");
        data.bytes(traversal.into()).iter().map(|b| b.bytes as f64).sum()
    };
    let least = bytes(scene);
    let memory = variants().iter().map(|(_, f)| bytes(&pretend(scene.clone(), f)) / least).collect();
    Found { scene: name, times, memory }
}

/// Building each variant over building the bare kernels.
fn builds(device: &Device) -> Vec<f64> {
    let build = |features: &Features| -> f64 {
        let before = cpu_time::of_all_threads();
        let times =
            warm::kernel_times(device, features, 12, Traversal::for_device(device), true).expect("kernels");
        match (before, cpu_time::of_all_threads()) {
            (Some(before), Some(after)) if after > before => (after - before) as f64,
            _ => times.cold_ms.unwrap_or(f64::NAN),
        }
    };
    let bare = build(&Features::default());
    variants().iter().map(|(_, features)| build(features) / bare).collect()
}

fn print(device: &str, found: &[Found], builds: &[f64]) {
    println!("{device}: what a feature costs a scene that does not need it\n");
    let mut columns = vec!["feature".to_string()];
    for found in found {
        columns.push(format!("{}, time", found.scene));
        columns.push(format!("{}, memory", found.scene));
    }
    columns.extend(["building", "worth it"].map(String::from));
    println!("| {} |", columns.join(" | "));
    println!("|{}", " --- |".repeat(columns.len()));
    let more = |ratio: f64| format!("{:+.1} %", 100.0 * (ratio - 1.0));
    for (index, (name, _)) in variants().iter().enumerate() {
        let (mut cells, mut most) = (vec![(*name).to_string()], builds[index]);
        for found in found {
            let times = &found.times[index];
            let at = |percent: f64| percentile(times, percent).unwrap_or(f64::NAN);
            let middle = median(times).unwrap_or(f64::NAN);
            cells.push(format!("{} ({} to {})", more(middle), more(at(25.0)), more(at(75.0))));
            cells.push(more(found.memory[index]));
            most = most.max(middle).max(found.memory[index]);
        }
        cells.push(more(builds[index]));
        cells.push(if most >= 1.0 + WORTH { "yes" } else { "no" }.to_string());
        println!("| {} |", cells.join(" | "));
    }
}
