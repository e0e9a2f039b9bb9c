//! The budget controller against made-up frames.

use proptest::prelude::*;

use super::*;
use crate::config::{Method, OperatingPoint};

/// Frames of 2, 4, 8, 16 and 32 ms; scores 4 to 8.
fn points() -> Vec<OperatingPoint> {
    (0..5)
        .map(|i| {
            let double = f64::from(1 << i);
            OperatingPoint {
                samples: 0.01 * double,
                ..OperatingPoint::of(&Config::default(), 1, 2.0 * double, 4.0 + f64::from(i))
            }
        })
        .collect()
}

fn start(ms: f64) -> Controller {
    let levels = QualityLevels::of(&points(), &Config::default()).unwrap();
    Controller::new(levels, Target { ms, score: 10.0 })
}

/// What a frame costs where views weigh `load`: in proportion to samples and rays.
fn cost(held: &QualityState, load: f64) -> f64 {
    load * 2.0 * held.samples * f64::from(held.rays) / (0.01 * 32.0)
}

/// Runs frames of one load; the milliseconds of each.
fn run(controller: &mut Controller, load: f64, frames: usize) -> Vec<f64> {
    let frame = |_| {
        let ms = cost(&controller.held(), load);
        controller.observe(ms, 0.0);
        ms
    };
    (0..frames).map(frame).collect()
}

#[test]
fn it_starts_and_stays_where_the_target_is_met() {
    let mut controller = start(11.0);
    let times = run(&mut controller, 1.0, 300);
    assert!(times.iter().all(|ms| (9.0..=11.6).contains(ms)), "{times:?}");
}

#[test]
fn it_answers_a_heavier_view_within_three_frames_and_comes_back_slowly() {
    let mut controller = start(11.0);
    run(&mut controller, 1.0, 50);
    let before = controller.held();
    let heavy = run(&mut controller, 2.5, 30);
    assert!(heavy[0] > 20.0 && heavy[1] > 20.0, "{heavy:?}");
    assert!(heavy[2] < 13.0, "the third frame is in time again, nearly: {heavy:?}");
    assert!(heavy[4..].iter().all(|ms| *ms < 11.8), "{heavy:?}");
    let back = run(&mut controller, 1.0, 200);
    assert!(back[..20].iter().all(|ms| *ms < 9.0), "not at once: {back:?}");
    assert!(back[199] > 10.0, "but in the end: {back:?}");
    assert!(back.iter().all(|ms| *ms < 11.8), "never too far: {back:?}");
    assert!((controller.held().score - before.score).abs() < 0.2);
}

#[test]
fn one_slow_frame_alone_changes_nothing() {
    let mut controller = start(11.0);
    run(&mut controller, 1.0, 50);
    let before = controller.held();
    controller.observe(90.0, 0.0);
    assert_eq!(controller.held(), before);
    run(&mut controller, 1.0, 1);
    assert_eq!(controller.held().samples, before.samples);
}

/// Frames at rest that are in time are no lighter view, and slow ones with such between them do not follow each other; two
/// that do are answered.
#[test]
fn frames_at_rest_lower_quality_alone() {
    let mut controller = start(11.0);
    run(&mut controller, 1.0, 50);
    let before = controller.held();
    for _ in 0..100 {
        controller.observe_at_rest(2.0, 0.0);
    }
    for _ in 0..5 {
        controller.observe_at_rest(90.0, 0.0);
        controller.observe_at_rest(2.0, 0.0);
    }
    assert_eq!(controller.held(), before);
    controller.observe_at_rest(90.0, 0.0);
    controller.observe_at_rest(90.0, 0.0);
    assert!(controller.held().position < before.position, "{:?}", controller.held());
}

#[test]
fn steps_are_small_on_the_way_back() {
    let mut controller = start(11.0);
    run(&mut controller, 3.0, 50);
    let mut last = controller.held();
    let mut changes = 0;
    for _ in 0..400 {
        run(&mut controller, 1.0, 1);
        let next = controller.held();
        let work = |held: &QualityState| held.samples * f64::from(held.rays);
        assert!((work(&next) / work(&last)).ln().abs() < 0.08, "{last:?} {next:?}");
        changes += u32::from(next.samples != last.samples);
        last = next;
    }
    assert!(changes <= 4, "patterns are kept: {changes}");
}

#[test]
fn new_patterns_are_no_heavier_view_but_take_their_time() {
    let mut controller = start(11.0);
    run(&mut controller, 1.0, 50);
    for frame in 0..400 {
        let pattern = if frame % 20 == 0 { 40.0 } else { 0.0 };
        let ms = cost(&controller.held(), 1.0);
        controller.observe(ms + pattern, pattern);
    }
    let held = controller.held();
    assert!((held.load - 1.0).abs() < 0.1, "{held:?}");
    assert!((6.0..11.0).contains(&cost(&held, 1.0)), "{held:?}");
}

#[test]
fn a_score_is_enough_where_it_is_reached() {
    let levels = QualityLevels::of(&points(), &Config::default()).unwrap();
    let mut controller = Controller::new(levels.clone(), Target { ms: 100.0, score: 5.5 });
    run(&mut controller, 1.0, 200);
    assert!((controller.held().score - 5.5).abs() < 1e-9);
    let without_time = Controller::new(levels, Target { ms: f64::INFINITY, score: 6.0 });
    assert_eq!((without_time.held().score, without_time.held().target_ms), (6.0, None));
}

#[test]
fn impossible_targets_and_times_end_at_the_ends() {
    let mut controller = start(0.1);
    run(&mut controller, 5.0, 20);
    assert_eq!(controller.held().position, 0.0);
    let mut controller = start(1e6);
    run(&mut controller, 1.0, 20);
    assert_eq!(controller.held().position, 1.0);
    let before = controller.held();
    for (frame, pattern) in [(f64::NAN, 0.0), (0.0, 0.0), (-5.0, 0.0), (5.0, f64::NAN), (5.0, 7.0)] {
        controller.observe(frame, pattern);
    }
    assert_eq!(controller.held(), before);
    controller.observe(f64::MAX, 0.0);
    controller.observe(f64::MAX, 0.0);
    assert!(controller.held().rays >= 1 && controller.held().samples > 0.0);
}

#[test]
fn another_display_period_is_another_target() {
    let mut controller = start(3.0);
    controller.retarget(Target { ms: 11.0, score: 10.0 });
    assert_eq!(controller.held(), start(11.0).held(), "nothing is known of frames yet");
    run(&mut controller, 2.0, 50);
    let before = controller.held();
    controller.retarget(Target { ms: 11.0, score: 10.0 });
    assert_eq!(controller.held(), before);
    controller.retarget(Target { ms: 5.5, score: 10.0 });
    assert!(cost(&controller.held(), 2.0) < 5.8, "at once, with the load that is known");
    let times = run(&mut controller, 2.0, 100);
    assert!(times.iter().all(|ms| (4.0..5.8).contains(ms)), "{times:?}");
}

#[test]
fn ladders_keep_to_one_family() {
    let mut mixed = points();
    mixed.push(OperatingPoint { method: Method::KNearest, frame_ms: 1.0, score: 9.0, ..mixed[0] });
    mixed.push(OperatingPoint { frame_ms: 9.0, score: 2.0, ..mixed[0] });
    let levels = QualityLevels::of(&mixed, &Config::default()).unwrap();
    assert_eq!(levels.steps(), points());
    let mut other = Config::default();
    other.trace.bounces = 2;
    assert_eq!(QualityLevels::of(&mixed, &other).unwrap().steps().len(), 5, "the family with most steps");
    assert_eq!(QualityLevels::of(&[], &other), None);
    let one = QualityLevels::of(&mixed[5..6], &other).unwrap();
    let mut controller = Controller::new(one, Target { ms: 5.0, score: 10.0 });
    controller.observe(3.0, 0.0);
    assert_eq!(controller.held().position, 1.0);
}

#[test]
fn targets_come_from_settings_and_the_display() {
    let mut config = Config::default();
    assert_eq!(Target::of(&config, None), None);
    let display = Target::of(&config, Some(10.0)).unwrap();
    assert_eq!(display, Target { ms: 9.0, score: 10.0 });
    config.budget.target_ms = TargetMs::Ms(20.0);
    config.budget.target_score = 7.0;
    assert_eq!(Target::of(&config, Some(10.0)), Some(Target { ms: 20.0, score: 7.0 }));
    config.budget.target_ms = TargetMs::None;
    assert_eq!(Target::of(&config, Some(10.0)).unwrap().ms, f64::INFINITY);
    config.budget.target_score = 0.0;
    assert_eq!(Target::of(&config, Some(10.0)), None);
}

#[test]
fn what_is_out_of_reach_is_told_once_and_shown() {
    let mut controller = start(3.0);
    run(&mut controller, 1.0, 20);
    assert!(controller.take_notes().is_empty() && !controller.held().time_out_of_reach);
    run(&mut controller, 4.0, 20);
    let held = controller.held();
    assert!(held.time_out_of_reach && !held.score_out_of_reach && held.position == 0.0, "{held:?}");
    let notes = controller.take_notes();
    assert!(notes.len() == 1 && notes[0].contains("the target of 3.0 ms is out of reach"), "{notes:?}");
    assert!(notes[0].contains("about 8.0 ms"), "{notes:?}");
    run(&mut controller, 1.0, 200);
    assert!(!controller.held().time_out_of_reach, "it can be met again");
    run(&mut controller, 4.0, 20);
    assert!(controller.held().time_out_of_reach && controller.take_notes().is_empty(), "told once");

    let levels = QualityLevels::of(&points(), &Config::default()).unwrap();
    let mut controller = Controller::new(levels.clone(), Target { ms: f64::INFINITY, score: 9.0 });
    assert!(controller.take_notes()[0].contains("best point has 8.00"));
    assert!(controller.held().score_out_of_reach);
    let mut reached = Controller::new(levels, Target { ms: f64::INFINITY, score: 8.0 });
    assert!(reached.take_notes().is_empty() && !reached.held().score_out_of_reach);
    assert!(start(1.0).expectation().unwrap().contains("2.0 ms") && start(2.0).expectation().is_none());
}

#[test]
fn a_front_of_other_settings_is_told() {
    let mut other = Config::default();
    other.trace.bounces = 2;
    let told = |config: &Config| {
        let levels = QualityLevels::of(&points(), config).unwrap();
        Controller::new(levels, Target { ms: 9.0, score: 10.0 }).take_notes()
    };
    assert!(told(&Config::default()).is_empty());
    assert_eq!(told(&other), [FOREIGN]);
    other = Config::default();
    other.trace.edge_rays = 0;
    assert_eq!(told(&other), [FOREIGN]);
}

#[test]
fn a_stall_is_forgotten_soon() {
    let mut controller = start(11.0);
    run(&mut controller, 1.0, 20);
    let before = controller.held();
    controller.observe(5e5, 0.0);
    controller.observe(5e5, 0.0);
    assert_eq!(controller.held().position, 0.0);
    run(&mut controller, 1.0, 150);
    assert!((controller.held().score - before.score).abs() < 0.2, "{:?}", controller.held());
}

/// Frames whose time is not all in samples and rays, as on a real device: `fixed` is the share of the first
/// step's 2 ms that every frame takes.
struct World {
    controller: Controller,
    fixed: f64,
}

impl World {
    fn new(target: f64, fixed: f64) -> World {
        let cost = |work: f64| 2.0 * (fixed + (1.0 - fixed) * work);
        let points: Vec<OperatingPoint> =
            points().into_iter().map(|p| OperatingPoint { frame_ms: cost(p.samples / 0.01), ..p }).collect();
        let levels = QualityLevels::of(&points, &Config::default()).unwrap();
        World { controller: Controller::new(levels, Target { ms: target, score: 10.0 }), fixed }
    }

    fn cost(&self, load: f64) -> f64 {
        let held = self.controller.held();
        let work = held.samples * f64::from(held.rays) / (0.01 * 32.0);
        2.0 * load * (self.fixed + (1.0 - self.fixed) * work)
    }

    /// A frame of that load, `noise` times as long as it would be; its time without the noise.
    fn frame(&mut self, load: f64, noise: f64) -> f64 {
        let ms = self.cost(load);
        self.controller.observe(ms * noise, 0.0);
        ms
    }
}

/// Times that may come from a broken clock or a machine that slept.
fn any_time() -> impl Strategy<Value = f64> {
    prop_oneof![
        3 => 0.1..100.0f64,
        1 => prop::sample::select(vec![0.0, -1.0, f64::NAN, f64::INFINITY, -f64::INFINITY, f64::MAX, 1e-300, 1e9]),
    ]
}

proptest! {
    #[test]
    fn whatever_is_observed_frames_can_be_made(
        times in prop::collection::vec((any_time(), any_time()), 1..200),
        target in 0.1..1e4f64,
    ) {
        let mut controller = start(target);
        for (frame, pattern) in times {
            let before = controller.held();
            controller.observe(frame, pattern);
            let held = controller.held();
            prop_assert!(held.samples > 0.0 && held.samples <= 1.0, "{:?}", held);
            prop_assert!((1..=4096).contains(&held.rays), "{:?}", held);
            prop_assert!((0.0..=1.0).contains(&held.position), "{:?}", held);
            prop_assert!(held.load.is_finite() && held.load > 0.0, "{:?}", held);
            prop_assert!((4.0..=8.0).contains(&held.score), "{:?}", held);
            prop_assert!(held.score <= before.score + CLIMB + 1e-9, "climbs slowly: {:?} {:?}", before, held);
            if !(frame - pattern > 0.0 && frame.is_finite() && pattern >= 0.0) {
                prop_assert_eq!(before, held);
            }
        }
        prop_assert!(controller.take_notes().len() <= 1);
    }

    /// A view that becomes up to ten times as heavy, where the front reaches that far.
    #[test]
    fn a_heavier_view_is_answered_in_its_third_frame(
        fixed in 0.0..0.3f64,
        heavier in 1.5..10.0f64,
        noise in prop::collection::vec(0.97..1.03f64, 100),
    ) {
        let mut world = World::new(25.0, fixed);
        for noise in &noise[..60] {
            world.frame(1.0, *noise);
        }
        let times: Vec<f64> = noise[60..].iter().map(|noise| world.frame(heavier, *noise)).collect();
        prop_assert!(times[2] < 25.0 * 1.25, "{:?}", times);
        prop_assert!(times[4..].iter().all(|ms| *ms < 25.0 * 1.15), "{:?}", times);
    }

    /// Up and down again: never too slow on the way back, and back in the end.
    #[test]
    fn a_lighter_view_is_answered_slowly_and_fully(
        fixed in 0.0..0.3f64,
        heavy in 1.2..10.0f64,
        noise in prop::collection::vec(0.97..1.03f64, 500),
    ) {
        let mut world = World::new(12.0, fixed);
        for noise in &noise[..50] {
            world.frame(heavy, *noise);
        }
        let mut last = world.controller.held();
        let (mut patterns, mut times) = (0, Vec::new());
        for noise in &noise[50..] {
            times.push(world.frame(1.0, *noise));
            let held = world.controller.held();
            let work = |held: &QualityState| held.samples * f64::from(held.rays);
            // One step of the levels doubles the work; a frame climbs a twentieth of it, and rays are whole.
            prop_assert!((work(&held) / work(&last)).ln() < 0.12, "no jump: {:?} {:?}", last, held);
            patterns += u32::from(held.samples != last.samples);
            last = held;
        }
        prop_assert!(times.iter().all(|ms| *ms < 12.0 * 1.15), "{:?}", times);
        prop_assert!(times[400..].iter().all(|ms| *ms > 12.0 * 0.8), "{:?}", times);
        prop_assert!(patterns <= 8, "{} patterns", patterns);
    }

    /// Frames that stumble now and then, by up to a hundredfold, change nothing for those after them.
    #[test]
    fn single_spikes_are_not_believed(
        spikes in prop::collection::vec((3usize..12, 2.0..100.0f64), 1..20),
        noise in 0.0..0.03f64,
    ) {
        let mut world = World::new(12.0, 0.2);
        for _ in 0..60 {
            world.frame(1.0, 1.0);
        }
        for (gap, spike) in spikes {
            world.frame(1.0, spike);
            for frame in 0..gap {
                let ms = world.frame(1.0, if frame % 2 == 0 { 1.0 + noise } else { 1.0 - noise });
                prop_assert!((12.0 * 0.8..12.0 * 1.1).contains(&ms), "{}", ms);
            }
        }
    }

    /// Noise alone changes patterns rarely: each new one is seen, and takes time.
    #[test]
    fn noise_makes_no_new_patterns(target in 5.0..30.0f64, noise in prop::collection::vec(0.9..1.1f64, 300)) {
        let mut world = World::new(target, 0.2);
        let (mut last, mut changes) = (world.controller.held(), 0);
        for noise in noise {
            world.frame(1.0, noise);
            let held = world.controller.held();
            changes += u32::from(held.samples != last.samples);
            last = held;
        }
        prop_assert!(changes <= 3, "{}", changes);
    }
}
