//! Pictures of small patterns whose right answer is known.

mod edges;

use glam::DVec2;

use super::*;
use crate::gpu::vulkan::{Encoding, Format, Image, Rect, testing};
use crate::layout::{pack_emission, pack_normal24, pack_surface};
use crate::math::pose::Pose;
use crate::math::view::FieldOfView;

const TOWARD: [f32; 3] = [0.0, 0.0, 1.0];

fn view(width: u32, height: u32) -> View {
    let fov = FieldOfView { left: -1.1, right: 0.9, up: 1.0, down: -0.8 };
    let rotation = glam::DQuat::from_euler(glam::EulerRot::YXZ, 0.4, -0.2, 0.1);
    View {
        world_from_eye: Pose::new(rotation, glam::DVec3::new(1.0, 2.0, 3.0)),
        fov,
        width,
        height,
        spacing: Default::default(),
    }
}

/// A normal of the view's own frame, as records hold it.
fn normal(view: &View, of_eye: [f32; 3]) -> u32 {
    let world = view.world_from_eye.rotation * glam::DVec3::from(of_eye.map(f64::from));
    pack_normal24([world.x as f32, world.y as f32, world.z as f32])
}

fn scattered(count: u32, width: u32, height: u32) -> Vec<u32> {
    let hash = |i: u32| (i.wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995).wrapping_mul(0x85eb_ca6b) >> 9;
    let mut samples: Vec<u32> =
        (0..count).map(|i| (hash(2 * i) % width) | ((hash(2 * i + 1) % height) << 16)).collect();
    samples.sort_unstable();
    samples.dedup();
    samples
}

struct Bench {
    reconstruction: Reconstruction,
    view: View,
    samples: Vec<u32>,
    /// What was traced lies where the device does not read it fast.
    far: bool,
}

impl Bench {
    fn new(context: &Context, mode: Mode, (width, height): (u32, u32), samples: Vec<u32>) -> Self {
        let settings = Settings { mode, ..Settings::default() };
        let mut reconstruction = Reconstruction::new(context, settings).unwrap();
        reconstruction.set_pattern(0, width, height, &samples).unwrap();
        Bench { reconstruction, view: view(width, height), samples, far: false }
    }

    /// The picture as radiance, from functions of the pixel.
    fn render(
        &mut self,
        record: impl Fn(u32, u32) -> SampleRecord,
        visible: impl Fn(u32, u32) -> VisibilityRecord,
    ) -> Vec<[f32; 4]> {
        let context = self.reconstruction.context.clone();
        let View { width, height, .. } = self.view;
        let image = Image::new(&context, Format::R32G32B32A32_SFLOAT, width, height).unwrap();
        self.render_to(&[Output::whole(image.target(), 5.0)], record, visible);
        bytemuck::pod_collect_to_vec(&image.read().unwrap())
    }

    fn render_to(
        &mut self,
        outputs: &[Output<'_>],
        record: impl Fn(u32, u32) -> SampleRecord,
        visible: impl Fn(u32, u32) -> VisibilityRecord,
    ) {
        let context = self.reconstruction.context.clone();
        let View { width, height, .. } = self.view;
        let records: Vec<_> = self.samples.iter().map(|s| record(s & 0xffff, s >> 16)).collect();
        let pixels: Vec<_> = (0..width * height).map(|p| visible(p % width, p / width)).collect();
        let memory = if self.far { HostBuffer::far } else { HostBuffer::new };
        let samples = memory(&context, size_of_val(&records[..])).unwrap();
        samples.write(0, &records);
        let visibility = memory(&context, size_of_val(&pixels[..])).unwrap();
        visibility.write(0, &pixels);
        let frame = Frame {
            view: &self.view,
            samples: (&samples).into(),
            visibility: Some((&visibility).into()),
            sun: None,
            least_expected: 0.01,
            light_holds: f32::INFINITY,
            light_changes: false,
            estimates: 1.0,
            rests: false,
            movers: Default::default(),
            overlay: Default::default(),
            shown_from: None,
            jitter: DVec2::ZERO,
            exposure: 0.0,
            other: None,
            outputs,
        };
        self.reconstruction.submit(0, &frame).unwrap();
        let stages: Vec<_> = self.reconstruction.wait(0).unwrap().iter().map(|time| time.stage).collect();
        assert!(stages.starts_with(&["filter"]), "{stages:?}");
    }
}

/// What lies in memory that the device reads slowly is copied to its own first, and the pictures are the same.
#[test]
fn pictures_do_not_depend_on_whose_memory_holds_what_was_traced() {
    let Some(context) = testing::context() else { return };
    for mode in [Mode::default(), Mode::KNearest] {
        let mut bench = Bench::new(&context, mode, (40, 30), scattered(200, 40, 30));
        let facing = normal(&bench.view, TOWARD);
        let mut render = |far, shift: u32| {
            bench.far = far;
            bench.render(
                |x, y| SampleRecord {
                    normal: facing,
                    depth: 3.0,
                    ..radiance([x as f32 + 1.0, y as f32 + 1.0, 2.0])
                },
                |x, y| seen(facing, 3.0, [((x + shift) % 7) as f32 / 7.0, (y % 5) as f32 / 5.0, 0.5], 0.0),
            )
        };
        // The second pair is copied to where the first one was.
        for shift in [0, 3] {
            let (near, far) = (render(false, shift), render(true, shift));
            assert!(near.iter().any(|pixel| pixel[0] > 0.0));
            assert_eq!(near, far, "{mode:?}");
        }
        if mode == Mode::default() {
            assert_ne!(render(true, 0), render(true, 3));
        }
    }
    testing::assert_valid(&context);
}

fn assert_close(found: [f32; 4], expected: [f32; 3], tolerance: f32, place: impl std::fmt::Debug) {
    for channel in 0..3 {
        let error = (found[channel] - expected[channel]).abs();
        let limit = tolerance * expected[channel].abs().max(1e-3);
        assert!(error <= limit, "{place:?}: {found:?} is not {expected:?}");
    }
}

fn radiance(first: [f32; 3]) -> SampleRecord {
    SampleRecord { first, ..SampleRecord::default() }
}

fn nothing(_: u32, _: u32) -> VisibilityRecord {
    VisibilityRecord::default()
}

/// A surface without a normal map that emits nothing.
fn seen(normal: u32, depth: f32, base: [f32; 3], metalness: f32) -> VisibilityRecord {
    let [base, surface] = pack_surface(base, metalness, 0.0);
    VisibilityRecord { normal, depth, base, surface, mapped: normal, emission: 0, reflected: 0 }
}

#[test]
fn a_constant_stays_constant() {
    let Some(context) = testing::context() else { return };
    for (size, count) in [((67, 45), 150), ((16, 16), 7), ((1, 1), 1), ((40, 3), 1)] {
        let samples = scattered(count, size.0, size.1);
        let mut bench = Bench::new(&context, Mode::KNearest, size, samples.clone());
        for pixel in bench.render(|_, _| radiance([0.25, 3.0, 700.0]), nothing) {
            assert_close(pixel, [0.25, 3.0, 700.0], 1e-5, size);
        }
        let mut bench = Bench::new(&context, Mode::default(), size, samples);
        let facing = normal(&bench.view, TOWARD);
        // Every other pixel is metal, with no F0 in blue.
        let metal = |x: u32| x % 2;
        let colour = |x: u32| [1.0, 0.1 + 0.1 * (x % 7) as f32, 0.3 * (1 - metal(x)) as f32];
        let picture = bench.render(
            |_, _| SampleRecord {
                first: [2.0, 3.0, 4.0],
                depth: 5.0,
                second: [0.5; 3],
                normal: facing,
                ..SampleRecord::default()
            },
            |x, _| seen(facing, 5.0, colour(x), metal(x) as f32),
        );
        for (index, pixel) in picture.iter().enumerate() {
            let (a, m) = (colour(index as u32 % size.0), metal(index as u32 % size.0) as f32);
            let f0 = a.map(|a| (0.04 * (1.0 - m) + a * m).max(1e-3));
            let expected = [0, 1, 2].map(|c| (2.0 + c as f32) * (1.0 - m) * a[c] + 0.5 * f0[c]);
            // Half a step of a root of 12 bits, for a base of a tenth.
            assert_close(*pixel, expected, 8e-4, index);
        }
    }
    testing::assert_valid(&context);
}

#[test]
fn nearest_samples_are_averaged_by_their_weights() {
    let Some(context) = testing::context() else { return };
    // Two samples: all of each at its own pixel, half of each in the middle.
    let mut bench = Bench::new(&context, Mode::KNearest, (9, 1), vec![0, 8]);
    let picture = bench.render(|x, _| radiance([x as f32; 3]), nothing);
    assert_close(picture[0], [0.0; 3], 1e-6, 0);
    assert_close(picture[4], [4.0; 3], 1e-6, 4);
    assert_close(picture[8], [8.0; 3], 1e-6, 8);
    // At pixel 2: d = 2 and 6, R = 12; weights (10/24)^2 and (6/72)^2.
    let (near, far) = ((10.0f32 / 24.0).powi(2), (6.0f32 / 72.0).powi(2));
    assert_close(picture[2], [8.0 * far / (near + far); 3], 1e-5, 2);
    testing::assert_valid(&context);
}

#[test]
fn what_is_not_finite_does_not_spread() {
    let Some(context) = testing::context() else { return };
    let size = (40, 30);
    let samples = scattered(120, size.0, size.1);
    let bad = |x: u32, y: u32| (x * 7 + y * 3).is_multiple_of(5);
    let count = samples.iter().filter(|&&s| bad(s & 0xffff, s >> 16)).count() as u32;
    assert!(count > 5);
    for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut bench = Bench::new(&context, Mode::KNearest, size, samples.clone());
        let value = |x, y| if bad(x, y) { [1.0, wrong, 1.0] } else { [2.0; 3] };
        let picture = bench.render(|x, y| radiance(value(x, y)), nothing);
        assert_eq!(bench.reconstruction.dropped(0), count);
        let off = |pixel: &&[f32; 4]| (pixel[0] - 2.0).abs() > 1e-4 && **pixel != [0.0, 0.0, 0.0, 1.0];
        assert_eq!(picture.iter().find(off), None);

        let mut bench = Bench::new(&context, Mode::default(), size, samples.clone());
        let facing = normal(&bench.view, TOWARD);
        let good = SampleRecord {
            first: [2.0; 3],
            depth: 4.0,
            second: [1.0; 3],
            normal: facing,
            ..SampleRecord::default()
        };
        for part in 0..3 {
            let record = |x, y| {
                let mut record = good;
                if bad(x, y) {
                    match part {
                        0 => record.first[2] = wrong,
                        1 => record.second[0] = wrong,
                        _ => record.depth = wrong,
                    }
                }
                record
            };
            let picture = bench.render(record, |_, _| seen(facing, 4.0, [1.0; 3], 0.0));
            assert_eq!(bench.reconstruction.dropped(0), count);
            for (index, pixel) in picture.iter().enumerate() {
                assert_close(*pixel, [2.0 + 0.04; 3], 1e-4, (index, part, wrong));
            }
        }
    }
    testing::assert_valid(&context);
}

#[test]
fn outputs_are_cut_from_the_view() {
    let Some(context) = testing::context() else { return };
    let samples: Vec<u32> = (0..20 * 8u32).map(|i| (i % 20) | (i / 20) << 16).collect();
    let mut bench = Bench::new(&context, Mode::KNearest, (20, 8), samples);
    let image = Image::new(&context, Format::R32G32B32A32_SFLOAT, 24, 10).unwrap();
    let part = |x, source_x| Output {
        target: image.target(),
        rect: Rect { x, y: 1, width: 12, height: 6 },
        source: [source_x, 2],
        encoding: Encoding::Radiance,
        exposure: 0.0,
        motion: None,
    };
    bench.render_to(&[part(0, 0), part(12, 8)], |x, y| radiance([x as f32, y as f32, 1.0]), nothing);
    let picture: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&image.read().unwrap());
    for y in 0..10usize {
        for x in 0..24usize {
            let source = if x < 12 { x } else { x - 12 + 8 };
            let inside = (1..7).contains(&y);
            let expected = if inside { [source as f32, (y + 1) as f32, 1.0, 1.0] } else { [0.0; 4] };
            assert_eq!(picture[y * 24 + x], expected, "({x}, {y})");
        }
    }
    testing::assert_valid(&context);
}

/// Khronos PBR Neutral and sRGB in f64.
fn display(rgb: [f64; 3], encode: bool) -> [f64; 3] {
    let low = rgb[0].min(rgb[1]).min(rgb[2]);
    let offset = if low < 0.08 { low - 6.25 * low * low } else { 0.04 };
    let mut c = rgb.map(|v| v - offset);
    let peak = c[0].max(c[1]).max(c[2]);
    if peak >= 0.76 {
        let new = 1.0 - 0.24 * 0.24 / (peak + 0.24 - 0.76);
        let grey = 1.0 - 1.0 / (0.15 * (peak - new) + 1.0);
        c = c.map(|v| v * new / peak * (1.0 - grey) + new * grey);
    }
    let srgb = |v: f64| if v <= 0.0031308 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    if encode { c.map(srgb) } else { c }
}

#[test]
fn displays_get_tone_mapped_pixels() {
    let Some(context) = testing::context() else { return };
    let samples: Vec<u32> = (0..64).collect();
    let mut bench = Bench::new(&context, Mode::KNearest, (64, 1), samples);
    let colour = |x: u32| [1e-3 * 1.3f32.powi(x as i32), 0.02 * x as f32, 0.5];
    for format in [Format::R8G8B8A8_UNORM, Format::R8G8B8A8_SRGB] {
        let image = Image::new(&context, format, 64, 1).unwrap();
        bench.render_to(&[Output::whole(image.target(), 1.0)], |x, _| radiance(colour(x)), nothing);
        for (x, pixel) in image.read().unwrap().chunks(4).enumerate() {
            let expected = display(colour(x as u32).map(|v| 2.0 * f64::from(v)), true);
            for channel in 0..3 {
                let code = expected[channel] * 255.0;
                let found = f64::from(pixel[channel]);
                assert!((found - code).abs() <= 0.75, "{format:?} {x}: {pixel:?} {code}");
            }
        }
    }
    let image = Image::new(&context, Format::R16G16B16A16_SFLOAT, 64, 1).unwrap();
    let mut output = Output::whole(image.target(), 1.0);
    assert_eq!(output.encoding, Encoding::Radiance);
    output.encoding = Encoding::DisplayLinear;
    bench.render_to(&[output], |x, _| radiance(colour(x)), nothing);
    // 1.0 in half precision is 0x3c00; the brightest red is nearly white.
    let halves: Vec<u16> = bytemuck::pod_collect_to_vec(&image.read().unwrap());
    assert!(halves[63 * 4] > 0x3b00 && halves[63 * 4] <= 0x3c00, "{:x}", halves[63 * 4]);
    testing::assert_valid(&context);
}

#[test]
fn a_new_pattern_replaces_the_old_one() {
    let Some(context) = testing::context() else { return };
    let mut bench = Bench::new(&context, Mode::KNearest, (20, 20), scattered(50, 20, 20));
    bench.render(|_, _| radiance([1.0; 3]), nothing);
    for (size, samples) in
        [((20, 20), scattered(80, 20, 20)), ((31, 9), vec![5]), ((20, 20), (0..20).collect())]
    {
        bench.reconstruction.set_pattern(0, size.0, size.1, &samples).unwrap();
        (bench.view, bench.samples) = (view(size.0, size.1), samples);
        let picture = bench.render(|_, _| radiance([4.0; 3]), nothing);
        assert!(picture.iter().all(|pixel| (pixel[0] - 4.0).abs() < 1e-4));
    }
    testing::assert_valid(&context);
}

#[test]
fn guided_reconstruction_asks_for_visibility() {
    let Some(context) = testing::context() else { return };
    let mut bench = Bench::new(&context, Mode::default(), (8, 8), vec![0]);
    let samples = HostBuffer::new(&context, size_of::<SampleRecord>()).unwrap();
    let image = Image::new(&context, Format::R8G8B8A8_UNORM, 8, 8).unwrap();
    let outputs = [Output::whole(image.target(), 0.0)];
    let frame = Frame {
        view: &bench.view,
        samples: (&samples).into(),
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
        exposure: 0.0,
        other: None,
        outputs: &outputs,
    };
    let error = bench.reconstruction.submit(0, &frame).unwrap_err();
    assert!(error.to_string().contains("visibility"), "{error}");
    testing::assert_valid(&context);
}

#[test]
fn a_wide_view_is_drawn_in_bands_without_seams() {
    let Some(context) = testing::context() else { return };
    let (width, height) = (8192, (context.storage_range() / (8192 * 16)).min(2048) as u32 + 24);
    let samples = vec![0, (width - 1) | ((height - 1) << 16)];
    let mut bench = Bench::new(&context, Mode::KNearest, (width, height), samples);
    let image = Image::new(&context, Format::R8G8B8A8_UNORM, width, height).unwrap();
    let mut output = Output::whole(image.target(), 0.0);
    output.encoding = Encoding::Radiance;
    bench.render_to(&[output], |x, _| radiance([(x > 0) as u32 as f32; 3]), nothing);
    let picture = image.read().unwrap();
    let red = |x: u32, y: u32| picture[((y * width + x) * 4) as usize];
    assert_eq!((red(0, 0), red(width - 1, height - 1)), (0, 255));
    for y in 1..height {
        for x in (0..width).step_by(61) {
            assert!(red(x, y).abs_diff(red(x, y - 1)) <= 1, "({x}, {y}): {} {}", red(x, y), red(x, y - 1));
        }
    }
    testing::assert_valid(&context);
}
