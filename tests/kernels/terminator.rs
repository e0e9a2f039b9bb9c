//! Where the shadow of a round surface begins that few triangles describe: where its normals say, not where its triangles do.

use foveate::math::view::View;
use foveate::reference::{self, Surface, TextureMode};
use foveate::scene::{Environment, Scene, Sun};
use foveate::trace::{Settings, Traversal};
use glam::{DVec2, DVec3, Vec3};

use crate::bench::{Bench, EVERYTHING, PLAIN, Picture, all_pixels, on_every_device, view};
use crate::scenes::{matt, metal, round_ball};

const SUN: Vec3 = Vec3::new(0.8, 0.5, 0.1);

fn light() -> Environment {
    let sun = Sun { direction: SUN.normalize(), cos_radius: 0.99999, radiance: Vec3::splat(1e5) };
    Environment { sun: Some(sun), ..Environment::constant(Vec3::splat(0.1)) }
}

fn eye() -> View {
    view(DVec3::new(0.1, 0.4, 4.0), DVec3::ZERO, 32.0, (96, 96))
}

fn traced(bench: &mut Bench, guided: bool) -> Picture {
    let settings = Settings { guided, edge_rays: 0, rays: 32, ..PLAIN };
    bench.trace(&eye(), &settings, &all_pixels(&eye()))
}

/// Pixels of the ball that are lit though they should not be or the other way round, of how many; those within half a
/// degree of the border are left out.
fn wrong(scene: &Scene, lit: impl Fn(usize) -> bool) -> (usize, usize) {
    let tracer = reference::Tracer::new(scene);
    let (mut off, mut all) = (0, 0);
    for pixel in 0..eye().pixels() {
        let at = DVec2::new((pixel % 96) as f64, (pixel / 96) as f64) + 0.5;
        let ray = reference::camera_ray(scene, &eye(), at);
        let Some(hit) = tracer.closest(&ray, f64::INFINITY) else { continue };
        let normal = Surface::at(&tracer, &ray, &hit, TextureMode::Level0).horizon;
        let facing = normal.dot(SUN.as_dvec3().normalize());
        if facing.abs() > 0.01 {
            all += 1;
            off += usize::from(lit(pixel) != (facing > 0.0));
        }
    }
    (off, all)
}

#[test]
fn shadows_of_round_things_begin_where_their_normals_say() {
    on_every_device(|device| {
        for (levels, material) in [(0, matt(0.5)), (1, matt(0.5)), (2, metal(Vec3::ONE, 0.4))] {
            let (scene, light) = (round_ball(levels, material), light());
            for traversal in [Traversal::Packet, Traversal::SingleRay] {
                let mut bench = Bench::walking(device, &scene, &light, &EVERYTHING, traversal);
                let picture = traced(&mut bench, true);
                let (off, all) = wrong(&scene, |pixel| picture.visibility[pixel].normal >> 31 != 0);
                println!("{levels} levels, {traversal:?}: the sun is wrong at {off} of {all} pixels");
                assert!(all > 2500 && off * 500 <= all, "{off} of {all}");
            }
        }
    });
}

/// The same in full pictures, where light rays look for the sun: it is the sun's light, by the cosine with the normal.
#[test]
fn full_pictures_of_round_things_are_as_bright_as_their_normals_say() {
    on_every_device(|device| {
        let (scene, light) = (round_ball(1, matt(0.5)), light());
        let picture = traced(&mut Bench::new(device, &scene, &light), false);
        // What the sky alone gives is a twentieth of the sun's light at the border's cosine.
        let (off, all) = wrong(&scene, |pixel| picture.samples[pixel].first[1] > 0.06);
        println!("{off} of {all} pixels are lit otherwise");
        assert!(all > 2500 && off * 200 <= all, "{off} of {all}");
    });
}

/// Normals that point into a thing describe no surface of it: light counts by its triangles.
#[test]
fn normals_that_point_inwards_raise_nothing() {
    on_every_device(|device| {
        let (mut scene, light) = (round_ball(1, matt(0.5)), light());
        scene.mesh.normals.iter_mut().for_each(|normal| *normal = -*normal);
        for traversal in [Traversal::Packet, Traversal::SingleRay] {
            let picture = traced(&mut Bench::walking(device, &scene, &light, &EVERYTHING, traversal), true);
            let tracer = reference::Tracer::new(&scene);
            let (mut lit, mut off) = (0, 0);
            for pixel in 0..eye().pixels() {
                let at = DVec2::new((pixel % 96) as f64, (pixel / 96) as f64) + 0.5;
                let ray = reference::camera_ray(&scene, &eye(), at);
                let Some(hit) = tracer.closest(&ray, f64::INFINITY) else { continue };
                let surface = Surface::at(&tracer, &ray, &hit, TextureMode::Level0);
                assert_eq!(surface.horizon, surface.geometric_normal);
                let faces = surface.geometric_normal.dot(SUN.as_dvec3()) > 0.0;
                lit += usize::from(faces);
                off += usize::from((picture.visibility[pixel].normal >> 31 != 0) != faces);
            }
            assert!(lit > 1000 && off < 20, "{traversal:?}: {off} of {lit}");
        }
    });
}
