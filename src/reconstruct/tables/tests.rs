use glam::DVec2;

use super::*;
use crate::foveation::Law;
use crate::gpu::vulkan::testing;
use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};
use crate::reconstruct::{GuidedSettings, MAX_NEIGHBOURS, Weights};
use crate::trace::pattern_maker::testing::processor;
use crate::trace::pattern_maker::{PatternMaker, PatternRequest};

/// All samples by distance from a pixel, then by index, with their squared distances.
fn by_distance(x: u32, y: u32, samples: &[u32]) -> Vec<(u64, u32)> {
    let squared = |packed: u32| {
        let (dx, dy) = (i64::from(packed & 0xffff) - i64::from(x), i64::from(packed >> 16) - i64::from(y));
        (dx * dx + dy * dy) as u64
    };
    let mut list: Vec<_> = samples.iter().zip(0u32..).map(|(&s, index)| (squared(s), index)).collect();
    list.sort_unstable();
    list
}

fn expected_weights(list: &[(u64, u32)], k: usize, weights: Weights) -> Vec<f64> {
    let d: Vec<f64> = list.iter().map(|&(squared, _)| (squared as f64).sqrt()).collect();
    let reach = if d.len() > k { d[k] } else { 2.0 * d[k - 1] };
    if d[0] == 0.0 && weights != Weights::Gaussian {
        let exact = d[..k].iter().filter(|&&d| d == 0.0).count() as f64;
        return d[..k].iter().map(|&d| if d == 0.0 { 1.0 / exact } else { 0.0 }).collect();
    }
    let weight = |d: f64| match weights {
        Weights::Shepard => ((reach - d) / (reach * d)).powi(2),
        Weights::Gaussian => (-4.5 * (d / reach.max(1.0)).powi(2)).exp(),
        Weights::Inverse => 1.0 / (d * d),
    };
    let all: Vec<f64> = d[..k].iter().map(|&d| weight(d)).collect();
    let sum: f64 = all.iter().sum();
    all.iter().map(|w| if sum > 0.0 { w / sum } else { 1.0 / k as f64 }).collect()
}

fn check_pixels(context: &Context, tables: &Tables, weights: Weights, samples: &[u32]) {
    let k = tables.k as usize;
    for band in tables.bands() {
        let pixels = (tables.width * band.rows) as usize;
        let indices: Vec<u32> = testing::fetch(context, &band.indices, pixels * k);
        let found: Vec<f32> = testing::fetch(context, &band.weights, pixels * k);
        for pixel in 0..pixels {
            let (x, y) = (pixel as u32 % tables.width, pixel as u32 / tables.width + band.first_row);
            let list = by_distance(x, y, samples);
            let expected = expected_weights(&list, k, weights);
            for j in 0..k {
                let slot = j * pixels + pixel;
                assert_eq!(indices[slot], list[j].1, "({x}, {y}) neighbour {j} of {k}");
                let error = (f64::from(found[slot]) - expected[j]).abs();
                assert!(error < 2e-5, "({x}, {y}) weight {j}: {} {}", found[slot], expected[j]);
            }
        }
    }
}

fn check_samples(context: &Context, tables: &Tables, samples: &[u32]) {
    let m = tables.neighbours as usize;
    let nearest: Vec<u32> = testing::fetch(context, tables.nearest().unwrap(), samples.len() * m);
    for (index, &packed) in samples.iter().enumerate() {
        let list = by_distance(packed & 0xffff, packed >> 16, samples);
        for (j, neighbour) in list[..m].iter().enumerate() {
            assert_eq!(nearest[j * samples.len() + index], neighbour.1, "sample {index} neighbour {j}");
        }
    }
}

fn check_pattern(context: &Context, k: u32, weights: Weights, size: (u32, u32), samples: &[u32]) {
    let guided = GuidedSettings { neighbours: MAX_NEIGHBOURS, ..GuidedSettings::default() };
    let settings = Settings { mode: Mode::Guided(guided), k, weights, reuse: None };
    let finders = Finders::new(context, &settings).unwrap();
    let mut tables = Tables::new(context).unwrap();
    tables.set(context, &settings, &finders, size, samples, None).unwrap();
    tables.wait().unwrap();
    assert_eq!(tables.k, k.min(samples.len() as u32));
    check_pixels(context, &tables, weights, samples);
    check_samples(context, &tables, samples);
}

fn scattered(count: u32, low: (u32, u32), size: (u32, u32)) -> Vec<u32> {
    let hash = |i: u32| {
        let i = i.wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995;
        (i ^ i >> 15).wrapping_mul(0x85eb_ca6b) >> 7
    };
    (0..count).map(|i| (low.0 + hash(2 * i) % size.0) | (low.1 + hash(2 * i + 1) % size.1) << 16).collect()
}

#[test]
fn neighbours_are_those_of_brute_force() {
    let Some(context) = testing::context() else { return };
    let mut clustered = scattered(150, (3, 4), (12, 9));
    clustered.push(66 | 44 << 16);
    let cases = [
        ((67, 45), scattered(200, (0, 0), (67, 45))),
        ((67, 45), clustered),
        ((64, 48), scattered(900, (0, 0), (64, 48))),
        ((33, 70), scattered(3, (0, 0), (33, 70))),
        ((50, 50), vec![7 | 9 << 16]),
        ((2, 1), vec![1]),
        // Farther than narrow keys reach, and two samples at one place.
        ((700, 9), vec![690 | 3 << 16, 3, 690 | 3 << 16, 350 | 8 << 16, 4 | 4 << 16, 5, 6, 7, 600]),
    ];
    for (size, samples) in &cases {
        for (k, weights) in [(4, Weights::Shepard), (1, Weights::Gaussian), (7, Weights::Inverse)] {
            check_pattern(&context, k, weights, *size, samples);
        }
    }
    check_pattern(&context, 16, Weights::Shepard, (67, 45), &cases[0].1);
    check_pattern(&context, 9, Weights::Gaussian, (67, 45), &cases[1].1);
    testing::assert_valid(&context);
}

#[test]
fn a_full_pattern_gives_each_pixel_its_own_sample() {
    let Some(context) = testing::context() else { return };
    let samples: Vec<u32> = (0..35u32).rev().map(|i| (i % 7) | (i / 7) << 16).collect();
    let settings = Settings::default();
    let finders = Finders::new(&context, &settings).unwrap();
    let mut tables = Tables::new(&context).unwrap();
    tables.set(&context, &settings, &finders, (7, 5), &samples, None).unwrap();
    tables.wait().unwrap();
    assert!(tables.nearest().is_none());
    check_pixels(&context, &tables, Weights::Inverse, &samples);
    testing::assert_valid(&context);
}

#[test]
fn one_sample_serves_a_wide_view_in_bands() {
    let Some(context) = testing::context() else { return };
    let settings = Settings { mode: Mode::KNearest, ..Settings::default() };
    let finders = Finders::new(&context, &settings).unwrap();
    let mut tables = Tables::new(&context).unwrap();
    let height = (context.storage_range() / (8192 * 16)).min(2048) as u32 + 24;
    tables.set(&context, &settings, &finders, (8192, height), &[8191], None).unwrap();
    tables.wait().unwrap();
    let rows: u32 = tables.bands().iter().map(|band| band.rows).sum();
    assert_eq!(rows, height);
    for band in tables.bands() {
        assert!(u64::from(band.rows) * 8192 * 16 <= context.storage_range());
        let weights: Vec<f32> = testing::fetch(&context, &band.weights, 8192 * band.rows as usize);
        assert!(weights.iter().all(|&weight| weight == 1.0));
    }
    testing::assert_valid(&context);
}

#[test]
fn patterns_that_cannot_be_used_are_refused() {
    let Some(context) = testing::context() else { return };
    let settings = Settings::default();
    let finders = Finders::new(&context, &settings).unwrap();
    let mut tables = Tables::new(&context).unwrap();
    let mut refuse = |size, samples: &[u32], key: &str| {
        let error = tables.set(&context, &settings, &finders, size, samples, None).unwrap_err();
        assert!(error.to_string().starts_with(key), "{error}");
    };
    refuse((10, 10), &[], "samples: ");
    refuse((10, 10), &[10], "pattern: ");
    refuse((0, 10), &[0], "size: ");
    refuse((1 << 16, 10), &[0], "size: ");
    testing::assert_valid(&context);
}

/// Neighbours that somebody else has found are left alone as long as frames look them up, by searches of this room's own and
/// by those of others.
#[test]
fn memory_that_is_lent_is_left_alone_while_frames_look_it_up() {
    let Some(context) = testing::context() else { return };
    let Some(device) = processor() else { return };
    if !Neighbours::is_faster_on(&device, &context) {
        println!("not run: the presenting device is no processor");
        return;
    }
    let settings = Settings::default();
    let mut maker = PatternMaker::with_neighbours(&device, &context, settings.lists()).unwrap();
    let fov = FieldOfView::symmetric(1.0, 1.0);
    let view =
        View { world_from_eye: Pose::IDENTITY, fov, width: 64, height: 48, spacing: Default::default() };
    let mut made = |gaze: f64| {
        let gaze = DVec2::splat(gaze);
        let wanted = PatternRequest { view, law: Law::default(), gaze, count: 300, hidden: None, lens: None };
        let (pattern, PatternTables::Neighbours(found)) = maker.choose(&wanted).unwrap() else {
            panic!("no neighbours, though both devices are processors")
        };
        (pattern.samples, found)
    };
    let finders = Finders::new(&context, &settings).unwrap();
    let mut tables = Tables::new(&context).unwrap();
    let mut last: Option<(Vec<u32>, BufferRef, usize)> = None;
    // Lent, lent, own, own, lent, own, lent, lent.
    for (step, is_lent) in [true, true, false, false, true, false, true, true].into_iter().enumerate() {
        let (samples, found) = made(0.1 * step as f64);
        let searched = is_lent.then_some(PatternTables::Neighbours(found));
        tables.set(&context, &settings, &finders, (64, 48), &samples, searched).unwrap();
        tables.wait().unwrap();
        check_pixels(&context, &tables, settings.weights, &samples);
        check_samples(&context, &tables, &samples);
        if let Some((indices, at, count)) = last {
            assert_eq!(indices, testing::fetch::<u32>(&context, &at, count), "step {step}: the frame before");
        }
        // Others' searches meanwhile, in all memory that is free.
        let _others = [0.9, 0.8, 0.7].map(|gaze| made(gaze - 0.1 * step as f64));
        check_pixels(&context, &tables, settings.weights, &samples);
        check_samples(&context, &tables, &samples);
        let (at, count) = (tables.bands()[0].indices.clone(), 64 * 48 * tables.k as usize);
        last = Some((testing::fetch(&context, &at, count), at, count));
        tables.keep();
    }
    testing::assert_valid(&context);
}
