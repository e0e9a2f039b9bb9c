//! A head that keys and a mouse move: what stands in for a tracker.

use glam::{DQuat, DVec3};

use crate::math::pose::Pose;

/// Metres a second.
const SPEED: f64 = 1.6;
/// Times faster while hurrying.
const HURRY: f64 = 3.0;
/// Radians for a pixel of the mouse.
const TURN: f64 = 0.0025;
/// Pitch at most, in radians up or down.
const MOST_PITCH: f64 = 1.45;
/// Seconds at most that a key counts in one step, however long a frame took.
const LONGEST_STEP: f64 = 0.25;

/// What keys and mouse ask for since the last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wish {
    /// To the right, up and backwards, each -1 to 1, as keys are held.
    pub go: DVec3,
    /// Pixels of the mouse to the right and down.
    pub mouse: [f64; 2],
    /// Faster.
    pub hurry: bool,
}

/// A head that stands, walks and looks around.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MouseLook {
    position: DVec3,
    /// Radians to the left of -Z, and up.
    yaw: f64,
    pitch: f64,
}

impl MouseLook {
    /// A head that begins at a pose; a roll is left out.
    pub fn new(start: Pose) -> Self {
        let ahead = start.rotation * DVec3::NEG_Z;
        let pitch = ahead.y.clamp(-1.0, 1.0).asin().clamp(-MOST_PITCH, MOST_PITCH);
        MouseLook { position: start.position, yaw: (-ahead.x).atan2(-ahead.z), pitch }
    }

    /// Turns by the mouse, and walks for `seconds` where a head of orientation `facing` looks, on the level.
    pub fn step(&mut self, wish: &Wish, seconds: f64, facing: DQuat) {
        self.turn(wish.mouse);
        let seconds = if seconds.is_finite() { seconds.clamp(0.0, LONGEST_STEP) } else { 0.0 };
        let ahead = facing * DVec3::NEG_Z;
        let heading = DQuat::from_rotation_y((-ahead.x).atan2(-ahead.z));
        let speed = SPEED * if wish.hurry { HURRY } else { 1.0 };
        let go = if wish.go.is_finite() { wish.go.clamp_length_max(1.0) } else { DVec3::ZERO };
        self.position += heading * go * (speed * seconds);
    }

    fn turn(&mut self, [right, down]: [f64; 2]) {
        if right.is_finite() && down.is_finite() {
            self.yaw = (self.yaw - right * TURN) % std::f64::consts::TAU;
            self.pitch = (self.pitch - down * TURN).clamp(-MOST_PITCH, MOST_PITCH);
        }
    }

    /// Where the mouse has the head look.
    pub fn orientation(&self) -> DQuat {
        DQuat::from_rotation_y(self.yaw) * DQuat::from_rotation_x(self.pitch)
    }

    /// Where the head is.
    pub fn position(&self) -> DVec3 {
        self.position
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_begins_where_it_is_put() {
        let pose = Pose::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 1.0, 2.5));
        let mouse_look = MouseLook::new(pose);
        assert!(mouse_look.orientation().angle_between(pose.rotation) < 1e-6);
        assert_eq!(mouse_look.position(), pose.position);
    }

    #[test]
    fn it_walks_where_it_looks_and_stays_level() {
        let mut mouse_look = MouseLook::new(Pose::look_at(DVec3::ZERO, DVec3::new(5.0, -3.0, 0.0)));
        let facing = mouse_look.orientation();
        for _ in 0..10 {
            mouse_look.step(&Wish { go: DVec3::NEG_Z, ..Wish::default() }, 0.1, facing);
        }
        assert!((mouse_look.position() - DVec3::X * SPEED).length() < 1e-9);
        let diagonal = Wish { go: DVec3::new(1.0, 0.0, -1.0), hurry: true, ..Wish::default() };
        let before = mouse_look.position();
        mouse_look.step(&diagonal, 0.1, facing);
        assert!(((mouse_look.position() - before).length() - 0.1 * SPEED * HURRY).abs() < 1e-9);
        assert!(mouse_look.position().z > 0.0, "its right is +Z when it looks along +X");
        let before = mouse_look.position();
        mouse_look.step(&diagonal, 1e6, facing);
        assert!((mouse_look.position() - before).length() < 2.0, "a stall is no leap");
    }

    #[test]
    fn steps_of_any_length_go_a_tenth_of_a_second_at_most() {
        let wish = Wish { go: DVec3::NEG_Z, mouse: [1e9, -1e9], hurry: true };
        for (seconds, expected) in [(0.0, 0.0), (f64::NAN, 0.0), (1e6, SPEED * HURRY * LONGEST_STEP)] {
            let mut mouse_look = MouseLook::new(Pose::IDENTITY);
            mouse_look.step(&wish, seconds, DQuat::IDENTITY);
            assert!((mouse_look.position().length() - expected).abs() < 1e-9, "{seconds}");
            assert!(mouse_look.orientation().is_normalized());
        }
    }

    #[test]
    fn the_mouse_turns_it_right_and_down_and_never_over() {
        let mut mouse_look = MouseLook::new(Pose::IDENTITY);
        let look = |mouse| Wish { mouse, ..Wish::default() };
        mouse_look.step(&look([100.0, 50.0]), 0.0, DQuat::IDENTITY);
        let ahead = mouse_look.orientation() * DVec3::NEG_Z;
        assert!(ahead.x > 0.2 && ahead.y < -0.1 && ahead.z < 0.0);
        mouse_look.step(&look([0.0, 1e6]), 0.0, DQuat::IDENTITY);
        mouse_look.step(&look([f64::NAN, f64::INFINITY]), f64::NAN, DQuat::IDENTITY);
        assert!((mouse_look.orientation() * DVec3::Y).y > 0.0);
    }
}
