//! A head and a gaze by formula: the same at the same time, every run.

use std::f64::consts::TAU;

use glam::{DQuat, DVec2, DVec3, EulerRot};

use crate::math::pose::Pose;

/// Sweep of the head to either side, nod and tilt, in degrees.
const YAW: f64 = 40.0;
const PITCH: f64 = 7.0;
const ROLL: f64 = 4.0;
/// How far the head moves from rest along its X, Y and Z, in units of its reach: never past 1 in all.
const SWAY: DVec3 = DVec3::new(0.8, 0.2, 0.5);
/// How far the head of a person who stands moves from rest, in metres.
const REACH: f64 = 0.4;
/// Length of a demonstration that is given none, in seconds.
const FALLBACK_SECONDS: f64 = 8.0;
/// Fixations before the gaze path repeats.
const FIXATIONS: usize = 64;
/// Length of fixations in seconds.
const FIXATION: std::ops::Range<f64> = 0.3..0.7;
/// Degrees that the image is wide, for the length of saccades only.
const IMAGE_DEGREES: f64 = 90.0;

/// Where a head is and where its eyes look, for any time.
#[derive(Clone, Debug, PartialEq)]
pub struct Script {
    head: Head,
    gaze: Gaze,
}

#[derive(Clone, Debug, PartialEq)]
enum Head {
    Still(Pose),
    Sweep { rest: Pose, seconds: f64, reach: f64 },
}

#[derive(Clone, Debug, PartialEq)]
enum Gaze {
    Still(DVec2),
    Path { fixations: Vec<Fixation>, seconds: f64 },
}

/// A fixation and the saccade that ends it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Fixation {
    start: f64,
    point: DVec2,
    /// When the eye leaves for the next point.
    leaves: f64,
    /// When it arrives there.
    arrives: f64,
}

impl Script {
    /// A look around from `rest`, with gaze jumps, that begins and ends at rest and repeats after
    /// `seconds`: yaw to 40 degrees either side about the world's up axis, a slight nod and tilt, and the
    /// head moving up to 0.4 m. `seconds` that are not above 0 and finite become 8.
    pub fn demo(rest: Pose, seconds: f64) -> Self {
        let seconds = if seconds.is_finite() && seconds > 1e-3 { seconds } else { FALLBACK_SECONDS };
        let rest = Pose::new(rest.rotation, rest.position);
        Script { head: Head::Sweep { rest, seconds, reach: REACH }, gaze: gaze_path() }
    }

    /// One pose and one gaze point, in 0..1 of the image, for ever; a gaze that is not finite becomes the
    /// centre.
    pub fn still(pose: Pose, gaze: DVec2) -> Self {
        let gaze = if gaze.is_finite() { gaze } else { DVec2::splat(0.5) };
        Script { head: Head::Still(Pose::new(pose.rotation, pose.position)), gaze: Gaze::Still(gaze) }
    }

    /// The same look around with the head moving up to that many metres from rest instead of 0.4 m: for
    /// scenes that are much smaller or larger than a person. A still script stays still.
    pub fn with_reach(mut self, metres: f64) -> Self {
        if let Head::Sweep { reach, .. } = &mut self.head {
            *reach = if metres.is_finite() { metres.max(0.0) } else { REACH };
        }
        self
    }

    /// `world_from_head` at a time in seconds. Any time is good; one that is not finite is 0.
    pub fn head_at(&self, time: f64) -> Pose {
        match self.head {
            Head::Still(pose) => pose,
            Head::Sweep { rest, seconds, reach } => sweep(rest, reach, wrapped(time, seconds) / seconds),
        }
    }

    /// The gaze point at a time in seconds, in 0..1 of the image from the upper left corner. Any time is
    /// good; one that is not finite is 0.
    pub fn gaze_at(&self, time: f64) -> DVec2 {
        match &self.gaze {
            Gaze::Still(point) => *point,
            Gaze::Path { fixations, seconds } => along(fixations, wrapped(time, *seconds)),
        }
    }
}

/// A time in 0..period.
fn wrapped(time: f64, period: f64) -> f64 {
    let time = if time.is_finite() { time.rem_euclid(period) } else { 0.0 };
    // The remainder of a tiny negative time rounds to the period itself.
    if time < period { time } else { 0.0 }
}

/// The head at a phase in 0..1 of its sweep.
fn sweep(rest: Pose, reach: f64, phase: f64) -> Pose {
    // Slow at both ends, so that the head starts from rest and the repeat is smooth.
    let turn = TAU * phase - (TAU * phase).sin();
    let yaw = YAW.to_radians() * turn.sin();
    let pitch = PITCH.to_radians() * (2.0 * turn).sin();
    let roll = ROLL.to_radians() * turn.sin() * (turn * 0.5).sin();
    let sway = SWAY * reach * DVec3::new(turn.sin(), (1.0 - turn.cos()) * -0.5, (2.0 * turn).sin());
    // About and along the world's up axis, whichever way the head is inclined at rest.
    let forward = rest.rotation * DVec3::NEG_Z;
    let heading = DQuat::from_rotation_y((-forward.x).atan2(-forward.z));
    let nod = DQuat::from_euler(EulerRot::XYZ, pitch, 0.0, roll);
    Pose::new(DQuat::from_rotation_y(yaw) * rest.rotation * nod, rest.position + heading * sway)
}

/// Fixations of varied lengths at points around the centre, with saccades between them.
fn gaze_path() -> Gaze {
    // Fractions of multiples of irrational numbers: evenly spread, never the same, no generator needed.
    let spread = |i: usize, step: f64| (i as f64 * step + 0.5).fract();
    let points: Vec<DVec2> = (0..FIXATIONS)
        .map(|i| {
            let (radius, angle) =
                (0.38 * spread(i, 0.754_877_666).powf(0.75), TAU * spread(i, 0.618_033_989));
            let point = DVec2::new(0.5, 0.5) + DVec2::from_angle(angle) * DVec2::new(radius, 0.8 * radius);
            if i == 0 { DVec2::splat(0.5) } else { point }
        })
        .collect();
    let mut start = 0.0;
    let mut fixations = Vec::with_capacity(FIXATIONS);
    for (i, &point) in points.iter().enumerate() {
        let leaves = start + FIXATION.start + (FIXATION.end - FIXATION.start) * spread(i, 0.569_840_291);
        // The main sequence of saccades: Bahill, Clark and Stark 1975, 21 ms and 2.2 ms per degree.
        let degrees = point.distance(points[(i + 1) % FIXATIONS]) * IMAGE_DEGREES;
        let arrives = leaves + 0.021 + 0.0022 * degrees;
        fixations.push(Fixation { start, point, leaves, arrives });
        start = arrives;
    }
    Gaze::Path { fixations, seconds: start }
}

/// The gaze at a time within the path.
fn along(fixations: &[Fixation], time: f64) -> DVec2 {
    let current = fixations.partition_point(|fixation| fixation.start <= time).saturating_sub(1);
    let Fixation { point, leaves, arrives, .. } = fixations[current];
    let next = fixations[(current + 1) % fixations.len()].point;
    let way = ((time - leaves) / (arrives - leaves)).clamp(0.0, 1.0);
    point.lerp(next, way * way * (3.0 - 2.0 * way))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn script() -> Script {
        Script::demo(Pose::look_at(DVec3::new(3.0, 1.65, -2.0), DVec3::new(9.0, 0.0, -2.0)), 6.0)
    }

    #[test]
    fn the_demo_begins_at_rest_and_sweeps_both_ways() {
        let script = script();
        let rest = script.head_at(0.0);
        let forward = |pose: Pose| pose.rotation * DVec3::NEG_Z;
        assert!((rest.position - DVec3::new(3.0, 1.65, -2.0)).length() < 1e-12);
        let (mut least, mut most, mut farthest) = (0.0f64, 0.0f64, 0.0f64);
        for i in 0..=6000 {
            let head = script.head_at(f64::from(i) * 1e-3);
            // Heading to the left of +X.
            let ahead = forward(head);
            let yaw = (-ahead.z).atan2(ahead.x).to_degrees();
            (least, most) = (least.min(yaw), most.max(yaw));
            farthest = farthest.max((head.position - rest.position).length());
        }
        assert!((most - 40.0).abs() < 2.0 && (least + 40.0).abs() < 2.0, "{least}..{most}");
        assert!((0.25..=0.4).contains(&farthest), "{farthest}");
    }

    #[test]
    fn the_head_never_jumps() {
        let script = script();
        for i in -700..1400 {
            let (a, b) = (script.head_at(f64::from(i) * 0.01), script.head_at(f64::from(i + 1) * 0.01));
            assert!((a.position - b.position).length() < 0.02, "step {i}");
            assert!(a.rotation.angle_between(b.rotation).to_degrees() < 3.0, "step {i}");
        }
        let start = script.head_at(0.0).rotation.angle_between(script.head_at(0.01).rotation);
        assert!(start.to_degrees() < 0.01, "it starts from rest");
    }

    #[test]
    fn reach_scales_the_way_of_the_head_alone() {
        let (usual, small) = (script(), script().with_reach(0.004));
        let away = |script: &Script| script.head_at(1.8).position - script.head_at(0.0).position;
        assert!((away(&usual) - away(&small) * 100.0).length() < 1e-9);
        assert_eq!(usual.head_at(1.8).rotation, small.head_at(1.8).rotation);
        assert_eq!(script().with_reach(f64::NAN), script());
    }

    #[test]
    fn the_gaze_rests_and_jumps() {
        let Gaze::Path { fixations, seconds } = gaze_path() else { panic!("a path") };
        assert!((20.0..60.0).contains(&seconds));
        for fixation in &fixations {
            assert!((0.3..=0.7).contains(&(fixation.leaves - fixation.start)));
            assert!((0.02..0.2).contains(&(fixation.arrives - fixation.leaves)));
        }
        let script = script();
        assert_eq!(script.gaze_at(0.0), DVec2::splat(0.5));
        let (mut rests, mut steps) = (0, 0);
        for i in 0..40_000 {
            let (a, b) = (script.gaze_at(f64::from(i) * 1e-3), script.gaze_at(f64::from(i + 1) * 1e-3));
            assert!(a.min_element() > 0.05 && a.max_element() < 0.95, "{a}");
            assert!(a.distance(b) < 0.02, "a saccade takes time: step {i}");
            rests += usize::from(a == b);
            steps += 1;
        }
        let share = rests as f64 / steps as f64;
        assert!((0.75..0.97).contains(&share), "rests {share} of the time");
    }

    #[test]
    fn every_time_is_safe() {
        let poses = [script(), Script::demo(Pose::IDENTITY, f64::NAN), Script::demo(Pose::IDENTITY, -1.0)];
        for script in poses {
            let times = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -0.1, -1e-300, -1e9, 1e18, f64::MAX];
            for time in times.into_iter().chain([f64::MIN, 0.0, 5e-324, 6.0]) {
                let head = script.head_at(time);
                assert!(head.position.is_finite() && head.rotation.is_normalized(), "{time}");
                let gaze = script.gaze_at(time);
                assert!(gaze.min_element() >= 0.0 && gaze.max_element() <= 1.0, "{time}: {gaze}");
            }
            assert_eq!(script.head_at(f64::NAN), script.head_at(0.0));
        }
    }

    #[test]
    fn still_is_still() {
        let pose = Pose::look_at(DVec3::ONE, DVec3::ZERO);
        let script = Script::still(pose, DVec2::new(0.2, 0.9)).with_reach(3.0);
        for time in [0.0, 17.3, f64::NAN] {
            assert!((script.head_at(time).position - pose.position).length() < 1e-15);
            assert_eq!(script.gaze_at(time), DVec2::new(0.2, 0.9));
        }
        assert_eq!(Script::still(pose, DVec2::NAN).gaze_at(1.0), DVec2::splat(0.5));
    }
}
