//! Penumbras of the sun in guided pictures: how much of its disc pixels see beside a straight edge, which is known exactly.

use std::f64::consts::PI;

use foveate::foveation::{Law, Pattern};
use foveate::math::view::View;
use foveate::reference::guided::{Choices, Guided};
use foveate::reference::reconstruct::WeightKind;
use foveate::reference::{self, Tracer};
use foveate::scene::{Environment, Scene, Sun};
use foveate::trace::{Settings, Traversal};
use glam::{DVec2, DVec3, Vec3};

use crate::bench::{Bench, EVERYTHING, PLAIN, on_every_device, view};
use crate::scenes::{floor, matt, quad, scene_of};

const SIZE: u32 = 96;
/// The sun's angular radius, twice what it is.
const RADIUS: f64 = 0.0093;

fn eye() -> View {
    view(DVec3::new(0.02, 0.7, 0.2), DVec3::new(0.01, 0.0, -0.02), 16.0, (SIZE, SIZE))
}

fn light(direction: Vec3) -> Environment {
    let sun =
        Sun { direction: direction.normalize(), cos_radius: RADIUS.cos() as f32, radiance: Vec3::splat(1e4) };
    Environment { sun: Some(sun), ..Environment::constant(Vec3::ZERO) }
}

/// A floor below a roof whose straight edge is so high that its shadow ends at x = 0.
fn roofed(height: f32, towards: Vec3) -> Scene {
    let mut scene = scene_of(vec![matt(0.5)]);
    floor(&mut scene, 60.0, 0.0, 0);
    scene.materials[0].double_sided = true;
    let edge = height * towards.x / towards.y;
    let corners = [[edge - 50.0, 50.0], [edge, 50.0], [edge, -50.0], [edge - 50.0, -50.0]];
    if height > 0.0 {
        quad(&mut scene, corners.map(|[x, z]| Vec3::new(x, height, z)), 0);
    }
    scene
}

/// The radiance of each pixel, from the device's records.
fn picture(bench: &mut Bench, light: &Environment, rays: u32) -> Vec<f64> {
    let view = eye();
    let pattern = Pattern::new(&view, &Law::Uniform, DVec2::splat(0.5), 500);
    let settings = Settings { guided: true, edge_rays: 2, rays, ..PLAIN };
    let traced = bench.trace(&view, &settings, &pattern);
    let positions: Vec<[u32; 2]> = pattern.samples.iter().map(|s| [s & 0xffff, s >> 16]).collect();
    let choices = Choices {
        neighbours: 24,
        normal_power: 16.0,
        plane_tolerance: 0.25,
        deviations: [0.6, 0.25],
        k: 4,
        weights: WeightKind::Shepard,
        least_expected: 0.02,
    };
    let twin = Guided {
        view: &view,
        positions: &positions,
        visibility: &traced.visibility,
        sun: light.sun,
        choices,
    };
    let prepared = twin.filter_samples(&traced.samples);
    (0..SIZE * SIZE).map(|p| twin.guided_color(&prepared, [p % SIZE, p / SIZE]).y).collect()
}

/// What the disc's part on one side of a line is, which passes its centre at `offset` of its radius.
fn segment(offset: f64) -> f64 {
    let u = offset.clamp(-1.0, 1.0);
    0.5 + (u.asin() + u * (1.0 - u * u).sqrt()) / PI
}

#[test]
fn penumbras_are_as_wide_as_the_sun() {
    on_every_device(|device| {
        for (height, towards, rays, traversal) in [
            (2.0, Vec3::new(0.2, 1.0, 0.1), 32, Traversal::Packet),
            (2.0, Vec3::new(0.2, 1.0, 0.1), 32, Traversal::SingleRay),
            (4.0, Vec3::new(-0.9, 1.0, 0.3), 32, Traversal::Packet),
            (1.0, Vec3::new(0.0, 1.0, 0.0), 8, Traversal::Packet),
        ] {
            let light = light(towards);
            let made = |scene: &Scene| {
                let mut bench = Bench::walking(device, scene, &light, &EVERYTHING, traversal);
                picture(&mut bench, &light, rays)
            };
            let shadowed = roofed(height, towards);
            let (found, open) = (made(&shadowed), made(&roofed(0.0, towards)));
            let tracer = Tracer::new(&shadowed);
            let slope = f64::from(towards.x / towards.y);
            let toward = towards.as_dvec3().normalize();
            let wide = f64::from(height) / toward.y * RADIUS.tan() * (1.0 + slope * slope).sqrt();
            let (mut squares, mut sum, mut worst, mut partly) = (0.0, 0.0, 0.0f64, 0);
            for pixel in 0..(SIZE * SIZE) as usize {
                let at = DVec2::new((pixel % SIZE as usize) as f64, (pixel / SIZE as usize) as f64) + 0.5;
                let ray = reference::camera_ray(&shadowed, &eye(), at);
                let hit = tracer.closest(&ray, f64::INFINITY).expect("the floor");
                let x = ray.origin.x + ray.direction.x * hit.t;
                let expected = segment(x / wide);
                let off = found[pixel] / open[pixel] - expected;
                partly += usize::from((0.02..0.98).contains(&expected));
                (squares, sum, worst) = (squares + off * off, sum + off, worst.max(off.abs()));
            }
            let root = (squares / partly as f64).sqrt();
            let mean = sum / partly as f64;
            println!(
                "{height} m, {rays} rays, {traversal:?}: {partly} pixels, off by {root:.3}, {mean:.3} in the mean, {worst:.2} at most"
            );
            assert!(partly > 500, "{partly} pixels in the penumbra");
            assert!(root < 0.045 && mean.abs() < 0.02 && worst < 0.4, "{root} {mean} {worst}");
        }
    });
}
