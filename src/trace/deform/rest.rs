//! Parts at rest, as kernels read them.

use glam::{DVec3, Vec3};

use crate::layout::{Influence, Morph, RestVertex};
use crate::scene::animation::{Geometry, Part, Target};

/// All parts that devices deform, at rest.
#[derive(Debug)]
pub(in crate::trace) struct Rest {
    /// One more follows the last.
    pub vertices: Vec<RestVertex>,
    pub influences: Vec<Influence>,
    pub morphs: Vec<Morph>,
    /// The first vertex of the mesh that moves, and how many numbers from there on the list above may have.
    pub first_vertex: usize,
    pub moving: usize,
}

/// Whether devices can deform a part: one that is skinned or morphed, and has normals of its own.
pub(super) fn can_deform(geometry: &Geometry) -> bool {
    let changes = geometry.skin.as_ref().map_or(!geometry.targets.is_empty(), |skin| !skin.joints.is_empty());
    changes && !geometry.flat && geometry.normals.len() == geometry.positions.len()
}

/// What morph targets add to a vertex's position, normal and tangent, of those that add anything, by their numbers.
pub(super) fn morphs_of(geometry: &Geometry, vertex: usize) -> impl Iterator<Item = (u32, [Vec3; 3])> {
    let added = move |list: &Vec<Vec3>| list.get(vertex).copied().unwrap_or_default();
    let all = move |target: &Target| [&target.positions, &target.normals, &target.tangents].map(added);
    (0..).zip(geometry.targets.iter().map(all)).filter(|(_, added)| *added != [Vec3::ZERO; 3])
}

impl Rest {
    /// None yet; the mesh moves from `first_vertex` on.
    pub fn new(first_vertex: usize) -> Self {
        Rest { vertices: Vec::new(), influences: Vec::new(), morphs: Vec::new(), first_vertex, moving: 0 }
    }

    /// Adds a part whose first joint and weight have these numbers, relative to `middle`.
    pub fn append(&mut self, part: &Part, joint: u32, weight: u32, middle: DVec3) {
        let geometry = &*part.geometry;
        for (own, vertex) in part.vertices.clone().enumerate() {
            self.vertices.push(RestVertex {
                position: (geometry.positions[own].as_dvec3() - middle).as_vec3().to_array(),
                vertex: vertex as u32,
                normal: geometry.normals[own].to_array(),
                first_influence: self.influences.len() as u32,
                tangent: geometry.tangents.get(own).map_or([0.0; 4], |tangent| tangent.to_array()),
                first_morph: self.morphs.len() as u32,
            });
            match &geometry.skin {
                None => self.influences.push(Influence { joint, share: 1.0 }),
                Some(skin) => {
                    let range = skin.starts[own] as usize..skin.starts[own + 1] as usize;
                    let influence =
                        |&(of, share): &(u32, f64)| Influence { joint: joint + of, share: share as f32 };
                    self.influences.extend(skin.influences[range].iter().map(influence));
                }
            }
            self.morphs.extend(morphs_of(geometry, own).map(|(target, added)| {
                let [position, normal, tangent] = added.map(|v| v.to_array());
                Morph { position, weight: weight + target, normal, tangent }
            }));
        }
        self.moving = self.moving.max(part.vertices.end - self.first_vertex);
    }

    /// With the end of the last vertex's lists.
    pub fn ended(mut self) -> Self {
        self.vertices.push(RestVertex {
            first_influence: self.influences.len() as u32,
            first_morph: self.morphs.len() as u32,
            ..RestVertex::default()
        });
        self
    }
}
