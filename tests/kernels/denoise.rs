//! Light that is averaged as far as it is noisy, and what samples know of their noise.

use foveate::foveation::{Law, Pattern};
use foveate::layout::{SampleRecord, noise_code, noise_variance};
use foveate::scene::Material;
use foveate::trace::Settings;
use glam::{DVec2, DVec3, Vec3};

use crate::bench::{Bench, PLAIN, Picture, all_pixels, on_every_device};
use crate::common;
use crate::guided::{compare, eye, filtered_once, last_shown, light, right, shown, still_life, traced};
use crate::scenes::{colourful, cuboid, floor, mapped, matt, scene_of, texture};

/// With a sample in each pixel noise is averaged away, and little else: few rays gain much, and many lose less than they are off.
/// Sparse samples are averaged further, too, where they are noisy.
#[test]
fn pictures_are_averaged_as_far_as_they_are_noisy() {
    let Some(context) = common::vulkan() else { return };
    on_every_device(|device| {
        let (scene, light) = (still_life(), light());
        let mut bench = Bench::new(device, &scene, &light);
        let view = eye();
        let mut made = |rays: u32, count: Option<usize>, neighbours: u32| {
            let pattern = count.map_or_else(
                || all_pixels(&view),
                |count| Pattern::new(&view, &Law::Uniform, DVec2::splat(0.5), count),
            );
            let picture =
                bench.trace(&view, &Settings { guided: true, edge_rays: 4, rays, ..PLAIN }, &pattern);
            let shown = shown(&context, &view, &picture, &pattern.samples, neighbours, None);
            (shown, picture, pattern.samples)
        };
        let truth = made(4096, None, 1).0;
        let error = |shown: &[DVec3]| {
            let off = |(a, b): (&DVec3, &DVec3)| (*a - *b).length_squared() / b.length_squared().max(0.01);
            (shown.iter().zip(&truth).map(off).sum::<f64>() / truth.len() as f64).sqrt()
        };
        let [few, few_alone] = [24, 1].map(|neighbours| error(&made(8, None, neighbours).0));
        let [many, many_alone] = [24, 1].map(|neighbours| error(&made(1024, None, neighbours).0));
        println!(
            "all pixels: {few:.4} for {few_alone:.4} with 8 rays, {many:.4} for {many_alone:.4} with 1024"
        );
        assert!(few < 0.6 * few_alone, "{few} for {few_alone}");
        assert!(many < 1.7 * many_alone, "{many} for {many_alone}");
        let mut errors = [0.0; 2];
        for rays in [4, 5, 6] {
            let (shown, picture, samples) = made(rays, Some(900), 24);
            errors[0] += error(&shown);
            errors[1] += error(&filtered_once(&view, &picture, &samples));
        }
        errors = errors.map(|sum| sum / 3.0);
        println!("sparse: {:.4} for {:.4}", errors[0], errors[1]);
        assert!(errors[0] < 0.98 * errors[1], "{errors:?}");
    });
}

/// Sparse samples are averaged a second time as far as they are noisy, in frames that know of earlier ones, too.
#[test]
fn frames_that_know_of_earlier_ones_are_averaged_by_noise() {
    let Some(context) = common::vulkan() else { return };
    on_every_device(|device| {
        let (scene, light) = (still_life(), light());
        let (picture, samples) = traced(&mut Bench::new(device, &scene, &light), &eye());
        let once = filtered_once(&eye(), &picture, &samples);
        let twice = right(&eye(), &picture, &samples, 24, None);
        for frames in [1, 2] {
            let found = last_shown(&context, &eye(), &picture, &samples, 24, None, frames);
            let off = [compare(&found, &once).0, compare(&found, &twice).0];
            println!("{frames} frames: {off:?} pixels off");
            assert!(off[0] > 100 && off[1] < 40, "{frames}: {off:?}");
        }
    });
}

/// Few rays tell less of where light comes from than their mean direction's length says: floors with normal maps beneath a roof
/// are not much brighter with eight rays than with many.
#[test]
fn few_rays_leave_normal_maps_as_bright_as_many() {
    let Some(context) = common::vulkan() else { return };
    on_every_device(|device| {
        let bumpy = Material { normal_texture: mapped(0, 0.5), ..matt(0.6) };
        let mut scene = scene_of(vec![bumpy, matt(0.5)]);
        scene.textures =
            vec![texture(false, |i| [90 + 11 * (i % 4) as u8, 100 + 13 * (i / 4) as u8, 230, 255])];
        floor(&mut scene, 6.0, 0.0, 0);
        cuboid(&mut scene, Vec3::new(-1.5, 0.6, -1.5), Vec3::new(1.5, 0.9, 0.7), 1);
        let (light, view) = (colourful(), eye());
        let mut bench = Bench::new(device, &scene, &light);
        let mut brightness = |rays: u32, seeds: u32, neighbours: u32| {
            let sum: f64 = (0..seeds)
                .map(|seed| {
                    let settings = Settings { guided: true, rays, seed, ..PLAIN };
                    let picture = bench.trace(&view, &settings, &all_pixels(&view));
                    let samples = all_pixels(&view).samples;
                    let shown = shown(&context, &view, &picture, &samples, neighbours, None);
                    let floor = |(pixel, _): &(usize, &DVec3)| picture.samples[*pixel].toward[0] != 0;
                    shown.iter().enumerate().filter(floor).map(|(_, color)| color.element_sum()).sum::<f64>()
                })
                .sum();
            sum / f64::from(seeds)
        };
        let (few, many) = (brightness(8, 12, 24), brightness(512, 1, 1));
        println!("8 rays: {:.4} of the light of 512", few / many);
        // What is left is of samples whose direction and light are off together.
        assert!((few / many - 1.0).abs() < 0.035, "{few} for {many}");
    });
}

/// What samples say of their noise is about how far estimates with other seeds lie apart.
#[test]
fn samples_know_how_noisy_they_are() {
    on_every_device(|device| {
        let (scene, light) = (still_life(), light());
        let mut bench = Bench::new(device, &scene, &light);
        for rays in [8, 32, 128] {
            let settings = |seed| Settings { guided: true, rays, seed, ..PLAIN };
            let pictures: Vec<Picture> =
                (0..24).map(|seed| bench.trace(&eye(), &settings(seed), &all_pixels(&eye()))).collect();
            let (mut found, mut told, mut below) = (0.0, 0.0, 0);
            let lit: Vec<usize> = (0..pictures[0].samples.len())
                .filter(|&sample| pictures.iter().all(|p| p.samples[sample].first.iter().sum::<f32>() > 1e-3))
                .collect();
            for &sample in &lit {
                let relative = |part: fn(&SampleRecord) -> [f32; 3]| {
                    let values: Vec<f64> = pictures
                        .iter()
                        .map(|p| {
                            Vec3::from(part(&p.samples[sample])).dot(Vec3::new(0.2126, 0.7152, 0.0722)).into()
                        })
                        .collect();
                    let mean = values.iter().sum::<f64>() / values.len() as f64;
                    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
                    squares / (values.len() - 1) as f64 / (mean * mean).max(1e-12)
                };
                let say: f64 = pictures
                    .iter()
                    .map(|p| noise_variance(noise_code(p.samples[sample].toward)))
                    .sum::<f64>()
                    / 24.0;
                let [first, second] = [relative(|s| s.first), relative(|s| s.second)];
                below += usize::from(say < 0.5 * first.min(second));
                (found, told) = (found + first.max(second).min(4.0).sqrt(), told + say.min(4.0).sqrt());
            }
            println!(
                "{rays} rays: {} samples, off by {:.4}, which say {:.4}; {below} too little",
                lit.len(),
                found / lit.len() as f64,
                told / lit.len() as f64
            );
            assert!(lit.len() > 1500, "{}", lit.len());
            assert!(below * 50 < lit.len(), "{rays}: {below} of {}", lit.len());
            assert!(told < 4.0 * found && told > 0.5 * found, "{rays}: {told} for {found}");
        }
    });
}
