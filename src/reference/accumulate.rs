//! Light carried from frame to frame and from eye to eye, in `f64`: what `kernels/accumulate.wgsl` does.

use glam::{DMat4, DVec2, DVec3};

use super::reconstruct::nearest;
use crate::math::view::View;
use look_up::{Found, agreement, before, look_across, look_back, what_it_had};
use toward::Toward;

mod look_up;
mod toward;

/// Share of demodulated specular light that counts as brightness.
pub const SPECULAR_SHARE: f64 = 0.1;
/// Rate of the mean that follows quickly.
pub const FAST_RATE: f64 = 0.25;
/// Standard deviations, and part of the mean, within which the quick and the slow mean may differ.
pub const DEVIATIONS: f64 = 3.0;
/// See [`DEVIATIONS`].
pub const UNNOTICED: f64 = 0.03;
/// Estimates that a mean needs before a change of light is looked for, which ends it.
pub const TELLING: f64 = 6.0;
/// Least agreement of surfaces.
pub const LEAST_AGREEMENT: f64 = 0.3;
/// Estimates at most that a mean holds on surfaces whose motion is known.
pub const MOVING_LONGEST: f64 = 8.0;
/// Radians by which a normal turns while a mean is made.
pub const MOVING_TURN: f64 = 0.1;
/// There, standard errors by which a neighbourhood's brightness may be off what it was without estimates being dropped.
pub const GLIDES: f64 = 2.0;
/// Share of a pixel's width from which on a surface is elsewhere than it was.
pub const ELSEWHERE: f64 = 0.1;
/// Where things or lights move, standard errors by which a neighbourhood's brightness is off what it was once light has
/// changed; see `kernels/accumulate.wgsl`.
pub const SUDDEN: f64 = 3.2;
/// Share of the variance in the past that counts at least.
pub const PAST_SHARE: f64 = 0.3;
/// Neighbours at least that tell of such a change.
pub const FEW: f64 = 5.0;
/// There, the weight of what was found on the other side of the sun's shadow: light from around the sun differs there as the sun does.
pub const OTHER_SIDE: f64 = 0.02;
/// Share of what was found on the same side from which on it counts in full: a shadow has come or gone where there is less.
pub const ENOUGH_ON_SIDE: f64 = 0.25;
/// Square of a distance in pixels that counts as none.
pub const SAME_PLACE: f64 = 0.01;
/// What weights are divided by at least.
const LEAST_WEIGHT: f64 = 1e-6;
/// What a penumbra that is not found again is trusted less from frame to frame, and how little ends it.
const CONFIDENCE_KEPT: f64 = 0.9;
const LEAST_CONFIDENCE: f64 = 0.2;

/// A sample of a frame. Light is demodulated; see [`crate::layout::SampleRecord`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Its pixel.
    pub at: [u32; 2],
    /// Diffuse light.
    pub diffuse: DVec3,
    /// Specular light.
    pub specular: DVec3,
    /// Where diffuse light of each colour comes from, within the unit sphere, where that is known: see
    /// [`crate::layout::SampleRecord::toward`].
    pub toward: Option<[DVec3; 3]>,
    /// Depth along the view's axis in metres; not above 0 where there is no surface.
    pub depth: f64,
    /// Unit normal in world orientation, without normal maps.
    pub normal: DVec3,
    /// How far what hides a part of the sun's disc is, as [`crate::layout::SampleRecord::normal`] has it; 0 where that is not
    /// known.
    pub blocker: f64,
    /// Whether the sun's centre is seen.
    pub sun_centre: bool,
    /// The surface's perceptual roughness, 0 to 1.
    pub roughness: f64,
    /// How its surface has moved since the last frame.
    pub motion: Motion,
    /// Estimates that its light counts as: 1, more where it was sent all rays and others fewer, and 0 where it waits for its turn
    /// and has no light of this frame.
    pub estimates: f64,
}

impl Sample {
    /// Whether it waits for its turn.
    pub fn waits(&self) -> bool {
        self.estimates == 0.0
    }
}

/// How a surface has moved since the last frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// It rests.
    Still,
    /// It moves, and nothing else is known.
    Unknown,
    /// As a whole: by the matrix that takes the world's points of it to where they were.
    Whole(DMat4),
}

/// Where a sample's surface was, seen from the last frame's eye.
struct Before {
    point: DVec3,
    normal: DVec3,
    longest: f64,
    alike_reflection: f64,
}

/// What is known of a sample besides its light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct History {
    /// Estimates in the mean of the diffuse and of the specular part.
    pub ages: [f64; 2],
    /// Mean brightness around the sample over few frames, over many, and its variance.
    pub fast: f64,
    /// See `fast`.
    pub slow: f64,
    /// See `fast`.
    pub variance: f64,
    /// How lately the penumbra was found: 1 in this frame.
    pub confidence: f64,
}

/// A frame as later ones look it up.
#[derive(Clone, Debug)]
pub struct Kept {
    /// The view.
    pub view: View,
    /// Its samples, with accumulated light where a history stands beside.
    pub samples: Vec<Sample>,
    /// One for each sample; empty for another eye's frame, of which only fresh light is taken.
    pub histories: Vec<History>,
}

/// How strictly surfaces are kept apart, and for how long light is remembered.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Exponent of the cosine between normals.
    pub normal_power: f64,
    /// Sine of the angle at which a point off the plane has lost all but 1/e of its weight.
    pub plane_tolerance: f64,
    /// Samples that are nearest to a pixel and looked up.
    pub k: usize,
    /// Samples around one that tell whether light has changed.
    pub neighbours: usize,
    /// Estimates at most in a mean.
    pub longest: f64,
    /// Whether things or lights move, so that light may be other than it was.
    pub light_changes: bool,
    /// Estimates that a sample counts as that is sent all rays where others are sent fewer.
    pub estimates: f64,
    /// Whether samples that wait are where they were in the last frame.
    pub rests: bool,
}

/// The samples with the light that was found before, and their histories.
pub fn accumulate(
    view: &View,
    fresh: &[Sample],
    last: Option<&Kept>,
    other: Option<&Kept>,
    settings: &Settings,
) -> (Vec<Sample>, Vec<History>) {
    (0..fresh.len()).map(|index| one(view, fresh, index, last, other, settings)).unzip()
}

fn one(
    view: &View,
    fresh: &[Sample],
    index: usize,
    last: Option<&Kept>,
    other: Option<&Kept>,
    settings: &Settings,
) -> (Sample, History) {
    let sample = fresh[index];
    let waits = sample.waits();
    let own = if sample.motion == Motion::Still { sample.estimates } else { sample.estimates.min(1.0) };
    let sees_a_surface = waits && sample.depth > 0.0;
    if !usable(&sample) && !sees_a_surface {
        return (sample, History::default());
    }
    let point = point_of(view, &sample);
    let lent = other.and_then(|kept| look_across(kept, view, &sample, point, settings));
    let lent = lent.unwrap_or_default();
    let [lent_weight, lent_gloss_weight] = lent.weights;
    let (value, error) = brightness_around(view, fresh, index, settings);
    let past = last.map(|kept| before(kept, view, &sample, point, settings));
    let unknown = if sample.motion == Motion::Still { settings.longest } else { 1.0 };
    let longest = past.as_ref().map_or(unknown, |past| past.longest);
    let mut history = History { fast: value, slow: value, ..History::default() };
    let mut found = (sample.diffuse, sample.specular, 0.0);
    let (mut found_toward, mut found_directed) = (Toward::default(), false);
    if let Some((past, Found { diffuse, specular, toward, directed, blocker: shadow, history: old })) =
        last.zip(past).and_then(|(kept, past)| {
            let old = match waits && settings.rests {
                true => what_it_had(kept, index),
                false => look_back(kept, view, &sample, &past, settings),
            };
            old.map(|old| (past, old))
        })
    {
        history = match waits {
            true => old,
            false => followed(&old, (value, error), longest, settings),
        };
        let kept = match sample.motion == Motion::Still || waits {
            true => 1.0,
            false => kept_in_motion(&old, value, error),
        };
        history.ages[0] *= kept;
        history.ages[1] *= kept * past.alike_reflection;
        found = (diffuse, specular, shadow);
        (found_toward, found_directed) = (toward, directed);
    }
    if waits && history.ages[0] + lent_weight <= 0.0 {
        return (sample, History::default());
    }
    let (estimates, glossy_estimates) = (own + lent_weight, own + lent_gloss_weight);
    let ages =
        [(history.ages[0] + estimates).min(longest), (history.ages[1] + glossy_estimates).min(longest)];
    let light = (sample.diffuse * own + lent.diffuse * lent_weight) / estimates.max(LEAST_WEIGHT);
    let gloss =
        (sample.specular * own + lent.specular * lent_gloss_weight) / glossy_estimates.max(LEAST_WEIGHT);
    let confidence = if waits { history.confidence } else { CONFIDENCE_KEPT * history.confidence };
    let is_kept = history.ages[0] > 0.0 && confidence > LEAST_CONFIDENCE;
    let kept_shadow = if is_kept { found.2 } else { 0.0 };
    history.confidence = match (sample.blocker > 0.0, is_kept) {
        (true, _) => 1.0,
        (false, true) => confidence,
        (false, false) => 0.0,
    };
    let blocker = match (sample.blocker > 0.0, kept_shadow > 0.0) {
        (true, true) => kept_shadow + (sample.blocker - kept_shadow) * (own / ages[0]).min(1.0),
        _ => sample.blocker.max(kept_shadow),
    };
    let part = (estimates / ages[0]).min(1.0);
    let toward = match (waits, sample.toward) {
        (true, _) => found_directed.then(|| toward::mean(&found_toward, Default::default())),
        (false, None) => None,
        (false, Some(fresh)) => {
            let of_estimate = part / estimates.max(LEAST_WEIGHT);
            let parts = [
                (1.0 - part, found_toward),
                (of_estimate * lent_weight, lent.toward),
                (of_estimate * own, toward::of(&sample)),
            ];
            Some(toward::mean(&toward::sum(parts), fresh))
        }
    };
    let mixed = Sample {
        diffuse: found.0.lerp(light, part),
        toward,
        specular: found.1.lerp(gloss, (glossy_estimates / ages[1].max(LEAST_WEIGHT)).min(1.0)),
        blocker,
        estimates: 1.0,
        ..sample
    };
    (mixed, History { ages, ..history })
}

fn usable(sample: &Sample) -> bool {
    !sample.waits()
        && sample.diffuse.is_finite()
        && sample.specular.is_finite()
        && sample.depth.is_finite()
        && sample.depth > 0.0
}

/// A sample's surface point relative to the eye, in world orientation.
fn point_of(view: &View, sample: &Sample) -> DVec3 {
    let pixel = DVec2::new(f64::from(sample.at[0]) + 0.5, f64::from(sample.at[1]) + 0.5);
    view.world_from_eye.rotation * view.eye_direction(pixel) * sample.depth
}

/// `to`'s eye relative to `from`'s.
fn offset(to: &View, from: &View) -> DVec3 {
    to.world_from_eye.position - from.world_from_eye.position
}

/// The width of a sample's pixel at depth 1 metre, across or down, whichever is more.
fn pixel_width(view: &View, sample: &Sample) -> f64 {
    let centre = DVec2::new(f64::from(sample.at[0]) + 0.5, f64::from(sample.at[1]) + 0.5);
    (view.fov.right - view.fov.left) / f64::from(view.picture().width) * view.pixel_scale(centre)
}

/// The part of what was found on a surface that moves which is kept.
fn kept_in_motion(last: &History, value: f64, error: Option<f64>) -> f64 {
    let limit = GLIDES.powi(2) * error.unwrap_or(0.0) + (UNNOTICED * last.slow).powi(2);
    (limit / (value - last.slow).powi(2)).min(1.0)
}

fn brightness(sample: &Sample) -> f64 {
    (sample.diffuse + sample.specular * SPECULAR_SHARE).dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// The mean brightness around a sample, and that mean's squared standard error, where there are enough samples to tell.
fn brightness_around(view: &View, fresh: &[Sample], index: usize, settings: &Settings) -> (f64, Option<f64>) {
    let sample = &fresh[index];
    let (point, width) = (point_of(view, sample), pixel_width(view, sample) * sample.depth);
    let positions: Vec<[u32; 2]> = fresh.iter().map(|sample| sample.at).collect();
    let mut values = Vec::new();
    for near in nearest(&positions, sample.at, settings.neighbours) {
        let other = &fresh[near.sample];
        if usable(other) && (other.sun_centre == sample.sun_centre || !settings.light_changes) {
            let there = point_of(view, other);
            let weight = agreement(point, sample.normal, there, other.normal, width, settings);
            values.push((weight, brightness(other)));
        }
    }
    let weights: f64 = values.iter().map(|(weight, _)| weight).sum();
    if weights <= 0.0 {
        return (brightness(sample), None);
    }
    let mean = values.iter().map(|(weight, value)| weight * value).sum::<f64>() / weights;
    let variance =
        values.iter().map(|(weight, value)| weight * (value - mean).powi(2)).sum::<f64>() / weights;
    let squared: f64 = values.iter().map(|(weight, _)| weight * weight).sum();
    // Kish's effective number of values is the square of the weights' sum over this.
    let free = weights * weights / squared - 1.0;
    (mean, (free > FEW - 1.0).then(|| variance / free))
}

/// The means with one more value; where they tell that light has changed, all estimates begin anew.
fn followed(
    last: &History,
    (value, error): (f64, Option<f64>),
    longest: f64,
    &Settings { light_changes, estimates, .. }: &Settings,
) -> History {
    let rate = 1.0 / (last.ages[0].min(longest) + 1.0);
    let mix = |from: f64, to: f64, rate: f64| from + (to - from) * rate;
    let mut history = History {
        ages: last.ages,
        fast: mix(last.fast, value, rate.max(FAST_RATE)),
        slow: mix(last.slow, value, rate),
        variance: last.variance,
        confidence: last.confidence,
    };
    // Where few of the neighbours have found much, chance has.
    let of_fast = FAST_RATE / (2.0 - FAST_RATE) * last.variance + FAST_RATE.powi(2) * error.unwrap_or(0.0);
    let limit = DEVIATIONS.powi(2) * of_fast + (UNNOTICED * last.slow).powi(2);
    let spread = |error: f64| error.max(PAST_SHARE * last.variance) * (1.0 + rate);
    let sudden = |error: f64| SUDDEN.powi(2) * spread(error) + (UNNOTICED * last.slow).powi(2);
    let is_sudden = light_changes && error.is_some_and(|error| (value - last.slow).powi(2) > sudden(error));
    let telling = TELLING.max((TELLING * estimates).min(0.5 * longest));
    if (last.ages[0] >= telling && (history.fast - history.slow).powi(2) > limit) || is_sudden {
        History { ages: [0.0; 2], fast: value, slow: value, ..history }
    } else {
        history.variance = mix(last.variance, (value - last.slow).powi(2), rate);
        history
    }
}

#[cfg(test)]
mod tests;
