//! Whether a moving part needs another tree, and how it is made in a thread of its own.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::deform::Deformation;
use super::rebuild::{Look, Seen};
use crate::bvh::parted::solid;
use crate::bvh::{Parted, WideBvh};
use crate::scene::animation::{Motion, Pose};

/// All that is known of moving parts at an instant.
pub(super) struct Looks<'a> {
    pub motion: &'a Arc<Motion>,
    pub pose: &'a Pose,
    pub anchor: DVec3,
    /// Triangles of each part in terms of its own vertices.
    pub own: &'a Arc<Vec<Vec<[u32; 3]>>>,
    /// Of the moving vertices that the host has brought there.
    pub positions: &'a [Vec3],
    /// The first of them in the mesh.
    pub first_vertex: usize,
    pub deformation: Option<&'a Deformation>,
    /// How wide triangles are at least that motion has flattened, in metres.
    pub width: f32,
}

impl Looks<'_> {
    /// How a part is looked at that gets another tree where rays visit more than `most` times as much as when its own was
    /// built; none where it has not come to that.
    pub fn at(&self, parted: &Parted, part: usize, most: f64) -> Option<Look> {
        let tree_for = parted.tree_for;
        match self.deformation.and_then(|deformation| deformation.tree(part)) {
            None => self.at_known(parted, part, most),
            Some(tree) => {
                let (motion, own, pose) = (self.motion.clone(), self.own.clone(), self.pose.clone());
                let (anchor, width) = (self.anchor, self.width);
                Some(Box::new(move || {
                    let (part, own) = (&motion.parts[part], &own[part]);
                    // What is nowhere has not grown.
                    let nothing = Seen { growth: Some(1.0), tree: None };
                    let Some(vertices) = part.at(&pose, anchor, own) else { return nothing };
                    let corners = |triangle: u32| {
                        let corners = own[triangle as usize - part.triangles.start];
                        solid(corners.map(|vertex| vertices.positions[vertex as usize]), width)
                    };
                    let growth = tree.growth_at(corners);
                    let build = || WideBvh::build_whole(tree_for, &vertices.positions, own);
                    Seen { growth: Some(growth), tree: (growth > most).then(build) }
                }))
            }
        }
    }

    /// A part whose tree the host has fitted.
    fn at_known(&self, parted: &Parted, part: usize, most: f64) -> Option<Look> {
        if parted.parts[part].growth() <= most {
            return None;
        }
        let range = &self.motion.parts[part].vertices;
        let own = range.start - self.first_vertex..range.end - self.first_vertex;
        let (positions, triangles) = (self.positions[own].to_vec(), self.own.clone());
        let tree_for = parted.tree_for;
        let build = move || WideBvh::build_whole(tree_for, &positions, &triangles[part]);
        Some(Box::new(move || Seen { growth: None, tree: Some(build()) }))
    }
}
