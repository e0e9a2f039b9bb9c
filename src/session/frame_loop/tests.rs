mod stage;

use glam::DVec3;

use super::*;
use crate::scene::generate::demo;
use stage::*;

#[test]
fn what_is_shown_is_seen_from_where_the_eyes_are_then() {
    for cost in [400_000, 3_000_000, 31_000_000, 170_000_000] {
        let run = frames(&per_eye(), cost, 8, |_| {});
        // The first frames learn how long one takes.
        for frame in 4..8 {
            let (handed_over, shown) = &run.wearer.ended[frame];
            let seen = eyes(beat(*handed_over));
            for (index, (shown, seen)) in shown.as_ref().unwrap().iter().zip(&seen).enumerate() {
                let error = (shown.space_from_eye.position - seen.space_from_eye.position).length();
                assert!(
                    close(shown.space_from_eye, seen.space_from_eye),
                    "{cost} {frame} {index}: {error} m"
                );
            }
            // What moves is where it is then.
            let instant = run.notebook.instants[frame] - run.notebook.instants[4];
            let first = beat(*handed_over) - beat(run.wearer.ended[4].0);
            assert!((instant - first as f64 * 1e-9).abs() < 1e-9, "{cost} {frame}: {instant}");
            // What is traced comes from there already, as far as frames take equally long.
            let traced = &run.notebook.drawn[frame].traced;
            for (traced, seen) in traced.iter().zip(&seen) {
                assert!(close(traced.view.world_from_eye, seen.space_from_eye), "{cost} {frame}");
            }
            let Shown { ages, .. } = run.listener.shown[frame];
            assert!(
                [ages.begin, ages.trace, ages.late].iter().all(|age| age.unwrap().abs() < 1e-6),
                "{ages:?}"
            );
        }
    }
}

#[test]
fn a_late_correction_follows_the_head_where_a_frame_takes_longer_than_expected() {
    let mut config = per_eye();
    let corrected = |config: &Config, surprises: bool| {
        let run = frames(config, 85_000_000, 1, |wearer| wearer.surprises = surprises);
        let drawn = &run.notebook.drawn[0];
        let traced: Vec<Pose> = drawn.traced.iter().map(|traced| traced.view.world_from_eye).collect();
        let shown: Vec<Pose> =
            run.wearer.ended[0].1.as_ref().unwrap().iter().map(|eye| eye.space_from_eye).collect();
        (traced, drawn.late.clone(), shown, run.wearer.located)
    };
    let (traced, late, shown, located) = corrected(&config, true);
    // Nothing is known of the first frame's length: its poses are of when it begins, its correction's of when the
    // first view is traced, for both eyes alike.
    assert!(close(traced[0], eyes(located[1])[0].space_from_eye));
    let then = eyes(beat(1000 * PERIOD + 85_000_000));
    for eye in 0..2 {
        assert!(close(late[eye].unwrap(), then[eye].space_from_eye), "{eye}");
        assert!(close(shown[eye], then[eye].space_from_eye), "{eye}");
    }
    // Where it is not wanted, or cannot gain anything, nobody is asked.
    config.headset.late_correction = false;
    for (config, surprises) in [(&config, true), (&per_eye(), false)] {
        let (traced, late, shown, located) = corrected(config, surprises);
        assert_eq!((late, located.len()), (vec![None, None], 2));
        assert!(close(traced[0], shown[0]) && close(traced[1], shown[1]));
    }
}

#[test]
fn each_eye_sees_its_own_side() {
    let run = frames(&per_eye(), 1_000_000, 3, |_| {});
    let Drawn { traced, .. } = &run.notebook.drawn[2];
    let right = traced[0].view.world_from_eye.rotation * DVec3::X;
    let apart = (traced[1].view.world_from_eye.position - traced[0].view.world_from_eye.position).dot(right);
    assert!((apart - 0.064).abs() < 1e-9, "the second eye is to the right: {apart}");
    assert_eq!([traced[0].parts[0].view, traced[1].parts[0].view], [0, 1]);
    // With one view for both the left eye sees its left part: fields of view lean outwards.
    let mut config = per_eye();
    config.view.stereo = Stereo::Shared;
    let run = frames(&config, 1_000_000, 3, |_| {});
    let parts = &run.notebook.drawn[2].traced[0].parts;
    assert_eq!([parts[0].view, parts[1].view], [0, 1]);
    assert!(parts[0].source[0] < parts[1].source[0], "{parts:?}");
}

/// The direction in the tracked space of where a traced view is sharp.
fn sharp(traced: &Traced) -> DVec3 {
    let scale = DVec2::new(f64::from(traced.view.width), f64::from(traced.view.height));
    (traced.view.world_from_eye.rotation * traced.view.eye_direction(traced.fovea.point * scale)).normalize()
}

#[test]
fn pictures_are_sharp_where_the_eyes_look_whatever_the_margin() {
    for margin in [0.0, 0.04, 0.2] {
        let mut config = per_eye();
        config.headset.margin = margin;
        let run = frames(&config, 1_000_000, 40, |wearer| wearer.gaze = Some(|_| 0.25));
        for (index, traced) in run.notebook.drawn[39].traced.iter().enumerate() {
            let ahead = traced.view.world_from_eye.rotation;
            let looked_at = ahead * DVec3::new(0.25f64.sin(), 0.0, -(0.25f64.cos()));
            let off = sharp(traced).angle_between(looked_at).to_degrees();
            assert!(off < 1.0, "margin {margin}, eye {index}: {off} degrees beside it");
            assert!(traced.view.width >= SIZE.0 && (margin == 0.0) == (traced.view.width == SIZE.0));
        }
    }
}

#[test]
fn the_sharp_region_is_wider_while_the_eyes_jump() {
    let jumps: fn(i64) -> f64 = |time| if time < 1020 * PERIOD { 0.0 } else { 0.4 };
    let run = frames(&per_eye(), 1_000_000, 60, |wearer| wearer.gaze = Some(jumps));
    let widest = |drawn: &[Drawn]| {
        drawn.iter().flat_map(|d| &d.traced).map(|traced| traced.fovea.widening).fold(0.0, f64::max)
    };
    assert_eq!(widest(&run.notebook.drawn[..10]), 1.0);
    assert!(widest(&run.notebook.drawn) > 1.3);
    assert!(widest(&run.notebook.drawn[55..]) < 1.2, "and no longer");
    assert!(run.listener.shown.iter().any(|shown| shown.fovea[0].widening > 1.3), "which is told");
}

#[test]
fn each_frame_has_random_numbers_of_its_own() {
    let mut config = per_eye();
    config.trace.seed = 40;
    let run = frames(&config, 1_000_000, 4, |_| {});
    assert_eq!(run.notebook.drawn.iter().map(|drawn| drawn.seed).collect::<Vec<_>>(), [40, 41, 42, 43]);
}

#[test]
fn pictures_show_the_hands_of_their_frame() {
    let grip = Pose::new(glam::DQuat::IDENTITY, DVec3::new(0.1, 1.0, -0.4));
    let run = frames(&per_eye(), PERIOD / 4, 3, |wearer| wearer.input.hands.grips = [Some(grip), None]);
    assert_eq!(run.notebook.hands.len(), run.notebook.drawn.len());
    assert!(run.notebook.hands.iter().all(|hands| hands.grips == [Some(grip), None] && hands.aim.is_none()));
}

#[test]
fn pictures_have_the_exposure_that_was_given() {
    let mut config = per_eye();
    config.view.exposure = crate::config::ExposureConfig::Stops(1.5);
    let run = frames(&config, 1_000_000, 2, |_| {});
    assert!(run.notebook.drawn.iter().all(|drawn| drawn.exposure == 1.5));
}

#[test]
fn what_nobody_sees_is_not_traced() {
    let run = frames(&per_eye(), 1_000_000, 3, |wearer| wearer.visible = false);
    assert!(run.notebook.drawn.is_empty() && run.listener.shown.is_empty() && run.wearer.located.is_empty());
    assert_eq!(run.wearer.ended.iter().filter(|(_, shown)| shown.is_none()).count(), 3);
    assert_eq!(run.wearer.held, 0, "whoever wants no picture gets no old one");
}

#[test]
fn time_is_held_told_and_the_exposure_locked_where_that_is_asked() {
    let mut config = per_eye();
    let lock = |wearer: &mut Wearer| wearer.input.toggles.exposure = true;
    let run = frames(&config, 1_000_000, 2, lock);
    assert_eq!((run.notebook.applied, run.notebook.toggled), (0, [2, 0]));
    assert_eq!(run.wearer.status, "0 samples");
    config.budget.target_ms = crate::config::TargetMs::Ms(0.001);
    let run = frames(&config, 1_000_000, 12, |_| {});
    assert_eq!(run.notebook.applied, 12);
    assert!(run.wearer.status.starts_with("quality 0 %"), "{}", run.wearer.status);
    let told = run.listener.notes.iter().filter(|note| note.contains("out of reach")).count();
    assert_eq!(told, 1, "{:?}", run.listener.notes);
}

/// What samples that take turns save is not spent, which would end the rest; a time that is missed all the same is answered.
#[test]
fn quality_does_not_grow_while_samples_take_turns() {
    let mut config = per_eye();
    let mut run = |rests: bool, target: f64| {
        config.budget.target_ms = crate::config::TargetMs::Ms(target);
        let mut run = frames(&config, 1_000_000, 0, |_| {});
        run.notebook.rests = rests;
        go_on(&mut run, &config, 12);
        let position = |shown: &Shown| shown.held.unwrap().position;
        let positions: Vec<f64> = run.listener.shown.iter().map(position).collect();
        let told = run.listener.notes.iter().filter(|note| note.contains("out of reach")).count();
        (positions[11] - positions[0], told)
    };
    let (grown, resting) = (run(false, 20.0), run(true, 20.0));
    assert!(grown.0 > 0.03 && resting.0 == 0.0, "{grown:?} {resting:?}");
    assert_eq!((run(false, 0.001).1, run(true, 0.001).1), (1, 1));
}

#[test]
fn a_field_of_view_is_scaled_as_a_whole() {
    let fov = FieldOfView { left: -1.2, right: 0.8, up: 1.0, down: -1.4 };
    let scaled = scaled(fov, 60f64.to_radians());
    assert!((scaled.up - scaled.down - 2.0 * 30f64.to_radians().tan()).abs() < 1e-12);
    assert!((scaled.left / scaled.right + 1.5).abs() < 1e-12);
}

/// Frames without a device show nothing new where the headset holds its picture, are told once, and go on afterwards;
/// elsewhere they are failures.
#[test]
fn pictures_are_held_while_no_device_is_left() {
    let scene = Scene::from_glb(std::path::Path::new("demo"), &demo::generate()).unwrap();
    let config = per_eye();
    let mut run = frames(&config, PERIOD / 4, 0, |_| ());
    let mut frame_loop = FrameLoop::new(&config, &scene, Rig::in_place(), None, None);
    frame_loop.hold_pictures();
    let mut absent = Absent { notebook: &mut run.notebook, missed: 3 };
    let mut step = |absent: &mut Absent, frame_loop: &mut FrameLoop| {
        let mut link = Link { headset: &mut run.wearer, draw: absent, observer: &mut run.listener };
        frame_loop.step(&mut link, &Keys::default())
    };
    (0..5).for_each(|_| assert!(step(&mut absent, &mut frame_loop).unwrap()));
    absent.missed = 1;
    let mut another = FrameLoop::new(&config, &scene, Rig::in_place(), None, None);
    let fault = step(&mut absent, &mut another).unwrap_err();
    assert!(fault.sentence().contains("none is left"));
    let shown: Vec<bool> = run.wearer.ended.iter().map(|(_, shown)| shown.is_some()).collect();
    assert_eq!((shown, run.wearer.held), (vec![false, false, false, true, true], 3));
    assert_eq!((run.listener.shown.len(), run.listener.notes.len()), (2, 2), "{:?}", run.listener.notes);
    assert!(run.listener.notes[0].contains("is held") && run.listener.notes[1].contains("again"));
    assert_eq!(run.wearer.told, vec![run.listener.notes[0].clone(); 3], "the wearer is told the same");
}

/// A second picture is made where a driver built while the first one's rays waited, and only there.
#[test]
fn warming_up_ends_where_nothing_was_left_to_be_built() {
    let config = per_eye();
    for (building, most, made) in [(0, 2, 1), (1, 2, 2), (9, 2, 2), (9, 1, 1)] {
        let mut run = frames(&config, PERIOD / 4, 0, |_| ());
        run.notebook.building = building;
        let mut frame_loop = FrameLoop::new(&config, &SCENE, Rig::in_place(), None, None);
        let mut link =
            Link { headset: &mut run.wearer, draw: &mut run.notebook, observer: &mut run.listener };
        frame_loop.warm_up(&mut link, most).unwrap();
        assert_eq!(run.notebook.drawn.len(), made, "{building} of {most}");
    }
}

/// What is announced is told in one frame that shows nothing new, before the picture that it is about.
#[test]
fn what_is_announced_is_told_before_the_next_picture() {
    let config = per_eye();
    let mut run = frames(&config, PERIOD / 4, 0, |_| ());
    let mut frame_loop = FrameLoop::new(&config, &SCENE, Rig::in_place(), None, None);
    frame_loop.announce("a picture is coming".to_string(), true);
    let mut step = |wearer: &mut Wearer| {
        let mut link = Link { headset: wearer, draw: &mut run.notebook, observer: &mut run.listener };
        assert!(frame_loop.step(&mut link, &Keys::default()).unwrap());
    };
    // Whoever sees nothing is not told.
    run.wearer.visible = false;
    step(&mut run.wearer);
    run.wearer.visible = true;
    (0..3).for_each(|_| step(&mut run.wearer));
    assert_eq!(run.wearer.told, ["a picture is coming"]);
    let shown: Vec<bool> = run.wearer.ended.iter().map(|(_, shown)| shown.is_some()).collect();
    assert_eq!((shown, run.notebook.drawn.len()), (vec![false, false, true, true], 2));
}
