//! A hand as 26 joints, numbered as OpenXR does (XrHandJointEXT).

use glam::{DQuat, DVec3};

use super::pose::Pose;

/// How many joints a hand has.
pub const JOINTS: usize = 26;
/// The palm's middle.
pub const PALM: usize = 0;
/// The wrist.
pub const WRIST: usize = 1;
/// From the wrist to the tip: thumb, index, middle, ring and little finger.
pub const FINGERS: [&[usize]; 5] = [
    &[WRIST, 2, 3, 4, 5],
    &[WRIST, 6, 7, 8, 9, 10],
    &[WRIST, 11, 12, 13, 14, 15],
    &[WRIST, 16, 17, 18, 19, 20],
    &[WRIST, 21, 22, 23, 24, 25],
];

/// How far the last three fingers' tips are from the palm, in lengths from the wrist to the middle finger's knuckle, in a
/// hand that closes, and in one that opens.
const CLOSED: f64 = 0.75;
const OPENED: f64 = 0.95;

/// A joint of a hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// Its -Z goes along the bone to the tip, its +Y out of the back of the hand.
    pub pose: Pose,
    /// From it to the skin, in metres.
    pub radius: f64,
}

/// All of a hand's joints.
pub type Joints = [Joint; JOINTS];

/// Whether a hand is closed around something, which is also where it was closed before and has not opened much yet.
pub fn grasps(joints: &Joints, before: bool) -> bool {
    let at = |joint: usize| joints[joint].pose.position;
    let size = at(WRIST).distance(at(FINGERS[2][2]));
    let reach = FINGERS[2..].iter().map(|finger| at(finger[5]).distance(at(PALM))).sum::<f64>() / 3.0;
    reach < size * if before { OPENED } else { CLOSED }
}

/// A right hand whose fingers are bent by so many radians at each of their joints, in the frame of its wrist: metres, +X to
/// the little finger. A left hand is its mirror image in X. An adult's, in round numbers.
pub fn bent(bend: f64) -> Joints {
    /// Where a finger begins in the palm, where its knuckle is, how long its bones are from there, and how thick it is
    /// from its beginning to its tip.
    type Finger<'a> = ([f64; 3], [f64; 3], &'a [f64], &'a [f64]);
    const LONG: [Finger; 4] = [
        (
            [-0.02, 0.0, -0.02],
            [-0.026, 0.0, -0.09],
            &[0.043, 0.026, 0.022],
            &[0.015, 0.0105, 0.009, 0.0085, 0.007],
        ),
        (
            [-0.004, 0.0, -0.02],
            [-0.004, 0.003, -0.093],
            &[0.048, 0.029, 0.023],
            &[0.015, 0.0105, 0.009, 0.0085, 0.007],
        ),
        (
            [0.01, 0.0, -0.02],
            [0.017, 0.0, -0.087],
            &[0.043, 0.028, 0.022],
            &[0.014, 0.01, 0.0085, 0.008, 0.007],
        ),
        (
            [0.022, -0.002, -0.02],
            [0.035, -0.004, -0.078],
            &[0.034, 0.02, 0.02],
            &[0.013, 0.009, 0.008, 0.0075, 0.0065],
        ),
    ];
    const THUMB: Finger =
        ([-0.024, -0.01, -0.02], [-0.048, -0.018, -0.052], &[0.034, 0.026], &[0.016, 0.013, 0.011, 0.009]);
    let mut joints = [Joint { pose: Pose::IDENTITY, radius: 0.022 }; JOINTS];
    joints[PALM] = Joint { pose: Pose::new(DQuat::IDENTITY, DVec3::new(0.0, 0.0, -0.055)), radius: 0.016 };
    let fingers = std::iter::once((&THUMB, 0.35 * bend)).chain(LONG.iter().map(|finger| (finger, bend)));
    for (places, ((start, knuckle, bones, radii), bend)) in FINGERS.iter().zip(fingers) {
        let (start, knuckle) = (DVec3::from(*start), DVec3::from(*knuckle));
        let along = Pose::look_at(start, knuckle).rotation;
        joints[places[1]] = Joint { pose: Pose::new(along, start), radius: radii[0] };
        let (mut turn, mut at) = (along * DQuat::from_rotation_x(-bend), knuckle);
        for (index, &place) in places[2..].iter().enumerate() {
            joints[place] = Joint { pose: Pose::new(turn, at), radius: radii[index + 1] };
            if let Some(length) = bones.get(index) {
                at += turn * DVec3::NEG_Z * *length;
                // The tip goes on as the bone before it does.
                let last = index + 1 == bones.len();
                turn *= if last { DQuat::IDENTITY } else { DQuat::from_rotation_x(-bend) };
            }
        }
    }
    joints
}

/// The other hand's joints: the mirror image in X.
pub fn mirrored(joints: &Joints) -> Joints {
    joints.map(|Joint { pose, radius }| {
        let DQuat { x, y, z, w } = pose.rotation;
        let position = pose.position * DVec3::new(-1.0, 1.0, 1.0);
        Joint { pose: Pose::new(DQuat::from_xyzw(x, -y, -z, w), position), radius }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hands_close_and_open_with_some_play() {
        let [open, half, fist] = [0.1, 0.9, 1.5].map(bent);
        assert!(!grasps(&open, false) && !grasps(&open, true));
        assert!(grasps(&fist, false) && grasps(&fist, true));
        assert!(grasps(&half, true) && !grasps(&half, false));
        // A child's hand closes as a giant's does.
        let scaled = |by: f64| {
            fist.map(|joint| Joint {
                pose: Pose::new(joint.pose.rotation, joint.pose.position * by),
                ..joint
            })
        };
        assert!(grasps(&scaled(0.5), false) && grasps(&scaled(3.0), false));
    }

    #[test]
    fn bones_go_along_their_joints_to_the_next_and_fingers_bend_to_the_palm() {
        for joints in [bent(0.0), bent(0.7), mirrored(&bent(0.7))] {
            for finger in FINGERS {
                for pair in finger[1..].windows(2) {
                    let [from, to] = [joints[pair[0]].pose, joints[pair[1]].pose];
                    let along = (to.position - from.position).normalize();
                    assert!((from.rotation * DVec3::NEG_Z).distance(along) < 1e-9, "{pair:?}");
                }
            }
        }
        let [straight, bent] = [bent(0.0), bent(0.7)];
        for finger in &FINGERS[1..] {
            assert!(bent[finger[5]].pose.position.y < straight[finger[5]].pose.position.y - 0.02);
        }
    }
}
