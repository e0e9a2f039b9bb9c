//! The pass against its twin in `f64`, over pictures of an eye that walks and turns before things that move.

use glam::{DQuat, DVec2};

use super::*;
use crate::gpu::vulkan::{Encoding, Format, Image, testing};
use crate::layout::{SURFACE_MOVER, SURFACE_MOVES, VisibilityRecord};
use crate::math::spacing::{Axis, Spacing};
use crate::math::view::FieldOfView;
use crate::reconstruct::{Mode, Reconstruction};
use crate::reference::guided::{Choices, Guided};
use crate::reference::motion;
use crate::reference::reconstruct::WeightKind;

const SIZE: (u32, u32) = (60, 40);
/// Of the parts of the picture that two outputs show, first pixel and size.
const PARTS: [([u32; 2], [u32; 2]); 2] = [([2, 3], [40, 30]), ([15, 1], [44, 36])];
/// How many pixels a motion image has for each of them: fewer than the picture.
const IMAGES: [(u32, u32); 2] = [(20, 15), (33, 12)];

/// How a sequence of pictures is made.
#[derive(Clone, Copy, Debug)]
struct Manner {
    uneven: bool,
    corrected: bool,
}

fn view(frame: u32, manner: Manner) -> View {
    let time = f64::from(frame);
    let axis = |picture, gaze, origin| Axis { picture, gaze, origin, radius: 6.0, growth: 0.012 };
    let spacing = Spacing { columns: axis(90.0, 40.0 + time, 25.0), rows: axis(60.0, 28.0, 19.0) };
    let rotation = DQuat::from_euler(glam::EulerRot::YXZ, 0.3 + 0.03 * time, -0.02 * time, 0.01 * time);
    View {
        world_from_eye: Pose::new(rotation, DVec3::new(20.0 + 0.05 * time, 1.6, 3.0 - 0.08 * time)),
        fov: FieldOfView { left: -1.1, right: 0.9, up: 0.7, down: -0.6 },
        width: SIZE.0,
        height: SIZE.1,
        spacing: if manner.uneven { spacing } else { Spacing::EVEN },
    }
}

fn shown_from(frame: u32, manner: Manner) -> Option<Pose> {
    let traced = view(frame, manner).world_from_eye;
    let turn = DQuat::from_rotation_y(0.02) * DQuat::from_rotation_x(-0.01);
    let moved = Pose::new(turn * traced.rotation, traced.position + DVec3::new(0.02, -0.01, 0.03));
    manner.corrected.then_some(moved)
}

/// From where a picture is shown.
fn shown_at(frame: u32, manner: Manner) -> Pose {
    shown_from(frame, manner).unwrap_or(view(frame, manner).world_from_eye)
}

/// A thing that slides, one that turns, and one that has just appeared.
fn movers(frame: u32) -> Arc<[Option<DMat4>]> {
    let time = f64::from(frame);
    let turned = DMat4::from_rotation_translation(DQuat::from_rotation_z(0.1 * time), DVec3::X);
    let slid = DMat4::from_translation(DVec3::new(0.1 * time, 0.0, -0.05 * time));
    [Some(slid), Some(turned), (frame == 2).then_some(slid)].into()
}

/// Sky above, and below blocks of things at several depths: of each kind of motion, of none, and of one that nobody knows.
fn records() -> Vec<VisibilityRecord> {
    let record = |pixel: u32| {
        let (x, y) = (pixel % SIZE.0, pixel / SIZE.0);
        let block = x / 6 + y / 6;
        let depth = if y < 6 { 0.0 } else { 1.0 + 0.7 * (block % 5) as f32 };
        let mapped = if block % 5 == 0 { 0 } else { SURFACE_MOVES | (block % 5) << SURFACE_MOVER };
        VisibilityRecord { depth, mapped, ..VisibilityRecord::default() }
    };
    (0..SIZE.0 * SIZE.1).map(record).collect()
}

/// The traced pixel that a pixel of the picture shows.
fn traced_pixel(guided: &Guided<'_>, shown_from: Option<Pose>, [x, y]: [u32; 2]) -> [u32; 2] {
    let last = DVec2::new(f64::from(SIZE.0), f64::from(SIZE.1)) - 1.0;
    match shown_from {
        Some(pose) => guided.warped(pose, [x, y], 3),
        None => {
            let at = guided.view.pixel_at(DVec2::new(f64::from(x), f64::from(y)) + 0.5);
            (at - 0.5).clamp(DVec2::ZERO, last).round().as_uvec2().to_array()
        }
    }
}

/// As the twin has it, for the pixel in the middle of one of a motion image.
fn expected(frames: [u32; 2], manner: Manner, part: usize, [x, y]: [u32; 2]) -> DVec3 {
    let (traced, visibility) = (view(frames[1], manner), records());
    let choices = Choices {
        neighbours: 1,
        normal_power: 1.0,
        plane_tolerance: 1.0,
        deviations: [1.0; 2],
        k: 1,
        weights: WeightKind::Gaussian,
        least_expected: 1.0,
    };
    let guided = Guided { view: &traced, positions: &[], visibility: &visibility, sun: None, choices };
    let (source, size) = PARTS[part];
    let across = (f64::from(x) + 0.5) * f64::from(size[0]) / f64::from(IMAGES[part].0);
    let down = (f64::from(y) + 0.5) * f64::from(size[1]) / f64::from(IMAGES[part].1);
    let pixel = [source[0] + across as u32, source[1] + down as u32];
    let pixel = traced_pixel(&guided, shown_from(frames[1], manner), pixel);
    let record = visibility[(pixel[1] * SIZE.0 + pixel[0]) as usize];
    let number = (record.mapped >> SURFACE_MOVER) as usize;
    let place = |frame| number.checked_sub(1).and_then(|index| *movers(frame).get(index)?);
    let moved = place(frames[0]).zip(place(frames[1])).map(|(was, is)| was * is.inverse());
    let shown = |frame| motion::Shown {
        view: View { world_from_eye: shown_at(frame, manner), ..view(frame, manner) },
        source: DVec2::new(f64::from(source[0]), f64::from(source[1])),
        size: DVec2::new(f64::from(size[0]), f64::from(size[1])),
    };
    motion::vector(
        &traced,
        DVec2::new(f64::from(pixel[0]), f64::from(pixel[1])) + 0.5,
        record.depth.into(),
        moved.unwrap_or_default(),
        [&shown(frames[0]), &shown(frames[1])],
        NEAREST_DEPTH.into(),
    )
}

/// The motion images of a picture's outputs, black where it has none; Y goes up in them or down.
fn submit(
    reconstruction: &mut Reconstruction,
    frame: u32,
    manner: Manner,
    y_up: Option<bool>,
) -> Vec<Vec<[f32; 4]>> {
    let context = reconstruction.context.clone();
    let (view, visibility) = (view(frame, manner), records());
    let samples = HostBuffer::new(&context, size_of::<crate::layout::SampleRecord>()).unwrap();
    samples.write(0, &[crate::layout::SampleRecord::default()]);
    let records = HostBuffer::new(&context, size_of_val(&visibility[..])).unwrap();
    records.write(0, &visibility);
    let picture = Image::new(&context, Format::R8G8B8A8_UNORM, 128, 64).unwrap();
    let images = IMAGES
        .map(|(width, height)| Image::new(&context, Format::R32G32B32A32_SFLOAT, width, height).unwrap());
    let motions =
        [0, 1].map(|index| MotionImage { target: images[index].target().clone(), y_up: y_up == Some(true) });
    let output = |index: usize| Output {
        target: picture.target(),
        rect: Rect { x: 50 * index as u32, y: 0, width: PARTS[index].1[0], height: PARTS[index].1[1] },
        source: PARTS[index].0,
        encoding: Encoding::DisplaySrgb,
        exposure: 0.0,
        motion: y_up.map(|_| &motions[index]),
    };
    let shown = Frame {
        view: &view,
        samples: (&samples).into(),
        visibility: Some((&records).into()),
        sun: None,
        least_expected: 0.01,
        light_holds: f32::INFINITY,
        light_changes: false,
        estimates: 1.0,
        rests: false,
        movers: movers(frame),
        overlay: Default::default(),
        shown_from: shown_from(frame, manner),
        other: None,
        jitter: DVec2::ZERO,
        exposure: 0.0,
        outputs: &[output(0), output(1)],
    };
    reconstruction.submit(0, &shown).unwrap();
    reconstruction.wait(0).unwrap();
    images.iter().map(|image| bytemuck::pod_collect_to_vec(&image.read().unwrap())).collect()
}

fn reconstruction(context: &Context, mode: Mode) -> Reconstruction {
    let settings = Settings { mode, ..Settings::default() };
    let mut reconstruction = Reconstruction::new(context, settings).unwrap();
    reconstruction.set_pattern(0, SIZE.0, SIZE.1, &[5]).unwrap();
    reconstruction
}

/// Compares a picture's vectors with the twin's: the share of pixels whose are alike.
fn share_alike(found: &[Vec<[f32; 4]>], frames: [u32; 2], manner: Manner, y: f64) -> f64 {
    let (mut alike, mut all) = (0, 0);
    for (part, image) in found.iter().enumerate() {
        for (index, vector) in image.iter().enumerate() {
            let at = [index as u32 % IMAGES[part].0, index as u32 / IMAGES[part].0];
            let found = DVec3::new(f64::from(vector[0]), y * f64::from(vector[1]), f64::from(vector[2]));
            let expected = expected(frames, manner, part, at);
            alike += usize::from((found - expected).length() < 2e-5 * (1.0 + expected.length()));
            all += 1;
        }
    }
    alike as f64 / all as f64
}

#[test]
fn vectors_are_those_of_the_twin() {
    let Some(context) = testing::context() else { return };
    for (uneven, corrected) in [(false, false), (false, true), (true, false), (true, true)] {
        let manner = Manner { uneven, corrected };
        let mut reconstruction = reconstruction(&context, Mode::default());
        let first = submit(&mut reconstruction, 0, manner, Some(false));
        assert!(share_alike(&first, [0, 0], manner, 1.0) > 0.99, "{manner:?}");
        for frame in 1..4 {
            let up = frame == 2;
            let found = submit(&mut reconstruction, frame, manner, Some(up));
            let y = if up { -1.0 } else { 1.0 };
            // Which pixel is seen is a matter of rounding where two meet.
            let share = share_alike(&found, [frame - 1, frame], manner, y);
            assert!(share > if corrected || uneven { 0.97 } else { 0.999 }, "{manner:?} {frame}: {share}");
            assert!(share_alike(&found, [frame - 1, frame], manner, -y) < 0.1, "{manner:?}: upside down");
            assert!(share_alike(&found, [frame, frame], manner, y) < 0.1, "{manner:?}: no motion");
        }
    }
    testing::assert_valid(&context);
}

#[test]
fn pictures_without_vectors_are_not_remembered() {
    let Some(context) = testing::context() else { return };
    let manner = Manner { uneven: false, corrected: false };
    let mut reconstruction = reconstruction(&context, Mode::default());
    let is_still = |vector: &[f32; 4]| vector.iter().all(|part| part.abs() < 1e-4);
    for (between, still) in [(Some(false), false), (None, true)] {
        submit(&mut reconstruction, 0, manner, Some(false));
        submit(&mut reconstruction, 1, manner, between);
        let found = submit(&mut reconstruction, 2, manner, Some(false));
        assert_eq!(found.iter().flatten().all(is_still), still, "{between:?}");
    }
    testing::assert_valid(&context);
}

#[test]
fn where_nothing_tells_what_is_seen_images_stay_as_they_are() {
    let Some(context) = testing::context() else { return };
    let manner = Manner { uneven: false, corrected: false };
    let mut reconstruction = reconstruction(&context, Mode::KNearest);
    for frame in 0..2 {
        submit(&mut reconstruction, frame, manner, Some(false));
        assert!(reconstruction.views[0].last_picture.uniform.is_none());
    }
    testing::assert_valid(&context);
}
