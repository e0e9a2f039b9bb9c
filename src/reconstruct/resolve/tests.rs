//! The pass against its twin in `f64`, and what means do: an eye at rest and one that walks, before things that move.

use glam::{DQuat, DVec3};

use super::*;
use crate::gpu::vulkan::{Format, Image, testing};
use crate::layout::{SURFACE_MOVER, SURFACE_MOVES, SampleRecord, VisibilityRecord};
use crate::math::pose::Pose;
use crate::math::spacing::{Axis, Spacing};
use crate::math::view::FieldOfView;
use crate::reconstruct::{Mode, Output, Reconstruction, Reuse, Settings};
use crate::reference::resolve::{Mean, Picture};

const SIZE: (u32, u32) = (60, 40);
const LONGEST: u32 = 12;
/// The frame in which the gaze jumps.
const JUMP: u32 = 20;
const REUSE: Reuse = Reuse { frames: 8, eyes: false, pictures: LONGEST };

/// Where the eye is and looks in a frame; its gaze moves where it does, and it rests in some frames.
fn view(frame: u32, walks: bool) -> View {
    let time = if walks { 0.1 * f64::from(frame) } else { 0.0 };
    let axis = |picture, gaze, origin| Axis { picture, gaze, origin, radius: 6.0, growth: 0.012 };
    let spacing = Spacing { columns: axis(90.0, gaze(frame, walks), 25.0), rows: axis(60.0, 28.0, 19.0) };
    let rotation = DQuat::from_euler(glam::EulerRot::YXZ, 0.02 * time, 0.01 * time, 0.005 * time);
    View {
        world_from_eye: Pose::new(rotation, DVec3::new(0.03 * time, 1.6, -0.05 * time)),
        fov: FieldOfView { left: -1.1, right: 0.9, up: 0.7, down: -0.6 },
        width: SIZE.0,
        height: SIZE.1,
        spacing,
    }
}

/// The column that is looked at: it follows something, and jumps at last.
fn gaze(frame: u32, walks: bool) -> f64 {
    let follows = f64::from(frame / 4 * u32::from(walks));
    if walks && frame >= JUMP { 75.0 } else { 40.0 + follows }
}

fn movers(frame: u32) -> Arc<[Option<DMat4>]> {
    let time = f64::from(frame);
    let slid = DMat4::from_translation(DVec3::new(0.02 * time, 0.0, 0.0));
    [Some(slid), (frame == 2).then_some(slid)].into()
}

fn moved(mapped: u32, frame: u32) -> DMat4 {
    let number = (mapped >> SURFACE_MOVER) as usize;
    let place = |frame| number.checked_sub(1).and_then(|index| *movers(frame).get(index)?);
    let moves = mapped & SURFACE_MOVES != 0;
    place(frame - 1)
        .zip(place(frame))
        .filter(|_| moves)
        .map_or(DMat4::IDENTITY, |(was, is)| was * is.inverse())
}

/// Blocks that glow differently at several depths, some of which move, under a sky.
fn records(frame: u32, noise: bool) -> Vec<VisibilityRecord> {
    let hash = |i: u32| (i.wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995).wrapping_mul(0x85eb_ca6b) >> 8;
    let record = |pixel: u32| {
        let (x, y) = (pixel % SIZE.0, pixel / SIZE.0);
        let block = x / 5 + y / 5;
        let depth = if y < 5 { 0.0 } else { 1.0 + 0.7 * (block % 5) as f32 };
        let mapped = if block % 3 == 0 { 0 } else { SURFACE_MOVES | (block % 3) << SURFACE_MOVER };
        let chance = hash(frame * 10_000 + pixel) as f32 / (1 << 24) as f32;
        let glow = 0.2 + (block % 4) as f32 + if noise { chance } else { 0.0 };
        let emission = crate::layout::pack_emission([glow, 0.5 * glow, 0.1 + 0.3 * glow]);
        VisibilityRecord { depth, mapped, emission, ..VisibilityRecord::default() }
    };
    (0..SIZE.0 * SIZE.1).map(record).collect()
}

/// What a frame shows of its view's own pixels, and what it adds them to.
struct Shown {
    traced: View,
    view: View,
    jitter: DVec2,
    shaded: Vec<DVec3>,
    means: Vec<DVec3>,
    counts: Vec<f32>,
}

fn unpacked(context: &Context, buffer: &BufferRef) -> Vec<DVec3> {
    let packed: Vec<[u32; 2]> = testing::fetch(context, buffer, (SIZE.0 * SIZE.1) as usize);
    let unpack = |[low, high]: [u32; 2]| {
        let scale = f64::from(high >> 24).exp2() / 127f64.exp2();
        let codes = [low & 0x7_ffff, low >> 19 | (high & 63) << 13, high >> 6 & 0x3_ffff];
        DVec3::from(codes.map(f64::from)) / DVec3::new(262_144.0, 262_144.0, 131_072.0) * scale
    };
    packed.into_iter().map(unpack).collect()
}

fn submit(
    reconstruction: &mut Reconstruction,
    frame: u32,
    walks: bool,
    visibility: &[VisibilityRecord],
) -> Shown {
    submit_with(reconstruction, frame, walks, |_| visibility.to_vec())
}

/// The same where what is seen depends on where within its pixels the view looks.
fn submit_with(
    reconstruction: &mut Reconstruction,
    frame: u32,
    walks: bool,
    seen: impl Fn(&View) -> Vec<VisibilityRecord>,
) -> Shown {
    let context = reconstruction.context.clone();
    let view = view(frame, walks);
    let jitter = reconstruction.jitter(0, &view);
    let traced = View { spacing: view.spacing.shifted(jitter), ..view };
    let visibility = &seen(&traced)[..];
    let samples = HostBuffer::new(&context, size_of::<SampleRecord>()).unwrap();
    samples.write(0, &[SampleRecord::default()]);
    let records = HostBuffer::new(&context, size_of_val(visibility)).unwrap();
    records.write(0, visibility);
    let picture = Image::new(&context, Format::R32G32B32A32_SFLOAT, 90, 60).unwrap();
    let shown = Frame {
        view: &traced,
        jitter,
        samples: (&samples).into(),
        visibility: Some((&records).into()),
        sun: None,
        least_expected: 0.01,
        light_holds: f32::INFINITY,
        light_changes: walks,
        estimates: 1.0,
        rests: false,
        movers: movers(frame),
        overlay: Default::default(),
        shown_from: None,
        other: None,
        exposure: 0.0,
        outputs: &[Output::whole(picture.target(), 0.0)],
    };
    reconstruction.submit(0, &shown).unwrap();
    let stages: Vec<_> = reconstruction.wait(0).unwrap().iter().map(|time| time.stage).collect();
    assert!(stages.contains(&"resolve"), "{stages:?}");
    let state = &reconstruction.views[0];
    let kept = state.means.last.as_ref().unwrap();
    let count = (SIZE.0 * SIZE.1) as usize;
    Shown {
        traced,
        view,
        jitter,
        shaded: unpacked(&context, state.shaded.as_ref().unwrap()),
        means: unpacked(&context, &kept.buffers.means),
        counts: testing::fetch::<f32>(&context, &kept.buffers.counts, count)
            .into_iter()
            .map(|held| held.max(1.0))
            .collect(),
    }
}

fn reconstruction(context: &Context, reuse: Reuse) -> Reconstruction {
    let settings = Settings { mode: Mode::default(), reuse: Some(reuse), ..Settings::default() };
    let mut reconstruction = Reconstruction::new(context, settings).unwrap();
    reconstruction.set_pattern(0, SIZE.0, SIZE.1, &[5]).unwrap();
    reconstruction
}

#[test]
fn means_are_those_of_the_twin() {
    let Some(context) = testing::context() else { return };
    for walks in [false, true] {
        let mut reconstruction = reconstruction(&context, REUSE);
        let mut last: Option<Mean> = None;
        let (mut compared, mut old) = (0, 0);
        for frame in 0..6 {
            let visibility = records(frame, true);
            let shown = submit(&mut reconstruction, frame, walks, &visibility);
            let moved = |mapped| moved(mapped, frame);
            let picture = Picture {
                traced: &shown.traced,
                view: &shown.view,
                jitter: shown.jitter,
                radiance: &shown.shaded,
                visibility: &visibility,
                is_still: !walks,
                moved: &moved,
                longest: LONGEST.into(),
            };
            let expected = picture.resolve(last.as_ref());
            for (index, mean) in shown.means.iter().enumerate() {
                let off = (*mean - expected.radiance[index]).length();
                // What is nearest, or still in the picture, is a matter of rounding where two are alike.
                let alike = off < 1e-3 * (1.0 + mean.length())
                    && (f64::from(shown.counts[index]) - expected.counts[index]).abs() < 1e-3;
                compared += usize::from(alike);
                old += usize::from(shown.counts[index] > 3.0);
            }
            // What is compared is one frame: the next begins with what the device has.
            let counts = shown.counts.iter().map(|count| f64::from(*count)).collect();
            last = Some(Mean { view: shown.view, radiance: shown.means, counts });
        }
        let all = 6 * (SIZE.0 * SIZE.1) as usize;
        assert!(compared as f64 > 0.995 * all as f64, "{walks}: {compared} of {all}");
        assert!(old as f64 > 0.3 * all as f64, "{walks}: {old} of {all}");
    }
    testing::assert_valid(&context);
}

#[test]
fn at_rest_pixels_are_means_of_all_that_they_have_shown() {
    let Some(context) = testing::context() else { return };
    let mut reconstruction = reconstruction(&context, REUSE);
    let mut sums = vec![DVec3::ZERO; (SIZE.0 * SIZE.1) as usize];
    let mut jitters = Vec::new();
    for frame in 0..LONGEST {
        let shown = submit(&mut reconstruction, frame, false, &records(frame, true));
        jitters.push(shown.jitter);
        sums.iter_mut().zip(&shown.shaded).for_each(|(sum, value)| *sum += *value);
        for (mean, sum) in shown.means.iter().zip(&sums) {
            let expected = *sum / f64::from(frame + 1);
            assert!((*mean - expected).length() < 1e-3 * (1.0 + expected.length()), "{frame}");
        }
    }
    // They look all over their pixels, which the first one sees in the middle.
    assert_eq!(jitters[0], DVec2::ZERO);
    assert!(jitters.iter().all(|jitter| jitter.abs().max_element() <= 0.5));
    let mean = jitters.iter().sum::<DVec2>() / f64::from(LONGEST);
    let spread = jitters.iter().map(|jitter| jitter.length_squared()).sum::<f64>() / f64::from(LONGEST);
    assert!(mean.length() < 0.1 && (0.1..0.2).contains(&spread), "{mean} {spread}");
    testing::assert_valid(&context);
}

#[test]
fn what_is_no_longer_there_is_gone_at_once_in_motion_and_after_a_cut() {
    let Some(context) = testing::context() else { return };
    let dark =
        vec![VisibilityRecord { depth: 2.0, ..VisibilityRecord::default() }; (SIZE.0 * SIZE.1) as usize];
    for (walks, cut, gone) in [(true, false, true), (false, true, true), (false, false, false)] {
        let mut reconstruction = reconstruction(&context, REUSE);
        for frame in 0..3 {
            submit(&mut reconstruction, frame, walks, &records(frame, false));
        }
        if cut {
            reconstruction.forget();
        }
        let shown = submit(&mut reconstruction, 3, walks, &dark);
        let left = shown.means.iter().map(|mean| mean.max_element()).fold(0.0, f64::max);
        assert_eq!(left < 1e-6, gone, "{walks} {cut}: {left}");
    }
    testing::assert_valid(&context);
}

/// What the middle of a pixel sees of a wall that glows in waves of some pixels.
fn glow(view: &View, pixel: u32) -> (f64, f64) {
    let centre = DVec2::new(f64::from(pixel % SIZE.0), f64::from(pixel / SIZE.0)) + 0.5;
    let seen = view.world_from_eye.rotation * view.eye_direction(centre);
    let depth = (-5.0 - view.world_from_eye.position.z) / seen.z;
    let point = view.world_from_eye.position + seen * depth;
    (depth, 2.0 + (4.0 * point.x).sin() + (4.0 * point.y).sin())
}

#[test]
fn means_stay_on_the_surface_that_they_are_of_as_the_eye_walks_past() {
    let Some(context) = testing::context() else { return };
    let mut reconstruction = reconstruction(&context, REUSE);
    let wall = |traced: &View| {
        let record = |pixel: u32| {
            let (depth, glow) = glow(traced, pixel);
            let emission = crate::layout::pack_emission([glow as f32; 3]);
            VisibilityRecord { depth: depth as f32, emission, ..VisibilityRecord::default() }
        };
        (0..SIZE.0 * SIZE.1).map(record).collect()
    };
    let (mut errors, mut held) = ([0.0; 3], 0);
    for frame in 0..16 {
        let shown = submit_with(&mut reconstruction, frame, true, wall);
        for pixel in (0..SIZE.0 * SIZE.1).filter(|&pixel| frame > 7 && shown.counts[pixel as usize] > 3.0) {
            let (right, last) = (glow(&shown.view, pixel).1, glow(&view(frame - 8, true), pixel).1);
            let [mean, single] = [&shown.means, &shown.shaded].map(|values| values[pixel as usize].x);
            errors
                .iter_mut()
                .zip([mean, single, last])
                .for_each(|(sum, value)| *sum += (value - right).powi(2));
            held += 1;
        }
    }
    let [mean, single, last] = errors.map(|sum| (sum / f64::from(held)).sqrt());
    assert!(held > 10_000 && mean < 0.5 * single && mean < 0.2 * last, "{held}: {mean} {single} {last}");
    testing::assert_valid(&context);
}

#[test]
fn where_the_gaze_comes_pictures_are_sharp_at_once() {
    let Some(context) = testing::context() else { return };
    let mut reconstruction = reconstruction(&context, REUSE);
    let picture = |frame| records(frame % 2, false);
    for frame in JUMP - 4..JUMP {
        submit(&mut reconstruction, frame, true, &picture(frame));
    }
    let shown = submit(&mut reconstruction, JUMP, true, &picture(JUMP));
    let (old, new) = (view(JUMP - 1, true), view(JUMP, true));
    let counts = |is_sharper: bool| {
        let pixel = |index: usize| {
            DVec2::new((index % SIZE.0 as usize) as f64, (index / SIZE.0 as usize) as f64) + 0.5
        };
        let widths = |pixel: DVec2| {
            let before = old.pixel_at(new.picture_point(pixel));
            [new.pixel_scale(pixel), old.pixel_scale(before)]
        };
        let counted = (0..shown.counts.len()).filter(|&index| {
            let [now, before] = widths(pixel(index));
            if is_sharper { before > 1.5 * now } else { before <= now }
        });
        let counts: Vec<f32> = counted.map(|index| shown.counts[index]).collect();
        (counts.iter().sum::<f32>() / counts.len() as f32, counts.len())
    };
    let ((sharper, sharp), (other, wide)) = (counts(true), counts(false));
    assert!(sharp > 50 && wide > 50 && sharper < 1.6 && other > 2.5, "{sharp} {wide}: {sharper} {other}");
    testing::assert_valid(&context);
}

#[test]
fn pictures_of_an_eye_that_is_fast_are_what_they_are_without_means() {
    let Some(context) = testing::context() else { return };
    let mut reconstruction = reconstruction(&context, REUSE);
    // From frame to frame the eye turns by a tenth of a pixel, then by several pixels.
    for (frame, is_fast) in [(0, true), (1, false), (2, false), (40, true), (80, true), (81, false)] {
        let shown = submit(&mut reconstruction, frame, true, &records(frame, true));
        assert_eq!(shown.jitter == DVec2::ZERO, is_fast, "{frame}");
        assert_eq!(shown.means == shown.shaded, is_fast, "{frame}");
    }
    testing::assert_valid(&context);
}
