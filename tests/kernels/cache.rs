//! The cache of light: as much light as paths find, none through walls, and the same whoever fills it.

use foveate::foveation::Pattern;
use foveate::layout::SAMPLE_REUSES;
use foveate::math::view::View;
use foveate::scene::{AlphaMode, Environment, Light, LightKind, Material, Scene, Sun};
use foveate::trace::{Settings, Traversal};
use glam::{DVec3, Vec3};

use crate::bench::{Bench, EVERYTHING, PLAIN, all_pixels, on_every_device, view};
use crate::scenes::{cuboid, floor, matt, quad, scene_of};

const GUIDED: Settings = Settings { guided: true, rays: 64, ..PLAIN };
const CACHED: Settings = Settings { cached: true, ..GUIDED };
const SIZE: (u32, u32) = (48, 32);

fn dark() -> Environment {
    Environment::constant(Vec3::ZERO)
}

fn lamp(position: Vec3) -> Light {
    Light {
        kind: LightKind::Point,
        intensity: Vec3::new(4.0, 3.0, 2.0),
        position,
        direction: Vec3::NEG_Y,
        range: f32::INFINITY,
    }
}

/// Two rooms of 4x3x4 m with one floor and one ceiling, a wall without thickness between them, a lamp in the first.
fn rooms() -> Scene {
    let both = |albedo| Material { double_sided: true, alpha: AlphaMode::Opaque, ..matt(albedo) };
    let mut scene = scene_of(vec![both(0.4), both(0.4)]);
    cuboid(&mut scene, Vec3::new(-4.0, 0.0, -2.0), Vec3::new(4.0, 3.0, 2.0), 0);
    let at = |y: f32, z: f32| Vec3::new(0.037, y, z);
    quad(&mut scene, [at(0.0, -2.0), at(3.0, -2.0), at(3.0, 2.0), at(0.0, 2.0)], 1);
    scene.lights = vec![lamp(Vec3::new(-1.2, 2.3, 0.4))];
    scene
}

/// The rooms under a wide gap in the ceiling.
fn roofless() -> Scene {
    let mut scene = rooms();
    let is_roof = |t: &[u32; 3]| t.iter().all(|&v| scene.mesh.positions[v as usize].y > 2.9);
    let roof = scene.mesh.triangles.iter().position(is_roof).unwrap();
    scene.mesh.triangles.remove(roof);
    scene.mesh.materials.remove(roof);
    scene
}

fn inside(x: f64) -> View {
    view(DVec3::new(x + 1.6, 1.4, 1.6), DVec3::new(x - 1.0, 0.8, -1.2), 80.0, SIZE)
}

/// The rooms without a lamp, whose outer walls shine.
fn shining() -> Scene {
    let mut scene = rooms();
    scene.lights.clear();
    scene.materials[0].emissive = Vec3::ONE;
    scene
}

/// Two walls so close to each other that rays from one meet the other within the cells that are seen from afar.
fn gap() -> Scene {
    let both = |albedo| Material { double_sided: true, alpha: AlphaMode::Opaque, ..matt(albedo) };
    let mut scene = scene_of(vec![both(0.8)]);
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    for x in [-0.002, 0.002] {
        quad(&mut scene, [at(x, 0.085, -4.0), at(x, 0.115, -4.0), at(x, 0.115, 4.0), at(x, 0.085, 4.0)], 0);
    }
    scene
}

fn along() -> View {
    view(DVec3::new(0.0, 0.1, 4.0), DVec3::new(0.0, 0.1, -4.0), 0.5, SIZE)
}

/// Mean of the samples' diffuse light.
fn mean(bench: &mut Bench, view: &View, settings: &Settings, seeds: u32) -> f64 {
    let pattern = all_pixels(view);
    let sums = (0..seeds).map(|seed| {
        let picture = bench.trace(view, &Settings { seed, ..*settings }, &pattern);
        assert_eq!(picture.dropped, 0);
        let all: f64 = picture.samples.iter().flat_map(|s| s.first).map(f64::from).sum();
        all / (3 * picture.samples.len()) as f64
    });
    sums.sum::<f64>() / f64::from(seeds)
}

/// The same of samples that are sent fewer rays, since the frame before has seen what they see.
fn mean_of_known(bench: &mut Bench, view: &View, settings: &Settings, seeds: u32) -> f64 {
    let pattern = all_pixels(view);
    let sums = (0..seeds).map(|seed| {
        let samples = bench.trace_again(view, &Settings { seed, ..*settings }, &pattern);
        let known: Vec<_> = samples.iter().filter(|s| s.toward[0] & SAMPLE_REUSES != 0).collect();
        assert_eq!(known.len(), samples.iter().filter(|s| s.depth > 0.0).count());
        let all: f64 = known.iter().flat_map(|s| s.first).map(f64::from).sum();
        all / (3 * samples.len()) as f64
    });
    sums.sum::<f64>() / f64::from(seeds)
}

fn lit(bench: &mut Bench, view: &View, steps: std::ops::Range<u64>) -> Pattern {
    let pattern = all_pixels(view);
    bench.light(view, &CACHED, &pattern, steps);
    pattern
}

#[test]
fn it_is_as_bright_as_paths_are() {
    on_every_device(|device| {
        for traversal in Traversal::ALL {
            let mut bench = Bench::walking(device, &rooms(), &dark(), &EVERYTHING, traversal);
            let view = inside(-2.0);
            lit(&mut bench, &view, 0..60);
            let direct = mean(&mut bench, &view, &GUIDED, 2);
            let paths = mean(&mut bench, &view, &Settings { bounces: 4, ..GUIDED }, 8);
            let cached = mean(&mut bench, &view, &CACHED, 4);
            println!("{}: direct {direct:.4}, four bounces {paths:.4}, cached {cached:.4}", traversal.name());
            assert!(paths > 1.2 * direct);
            // It leaves no bounce out: the fifth and later ones are up to a thirtieth here.
            assert!((0.97..1.06).contains(&(cached / paths)), "{cached} for {paths}");
        }
    });
}

/// Whether fewer rays look for surfaces or for the sky, and whether the cache knows what they meet: the mean of what they find is
/// that of all.
#[test]
fn samples_that_are_sent_fewer_rays_find_as_much_light() {
    on_every_device(|device| {
        for traversal in Traversal::ALL {
            for (name, scene, sky, view, steps) in [
                ("room, an empty cache", rooms(), dark(), inside(-2.0), 0),
                ("room", rooms(), dark(), inside(-2.0), 30),
                ("roofless room", roofless(), Environment::constant(Vec3::ONE), inside(-2.0), 30),
                ("shining walls", shining(), dark(), inside(-2.0), 30),
                ("gap", gap(), Environment::constant(Vec3::ONE), along(), 30),
            ] {
                let mut bench = Bench::walking(device, &scene, &sky, &EVERYTHING, traversal);
                lit(&mut bench, &view, 0..steps);
                let all = mean(&mut bench, &view, &CACHED, 8);
                for fewer in [8, 16, 32] {
                    let settings = Settings { fewer_rays: Some(fewer), ..CACHED };
                    let known = mean_of_known(&mut bench, &view, &settings, 8);
                    println!("{}, {name}: {fewer} rays {known:.4}, 64 rays {all:.4}", traversal.name());
                    assert!((known / all - 1.0).abs() < 0.01, "{name}: {known} of {fewer} rays for {all}");
                }
            }
        }
    });
}

/// Samples that are sent all rays are shaded to the bit as where none is sent fewer, also where paths are followed from each hit.
#[test]
fn samples_that_are_sent_all_rays_do_not_see_that_others_are_sent_fewer() {
    on_every_device(|device| {
        let view = inside(-2.0);
        let pattern = all_pixels(&view);
        for traversal in Traversal::ALL {
            let mut bench = Bench::walking(device, &rooms(), &dark(), &EVERYTHING, traversal);
            let all = Settings { bounces: 1, rays: 32, ..GUIDED };
            let mut samples = |fewer_rays| {
                let settings = Settings { fewer_rays, ..all };
                bench.trace(&view, &settings, &pattern).samples
            };
            assert!(samples(None) == samples(Some(4)), "{}", traversal.name());
        }
    });
}

/// The cells of the floor reach into both rooms. The first room is seen first.
#[test]
fn no_light_leaks_through_a_wall() {
    on_every_device(|device| {
        let mut bench = Bench::walking(device, &rooms(), &dark(), &EVERYTHING, Traversal::for_device(device));
        let (first, second) = (inside(-2.0), inside(2.0));
        lit(&mut bench, &first, 0..40);
        let bright = mean(&mut bench, &first, &CACHED, 1);
        lit(&mut bench, &second, 40..41);
        let at_once = mean(&mut bench, &second, &CACHED, 4);
        lit(&mut bench, &second, 41..70);
        let later = mean(&mut bench, &second, &CACHED, 4);
        println!("lit room {bright:.4}, dark room at once {at_once:.2e}, later {later:.2e}");
        assert!(bright > 0.1);
        assert!(at_once < 5e-3 * bright && later < 5e-3 * bright);
        // A gap in the wall is noticed.
        let mut open = rooms();
        open.mesh.triangles.pop();
        open.mesh.materials.pop();
        let mut bench = Bench::walking(device, &open, &dark(), &EVERYTHING, Traversal::for_device(device));
        lit(&mut bench, &second, 0..30);
        assert!(mean(&mut bench, &second, &CACHED, 1) > 0.02 * bright);
    });
}

#[test]
fn the_same_steps_make_the_same_cache() {
    on_every_device(|device| {
        let view = inside(-2.0);
        let filled = |traversal: Traversal| {
            let mut bench = Bench::walking(device, &rooms(), &dark(), &EVERYTHING, traversal);
            let pattern = lit(&mut bench, &view, 0..12);
            bench.trace(&view, &CACHED, &pattern).samples
        };
        let traversal = Traversal::for_device(device);
        assert_eq!(filled(traversal), filled(traversal));
    });
}

/// A wall beside a floor, lit by a lamp close to it, which a shelf hides from the floor.
fn glaring_wall() -> Scene {
    let both = |albedo| Material { double_sided: true, ..matt(albedo) };
    let mut scene = scene_of(vec![both(0.5), both(0.5)]);
    floor(&mut scene, 2.0, 0.0, 0);
    let wall = |y: f32, z: f32| Vec3::new(1.0, y, z);
    quad(&mut scene, [wall(0.0, -2.0), wall(3.0, -2.0), wall(3.0, 2.0), wall(0.0, 2.0)], 1);
    let shelf = |x: f32, z: f32| Vec3::new(x, 0.98, z);
    quad(&mut scene, [shelf(0.8, -2.0), shelf(1.0, -2.0), shelf(1.0, 2.0), shelf(0.8, 2.0)], 1);
    scene.lights = vec![Light { intensity: Vec3::splat(200.0), ..lamp(Vec3::new(0.95, 1.0, 0.0)) }];
    scene
}

/// By day what rays find of such a wall counts no more than white in the sun; at night it counts as it is.
#[test]
fn what_lamps_light_from_nearby_makes_no_spots_by_day() {
    on_every_device(|device| {
        let eye = view(DVec3::new(-1.6, 1.2, 0.0), DVec3::new(-0.4, 0.0, 0.0), 30.0, SIZE);
        // White surfaces that face it have a radiance of 5.
        let sun = Sun { direction: Vec3::Y, cos_radius: 0.9999, radiance: Vec3::splat(2.5e4) };
        let brightest = |sun: Option<Sun>| {
            let light = Environment { sun, ..dark() };
            let mut bench =
                Bench::walking(device, &glaring_wall(), &light, &EVERYTHING, Traversal::for_device(device));
            let pattern = lit(&mut bench, &eye, 0..30);
            let samples = bench.trace(&eye, &Settings { rays: 8, ..CACHED }, &pattern).samples;
            samples.iter().flat_map(|sample| sample.first).fold(0.0, f32::max)
        };
        let (day, night) = (brightest(Some(sun)), brightest(None));
        let moon = Sun { radiance: Vec3::splat(2.5e-3), ..sun };
        let dim = brightest(Some(moon));
        println!("brightest by day {day:.3}, at night {night:.3}, with a moon {dim:.3}");
        assert!(day > 0.1 && day < 10.0 && night > 2.0 * day && dim > 2.0 * day, "{day} {night} {dim}");
    });
}
