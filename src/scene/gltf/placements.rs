//! Which primitives are placed where, and in which state: each is read once for each state.

use std::collections::HashMap;

use glam::DMat4;

use super::Outcome;
use super::json::{Document, Primitive};
use super::nodes::Nodes;
use super::triangulate::Mode;

/// Triangles that a scene may have once all instances are placed.
const MAX_TRIANGLES: usize = 100_000_000;

/// A primitive in one state of morphing and skinning, and where it is shown.
#[derive(Clone, Debug)]
pub struct Placement {
    /// Index of the document's mesh.
    pub mesh: usize,
    /// Index of the primitive in its mesh.
    pub primitive: usize,
    /// Index of the document's skin, when the primitive has joints.
    pub skin: Option<usize>,
    /// Weights of the morph targets.
    pub weights: Vec<f64>,
    /// `world_from_mesh` of each instance.
    pub transforms: Vec<DMat4>,
}

/// Everything that the scene's nodes show and that has triangles.
pub fn placements(document: &Document, nodes: &Nodes, warnings: &mut Vec<String>) -> Outcome<Vec<Placement>> {
    let mut list: Vec<Placement> = Vec::new();
    let mut known: HashMap<_, usize> = HashMap::new();
    let (mut thin, mut without_positions, mut triangles) = (0_usize, 0_usize, 0_usize);
    for &index in &nodes.shown {
        let node = &document.nodes[index];
        let Some(mesh) = node.mesh else { continue };
        for (i, primitive) in document.meshes[mesh.0].primitives.iter().enumerate() {
            let Some(mode) = primitive.mode.map_or(Some(Mode::Triangles), |mode| Mode::new(mode.0)) else {
                return Err(format!(
                    "primitive {i} of mesh {} has an unknown mode; export the scene again",
                    mesh.0
                ));
            };
            if mode == Mode::Thin {
                thin += 1;
                continue;
            }
            let Some(corners) = corner_count(document, primitive) else {
                without_positions += 1;
                continue;
            };
            triangles = triangles.saturating_add(mode.triangles(corners));
            let skin = node.skin.filter(|_| is_skinned(primitive)).map(|skin| skin.0);
            let weights_of = node.weights.as_ref().filter(|_| !primitive.targets.is_empty()).map(|_| index);
            let key = (mesh.0, i, skin, weights_of);
            let world = nodes.world[index];
            match known.get(&key) {
                // A skin places its vertices in the world by itself, so that a second node adds nothing.
                Some(&at) if skin.is_none() => list[at].transforms.push(world),
                Some(_) => {}
                None => {
                    known.insert(key, list.len());
                    let weights = node.weights.as_ref().unwrap_or(&document.meshes[mesh.0].weights).clone();
                    list.push(Placement {
                        mesh: mesh.0,
                        primitive: i,
                        skin,
                        weights,
                        transforms: vec![world],
                    });
                }
            }
        }
    }
    if triangles > MAX_TRIANGLES {
        return Err(format!(
            "its instances have {triangles} triangles together, but at most {MAX_TRIANGLES} are supported; show less of it"
        ));
    }
    if thin > 0 {
        warnings.push(format!(
            "{thin} primitives of points or lines were left out, because rays cannot hit them"
        ));
    }
    if without_positions > 0 {
        warnings.push(format!("{without_positions} primitives without positions were left out"));
    }
    Ok(list)
}

/// Number of corners to make triangles of; `None` without positions.
fn corner_count(document: &Document, primitive: &Primitive) -> Option<usize> {
    let positions = primitive.attributes.get("POSITION")?;
    Some(document.accessors[primitive.indices.unwrap_or(*positions).0].count.0)
}

fn is_skinned(primitive: &Primitive) -> bool {
    primitive.attributes.contains_key("JOINTS_0") && primitive.attributes.contains_key("WEIGHTS_0")
}
