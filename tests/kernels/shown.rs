//! The stages on the presenting device against double precision: weights of samples, and the late correction.

use foveate::foveation::{Law, Pattern};
use foveate::gpu::vulkan::{Context, Format, HostBuffer, Image};
use foveate::layout::SampleRecord;
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::reconstruct::{Frame, Mode, Output, Reconstruction, Settings, Weights};
use foveate::reference::Random;
use foveate::reference::reconstruct::{WeightKind, reconstruct};
use glam::{DQuat, DVec2, DVec3};

use crate::bench::all_pixels;
use crate::stages::{Row, ULP, Worst};

/// The k-nearest picture of samples, seen from a pose.
fn picture(
    context: &Context,
    view: &View,
    k: u32,
    samples: &[u32],
    colours: &[[f32; 3]],
    from: Option<Pose>,
) -> Vec<[f32; 4]> {
    let settings = Settings { mode: Mode::KNearest, k, weights: Weights::Shepard, reuse: None };
    let mut reconstruction = Reconstruction::new(context, settings).unwrap();
    reconstruction.set_pattern(0, view.width, view.height, samples).unwrap();
    let records: Vec<SampleRecord> =
        colours.iter().map(|&first| SampleRecord { first, depth: 1.0, ..SampleRecord::default() }).collect();
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
        shown_from: from,
        jitter: Default::default(),
        other: None,
        exposure: 0.0,
        outputs: &outputs,
    };
    reconstruction.submit(0, &frame).unwrap();
    reconstruction.wait(0).unwrap();
    bytemuck::pod_collect_to_vec(&image.read().unwrap())
}

fn view(turn: DQuat) -> View {
    let fov = FieldOfView { left: -1.4, right: 1.1, up: 0.9, down: -0.8 };
    View {
        world_from_eye: Pose::new(turn, DVec3::ZERO),
        fov,
        width: 192,
        height: 128,
        spacing: Default::default(),
    }
}

fn weights(context: &Context) -> Row {
    let view = view(DQuat::IDENTITY);
    let samples = Pattern::new(&view, &Law::default(), DVec2::splat(0.5), 900).samples;
    let mut random = Random::new(3);
    let colours: Vec<[f32; 3]> = samples.iter().map(|_| [0; 3].map(|_| random.uniform() as f32)).collect();
    let found = picture(context, &view, 6, &samples, &colours, None);
    let places: Vec<[u32; 2]> = samples.iter().map(|s| [s & 0xffff, s >> 16]).collect();
    let exact: Vec<DVec3> = colours.iter().map(|c| DVec3::from(c.map(f64::from))).collect();
    let truth = reconstruct((view.width, view.height), &places, &exact, 6, WeightKind::Shepard);
    let mut worst = Worst::default();
    for (pixel, (found, truth)) in found.iter().zip(&truth).enumerate() {
        worst.see((f64::from(found[0]) - truth.x).abs() / ULP, || format!("pixel {pixel}, 6 neighbours"));
    }
    worst.row("weighted mean of samples", "the brightest sample", 100.0)
}

/// Every pixel is a sample whose colour is its place: the picture tells from where each pixel was taken.
fn late_correction(context: &Context) -> Row {
    let (mut pixels, mut elsewhere) = (0u32, 0u32);
    for degrees in [0.1, 1.0, 10.0, 32.0] {
        let traced = view(DQuat::from_rotation_y(0.7) * DQuat::from_rotation_x(-0.3));
        let there = traced.world_from_eye.then(Pose::new(
            DQuat::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), f64::to_radians(degrees)),
            DVec3::ZERO,
        ));
        let samples = all_pixels(&traced).samples;
        let colours: Vec<[f32; 3]> =
            samples.iter().map(|s| [(s & 0xffff) as f32, (s >> 16) as f32, 1.0]).collect();
        let found = picture(context, &traced, 1, &samples, &colours, Some(there));
        for (pixel, found) in found.iter().enumerate() {
            let (x, y) = (pixel % traced.width as usize, pixel / traced.width as usize);
            let seen = there.rotation * traced.eye_direction(DVec2::new(x as f64, y as f64) + 0.5);
            let Some(at) = traced.project(traced.world_from_eye.rotation.conjugate() * seen) else {
                continue;
            };
            let inside = at.cmpge(DVec2::ZERO).all()
                && at.cmplt(DVec2::new(f64::from(traced.width), f64::from(traced.height))).all();
            if inside {
                let middle = DVec2::new(f64::from(found[0]), f64::from(found[1])) + 0.5;
                pixels += 1;
                elsewhere += u32::from((at - middle).abs().max_element() > 0.5);
            }
        }
    }
    assert!(pixels > 50_000, "{pixels}");
    let share = f64::from(elsewhere) / f64::from(pixels);
    let mut worst = Worst::default();
    worst.see(share, || format!("{pixels} pixels, turned by 0.1 to 32 degrees"));
    worst.row("late correction: pixels taken from elsewhere", "share of pixels", 1e-3)
}

/// Nothing where there is no Vulkan device.
pub fn rows() -> Vec<Row> {
    let Some(context) = crate::common::vulkan() else { return Vec::new() };
    vec![weights(&context), late_correction(&context)]
}
