//! Samples' light by both variants of the kernels: one kernel for packets, and those that hand light rays on in memory, as
//! GPUs have it.

use foveate::layout::{SampleRecord, VisibilityRecord, unpack_emission, unpack_normal24};
use foveate::math::view::View;
use foveate::scene::{AlphaMode, Glass, Layers, Material, Scene};
use foveate::trace::{Settings, Traversal};
use glam::{DVec3, Vec3, Vec4};

use crate::bench::{Bench, EVERYTHING, PLAIN, all_pixels, on_every_device};
use crate::cases::lights;
use crate::guided::{eye, light, still_life};
use crate::scenes::{cuboid, floor, mapped, matt, metal, quad, scene_of, texture};

fn glass() -> Glass {
    let attenuation = Vec3::new(0.2, 1.0, 2.0);
    Glass { transmission: 0.9, texture: None, ior: 1.5, solid: true, attenuation }
}

/// The still life with all that light rays look for: a lamp that is a surface, punctual ones, glass, a coat, and a wall that is
/// passed from behind.
pub fn everything() -> Scene {
    let mut scene = still_life();
    let first = scene.materials.len() as u32;
    let coat = Layers { coat: 1.0, coat_roughness: 0.3, ..Layers::default() };
    scene.materials.extend([
        Material { emissive: Vec3::new(6.0, 4.0, 2.0), ..matt(0.2) },
        Material { glass: Some(glass()), double_sided: true, roughness: 0.2, ..matt(0.8) },
        Material { layers: Some(Box::new(coat)), roughness: 0.6, ..matt(0.4) },
        matt(0.5),
    ]);
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    quad(&mut scene, [at(-0.6, 1.9, -0.6), at(0.4, 1.9, -0.6), at(0.4, 1.9, 0.4), at(-0.6, 1.9, 0.4)], first);
    cuboid(&mut scene, at(0.5, 0.0, 0.7), at(0.9, 0.4, 1.1), first + 1);
    cuboid(&mut scene, at(-1.5, 0.0, 0.5), at(-1.1, 0.6, 0.9), first + 2);
    quad(
        &mut scene,
        [at(1.7, 0.0, 1.0), at(1.7, 0.0, -1.0), at(1.7, 1.4, -1.0), at(1.7, 1.4, 1.0)],
        first + 3,
    );
    scene.lights = lights();
    scene
}

/// Whether two records are the same but for rounding.
pub fn alike(a: &SampleRecord, b: &SampleRecord) -> bool {
    let near = |a: [f32; 3], b: [f32; 3]| {
        let (a, b) = (DVec3::from(a.map(f64::from)), DVec3::from(b.map(f64::from)));
        (a - b).abs().max_element() <= 1e-3 * a.max_element() + 1e-5
    };
    let normal = |packed: u32| DVec3::from(unpack_normal24(packed & 0xff_ffff).map(f64::from));
    // Directions of 10 bits an axis.
    let toward =
        |packed: u32| DVec3::from([22, 12, 2].map(|shift| f64::from((packed << shift) as i32 >> 22) / 511.0));
    let directed = |(&a, &b): (&u32, &u32)| toward(a).distance(toward(b)) < 0.01;
    let noise = |record: &SampleRecord| record.toward[1] >> 30 | record.toward[2] >> 30 << 2;
    // The code of what hides the sun, and whether the pixel sees it.
    (a.depth - b.depth).abs() <= 1e-4 * a.depth
        && near(a.first, b.first)
        && near(a.second, b.second)
        && a.normal >> 24 == b.normal >> 24
        && noise(a) == noise(b)
        && normal(a.normal).distance(normal(b.normal)) < 0.002
        && a.toward.iter().zip(&b.toward).all(directed)
}

#[test]
fn both_variants_shade_the_same() {
    on_every_device(|device| {
        let (all, light, view) = (everything(), light(), eye());
        let mut dark = all.clone();
        dark.materials.iter_mut().for_each(|material| material.emissive = Vec3::ZERO);
        let pattern = all_pixels(&view);
        let guided = Settings { guided: true, ..PLAIN };
        let cases = [
            ("rays alone", &all, Settings { rays: 32, ..PLAIN }),
            ("paths, more rays than go together", &all, Settings { rays: 80, bounces: 2, ..PLAIN }),
            ("guided paths, few rays", &all, Settings { rays: 8, bounces: 1, ..guided }),
            ("paths where nothing emits", &dark, Settings { rays: 32, bounces: 2, ..PLAIN }),
            ("guided, a cache of light", &all, Settings { rays: 32, cached: true, ..guided }),
        ];
        for (name, scene, settings) in cases {
            let [(packet, rays), (single, own)] = [Traversal::Packet, Traversal::SingleRay].map(|variant| {
                let mut bench = Bench::walking(device, scene, &light, &EVERYTHING, variant);
                if settings.cached {
                    bench.light(&view, &settings, &pattern, 0..6);
                }
                let picture = bench.trace(&view, &settings, &pattern);
                assert_eq!(picture.dropped, 0, "{name}");
                for (sample, pixel) in picture.samples.iter().zip(&picture.visibility) {
                    assert_eq!(sample.reflected, pixel.reflected, "{name}");
                }
                (picture.samples, picture.rays)
            });
            let lit = packet.iter().filter(|record| record.depth > 0.0).count();
            let off = packet.iter().zip(&single).filter(|(a, b)| !alike(a, b)).count();
            println!("{name}: {off} of {lit} samples differ, {rays} and {own} rays");
            assert!(lit > 2000 && off * 100 <= lit, "{name}: {off} of {lit} samples differ");
            assert!(rays.abs_diff(own) * 500 <= rays, "{name}: {rays} and {own} rays");
        }
    });
}

/// A mirror before a mirror, a thing that stands on the one, and metal that is not quite smooth.
pub fn mirrors() -> Scene {
    let [smooth, rough] = [0.02, 0.22].map(|roughness| metal(Vec3::new(0.9, 0.8, 0.6), roughness));
    let mut scene = scene_of(vec![smooth, rough, matt(0.5)]);
    floor(&mut scene, 6.0, 0.0, 0);
    cuboid(&mut scene, Vec3::new(-1.4, 0.0, -1.0), Vec3::new(-0.2, 1.3, -0.4), 0);
    cuboid(&mut scene, Vec3::new(0.1, 0.0, -0.5), Vec3::new(1.1, 0.9, 0.5), 1);
    cuboid(&mut scene, Vec3::new(-0.9, 0.0, 0.3), Vec3::new(-0.4, 0.5, 0.8), 2);
    scene
}

/// The mirrors behind a pane that covers them in part, and beside glass, which the low sun shines through.
pub fn mirrors_behind_panes() -> Scene {
    let mut scene = mirrors();
    let first = scene.materials.len() as u32;
    let covering = Material {
        base_color: Vec4::new(0.8, 0.3, 0.2, 0.4),
        alpha: AlphaMode::Blend,
        double_sided: true,
        ..matt(1.0)
    };
    scene.materials.extend([
        covering,
        Material { glass: Some(glass()), double_sided: true, roughness: 0.2, ..matt(0.8) },
    ]);
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    quad(
        &mut scene,
        [at(-2.5, 0.0, -1.6), at(2.5, 0.0, -1.6), at(2.5, 1.5, -1.6), at(-2.5, 1.5, -1.6)],
        first,
    );
    cuboid(&mut scene, at(0.3, 0.0, 0.9), at(0.8, 0.5, 1.3), first + 1);
    scene
}

/// Of how many pixels what they mirror differs, and how many mirror anything.
pub fn mirrored_apart(a: &[VisibilityRecord], b: &[VisibilityRecord]) -> (usize, usize) {
    let mirrored = |record: &VisibilityRecord| DVec3::from(unpack_emission(record.reflected).map(f64::from));
    let (mut off, mut shown) = (0, 0);
    for (a, b) in a.iter().zip(b).filter(|(a, _)| a.reflected > 0) {
        let (a, b) = (mirrored(a), mirrored(b));
        off += usize::from((a - b).abs().max_element() > 0.02 * a.max_element() + 1e-3);
        shown += 1;
    }
    (off, shown)
}

/// What pixels mirror: of the sky alone, of what stands there, and in more tiles than have their rays under way together.
#[test]
fn both_variants_mirror_the_same() {
    on_every_device(|device| {
        let (scene, light) = (mirrors(), light());
        let wide = View { width: 336, height: 256, ..eye() };
        let few = Settings { guided: true, rays: 1, ..PLAIN };
        let cases = [
            ("the sky", eye(), few),
            ("what stands there", eye(), Settings { bounces: 1, ..few }),
            ("many tiles", wide, Settings { bounces: 1, ..few }),
        ];
        for (name, view, settings) in cases {
            let [(packet, rays), (single, own)] = [Traversal::Packet, Traversal::SingleRay].map(|variant| {
                let mut bench = Bench::walking(device, &scene, &light, &EVERYTHING, variant);
                let picture = bench.trace(&view, &settings, &all_pixels(&view));
                (picture.visibility, picture.rays)
            });
            let (off, shown) = mirrored_apart(&packet, &single);
            println!("{name}: {off} of {shown} pixels mirror something else, {rays} and {own} rays");
            assert!(shown * 3 > view.pixels() && off * 100 <= shown, "{name}: {off} of {shown}");
            assert!(rays.abs_diff(own) * 500 <= rays, "{name}: {rays} and {own} rays");
        }
    });
}

/// A room with a pattern on its walls, so fine that it blurs over the cones of paths.
fn papered_room() -> Scene {
    let walls = Material { base_color_texture: mapped(0, 16.0), double_sided: true, ..matt(0.9) };
    let mut scene = scene_of(vec![walls, matt(0.5)]);
    scene.textures = vec![texture(false, |i| if i * 7 % 3 == 0 { [255; 4] } else { [8, 8, 8, 255] })];
    // The eye is inside.
    cuboid(&mut scene, Vec3::new(-2.0, -0.1, -2.0), Vec3::new(2.0, 3.2, 3.6), 0);
    floor(&mut scene, 1.9, 0.0, 1);
    scene.lights = lights();
    scene
}

/// What paths find on surfaces is as wide as their rays' cones are there.
#[test]
fn both_variants_blur_what_paths_meet_the_same() {
    on_every_device(|device| {
        let (scene, light, view) = (papered_room(), light(), eye());
        let pattern = all_pixels(&view);
        let settings = Settings { rays: 16, bounces: 2, ..PLAIN };
        let [packet, single] = [Traversal::Packet, Traversal::SingleRay].map(|variant| {
            let mut bench = Bench::walking(device, &scene, &light, &EVERYTHING, variant);
            let picture = bench.trace(&view, &settings, &pattern);
            // From all surfaces rays to lights and on, twice.
            assert!(picture.rays > 60 * pattern.samples.len() as u64, "{} rays", picture.rays);
            picture.samples
        });
        let off = packet.iter().zip(&single).filter(|(a, b)| !alike(a, b)).count();
        println!("{off} of {} samples differ", packet.len());
        assert!(off * 200 <= packet.len(), "{off} of {} samples differ", packet.len());
    });
}
