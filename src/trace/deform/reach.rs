//! Where a part may be in a pose, without its vertices.

use glam::{DMat4, DVec3, Vec3};

use crate::scene::animation::Geometry;

/// A box in the units of a mesh.
type Corners = (DVec3, DVec3);

/// Farther than so many metres, or so much of anything on the way, and sums in single precision may overflow.
const MOST: f64 = 1e36;
/// Roundings of single precision, relative to the largest coordinate.
const MARGIN: f64 = 1e-5;

/// The boxes around what a part is made of.
#[derive(Debug)]
pub(super) struct Reach {
    /// Around the vertices at rest that follow each joint; `None` where none does.
    joints: Vec<Option<Corners>>,
    /// Around what each morph target adds, and nothing.
    targets: Vec<Corners>,
}

fn around(a: Corners, b: Corners) -> Corners {
    (a.0.min(b.0), a.1.max(b.1))
}

impl Reach {
    pub fn of(geometry: &Geometry) -> Self {
        let place = |vertex: usize| geometry.positions[vertex].as_dvec3();
        let mut joints = vec![None; geometry.skin.as_ref().map_or(1, |skin| skin.joints.len())];
        let mut follow = |joint: usize, vertex: usize| {
            let own = (place(vertex), place(vertex));
            joints[joint] = Some(joints[joint].map_or(own, |known| around(known, own)));
        };
        match &geometry.skin {
            None => (0..geometry.positions.len()).for_each(|vertex| follow(0, vertex)),
            Some(skin) => {
                for (vertex, range) in skin.starts.windows(2).enumerate() {
                    let own = &skin.influences[range[0] as usize..range[1] as usize];
                    own.iter().for_each(|&(joint, _)| follow(joint as usize, vertex));
                }
            }
        }
        let of = |deltas: &Vec<Vec3>| {
            let nothing = (DVec3::ZERO, DVec3::ZERO);
            deltas.iter().map(|d| d.as_dvec3()).fold(nothing, |all, d| around(all, (d, d)))
        };
        Reach { joints, targets: geometry.targets.iter().map(|target| of(&target.positions)).collect() }
    }

    /// The middle of all its vertices at rest.
    pub fn middle(&self) -> DVec3 {
        self.joints
            .iter()
            .flatten()
            .copied()
            .reduce(around)
            .map_or(DVec3::ZERO, |(low, high)| (low + high) * 0.5)
    }

    /// A box relative to the anchor, in metres, around all its vertices where `joints` are the matrices of its joints and
    /// `weights` those of its targets. `None` where it goes farther than single precision does.
    pub fn at(&self, joints: &[DMat4], weights: &[f64], anchor: DVec3) -> Option<(Vec3, Vec3)> {
        let by =
            self.targets.iter().zip(weights).fold((DVec3::ZERO, DVec3::ZERO), |sum, (target, &weight)| {
                let (a, b) = (target.0 * weight, target.1 * weight);
                (sum.0 + a.min(b), sum.1 + a.max(b))
            });
        let mut all: Option<Corners> = None;
        for (matrix, rest) in joints.iter().zip(&self.joints) {
            let Some(rest) = rest else { continue };
            let (lower, upper) = (rest.0 + by.0, rest.1 + by.1);
            let (middle, half) = ((lower + upper) * 0.5, (upper - lower) * 0.5);
            let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|axis| axis.truncate().abs());
            let (at, reach) =
                (matrix.transform_point3(middle) - anchor, x * half.x + y * half.y + z * half.z);
            let parts = [lower, upper, at, reach, x, y, z, by.1 - by.0];
            // What is not a number is not below it either.
            if !parts.iter().all(|part| part.abs().cmplt(DVec3::splat(MOST)).all()) {
                return None;
            }
            let own = (at - reach, at + reach);
            all = Some(all.map_or(own, |known| around(known, own)));
        }
        let (lower, upper) = all?;
        let margin = DVec3::splat(lower.abs().max(upper.abs()).max_element() * MARGIN);
        Some(((lower - margin).as_vec3(), (upper + margin).as_vec3()))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DQuat;

    use super::*;
    use crate::scene::animation::Pose;
    use crate::scene::animation::{Part, Skin, Target};

    fn geometry() -> Geometry {
        let positions: Vec<Vec3> =
            (0..60).map(|i| Vec3::new((i % 5) as f32, (i % 7) as f32, i as f32)).collect();
        let influences = (0..60).flat_map(|i| [(i % 3, 0.25), ((i + 1) % 3, 0.75)]).collect();
        let target =
            Target { positions: positions.iter().map(|p| p.zxy() * 0.1).collect(), ..Target::default() };
        Geometry {
            normals: vec![Vec3::Y; 60],
            triangles: vec![[0, 1, 2]],
            targets: vec![target],
            weights: vec![-0.5],
            skin: Some(Skin {
                joints: vec![0, 1, 2],
                bind: vec![DMat4::IDENTITY; 3],
                starts: (0..=60).map(|i| 2 * i).collect(),
                influences,
            }),
            positions,
            ..Geometry::default()
        }
    }

    use glam::Vec3Swizzles;

    #[test]
    fn boxes_hold_all_vertices() {
        let (geometry, anchor) = (Arc::new(geometry()), DVec3::new(3.0, 100.0, -2.0));
        let reach = Reach::of(&geometry);
        for step in 0..20 {
            let turn = |joint: usize| {
                DQuat::from_axis_angle(DVec3::new(1.0, joint as f64, 0.3).normalize(), step as f64)
            };
            let joint =
                |j: usize| DMat4::from_rotation_translation(turn(j), DVec3::new(0.0, j as f64, step as f64));
            let world: Vec<DMat4> = (0..3).map(joint).collect();
            let pose = Pose { world: world.clone(), ..Pose::default() };
            let part = Part {
                geometry: geometry.clone(),
                node: 0,
                local: DMat4::IDENTITY,
                vertices: 0..60,
                triangles: 0..1,
            };
            let (lower, upper) = reach.at(&world, &geometry.weights, anchor).unwrap();
            let vertices = part.at(&pose, anchor, &geometry.triangles).unwrap();
            assert!(
                vertices.positions.iter().all(|p| p.cmpge(lower).all() && p.cmple(upper).all()),
                "{step}"
            );
        }
    }

    #[test]
    fn what_goes_too_far_is_nowhere() {
        let (geometry, anchor) = (geometry(), DVec3::ZERO);
        let reach = Reach::of(&geometry);
        let fine = [DMat4::IDENTITY; 3];
        assert!(reach.at(&fine, &[1.0], anchor).is_some());
        for bad in [f64::NAN, f64::INFINITY, 1e37] {
            assert!(reach.at(&fine, &[bad], anchor).is_none(), "{bad}");
            let far = DMat4::from_translation(DVec3::new(0.0, bad, 0.0));
            assert!(reach.at(&[fine[0], far, fine[0]], &[1.0], anchor).is_none(), "{bad}");
            // Sizes that others take back on the way.
            let large = DMat4::from_scale(DVec3::splat(bad));
            assert!(reach.at(&[fine[0], fine[0], large], &[1.0], anchor).is_none(), "{bad}");
        }
    }
}
