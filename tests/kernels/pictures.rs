//! Pictures without speckle and without leaks, at every scale.

use foveate::gpu::opencl::Device;
use foveate::math::view::View;
use foveate::reference::{self, Random, Renderer};
use foveate::scene::{Environment, Light, LightKind};
use foveate::trace::{Settings, Traversal};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::bench::{Bench, EVERYTHING, PLAIN, all_pixels, on_every_device};
use crate::convex::{Convex, PLACES, ball, room};

const SIZE: u32 = 64;

/// Red of every pixel.
fn picture(
    device: &Device,
    shape: &Convex,
    light: &Environment,
    view: &View,
    traversal: Traversal,
    bounces: u32,
) -> Vec<f64> {
    let mut bench = Bench::walking(device, &shape.scene, light, &EVERYTHING, traversal);
    let picture = bench.trace(view, &Settings { rays: 64, bounces, ..PLAIN }, &all_pixels(view));
    assert_eq!(picture.dropped, 0);
    picture.samples.iter().map(|sample| f64::from(sample.first[0])).collect()
}

/// Pixels that are more than a 25th of the brightest away from all that is seen within half a pixel of them.
fn speckles(found: &[f64], truth: &[[f64; 5]]) -> usize {
    assert_eq!(found.len(), truth.len());
    let brightest = truth.iter().flatten().fold(0.0, |most: f64, value| most.max(*value));
    assert!(brightest > 0.0, "nothing is lit");
    let far = |(found, near): (&f64, &[f64; 5])| {
        // What is no number is far from everything.
        found.is_nan() || near.iter().all(|near| (found - near).abs() > brightest / 25.0)
    };
    found.iter().zip(truth).filter(|pair| far(*pair)).count()
}

/// What the reference sees in the middle of every pixel and at its corners. Punctual light needs one path.
fn truth(shape: &Convex, dark: &Environment, view: &View) -> Vec<[f64; 5]> {
    let renderer = Renderer::new(&shape.scene, dark);
    let pixel = |pixel: usize| {
        let corner = DVec2::new((pixel % SIZE as usize) as f64, (pixel / SIZE as usize) as f64);
        [[0.5, 0.5], [0.02, 0.02], [0.98, 0.02], [0.02, 0.98], [0.98, 0.98]].map(|at| {
            let ray = reference::camera_ray(&shape.scene, view, corner + DVec2::from(at));
            renderer.radiance(&ray, 1, &mut Random::new(1)).mean.x
        })
    };
    (0..view.pixels()).into_par_iter().map(pixel).collect()
}

/// The shape, lit by one light from infinitely far.
fn lit(mut shape: Convex) -> Convex {
    shape.scene.lights = vec![Light {
        kind: LightKind::Directional,
        intensity: Vec3::splat(3.0),
        position: Vec3::ZERO,
        direction: -Vec3::new(0.48, 0.6, 0.64),
        range: f32::INFINITY,
    }];
    shape
}

#[test]
fn surfaces_do_not_shadow_themselves_at_any_scale() {
    on_every_device(|device| {
        let dark = Environment::constant(Vec3::ZERO);
        for shape in PLACES.iter().flat_map(|&place| [lit(room(place)), lit(ball(place))]) {
            for view in shape.views_from_outside(SIZE) {
                let truth = truth(&shape, &dark, &view);
                for traversal in Traversal::ALL {
                    let mut found = picture(device, &shape, &dark, &view, traversal, 0);
                    assert_eq!(speckles(&found, &truth), 0, "{}, {}", shape.name, traversal.name());
                    // One speckle is noticed.
                    let most = found.iter().copied().fold(0.0, f64::max);
                    let lit =
                        truth.iter().position(|near| near.iter().all(|value| *value > most / 2.0)).unwrap();
                    found[lit] = 0.0;
                    assert_eq!(speckles(&found, &truth), 1, "{}", shape.name);
                }
            }
        }
    });
}

/// Pixels that anything lights.
fn leaks(picture: &[f64]) -> usize {
    picture.iter().filter(|value| **value != 0.0).count()
}

/// Light from everywhere outside, none inside: over two bounces a picture from inside is black to the last pixel.
#[test]
fn no_light_leaks_into_closed_shapes_at_any_scale() {
    on_every_device(|device| {
        let bright = Environment::constant(Vec3::splat(1e3));
        for shape in PLACES.iter().flat_map(|&place| [room(place), ball(place)]) {
            for (view, traversal) in shape
                .views(SIZE / 2, 9)
                .into_iter()
                .flat_map(|v| Traversal::ALL.map(|traversal| (v, traversal)))
            {
                let found = picture(device, &shape, &bright, &view, traversal, 2);
                assert_eq!(leaks(&found), 0, "{}, {}", shape.name, traversal.name());
            }
        }
        // A single missing triangle is noticed.
        let mut open = room(PLACES[1]);
        open.scene.mesh.triangles.swap_remove(60);
        open.scene.mesh.materials.pop();
        let view = &open.views(SIZE / 2, 9)[1];
        let looking = View {
            world_from_eye: foveate::math::pose::Pose::look_at(view.world_from_eye.position, DVec3::ZERO),
            ..*view
        };
        assert!(leaks(&picture(device, &open, &bright, &looking, Traversal::Packet, 2)) > 0);
    });
}
