//! Which primitives are placed where, and in which state: each is read once for each state.

use std::collections::HashMap;

use glam::DMat4;

use super::Outcome;
use super::buffers::Buffers;
use super::instances;
use super::json::{Document, Node, Primitive};
use super::moving::Moving;
use super::nodes::Nodes;
use super::triangulate::Mode;
use crate::scene::LoadOptions;

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
    /// How it moves, where it does and motion is kept.
    pub moving: Option<Moving>,
    /// It is to be kept once, if nothing else speaks against it.
    pub shared: bool,
}

/// Everything that the scene's nodes show and that has triangles.
pub fn placements(
    document: &Document,
    buffers: &Buffers<'_>,
    nodes: &Nodes,
    options: &LoadOptions,
    warnings: &mut Vec<String>,
) -> Outcome<Vec<Placement>> {
    let mut list: Vec<Placement> = Vec::new();
    let mut known: HashMap<_, usize> = HashMap::new();
    let (mut thin, mut without_positions) = (0_usize, 0_usize);
    options.budget.plan_instances(instances(document, nodes))?;
    for &index in &nodes.shown {
        let node = &document.nodes[index];
        let Some(mesh) = node.mesh else { continue };
        let locals = locals(document, buffers, node, index)?;
        let worlds: Vec<DMat4> = locals.iter().map(|local| nodes.pose.world[index] * *local).collect();
        let places = || locals.iter().map(|&local| (index, local));
        for (i, primitive) in document.meshes[mesh.0].primitives.iter().enumerate() {
            let Some(mode) = mode(primitive) else {
                return Err(format!(
                    "primitive {i} of mesh {} has an unknown mode; export the scene again",
                    mesh.0
                ));
            };
            if mode == Mode::Thin {
                thin += 1;
                continue;
            }
            if !primitive.attributes.contains_key("POSITION") {
                without_positions += 1;
                continue;
            }
            let skin = node.skin.filter(|_| is_skinned(primitive)).map(|skin| skin.0);
            let moved = nodes.pose.weights.get(&index);
            let own = moved.or(node.weights.as_ref()).filter(|_| !primitive.targets.is_empty());
            let weights_of = own.map(|_| index);
            let moves = options.keeps_motion && moves(document, nodes, index, skin, moved.is_some());
            let key = (mesh.0, i, skin, weights_of, moves);
            match known.get(&key) {
                // A skin places its vertices in the world by itself, so that a second node adds nothing.
                Some(&at) if skin.is_none() => {
                    list[at].transforms.extend(&worlds);
                    list[at].moving.iter_mut().for_each(|moving| moving.places.extend(places()));
                }
                Some(_) => {}
                None => {
                    known.insert(key, list.len());
                    let weights = own.unwrap_or(&document.meshes[mesh.0].weights).clone();
                    let weights_node = moved.map(|_| index);
                    let moving = moves.then(|| Moving {
                        skin,
                        weights: weights.clone(),
                        weights_node,
                        places: places().collect(),
                    });
                    let transforms = worlds.clone();
                    let shared = false;
                    list.push(Placement {
                        mesh: mesh.0,
                        primitive: i,
                        skin,
                        weights,
                        transforms,
                        moving,
                        shared,
                    });
                }
            }
        }
    }
    tell_left_out(thin, without_positions, warnings);
    share(document, &mut list, options)?;
    Ok(list)
}

/// Says which primitives are kept once, and plans the triangles of all.
fn share(document: &Document, list: &mut [Placement], options: &LoadOptions) -> Outcome<()> {
    let once = |placement: &Placement| {
        once(document, &document.meshes[placement.mesh].primitives[placement.primitive]) as u64
    };
    let copies = |placement: &Placement| placement.transforms.len() as u64;
    let all = |list: &[Placement]| {
        list.iter().map(|p| once(p).saturating_mul(copies(p))).fold(0, u64::saturating_add)
    };
    let sum = all(list);
    // What keeps its form.
    let is_rigid = |p: &Placement| {
        let has_targets = !document.meshes[p.mesh].primitives[p.primitive].targets.is_empty();
        p.moving.is_some() && p.skin.is_none() && !has_targets
    };
    let moved = list.iter().filter(|p| is_rigid(p)).map(|p| once(p).saturating_mul(copies(p)));
    let moved = moved.fold(0, u64::saturating_add);
    for placement in list.iter_mut() {
        placement.shared = match placement.moving {
            None => options.instancing.shares(once(placement), copies(placement), sum),
            Some(_) => is_rigid(placement) && options.instancing.shares_moving(moved),
        };
    }
    // Mirrored ones have a shape of their own.
    let kept = |p: &Placement| once(p).saturating_mul(if p.shared { copies(p).min(2) } else { copies(p) });
    options.budget.plan_triangles(list.iter().map(kept).fold(0, u64::saturating_add))
}

/// Tells of primitives that rays cannot hit.
fn tell_left_out(thin: usize, without_positions: usize, warnings: &mut Vec<String>) {
    if thin > 0 {
        warnings.push(format!(
            "{thin} primitives of points or lines were left out, because rays cannot hit them"
        ));
    }
    if without_positions > 0 {
        warnings.push(format!("{without_positions} primitives without positions were left out"));
    }
}

/// Whether a primitive of a node is elsewhere at other instants.
fn moves(document: &Document, nodes: &Nodes, node: usize, skin: Option<usize>, morphs: bool) -> bool {
    let hangs = |skin: usize| document.skins[skin].joints.iter().any(|joint| nodes.moving[joint.0]);
    morphs || nodes.visibility_changes[node] || skin.map_or(nodes.moving[node], hangs)
}

/// `node_from_mesh` of all instances that a node shows.
fn locals(document: &Document, buffers: &Buffers<'_>, node: &Node, index: usize) -> Outcome<Vec<DMat4>> {
    match &node.extensions.instances {
        Some(instances) => instances::transforms(document, buffers, index, instances),
        None => Ok(vec![DMat4::IDENTITY]),
    }
}

/// Instances of all primitives.
fn instances(document: &Document, nodes: &Nodes) -> u64 {
    let of_node = |&index: &usize| {
        let node = &document.nodes[index];
        let copies = node.extensions.instances.as_ref().map_or(1, |i| instances::count(document, i));
        let primitives: usize = node.mesh.iter().map(|mesh| document.meshes[mesh.0].primitives.len()).sum();
        primitives.saturating_mul(copies) as u64
    };
    nodes.shown.iter().map(of_node).fold(0, u64::saturating_add)
}

/// Triangles of a primitive.
fn once(document: &Document, primitive: &Primitive) -> usize {
    let Some(positions) = primitive.attributes.get("POSITION") else { return 0 };
    let corners = document.accessors[primitive.indices.unwrap_or(*positions).0].count.0;
    mode(primitive).map_or(0, |mode| mode.triangles(corners))
}

fn mode(primitive: &Primitive) -> Option<Mode> {
    primitive.mode.map_or(Some(Mode::Triangles), |mode| Mode::new(mode.0))
}

fn is_skinned(primitive: &Primitive) -> bool {
    primitive.attributes.contains_key("JOINTS_0") && primitive.attributes.contains_key("WEIGHTS_0")
}
