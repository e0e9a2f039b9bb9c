//! A hand's skin: a tube through the joints of each finger, and a palm between their knuckles.
//!
//! Each vertex hangs on one joint, at a place in that joint's frame whose unit is the joint's radius: so joints alone,
//! however large the hand is, say where the skin is.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{DMat4, DQuat, DVec3, Vec3};

use crate::math::hand::{FINGERS, JOINTS, Joint, Joints};
use crate::scene::animation::{Geometry, Skin};

/// Points around a finger.
const SIDES: usize = 12;
/// Rings of a finger's end.
const CAP: usize = 4;
/// How far the palm and the back of the hand are from the joints between them, in their radius.
const FLAT: f32 = 0.9;

/// Bones that meet at a sharper angle than this, as half of it in radians, are not mitred any wider.
const SHARPEST: f64 = 1.0;

/// `world_from_joint` of each joint, with its radius as the unit: where two bones meet they are turned halfway between
/// these, and wider across, so that the fingers are as thick there as elsewhere.
pub fn places(joints: &Joints) -> [DMat4; JOINTS] {
    let mut places = joints.map(|joint| placed(&joint, joint.pose.rotation, 1.0));
    for pair in FINGERS.iter().flat_map(|finger| finger[..finger.len() - 1].windows(2)) {
        let [from, to] = [pair[0], pair[1]].map(|joint| joints[joint].pose.rotation);
        let half = 0.5 * (from * DVec3::Z).angle_between(to * DVec3::Z);
        places[pair[1]] = placed(&joints[pair[1]], from.slerp(to, 0.5), 1.0 / half.min(SHARPEST).cos());
    }
    places
}

fn placed(joint: &Joint, rotation: DQuat, wider: f64) -> DMat4 {
    let scale = joint.radius * DVec3::new(1.0, wider, 1.0);
    DMat4::from_scale_rotation_translation(scale, rotation, joint.pose.position)
}

/// The skin of a hand whose joints are `nodes`; `mirrored` for the left one, whose thumb is on the other side.
pub fn hand(nodes: [usize; JOINTS], mirrored: bool) -> Geometry {
    let mut made = Made::default();
    FINGERS.iter().for_each(|joints| made.finger(joints));
    // Between thumb and index finger only the web.
    made.web([FINGERS[0][1], FINGERS[0][2], FINGERS[1][1]]);
    for pair in FINGERS[1..].windows(2) {
        made.palm([pair[0][1], pair[0][2], pair[1][2], pair[1][1]]);
    }
    let Made { mut geometry, joints } = made;
    if mirrored {
        geometry.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        for list in [&mut geometry.positions, &mut geometry.normals] {
            list.iter_mut().for_each(|vector| vector.x = -vector.x);
        }
    }
    geometry.skin = Some(Skin {
        joints: nodes.to_vec(),
        bind: vec![DMat4::IDENTITY; JOINTS],
        starts: (0..=joints.len() as u32).collect(),
        influences: joints.into_iter().map(|joint| (joint, 1.0)).collect(),
    });
    geometry
}

/// A skin in the making: the joint of each vertex.
#[derive(Default)]
struct Made {
    geometry: Geometry,
    joints: Vec<u32>,
}

impl Made {
    fn vertex(&mut self, joint: usize, position: Vec3, normal: Vec3) -> u32 {
        self.geometry.positions.push(position);
        self.geometry.normals.push(normal);
        self.joints.push(joint as u32);
        self.joints.len() as u32 - 1
    }

    /// A ring on the unit sphere around a joint, as high above its equator as an angle says.
    fn ring(&mut self, joint: usize, lift: f32) -> [u32; SIDES] {
        std::array::from_fn(|side| {
            let (sin, cos) = (side as f32 / SIDES as f32 * TAU).sin_cos();
            let normal = Vec3::new(cos * lift.cos(), sin * lift.cos(), -lift.sin());
            self.vertex(joint, normal, normal)
        })
    }

    /// A tube through joints, round at both ends.
    fn finger(&mut self, joints: &[usize]) {
        let (first, last) = (joints[0], joints[joints.len() - 1]);
        let lift = |ring: usize| FRAC_PI_2 * ring as f32 / CAP as f32;
        let mut rings: Vec<[u32; SIDES]> = (1..CAP).rev().map(|ring| self.ring(first, -lift(ring))).collect();
        rings.extend(joints[..joints.len() - 1].iter().map(|&joint| self.ring(joint, 0.0)));
        rings.extend((0..CAP).map(|ring| self.ring(last, lift(ring))));
        for pair in rings.windows(2) {
            for side in 0..SIDES {
                let next = (side + 1) % SIDES;
                let (a, b, c, d) = (pair[0][side], pair[0][next], pair[1][side], pair[1][next]);
                self.geometry.triangles.extend([[a, c, d], [a, d, b]]);
            }
        }
        for (joint, ring, pole) in [(first, rings[0], Vec3::Z), (last, rings[rings.len() - 1], Vec3::NEG_Z)] {
            let pole_vertex = self.vertex(joint, pole, pole);
            for side in 0..SIDES {
                let (a, b) = (ring[side], ring[(side + 1) % SIDES]);
                self.geometry.triangles.push(if pole.z > 0.0 {
                    [pole_vertex, a, b]
                } else {
                    [a, pole_vertex, b]
                });
            }
        }
    }

    /// A slab between two fingers' beginnings and knuckles, which run along them: its sides lie within the fingers.
    fn palm(&mut self, [a, b, c, d]: [usize; 4]) {
        for (up, corners) in [(Vec3::Y, [a, d, c, b]), (Vec3::NEG_Y, [a, b, c, d])] {
            let [a, b, c, d] = corners.map(|joint| self.vertex(joint, up * FLAT, up));
            self.geometry.triangles.extend([[a, b, c], [a, c, d]]);
        }
        self.side([b, c], Vec3::NEG_Z);
        self.side([d, a], Vec3::Z);
    }

    /// The same between three joints.
    fn web(&mut self, [a, b, c]: [usize; 3]) {
        for (up, corners) in [(Vec3::Y, [a, c, b]), (Vec3::NEG_Y, [a, b, c])] {
            let corners = corners.map(|joint| self.vertex(joint, up * FLAT, up));
            self.geometry.triangles.push(corners);
        }
        self.side([b, c], Vec3::NEG_Z);
        self.side([c, a], Vec3::Z);
    }

    /// What closes a slab between its faces.
    fn side(&mut self, [from, to]: [usize; 2], normal: Vec3) {
        let corners = [(from, FLAT), (from, -FLAT), (to, -FLAT), (to, FLAT)];
        let [a, b, c, d] = corners.map(|(joint, height)| self.vertex(joint, Vec3::Y * height, normal));
        self.geometry.triangles.extend([[a, b, c], [a, c, d]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hand::{bent, mirrored};
    use crate::scene::animation::Pose;

    /// A bent finger is as thick at its joints as between them.
    #[test]
    fn joints_are_mitred() {
        let joints = bent(1.2);
        let places = places(&joints);
        for finger in &FINGERS[1..] {
            for pair in finger[2..].windows(2) {
                let [from, to] = [pair[0], pair[1]].map(|joint| joints[joint].pose.position);
                let along = (to - from).normalize();
                // What the ring at either joint is across, seen along the bone between them.
                for &joint in pair.iter().filter(|&&joint| joint != finger[5]) {
                    let own = &joints[joint];
                    let back = places[joint].transform_vector3(DVec3::Y);
                    let thick = (back - along * back.dot(along)).length() / own.radius;
                    assert!((thick - 1.0).abs() < 1e-6, "{joint}: {thick}");
                }
            }
        }
    }

    /// Each vertex is as far from its joint as the hand is thick there, triangles face outwards, and what is closed has no
    /// more than its volume.
    #[test]
    fn skins_are_as_thick_as_their_joints_and_face_outwards() {
        for left in [false, true] {
            let geometry = hand(std::array::from_fn(|joint| joint), left);
            let joints = if left { mirrored(&bent(0.3)) } else { bent(0.3) };
            let pose = Pose { world: places(&joints).to_vec(), ..Pose::default() };
            let vertices = geometry.places(&pose, 0, &DMat4::IDENTITY);
            let skin = geometry.skin.as_ref().unwrap();
            for (vertex, position) in vertices.iter().enumerate() {
                let joint = &joints[skin.influences[vertex].0 as usize];
                let far = position.distance(joint.pose.position) / joint.radius;
                assert!((0.89..1.07).contains(&far), "{vertex}: {far}");
            }
            let (mut outwards, mut volume) = (0, 0.0);
            for triangle in &geometry.triangles {
                let [a, b, c] = triangle.map(|vertex| vertices[vertex as usize]);
                let cross = (b - a).cross(c - a);
                volume += a.dot(cross) / 6.0;
                let normal = |vertex: u32| {
                    let world = pose.world[skin.influences[vertex as usize].0 as usize];
                    world.transform_vector3(geometry.normals[vertex as usize].as_dvec3())
                };
                outwards += usize::from(triangle.iter().all(|&vertex| normal(vertex).dot(cross) > 0.0));
            }
            // Where a finger bends some triangles at its inner side turn over.
            let count = geometry.triangles.len();
            assert!(outwards * 100 > count * 97, "{left}: {outwards} of {count}");
            assert!((1e-4..6e-4).contains(&volume), "{left}: {volume} cubic metres");
        }
    }
}
