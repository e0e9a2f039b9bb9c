//! The k-nearest reconstruction of the presenting device against brute force in `f64`.

mod common;

use foveate::foveation::{Law, Pattern};
use foveate::gpu::vulkan::{Context, Format, HostBuffer, Image};
use foveate::layout::SampleRecord;
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::reconstruct::{Frame, Mode, Output, Reconstruction, Settings, Weights};
use foveate::reference::Random;
use foveate::reference::reconstruct::{WeightKind, reconstruct};
use glam::{DVec2, DVec3};

/// Weights are `f32`, and so are sums of up to 16 of them: relative to the brightest sample.
const TOLERANCE: f64 = 1e-5;

const KINDS: [(Weights, WeightKind); 3] = [
    (Weights::Shepard, WeightKind::Shepard),
    (Weights::Gaussian, WeightKind::Gaussian),
    (Weights::Inverse, WeightKind::Inverse),
];

fn view(width: u32, height: u32) -> View {
    let fov = FieldOfView { left: -1.4, right: 1.1, up: 0.9, down: -0.8 };
    View { world_from_eye: Pose::IDENTITY, fov, width, height, spacing: Default::default() }
}

/// Independent uniform colours, one for each sample.
fn colours(count: usize) -> Vec<[f32; 3]> {
    let mut random = Random::new(3);
    (0..count).map(|_| [0; 3].map(|_| random.uniform() as f32)).collect()
}

fn records(colours: &[[f32; 3]]) -> Vec<SampleRecord> {
    colours.iter().map(|&first| SampleRecord { first, depth: 1.0, ..SampleRecord::default() }).collect()
}

/// The device's picture.
fn render(
    context: &Context,
    view: &View,
    settings: Settings,
    samples: &[u32],
    colours: &[[f32; 3]],
) -> Vec<[f32; 4]> {
    let mut reconstruction = Reconstruction::new(context, settings).unwrap();
    reconstruction.set_pattern(0, view.width, view.height, samples).unwrap();
    let records = records(colours);
    let buffer = HostBuffer::new(context, size_of_val(&records[..])).unwrap();
    buffer.write(0, &records);
    let image = Image::new(context, Format::R32G32B32A32_SFLOAT, view.width, view.height).unwrap();
    let outputs = [Output::whole(image.target(), 0.0)];
    let frame = Frame {
        view,
        samples: (&buffer).into(),
        visibility: None,
        sun: None,
        least_expected: 0.01,
        light_holds: f32::INFINITY,
        light_changes: false,
        estimates: 1.0,
        rests: false,
        movers: Default::default(),
        overlay: Default::default(),
        shown_from: None,
        jitter: Default::default(),
        other: None,
        exposure: 0.0,
        outputs: &outputs,
    };
    reconstruction.submit(0, &frame).unwrap();
    reconstruction.wait(0).unwrap();
    assert_eq!(context.validation_messages(), Vec::<String>::new());
    bytemuck::pod_collect_to_vec(&image.read().unwrap())
}

fn brute_force(view: &View, k: u32, kind: WeightKind, samples: &[u32], colours: &[[f32; 3]]) -> Vec<DVec3> {
    let places: Vec<[u32; 2]> = samples.iter().map(|s| [s & 0xffff, s >> 16]).collect();
    let colours: Vec<DVec3> = colours.iter().map(|c| DVec3::from(c.map(f64::from))).collect();
    reconstruct((view.width, view.height), &places, &colours, k as usize, kind)
}

/// Pixels that differ, and the largest difference.
fn differences(found: &[[f32; 4]], expected: &[DVec3]) -> (usize, f64) {
    assert_eq!(found.len(), expected.len());
    let errors = found.iter().zip(expected).map(|(found, expected)| {
        let found = DVec3::new(f64::from(found[0]), f64::from(found[1]), f64::from(found[2]));
        if found.is_finite() { (found - expected).abs().max_element() } else { f64::INFINITY }
    });
    errors.fold((0, 0.0), |(count, worst), error| (count + usize::from(error > TOLERANCE), worst.max(error)))
}

fn check(context: &Context, view: &View, k: u32, samples: &[u32]) {
    let colours = colours(samples.len());
    for (weights, kind) in KINDS {
        let settings = Settings { mode: Mode::KNearest, k, weights, reuse: None };
        let found = render(context, view, settings, samples, &colours);
        let (count, worst) = differences(&found, &brute_force(view, k, kind, samples, &colours));
        let View { width, height, .. } = view;
        println!("{width}x{height}, {} samples, k {k}, {kind:?}: off by {worst:.1e}", samples.len());
        assert_eq!(count, 0, "{width}x{height}, {} samples, k {k}, {kind:?}: off by {worst}", samples.len());
    }
}

fn pattern(view: &View, gaze: DVec2, count: usize) -> Vec<u32> {
    Pattern::new(view, &Law::default(), gaze, count).samples
}

#[test]
fn pictures_are_those_of_brute_force_wherever_the_gaze_is() {
    let Some(context) = common::vulkan() else { return };
    let view = view(97, 61);
    let gazes = [[0.5, 0.5], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    for (gaze, k) in gazes.into_iter().zip([6, 1, 4, 8, 16]) {
        check(&context, &view, k, &pattern(&view, DVec2::from(gaze), 320));
    }
}

#[test]
fn few_samples_are_enough() {
    let Some(context) = common::vulkan() else { return };
    let small = view(33, 20);
    check(&context, &small, 6, &[17 | 5 << 16]);
    check(&context, &small, 16, &[0, 32, 19 << 16, 32 | 19 << 16, 16 | 10 << 16]);
    // k is the number of samples: none is left to be R.
    check(&context, &small, 5, &[0, 32, 19 << 16, 32 | 19 << 16, 16 | 10 << 16]);
    check(&context, &view(1, 1), 4, &[0]);
    check(&context, &view(2, 1), 1, &[0, 1]);
}

#[test]
fn full_pictures_are_their_samples() {
    let Some(context) = common::vulkan() else { return };
    let view = view(40, 24);
    let samples = Pattern::new(&view, &Law::Full, DVec2::splat(0.5), 0).samples;
    let colours = colours(samples.len());
    let expected = brute_force(&view, 1, WeightKind::Inverse, &samples, &colours);
    for (weights, _) in KINDS {
        let settings = Settings { mode: Mode::KNearest, k: 4, weights, reuse: None };
        let found = render(&context, &view, settings, &samples, &colours);
        assert_eq!(differences(&found, &expected).0, 0, "{weights:?}");
    }
}

#[test]
fn clusters_have_ties_everywhere() {
    let Some(context) = common::vulkan() else { return };
    let view = view(40, 24);
    let corner: Vec<u32> = (0..64).map(|i| (i % 8) | (i / 8) << 16).collect();
    check(&context, &view, 6, &corner);
}

#[test]
fn wide_views_are_those_of_brute_force() {
    let Some(context) = common::vulkan() else { return };
    let view = view(8192, 16);
    check(&context, &view, 4, &pattern(&view, DVec2::new(0.9, 0.5), 600));
}

/// Guards the guard: one wrong sample, or another k, is noticed.
#[test]
fn wrong_pictures_are_noticed() {
    let Some(context) = common::vulkan() else { return };
    let view = view(97, 61);
    let samples = pattern(&view, DVec2::splat(0.5), 320);
    let settings = Settings { mode: Mode::KNearest, k: 6, weights: Weights::Shepard, reuse: None };
    let mut colours = colours(samples.len());
    let expected = brute_force(&view, 6, WeightKind::Shepard, &samples, &colours);
    let found = |k, colours: &[[f32; 3]]| {
        differences(&render(&context, &view, Settings { k, ..settings }, &samples, colours), &expected).0
    };
    assert_eq!(found(6, &colours), 0);
    assert!(found(7, &colours) > 1000);
    colours[100][1] += 0.01;
    assert!((1..1000).contains(&found(6, &colours)));
}
