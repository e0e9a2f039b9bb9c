//! A part of a mesh that moves: what its vertices are made of, and where they are in a pose.

use std::ops::Range;
use std::sync::Arc;

use glam::{DMat3, DMat4, DVec3, Vec3, Vec4};
use rayon::prelude::*;

use super::Pose;
use crate::scene::gltf::vectors::{cross, transform_normal, transform_tangent, unit_normals, usable_tangent};

/// Vertices that one thread makes at least.
const FEW: usize = 2048;

/// A primitive before it is morphed, skinned and placed. Lists beside `positions` are as long as it, or empty.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// In the units of the file.
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Unit tangents with the bitangent's sign; empty without a normal map.
    pub tangents: Vec<Vec4>,
    /// Its triangles, counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// The file has no normals: each triangle has its own three vertices, and they its normal.
    pub flat: bool,
    /// Morph targets.
    pub targets: Vec<Target>,
    /// Weights of the morph targets, where no animation moves them.
    pub weights: Vec<f64>,
    /// The node whose weights an animation moves.
    pub weights_node: Option<usize>,
    /// The joints that it hangs on.
    pub skin: Option<Skin>,
}

/// What a morph target adds at weight 1; lists are empty where it adds nothing.
#[derive(Clone, Debug, Default)]
pub struct Target {
    /// To positions.
    pub positions: Vec<Vec3>,
    /// To normals.
    pub normals: Vec<Vec3>,
    /// To tangents.
    pub tangents: Vec<Vec3>,
}

/// Joints, and how much each vertex follows which of them.
#[derive(Clone, Debug, Default)]
pub struct Skin {
    /// The nodes that are joints.
    pub joints: Vec<usize>,
    /// `joint_from_bind` of each joint.
    pub bind: Vec<DMat4>,
    /// Where each vertex's influences begin, and where the last one's end.
    pub starts: Vec<u32>,
    /// Joints and their shares, which sum to 1 for each vertex.
    pub influences: Vec<(u32, f64)>,
}

/// A geometry in the scene's mesh.
#[derive(Clone, Debug)]
pub struct Part {
    /// What it is made of.
    pub geometry: Arc<Geometry>,
    /// The node that places it, where it has no skin.
    pub node: usize,
    /// `node_from_mesh`: other than the identity for instances.
    pub local: DMat4,
    /// Its vertices in the mesh.
    pub vertices: Range<usize>,
    /// Its triangles in the mesh, wound as they were at the instant for which the scene was loaded.
    pub triangles: Range<usize>,
}

/// Vertices at one instant.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Vertices {
    /// Relative to the anchor, in metres; all finite.
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Unit tangents; empty where the geometry has none.
    pub tangents: Vec<Vec4>,
}

/// The mean of joints' matrices by their shares; without any, nothing is moved.
pub fn blended(joints: &[DMat4], influences: &[(u32, f64)]) -> DMat4 {
    let sum = influences.iter().map(|&(joint, share)| joints[joint as usize] * share).reduce(|a, b| a + b);
    sum.unwrap_or(DMat4::IDENTITY)
}

impl Geometry {
    /// `world_from_mesh` of each vertex; one for all where there is no skin.
    fn matrices(&self, pose: &Pose, node: usize, local: &DMat4) -> Vec<DMat4> {
        let Some(skin) = &self.skin else { return vec![pose.world[node] * *local] };
        let joints: Vec<DMat4> =
            skin.joints.iter().zip(&skin.bind).map(|(&joint, bind)| pose.world[joint] * *bind).collect();
        let blend = |vertex: usize| {
            let range = skin.starts[vertex] as usize..skin.starts[vertex + 1] as usize;
            blended(&joints, &skin.influences[range])
        };
        (0..self.positions.len()).into_par_iter().with_min_len(FEW).map(blend).collect()
    }

    /// What `take` makes of positions in the world, in metres; some may not be finite.
    fn world<T: Send>(
        &self,
        pose: &Pose,
        matrices: &[DMat4],
        take: impl Fn(DVec3) -> T + Sync + Send,
    ) -> Vec<T> {
        let morphs = self.morphs(pose, |target| &target.positions);
        let place = |(vertex, base): (usize, &Vec3)| {
            let at =
                morphs.iter().fold(base.as_dvec3(), |at, (deltas, w)| at + deltas[vertex].as_dvec3() * *w);
            take(matrices[vertex.min(matrices.len() - 1)].transform_point3(at))
        };
        self.positions.par_iter().enumerate().with_min_len(FEW).map(place).collect()
    }

    /// The lists of one kind that are not empty, with their weights where these are not 0.
    fn morphs<T>(&self, pose: &Pose, list: impl Fn(&Target) -> &Vec<T>) -> Vec<(&Vec<T>, f64)> {
        let moved = self.weights_node.and_then(|node| pose.weights.get(&node));
        let weights = moved.unwrap_or(&self.weights);
        let pairs = self.targets.iter().zip(weights).map(|(target, &weight)| (list(target), weight));
        pairs.filter(|(list, weight)| !list.is_empty() && *weight != 0.0).collect()
    }

    fn morphed(&self, pose: &Pose, base: &[Vec3], list: impl Fn(&Target) -> &Vec<Vec3>) -> Vec<Vec3> {
        let morphs = self.morphs(pose, list);
        let sum = |(vertex, base): (usize, &Vec3)| {
            let sum =
                morphs.iter().fold(base.as_dvec3(), |v, (deltas, w)| v + deltas[vertex].as_dvec3() * *w);
            sum.as_vec3()
        };
        base.par_iter().enumerate().with_min_len(FEW).map(sum).collect()
    }

    /// Where its vertices are in the world, in metres, for a part that `node` and `local` place.
    pub fn places(&self, pose: &Pose, node: usize, local: &DMat4) -> Vec<DVec3> {
        self.world(pose, &self.matrices(pose, node, local), |p| p)
    }

    /// Its triangles as they are wound in a pose: mirroring turns the winding (glTF 2.0, 3.7.4).
    pub fn wound(&self, pose: &Pose, node: usize, local: &DMat4) -> Vec<[u32; 3]> {
        let matrices = self.matrices(pose, node, local);
        let turned: Vec<bool> = matrices.iter().map(|matrix| matrix.determinant() < 0.0).collect();
        let wind = |&[a, b, c]: &[u32; 3]| match turned[(a as usize).min(turned.len() - 1)] {
            true => [a, c, b],
            false => [a, b, c],
        };
        self.triangles.iter().map(wind).collect()
    }
}

impl Part {
    /// Its vertices in a pose. `triangles` are its own in the mesh, in terms of its own vertices. `None` where one is not
    /// finite in single precision relative to the anchor: then the part stays where it was.
    pub fn at(&self, pose: &Pose, anchor: DVec3, triangles: &[[u32; 3]]) -> Option<Vertices> {
        let geometry = &*self.geometry;
        let matrices = geometry.matrices(pose, self.node, &self.local);
        let positions = geometry.world(pose, &matrices, |p| (p - anchor).as_vec3());
        if !positions.par_iter().with_min_len(FEW).all(|p| p.is_finite()) {
            return None;
        }
        let normals = if geometry.flat {
            flat_normals(&positions, triangles)
        } else {
            let linear: Vec<DMat3> =
                matrices.par_iter().with_min_len(FEW).map(|m| DMat3::from_mat4(*m)).collect();
            let of = |vertex: usize| &linear[vertex.min(linear.len() - 1)];
            let morphed = geometry.morphed(pose, &geometry.normals, |target| &target.normals);
            let turn = |(vertex, normal): (usize, &Vec3)| transform_normal(of(vertex), *normal);
            let turned: Vec<Vec3> = morphed.par_iter().enumerate().with_min_len(FEW).map(turn).collect();
            unit_normals(&turned, &positions, triangles)
        };
        let tangents = self.tangents(pose, &matrices, &normals);
        Some(Vertices { positions, normals, tangents })
    }

    fn tangents(&self, pose: &Pose, matrices: &[DMat4], normals: &[Vec3]) -> Vec<Vec4> {
        let geometry = &*self.geometry;
        let base: Vec<Vec3> = geometry.tangents.iter().map(|tangent| tangent.truncate()).collect();
        let morphed = geometry.morphed(pose, &base, |target| &target.tangents);
        let turn = |(vertex, tangent): (usize, &Vec3)| {
            let linear = DMat3::from_mat4(matrices[vertex.min(matrices.len() - 1)]);
            let turned = transform_tangent(&linear, tangent.extend(geometry.tangents[vertex].w));
            usable_tangent(turned, normals[vertex])
        };
        morphed.par_iter().enumerate().with_min_len(FEW).map(turn).collect()
    }
}

/// Of triangles that share no vertex.
fn flat_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::Y; positions.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|i| positions[i as usize]);
        let normal = cross(a, b, c).try_normalize().map_or(Vec3::Y, |normal| normal.as_vec3());
        triangle.iter().for_each(|&i| normals[i as usize] = normal);
    }
    normals
}
