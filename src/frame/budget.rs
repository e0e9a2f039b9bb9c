//! Holds the frame's time: from what frames cost to where on the front the next one is.
//!
//! All of it is arithmetic on numbers that are handed in: no clock, no device.

use serde::{Deserialize, Serialize};

use super::front::on_front;
use crate::config::{Config, OperatingPoint, Samples, TargetMs, preset};
use crate::error::{Error, Result};

/// The share of the display's period that a frame may take: the rest is for the compositor.
const DISPLAY_SHARE: f64 = 0.9;
/// How much of the way to a heavier view is believed at once. One slow frame alone is not believed, so a
/// view that becomes heavier is answered in the third of its frames.
const HEAVIER: f64 = 0.9;
/// How much of the way to a lighter view is believed with each frame: some 45 frames for nine tenths.
const LIGHTER: f64 = 0.05;
/// Steps of the front that are climbed with each frame at most.
const CLIMB: f64 = 0.05;
/// New patterns' share of the load is averaged over some 20 frames.
const PATTERNS: f64 = 0.05;
/// Numbers of samples are powers of two to multiples of one half, since each new one needs new patterns;
/// the rays make up for what is lost by rounding.
const SAMPLE_STEPS: f64 = 2.0;
/// How far the wanted number of samples goes from the current one, in steps, before that changes.
const HOLD_ON: f64 = 0.75;

/// Points of one family, cheapest first, each dearer and better than the one before: they differ in
/// numbers of samples and rays alone, so that frames may move between them unseen.
#[derive(Clone, Debug, PartialEq)]
pub struct Ladder {
    steps: Vec<OperatingPoint>,
}

impl Ladder {
    /// The best ladder among points: of the family that `config` belongs to where that has at least two
    /// steps, else of the family with the most steps. `None` without points.
    pub fn of(points: &[OperatingPoint], config: &Config) -> Option<Ladder> {
        let given = OperatingPoint::of(config, 1, 1.0, 0.0);
        let own = Ladder::family(points, &given);
        if own.len() >= 2 {
            return Some(Ladder { steps: own });
        }
        let families = points.iter().map(|point| Ladder::family(points, point));
        families.max_by_key(Vec::len).filter(|steps| !steps.is_empty()).map(|steps| Ladder { steps })
    }

    /// The front among points that differ from `member` in samples and rays only.
    fn family(points: &[OperatingPoint], member: &OperatingPoint) -> Vec<OperatingPoint> {
        let family: Vec<OperatingPoint> = points.iter().filter(|p| p.same_family(member)).copied().collect();
        let values: Vec<(f64, f64)> = family.iter().map(|p| (p.frame_ms, p.score)).collect();
        let mut steps: Vec<OperatingPoint> =
            family.into_iter().zip(on_front(&values)).filter(|(_, best)| *best).map(|(p, _)| p).collect();
        steps.sort_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms));
        steps
    }

    /// The last step.
    fn top(&self) -> f64 {
        (self.steps.len() - 1) as f64
    }

    /// A value between the steps around a position.
    fn between(&self, position: f64, value: impl Fn(&OperatingPoint) -> f64) -> f64 {
        let position = position.clamp(0.0, self.top());
        let low = position.floor();
        let (a, b) = (&self.steps[low as usize], &self.steps[(low as usize + 1).min(self.steps.len() - 1)]);
        let (a, b) = (value(a), value(b));
        a + (b - a) * (position - low)
    }

    /// The same between the logarithms of values above 0.
    fn between_logs(&self, position: f64, value: impl Fn(&OperatingPoint) -> f64) -> f64 {
        self.between(position, |p| value(p).ln()).exp()
    }

    /// The highest position up to which a value that grows along the ladder is at most `limit`; 0 where
    /// none is.
    fn reach(&self, limit: f64, value: impl Fn(&OperatingPoint) -> f64) -> f64 {
        let above = self.steps.iter().position(|p| value(p) > limit);
        let Some(above) = above else { return self.top() };
        if above == 0 {
            return 0.0;
        }
        let (low, high) = (value(&self.steps[above - 1]), value(&self.steps[above]));
        (above - 1) as f64 + (limit - low) / (high - low)
    }
}

/// What frames are held to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Milliseconds of a frame at most; infinite where only a score is wanted.
    pub ms: f64,
    /// The score to stay at where time allows; 10 for as good as possible.
    pub score: f64,
}

impl Target {
    /// What the settings ask for, on a display of that period where there is one; `None` where they ask
    /// for nothing.
    pub fn of(config: &Config, display_period_ms: Option<f64>) -> Option<Target> {
        let ms = match (config.budget.target_ms, display_period_ms) {
            (TargetMs::Ms(ms), _) => Some(ms),
            (TargetMs::Display, Some(period)) if period.is_finite() && period > 0.0 => {
                Some(period * DISPLAY_SHARE)
            }
            _ => None,
        };
        let score = Some(config.budget.target_score).filter(|score| *score > 0.0);
        if ms.is_none() && score.is_none() {
            return None;
        }
        Some(Target { ms: ms.unwrap_or(f64::INFINITY), score: score.unwrap_or(10.0) })
    }
}

/// What a frame is to be made with.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Held {
    /// Milliseconds that it may take; `null` where only a score is wanted.
    pub target_ms: Option<f64>,
    /// Where it is on the ladder: 0 the fastest, 1 the best.
    pub position: f64,
    /// How much dearer frames are than where the front was measured.
    pub load: f64,
    /// The score that the front promises there.
    pub score: f64,
    /// Samples as a share of the pixels.
    pub samples: f64,
    /// Light rays per sample.
    pub rays: u32,
}

/// Moves along a ladder so that frames take the time that they may.
#[derive(Clone, Debug)]
pub struct Controller {
    ladder: Ladder,
    target: Target,
    /// Highest position that the wanted score needs.
    ceiling: f64,
    position: f64,
    /// Milliseconds of a frame over those of the ladder; none before the first frame.
    load: Option<f64>,
    /// The last frame's own load.
    last: Option<f64>,
    /// Average milliseconds of new patterns.
    patterns: f64,
    /// The samples' current step: their share is 2^(step / 2).
    sample_step: f64,
}

impl Controller {
    /// Starts where the ladder's own times say that the target is met.
    pub fn new(ladder: Ladder, target: Target) -> Controller {
        let ceiling = match target.score {
            score if score >= 10.0 => ladder.top(),
            // The first position that has the score.
            score => ladder.reach(score, |p| p.score),
        };
        let position = ladder.reach(target.ms, |p| p.frame_ms).min(ceiling);
        let mut controller = Controller {
            ladder,
            target,
            ceiling,
            position,
            load: None,
            last: None,
            patterns: 0.0,
            sample_step: 0.0,
        };
        controller.sample_step = controller.wanted_step().round();
        controller
    }

    /// What the next frame is to be made with.
    pub fn held(&self) -> Held {
        let work = self.ladder.between_logs(self.position, |p| p.samples * f64::from(p.rays));
        let samples = (self.sample_step / SAMPLE_STEPS).exp2().min(1.0);
        Held {
            target_ms: Some(self.target.ms).filter(|ms| ms.is_finite()),
            position: if self.ladder.top() > 0.0 { self.position / self.ladder.top() } else { 1.0 },
            load: self.load.unwrap_or(1.0),
            score: self.ladder.between(self.position, |p| p.score),
            samples,
            rays: (work / samples).round().clamp(1.0, 4096.0) as u32,
        }
    }

    /// The settings of the next frame.
    pub fn config(&self, base: &Config) -> Config {
        let held = self.held();
        let mut config = self.ladder.steps[0].applied_to(base);
        config.foveation.samples = Samples::Share(held.samples);
        config.trace.rays = held.rays;
        config
    }

    /// Takes in what a frame cost, of which `pattern_ms` went to new patterns: those come with the gaze,
    /// and say nothing about how heavy the view is. Times that are no times are left out.
    pub fn observe(&mut self, frame_ms: f64, pattern_ms: f64) {
        let own = frame_ms - pattern_ms;
        if !(own.is_finite() && own > 0.0 && pattern_ms >= 0.0) {
            return;
        }
        let found = own / self.ladder.between_logs(self.position, |p| p.frame_ms);
        let heavy = found.min(self.last.unwrap_or(found));
        self.last = Some(found);
        let load = self.load.unwrap_or(found);
        let load = if heavy > load {
            load + (heavy - load) * HEAVIER
        } else {
            load + (found.min(load) - load) * LIGHTER
        };
        self.load = Some(load);
        self.patterns += (pattern_ms - self.patterns) * PATTERNS;
        self.step(load);
    }

    fn step(&mut self, load: f64) {
        // Patterns never take more than half of the time from what frames are made for.
        let own = (self.target.ms - self.patterns).max(self.target.ms * 0.5);
        let wanted = self.ladder.reach(own / load, |p| p.frame_ms).min(self.ceiling);
        self.position = wanted.min(self.position + CLIMB);
        let step = self.wanted_step();
        if (step - self.sample_step).abs() > HOLD_ON {
            self.sample_step = step.round();
        }
    }

    /// The samples' step at the current position, between whole ones.
    fn wanted_step(&self) -> f64 {
        self.ladder.between(self.position, |p| p.samples.log2()) * SAMPLE_STEPS
    }
}

/// The controller that the settings ask for, on a display of that period where there is one. Without a
/// front of its own it moves along that of the preset "balanced".
///
/// # Errors
/// [`Error::Setting`] where the front has no point that can be used.
pub fn controller(config: &Config, display_period_ms: Option<f64>) -> Result<Option<Controller>> {
    let Some(target) = Target::of(config, display_period_ms) else { return Ok(None) };
    let usual;
    let points = if config.budget.front.is_empty() {
        usual = preset::front("balanced")?;
        &usual
    } else {
        &config.budget.front
    };
    match Ladder::of(points, config) {
        Some(ladder) => Ok(Some(Controller::new(ladder, target))),
        None => Err(Error::setting("budget.front", "it has no points; give what foveate measure wrote")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Method;

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
        let ladder = Ladder::of(&points(), &Config::default()).unwrap();
        Controller::new(ladder, Target { ms, score: 10.0 })
    }

    /// What a frame costs where views weigh `load`: in proportion to samples and rays.
    fn cost(held: &Held, load: f64) -> f64 {
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

    #[test]
    fn steps_are_small_on_the_way_back() {
        let mut controller = start(11.0);
        run(&mut controller, 3.0, 50);
        let mut last = controller.held();
        let mut changes = 0;
        for _ in 0..400 {
            run(&mut controller, 1.0, 1);
            let next = controller.held();
            let work = |held: &Held| held.samples * f64::from(held.rays);
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
        let ladder = Ladder::of(&points(), &Config::default()).unwrap();
        let mut controller = Controller::new(ladder.clone(), Target { ms: 100.0, score: 5.5 });
        run(&mut controller, 1.0, 200);
        assert!((controller.held().score - 5.5).abs() < 1e-9);
        let without_time = Controller::new(ladder, Target { ms: f64::INFINITY, score: 6.0 });
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
    fn ladders_keep_to_one_family() {
        let mut mixed = points();
        mixed.push(OperatingPoint { method: Method::KNearest, frame_ms: 1.0, score: 9.0, ..mixed[0] });
        mixed.push(OperatingPoint { frame_ms: 9.0, score: 2.0, ..mixed[0] });
        let ladder = Ladder::of(&mixed, &Config::default()).unwrap();
        assert_eq!(ladder.steps, points());
        let mut other = Config::default();
        other.trace.bounces = 2;
        assert_eq!(Ladder::of(&mixed, &other).unwrap().steps.len(), 5, "the family with most steps");
        assert_eq!(Ladder::of(&[], &other), None);
        let one = Ladder::of(&mixed[5..6], &other).unwrap();
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
}
