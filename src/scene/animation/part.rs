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

impl Skin {
    /// The joint's node that a triangle follows most; the first of several. `None` where it follows none.
    pub fn leader(&self, triangle: &[u32; 3]) -> Option<usize> {
        let of = |&vertex: &u32| {
            let range = self.starts[vertex as usize]..self.starts[vertex as usize + 1];
            &self.influences[range.start as usize..range.end as usize]
        };
        let mut shares: Vec<(u32, f64)> = Vec::new();
        for &(joint, share) in triangle.iter().flat_map(of) {
            match shares.iter_mut().find(|own| own.0 == joint) {
                Some(own) => own.1 += share,
                None => shares.push((joint, share)),
            }
        }
        let most = shares.iter().map(|own| own.1).fold(0.0, f64::max);
        shares.iter().find(|own| own.1 == most).map(|own| self.joints[own.0 as usize])
    }
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

/// `world_from_mesh` of each vertex in a pose.
struct Matrices<'a> {
    /// Of each joint; of the whole where there is no skin.
    joints: Vec<DMat4>,
    skin: Option<&'a Skin>,
}

impl Matrices<'_> {
    fn of(&self, vertex: usize) -> DMat4 {
        let Some(skin) = self.skin else { return self.joints[0] };
        let range = skin.starts[vertex] as usize..skin.starts[vertex + 1] as usize;
        blended(&self.joints, &skin.influences[range])
    }
}

impl Geometry {
    fn matrices(&self, pose: &Pose, node: usize, local: &DMat4) -> Matrices<'_> {
        let joints = match &self.skin {
            None => vec![pose.world[node] * *local],
            Some(skin) => {
                skin.joints.iter().zip(&skin.bind).map(|(&joint, bind)| pose.world[joint] * *bind).collect()
            }
        };
        Matrices { joints, skin: self.skin.as_ref() }
    }

    /// `world_from_mesh` of each joint in a pose; of the whole where there is no skin.
    pub fn joint_matrices(&self, pose: &Pose, node: usize, local: &DMat4) -> Vec<DMat4> {
        self.matrices(pose, node, local).joints
    }

    /// The weights of its morph targets in a pose.
    pub fn weights_in<'a>(&'a self, pose: &'a Pose) -> &'a [f64] {
        self.weights_node.and_then(|node| pose.weights.get(&node)).unwrap_or(&self.weights)
    }

    /// The lists of one kind that are not empty, with their weights where these are not 0.
    fn morphs<T>(&self, pose: &Pose, list: impl Fn(&Target) -> &Vec<T>) -> Vec<(&Vec<T>, f64)> {
        let pairs =
            self.targets.iter().zip(self.weights_in(pose)).map(|(target, &weight)| (list(target), weight));
        pairs.filter(|(list, weight)| !list.is_empty() && *weight != 0.0).collect()
    }

    /// Where its vertices are in the world, in metres, for a part that `node` and `local` place.
    pub fn places(&self, pose: &Pose, node: usize, local: &DMat4) -> Vec<DVec3> {
        let (matrices, morphs) = (self.matrices(pose, node, local), self.morphs(pose, |t| &t.positions));
        let place = |vertex| matrices.of(vertex).transform_point3(morphed(&self.positions, &morphs, vertex));
        (0..self.positions.len()).into_par_iter().with_min_len(FEW).map(place).collect()
    }

    /// Its triangles as they are wound in a pose: mirroring turns the winding (glTF 2.0, 3.7.4).
    pub fn wound(&self, pose: &Pose, node: usize, local: &DMat4) -> Vec<[u32; 3]> {
        let matrices = self.matrices(pose, node, local);
        let count = if self.skin.is_some() { self.positions.len() } else { 1 };
        let turned: Vec<bool> = (0..count).map(|vertex| matrices.of(vertex).determinant() < 0.0).collect();
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
        let (moves, turns) = (
            geometry.morphs(pose, |target| &target.positions),
            geometry.morphs(pose, |target| &target.normals),
        );
        let place = |vertex: usize| {
            let matrix = matrices.of(vertex);
            let position = matrix.transform_point3(morphed(&geometry.positions, &moves, vertex));
            let normal = (!geometry.flat).then(|| {
                let own = morphed(&geometry.normals, &turns, vertex).as_vec3();
                transform_normal(&DMat3::from_mat4(matrix), own)
            });
            ((position - anchor).as_vec3(), normal.unwrap_or_default())
        };
        let (mut positions, mut turned) = (Vec::new(), Vec::new());
        let vertices = (0..geometry.positions.len()).into_par_iter().with_min_len(FEW);
        vertices.map(place).unzip_into_vecs(&mut positions, &mut turned);
        if !positions.iter().all(|p| p.is_finite()) {
            return None;
        }
        let normals = match geometry.flat {
            true => flat_normals(&positions, triangles),
            false => unit_normals(&turned, &positions, triangles),
        };
        let tangents = self.tangents(pose, &matrices, &normals);
        Some(Vertices { positions, normals, tangents })
    }

    fn tangents(&self, pose: &Pose, matrices: &Matrices<'_>, normals: &[Vec3]) -> Vec<Vec4> {
        let geometry = &*self.geometry;
        let base: Vec<Vec3> = geometry.tangents.iter().map(|tangent| tangent.truncate()).collect();
        let morphs = geometry.morphs(pose, |target| &target.tangents);
        let turn = |vertex: usize| {
            let linear = DMat3::from_mat4(matrices.of(vertex));
            let own = morphed(&base, &morphs, vertex).as_vec3();
            let turned = transform_tangent(&linear, own.extend(geometry.tangents[vertex].w));
            usable_tangent(turned, normals[vertex])
        };
        (0..base.len()).into_par_iter().with_min_len(FEW).map(turn).collect()
    }
}

/// A vertex's vector with what morph targets add.
fn morphed(base: &[Vec3], morphs: &[(&Vec<Vec3>, f64)], vertex: usize) -> DVec3 {
    let add = |sum: DVec3, (deltas, weight): &(&Vec<Vec3>, f64)| sum + deltas[vertex].as_dvec3() * *weight;
    morphs.iter().fold(base[vertex].as_dvec3(), add)
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
