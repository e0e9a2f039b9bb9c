//! Camera rays: what the kernels hit against what the reference allows.

use foveate::bvh::WideBvh;
use foveate::gpu::opencl::Device;
use foveate::math::view::View;
use foveate::reference::{self, Tracer};
use foveate::scene::{Environment, Scene};
use foveate::trace::{Traversal, Traversals};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::bench::{Bench, EVERYTHING, PLAIN, Picture, all_pixels, on_every_device, view};
use crate::scenes::{self, matt};

/// Kernels round directions, corners and distances to 24 bits: sideways a hit may be off by this, relative
/// to the distance from the eye to the farthest corner of the scene's bounds.
const TOLERANCE: f64 = 1e-6;

fn reach(scene: &Scene, view: &View) -> f64 {
    let (low, high) = scene.mesh.bounds().unwrap();
    let eye = view.world_from_eye.position - scene.anchor;
    (low.as_dvec3() - eye).abs().max((high.as_dvec3() - eye).abs()).length()
}

/// Hits, and camera rays whose hit or miss the reference does not allow.
pub fn disagreements(scene: &Scene, view: &View, picture: &Picture) -> (usize, Vec<usize>) {
    let tracer = Tracer::new(scene);
    let tolerance = TOLERANCE * reach(scene, view);
    let is_wrong = |pixel: &usize| {
        let at = DVec2::new((pixel % view.width as usize) as f64, (pixel / view.width as usize) as f64) + 0.5;
        let ray = reference::camera_ray(scene, view, at);
        let hit = picture.hits[*pixel];
        match hit.triangle {
            u32::MAX => !tracer.is_valid_miss(&ray, f64::INFINITY, tolerance),
            triangle => !tracer.is_valid_hit(&ray, triangle, f64::from(hit.t), tolerance),
        }
    };
    let hits = picture.hits.iter().filter(|hit| hit.triangle != u32::MAX).count();
    (hits, (0..view.pixels()).into_par_iter().filter(is_wrong).collect())
}

/// All pixels' hits; sometimes by way of samples, sometimes by way of pixels.
fn trace(device: &Device, scene: &Scene, view: &View, guided: bool) -> Picture {
    trace_by(device, scene, view, guided, Traversal::for_device(device))
}

fn trace_by(device: &Device, scene: &Scene, view: &View, guided: bool, traversal: Traversal) -> Picture {
    let light = Environment::constant(Vec3::ONE);
    let settings = foveate::trace::Settings { rays: 1, guided, ..PLAIN };
    Bench::walking(device, scene, &light, &EVERYTHING, traversal).trace(view, &settings, &all_pixels(view))
}

fn check(device: &Device, name: &str, scene: &Scene, view: &View) {
    for (traversal, guided) in
        Traversal::ALL.into_iter().flat_map(|traversal| [false, true].map(|guided| (traversal, guided)))
    {
        let picture = trace_by(device, scene, view, guided, traversal);
        let (hits, wrong) = disagreements(scene, view, &picture);
        println!(
            "{name}, {}: {} rays, {hits} hits, {} disagreements",
            traversal.name(),
            view.pixels(),
            wrong.len()
        );
        assert!(hits > view.pixels() / 50, "{name}: too few hits to tell");
        assert_eq!(wrong.first(), None, "{name}: {} of {} rays", wrong.len(), view.pixels());
    }
}

const SIZE: (u32, u32) = (101, 77);

#[test]
fn soups_of_every_scale_are_hit_where_the_reference_says() {
    on_every_device(|device| {
        for (name, scale) in [("soup 1e-6", 1e-6), ("soup", 1.0), ("soup 1e6", 1e6)] {
            let scene = scenes::soup(5, 700, scale);
            let eye = DVec3::new(9.0, 4.0, 13.0) * scale;
            check(device, name, &scene, &view(eye, DVec3::ZERO, 60.0, SIZE));
            check(device, name, &scene, &view(DVec3::ZERO, eye, 100.0, SIZE));
        }
    });
}

#[test]
fn scene_far_from_the_origin_is_hit_as_well_as_one_near_it() {
    on_every_device(|device| {
        let mut scene = scenes::soup(6, 700, 1.0);
        scene.anchor = DVec3::new(1e7, -3e6, 2e6);
        // An eye that `f32` could not place within half a metre.
        let eye = scene.anchor + DVec3::new(9.03, 4.01, 12.97);
        check(device, "1e7 m away", &scene, &view(eye, scene.anchor, 60.0, SIZE));
    });
}

#[test]
fn slivers_are_hit_where_the_reference_says() {
    on_every_device(|device| {
        let scene = scenes::slivers(7, 3000);
        check(device, "slivers", &scene, &view(DVec3::new(0.0, 1.0, 4.0), DVec3::ZERO, 80.0, (160, 120)));
    });
}

/// Pixel centres fall on vertices: the eye's distance is half the grid's width, the view 90 degrees wide.
#[test]
fn rays_aimed_at_vertices_never_slip_through() {
    on_every_device(|device| {
        let scene = scenes::grid(62, 0.5);
        let view = view(DVec3::new(0.0, 0.0, 16.0), DVec3::ZERO, 90.0, (64, 64));
        let shifted = View {
            fov: foveate::math::view::FieldOfView {
                left: view.fov.left - 0.5 / 32.0,
                right: view.fov.right - 0.5 / 32.0,
                up: view.fov.up - 0.5 / 32.0,
                down: view.fov.down - 0.5 / 32.0,
            },
            ..view
        };
        for (name, view) in [("cell centres", &view), ("vertices", &shifted)] {
            check(device, name, &scene, view);
            let picture = trace(device, &scene, view, false);
            let inside = |p: usize| (3..60).contains(&(p % 64)) && (3..60).contains(&(p / 64));
            let missed = (0..64 * 64).filter(|&p| inside(p) && picture.hits[p].triangle == u32::MAX).count();
            assert_eq!(missed, 0, "{name}: rays slipped through");
        }
    });
}

#[test]
fn closed_surface_has_no_holes() {
    on_every_device(|device| {
        let mut rays = 0;
        for (levels, centre, radius) in [
            (0, Vec3::ZERO, 1.0f32),
            (3, Vec3::ZERO, 1e-6),
            (5, Vec3::ZERO, 1e6),
            (4, Vec3::splat(700.0), 2.5),
        ] {
            let scene = scenes::sphere(levels, centre, radius, matt(0.5));
            let middle = centre.as_dvec3();
            for (offset, target) in [
                (DVec3::ZERO, DVec3::X),
                (DVec3::new(0.3, 0.2, -0.4), DVec3::new(-1.0, 2.0, 0.5)),
                (DVec3::new(0.0, -0.7, 0.0), DVec3::Y),
            ] {
                let eye = middle + offset * f64::from(radius);
                let view = view(eye, eye + target * f64::from(radius), 150.0, (300, 300));
                for traversal in Traversal::ALL {
                    let picture = trace_by(device, &scene, &view, false, traversal);
                    let misses = picture.hits.iter().filter(|hit| hit.triangle == u32::MAX).count();
                    assert_eq!(misses, 0, "{levels} {centre} {radius} {}: holes", traversal.name());
                    rays += view.pixels();
                }
            }
        }
        println!("closed surfaces: {rays} rays, 0 misses");
        assert!(rays > 1_000_000);
    });
}

/// Light rays that leave the inside of a closed surface all meet it: not one sees the light outside.
#[test]
fn no_light_leaks_into_a_closed_surface() {
    on_every_device(|device| {
        let light = Environment::constant(Vec3::ONE);
        for (centre, radius) in
            [(Vec3::ZERO, 1.0f32), (Vec3::ZERO, 1e-6), (Vec3::ZERO, 1e6), (Vec3::new(900.0, -30.0, 4.0), 0.5)]
        {
            let scene = scenes::sphere(3, centre, radius, matt(0.5));
            let eye = centre.as_dvec3() + DVec3::new(0.1, 0.2, 0.3) * f64::from(radius);
            let view = view(eye, centre.as_dvec3(), 150.0, (32, 32));
            let settings = foveate::trace::Settings { rays: 256, ..PLAIN };
            for traversal in Traversal::ALL {
                let mut bench = Bench::walking(device, &scene, &light, &EVERYTHING, traversal);
                let picture = bench.trace(&view, &settings, &all_pixels(&view));
                let lit = picture.samples.iter().filter(|sample| sample.first != [0.0; 3]).count();
                assert_eq!(lit, 0, "{centre} {radius} {}: {lit} of 1024 samples see light", traversal.name());
                assert!(picture.rays > 200_000);
            }
        }
    });
}

/// A million triangles in one place are hit as one is, and cost neither depth nor memory without bounds.
#[test]
fn a_million_coincident_triangles_are_hit() {
    on_every_device(|device| {
        let mut scene = scenes::shape([[Vec3::ZERO, Vec3::X, Vec3::Y]]);
        scene.mesh.triangles = vec![[0, 1, 2]; 1_000_000];
        scene.mesh.materials = vec![0; 1_000_000];
        let view = view(DVec3::new(0.3, 0.3, 0.4), DVec3::new(0.3, 0.3, 0.0), 60.0, (8, 8));
        for traversal in Traversal::ALL {
            let picture = trace_by(device, &scene, &view, true, traversal);
            for (pixel, hit) in picture.hits.iter().enumerate() {
                let at = DVec2::new((pixel % 8) as f64, (pixel / 8) as f64) + 0.5;
                let ray = reference::camera_ray(&scene, &view, at);
                let p = ray.at(-ray.origin.z / ray.direction.z);
                let inside = p.x > 1e-6 && p.y > 1e-6 && p.x + p.y < 1.0 - 1e-6;
                assert_eq!(hit.triangle != u32::MAX, inside, "{} {pixel}", traversal.name());
                assert!(!inside || (f64::from(hit.t) - ray.origin.distance(p)).abs() < 1e-6, "{hit:?}");
            }
        }
    });
}

#[test]
fn sponza_is_hit_where_the_reference_says() {
    let Some(path) = crate::common::data("scenes/sponza/Sponza.gltf") else { return };
    on_every_device(|device| {
        let scene = Scene::load(&path).unwrap();
        let eye = scene.anchor + DVec3::new(-6.0, 2.0, 0.3);
        check(device, "Sponza", &scene, &view(eye, eye + DVec3::new(1.0, 0.1, -0.2), 75.0, (320, 200)));
    });
}

/// A tree that was built before everything moved finds what the reference does, in both of its forms; and one
/// that was not refitted does not.
#[test]
fn refitted_trees_are_hit_where_the_reference_says() {
    on_every_device(|device| {
        let before = scenes::soup(8, 700, 1.0);
        let built = WideBvh::build(&before.mesh.positions, &before.mesh.triangles);
        type Motion = fn(Vec3) -> Vec3;
        let motions: [(&str, Motion); 3] = [
            ("twisted", |p| glam::Quat::from_rotation_y(0.4 * p.y) * p + Vec3::new(0.5, 0.0, 0.2)),
            ("flattened", |p| Vec3::new(p.x, 0.02 * p.y, p.z)),
            ("stretched", |p| Vec3::new(40.0 * p.x, p.y, 0.1 * p.z)),
        ];
        for (name, motion) in motions {
            let mut scene = before.clone();
            scene.mesh.positions.iter_mut().for_each(|p| *p = motion(*p));
            let view = view(DVec3::new(9.0, 4.0, 13.0), DVec3::ZERO, 60.0, SIZE);
            let trace = |bvh: WideBvh, traversal: Traversal, guided: bool| {
                let light = Environment::constant(Vec3::ONE);
                let settings = foveate::trace::Settings { rays: 1, guided, ..PLAIN };
                let mut bench = Bench::over(device, &scene, &light, &EVERYTHING, traversal, bvh);
                disagreements(&scene, &view, &bench.trace(&view, &settings, &all_pixels(&view)))
            };
            let mut tree = built.clone();
            let growth = tree.refit(&scene.mesh.positions, &scene.mesh.triangles).unwrap().growth();
            for (traversal, guided) in
                Traversal::ALL.into_iter().flat_map(|traversal| [(traversal, false), (traversal, true)])
            {
                let (hits, wrong) = trace(tree.clone(), traversal, guided);
                println!("{name}, {}: {hits} hits, {growth:.2} times the cost", traversal.name());
                assert!(hits > view.pixels() / 100, "{name}: too few hits to tell");
                assert_eq!(wrong.first(), None, "{name}: {} of {} rays", wrong.len(), view.pixels());
            }
            let (_, wrong) = trace(built.clone(), Traversal::for_device(device), false);
            assert!(!wrong.is_empty(), "{name}: the old boxes would do as well");
        }
    });
}

/// Rays of pixels and of samples may use different variants, and the picture stays the same.
#[test]
fn variants_may_differ_by_kind_of_ray() {
    on_every_device(|device| {
        let scene = scenes::sphere(4, Vec3::ZERO, 1.0, matt(0.5));
        let view = view(DVec3::new(0.0, 0.5, 3.0), DVec3::ZERO, 50.0, SIZE);
        let light = Environment::constant(Vec3::ONE);
        let trace = |traversals: Traversals, guided: bool| {
            let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
            let settings = foveate::trace::Settings { guided, ..PLAIN };
            let mut bench = Bench::over(device, &scene, &light, &EVERYTHING, traversals, bvh);
            bench.trace(&view, &settings, &all_pixels(&view))
        };
        for guided in [false, true] {
            let plain = trace(Traversal::Packet.into(), guided);
            for (pixels, bundles) in
                [(Traversal::Packet, Traversal::SingleRay), (Traversal::SingleRay, Traversal::Packet)]
            {
                let mixed = trace(Traversals { pixels, bundles }, guided);
                assert_eq!(mixed.rays, plain.rays);
                let differ = mixed.samples.iter().zip(&plain.samples).filter(|(a, b)| a != b).count();
                // Hits are the same; their distances may round differently.
                assert!(differ * 100 <= plain.samples.len(), "{differ} of {}", plain.samples.len());
            }
        }
    });
}

/// Guards the guard: answers that are wrong in the ways that kernels could be are noticed.
#[test]
fn wrong_hits_are_noticed() {
    on_every_device(|device| {
        let scene = scenes::soup(5, 700, 1.0);
        let view = view(DVec3::new(9.0, 4.0, 13.0), DVec3::ZERO, 60.0, SIZE);
        let wrong = |change: &dyn Fn(&mut foveate::layout::HitRecord)| {
            let mut picture = trace(device, &scene, &view, false);
            let pixel = picture.hits.iter().position(|hit| hit.triangle != u32::MAX).unwrap();
            change(&mut picture.hits[pixel]);
            disagreements(&scene, &view, &picture).1 == [pixel]
        };
        assert!(wrong(&|hit| hit.t *= 1.0001));
        assert!(wrong(&|hit| hit.triangle ^= 1));
        assert!(wrong(&|hit| hit.triangle = u32::MAX));
        assert!(!wrong(&|_| ()));
    });
}
