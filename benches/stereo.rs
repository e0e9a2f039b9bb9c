//! How many samples of one eye have light that the other eye has just found: `cargo bench --bench stereo [-- --scenes demo,town,FILE]`.
//!
//! In double precision, by the twin of the pass that carries light over (`src/reference/accumulate.rs`): both eyes' patterns at
//! the usual share of the pixels are seen by f64 camera rays, and each sample of the right eye looks for samples of its
//! surface in the left eye's. Of those that find none it is told how many lie outside the left eye's picture. A table in Markdown.

use foveate::config::Config;
use foveate::foveation::{Law, Pattern};
use foveate::frame::Loaded;
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::reference::accumulate::{Kept, Motion, Sample, Settings, accumulate};
use foveate::reference::{Surface, TextureMode, Tracer, camera_ray};
use foveate::scene::{default_viewpoint, generate};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// As the settings have it by default.
const SETTINGS: Settings = Settings {
    normal_power: 16.0,
    plane_tolerance: 0.25,
    k: 4,
    neighbours: 24,
    longest: 32.0,
    light_changes: false,
    estimates: 1.0,
    rests: true,
};
const SIZE: [u32; 2] = [640, 400];
const EYES_APART: f64 = 0.064;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |flag: &str| arguments.iter().position(|a| a == flag).and_then(|at| arguments.get(at + 1));
    let config = Config::default();
    println!(
        "| scene | samples | served by the other eye | estimates of its own that it is worth | outside its picture |"
    );
    println!("| --- | --- | --- | --- | --- |");
    for name in value("--scenes").map_or("demo,town", String::as_str).split(',') {
        let loaded = match name {
            "demo" => Loaded::from_glb(name, &generate::demo::generate(), &config),
            "town" => Loaded::from_glb(
                name,
                &generate::voxel_town::generate(1_000_000, 1).expect("a town"),
                &config,
            ),
            path => Loaded::from_file(path.as_ref(), &config),
        }
        .expect("the scene");
        let tracer = Tracer::new(&loaded.scene);
        let rest = default_viewpoint(&loaded.scene, 70.0).world_from_eye;
        let [left, right] = [-0.5, 0.5].map(|side| {
            let view = eye(rest, side);
            let samples = seen(&tracer, &view, config.foveation.samples.of(view.pixels()));
            (view, samples)
        });
        let other = Kept { view: left.0, samples: left.1, histories: Vec::new() };
        let usable: Vec<usize> = (0..right.1.len()).filter(|&index| right.1[index].depth > 0.0).collect();
        let (_, histories) = accumulate(&right.0, &right.1, None, Some(&other), &SETTINGS);
        let lent: Vec<f64> = usable.iter().map(|&index| histories[index].ages[0] - 1.0).collect();
        let outside = usable.iter().filter(|&&index| is_outside(&right.0, &left.0, &right.1[index])).count();
        let count = usable.len() as f64;
        println!(
            "| {} | {} | {:.1} % | {:.2} | {:.1} % |",
            name.rsplit('/').next().unwrap_or(name),
            usable.len(),
            lent.iter().filter(|&&weight| weight > 0.0).count() as f64 / count * 100.0,
            lent.iter().sum::<f64>() / count,
            outside as f64 / count * 100.0
        );
    }
}

fn eye(rest: Pose, side: f64) -> View {
    let position = rest.position + rest.rotation * DVec3::X * (side * EYES_APART);
    let [width, height] = SIZE;
    let fov = FieldOfView::symmetric(70f64.to_radians(), f64::from(width) / f64::from(height));
    View {
        world_from_eye: Pose::new(rest.rotation, position),
        fov,
        width,
        height,
        spacing: Default::default(),
    }
}

/// What a pattern's samples see; their light is not asked.
fn seen(tracer: &Tracer, view: &View, count: usize) -> Vec<Sample> {
    let pattern = Pattern::new(view, &Law::default(), DVec2::splat(0.5), count);
    let ahead = view.world_from_eye.rotation * DVec3::NEG_Z;
    let sample = |packed: &u32| {
        let at = [packed & 0xffff, packed >> 16];
        let pixel = DVec2::new(f64::from(at[0]), f64::from(at[1])) + 0.5;
        let ray = camera_ray(tracer.scene(), view, pixel);
        let hit = tracer.closest(&ray, f64::INFINITY);
        let surface = hit.map(|hit| Surface::at(tracer, &ray, &hit, TextureMode::Level0));
        Sample {
            estimates: 1.0,
            at,
            diffuse: DVec3::ONE,
            specular: DVec3::ZERO,
            toward: None,
            depth: hit.map_or(0.0, |hit| hit.t * ray.direction.dot(ahead)),
            normal: surface.as_ref().map_or(DVec3::Z, |surface| surface.horizon),
            blocker: 0.0,
            sun_centre: true,
            roughness: surface.as_ref().map_or(1.0, |surface| surface.roughness),
            motion: Motion::Still,
        }
    };
    pattern.samples.par_iter().map(sample).collect()
}

/// Whether a sample's surface point lies outside the other eye's picture.
fn is_outside(view: &View, other: &View, sample: &Sample) -> bool {
    let pixel = DVec2::new(f64::from(sample.at[0]), f64::from(sample.at[1])) + 0.5;
    let point = view.world_from_eye.rotation * view.eye_direction(pixel) * sample.depth;
    let there = point + view.world_from_eye.position - other.world_from_eye.position;
    let size = DVec2::new(f64::from(other.width), f64::from(other.height));
    other
        .project(other.world_from_eye.rotation.inverse() * there)
        .is_none_or(|at| at.cmplt(DVec2::ZERO).any() || at.cmpge(size).any())
}
