//! From an eye tracker's raw samples to the point that the pattern is centred on.
//!
//! In a fixation the gaze is smoothed by a filter whose cut-off rises with the eye's speed (the 1€ filter
//! of Casiez, Roussel and Vogel 2012, on directions). A saccade is told by its speed and followed at once,
//! with a wider centre while it lasts. A dropout, such as a blink, is held for a moment and then eased
//! back to the view's optical centre.

use glam::{DVec2, DVec3};

use crate::math::view::View;

/// How long a gaze is held after its last valid sample, in seconds; a blink is mostly shorter.
pub const HOLD: f64 = 0.15;
/// How long the way back to the optical centre takes after that, in seconds.
pub const EASE: f64 = 0.3;
/// Angular speed above which the eye is in a saccade, in degrees per second.
pub const SACCADE_SPEED: f64 = 100.0;
/// How much wider the centre is during a saccade: the eye lands somewhere near its newest sample.
pub const SACCADE_WIDENING: f64 = 1.5;

/// How long the widening takes to fade after a saccade's last sample, in seconds.
const WIDENING_FADE: f64 = 0.1;
/// Least time over which speed is measured, in seconds: trackers of 1 kHz jitter from sample to sample.
const SPEED_SPAN: f64 = 0.005;
/// Cut-off of the smoothing at rest in hertz, and how much it rises per degree per second.
const CUTOFF: f64 = 2.0;
const CUTOFF_PER_SPEED: f64 = 0.25;

/// Where an eye looks, as a tracker tells it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GazeTarget {
    /// A direction in eye space (it looks along -Z), of any length.
    Direction(DVec3),
    /// A point of the image, in 0..1 from the upper left corner.
    Image(DVec2),
}

/// One sample of an eye tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GazeSample {
    /// When the eye was seen, in seconds of any clock.
    pub time: f64,
    /// Where it looked.
    pub target: GazeTarget,
    /// What the tracker itself thinks of the sample; false during blinks.
    pub valid: bool,
}

/// What a gaze point rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GazeState {
    /// The eye rests on something, or follows it slowly.
    Fixation,
    /// The eye jumps.
    Saccade,
    /// The last gaze known is held, or eased back to the optical centre.
    Dropout,
    /// Nothing is known: the optical centre.
    Fallback,
}

/// The gaze to sample for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GazePoint {
    /// Point of the image in 0..1 from the upper left corner; finite, at times outside the image.
    pub point: DVec2,
    /// Factor for the width of the region of full density, at least 1: see
    /// [`Law::widened`](super::Law::widened).
    pub widening: f64,
    /// What the point rests on.
    pub state: GazeState,
}

/// Turns raw gaze samples into gaze points; pure, with no clock of its own.
///
/// Samples that are invalid, point behind the eye or hold values that are not finite are dropped. So are
/// those older than the newest one, unless they are older by more than [`HOLD`]: then the clock was set
/// back, and the filter starts anew.
#[derive(Clone, Debug, Default)]
pub struct GazeFilter {
    track: Option<Track>,
}

/// What is known of an eye that was seen.
#[derive(Clone, Copy, Debug)]
struct Track {
    /// Time of the newest valid sample.
    time: f64,
    /// The smoothed gaze, a unit vector.
    gaze: DVec3,
    /// A raw sample at least [`SPEED_SPAN`] old, from which speed is measured.
    anchor: (f64, DVec3),
    /// Time of the last sample in a saccade.
    saccade: Option<f64>,
}

impl GazeFilter {
    /// A filter that has seen nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes a sample; `view` is the eye's view, for the meaning of image points.
    pub fn push(&mut self, view: &View, sample: GazeSample) {
        let Some(direction) = usable_direction(view, &sample) else { return };
        let time = sample.time;
        self.track = Some(match self.track {
            Some(track) if time > track.time && time - track.time <= HOLD => track.followed(time, direction),
            Some(track) if time <= track.time && track.time - time <= HOLD => track,
            _ => Track { time, gaze: direction, anchor: (time, direction), saccade: None },
        });
    }

    /// The gaze to sample for at a time of the samples' clock, in seconds.
    ///
    /// A time that is not a number, or more than [`HOLD`] before the newest sample, gets the fallback.
    pub fn at(&self, view: &View, time: f64) -> GazePoint {
        let centre = view.optical_centre();
        let fallback = GazePoint { point: centre, widening: 1.0, state: GazeState::Fallback };
        let Some(track) = self.track else { return fallback };
        let age = time - track.time;
        if !(-HOLD..HOLD + EASE).contains(&age) {
            return fallback;
        }
        let Some(point) = image_point(view, track.gaze) else { return fallback };
        let widening = track.saccade.map_or(1.0, |last| {
            1.0 + (SACCADE_WIDENING - 1.0) * (1.0 - smoothstep((time - last) / WIDENING_FADE))
        });
        let state = match age {
            age if age > HOLD => GazeState::Dropout,
            _ if track.saccade == Some(track.time) => GazeState::Saccade,
            _ => GazeState::Fixation,
        };
        GazePoint { point: point.lerp(centre, smoothstep((age - HOLD) / EASE)), widening, state }
    }
}

impl Track {
    /// The track after a sample soon after the last.
    fn followed(self, time: f64, direction: DVec3) -> Track {
        let (since, from) = self.anchor;
        let speed = from.angle_between(direction).to_degrees() / (time - since).max(SPEED_SPAN);
        let anchor = if time - since >= SPEED_SPAN { (time, direction) } else { self.anchor };
        if speed > SACCADE_SPEED {
            return Track { time, gaze: direction, anchor, saccade: Some(time) };
        }
        let cutoff = CUTOFF + CUTOFF_PER_SPEED * speed;
        let share = 1.0 - (-std::f64::consts::TAU * cutoff * (time - self.time)).exp();
        let gaze = self.gaze.lerp(direction, share).try_normalize().unwrap_or(direction);
        Track { time, gaze, anchor, saccade: self.saccade }
    }
}

/// The unit direction of a sample that can be used.
fn usable_direction(view: &View, sample: &GazeSample) -> Option<DVec3> {
    if !sample.valid || !sample.time.is_finite() {
        return None;
    }
    let direction = match sample.target {
        GazeTarget::Direction(direction) => direction,
        GazeTarget::Image(point) => {
            view.eye_direction(point * DVec2::new(f64::from(view.width), f64::from(view.height)))
        }
    };
    direction.try_normalize().filter(|unit| unit.is_finite() && unit.z < -1e-3)
}

/// Where a direction meets the image, in 0..1.
fn image_point(view: &View, direction: DVec3) -> Option<DVec2> {
    let size = DVec2::new(f64::from(view.width), f64::from(view.height));
    view.project(direction).map(|pixel| pixel / size).filter(|point| point.is_finite())
}

/// 0 below 0, 1 above 1, and a smooth rise between.
fn smoothstep(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;
    use crate::math::view::FieldOfView;

    fn view() -> View {
        let fov = FieldOfView { left: -1.2, right: 0.8, up: 1.0, down: -1.1 };
        View { world_from_eye: Pose::IDENTITY, fov, width: 960, height: 1080, spacing: Default::default() }
    }

    /// A direction that many degrees to the right of the axis.
    fn degrees(x: f64) -> GazeTarget {
        GazeTarget::Direction(DVec3::new(x.to_radians().sin(), 0.0, -x.to_radians().cos()))
    }

    fn sample(time: f64, target: GazeTarget) -> GazeSample {
        GazeSample { time, target, valid: true }
    }

    /// Eccentricity of a gaze point to the right, in degrees.
    fn seen(point: GazePoint) -> f64 {
        let direction = view().eye_direction(point.point * DVec2::new(960.0, 1080.0));
        (direction.x / -direction.z).atan().to_degrees()
    }

    /// A filter that has looked at one place for a second, at 120 Hz up to time 1.
    fn fixed(at: f64) -> GazeFilter {
        let mut filter = GazeFilter::new();
        (0..=120).for_each(|i| filter.push(&view(), sample(f64::from(i) / 120.0, degrees(at))));
        filter
    }

    #[test]
    fn no_gaze_is_the_optical_centre() {
        let point = GazeFilter::new().at(&view(), 3.0);
        assert_eq!(
            point,
            GazePoint { point: view().optical_centre(), widening: 1.0, state: GazeState::Fallback }
        );
    }

    #[test]
    fn image_points_and_directions_agree() {
        let mut filter = GazeFilter::new();
        filter.push(&view(), sample(0.0, GazeTarget::Image(DVec2::new(0.9, 0.2))));
        let point = filter.at(&view(), 0.0);
        assert!((point.point - DVec2::new(0.9, 0.2)).length() < 1e-12);
        assert_eq!(point.state, GazeState::Fixation);
    }

    #[test]
    fn jitter_is_smoothed_in_a_fixation() {
        let mut filter = GazeFilter::new();
        let (mut raw, mut smooth) = (0.0f64, 0.0f64);
        let mut state = 1u32;
        for i in 0..480 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let jitter = (f64::from(state >> 8) / f64::from(1 << 24) - 0.5) * 0.4;
            let time = f64::from(i) / 120.0;
            filter.push(&view(), sample(time, degrees(5.0 + jitter)));
            let point = filter.at(&view(), time);
            assert_eq!(point.state, GazeState::Fixation);
            if i > 60 {
                raw += jitter * jitter;
                smooth += (seen(point) - 5.0).powi(2);
            }
        }
        assert!(smooth < raw * 0.5, "variance {smooth} of {raw}");
    }

    #[test]
    fn slow_pursuit_is_followed_closely() {
        let mut filter = GazeFilter::new();
        for i in 0..=240 {
            filter.push(&view(), sample(f64::from(i) / 120.0, degrees(f64::from(i) / 120.0 * 20.0 - 20.0)));
        }
        let point = filter.at(&view(), 2.0);
        assert_eq!(point.state, GazeState::Fixation);
        assert!((seen(point) - 20.0).abs() < 0.6, "{}", seen(point));
    }

    #[test]
    fn a_saccade_is_followed_at_once_with_a_wider_centre() {
        let mut filter = fixed(0.0);
        filter.push(&view(), sample(1.0 + 1.0 / 120.0, degrees(4.0)));
        let point = filter.at(&view(), 1.0 + 1.0 / 120.0);
        assert_eq!((point.state, point.widening), (GazeState::Saccade, SACCADE_WIDENING));
        assert!((seen(point) - 4.0).abs() < 1e-9);
        for i in 2..=30 {
            filter.push(&view(), sample(1.0 + f64::from(i) / 120.0, degrees(4.0)));
        }
        let point = filter.at(&view(), 1.25);
        assert_eq!((point.state, point.widening), (GazeState::Fixation, 1.0));
    }

    #[test]
    fn the_noise_of_a_fast_tracker_is_no_saccade() {
        let mut filter = GazeFilter::new();
        for i in 0..1000 {
            let time = f64::from(i) / 1000.0;
            filter.push(&view(), sample(time, degrees(if i % 2 == 0 { 0.1 } else { -0.1 })));
            assert_eq!(filter.at(&view(), time).state, GazeState::Fixation);
        }
    }

    #[test]
    fn a_blink_is_held_then_eased_to_the_centre() {
        let mut filter = fixed(20.0);
        for i in 1..=120 {
            let blink = GazeSample { valid: false, ..sample(1.0 + f64::from(i) / 120.0, degrees(-60.0)) };
            filter.push(&view(), blink);
        }
        let held = filter.at(&view(), 1.0 + HOLD * 0.9);
        assert!((seen(held) - 20.0).abs() < 1e-6);
        let mut last = held.point.x;
        for step in 1..=20 {
            let eased = filter.at(&view(), 1.0 + HOLD + EASE * f64::from(step) / 20.1);
            assert_eq!(eased.state, GazeState::Dropout);
            assert!(eased.point.x < last && last - eased.point.x < 0.05, "step {step}");
            last = eased.point.x;
        }
        let lost = filter.at(&view(), 1.0 + HOLD + EASE);
        assert_eq!((lost.point, lost.state), (view().optical_centre(), GazeState::Fallback));
        filter.push(&view(), sample(3.0, degrees(-10.0)));
        assert!((seen(filter.at(&view(), 3.0)) + 10.0).abs() < 1e-9, "a gaze that returns is taken at once");
    }

    #[test]
    fn useless_samples_are_dropped() {
        let mut filter = fixed(10.0);
        let before = filter.at(&view(), 1.01);
        let useless = [
            GazeTarget::Direction(DVec3::Z),
            GazeTarget::Direction(DVec3::X),
            GazeTarget::Direction(DVec3::ZERO),
            GazeTarget::Direction(DVec3::NAN),
            GazeTarget::Direction(DVec3::splat(f64::INFINITY)),
            GazeTarget::Image(DVec2::NAN),
            GazeTarget::Image(DVec2::splat(f64::INFINITY)),
        ];
        useless.into_iter().for_each(|target| filter.push(&view(), sample(1.01, target)));
        assert_eq!(filter.at(&view(), 1.01), before);
    }

    #[test]
    fn wrong_times_do_no_harm() {
        let mut filter = fixed(10.0);
        let times =
            [f64::NAN, f64::INFINITY, -5.0, 1.0, 1.0, 0.9, 1e300, -1e300, 0.0, 1e-300, f64::MIN, f64::MAX];
        for time in times {
            filter.push(&view(), sample(time, degrees(-15.0)));
            for asked in times {
                let point = filter.at(&view(), asked);
                assert!(point.point.is_finite() && (1.0..=SACCADE_WIDENING).contains(&point.widening));
            }
        }
        // After all that the tracker recovers.
        for i in 0..=120 {
            filter.push(&view(), sample(50.0 + f64::from(i) / 120.0, degrees(7.0)));
        }
        let point = filter.at(&view(), 51.0);
        assert!((seen(point) - 7.0).abs() < 1e-6 && point.state == GazeState::Fixation);
    }

    #[test]
    fn samples_out_of_order_are_dropped_and_a_clock_set_back_starts_anew() {
        let mut filter = fixed(10.0);
        filter.push(&view(), sample(0.95, degrees(-30.0)));
        assert!((seen(filter.at(&view(), 1.0)) - 10.0).abs() < 1e-6);
        filter.push(&view(), sample(0.2, degrees(-30.0)));
        assert!((seen(filter.at(&view(), 0.2)) + 30.0).abs() < 1e-6);
    }
}
