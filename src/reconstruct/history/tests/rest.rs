//! Views that rest, and samples that wait for their turn there.

use glam::Vec3;

use super::*;

/// Frames of one still view, of whose samples half wait in the last one: what each frame leaves, after `told` has seen the
/// reconstruction before it.
fn at_rest(
    context: &Context,
    changes: impl Fn(u32) -> bool,
    mut told: impl FnMut(u32, &mut Reconstruction),
) -> [Vec<(SampleRecord, [f32; 8])>; 2] {
    let settings = Settings { mode: Mode::default(), reuse: Some(REUSE), ..Settings::default() };
    let mut reconstruction = Reconstruction::new(context, settings).unwrap();
    let samples = scattered(300);
    reconstruction.set_pattern(0, SIZE.0, SIZE.1, &samples).unwrap();
    let mut last = [Vec::new(), Vec::new()];
    for frame in 0..6 {
        let turn = if frame < 5 { Turn::ALL } else { HALF };
        let traced = |(i, &s): (usize, &u32)| traced(&eye(0, 0), s, frame, i);
        let marked =
            |(i, record): (usize, SampleRecord)| if waits(i, turn) { waiting(&record) } else { record };
        let fresh: Vec<_> = samples.iter().enumerate().map(traced).enumerate().map(marked).collect();
        told(frame, &mut reconstruction);
        let left = submit(&mut reconstruction, &eye(0, 0), 0, &fresh, (0, changes(frame), 1.0, true));
        last = [last[1].clone(), left.0.into_iter().zip(left.1).collect()];
    }
    last
}

const HALF: Turn = Turn { number: 1, of: 2 };

#[test]
fn what_waits_keeps_what_it_had() {
    let Some(context) = testing::context() else { return };
    let [before, after] = at_rest(&context, |_| false, |_, _| {});
    let samples = scattered(300);
    let mut kept = 0;
    for (index, ((was, of_was), (is, of_is))) in before.iter().zip(&after).enumerate() {
        if !waits(index, HALF) || of_was[0] <= 0.0 || motion(samples[index], 0) != Motion::Still {
            continue;
        }
        kept += 1;
        let off = |part: usize| (of_was[part] - of_is[part]).abs();
        assert!(off(0) < 0.01 && off(1) < 0.01 && off(6) < 0.01, "{index}: {of_was:?} {of_is:?}");
        assert_eq!((was.depth, was.toward, was.reflected), (is.depth, is.toward, is.reflected), "{index}");
        let light = |record: &SampleRecord| (Vec3::from(record.first), Vec3::from(record.second));
        let ((diffuse, specular), (diffuse_before, specular_before)) = (light(is), light(was));
        let changed = (diffuse - diffuse_before).length().max((specular - specular_before).length());
        assert!(changed < 0.02, "{index}: {was:?} {is:?}");
    }
    assert!(kept > 60, "{kept}");
}

#[test]
fn views_rest_while_nothing_changes() {
    let Some(context) = testing::context() else { return };
    let turned = |by: f64| {
        let view = eye(0, 0);
        View {
            world_from_eye: Pose::new(
                DQuat::from_rotation_y(by) * view.world_from_eye.rotation,
                view.world_from_eye.position,
            ),
            ..view
        }
    };
    at_rest(
        &context,
        |_| false,
        |frame, reconstruction| {
            assert_eq!(reconstruction.rests(0, &eye(0, 0), 2), frame >= 3, "frame {frame}");
            assert!(!reconstruction.rests(0, &turned(1e-3), 0));
            assert_eq!(reconstruction.rests(0, &turned(1e-4), 0), frame > 0);
            assert!(!reconstruction.rests(1, &eye(0, 0), 0), "there is no such view");
        },
    );
    // A new pattern ends it.
    at_rest(
        &context,
        |_| false,
        |frame, reconstruction| {
            if frame == 4 {
                reconstruction.set_pattern(0, SIZE.0, SIZE.1, &scattered(300)).unwrap();
            }
            assert_eq!(reconstruction.rests(0, &eye(0, 0), 1), [2, 3, 5].contains(&frame), "frame {frame}");
        },
    );
    // So does light that changes.
    at_rest(
        &context,
        |frame| frame == 3,
        |frame, reconstruction| {
            assert_eq!(reconstruction.rests(0, &eye(0, 0), 1), [2, 3, 5].contains(&frame), "frame {frame}");
        },
    );
}
