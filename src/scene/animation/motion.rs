//! What of a scene moves, and where it is at a time.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::{DMat4, DQuat, DVec3, Vec3};
use rayon::prelude::*;

use super::part::{Part, Vertices};
use super::{MovingMaterial, Pose, Rigid, Skeleton, orientation};
use crate::scene::grab::Grabbable;
use crate::scene::instanced::Instance;
use crate::scene::{Instanced, Light, Mesh};

/// The moving parts of a scene. Their vertices and triangles are the last ones of its mesh, their instances the last ones of
/// those of shapes that are kept once.
#[derive(Clone, Debug, Default)]
pub struct Motion {
    /// The nodes and the clips that play.
    pub skeleton: Skeleton,
    /// Moving parts in the order of the mesh.
    pub parts: Vec<Part>,
    /// Moving instances in their order.
    pub rigid: Vec<Rigid>,
    /// Lights that move or change.
    pub lights: Vec<MovingLight>,
    /// Materials that change. The scene has each of them as bright as it ever gets.
    pub materials: Vec<MovingMaterial>,
    /// Nodes beyond the skeleton's, where they are as long as nobody gives them another place: `world_from_node`, in
    /// metres. The last parts hang on them.
    pub given: Vec<DMat4>,
    /// Nodes that hands can seize.
    pub grabbable: Vec<Grabbable>,
    /// The time for which the scene was loaded, in seconds: what plays on begins there.
    pub start: f64,
}

/// A light that moves or changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingLight {
    /// Its index in the scene.
    pub light: usize,
    /// The node that places it.
    pub node: usize,
    /// Its number in the file.
    pub number: usize,
    /// The file's linear colour.
    pub color: Option<[f64; 3]>,
    /// The file's intensity, in the light's unit.
    pub intensity: Option<f64>,
}

/// Everything that moves, at one instant.
#[derive(Clone, Debug, Default)]
pub struct Instant {
    /// Vertices of each part; `None` where one is not finite, that part stays where it was, or where they were not wanted.
    pub parts: Vec<Option<Vertices>>,
    /// Where each moving instance is; `None` where that is not finite: it stays where it was.
    pub rigid: Vec<Option<Instance>>,
    /// The moving lights, in their order; `None` where one is not finite: it stays where it was.
    pub lights: Vec<Option<PlacedGlow>>,
    /// The pose that all of this is of.
    pub pose: Pose,
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

    /// How many parts there are before the first that hangs on a node beyond the skeleton's.
    pub fn parts_before_given(&self) -> usize {
        let nodes = self.skeleton.nodes();
        self.parts.iter().rposition(|part| part.node < nodes).map_or(0, |last| last + 1)
    }

    /// Instances before the first that moves.
    pub fn first_instance(&self, instanced: &Instanced) -> usize {
        instanced.instances.len() - self.rigid.len()
    }

    /// Everything at a time, in seconds since the clips began to play. `triangles` are those of each part in terms of its
    /// own vertices.
    pub fn at(&self, time: f64, anchor: DVec3, triangles: &[Vec<[u32; 3]>]) -> Instant {
        self.with(self.pose(time, &self.given, &[]), anchor, triangles, &|_| true)
    }

    /// Where all nodes are at a time: those beyond the skeleton's where they are given, those that hands can seize, in
    /// their order, where these have put them, if they have (`world_from_node`, in metres).
    pub fn pose(&self, time: f64, given: &[DMat4], put: &[Option<DMat4>]) -> Pose {
        let put = self.grabbable.iter().zip(put).filter_map(|(thing, place)| Some((thing.node, (*place)?)));
        let mut pose = self.skeleton.pose_with(time, &put.collect::<BTreeMap<_, _>>());
        pose.world.extend(given);
        pose
    }

    /// Everything in a pose; of those parts that are `wanted`, by their numbers.
    pub fn with(
        &self,
        pose: Pose,
        anchor: DVec3,
        triangles: &[Vec<[u32; 3]>],
        wanted: &(dyn Fn(usize) -> bool + Sync),
    ) -> Instant {
        let part = |part: usize| self.parts[part].at(&pose, anchor, &triangles[part]);
        let parts = (0..self.parts.len()).into_par_iter();
        Instant {
            parts: parts.map(|index| wanted(index).then(|| part(index)).flatten()).collect(),
            rigid: self.rigid.iter().map(|rigid| rigid.at(&pose, anchor)).collect(),
            lights: self.lights.iter().map(|light| light.at(&pose, anchor)).collect(),
            pose,
        }
    }

    /// The triangles of the mesh of parts that clips hide in a pose.
    pub fn hidden_triangles(&self, pose: &Pose) -> Vec<Range<usize>> {
        let hidden = self.parts.iter().filter(|part| pose.hides(part.node));
        hidden.map(|part| part.triangles.clone()).collect()
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
    /// Puts the scene's lights there.
    pub fn apply_lights(&self, motion: &Motion, lights: &mut [Light]) {
        for (moving, placed) in motion.lights.iter().zip(&self.lights) {
            if let Some(PlacedGlow { position, direction, intensity }) = *placed {
                lights[moving.light] = Light { position, direction, intensity, ..lights[moving.light] };
            }
        }
    }

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
        self.apply_lights(motion, lights);
    }
}

/// Where a light is, where it shines at, and how brightly: as in [`Light`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedGlow {
    /// Relative to the anchor.
    pub position: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Linear colour times intensity.
    pub intensity: Vec3,
}

impl MovingLight {
    fn at(&self, pose: &Pose, anchor: DVec3) -> Option<PlacedGlow> {
        let world: &DMat4 = &pose.world[self.node];
        let turned: DQuat = orientation(world);
        let (position, direction) = ((world.w_axis.truncate() - anchor).as_vec3(), turned * DVec3::NEG_Z);
        let glow = pose.lights.get(&self.number).copied().unwrap_or_default();
        let shines = if pose.hides(self.node) { 0.0 } else { 1.0 };
        (position.is_finite() && direction.is_finite()).then(|| PlacedGlow {
            position,
            direction: direction.as_vec3().normalize(),
            intensity: glow.radiated(self.color, self.intensity) * shines,
        })
    }
}
