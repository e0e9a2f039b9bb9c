//! The ray-tracing pipeline of `benches/vulkan_rays`, on rays whose answers are known. (Ray queries are the program's own:
//! `src/trace/hardware/queries/tests.rs`.)

#[path = "common/mod.rs"]
mod common;
#[allow(dead_code)] // The benchmark uses all of it.
#[path = "../benches/vulkan_rays/gpu/mod.rs"]
mod gpu;

use std::process::Command;

use glam::Vec3;

use gpu::{Gpu, Rays};

/// A device with ray-tracing pipelines; says so where there is none, which a machine of CI=true has promised.
fn gpu() -> Option<Gpu> {
    let gpu = Gpu::open("").unwrap();
    if gpu.is_none() {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "no Vulkan device has ray-tracing pipelines");
        println!("not run: no Vulkan device here has VK_KHR_ray_tracing_pipeline");
    }
    gpu
}

/// Two squares across the z axis, at 2 and at 5, the nearer one smaller, and five rays along it.
fn squares() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let square = |half: f32, z: f32| {
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| Vec3::new(x * half, y * half, z))
    };
    let positions = [square(1.0, 2.0), square(3.0, 5.0)].concat();
    (positions, vec![[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]])
}

/// Origins, each of two rays, and the distances of their nearest hits.
const ORIGINS: [[f32; 3]; 3] = [[0.25, 0.5, 0.0], [2.0, 0.5, 0.0], [4.0, 0.0, 0.0]];
const DISTANCES: [Option<f32>; 6] = [Some(2.0), None, Some(5.0), None, None, None];

fn check(gpu: &mut Gpu) {
    let directions: Vec<[f32; 3]> =
        (0..6).map(|ray| [0.0, 0.0, if ray % 2 == 0 { 1.0 } else { -1.0 }]).collect();
    for any in [false, true] {
        let rays =
            Rays { eye: [9.0; 3], origins: &ORIGINS, rays_per_origin: 2, directions: &directions, any };
        gpu.load(&rays).unwrap();
        assert!(gpu.take_answers().unwrap().iter().all(|t| t.is_nan()), "answers before anything was asked");
        gpu.trace().unwrap();
        for (ray, (found, expected)) in gpu.take_answers().unwrap().into_iter().zip(DISTANCES).enumerate() {
            match expected {
                Some(t) if any => assert!(found <= t, "ray {ray}: {found}"),
                Some(t) => assert!((found - t).abs() < 1e-5, "ray {ray}: {found} instead of {t}"),
                None => assert_eq!(found, 1e30, "ray {ray}"),
            }
        }
    }
    // Rays from the eye: without origins of their own.
    let rays =
        Rays { eye: [0.0; 3], origins: &[], rays_per_origin: 0, directions: &directions[..1], any: false };
    gpu.load(&rays).unwrap();
    gpu.trace().unwrap();
    let found = gpu.take_answers().unwrap();
    assert!(found.len() == 1 && (found[0] - 2.0).abs() < 1e-5, "{found:?}");
}

#[test]
fn known_hits_are_found() {
    let Some(mut gpu) = gpu() else { return };
    let (positions, triangles) = squares();
    gpu.build(&positions, &triangles).unwrap();
    check(&mut gpu);
}

#[test]
fn the_validation_layer_finds_nothing() {
    if !common::validation::installed() {
        return;
    }
    let layer = "VK_LAYER_KHRONOS_validation";
    let run = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "known_hits_are_found", "--nocapture"])
        .envs([("VK_INSTANCE_LAYERS", layer), ("VK_LOADER_DEBUG", "layer")])
        .output()
        .unwrap();
    let printed = [run.stdout, run.stderr].concat();
    let printed = String::from_utf8_lossy(&printed);
    assert!(run.status.success(), "{printed}");
    let has_layer = printed.lines().any(|line| line.contains("LAYER") && line.contains(layer));
    assert!(has_layer, "the layer was not there: {printed}");
    let found: Vec<&str> =
        printed.lines().filter(|line| line.contains("VUID") || line.contains("Validation Error")).collect();
    assert!(found.is_empty(), "{found:#?}");
}
