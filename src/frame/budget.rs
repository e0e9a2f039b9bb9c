//! Holds the frame's time: from what frames cost to where on the front the next one is.
//!
//! All of it is arithmetic on numbers that are handed in: no clock, no device.
//!
//! Where a frame's time is to be held, [`Controller`] takes what frames cost and tells the samples and rays
//! of the next one, along the front that `foveate measure` has found (`budget.front`) or that of the preset
//! (`src/frame/quality_levels.rs`: of it, the points that differ in samples and rays alone, so that frames
//! move between them unseen). Two slow frames in a row count nearly whole, so that the third is in time
//! again; one alone counts nothing, and lighter views are believed slowly. What is out of reach is told once.
//! `Renderer::set_quality` takes what it says from frame to frame.

use serde::{Deserialize, Serialize};

use super::quality_levels::QualityLevels;
use crate::config::{Config, Quality, Samples, TargetMs, preset};
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
/// Frames in a row for which not even the first step is fast enough, before the target counts as out of reach.
const OUT_OF_REACH: u32 = 5;
/// On the way back to a lighter view a load beyond this many times what the first step can bear is forgotten at
/// once: it made no difference, and would only make the way longer.
const FORGOTTEN: f64 = 2.0;
/// Loads at most, so that numbers stay finite.
const HEAVIEST: f64 = 1e12;
/// New patterns' share of the load is averaged over some 20 frames.
const PATTERNS: f64 = 0.05;
/// Numbers of samples are powers of two to multiples of one half, since each new one needs new patterns;
/// the rays make up for what is lost by rounding.
const SAMPLE_STEPS: f64 = 2.0;
/// How far the wanted number of samples goes from the current one, in steps, before that changes.
const HOLD_ON: f64 = 0.75;

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
pub struct QualityState {
    /// Milliseconds that it may take; `null` where only a score is wanted.
    pub target_ms: Option<f64>,
    /// Where it is on the levels: 0 the fastest, 1 the best.
    pub position: f64,
    /// How much dearer frames are than where the front was measured.
    pub load: f64,
    /// The score that the front promises there.
    pub score: f64,
    /// Samples as a share of the pixels.
    pub samples: f64,
    /// Light rays per sample.
    pub rays: u32,
    /// Not even the front's fastest point meets the time: frames are made with it.
    pub time_out_of_reach: bool,
    /// Not even the front's best point has the wanted score.
    pub score_out_of_reach: bool,
}

/// Moves along quality levels so that frames take the time that they may.
#[derive(Clone, Debug)]
pub struct Controller {
    levels: QualityLevels,
    target: Target,
    /// Highest position that the wanted score needs.
    ceiling: f64,
    position: f64,
    /// Milliseconds of a frame over those of the levels; none before the first frame.
    load: Option<f64>,
    /// The last frame's own load.
    last: Option<f64>,
    /// Average milliseconds of new patterns.
    patterns: f64,
    /// The samples' current step: their share is 2^(step / 2).
    sample_step: f64,
    /// Frames in a row for which the time was out of reach.
    beyond: u32,
    /// Sentences for the operator, each once.
    notes: Vec<String>,
    /// That the time is out of reach was told.
    told: bool,
}

impl Controller {
    /// Starts where the levels' own times say that the target is met.
    pub fn new(levels: QualityLevels, target: Target) -> Controller {
        let ceiling = match target.score {
            score if score >= 10.0 => levels.top(),
            // The first position that has the score.
            score => levels.reach(score, |p| p.score),
        };
        let position = levels.reach(target.ms, |p| p.frame_ms).min(ceiling);
        let mut controller = Controller {
            levels,
            target,
            ceiling,
            position,
            load: None,
            last: None,
            patterns: 0.0,
            sample_step: 0.0,
            beyond: 0,
            notes: Vec::new(),
            told: false,
        };
        controller.sample_step = controller.wanted_step().round();
        if controller.levels.foreign {
            controller.notes.push(FOREIGN.to_string());
        }
        if controller.score_out_of_reach() {
            let (wanted, best) =
                (controller.target.score, controller.levels.between(f64::INFINITY, |p| p.score));
            controller.notes.push(format!(
                "the target score of {wanted} is out of reach: the front's best point has {best:.2}; measure \
                 a front with better ones, or ask for less"
            ));
        }
        controller
    }

    /// Sentences for the operator that have not been told yet: what is out of reach, each once.
    pub fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    /// A sentence where the front's own times say that the target will be missed: for who makes one frame
    /// and has none to learn from.
    pub fn expectation(&self) -> Option<String> {
        let (fastest, target) = (self.levels.steps()[0].frame_ms, self.target.ms);
        (fastest > target).then(|| {
            format!(
                "the front's fastest point took {fastest:.1} ms where it was measured, longer than the {target} ms \
                 wanted; it is used"
            )
        })
    }

    fn score_out_of_reach(&self) -> bool {
        self.target.score < 10.0 && self.levels.steps().iter().all(|step| step.score < self.target.score)
    }

    /// Holds another target from now on, such as that of a display whose period has changed.
    pub fn retarget(&mut self, target: Target) {
        if self.target == target {
            return;
        }
        let fresh = Controller::new(self.levels.clone(), target);
        (self.target, self.ceiling) = (target, fresh.ceiling);
        match self.load {
            Some(load) => self.step(load),
            None => *self = Controller { notes: std::mem::take(&mut self.notes), ..fresh },
        }
    }

    /// What the next frame is to be made with.
    pub fn held(&self) -> QualityState {
        let work = self.levels.between_logs(self.position, |p| p.samples * f64::from(p.rays));
        let samples = (self.sample_step / SAMPLE_STEPS).exp2().min(1.0);
        QualityState {
            target_ms: Some(self.target.ms).filter(|ms| ms.is_finite()),
            position: if self.levels.top() > 0.0 { self.position / self.levels.top() } else { 1.0 },
            load: self.load.unwrap_or(1.0),
            score: self.levels.between(self.position, |p| p.score),
            samples,
            rays: (work / samples).round().clamp(1.0, 4096.0) as u32,
            time_out_of_reach: self.beyond >= OUT_OF_REACH,
            score_out_of_reach: self.score_out_of_reach(),
        }
    }

    /// The quality of the next frame, where light of further bounces comes from where it came `before`.
    pub fn quality(&self, before: Quality) -> Quality {
        let held = self.held();
        let first = self.levels.steps()[0].quality(before);
        Quality { samples: Samples::Share(held.samples), rays: held.rays, ..first }
    }

    /// Takes in what a frame cost, of which `pattern_ms` went to new patterns: those come with the gaze,
    /// and say nothing about how heavy the view is. Times that are no times are left out.
    pub fn observe(&mut self, frame_ms: f64, pattern_ms: f64) {
        let own = frame_ms - pattern_ms;
        if !(own.is_finite() && own > 0.0 && pattern_ms >= 0.0) {
            return;
        }
        let found = (own / self.levels.between_logs(self.position, |p| p.frame_ms)).min(HEAVIEST);
        let heavy = found.min(self.last.unwrap_or(found));
        self.last = Some(found);
        let load = self.load.unwrap_or(found);
        let load = if heavy > load {
            load + (heavy - load) * HEAVIER
        } else {
            let bearable = self.target.ms / self.levels.steps()[0].frame_ms;
            let load = load.min(found.max(FORGOTTEN * bearable));
            load + (found.min(load) - load) * LIGHTER
        };
        self.load = Some(load);
        self.patterns += (pattern_ms - self.patterns) * PATTERNS;
        self.step(load);
        self.watch(load);
    }

    /// Takes in what a frame cost whose samples took turns: nothing grows by what that saves, which would end the rest, but a
    /// time that is missed all the same counts.
    pub fn observe_at_rest(&mut self, frame_ms: f64, pattern_ms: f64) {
        if frame_ms > self.target.ms {
            return self.observe(frame_ms, pattern_ms);
        }
        // Slow frames with such a one between them do not follow each other.
        self.last = Some(0.0);
        self.beyond = 0;
    }

    /// Notices where not even the first step is fast enough.
    fn watch(&mut self, load: f64) {
        let least = load * self.levels.steps()[0].frame_ms + self.patterns;
        self.beyond = if least > self.target.ms { self.beyond.saturating_add(1) } else { 0 };
        if self.beyond == OUT_OF_REACH && !self.told {
            self.told = true;
            self.notes.push(format!(
                "the target of {:.1} ms is out of reach: frames take about {least:.1} ms with the front's fastest \
                 point; give a smaller picture, a larger --target-ms, or a front with faster points",
                self.target.ms
            ));
        }
    }

    fn step(&mut self, load: f64) {
        // Patterns never take more than half of the time from what frames are made for.
        let own = (self.target.ms - self.patterns).max(self.target.ms * 0.5);
        let wanted = self.levels.reach(own / load, |p| p.frame_ms).min(self.ceiling);
        self.position = wanted.min(self.position + CLIMB);
        let step = self.wanted_step();
        if (step - self.sample_step).abs() > HOLD_ON {
            self.sample_step = step.round();
        }
    }

    /// The samples' step at the current position, between whole ones.
    fn wanted_step(&self) -> f64 {
        self.levels.between(self.position, |p| p.samples.log2()) * SAMPLE_STEPS
    }
}

/// What is told where frames cannot be made with the settings that were given.
const FOREIGN: &str = "the front has no points with these settings of law, bounces, edge rays and reconstruction; \
                       frames are made with those of the front (budget.front, --preset)";

/// Has a controller hold what the settings ask for on a display whose period may be told late, or change; there
/// is none as long as there is nothing to hold.
///
/// # Errors
/// As [`controller`].
pub fn follow(held: &mut Option<Controller>, config: &Config, display_period_ms: Option<f64>) -> Result<()> {
    match (held.as_mut(), Target::of(config, display_period_ms)) {
        (None, Some(_)) => *held = controller(config, display_period_ms)?,
        (Some(controller), Some(target)) => controller.retarget(target),
        _ => {}
    }
    Ok(())
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
    match QualityLevels::of(points, config) {
        Some(levels) => Ok(Some(Controller::new(levels, target))),
        None => Err(Error::setting("budget.front", "it has no points; give what foveate measure wrote")),
    }
}

#[cfg(test)]
mod tests;
