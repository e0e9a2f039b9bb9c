//! Guided pictures against the same stages in double precision, on a still life that has every kind of texture, a
//! polished floor, a mirror and bumps: as samples are (the pixels' stage alone), filtered, and seen from elsewhere.

use foveate::foveation::{Law, Pattern};
use foveate::gpu::vulkan::{Context, Format, HostBuffer, Image};
use foveate::layout::{IS_MAPPED, SampleRecord, VisibilityRecord, unpack_emission, unpack_normal24};
use foveate::math::pose::Pose;
use foveate::math::spacing::{Axis, Spacing};
use foveate::math::view::View;
use foveate::reconstruct::{
    Frame, GuidedSettings, Mode, Output, Reconstruction, Reuse, Settings as Reconstructed, Weights,
};
use foveate::reference::guided::{Choices, Guided, directional_share};
use foveate::reference::reconstruct::WeightKind;
use foveate::reference::{self, Surface, TextureMode, Tracer};
use foveate::scene::sky::Sky;
use foveate::scene::{AlphaMode, Environment, Material, Scene};
use foveate::trace::{Settings, Traversal};
use glam::{DQuat, DVec2, DVec3, Vec3};

use crate::bench::{Bench, EVERYTHING, PLAIN, Picture, all_pixels, on_every_device, view};
use crate::common;
use crate::scenes::{colourful, cuboid, floor, mapped, matt, metal, quad, scene_of, texture};

const SIZE: (u32, u32) = (64, 48);
const LEAST: f32 = 0.02;

/// A polished floor, a mirror, and a block whose texture plays every role.
pub fn still_life() -> Scene {
    let every = Material {
        base_color_texture: mapped(0, 1.7),
        metallic_roughness_texture: mapped(1, 1.3),
        normal_texture: mapped(2, 2.1),
        occlusion_texture: mapped(3, 1.0),
        emissive: Vec3::new(0.2, 0.1, 0.3),
        emissive_texture: mapped(4, 1.1),
        ..matt(0.9)
    };
    let every = Material { metallic: 0.8, roughness: 0.9, ..every };
    let polished = Material { roughness: 0.12, ..matt(0.3) };
    let mut scene = scene_of(vec![polished, metal(Vec3::new(0.9, 0.8, 0.6), 0.05), every, matt(0.5)]);
    // Up and down again, since textures repeat.
    let wave = |i: u32| [0, 1, 2, 1][(i % 4) as usize] + [0, 1, 2, 1][(i / 4) as usize];
    scene.textures = vec![
        texture(true, |i| [60 + 12 * i as u8, 200 - 9 * i as u8, 90, 255]),
        texture(false, |i| [0, 80 + 25 * wave(i), 250 - 25 * wave(i), 255]),
        texture(false, |i| [90 + 11 * (i % 4) as u8, 100 + 13 * (i / 4) as u8, 230, 255]),
        texture(false, |i| [120 + 8 * i as u8, 0, 0, 255]),
        texture(true, |i| [15 * i as u8, 255 - 15 * i as u8, 70, 255]),
    ];
    floor(&mut scene, 6.0, 0.0, 0);
    cuboid(&mut scene, Vec3::new(-1.4, 0.0, -1.0), Vec3::new(-0.2, 1.3, -0.4), 1);
    cuboid(&mut scene, Vec3::new(0.1, 0.0, -0.5), Vec3::new(1.1, 0.9, 0.5), 2);
    cuboid(&mut scene, Vec3::new(-0.9, 0.0, 0.3), Vec3::new(-0.4, 0.5, 0.8), 3);
    scene
}

/// The sun stands low behind things, where Fresnel's reflection is strong, and is so large that its shadows are soft over
/// several pixels.
pub fn light() -> Environment {
    let mut light = Sky { sun_elevation_deg: 16.0, sun_azimuth_deg: 14.0, ..Sky::default() }.bake();
    if let Some(sun) = &mut light.sun {
        let irradiance = sun.radiance * sun.solid_angle() as f32;
        sun.cos_radius = 2f32.to_radians().cos();
        sun.radiance = irradiance / sun.solid_angle() as f32;
    }
    light
}

pub fn eye() -> View {
    view(DVec3::new(0.3, 1.5, 3.1), DVec3::new(0.0, 0.5, 0.0), 50.0, SIZE)
}

/// The same with pixels that are farther apart away from a gaze.
fn spaced_eye() -> View {
    let ((columns, width), (rows, height)) =
        (Axis::new(SIZE.0, 38.0, 8.0, 0.03), Axis::new(SIZE.1, 20.0, 6.0, 0.02));
    assert!(width < 50 && height < 40, "{width} {height}");
    View { width, height, spacing: Spacing { columns, rows }, ..eye() }
}

/// The traced records of a sparse pattern.
pub fn traced(bench: &mut Bench, view: &View) -> (Picture, Vec<u32>) {
    traced_at(bench, view, Pattern::new(view, &Law::default(), DVec2::splat(0.5), 420))
}

fn traced_at(bench: &mut Bench, view: &View, pattern: Pattern) -> (Picture, Vec<u32>) {
    let settings = Settings { guided: true, edge_rays: 4, rays: 24, ..PLAIN };
    (bench.trace(view, &settings, &pattern), pattern.samples)
}

/// The device's picture, in linear light.
pub fn shown(
    context: &Context,
    view: &View,
    picture: &Picture,
    samples: &[u32],
    neighbours: u32,
    from: Option<Pose>,
) -> Vec<DVec3> {
    last_shown(context, view, picture, samples, neighbours, from, 1)
}

/// The last one of so many frames that are all alike, of which later ones take light from earlier ones.
pub fn last_shown(
    context: &Context,
    view: &View,
    picture: &Picture,
    samples: &[u32],
    neighbours: u32,
    from: Option<Pose>,
    frames: usize,
) -> Vec<DVec3> {
    let guided = GuidedSettings { neighbours, ..GuidedSettings::default() };
    let reuse = (frames > 1).then_some(Reuse { frames: 32, eyes: false, pictures: 1 });
    let settings = Reconstructed { mode: Mode::Guided(guided), k: 4, weights: Weights::Shepard, reuse };
    let mut reconstruction = Reconstruction::new(context, settings).unwrap();
    reconstruction.set_pattern(0, view.width, view.height, samples).unwrap();
    let buffer = |bytes: &[u8]| {
        let buffer = HostBuffer::new(context, bytes.len()).unwrap();
        buffer.write(0, bytes);
        buffer
    };
    let records = buffer(bytemuck::cast_slice(&picture.samples));
    let visibility = buffer(bytemuck::cast_slice(&picture.visibility));
    let image = Image::new(context, Format::R32G32B32A32_SFLOAT, SIZE.0, SIZE.1).unwrap();
    let frame = Frame {
        view,
        samples: (&records).into(),
        visibility: Some((&visibility).into()),
        sun: light().sun,
        least_expected: LEAST,
        light_holds: f32::INFINITY,
        light_changes: false,
        estimates: 1.0,
        rests: false,
        movers: Default::default(),
        exposure: 0.0,
        other: None,
        overlay: Default::default(),
        shown_from: from,
        jitter: Default::default(),
        outputs: &[Output::whole(image.target(), 0.0)],
    };
    for _ in 0..frames {
        reconstruction.submit(0, &frame).unwrap();
        reconstruction.wait(0).unwrap();
    }
    let floats: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&image.read().unwrap());
    floats.iter().map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into())).collect()
}

fn positions(samples: &[u32]) -> Vec<[u32; 2]> {
    samples.iter().map(|s| [s & 0xffff, s >> 16]).collect()
}

fn twin<'a>(
    view: &'a View,
    picture: &'a Picture,
    positions: &'a [[u32; 2]],
    neighbours: usize,
) -> Guided<'a> {
    let choices = Choices {
        neighbours,
        normal_power: 16.0,
        plane_tolerance: 0.25,
        deviations: [0.6, 0.25],
        k: if positions.len() == view.pixels() { 1 } else { 4 },
        weights: WeightKind::Shepard,
        least_expected: f64::from(LEAST),
    };
    Guided { view, positions, visibility: &picture.visibility, sun: light().sun, choices }
}

/// In double precision, with samples that are not averaged a second time.
pub fn filtered_once(view: &View, picture: &Picture, samples: &[u32]) -> Vec<DVec3> {
    let positions = positions(samples);
    let twin = twin(view, picture, &positions, 24);
    let prepared = twin.filter_samples(&picture.samples);
    (0..SIZE.0 * SIZE.1).map(|p| twin.guided_color(&prepared, [p % SIZE.0, p / SIZE.0])).collect()
}

/// The same in double precision.
pub fn right(
    view: &View,
    picture: &Picture,
    samples: &[u32],
    neighbours: usize,
    from: Option<Pose>,
) -> Vec<DVec3> {
    let positions = positions(samples);
    let twin = twin(view, picture, &positions, neighbours);
    let prepared = twin.prepare(&picture.samples);
    let pixel = |p: u32| {
        let at = [p % SIZE.0, p / SIZE.0];
        match view.spacing.is_even() {
            true => twin.guided_color(&prepared, from.map_or(at, |pose| twin.warped(pose, at, 3))),
            false => twin.magnified(&prepared, from.map(|pose| (pose, 3)), at),
        }
    };
    (0..SIZE.0 * SIZE.1).map(pixel).collect()
}

/// How many pixels are further off than what is packed between the passes allows, and the largest error.
pub fn compare(found: &[DVec3], right: &[DVec3]) -> (usize, f64) {
    let off = found.iter().zip(right).map(|(found, right)| {
        assert!(found.is_finite() && found.min_element() >= 0.0, "{found}");
        (*found - *right).abs().max_element() / right.max_element().max(0.05)
    });
    off.fold((0, 0.0), |(count, worst), error| (count + usize::from(error > 0.02), f64::max(worst, error)))
}

#[test]
fn guided_pictures_are_those_of_double_precision() {
    let Some(context) = common::vulkan() else { return };
    on_every_device(|device| {
        let (scene, light) = (still_life(), light());
        let mut bench = Bench::new(device, &scene, &light);
        let (picture, samples) = traced(&mut bench, &eye());
        let expecting = picture.visibility.iter().filter(|record| record.reflected != 0).count();
        let shared = picture.visibility.iter().filter(|record| record.normal >> 27 & 15 != 0).count();
        let mapped = picture.samples.iter().filter(|sample| sample.toward[0] != 0).count();
        let partly = picture.samples.iter().filter(|sample| sample.normal >> 25 != 0).count();
        assert!(
            expecting > 600 && shared > 50 && mapped > 15 && partly > 5,
            "{expecting} {shared} {mapped} {partly}"
        );
        let turn = eye().world_from_eye.rotation * DQuat::from_rotation_y(0.02);
        let moved = Pose::new(turn, eye().world_from_eye.position + DVec3::new(0.12, -0.08, 0.05));
        let (coarse, coarse_samples) = traced(&mut bench, &spaced_eye());
        let (even, spaced) = ((eye(), &picture, &samples), (spaced_eye(), &coarse, &coarse_samples));
        let full = [eye(), spaced_eye()].map(|view| {
            let (mut picture, samples) = traced_at(&mut bench, &view, all_pixels(&view));
            // Holes of some pixels, and samples on which no light falls.
            for sample in picture.samples.iter_mut().step_by(97) {
                sample.first[1] = f32::NAN;
            }
            for sample in picture.samples.iter_mut().skip(7).step_by(31) {
                (sample.first, sample.second) = ([0.0; 3], [0.0; 3]);
                (sample.toward[1], sample.toward[2]) =
                    (sample.toward[1] | 3 << 30, sample.toward[2] | 3 << 30);
            }
            (view, picture, samples)
        });
        let full = full.each_ref().map(|(view, picture, samples)| (*view, picture, samples));
        for ((view, picture, samples), neighbours, from) in [
            (&even, 1, None),
            (&even, 24, None),
            (&even, 24, Some(moved)),
            (&spaced, 24, None),
            (&spaced, 24, Some(moved)),
            (&full[0], 1, None),
            (&full[0], 24, None),
            (&full[0], 24, Some(moved)),
            (&full[1], 24, None),
        ] {
            let found = shown(&context, view, picture, samples, neighbours, from);
            let right = right(view, picture, samples, neighbours as usize, from);
            let (count, worst) = compare(&found, &right);
            println!(
                "{neighbours} neighbours, moved {}: {count} pixels off, by {worst:.3} at most",
                from.is_some()
            );
            // What is on one side of a threshold in single precision and on the other in double.
            let allowed = if from.is_some() { 40 } else { 12 };
            assert!(count <= allowed, "{neighbours} {from:?}: {count} pixels are off, by up to {worst}");
            // A comparer that finds nothing in wrong pictures finds nothing.
            let wrong: Vec<DVec3> = right.iter().map(|color| *color * DVec3::new(1.0, 1.03, 1.0)).collect();
            assert!(compare(&found, &wrong).0 > 500);
        }
    });
}

/// What each pixel's record says of textured surfaces: metalness and roughness each in its own place, of the nearest
/// texel, and the mapped normal.
#[test]
fn textured_surfaces_are_described_as_the_reference_sees_them() {
    on_every_device(|device| {
        let (scene, light) = (still_life(), light());
        let mut bench = Bench::new(device, &scene, &light);
        for view in [eye(), spaced_eye()] {
            described(&scene, &mut bench, &view);
        }
    });
}

fn described(scene: &Scene, bench: &mut Bench, view: &View) {
    let settings = Settings { guided: true, rays: 1, ..PLAIN };
    let picture = bench.trace(view, &settings, &all_pixels(view));
    let tracer = Tracer::new(scene);
    let (mut checked, mut off, mut other) = (0, [0; 3], 0);
    for (pixel, record) in picture.visibility.iter().enumerate().filter(|(_, r)| r.depth > 0.0) {
        let (x, y) = (pixel % view.width as usize, pixel / view.width as usize);
        let ray = reference::camera_ray(scene, view, DVec2::new(x as f64, y as f64) + 0.5);
        let hit = tracer.closest(&ray, f64::INFINITY);
        let Some(hit) = hit.filter(|hit| hit.triangle == picture.hits[pixel].triangle) else {
            other += 1;
            continue;
        };
        assert!((f64::from(picture.hits[pixel].t) / hit.t - 1.0).abs() < 1e-4, "{x} {y}");
        if scene.mesh.materials[hit.triangle as usize] != 2 {
            continue;
        }
        let surface = Surface::at(&tracer, &ray, &hit, TextureMode::Level0);
        let metalness = f64::from(record.surface >> 12 & 255) / 255.0;
        let roughness = f64::from(record.surface >> 20) / 4095.0;
        let mapped = unpack_normal24(record.mapped);
        checked += 1;
        // Nearest texels differ from filtered ones by half a step along each side at most.
        let allowed = 25.5 / 255.0;
        off[0] += usize::from((metalness - surface.metallic).abs() > 0.8 * allowed);
        off[1] += usize::from((roughness - surface.roughness).abs() > 0.9 * allowed);
        off[2] += usize::from(DVec3::from(mapped.map(f64::from)).distance(surface.normal) > 0.02);
    }
    println!("{checked} textured pixels, {off:?} described otherwise, {other} see something else");
    assert!(checked > view.pixels() / 20 && off.iter().all(|&off| off * 8 < checked), "{checked} {off:?}");
    assert!(other < 4, "{other} rays go elsewhere");
}

/// A work-item a pixel, as GPUs have it, describes what one for 8 by 8 pixels does, and finds the same edges.
#[test]
fn both_variants_describe_the_same() {
    on_every_device(|device| {
        let (scene, light) = (still_life(), light());
        let traced = |traversal: Traversal, view: &View| {
            let settings = Settings { guided: true, edge_rays: 4, rays: 1, ..PLAIN };
            Bench::walking(device, &scene, &light, &EVERYTHING, traversal).trace(
                view,
                &settings,
                &all_pixels(view),
            )
        };
        for view in [eye(), spaced_eye()] {
            let [packet, single] = [Traversal::Packet, Traversal::SingleRay].map(|t| traced(t, &view));
            let mut off = [0; 8];
            for (a, b) in packet.visibility.iter().zip(&single.visibility) {
                let near = |a: DVec3, b: DVec3, most: f64| (a - b).abs().max_element() <= most;
                let normal = |packed: u32| DVec3::from(unpack_normal24(packed & 0xff_ffff).map(f64::from));
                let light = |packed: u32| DVec3::from(unpack_emission(packed).map(f64::from));
                let bytes = |v: u32, w: u32| v.abs_diff(w) > 2;
                off[0] += usize::from((a.depth - b.depth).abs() > 1e-4 * a.depth);
                off[1] += usize::from(!near(normal(a.normal), normal(b.normal), 0.002));
                off[2] += usize::from(!near(normal(a.mapped), normal(b.mapped), 0.02));
                off[3] += usize::from(a.normal >> 31 != b.normal >> 31);
                off[4] += usize::from(a.normal >> 24 & 127 != b.normal >> 24 & 127);
                off[5] += usize::from(
                    bytes(a.base >> 8 & 255, b.base >> 8 & 255) || bytes(a.base >> 24, b.base >> 24),
                );
                let (lit, reflected) = (light(a.emission), light(a.reflected));
                off[6] += usize::from(!near(lit, light(b.emission), 0.02 * lit.max_element() + 1e-3));
                off[7] +=
                    usize::from(!near(reflected, light(b.reflected), 0.1 * reflected.max_element() + 1e-2));
            }
            let pixels = view.pixels();
            println!(
                "{pixels} pixels; differing in depth, normal, mapped, sun, edge, base, emission, reflection: {off:?}"
            );
            assert!(off.iter().all(|&count| count * 50 <= pixels), "{off:?} of {pixels}");
            let shared = single.visibility.iter().filter(|record| record.normal >> 27 & 15 != 0).count();
            assert!(shared > 50 && off[0] * 200 <= pixels, "{shared} edges");
        }
    });
}

/// Samples on a normal map, multiplied by what their light's directions give their own normal, have the radiance of
/// samples that are shown as they are.
#[test]
fn samples_on_normal_maps_keep_their_radiance() {
    on_every_device(|device| {
        let bumpy = Material { normal_texture: mapped(0, 0.5), ..matt(0.6) };
        let mut scene = scene_of(vec![bumpy]);
        scene.textures =
            vec![texture(false, |i| [90 + 40 * (i % 4) as u8, 80 + 30 * (i / 4) as u8, 220, 255])];
        floor(&mut scene, 6.0, 0.0, 0);
        let light = Environment { sun: None, ..light() };
        let mut bench = Bench::new(device, &scene, &light);
        let (view, settings) = (eye(), Settings { rays: 96, ..PLAIN });
        let whole = bench.trace(&view, &settings, &all_pixels(&view));
        let parts = bench.trace(&view, &Settings { guided: true, ..settings }, &all_pixels(&view));
        let (mut checked, mut directed) = (0, 0);
        for (pixel, (whole, sample)) in whole.samples.iter().zip(&parts.samples).enumerate() {
            let record = &parts.visibility[pixel];
            if sample.depth <= 0.0 {
                continue;
            }
            assert_ne!(sample.toward[0] & IS_MAPPED, 0);
            let normal = DVec3::from(unpack_normal24(record.mapped).map(f64::from));
            let share = DVec3::from_array(sample.toward.map(|packed| {
                let axis = |shift: u32| f64::from((packed << shift) as i32 >> 22) / 511.0;
                directional_share(DVec3::new(axis(22), axis(12), axis(2)), normal)
            }));
            let diffuse = DVec3::from(sample.first.map(f64::from)) * share * 0.6;
            let found = diffuse + DVec3::from(sample.second.map(f64::from)) * 0.04;
            let right = DVec3::from(whole.first.map(f64::from));
            let off = (found - right).abs().max_element();
            // Rays that no neighbour needs are not traced for radiance alone, which changes no other ray.
            assert!(off < 0.01 * right.max_element(), "{pixel}: {found} is not {right}");
            checked += 1;
            directed += usize::from((share - DVec3::ONE).abs().max_element() > 0.1);
        }
        assert!(checked > 1000 && directed > 500, "{checked} {directed}");
    });
}

/// So are those of panes before each other, which cover things in part.
#[test]
fn guided_pictures_of_panes_are_those_of_double_precision() {
    let Some(context) = common::vulkan() else { return };
    on_every_device(|device| {
        let mut scene = still_life();
        let pane = |color: Vec3, alpha: f32| Material {
            base_color: color.extend(alpha),
            alpha: AlphaMode::Blend,
            double_sided: true,
            ..matt(1.0)
        };
        for (i, color) in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().enumerate() {
            scene.materials.push(pane(color, 0.3 + 0.1 * i as f32));
            let (z, right) = (1.0 + 0.2 * i as f32, 0.2 + 0.3 * i as f32);
            let corners = [[-0.9, 0.1], [right, 0.1], [right, 1.2], [-0.9, 1.2]];
            let material = scene.materials.len() as u32 - 1;
            quad(&mut scene, corners.map(|[x, y]| Vec3::new(x, y, z)), material);
        }
        let mut bench = Bench::new(device, &scene, &light());
        let (picture, samples) = traced(&mut bench, &eye());
        let shares = |record: &VisibilityRecord| [record.normal >> 27, record.base, record.base >> 16];
        let of_three =
            picture.visibility.iter().filter(|r| shares(r).iter().all(|code| code & 15 > 0)).count();
        assert!(of_three > 100, "{of_three}");
        for neighbours in [1, 24] {
            let found = shown(&context, &eye(), &picture, &samples, neighbours, None);
            let (count, worst) =
                compare(&found, &right(&eye(), &picture, &samples, neighbours as usize, None));
            println!("{neighbours} neighbours: {count} pixels off, by {worst:.3} at most");
            assert!(count <= 12, "{neighbours}: {count} pixels are off, by up to {worst}");
        }
    });
}

/// A mirror that sees a second one shows what that one sees.
#[test]
fn mirrors_in_mirrors_show_what_stands_before_them() {
    on_every_device(|device| {
        let glowing = Material { unlit: true, ..metal(Vec3::new(0.9, 0.5, 0.2), 1.0) };
        let mut scene = scene_of(vec![metal(Vec3::new(0.9, 0.9, 0.5), 0.0), glowing]);
        floor(&mut scene, 2.0, 0.0, 0);
        let wall = |z: f32, right: f32| {
            [[-right, 0.0], [right, 0.0], [right, 40.0], [-right, 40.0]].map(|[x, y]| Vec3::new(x, y, z))
        };
        quad(&mut scene, wall(-3.0, 20.0), 0);
        quad(&mut scene, wall(6.0, -20.0), 1);
        let eye = view(DVec3::new(0.0, 2.0, 3.0), DVec3::ZERO, 20.0, SIZE);
        let settings = Settings { rays: 64, guided: true, bounces: 1, ..PLAIN };
        let picture = Bench::new(device, &scene, &colourful()).trace(&eye, &settings, &all_pixels(&eye));
        // Of the floor's mirror, which samples are divided by.
        let right = Vec3::new(0.9, 0.5, 0.2) * Vec3::new(0.9, 0.9, 0.5);
        let mut checked = 0;
        for record in picture.visibility.iter().filter(|r| r.depth > 0.0) {
            let found = Vec3::from(unpack_emission(record.reflected));
            assert!((found - right).abs().max_element() < 0.02, "{found} for {right}");
            checked += 1;
        }
        assert!(checked > 2000, "{checked}");
    });
}

/// What pixels expect to mirror is about what their samples find where nothing hides the environment, and nothing
/// where a mirror sees something else.
#[test]
fn pixels_expect_about_what_samples_find() {
    on_every_device(|device| {
        for (material, allowed) in [
            (metal(Vec3::new(0.9, 0.5, 0.2), 0.02), 0.03),
            (metal(Vec3::new(0.9, 0.5, 0.2), 0.25), 0.2),
            (metal(Vec3::new(0.9, 0.5, 0.2), 0.45), 0.25),
            (Material { roughness: 0.1, ..matt(0.3) }, 0.2),
        ] {
            let mut scene = scene_of(vec![material.clone()]);
            floor(&mut scene, 6.0, 0.0, 0);
            let mut bench = Bench::new(device, &scene, &colourful());
            let settings = Settings { rays: 256, guided: true, ..PLAIN };
            let picture = bench.trace(&eye(), &settings, &all_pixels(&eye()));
            let seen: Vec<_> = picture.samples.iter().filter(|sample| sample.depth > 0.0).collect();
            let expected = |s: &SampleRecord| DVec3::from(unpack_emission(s.reflected).map(f64::from));
            let found: DVec3 = seen.iter().map(|s| DVec3::from(s.second.map(f64::from))).sum();
            let right: DVec3 = seen.iter().map(|s| expected(s)).sum();
            let off = (found / right - DVec3::ONE).abs().max_element();
            println!(
                "roughness {}: samples find {:.3} of what is expected",
                material.roughness,
                found / right
            );
            assert!(seen.len() > 1000 && off < allowed, "{}: {}", material.roughness, found / right);
        }
        let (scene, light) = (still_life(), light());
        let picture = traced(&mut Bench::new(device, &scene, &light), &eye()).0;
        let material = |pixel: usize| scene.mesh.materials[picture.hits[pixel].triangle as usize];
        let mirror =
            (0..picture.hits.len()).filter(|&p| picture.hits[p].triangle != u32::MAX && material(p) == 1);
        let dark = mirror.clone().filter(|&p| picture.visibility[p].reflected == 1).count();
        assert!(dark > 20 && dark < mirror.count(), "the mirror sees the block and the sky: {dark}");
    });
}

/// Metal that is not quite smooth mirrors what stands on it, blurred: pixels expect that too, where rays look for surfaces.
#[test]
fn pixels_of_rough_metal_expect_what_stands_on_it() {
    on_every_device(|device| {
        let mut scene = scene_of(vec![metal(Vec3::splat(0.9), 0.22), matt(0.1)]);
        floor(&mut scene, 6.0, 0.0, 0);
        cuboid(&mut scene, Vec3::new(-0.6, 0.0, -0.6), Vec3::new(0.6, 1.4, 0.0), 1);
        let mut bench = Bench::new(device, &scene, &colourful());
        let settings = Settings { rays: 256, guided: true, bounces: 1, ..PLAIN };
        let picture = bench.trace(&eye(), &settings, &all_pixels(&eye()));
        let is_floor = |sample: &&SampleRecord| sample.depth > 0.0 && sample.reflected > 1;
        let (mut off, mut all, mut dark) = (0.0, 0.0, 0);
        for sample in picture.samples.iter().filter(is_floor) {
            let expected: f32 = unpack_emission(sample.reflected).iter().sum();
            let found: f32 = sample.second.iter().sum();
            (off, all) = (off + (expected - found).abs(), all + found);
            dark += usize::from(found < 0.8);
        }
        println!("pixels are off by {:.3} of what samples find; {dark} mirror the block", off / all);
        assert!(dark > 100 && off < 0.12 * all, "{} {dark}", off / all);
    });
}
