//! The pass against its twin in `f64`, over frames of two eyes that move in front of two walls.

use glam::{DMat4, DQuat, DVec2, DVec3};

use super::*;
use crate::gpu::vulkan::{Format, Image, testing};
use crate::layout::{
    IS_MAPPED, SAMPLE_REUSES, SURFACE_MOVER, SURFACE_MOVES, TURN_SAMPLES, VisibilityRecord, noise_code,
    pack_normal24,
};
use crate::math::pose::Pose;
use crate::math::spacing::{Axis, Spacing};
use crate::math::view::FieldOfView;
use crate::reconstruct::{Frame, Mode, Output, Reconstruction, Settings};
use crate::reference::accumulate::{self, Motion, Sample};
use crate::reference::guided::toward;
use crate::trace::Turn;

mod rest;

const SIZE: (u32, u32) = (60, 40);
const REUSE: Reuse = Reuse { frames: 8, eyes: true, pictures: 1 };

/// Pixels that are farther apart around a gaze that moves, in two of three frames.
fn spacing(frame: u32) -> Spacing {
    if frame.is_multiple_of(3) {
        return Spacing::EVEN;
    }
    let axis = |picture, gaze, origin| Axis { picture, gaze, origin, radius: 6.0, growth: 0.012 };
    Spacing { columns: axis(90.0, 40.0 + f64::from(frame), 25.0), rows: axis(60.0, 28.0, 19.0) }
}

/// Two eyes that walk and turn.
fn eye(frame: u32, eye: usize) -> View {
    let frame = f64::from(frame);
    let position = DVec3::new(0.03 * frame + 0.064 * eye as f64, 0.01 * frame, -0.05 * frame);
    let rotation = DQuat::from_euler(glam::EulerRot::YXZ, 0.02 * frame, 0.01 * frame, 0.005 * frame);
    let fov = FieldOfView { left: -1.1, right: 0.9, up: 0.7, down: -0.6 };
    View {
        world_from_eye: Pose::new(rotation, position),
        fov,
        width: SIZE.0,
        height: SIZE.1,
        spacing: spacing(frame as u32),
    }
}

/// Depth and normal of what a pixel sees: a wall behind, one aside, or nothing.
fn seen(view: &View, at: [u32; 2]) -> (f64, DVec3) {
    let pixel = DVec2::new(f64::from(at[0]) + 0.5, f64::from(at[1]) + 0.5);
    let direction = view.world_from_eye.rotation * view.eye_direction(pixel);
    let eye = view.world_from_eye.position;
    if pixel.y < 3.0 {
        return (0.0, DVec3::Z);
    }
    let behind = (-5.0 - eye.z) / direction.z;
    let aside = (1.5 - eye.x) / direction.x;
    if aside > 0.0 && aside < behind { (aside, DVec3::NEG_X) } else { (behind, DVec3::Z) }
}

fn scattered(count: u32) -> Vec<u32> {
    let hash = |i: u32| (i.wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995).wrapping_mul(0x85eb_ca6b) >> 9;
    let mut samples: Vec<u32> =
        (0..count).map(|i| (hash(2 * i) % SIZE.0) | (hash(2 * i + 1) % SIZE.1) << 16).collect();
    samples.sort_unstable();
    samples.dedup();
    samples
}

/// Words of a record that say how noisy it is, and of most from where light comes: for each colour from another side.
fn toward_of(code: u32, chance: impl Fn(u32) -> f32) -> [u32; 3] {
    let axis = |part| (2.0 * chance(part) - 1.0) * 0.57;
    let pack = |v: [f32; 3]| {
        let [x, y, z] = v.map(|v| (v * 511.0).round() as i32 as u32 & 1023);
        x | y << 10 | z << 20
    };
    let direction = |color: u32| pack([0u32, 1, 2].map(|part| axis(8 + 3 * color + part)));
    let [red, green, blue] = if chance(2) < 0.7 { [0, 1, 2].map(direction) } else { [0; 3] };
    let mark = if chance(2) < 0.7 { IS_MAPPED } else { 0 };
    [red | mark, green | code << 30, blue | code >> 2 << 30]
}

/// What a frame traces at a sample: light with noise, a part of the sun, now and then something not finite.
fn traced(view: &View, packed: u32, frame: u32, index: usize) -> SampleRecord {
    let at = [packed & 0xffff, packed >> 16];
    let (depth, normal) = seen(view, at);
    let hash = |i: u32| (i.wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995).wrapping_mul(0x85eb_ca6b) >> 8;
    let chance = |part: u32| hash(frame * 40_000 + index as u32 * 32 + part) as f32 / (1 << 24) as f32;
    // From the seventh frame on there is a quarter of the light.
    let light = if frame < 6 { 4.0 } else { 1.0 };
    // Some find much, as where light is seldom found.
    let found = if chance(30) < 0.02 { 12.0 } else { 1.0 };
    let value = |part: u32| light * found * (0.5 + chance(part));
    let first = if index % 37 == 5 { [f32::NAN; 3] } else { [value(0), value(1), value(2)] };
    let centre = u32::from(at[0] < 30);
    let sun = if chance(7) < 0.6 { 0 } else { 1 + (chance(3) * 126.0) as u32 };
    let normal = pack_normal24(normal.as_vec3().to_array()) | (sun << 1 | centre) << 24;
    SampleRecord {
        first,
        depth: depth as f32,
        second: [value(4), value(5), value(6)],
        normal,
        toward: toward_of(index as u32 % 16, chance),
        ..SampleRecord::default()
    }
}

fn as_reference(record: &SampleRecord, packed: u32) -> Sample {
    let color = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    Sample {
        at: [packed & 0xffff, packed >> 16],
        diffuse: color(record.first),
        specular: color(record.second),
        toward: toward(record.toward),
        depth: f64::from(record.depth),
        normal: DVec3::from(crate::layout::unpack_normal24(record.normal).map(f64::from)),
        blocker: f64::from(record.normal >> 25),
        sun_centre: record.normal >> 24 & 1 == 1,
        roughness: 1.0,
        motion: Motion::Still,
        estimates: 1.0,
    }
}

/// All samples have light in the first frame of a pattern and in those that come early, else a third of them.
fn turn(frame: u32) -> Turn {
    if frame < 2 || frame.is_multiple_of(3) { Turn::ALL } else { Turn { number: frame % 3, of: 3 } }
}

fn waits(index: usize, turn: Turn) -> bool {
    index as u32 / TURN_SAMPLES % turn.of != turn.number
}

/// What a frame leaves of a sample that waits for its turn.
fn waiting(traced: &SampleRecord) -> SampleRecord {
    let normal = traced.normal & 0x1ff_ffff;
    SampleRecord { depth: -traced.depth, normal, toward: [SAMPLE_REUSES, 0, 0], ..SampleRecord::default() }
}

/// What the record of a pixel says of its motion: every fourth block moves, some by numbers that there are, one by one of
/// which no frame knows.
fn mapped(x: u32, y: u32) -> u32 {
    let (column, row) = (x / 8, y / 8);
    match (column + row) % 4 {
        0 => SURFACE_MOVES | (column % 4) << SURFACE_MOVER,
        _ => 0,
    }
}

/// Where the two things are that move as a whole: the first along the walls, with a jump; the other turns and is seldom
/// known.
fn movers(frame: u32) -> Vec<Option<DMat4>> {
    let time = f64::from(frame);
    let along = DVec3::new(0.0, 0.02 * time, if frame < 4 { 0.0 } else { 0.01 * time });
    let turned = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.04 * time);
    let turned = (!frame.is_multiple_of(5)).then(|| DMat4::from_rotation_translation(turned, DVec3::X));
    vec![Some(DMat4::from_scale_rotation_translation(DVec3::splat(2.0), DQuat::IDENTITY, along)), turned]
}

/// As the twin has it.
fn motion(packed: u32, frame: u32) -> Motion {
    let mapped = mapped(packed & 0xffff, packed >> 16);
    let number = (mapped >> SURFACE_MOVER) as usize;
    let place = |frame: u32| number.checked_sub(1).and_then(|index| *movers(frame).get(index)?);
    match (mapped & SURFACE_MOVES, frame.checked_sub(1).and_then(place), place(frame)) {
        (0, ..) => Motion::Still,
        (_, Some(was), Some(is)) => Motion::Whole(was * is.inverse()),
        _ => Motion::Unknown,
    }
}

/// Submits a frame of one eye; the records and histories that it leaves.
fn submit(
    reconstruction: &mut Reconstruction,
    view: &View,
    eye: usize,
    records: &[SampleRecord],
    (frame, light_changes, estimates, rests): (u32, bool, f32, bool),
) -> (Vec<SampleRecord>, Vec<[f32; 8]>) {
    let context = reconstruction.context.clone();
    let samples = HostBuffer::new(&context, size_of_val(records)).unwrap();
    samples.write(0, records);
    let rough = VisibilityRecord { surface: 4095 << 20, ..VisibilityRecord::default() };
    let seen = |pixel| VisibilityRecord { mapped: mapped(pixel % SIZE.0, pixel / SIZE.0), ..rough };
    let pixels: Vec<VisibilityRecord> = (0..SIZE.0 * SIZE.1).map(seen).collect();
    let visibility = HostBuffer::new(&context, size_of_val(&pixels[..])).unwrap();
    visibility.write(0, &pixels);
    let image = Image::new(&context, Format::R8G8B8A8_UNORM, SIZE.0, SIZE.1).unwrap();
    let shown = Frame {
        view,
        samples: (&samples).into(),
        visibility: Some((&visibility).into()),
        sun: None,
        least_expected: 0.01,
        light_holds: f32::INFINITY,
        light_changes,
        estimates,
        rests,
        movers: movers(frame).into(),
        overlay: Default::default(),
        shown_from: None,
        jitter: DVec2::ZERO,
        other: Some(eye ^ 1),
        exposure: 0.0,
        outputs: &[Output::whole(image.target(), 0.0)],
    };
    reconstruction.submit(eye, &shown).unwrap();
    let stages: Vec<_> = reconstruction.wait(eye).unwrap().iter().map(|time| time.stage).collect();
    assert!(stages.starts_with(&["accumulate", "filter"]), "{stages:?}");
    let kept = reconstruction.views[eye].history.last.as_ref().unwrap();
    let (records_of, histories) = (&kept.buffers.records, &kept.buffers.histories);
    (testing::fetch(&context, records_of, records.len()), testing::fetch(&context, histories, records.len()))
}

#[test]
fn frames_are_those_of_the_reference() {
    [false, true]
        .into_iter()
        .for_each(|light_changes| frames_are_those_of_the_twin(light_changes, |_| Turn::ALL, 1.0, true));
}

#[test]
fn samples_that_are_sent_fewer_rays_are_those_of_the_reference() {
    frames_are_those_of_the_twin(false, |_| Turn::ALL, 4.0, true);
}

#[test]
fn samples_that_wait_for_their_turn_are_those_of_the_reference() {
    frames_are_those_of_the_twin(false, turn, 1.0, true);
}

#[test]
fn samples_that_wait_in_motion_are_those_of_the_reference() {
    let half = |frame: u32| if frame == 0 { Turn::ALL } else { Turn { number: frame % 2, of: 2 } };
    frames_are_those_of_the_twin(false, half, 1.0, false);
}

/// All samples count as so many estimates but for every third one, which is sent fewer rays where that is more than 1.
fn frames_are_those_of_the_twin(light_changes: bool, turn: fn(u32) -> Turn, estimates: f32, rests: bool) {
    let Some(context) = testing::context() else { return };
    let settings = Settings { mode: Mode::default(), reuse: Some(REUSE), ..Settings::default() };
    let mut reconstruction = Reconstruction::new(&context, settings).unwrap();
    let guided = settings.guided();
    let rules = accumulate::Settings {
        normal_power: guided.normal_power.into(),
        plane_tolerance: guided.plane_tolerance.into(),
        k: settings.k as usize,
        neighbours: 12,
        longest: f64::from(REUSE.frames),
        light_changes,
        estimates: estimates.into(),
        rests,
    };
    let mut kept: [Option<accumulate::Kept>; 2] = [None, None];
    let mut lent: [Option<accumulate::Kept>; 2] = [None, None];
    let mut towards: [Vec<[u32; 3]>; 2] = [Vec::new(), Vec::new()];
    let (mut waited, mut holes, mut directed) = (0, 0, 0);
    let (mut compared, mut along, mut carried, mut cut, mut undecided, mut quieter) = (0, 0, 0, 0, 0, 0);
    for frame in 0..9 {
        for eye_index in 0..2 {
            let view = eye(frame, eye_index);
            // The pattern changes at times, as when the gaze moves.
            let samples = scattered(300 + 20 * (frame / 3));
            reconstruction.set_pattern(eye_index, SIZE.0, SIZE.1, &samples).unwrap();
            let turn = turn(frame);
            let traced = |(i, &s): (usize, &u32)| traced(&view, s, frame, i);
            let marked =
                |(i, record): (usize, SampleRecord)| if waits(i, turn) { waiting(&record) } else { record };
            let mut fresh: Vec<_> = samples.iter().enumerate().map(traced).enumerate().map(marked).collect();
            let reuses = |index: usize| estimates > 1.0 && index.is_multiple_of(3);
            for (_, record) in fresh.iter_mut().enumerate().filter(|(index, _)| reuses(*index)) {
                record.toward[0] |= SAMPLE_REUSES;
            }
            let of_own = |index: usize| if reuses(index) { 1.0 } else { f64::from(estimates) };
            let told = (frame, light_changes, estimates, rests);
            let (records, histories) = submit(&mut reconstruction, &view, eye_index, &fresh, told);
            let twins: Vec<_> = fresh
                .iter()
                .zip(&samples)
                .enumerate()
                .map(|(index, (record, &packed))| Sample {
                    motion: motion(packed, frame),
                    estimates: if waits(index, turn) { 0.0 } else { of_own(index) },
                    depth: f64::from(record.depth.abs()),
                    ..as_reference(record, packed)
                })
                .collect();
            let other = lent[1 - eye_index].as_ref();
            let (expected, ages) =
                accumulate::accumulate(&view, &twins, kept[eye_index].as_ref(), other, &rules);
            let mut found_samples = Vec::new();
            for (index, (record, twin)) in records.iter().zip(&expected).enumerate() {
                let found = as_reference(record, samples[index]);
                found_samples.push(found);
                if !twin.diffuse.is_finite() {
                    assert!(record.first[0].is_nan() && histories[index][0] == 0.0);
                    continue;
                }
                let place = (frame, eye_index, index);
                if twin.waits() {
                    assert!(record.depth <= 0.0 && histories[index][0] == 0.0, "{place:?}: {record:?}");
                    holes += usize::from(twin.depth > 0.0);
                    continue;
                }
                let aged = [0, 1].map(|part| (histories[index][part] - ages[index].ages[part] as f32).abs());
                // Whether light has changed is a matter of rounding where it is just at the limit, and so is whether enough
                // neighbours tell how far it has.
                let moves = twin.motion != Motion::Still;
                // How much is kept of what moves falls with the square of how far light is off, and is as far off by rounding.
                let rounded = if moves { 0.004 } else { 0.02 };
                if aged[0] > rounded
                    && (moves || ages[index].ages[0].min(histories[index][0].into()) < 1.5 + of_own(index))
                {
                    undecided += 1;
                    continue;
                }
                assert!(aged[0] < 0.02 && aged[1] < 0.02, "{place:?}: {aged:?}");
                assert!((found.diffuse - twin.diffuse).length() < 0.01, "{place:?}: {found:?} {twin:?}");
                assert!((found.specular - twin.specular).length() < 0.01, "{place:?}: {found:?} {twin:?}");
                if !waits(index, turn) || !rests {
                    assert_eq!(found.toward.is_some(), twin.toward.is_some(), "{place:?}");
                    // Each axis is one of 1023 numbers, before and after.
                    let off =
                        found.toward.zip(twin.toward).map(|(a, b)| [0, 1, 2].map(|c| (a[c] - b[c]).length()));
                    let most = off.unwrap_or_default().into_iter().fold(0.0, f64::max);
                    assert!(most < 0.003, "{place:?}: {:?} {:?}", found.toward, twin.toward);
                    directed += usize::from(off.is_some() && ages[index].ages[0] > 3.0);
                }
                let confidence = f64::from(histories[index][6]);
                assert!((confidence - ages[index].confidence).abs() < 0.01, "{place:?}: {confidence}");
                let own = if moves { 1.0 } else { of_own(index) };
                let age = (histories[index][0].min(histories[index][1]) / own as f32).max(1.0);
                let code = index as u32 % 16;
                let waits = waits(index, turn);
                waited += usize::from(waits);
                if waits && rests {
                    let had = towards[eye_index][index];
                    assert!(
                        record.toward == had || record.toward == [0; 3],
                        "{place:?}: {:x?}",
                        record.toward
                    );
                }
                let expected = match code {
                    0 | 15 => code,
                    _ => (code + (age.log2() / 1.5) as u32).min(14),
                };
                let limit = (age.log2() / 1.5).fract();
                quieter += usize::from(expected > code && !waits);
                assert!(
                    waits || noise_code(record.toward) == expected || !(1e-3..0.999).contains(&limit),
                    "{place:?}: {:x?}, age {age}",
                    record.toward
                );
                assert!((found.blocker - twin.blocker).abs() < 0.52, "{place:?}: {found:?} {twin:?}");
                compared += 1;
                carried += usize::from(ages[index].ages[0] > 3.0);
                let moves = matches!(twin.motion, Motion::Whole(_));
                along += usize::from(moves && ages[index].ages.iter().all(|age| *age > 3.0));
                cut += usize::from(frame >= 6 && ages[index].ages[0] < 2.5 && twin.depth > 0.0);
            }
            // What is compared is one frame: the next begins with what the device has.
            let kept_histories = histories.iter().map(|h| accumulate::History {
                ages: [h[0].into(), h[1].into()],
                fast: h[2].into(),
                slow: h[3].into(),
                variance: h[4].into(),
                confidence: h[6].into(),
            });
            let kept_samples = found_samples.into_iter().zip(&histories).map(|(sample, h)| Sample {
                blocker: if h[0] > 0.0 { f64::from(h[5]) } else { sample.blocker },
                ..sample
            });
            towards[eye_index] = records.iter().map(|record| record.toward).collect();
            kept[eye_index] = Some(accumulate::Kept {
                view,
                samples: kept_samples.collect(),
                histories: kept_histories.collect(),
            });
            lent[eye_index] = Some(accumulate::Kept { view, samples: twins, histories: Vec::new() });
        }
    }
    assert!(directed > 300, "{directed} samples know where the light of several frames comes from");
    if turn(7) != Turn::ALL {
        assert!(compared > 3000 && waited > 1500 && holes > 5, "{compared} {waited} {holes}");
        return testing::assert_valid(&context);
    }
    assert!(compared > 4000 && carried > 2000 && cut > 100, "{compared} {carried} {cut}");
    let least = if estimates > 1.0 { 500 } else { 1000 };
    assert!(quieter > least, "{quieter} samples are less noisy than new ones");
    assert!(along > 50, "{along} samples are carried along with what moves");
    assert!(undecided < compared / 100, "{undecided}");
    testing::assert_valid(&context);
}

#[test]
fn nothing_is_found_after_a_cut() {
    let Some(context) = testing::context() else { return };
    let settings = Settings { mode: Mode::default(), reuse: Some(REUSE), ..Settings::default() };
    let mut reconstruction = Reconstruction::new(&context, settings).unwrap();
    let samples = scattered(300);
    reconstruction.set_pattern(0, SIZE.0, SIZE.1, &samples).unwrap();
    let view = eye(0, 0);
    for frame in 0..3 {
        let fresh: Vec<_> = samples.iter().enumerate().map(|(i, &s)| traced(&view, s, frame, i)).collect();
        reconstruction.forget();
        let (records, _) = submit(&mut reconstruction, &view, 0, &fresh, (0, false, 1.0, true));
        assert_eq!(bytemuck::cast_slice::<_, u8>(&records), bytemuck::cast_slice::<_, u8>(&fresh));
    }
}
