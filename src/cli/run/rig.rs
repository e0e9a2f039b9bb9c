//! Who wears the headset: where they are in the scene, where they look, and what they cannot see.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::keys::Keys;
use crate::config::{HeadsetConfig, Turn, Walk};
use crate::foveation::{BitMask, GazeFilter, GazeSample, GazeTarget};
use crate::headset::locomotion::{Hands, Locomotion, Manner, upright};
use crate::headset::openxr::{EyeView, Gaze, HiddenMesh};
use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};
use crate::scene::{Scene, pick};
use crate::session::FoveaPoint;

/// How far the gaze moves, in 0..1 of the image, before the pattern follows it: patterns cost time.
const STEADY: f64 = 0.01;
/// By how much the widening changes before the pattern follows it.
const STEADY_WIDENING: f64 = 0.2;
/// Eyes above the ground where nothing tells, in metres.
const USUAL_HEIGHT: f64 = 1.6;
/// How much faster keys move while hurrying.
const HURRY: f64 = 3.0;
/// Seconds at most that a key counts in one frame, however long that took.
const LONGEST_STEP: f64 = 0.1;
/// The steepest ground that one can stand on: the cosine of its slope.
const STEEPEST: f64 = 0.7;

/// The wearer.
pub struct Rig {
    rest: Pose,
    locomotion: Locomotion,
    height: f64,
    manner: Manner,
    /// Metres a second by keys.
    speed: f64,
    teleports: bool,
    looks: Vec<Look>,
    time: Option<i64>,
}

/// Where a view is sharp, and what of it is hidden.
#[derive(Default)]
struct Look {
    filter: GazeFilter,
    fovea: Option<FoveaPoint>,
    mask: Option<(MaskKey, Option<Arc<BitMask>>)>,
}

/// A mask is made anew when one of these changes.
type MaskKey = (u64, FieldOfView, u32, u32);

impl Rig {
    /// Stands at a pose of the scene, upright, as the settings let them move.
    pub fn new(rest: Pose, scene: &Scene, config: &HeadsetConfig) -> Self {
        let below = pick::nearest(&scene.mesh, rest.position - scene.anchor, DVec3::NEG_Y);
        let height = below.map_or(USUAL_HEIGHT, |(point, _)| rest.position.y - (scene.anchor.y + point.y));
        let turn = if config.turn == Turn::Off { 0.0 } else { config.turn_degrees.to_radians() };
        let rest = Pose { rotation: upright(rest.rotation), position: rest.position };
        Rig {
            rest,
            locomotion: Locomotion::new(rest),
            height: height.clamp(0.5, 2.5),
            manner: Manner {
                speed: if config.walk == Walk::Smooth { config.speed } else { 0.0 },
                turn,
                smooth_turn: config.turn == Turn::Smooth,
            },
            speed: if config.walk == Walk::Off { 0.0 } else { config.speed },
            teleports: config.walk == Walk::Teleport,
            looks: Vec::new(),
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
            let hit = pick::nearest(&scene.mesh, aim.position - scene.anchor, aim.rotation * DVec3::NEG_Z);
            if let Some((point, _)) = hit.filter(|(_, normal)| normal.y > STEEPEST) {
                self.locomotion.stand_on(point + scene.anchor, &head, self.height);
            }
        }
    }

    /// Keys go before hands; they walk smoothly even where controllers teleport.
    fn step(&mut self, hands: &Hands, keys: &Keys, head: &Pose, seconds: f64) {
        if keys.recentre {
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
        self.locomotion.world_from_space.then(space_from_eye)
    }

    /// Where the views are sharp at a time, in nanoseconds: where the eyes look, or at the optical centre.
    pub fn look(
        &mut self,
        gaze: Option<Gaze>,
        eyes: &[EyeView],
        views: &[View],
        time: i64,
    ) -> Vec<FoveaPoint> {
        self.looks.resize_with(views.len(), Look::default);
        let looks = self.looks.iter_mut().zip(eyes).zip(views);
        looks.map(|((look, eye), view)| look.follow(gaze, eye, view, time)).collect()
    }

    /// The hidden pixels of a view; `version` grows when its mesh has changed.
    pub fn hidden(
        &mut self,
        index: usize,
        view: &View,
        mesh: &HiddenMesh,
        version: u64,
    ) -> Option<Arc<BitMask>> {
        let key = (version, view.fov, view.width, view.height);
        let look = self.looks.get_mut(index)?;
        if look.mask.as_ref().is_none_or(|(made_for, _)| *made_for != key) {
            let mask = mesh.pixels(&view.fov, view.width, view.height).map(Arc::new);
            look.mask = Some((key, mask));
        }
        look.mask.as_ref().and_then(|(_, mask)| mask.clone())
    }
}

impl Look {
    fn follow(&mut self, gaze: Option<Gaze>, eye: &EyeView, view: &View, time: i64) -> FoveaPoint {
        let seconds = |time: i64| time as f64 * 1e-9;
        if let Some(gaze) = gaze {
            let direction = eye.space_from_eye.rotation.conjugate() * gaze.direction;
            let target = GazeTarget::Direction(direction);
            self.filter.push(view, GazeSample { time: seconds(gaze.time), target, valid: gaze.valid });
        }
        let new = self.filter.at(view, seconds(time));
        let steady = |old: &FoveaPoint| {
            (old.point - new.point).length() < STEADY && (old.widening - new.widening).abs() < STEADY_WIDENING
        };
        let new = FoveaPoint { point: new.point, widening: new.widening };
        *self.fovea.insert(self.fovea.filter(steady).unwrap_or(new))
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
    use glam::DQuat;

    const FOV: FieldOfView = FieldOfView { left: -1.2, right: 0.8, up: 1.0, down: -1.0 };

    fn eye() -> EyeView {
        EyeView { space_from_eye: Pose::new(DQuat::from_rotation_y(0.7), DVec3::X), fov: FOV }
    }

    fn view() -> View {
        View { world_from_eye: Pose::IDENTITY, fov: FOV, width: 200, height: 100 }
    }

    #[test]
    fn the_sharp_region_follows_the_gaze_and_comes_back() {
        let mut look = Look::default();
        let target = DVec2::new(0.8, 0.3);
        let seen = view().eye_direction(target * DVec2::new(200.0, 100.0));
        let direction = (eye().space_from_eye.rotation * seen).normalize();
        let at = |look: &mut Look, ms: i64, valid| {
            let time = 5_000_000_000 + ms * 1_000_000;
            look.follow(Some(Gaze { time, direction, valid }), &eye(), &view(), time)
        };
        assert!((look.follow(None, &eye(), &view(), 1).point - view().optical_centre()).length() < 1e-9);
        for ms in (0..500).step_by(10) {
            at(&mut look, ms, true);
        }
        assert!((at(&mut look, 500, true).point - target).length() < 0.02);
        for ms in (510..2000).step_by(10) {
            at(&mut look, ms, false);
        }
        assert!((at(&mut look, 2000, false).point - view().optical_centre()).length() < STEADY);
    }

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
    fn a_gaze_that_trembles_makes_no_new_patterns() {
        let mut look = Look::default();
        let mut points = Vec::new();
        for step in 0..100i64 {
            let direction = eye().space_from_eye.rotation * DVec3::new(0.003 * (step % 2) as f64, 0.0, -1.0);
            let time = 1_000_000_000 + step * 11_000_000;
            points.push(look.follow(Some(Gaze { time, direction, valid: true }), &eye(), &view(), time));
        }
        assert!(points[2..].windows(2).all(|pair| pair[0] == pair[1]), "{points:?}");
    }
}
