//! How a wearer moves through a scene that is larger than the room.

use glam::{DQuat, DVec2, DVec3};

use crate::math::hand::Joints;
use crate::math::pose::Pose;

/// How far a stick is pushed before it counts, and how far it must come back to count again.
const PUSHED: f64 = 0.6;
const BACK: f64 = 0.3;
/// A stick's rest is not quite zero.
const DEAD: f64 = 0.15;
/// Longest step of time, in seconds: after a pause nobody has moved meanwhile.
const LONGEST_STEP: f64 = 0.1;

/// How it is done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Manner {
    /// Metres per second at full push; 0 where the stick does not move.
    pub speed: f64,
    /// Radians of one turn, or with `smooth_turn` per second.
    pub turn: f64,
    /// Turns as long as the stick is pushed instead of once.
    pub smooth_turn: bool,
}

/// What the wearer's hands do.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hands {
    /// To go: right and ahead, each -1 to 1.
    pub go: DVec2,
    /// To turn: right is positive, -1 to 1.
    pub turn: f64,
    /// A teleport was asked for, just now: what was pressed to aim has been let go.
    pub teleport: bool,
    /// It is still pressed: the wearer looks where they would go.
    pub aiming: bool,
    /// Where the left and the right hand hold things, in the tracked space; `None` where they are not seen.
    pub grips: [Option<Pose>; 2],
    /// The joints of the left and the right hand in the tracked space, where these are seen and hold no controller.
    pub joints: [Option<Joints>; 2],
    /// The left and the right hand squeeze what they hold.
    pub squeezes: [bool; 2],
    /// Where the pointing hand is and, along its -Z, points: in the tracked space.
    pub aim: Option<Pose>,
    /// Back to the start, just now.
    pub recentre: bool,
    /// Eyes as high above the ground as at the start, just now.
    pub height: bool,
}

/// Where the tracked space lies in the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Locomotion {
    /// The tracked space in the scene; upright.
    pub world_from_space: Pose,
    turned: bool,
}

impl Locomotion {
    /// Stands still.
    pub fn new(world_from_space: Pose) -> Self {
        Locomotion { world_from_space, turned: false }
    }

    /// Goes and turns for `seconds`; `head` is in the tracked space. Turns are about the head, so that
    /// the wearer stays where they are; going follows where the head looks, on the level.
    pub fn step(&mut self, hands: &Hands, head: &Pose, manner: &Manner, seconds: f64) {
        let seconds = if seconds.is_finite() { seconds.clamp(0.0, LONGEST_STEP) } else { 0.0 };
        self.turn_about(
            self.world_from_space.transform_point(head.position),
            self.angle(hands, manner, seconds),
        );
        self.turned = hands.turn.abs() > if self.turned { BACK } else { PUSHED };
        if hands.go.length() > DEAD && manner.speed > 0.0 {
            let heading = self.world_from_space.rotation * upright(head.rotation);
            let push = hands.go.clamp_length_max(1.0) * manner.speed * seconds;
            self.world_from_space.position += heading * DVec3::new(push.x, 0.0, -push.y);
        }
    }

    /// Where the head is in the scene.
    pub fn place(&self, head: &Pose) -> DVec3 {
        self.world_from_space.transform_point(head.position)
    }

    /// Rises by so many metres, or sinks.
    pub fn rise(&mut self, metres: f64) {
        self.world_from_space.position.y += metres;
    }

    /// Puts the head at a pose of the scene, level and facing the same way; how high the head is above the
    /// tracked space's origin is left to it.
    pub fn recentre(&mut self, rest: Pose, head: &Pose) {
        let rotation = upright(rest.rotation) * upright(head.rotation).conjugate();
        let level = DVec3::new(head.position.x, 0.0, head.position.z);
        self.world_from_space = Pose { rotation, position: rest.position - rotation * level };
    }

    /// Puts the wearer's head above a point on the ground: `height` metres, or as high as it is above the
    /// tracked space's origin where that is the floor.
    pub fn stand_on(&mut self, ground: DVec3, head: &Pose, height: f64) {
        let now = self.world_from_space.transform_point(head.position);
        let sideways = DVec3::new(ground.x - now.x, 0.0, ground.z - now.z);
        let rise = ground.y + height - self.world_from_space.position.y;
        self.world_from_space.position += sideways + DVec3::Y * rise;
    }

    /// Radians to turn to the left.
    fn angle(&self, hands: &Hands, manner: &Manner, seconds: f64) -> f64 {
        match manner.smooth_turn {
            true if hands.turn.abs() > DEAD => -hands.turn * manner.turn * seconds,
            false if hands.turn.abs() > PUSHED && !self.turned => -manner.turn * hands.turn.signum(),
            _ => 0.0,
        }
    }

    fn turn_about(&mut self, centre: DVec3, angle: f64) {
        if angle == 0.0 {
            return;
        }
        let turn = DQuat::from_rotation_y(angle);
        let from_centre = self.world_from_space.position - centre;
        self.world_from_space = Pose::new(turn * self.world_from_space.rotation, centre + turn * from_centre);
    }
}

/// The part of a rotation that turns about the vertical.
pub fn upright(rotation: DQuat) -> DQuat {
    let ahead = rotation * DVec3::NEG_Z;
    let level = ahead.x.hypot(ahead.z) > 1e-6;
    if level { DQuat::from_rotation_y((-ahead.x).atan2(-ahead.z)) } else { DQuat::IDENTITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SNAP: Manner = Manner { speed: 2.0, turn: 0.5, smooth_turn: false };

    fn head() -> Pose {
        Pose::new(DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(-0.3), DVec3::new(0.3, 0.1, -0.2))
    }

    #[test]
    fn a_snap_turn_comes_once_and_leaves_the_head_where_it_is() {
        let mut locomotion =
            Locomotion::new(Pose::new(DQuat::from_rotation_y(1.0), DVec3::new(4.0, 1.6, 2.0)));
        let before = locomotion.world_from_space;
        let place = before.transform_point(head().position);
        for turn in [0.2, 0.9, 1.0, 0.5, 0.4] {
            locomotion.step(&Hands { turn, ..Hands::default() }, &head(), &SNAP, 0.01);
        }
        let now = locomotion.world_from_space;
        assert!((now.transform_point(head().position) - place).length() < 1e-12);
        let expected = DQuat::from_rotation_y(1.0 - 0.5);
        assert!(now.rotation.angle_between(expected) < 1e-9, "to the right, and once");
        locomotion.step(&Hands::default(), &head(), &SNAP, 0.01);
        locomotion.step(&Hands { turn: -1.0, ..Hands::default() }, &head(), &SNAP, 0.01);
        assert!(locomotion.world_from_space.rotation.angle_between(before.rotation) < 1e-7);
    }

    #[test]
    fn going_follows_the_head_on_the_level() {
        let mut locomotion = Locomotion::new(Pose::IDENTITY);
        let ahead = Hands { go: DVec2::new(0.0, 1.0), ..Hands::default() };
        locomotion.step(&ahead, &head(), &SNAP, 0.05);
        let moved = locomotion.world_from_space.position;
        let expected = DQuat::from_rotation_y(0.4) * DVec3::NEG_Z * 0.1;
        assert!((moved - expected).length() < 1e-12, "{moved}");
        let still = locomotion;
        locomotion.step(&Hands { go: DVec2::splat(0.1), ..Hands::default() }, &head(), &SNAP, 0.05);
        locomotion.step(&ahead, &head(), &Manner { speed: 0.0, ..SNAP }, 0.05);
        assert_eq!(locomotion, still);
        locomotion.step(&ahead, &head(), &SNAP, 1000.0);
        assert!((locomotion.world_from_space.position - moved).length() < 0.21, "a pause is no journey");
    }

    #[test]
    fn smooth_turns_last_as_long_as_the_stick_is_pushed() {
        let mut locomotion = Locomotion::new(Pose::IDENTITY);
        let manner = Manner { smooth_turn: true, turn: 2.0, speed: 0.0 };
        for _ in 0..10 {
            locomotion.step(&Hands { turn: 0.5, ..Hands::default() }, &head(), &manner, 0.01);
        }
        let turned = locomotion.world_from_space.rotation;
        assert!(turned.angle_between(DQuat::from_rotation_y(-0.1)) < 1e-7);
    }

    #[test]
    fn steps_of_any_length_keep_the_wearer_near() {
        let hands = Hands { go: DVec2::Y, turn: 1.0, ..Hands::default() };
        let manner = Manner { smooth_turn: true, ..SNAP };
        for seconds in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let mut locomotion = Locomotion::new(Pose::IDENTITY);
            locomotion.step(&hands, &head(), &manner, seconds);
            assert_eq!(locomotion.world_from_space, Pose::IDENTITY, "{seconds}");
        }
        let mut locomotion = Locomotion::new(Pose::IDENTITY);
        locomotion.step(&hands, &head(), &manner, 1e6);
        assert!((locomotion.world_from_space.position.length() - SNAP.speed * LONGEST_STEP).abs() < 0.1);
        assert!(locomotion.world_from_space.rotation.is_normalized());
    }

    #[test]
    fn going_back_to_the_start_faces_ahead() {
        let rest = Pose::new(DQuat::from_rotation_y(0.8), DVec3::new(1.0, 1.6, -2.0));
        let mut locomotion =
            Locomotion::new(Pose::new(DQuat::from_rotation_y(2.0), DVec3::new(5.0, 7.0, 5.0)));
        locomotion.rise(0.5);
        assert_eq!(locomotion.world_from_space.position, DVec3::new(5.0, 7.5, 5.0));
        locomotion.recentre(rest, &head());
        let now = locomotion.world_from_space.then(head());
        assert!((now.position - (rest.position + DVec3::Y * 0.1)).length() < 1e-12, "{now:?}");
        assert!(upright(now.rotation).angle_between(rest.rotation) < 1e-6);
        assert!((locomotion.world_from_space.rotation * DVec3::Y - DVec3::Y).length() < 1e-12);
    }

    #[test]
    fn a_teleport_puts_the_head_above_the_ground() {
        let mut locomotion =
            Locomotion::new(Pose::new(DQuat::from_rotation_y(2.0), DVec3::new(5.0, 1.6, 5.0)));
        locomotion.stand_on(DVec3::new(-1.0, 3.0, 2.0), &head(), 1.6);
        let now = locomotion.world_from_space.transform_point(head().position);
        assert!((now - DVec3::new(-1.0, 3.0 + 1.6 + 0.1, 2.0)).length() < 1e-12, "{now}");
    }
}
