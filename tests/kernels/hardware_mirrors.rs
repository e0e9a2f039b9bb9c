//! Rays of mirrors that ray queries trace, and those to the sun from what mirrors show, against those of the kernels.

use std::sync::Arc;

use foveate::bvh::instances::over_instances;
use foveate::bvh::{Trees, WideBvh};
use foveate::math::view::View;
use foveate::scene::Features;
use foveate::scene::instanced::{Instance, Instanced, InstancedShape};
use foveate::trace::{Settings, Traversal};
use glam::{DMat4, DQuat, DVec3, Vec3};

use crate::bench::{Bench, EVERYTHING, PLAIN, Picture, all_pixels};
use crate::guided::{eye, light};
use crate::hardware::{both, on_shared_memory};
use crate::scenes::{cuboid, floor, matt, metal, scene_of};
use crate::variants::{mirrored_apart, mirrors, mirrors_behind_panes};

/// One ray for each sample: what counts here are pixels.
const SKY_ALONE: Settings = Settings { guided: true, rays: 1, ..PLAIN };
const SURFACES: Settings = Settings { bounces: 1, ..SKY_ALONE };

/// How much differs of what pixels mirror, which is held to a share of them, and of the rays that were sent.
fn compare([kernels, queries]: &[Picture; 2], name: &str, most: f64) {
    let (off, shown) = mirrored_apart(&kernels.visibility, &queries.visibility);
    let (rays, own) = (kernels.rays, queries.rays);
    println!("{name}: {off} of {shown} pixels mirror something else, {rays} and {own} rays");
    assert!(shown * 3 > kernels.visibility.len(), "{name}: {shown} pixels mirror");
    assert!(off as f64 <= most * shown as f64, "{name}: {off} of {shown}");
    assert!(rays.abs_diff(own) * 500 <= rays, "{name}: {rays} and {own} rays");
}

/// Whether there is something, and what; in more tiles than have their rays under way together; and what ray queries leave
/// open, from pixels, from mirrors that are met and to the sun.
#[test]
fn what_pixels_mirror_is_what_the_kernels_find() {
    on_shared_memory(|device, context| {
        let wide = View { width: 336, height: 256, ..eye() };
        let (plain, covered) = (mirrors(), mirrors_behind_panes());
        for (name, scene, view, settings, most) in [
            ("the sky", &plain, eye(), SKY_ALONE, 0.002),
            ("what stands there", &plain, eye(), SURFACES, 0.002),
            ("many tiles", &plain, wide, SURFACES, 0.002),
            ("the sky behind panes", &covered, eye(), SKY_ALONE, 0.002),
            ("what stands behind panes", &covered, eye(), SURFACES, 0.01),
        ] {
            let pictures = both((device, context), scene, &light(), &view, &settings);
            compare(&pictures, name, most);
        }
    });
}

/// Blocks that are one shape, turned and of several sizes, on a mirror.
#[test]
fn mirrors_show_instances() {
    on_shared_memory(|device, context| {
        let mut block = scene_of(vec![metal(Vec3::new(0.9, 0.8, 0.6), 0.02), matt(0.5)]);
        cuboid(&mut block, Vec3::new(-0.3, 0.0, -0.3), Vec3::new(0.3, 0.8, 0.3), 1);
        let (positions, triangles) = (block.mesh.positions.len(), block.mesh.triangles.len());
        let place = |number: usize| {
            let turn = DQuat::from_rotation_y(0.7 * number as f64);
            let size = DVec3::new(1.0, 0.5 + 0.25 * number as f64, 0.8);
            let at = DVec3::new(0.9 * number as f64 - 1.8, 0.0, -0.4 * (number % 3) as f64);
            Instance::new(0, &DMat4::from_scale_rotation_translation(size, turn, at))
        };
        let instanced = Instanced {
            shapes: vec![InstancedShape { triangles: 0..triangles, vertices: 0..positions }],
            mesh: block.mesh.clone(),
            instances: (0..5).map(place).collect(),
        };
        let mut scene = scene_of(block.materials.clone());
        floor(&mut scene, 6.0, 0.0, 0);
        let still = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
        let (world, shapes) = (
            over_instances(still, &instanced.boxes()),
            [WideBvh::build(&block.mesh.positions, &block.mesh.triangles)],
        );
        scene.instanced = Some(Arc::new(instanced));
        let trees = Trees { world: &world, shapes: &shapes };
        let features = Features { instances: true, ..EVERYTHING };
        let mut kernels = Bench::grown(device, &scene, &light(), &features, Traversal::SingleRay, trees);
        let mut queries = Bench::by_ray_queries(device, context, &scene, &light(), trees, None);
        let view = eye();
        let pictures =
            [&mut kernels, &mut queries].map(|bench| bench.trace(&view, &SURFACES, &all_pixels(&view)));
        compare(&pictures, "instances", 0.005);
    });
}
