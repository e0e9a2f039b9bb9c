//! What the kernels write besides radiance: visibility, guided samples, the same bits for the same seed.

use foveate::gpu::opencl::Device;
use foveate::layout::{
    SUN_VISIBLE, SampleRecord, VisibilityRecord, unpack_emission, unpack_normal24, unpack_surface,
};
use foveate::math::view::View;
use foveate::reference::{self, Surface, TextureMode, Tracer};
use foveate::scene::{AlphaMode, Environment, Features, Material, Scene, Sun};
use foveate::trace::{Settings, Traversal};
use glam::{DVec2, DVec3, Vec3, Vec4};

use crate::bench::{Bench, EVERYTHING, PLAIN, all_pixels, on_every_device, view};
use crate::cases;
use crate::scenes::{colourful, cuboid, floor, mapped, matt, metal, scene_of, sphere, texture};

const SIZE: (u32, u32) = (48, 32);

fn eye() -> View {
    view(DVec3::new(0.2, 1.5, 3.1), DVec3::new(0.0, 0.4, 0.0), 60.0, SIZE)
}

/// A floor, a block and a ball seen from inside and outside, each of another material.
fn still_life() -> Scene {
    let red = Material { emissive: Vec3::new(0.3, 40.0, 1e-3), ..metal(Vec3::new(0.9, 0.1, 0.0), 0.35) };
    let mut scene = scene_of(vec![matt(0.37), red]);
    floor(&mut scene, 6.0, 0.0, 0);
    cuboid(&mut scene, Vec3::new(-0.9, 0.0, -0.5), Vec3::new(0.1, 0.8, 0.4), 1);
    let plastic = Material {
        double_sided: true,
        base_color: Vec4::new(0.05, 0.6, 1.0, 1.0),
        roughness: 0.6,
        metallic: 0.2,
        ..Material::default()
    };
    let ball = sphere(2, Vec3::new(0.9, 0.6, 0.2), 0.5, plastic.clone());
    let (first, centre) = (scene.mesh.positions.len() as u32, Vec3::new(0.9, 0.6, 0.2));
    scene.materials.push(plastic);
    let mesh = &mut scene.mesh;
    mesh.triangles.extend(ball.mesh.triangles.iter().map(|t| t.map(|index| index + first)));
    mesh.materials.extend(ball.mesh.triangles.iter().map(|_| 2));
    // Smooth normals, inwards as the ball's triangles are.
    mesh.normals.extend(ball.mesh.positions.iter().map(|p| (centre - p).normalize()));
    mesh.positions.extend(ball.mesh.positions);
    mesh.tangents.extend(ball.mesh.tangents);
    mesh.uvs[0].extend(&ball.mesh.uvs[0]);
    scene
}

/// The roots of a base colour, metalness and roughness, and how far each may be off by its code's length.
fn described(record: &VisibilityRecord) -> [(f64, f64); 5] {
    let part = |packed: u32, shift: u32, bits: u32| {
        let most = f64::from((1u32 << bits) - 1);
        (f64::from(packed >> shift & ((1u32 << bits) - 1)) / most, 0.51 / most)
    };
    let (base, surface) = (record.base, record.surface);
    [part(base, 4, 12), part(base, 20, 12), part(surface, 0, 12), part(surface, 12, 8), part(surface, 20, 12)]
}

#[test]
fn visibility_is_what_the_reference_sees() {
    on_every_device(|device| {
        let (scene, light, view) = (still_life(), colourful(), eye());
        let settings = Settings { guided: true, rays: 1, ..PLAIN };
        let picture = Bench::new(device, &scene, &light).trace(&view, &settings, &all_pixels(&view));
        let tracer = Tracer::new(&scene);
        let (mut surfaces, mut skies) = (0, 0);
        for (pixel, record) in picture.visibility.iter().enumerate() {
            let at = DVec2::new((pixel % 48) as f64, (pixel / 48) as f64) + 0.5;
            let ray = reference::camera_ray(&scene, &view, at);
            let emitted = DVec3::from(unpack_emission(record.emission).map(f64::from));
            let Some(hit) = tracer.closest(&ray, f64::INFINITY) else {
                let sky = reference::light::background(&light, ray.direction);
                assert_eq!(
                    (record.depth, record.normal, record.base, record.surface),
                    (0.0, 0, 0, 0),
                    "{pixel}"
                );
                assert!((emitted - sky).abs().max_element() < sky.max_element() / 250.0, "{pixel}");
                skies += 1;
                continue;
            };
            if picture.hits[pixel].triangle != hit.triangle {
                continue;
            }
            surfaces += 1;
            let surface = Surface::at(&tracer, &ray, &hit, TextureMode::Level0);
            let forward = view.world_from_eye.rotation * DVec3::NEG_Z;
            let depth = (hit.t * ray.direction).dot(forward);
            assert!((f64::from(record.depth) - depth).abs() < 1e-5 * depth, "{pixel}: {record:?} {depth}");
            let normal = DVec3::from(unpack_normal24(record.normal).map(f64::from));
            assert!(normal.distance(surface.normal) < 1.5e-3, "{pixel}: {normal} {}", surface.normal);
            let [r, g, b] = surface.base_color.to_array().map(f64::sqrt);
            let expected = [r, g, b, surface.metallic, surface.roughness];
            for ((found, allowed), right) in described(record).into_iter().zip(expected) {
                assert!((found - right).abs() < allowed, "{pixel}: {record:?} {right}");
            }
            let off = (emitted - surface.emission).abs().max_element();
            assert!(off <= surface.emission.max_element() / 250.0, "{pixel}: {emitted}");
        }
        assert!(surfaces > 1000 && skies > 50, "{surfaces} {skies}");
    });
}

/// Pixels see the sun's centre where the reference's ray to it meets nothing. Rounding may decide otherwise
/// at shadows' edges only: few pixels, none of them far from one.
#[test]
fn pixels_see_the_sun_where_the_reference_does() {
    on_every_device(|device| {
        let (scene, light, view) = (still_life(), cases::floor_under_sky().light, eye());
        let sun = light.sun.unwrap().direction.as_dvec3();
        let settings = Settings { guided: true, rays: 1, ..PLAIN };
        let picture = Bench::new(device, &scene, &light).trace(&view, &settings, &all_pixels(&view));
        let tracer = Tracer::new(&scene);
        let (mut lit, mut dark, mut wrong) = (0, 0, 0);
        for (pixel, record) in picture.visibility.iter().enumerate() {
            let at = DVec2::new((pixel % 48) as f64, (pixel / 48) as f64) + 0.5;
            let ray = reference::camera_ray(&scene, &view, at);
            let Some(hit) = tracer.closest(&ray, f64::INFINITY) else { continue };
            let surface = Surface::at(&tracer, &ray, &hit, TextureMode::Level0);
            let origin = ray.origin + ray.direction * hit.t + surface.geometric_normal * 1e-5;
            let free = surface.geometric_normal.dot(sun) > 0.0
                && !tracer.occluded(&reference::Ray { origin, direction: sun }, f64::INFINITY);
            let seen = record.normal & SUN_VISIBLE == SUN_VISIBLE;
            assert!(seen || record.normal & SUN_VISIBLE == 0, "{pixel}");
            lit += usize::from(free);
            dark += usize::from(!free);
            wrong += usize::from(free != seen);
        }
        println!("{lit} pixels in the sun, {dark} in shadow, {wrong} judged otherwise");
        assert!(lit > 300 && dark > 40 && wrong * 300 <= lit + dark, "{lit} {dark} {wrong}");
    });
}

/// A normal map's record holds both normals: the vertices' and the map's.
#[test]
fn mapped_normals_are_those_of_the_reference() {
    on_every_device(|device| {
        let bumpy = Material { normal_texture: mapped(0, 0.02), ..matt(0.5) };
        let mut scene = scene_of(vec![bumpy]);
        scene
            .textures
            .push(texture(false, |i| [90 + 11 * (i % 4) as u8, 100 + 13 * (i / 4) as u8, 230, 255]));
        floor(&mut scene, 6.0, 0.0, 0);
        let picture = Bench::new(device, &scene, &cases::floor_under_sky().light).trace(
            &eye(),
            &Settings { guided: true, rays: 1, ..PLAIN },
            &all_pixels(&eye()),
        );
        let tracer = Tracer::new(&scene);
        let (mut checked, mut bent) = (0, 0);
        for (pixel, record) in picture.visibility.iter().enumerate().filter(|(_, r)| r.depth > 0.0) {
            let at = DVec2::new((pixel % 48) as f64, (pixel / 48) as f64) + 0.5;
            let ray = reference::camera_ray(&scene, &eye(), at);
            let Some(hit) = tracer.closest(&ray, f64::INFINITY) else { continue };
            let surface = Surface::at(&tracer, &ray, &hit, TextureMode::Level0);
            let found = DVec3::from(unpack_normal24(record.mapped).map(f64::from));
            assert!(found.distance(surface.normal) < 3e-3, "{pixel}: {found} {}", surface.normal);
            assert!(unpack_normal24(record.normal)[1] > 0.999, "{pixel}");
            checked += 1;
            bent += usize::from(surface.normal.y < 0.99);
        }
        assert!(checked > 500 && bent > 200, "{checked} {bent}");
    });
}

/// Dark vertex colours have no bands: what eight linear bits cannot tell from black is there.
#[test]
fn dark_vertex_colours_are_those_of_the_file() {
    on_every_device(|device| {
        let mut scene = scene_of(vec![Material { unlit: true, ..matt(1.0) }]);
        floor(&mut scene, 6.0, 0.0, 0);
        scene.mesh.colors = [1e-4, 3e-4, 7e-4, 1.5e-3].map(|c| Vec4::new(c, 2.0 * c, 3.0 * c, 1.0)).to_vec();
        let picture = Bench::new(device, &scene, &colourful()).trace(&eye(), &PLAIN, &all_pixels(&eye()));
        let tracer = Tracer::new(&scene);
        let mut checked = 0;
        for (pixel, sample) in picture.samples.iter().enumerate() {
            let at = DVec2::new((pixel % 48) as f64, (pixel / 48) as f64) + 0.5;
            let ray = reference::camera_ray(&scene, &eye(), at);
            let Some(hit) = tracer.closest(&ray, f64::INFINITY) else { continue };
            let color = Surface::at(&tracer, &ray, &hit, TextureMode::Level0).base_color;
            let off = DVec3::from(sample.first.map(f64::from)) - color;
            assert!(off.abs().max_element() < 1e-3 * color.max_element(), "{pixel}: {off} of {color}");
            checked += 1;
        }
        assert!(checked > 500, "{checked}");
    });
}

/// A surface brighter than white is that bright in guided pictures too, whose records hold no more than white.
#[test]
fn vertex_colours_above_one_are_kept_in_guided_samples() {
    on_every_device(|device| {
        for metallic in [0.0, 0.8] {
            let mut scene = scene_of(vec![Material { metallic, ..matt(1.0) }]);
            floor(&mut scene, 6.0, 0.0, 0);
            scene.mesh.colors = vec![Vec4::new(3.0, 1.5, 0.75, 1.0); 4];
            let mut bench = Bench::new(device, &scene, &colourful());
            let plain = bench.trace(&eye(), &PLAIN, &all_pixels(&eye()));
            let guided = bench.trace(&eye(), &Settings { guided: true, ..PLAIN }, &all_pixels(&eye()));
            let mut checked = 0;
            for (pixel, record) in guided.visibility.iter().enumerate().filter(|(_, r)| r.depth > 0.0) {
                let (bases, metallic, _) = unpack_surface([record.base, record.surface]);
                for channel in 0..3 {
                    let base = bases[channel];
                    let f0 = 0.04 + (base - 0.04) * metallic;
                    let (first, second) = (guided.samples[pixel].first, guided.samples[pixel].second);
                    let sum = base * (1.0 - metallic) * first[channel] + f0 * second[channel];
                    let whole = plain.samples[pixel].first[channel];
                    assert!((sum / whole - 1.0).abs() < 0.01, "{pixel}, {channel}: {sum} is not {whole}");
                }
                checked += 1;
            }
            assert!(checked > 500, "{checked}");
        }
    });
}

/// Guided pixels of surfaces with layers are what samples with the sun's light are: the record's colours times the
/// samples' parts, and the sun in the record.
#[test]
fn layered_surfaces_are_whole_in_guided_pictures() {
    on_every_device(|device| {
        let light = cases::floor_under_sky().light;
        let sun = Sun { cos_radius: 0.999_989, ..light.sun.unwrap() };
        let light = Environment { sun: Some(sun), ..light };
        for (name, material) in cases::layered_materials() {
            let mut scene = scene_of(vec![Material { roughness: 0.5, ..material }]);
            floor(&mut scene, 6.0, 0.0, 0);
            let mut bench = Bench::new(device, &scene, &light);
            let settings = Settings { rays: 256, ..PLAIN };
            let plain = bench.trace(&eye(), &settings, &all_pixels(&eye()));
            let guided = bench.trace(&eye(), &Settings { guided: true, ..settings }, &all_pixels(&eye()));
            let (mut whole, mut parts, mut pixels) = (Vec3::ZERO, Vec3::ZERO, 0);
            for (pixel, record) in guided.visibility.iter().enumerate().filter(|(_, r)| r.depth > 0.0) {
                assert_eq!(record.normal & SUN_VISIBLE, 0, "{name}: reconstruction would add the sun again");
                let (base, metallic, _) = unpack_surface([record.base, record.surface]);
                let base = Vec3::from(base);
                let f0 = Vec3::splat(0.04).lerp(base, metallic).max(Vec3::splat(1e-3));
                let sample = &guided.samples[pixel];
                parts += base * (1.0 - metallic) * Vec3::from(sample.first) + f0 * Vec3::from(sample.second);
                parts += Vec3::from(unpack_emission(record.emission));
                whole += Vec3::from(plain.samples[pixel].first);
                pixels += 1;
            }
            let off = ((parts - whole) / whole).abs().max_element();
            println!("{name}: {whole} by samples, {parts} by guided parts, off by {off}");
            assert!(pixels > 500 && off < 0.02, "{name}: {off}");
        }
    });
}

/// Guided samples times their surface's colours are the radiance that k-NN samples have.
#[test]
fn guided_samples_are_radiance_divided_by_colour() {
    on_every_device(|device| {
        let (mut scene, light, view) = (still_life(), cases::floor_under_sky().light, eye());
        scene.lights = cases::lights();
        // Guided samples leave the sun to their pixels.
        let light = foveate::scene::Environment { sun: None, ..light };
        let mut bench = Bench::new(device, &scene, &light);
        for bounces in [0, 2] {
            let settings = Settings { rays: 40, bounces, seed: 5, ..PLAIN };
            let radiance = bench.trace(&view, &settings, &all_pixels(&view));
            let guided = bench.trace(&view, &Settings { guided: true, ..settings }, &all_pixels(&view));
            let mut checked = 0;
            for (pixel, (whole, parts)) in radiance.samples.iter().zip(&guided.samples).enumerate() {
                let hit = guided.hits[pixel];
                assert_eq!(hit, radiance.hits[pixel], "{pixel}: pixels and samples hit alike");
                if hit.triangle == u32::MAX {
                    assert_eq!((parts.first, parts.second, parts.depth), ([0.0; 3], [0.0; 3], 0.0));
                    continue;
                }
                assert_eq!((whole.depth, whole.normal, whole.second), (parts.depth, parts.normal, [0.0; 3]));
                let material = &scene.materials[scene.mesh.materials[hit.triangle as usize] as usize];
                let base = material.base_color.truncate();
                let diffuse = base * (1.0 - material.metallic) * Vec3::from(parts.first);
                let f0 = Vec3::splat(0.04).lerp(base, material.metallic).max(Vec3::splat(1e-3));
                let sum = diffuse + f0 * Vec3::from(parts.second) + material.emissive;
                let whole = Vec3::from(whole.first);
                let off = (sum - whole).abs().max_element();
                assert!(off <= 1e-5 * whole.max_element(), "{pixel}: {sum} is not {whole}");
                checked += 1;
            }
            assert!(checked > 1000, "{checked}");
        }
    });
}

fn bits(samples: &[SampleRecord]) -> &[u32] {
    bytemuck::cast_slice(samples)
}

#[test]
fn same_seed_gives_the_same_bits_and_another_seed_others() {
    on_every_device(|device| {
        let (scene, light, view) = (still_life(), colourful(), eye());
        let trace = |settings: &Settings| {
            Bench::new(device, &scene, &light).trace(&view, settings, &all_pixels(&view))
        };
        for guided in [false, true] {
            let settings = Settings { guided, bounces: 1, ..PLAIN };
            let (first, again) = (trace(&settings), trace(&settings));
            assert_eq!(bits(&first.samples), bits(&again.samples));
            assert_eq!(first.visibility, again.visibility);
            assert_eq!((first.rays, &first.hits), (again.rays, &again.hits));
            let other = trace(&Settings { seed: 2, ..settings });
            let hit = |i: &usize| first.samples[*i].depth > 0.0;
            let differ = |i: &usize| first.samples[*i].first != other.samples[*i].first;
            let hits = (0..first.samples.len()).filter(hit).count();
            let changed = (0..first.samples.len()).filter(hit).filter(differ).count();
            assert!(changed > hits * 9 / 10, "{changed} of {hits}");
            let jittered = trace(&Settings { jitter: true, ..settings });
            assert_ne!(first.hits, jittered.hits);
        }
    });
}

/// Sums that would overflow halves or lose their small parts are still numbers, and none is negative.
#[test]
fn extreme_light_stays_finite() {
    on_every_device(|device| {
        let direction = Vec3::new(0.3, 0.8, 0.4).normalize();
        let mut scene = still_life();
        for radiance in [1e9, 1e-6] {
            for (sun, map) in [(1e9, 1e-6), (1e-6, 1e9), (0.0, radiance)] {
                let sun = Sun { direction, cos_radius: 0.999_989, radiance: Vec3::splat(sun) };
                let light = Environment { sun: Some(sun), ..Environment::constant(Vec3::splat(map)) };
                for material in &mut scene.materials {
                    material.roughness = if radiance > 1.0 { 0.0 } else { 1.0 };
                }
                let mut bench = Bench::new(device, &scene, &light);
                for guided in [false, true] {
                    let settings = Settings { guided, bounces: 2, ..PLAIN };
                    let picture = bench.trace(&eye(), &settings, &all_pixels(&eye()));
                    assert_eq!(picture.dropped, 0);
                    let numbers = |s: &SampleRecord| [s.first, s.second].concat();
                    assert!(picture.samples.iter().flat_map(numbers).all(|v| v.is_finite() && v >= 0.0));
                    assert!(picture.samples.iter().all(|s| s.depth.is_finite() && s.depth >= 0.0));
                    assert!(picture.samples.iter().flat_map(numbers).any(|v| v > 0.0));
                }
            }
        }
    });
}

/// Kernels built with every feature give what kernels give that have only those that a scene requires: bit by bit, but
/// for layers and glass, whose code is rounded elsewhere.
#[test]
fn specialised_kernels_are_the_general_ones() {
    on_every_device(|device| {
        let masked = Material { alpha: AlphaMode::Mask(0.5), ..matt(0.6) };
        let mut pierced = still_life();
        pierced.materials[1] = masked;
        let mut lit = still_life();
        lit.lights = cases::lights();
        let bare = still_life();
        let sky = cases::floor_under_sky().light;
        for (name, scene, light) in
            [("bare", &bare, &colourful()), ("sun and lights", &lit, &sky), ("alpha", &pierced, &colourful())]
        {
            let required = Features::required_by(scene, light);
            assert_ne!(required, EVERYTHING);
            for guided in [false, true] {
                let settings = Settings { guided, bounces: 1, ..PLAIN };
                let trace = |features: &Features| trace_with(device, scene, light, features, &settings);
                let (special, whole) = (trace(&required), trace(&EVERYTHING));
                let general = trace(&Features { layers: false, glass: false, ..EVERYTHING });
                assert_eq!((&special.hits, &special.hits), (&general.hits, &whole.hits), "{name}");
                assert_eq!(special.visibility, general.visibility, "{name}");
                assert_eq!(special.visibility, whole.visibility, "{name}");
                // Code around the same sums may have them rounded in another order.
                let others = general.samples.iter().chain(&whole.samples);
                for (a, b) in special.samples.iter().cycle().zip(others) {
                    let (first, second) = (Vec3::from(a.first), Vec3::from(a.second));
                    let off = (first - Vec3::from(b.first)).abs().max((second - Vec3::from(b.second)).abs());
                    let most = first.max_element().max(second.max_element());
                    assert!(off.max_element() <= 1e-4 * most, "{name}: {a:?} {b:?}");
                }
            }
        }
    });
}

/// The flags by their bits: textures, normal maps, alpha, vertex colours, sun, emitters, layers, glass, glossy,
/// instances.
fn combination(bits: u32) -> Features {
    let on = |bit: u32| bits >> bit & 1 != 0;
    Features {
        textures: on(0),
        normal_maps: on(1),
        alpha: on(2),
        vertex_colors: on(3),
        sun: on(4),
        emitters: on(5),
        layers: on(6),
        glass: on(7),
        glossy: on(8),
        instances: on(9),
    }
}

/// Builds kernels for combinations of features, in both variants, and makes all kernels of a frame from them.
fn build(device: &Device, combinations: impl Iterator<Item = u32>) {
    let (scene, light) = (still_life(), colourful());
    let mut seen = std::collections::HashSet::new();
    for features in combinations.map(combination) {
        assert!(seen.insert(features), "{features:?} comes twice");
        for traversal in Traversal::ALL {
            Bench::walking(device, &scene, &light, &features, traversal);
        }
    }
    println!("{} combinations in {} variants", seen.len(), Traversal::ALL.len());
}

#[test]
fn each_feature_builds_alone_and_beside_all_others() {
    on_every_device(|device| build(device, (0..10).map(|bit| 1 << bit).chain([0, 0b11_1111_1111])));
}

#[test]
#[ignore = "1044 builds: make test-long"]
fn long_every_combination_of_features_builds() {
    on_every_device(|device| build(device, (0..512).chain((0..10).map(|bit| 1 << 9 | (1 << bit) >> 1))));
}

fn trace_with(
    device: &Device,
    scene: &Scene,
    light: &Environment,
    features: &Features,
    settings: &Settings,
) -> crate::bench::Picture {
    Bench::with(device, scene, light, features).trace(&eye(), settings, &all_pixels(&eye()))
}
