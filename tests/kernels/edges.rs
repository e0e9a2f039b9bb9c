//! Edges inside pixels: what the kernels say a neighbour's surface fills of a pixel, against what 256 of the
//! reference's rays find in it.

use foveate::layout::{SUN_VISIBLE, VisibilityRecord};
use foveate::math::view::View;
use foveate::reference::{self, Tracer};
use foveate::scene::Scene;
use foveate::trace::Settings;
use glam::{DVec2, DVec3, Vec3};

use crate::bench::{Bench, PLAIN, Picture, all_pixels, on_every_device, view};
use crate::cases::floor_under_sky;
use crate::scenes::{colourful, cuboid, floor, matt, quad, scene_of};

const SIZE: (u32, u32) = (48, 32);

fn guided(edge_rays: u32) -> Settings {
    Settings { guided: true, rays: 1, edge_rays, ..PLAIN }
}

/// The share of its neighbour in a pixel, and that neighbour's place.
fn share_of(record: &VisibilityRecord, pixel: usize, width: u32) -> (f64, usize) {
    let neighbour = record.normal >> 24 & 7;
    let place = neighbour + u32::from(neighbour > 3);
    let (dx, dy) = (place as i64 % 3 - 1, place as i64 / 3 - 1);
    (f64::from(record.normal >> 27 & 15) / 15.0, (pixel as i64 + dy * i64::from(width) + dx) as usize)
}

/// A slanted sheet before a block on a floor, under the sky: all edges are straight.
fn still_life() -> Scene {
    let mut scene = scene_of(vec![matt(0.2), matt(0.6), matt(0.9)]);
    floor(&mut scene, 6.0, 0.0, 0);
    cuboid(&mut scene, Vec3::new(-0.9, 0.0, -0.5), Vec3::new(0.1, 0.8, 0.4), 1);
    let sheet = [[-0.2, 0.3, 1.0], [0.9, 0.45, 1.0], [0.8, 1.6, 1.0], [-0.35, 1.4, 1.0]].map(Vec3::from);
    quad(&mut scene, sheet, 2);
    scene
}

/// The material that rays through a pixel hit, for a grid of 16 by 16 of them; none is the sky.
fn materials_in(tracer: &Tracer, scene: &Scene, view: &View, pixel: usize) -> Vec<Option<u32>> {
    let corner = DVec2::new((pixel % SIZE.0 as usize) as f64, (pixel / SIZE.0 as usize) as f64);
    let at = |i: u32| corner + (DVec2::new(f64::from(i % 16), f64::from(i / 16)) + 0.5) / 16.0;
    let hit = |i| tracer.closest(&reference::camera_ray(scene, view, at(i)), f64::INFINITY);
    (0..256).map(|i| hit(i).map(|hit| scene.mesh.materials[hit.triangle as usize])).collect()
}

/// Mean error of the shares in pixels that two materials share, those pixels, and how many more there are
/// whose neighbour does not see what the pixel shares with it.
fn score(picture: &Picture, scene: &Scene, view: &View) -> (f64, usize, usize) {
    let tracer = Tracer::new(scene);
    let material = |pixel: usize| match picture.hits[pixel].triangle {
        u32::MAX => None,
        triangle => Some(scene.mesh.materials[triangle as usize]),
    };
    let (mut error, mut edges, mut strangers) = (0.0, 0, 0);
    for (pixel, record) in picture.visibility.iter().enumerate() {
        let seen = materials_in(&tracer, scene, view, pixel);
        let foreign = seen.iter().filter(|m| **m != material(pixel)).count() as f64 / 256.0;
        let (share, neighbour) = share_of(record, pixel, SIZE.0);
        if share > 0.0 {
            strangers += usize::from(!seen.contains(&material(neighbour)));
        }
        if foreign > 0.0 {
            error += (share - foreign).abs();
            edges += 1;
        }
    }
    (error / edges as f64, edges, strangers)
}

#[test]
fn shares_are_what_other_surfaces_fill() {
    on_every_device(|device| {
        let (scene, light) = (still_life(), colourful());
        let view = view(DVec3::new(0.2, 1.5, 3.1), DVec3::new(0.0, 0.5, 0.0), 60.0, SIZE);
        let mut bench = Bench::new(device, &scene, &light);
        let mut errors = Vec::new();
        for rays in [0, 2, 4, 8] {
            let picture = bench.trace(&view, &guided(rays), &all_pixels(&view));
            let (error, edges, strangers) = score(&picture, &scene, &view);
            println!("{rays} rays: mean error {error:.3} of {edges} pixels, {strangers} strangers");
            assert!(edges > 80 && strangers * 50 <= edges, "{edges} {strangers}");
            errors.push(error);
        }
        // Without rays the whole foreign part is the error: the comparison can fail.
        assert!(errors[0] > 0.2 && errors[1] < 0.16 && errors[2] < 0.12 && errors[3] < 0.09, "{errors:?}");
    });
}

/// Shadows' edges are guessed from which neighbours see the sun: the squared error of the part that lies on the
/// other side is less than without a guess, and the neighbour named is on that side.
#[test]
fn shadows_edges_are_shared_too() {
    on_every_device(|device| {
        let mut scene = scene_of(vec![matt(0.5)]);
        floor(&mut scene, 9.0, 0.0, 0);
        // Out of view above the floor, with edges that run along no row of pixels.
        let sheet = [[-0.8, 4.0, -0.6], [-0.5, 4.0, 0.9], [0.9, 4.0, 0.5], [0.6, 4.0, -0.9]].map(Vec3::from);
        quad(&mut scene, sheet, 0);
        let light = floor_under_sky().light;
        let sun = light.sun.unwrap().direction.as_dvec3();
        let shadow = -sun * (4.0 / sun.y) + DVec3::Y * 4.0;
        let view = view(shadow + DVec3::new(0.4, 2.5, 1.9), shadow, 60.0, SIZE);
        let picture = Bench::new(device, &scene, &light).trace(&view, &guided(2), &all_pixels(&view));
        let tracer = Tracer::new(&scene);
        let lit = |ray: reference::Ray| {
            let hit = tracer.closest(&ray, f64::INFINITY).unwrap();
            let origin = ray.origin + ray.direction * hit.t + DVec3::Y * 1e-5;
            !tracer.occluded(&reference::Ray { origin, direction: sun }, f64::INFINITY)
        };
        let (mut error, mut ignored, mut edges) = (0.0, 0.0, 0);
        for (pixel, record) in picture.visibility.iter().enumerate() {
            let own = record.normal & SUN_VISIBLE;
            let corner = DVec2::new((pixel % SIZE.0 as usize) as f64, (pixel / SIZE.0 as usize) as f64);
            let at = |i: u32| corner + (DVec2::new(f64::from(i % 16), f64::from(i / 16)) + 0.5) / 16.0;
            let other = |i: &u32| lit(reference::camera_ray(&scene, &view, at(*i))) != (own != 0);
            let foreign = (0..256).filter(other).count() as f64 / 256.0;
            let (share, neighbour) = share_of(record, pixel, SIZE.0);
            if share > 0.0 {
                assert_ne!(picture.visibility[neighbour].normal & SUN_VISIBLE, own, "{pixel}");
                edges += 1;
            }
            error += (share - foreign).powi(2);
            ignored += foreign.powi(2);
        }
        println!("{edges} pixels share a shadow's edge: squared error {error:.2}, without {ignored:.2}");
        assert!(edges > 40 && error < 0.7 * ignored, "{edges}: {error} {ignored}");
    });
}

/// Triangles of one surface have no edges between them, however many there are.
#[test]
fn one_surface_has_no_edges() {
    on_every_device(|device| {
        let mut scene = scene_of(vec![matt(0.5)]);
        for tile in 0..1600 {
            let (x, z) = ((tile % 40) as f32 * 0.2 - 4.0, (tile / 40) as f32 * 0.2 - 4.0);
            let corners = [[x, 0.0, z], [x, 0.0, z + 0.2], [x + 0.2, 0.0, z + 0.2], [x + 0.2, 0.0, z]];
            quad(&mut scene, corners.map(Vec3::from), 0);
        }
        let view = view(DVec3::new(0.3, 0.9, 0.8), DVec3::ZERO, 40.0, SIZE);
        let mut bench = Bench::new(device, &scene, &colourful());
        let [plain, picture] = [0, 4].map(|rays| bench.trace(&view, &guided(rays), &all_pixels(&view)));
        let triangles: std::collections::HashSet<u32> = picture.hits.iter().map(|h| h.triangle).collect();
        let shared = picture.visibility.iter().filter(|r| r.normal >> 27 & 15 > 0).count();
        assert!(triangles.len() > 50 && !triangles.contains(&u32::MAX), "{}", triangles.len());
        assert_eq!(shared, 0);
        assert_eq!(picture.rays, plain.rays, "no ray is sent where there is no edge");
    });
}
