//! Who wears the headset, and where they are in the scene.

use glam::{DVec2, DVec3};

use crate::config::{HeadsetConfig, Turn, Walk};
use crate::headset::locomotion::{Hands, Locomotion, Manner, upright};
use crate::headset::{EyeView, Keys};
use crate::math::hand::Joint;
use crate::math::pose::Pose;
use crate::scene::hands::{Aim, HandPlaces, Met};
use crate::scene::{Scene, pick};

/// Eyes above the ground where nothing tells, in metres.
const USUAL_HEIGHT: f64 = 1.6;
/// How much faster keys move while hurrying.
const HURRY: f64 = 3.0;
/// Seconds at most that a key counts in one frame, however long that took.
const LONGEST_STEP: f64 = 0.1;
/// The steepest ground that one can stand on: the cosine of its slope.
const STEEPEST: f64 = 0.7;

/// What the wearer moves by: where the tracked space lies in the scene.
pub struct Rig {
    rest: Pose,
    locomotion: Locomotion,
    /// The tracked space's origin above the ground.
    height: f64,
    /// Eyes above the ground at the start.
    eyes: f64,
    manner: Manner,
    /// Metres a second by keys.
    speed: f64,
    teleports: bool,
    time: Option<i64>,
}

impl Rig {
    /// Stands at a pose of the scene, upright, as the settings let them move.
    pub fn new(rest: Pose, scene: &Scene, config: &HeadsetConfig) -> Self {
        let below = pick::nearest(scene, rest.position - scene.anchor, DVec3::NEG_Y);
        let height = below.map_or(USUAL_HEIGHT, |(point, _)| rest.position.y - (scene.anchor.y + point.y));
        let turn = if config.turn == Turn::Off { 0.0 } else { config.turn_degrees.to_radians() };
        let rest = Pose { rotation: upright(rest.rotation), position: rest.position };
        let height = height.clamp(0.5, 2.5);
        Rig {
            rest,
            locomotion: Locomotion::new(rest),
            height,
            eyes: height,
            manner: Manner {
                speed: if config.walk == Walk::Smooth { config.speed } else { 0.0 },
                turn,
                smooth_turn: config.turn == Turn::Smooth,
            },
            speed: if config.walk == Walk::Off { 0.0 } else { config.speed },
            teleports: config.walk == Walk::Teleport,
            time: None,
        }
    }

    /// A tracked space that is the scene, for headsets that move by themselves.
    pub fn in_place() -> Self {
        Rig {
            rest: Pose::IDENTITY,
            locomotion: Locomotion::new(Pose::IDENTITY),
            height: USUAL_HEIGHT,
            eyes: USUAL_HEIGHT,
            manner: Manner { speed: 0.0, turn: 0.0, smooth_turn: false },
            speed: 0.0,
            teleports: false,
            time: None,
        }
    }

    /// The tracked space's origin is so many metres above the room's floor, which becomes the scene's ground
    /// below the wearer: whoever crouches, or is tall, is so in the scene.
    pub fn stand(&mut self, height: f64) {
        let rise = height - self.height;
        self.height = height;
        self.rest.position.y += rise;
        self.locomotion.rise(rise);
    }

    /// Moves as hands and keys say until a time, in nanoseconds.
    pub fn walk(&mut self, hands: &Hands, keys: &Keys, eyes: &[EyeView], time: i64, scene: &Scene) {
        let seconds = self.time.map_or(0.0, |last| time.saturating_sub(last) as f64 * 1e-9);
        self.time = Some(time);
        let head = between(eyes);
        self.step(hands, keys, &head, seconds);
        if let Some(aim) = hands.aim.filter(|_| hands.teleport && self.teleports) {
            let aim = self.locomotion.world_from_space.then(aim);
            let hit = pick::nearest(scene, aim.position - scene.anchor, aim.rotation * DVec3::NEG_Z);
            if let Some((point, _)) = hit.filter(|(_, normal)| normal.y > STEEPEST) {
                self.locomotion.stand_on(point + scene.anchor, &head, self.height);
            }
        }
        if hands.height {
            self.reset_height(&head, scene);
        }
    }

    /// Where hands are in the scene, and what the one that aims points at.
    pub fn hands(&self, hands: &Hands, scene: &Scene) -> HandPlaces {
        let aim = hands.aim.filter(|_| hands.aiming && self.teleports).map(|aim| {
            let hand = self.in_scene(aim);
            let met = pick::nearest(scene, hand.position - scene.anchor, hand.rotation * DVec3::NEG_Z);
            let met = met.map(|(point, normal)| Met {
                point: point + scene.anchor,
                normal,
                can_stand: normal.y > STEEPEST,
            });
            Aim { hand, met }
        });
        let joint = |joint: Joint| Joint { pose: self.in_scene(joint.pose), ..joint };
        HandPlaces {
            grips: hands.grips.map(|grip| grip.map(|grip| self.in_scene(grip))),
            joints: hands.joints.map(|joints| joints.map(|joints| joints.map(joint))),
            aim,
        }
    }

    /// Has the eyes as high above the ground as at the start, however tall or seated the wearer is: until they go
    /// back to the start. Nothing where there is no ground.
    fn reset_height(&mut self, head: &Pose, scene: &Scene) {
        let place = self.locomotion.place(head) - scene.anchor;
        // Whoever has sunk below the ground finds it above.
        let above = place + DVec3::Y * self.eyes;
        if let Some((ground, _)) = pick::nearest(scene, above, DVec3::NEG_Y) {
            self.locomotion.rise(ground.y + self.eyes - place.y);
        }
    }

    /// Keys go before hands; they walk smoothly even where controllers teleport.
    fn step(&mut self, hands: &Hands, keys: &Keys, head: &Pose, seconds: f64) {
        if keys.recentre || hands.recentre {
            self.locomotion.recentre(self.rest, head);
        }
        let speed = self.speed * if keys.hurry { HURRY } else { 1.0 };
        let level = DVec2::new(keys.go.x, -keys.go.z);
        let by_keys = level != DVec2::ZERO;
        let hands = Hands {
            go: if by_keys { level } else { hands.go },
            turn: if keys.turn == 0.0 { hands.turn } else { keys.turn },
            ..*hands
        };
        let manner = if by_keys { Manner { speed, ..self.manner } } else { self.manner };
        self.locomotion.step(&hands, head, &manner, seconds);
        self.locomotion.rise(keys.go.y * speed * seconds.clamp(0.0, LONGEST_STEP));
    }

    /// A pose of the tracked space in the scene.
    pub fn in_scene(&self, space_from_eye: Pose) -> Pose {
        let world_from_space = self.locomotion.world_from_space;
        if world_from_space == Pose::IDENTITY {
            space_from_eye
        } else {
            world_from_space.then(space_from_eye)
        }
    }
}

/// The head: between the first two eyes, turned as the first.
pub fn between(eyes: &[EyeView]) -> Pose {
    match eyes {
        [] => Pose::IDENTITY,
        [only] => only.space_from_eye,
        [left, right, ..] => Pose {
            rotation: left.space_from_eye.rotation,
            position: (left.space_from_eye.position + right.space_from_eye.position) * 0.5,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hand;
    use glam::DQuat;

    #[test]
    fn the_floor_of_the_room_is_the_ground_of_the_scene() {
        let glb = crate::scene::generate::demo::generate();
        let scene = Scene::from_glb(std::path::Path::new("demo"), &glb).unwrap();
        let start = Pose::new(DQuat::IDENTITY, DVec3::new(0.0, 1.6, 0.0));
        let mut rig = Rig::new(start, &scene, &crate::config::Config::default().headset);
        let below = rig.rest.position.y - rig.height;
        let ground = |rig: &Rig, height: f64| {
            rig.in_scene(Pose::new(DQuat::IDENTITY, DVec3::new(0.0, -height, 0.0))).position.y
        };
        for height in [1.2, 1.75, 0.9] {
            rig.stand(height);
            assert!((ground(&rig, height) - below).abs() < 1e-9);
            assert!((rig.rest.position.y - height - below).abs() < 1e-9);
        }
    }

    #[test]
    fn hands_are_in_the_scene_and_aim_at_what_is_there() {
        let glb = crate::scene::generate::demo::generate();
        let scene = Scene::from_glb(std::path::Path::new("demo"), &glb).unwrap();
        let start = Pose::new(DQuat::from_rotation_y(1.0), DVec3::new(0.0, 1.6, 0.0));
        let mut config = crate::config::Config::default().headset;
        let rig = Rig::new(start, &scene, &config);
        let grip = Pose::new(DQuat::from_rotation_x(-0.5), DVec3::new(0.2, -0.3, -0.4));
        let joints = [Some(hand::bent(0.5)), None];
        let hands =
            Hands { grips: [None, Some(grip)], joints, aim: Some(grip), aiming: true, ..Hands::default() };
        let shown = rig.hands(&hands, &scene);
        assert_eq!(shown.grips, [None, Some(rig.in_scene(grip))]);
        let (tip, own) = (shown.joints[0].unwrap()[10], joints[0].unwrap()[10]);
        assert!(tip.pose == rig.in_scene(own.pose) && tip.radius == own.radius && shown.joints[1].is_none());
        let Aim { hand: aim, met } = shown.aim.unwrap();
        let Met { point, normal, .. } = met.unwrap();
        assert!((point - aim.position).normalize().dot(aim.rotation * DVec3::NEG_Z) > 1.0 - 1e-9);
        assert!((normal.length() - 1.0).abs() < 1e-9 && point.y < aim.position.y);
        assert_eq!(rig.hands(&Hands { aiming: false, ..hands }, &scene).aim, None);
        config.walk = Walk::Off;
        assert_eq!(Rig::new(start, &scene, &config).hands(&hands, &scene).aim, None);
    }
}
