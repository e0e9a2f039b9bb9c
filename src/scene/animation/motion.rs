//! What of a scene moves, and where it is at a time.

use glam::{DMat4, DQuat, DVec3, Vec3};
use rayon::prelude::*;

use super::part::{Part, Vertices};
use super::{Pose, Skeleton, orientation};
use crate::scene::{Light, Mesh};

/// The moving parts of a scene. Their vertices and triangles are the last ones of its mesh.
#[derive(Clone, Debug, Default)]
pub struct Motion {
    /// The nodes and the clips that play.
    pub skeleton: Skeleton,
    /// Moving parts in the order of the mesh.
    pub parts: Vec<Part>,
    /// Lights that move: their index in the scene, and their node.
    pub lights: Vec<(usize, usize)>,
    /// The time for which the scene was loaded, in seconds: what plays on begins there.
    pub start: f64,
}

/// Everything that moves, at one instant.
#[derive(Clone, Debug, Default)]
pub struct Instant {
    /// Vertices of each part; `None` where one is not finite: that part stays where it was.
    pub parts: Vec<Option<Vertices>>,
    /// Positions relative to the anchor and directions of the moving lights, in their order.
    pub lights: Vec<Option<(Vec3, Vec3)>>,
}

impl Motion {
    /// Vertices of the mesh before the first that moves.
    pub fn first_vertex(&self, mesh: &Mesh) -> usize {
        self.parts.first().map_or(mesh.positions.len(), |part| part.vertices.start)
    }

    /// Triangles of the mesh before the first that moves.
    pub fn first_triangle(&self, mesh: &Mesh) -> usize {
        self.parts.first().map_or(mesh.triangles.len(), |part| part.triangles.start)
    }

    /// Everything at a time, in seconds since the clips began to play. `triangles` are those of each part in terms of its
    /// own vertices.
    pub fn at(&self, time: f64, anchor: DVec3, triangles: &[Vec<[u32; 3]>]) -> Instant {
        let pose = self.skeleton.pose(time);
        let part = |(part, triangles): (&Part, &Vec<[u32; 3]>)| part.at(&pose, anchor, triangles);
        Instant {
            parts: self.parts.par_iter().zip(triangles).map(part).collect(),
            lights: self.lights.iter().map(|&(_, node)| placed(&pose, node, anchor)).collect(),
        }
    }

    /// The triangles of each part in terms of its own vertices.
    pub fn own_triangles(&self, mesh: &Mesh) -> Vec<Vec<[u32; 3]>> {
        let own = |part: &Part| {
            let first = part.vertices.start as u32;
            mesh.triangles[part.triangles.clone()].iter().map(|t| t.map(|vertex| vertex - first)).collect()
        };
        self.parts.iter().map(own).collect()
    }
}

impl Instant {
    /// Puts a mesh and its lights there.
    pub fn apply(&self, motion: &Motion, mesh: &mut Mesh, lights: &mut [Light]) {
        for (part, vertices) in motion.parts.iter().zip(&self.parts) {
            let Some(vertices) = vertices else { continue };
            mesh.positions[part.vertices.clone()].copy_from_slice(&vertices.positions);
            mesh.normals[part.vertices.clone()].copy_from_slice(&vertices.normals);
            if !mesh.tangents.is_empty() && !vertices.tangents.is_empty() {
                mesh.tangents[part.vertices.clone()].copy_from_slice(&vertices.tangents);
            }
        }
        for (&(light, _), placed) in motion.lights.iter().zip(&self.lights) {
            if let Some((position, direction)) = *placed {
                (lights[light].position, lights[light].direction) = (position, direction);
            }
        }
    }
}

/// Where a light is and shines at.
fn placed(pose: &Pose, node: usize, anchor: DVec3) -> Option<(Vec3, Vec3)> {
    let world: &DMat4 = &pose.world[node];
    let turned: DQuat = orientation(world);
    let (position, direction) = ((world.w_axis.truncate() - anchor).as_vec3(), turned * DVec3::NEG_Z);
    (position.is_finite() && direction.is_finite()).then(|| (position, direction.as_vec3().normalize()))
}
