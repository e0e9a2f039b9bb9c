//! Skins at the instant that is shown.

use glam::DMat4;

use super::Outcome;
use super::accessor::{Accessor, Component};
use super::buffers::Buffers;
use super::json::Document;
use super::nodes::Nodes;

/// What takes a vertex from its bind pose to the world, for each joint.
pub struct Skin {
    /// `world_from_joint * joint_from_bind`.
    pub matrices: Vec<DMat4>,
}

impl Skin {
    /// Skin `index` of the document.
    pub fn read(document: &Document, buffers: &Buffers<'_>, nodes: &Nodes, index: usize) -> Outcome<Self> {
        let skin = &document.skins[index];
        let inverse = skin
            .inverse_bind_matrices
            .map(|accessor| {
                Accessor::new(document, buffers, accessor.0)?.expect(
                    &format!("inverseBindMatrices of skin {index}"),
                    &[16],
                    &[Component::F32],
                )
            })
            .transpose()?;
        if let Some(inverse) = inverse.as_ref().filter(|inverse| inverse.count < skin.joints.len()) {
            return Err(format!(
                "skin {index} has {} joints but {} inverse bind matrices; export the scene again",
                skin.joints.len(),
                inverse.count
            ));
        }
        let bind = |joint: usize| match &inverse {
            Some(inverse) => DMat4::from_cols_array(&inverse.get::<16>(joint).map(f64::from)),
            None => DMat4::IDENTITY,
        };
        let matrices =
            skin.joints.iter().enumerate().map(|(i, node)| nodes.pose.world[node.0] * bind(i)).collect();
        Ok(Skin { matrices })
    }
}
