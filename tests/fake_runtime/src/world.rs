//! Where the head, the views and the eyes are.

use glam::{EulerRot, Quat, Vec3};
use openxr_sys as xr;

use crate::script::{Gaze, HandMove, Head, SeenHand, View};

/// A rigid transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    pub turn: Quat,
    pub place: Vec3,
}

impl Pose {
    pub const IDENTITY: Pose = Pose { turn: Quat::IDENTITY, place: Vec3::ZERO };

    /// The floor's space, seen from the LOCAL space that is so many metres above it.
    pub fn floor(below: f32) -> Pose {
        Pose { turn: Quat::IDENTITY, place: Vec3::new(0.0, -below, 0.0) }
    }

    /// First `inner`, then this.
    pub fn then(self, inner: Pose) -> Pose {
        Pose { turn: (self.turn * inner.turn).normalize(), place: self.place + self.turn * inner.place }
    }

    pub fn inverse(self) -> Pose {
        let turn = self.turn.conjugate();
        Pose { turn, place: -(turn * self.place) }
    }

    /// OpenXR's pose; nothing where its orientation has no length of 1.
    pub fn from_xr(pose: &xr::Posef) -> Option<Pose> {
        let (q, p) = (pose.orientation, pose.position);
        let (turn, place) = (Quat::from_xyzw(q.x, q.y, q.z, q.w), Vec3::new(p.x, p.y, p.z));
        ((turn.length() - 1.0).abs() < 0.01 && place.is_finite()).then_some(Pose { turn, place })
    }

    pub fn to_xr(self) -> xr::Posef {
        let (q, p) = (self.turn, self.place);
        xr::Posef {
            orientation: xr::Quaternionf { x: q.x, y: q.y, z: q.z, w: q.w },
            position: xr::Vector3f { x: p.x, y: p.y, z: p.z },
        }
    }

    /// Orientation x, y, z, w and position x, y, z, for the log.
    pub fn list(self) -> [f32; 7] {
        let (q, p) = (self.turn, self.place);
        [q.x, q.y, q.z, q.w, p.x, p.y, p.z]
    }
}

/// The head in the LOCAL space, some seconds after the session's creation.
pub(crate) fn head(head: &Head, seconds: f64) -> Pose {
    let angle = (f64::from(head.yaw_rate).to_radians() * seconds).rem_euclid(std::f64::consts::TAU);
    let place = Vec3::from(head.position) + Vec3::from(head.velocity) * seconds as f32;
    Pose { turn: Quat::from_rotation_y(angle as f32), place }
}

/// By how much it is elsewhere in the LOCAL space where its views were asked for so many times before.
pub(crate) fn learned(head: &Head, times: u32) -> Pose {
    let times = times as f32;
    let turn = Quat::from_rotation_y(head.learned_yaw.to_radians() * times);
    Pose { turn, place: Vec3::from(head.learned_shift) * times }
}

/// A view in the head's space.
pub(crate) fn view(view: &View) -> Pose {
    let [yaw, pitch, roll] = view.turn.map(f32::to_radians);
    Pose { turn: Quat::from_euler(EulerRot::YXZ, yaw, pitch, roll), place: Vec3::from(view.position) }
}

/// A view's field of view, radians.
pub(crate) fn fov(view: &View) -> xr::Fovf {
    let [angle_left, angle_right, angle_up, angle_down] = view.fov.map(f32::to_radians);
    xr::Fovf { angle_left, angle_right, angle_up, angle_down }
}

/// The eyes in the head's space at a frame; nothing where they are lost.
pub(crate) fn gaze(keys: &[Gaze], frame: u64) -> Option<Pose> {
    let key = keys.iter().rev().find(|key| key.frame <= frame)?;
    let turn = Quat::from_euler(EulerRot::YXZ, key.yaw.to_radians(), key.pitch.to_radians(), 0.0);
    (!key.lost).then_some(Pose { turn, place: Vec3::ZERO })
}

/// Degrees to the left and up of where the eyes look at a frame; nothing where they are lost.
pub(crate) fn gaze_angles(keys: &[Gaze], frame: u64) -> Option<[f32; 2]> {
    let key = keys.iter().rev().find(|key| key.frame <= frame)?;
    (!key.lost).then_some([key.yaw, key.pitch])
}

/// How far hands point down, degrees.
const HAND_DOWN: f32 = 30.0;

/// A hand that is held out, in the head's space, at a frame; nothing where it is not seen.
pub(crate) fn hand(moves: &[HandMove], left: bool, frame: u64) -> Option<Pose> {
    let side = if left { -0.2 } else { 0.2 };
    let moved = moves.iter().rev().filter(|hand| hand.left == left).find(|hand| hand.frame <= frame);
    let moved = moved.copied().unwrap_or_default();
    let turn = Quat::from_rotation_x(-HAND_DOWN.to_radians());
    let place = Vec3::new(side, -0.3, -0.4) + Vec3::from(moved.shift);
    (!moved.lost).then_some(Pose { place, turn })
}

/// The joints of the same hand in the head's space, with their radii in metres: the palm is where the hand is, fingers are
/// rows that lie side by side, or are rolled up.
pub(crate) fn joints(
    seen: &[SeenHand],
    moves: &[HandMove],
    left: bool,
    frame: u64,
) -> Option<[(Pose, f32); xr::HAND_JOINT_COUNT_EXT]> {
    let key = seen.iter().rev().filter(|hand| hand.left == left).find(|hand| hand.frame <= frame)?;
    let hand = hand(moves, left, frame).filter(|_| !key.lost)?;
    let at = |x: f32, y: f32, z: f32| {
        let place = Vec3::new(if left { -x } else { x }, y, z);
        (hand.then(Pose { turn: Quat::IDENTITY, place }), 0.012)
    };
    Some(std::array::from_fn(|joint| match joint {
        0 => at(0.0, 0.0, 0.0),
        1 => at(0.0, 0.0, 0.05),
        // Four of the thumb, and five of each finger, which it lies beside.
        _ => {
            let (finger, bone) = if joint < 6 { (0, joint - 2) } else { ((joint - 1) / 5, (joint - 1) % 5) };
            let across = (finger as f32 - 2.0) * 0.02;
            match bone {
                0 => at(across, 0.0, 0.02),
                1 => at(across, 0.0, -0.04),
                bone if key.closed => at(across, -0.012 * (bone as f32 - 1.0), -0.03),
                bone => at(across, 0.0, -0.04 - 0.03 * (bone as f32 - 1.0)),
            }
        }
    }))
}

/// Moves what a view sees to where the eyes look, degrees to the left and up.
pub(crate) fn follow(view: &mut View, [left, up]: [f32; 2]) {
    let [l, r, u, d] = view.fov;
    view.fov = [l - left, r - left, u + up, d + up];
}

/// The hidden parts of a view, as triangles on the plane one metre before it.
pub(crate) fn hidden(view: &View, share: f32) -> (Vec<xr::Vector2f>, Vec<u32>) {
    if share <= 0.0 {
        return (Vec::new(), Vec::new());
    }
    let [left, right, up, down] = view.fov.map(|angle| angle.to_radians().tan());
    let (across, along) = ((right - left) * share, (up - down) * share);
    let corners =
        [(left, up, 1.0, -1.0), (right, up, -1.0, -1.0), (right, down, -1.0, 1.0), (left, down, 1.0, 1.0)];
    let mut vertices = Vec::new();
    for (x, y, inward, upward) in corners {
        let mut points = vec![(x, y), (x + inward * across, y), (x, y + upward * along)];
        if inward * upward < 0.0 {
            points.swap(1, 2);
        }
        vertices.extend(points.into_iter().map(|(x, y)| xr::Vector2f { x, y }));
    }
    let indices = (0..vertices.len() as u32).collect();
    (vertices, indices)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_undo_each_other() {
        let pose = view(&View { position: [0.1, 0.2, 0.3], turn: [20.0, -10.0, 5.0], ..View::default() });
        let back = pose.then(pose.inverse());
        assert!(back.place.length() < 1e-6 && back.turn.angle_between(Quat::IDENTITY) < 1e-3);
        assert_eq!(Pose::from_xr(&pose.to_xr()), Some(pose));
        let mut broken = pose.to_xr();
        broken.orientation.w = 3.0;
        assert_eq!(Pose::from_xr(&broken), None);
    }

    #[test]
    fn a_turn_to_the_left_looks_to_the_left() {
        let turned = head(&Head { yaw_rate: 90.0, ..Head::default() }, 1.0);
        assert!((turned.turn * Vec3::NEG_Z - Vec3::NEG_X).length() < 1e-5);
        let keys = [
            Gaze { frame: 2, yaw: 90.0, ..Gaze::default() },
            Gaze { frame: 4, lost: true, ..Gaze::default() },
        ];
        assert!((gaze(&keys, 3).unwrap().turn * Vec3::NEG_Z - Vec3::NEG_X).length() < 1e-5);
        assert!(gaze(&keys, 1).is_none() && gaze(&keys, 4).is_none() && gaze(&[], 1).is_none());
    }

    #[test]
    fn hidden_triangles_turn_counter_clockwise_and_take_their_share() {
        let view = View::default();
        let (points, corners) = hidden(&view, 0.2);
        let area = |t: &[u32]| {
            let [a, b, c] = [0, 1, 2].map(|i| points[t[i] as usize]);
            ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)) / 2.0
        };
        let areas: Vec<f32> = corners.chunks(3).map(area).collect();
        assert!(areas.len() == 4 && areas.iter().all(|&a| a > 0.0), "{areas:?}");
        let whole = 2.0 * 2.0 * 40f32.to_radians().tan();
        assert!((areas.iter().sum::<f32>() / whole - 4.0 * 0.02).abs() < 1e-5);
    }
}
