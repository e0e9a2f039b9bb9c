//! Skins at the instant that is shown.

use glam::DMat4;

use super::Outcome;
use super::buffers::Buffers;
use super::json::Document;
use super::moving;
use super::nodes::Nodes;

/// What takes a vertex from its bind pose to the world, for each joint.
pub struct Skin {
    /// `world_from_joint * joint_from_bind`.
    pub matrices: Vec<DMat4>,
}

impl Skin {
    /// Skin `index` of the document.
    pub fn read(document: &Document, buffers: &Buffers<'_>, nodes: &Nodes, index: usize) -> Outcome<Self> {
        let bind = moving::bind_matrices(document, buffers, index)?;
        let joints = document.skins[index].joints.iter();
        let matrices = joints.zip(bind).map(|(node, bind)| nodes.pose.world[node.0] * bind).collect();
        Ok(Skin { matrices })
    }
}
