//! Motions: where the head is in each frame, and which time it is.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::math::pose::Pose;

/// How the head moves, or what is before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    /// Nothing moves.
    Rest,
    /// The head turns by 20 degrees a second.
    SlowTurn,
    /// The head turns by 100 degrees a second.
    FastTurn,
    /// The head goes aside by a metre a second, past what is near; slower in scenes that are small for that.
    Walk,
    /// The head rests, and the scene or its sky moves.
    Scene,
}

impl Motion {
    /// All of them.
    pub const ALL: [Motion; 5] =
        [Motion::Rest, Motion::SlowTurn, Motion::FastTurn, Motion::Walk, Motion::Scene];

    /// A name for files, as in the report's JSON.
    pub fn key(self) -> &'static str {
        match self {
            Motion::Rest => "rest",
            Motion::SlowTurn => "slow-turn",
            Motion::FastTurn => "fast-turn",
            Motion::Walk => "walk",
            Motion::Scene => "scene",
        }
    }

    /// A name for tables.
    pub fn name(self) -> &'static str {
        match self {
            Motion::Rest => "at rest",
            Motion::SlowTurn => "slow turn (20°/s)",
            Motion::FastTurn => "fast turn (100°/s)",
            Motion::Walk => "walk (1 m/s at most)",
            Motion::Scene => "moving scene",
        }
    }

    /// Degrees a second that the head turns to the left.
    fn turning(self) -> f64 {
        match self {
            Motion::SlowTurn => 20.0,
            Motion::FastTurn => 100.0,
            _ => 0.0,
        }
    }
}

/// Metres a second of a walk.
const WALKING: f64 = 1.0;

/// A motion in frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Course {
    /// The motion.
    pub motion: Motion,
    /// The head in each frame, `world_from_head`.
    pub heads: Vec<Pose>,
    /// Seconds since the scene's beginning in each frame.
    pub times: Vec<f64>,
    /// Frames before the first that is judged.
    pub history: usize,
}

impl Course {
    /// `history` frames and `judged` ones, `1 / hz` seconds apart, in the middle of whose last ones the head is where it
    /// rests. It goes no further than `reach` metres from there.
    pub fn new(motion: Motion, rest: Pose, [history, judged]: [usize; 2], hz: f64, reach: f64) -> Course {
        let middle = history as f64 + 0.5 * (judged as f64 - 1.0);
        let walking = if motion == Motion::Walk { WALKING.min(reach * hz / middle.max(1.0)) } else { 0.0 };
        let frames = 0..history + judged;
        let head = |frame: usize| {
            let seconds = (frame as f64 - middle) / hz;
            let turn = DQuat::from_rotation_y((motion.turning() * seconds).to_radians());
            let aside = rest.rotation * DVec3::X * (walking * seconds);
            // About the world's up axis, as necks do.
            Pose::new(turn * rest.rotation, rest.position + aside)
        };
        let time = |frame: usize| if motion == Motion::Scene { frame as f64 / hz } else { 0.0 };
        Course {
            motion,
            heads: frames.clone().map(head).collect(),
            times: frames.map(time).collect(),
            history,
        }
    }

    /// Frames that are judged.
    pub fn judged(&self) -> std::ops::Range<usize> {
        self.history..self.heads.len()
    }

    /// Whether all frames show the same.
    pub fn rests(&self) -> bool {
        self.motion == Motion::Rest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const REST: Pose = Pose::IDENTITY;

    fn course(motion: Motion, reach: f64) -> Course {
        Course::new(motion, REST, [9, 3], 60.0, reach)
    }

    #[test]
    fn heads_move_as_fast_as_their_motion_says() {
        for (motion, degrees, metres) in
            [(Motion::SlowTurn, 20.0, 0.0), (Motion::FastTurn, 100.0, 0.0), (Motion::Walk, 0.0, 1.0)]
        {
            let course = course(motion, 10.0);
            assert_eq!(course.heads.len(), 12);
            assert_eq!(course.judged(), 9..12);
            for pair in course.heads.windows(2) {
                let angle = pair[0].rotation.angle_between(pair[1].rotation).to_degrees();
                assert!((angle * 60.0 - degrees).abs() < 1e-3, "{motion:?} {angle}");
                let step = (pair[1].position - pair[0].position).length();
                assert!((step * 60.0 - metres).abs() < 1e-9, "{motion:?} {step}");
            }
            // The middle of the three that are judged.
            assert!(course.heads[10].rotation.angle_between(REST.rotation) < 1e-6);
            assert!(course.heads[10].position.length() < 1e-9);
            assert_eq!(course.times, [0.0; 12]);
        }
    }

    #[test]
    fn a_walk_stays_within_reach() {
        let far = |course: Course| course.heads.iter().map(|h| h.position.length()).fold(0.0, f64::max);
        assert!(far(course(Motion::Walk, 0.05)) <= 0.05 + 1e-12);
        assert!(far(course(Motion::Walk, 0.05)) > 0.049);
    }

    #[test]
    fn time_passes_only_for_the_scene() {
        for motion in Motion::ALL {
            assert_eq!(serde_json::to_value(motion).unwrap(), motion.key());
            let course = course(motion, 1.0);
            let passes = course.times[11] > 0.0;
            assert_eq!(passes, motion == Motion::Scene);
            let moves = course.heads[0] != course.heads[11];
            assert_eq!(course.rests(), !moves && !passes, "{motion:?}");
        }
    }
}
