//! The node hierarchy: world transforms in double precision, and what the nodes place.

use glam::{DMat4, DQuat, DVec3};

use super::Outcome;
use super::json::{Document, Node};
use crate::scene::animation::{Clip, Local, Pose, Skeleton};
use crate::scene::grab::Grab;

/// The hierarchy, flattened.
pub struct Nodes {
    /// Where every node of the file is at the instant that is shown, in the scene or not (a joint may be elsewhere).
    pub pose: Pose,
    /// Where they are at others.
    pub skeleton: Skeleton,
    /// Which of them are elsewhere at others.
    pub moving: Vec<bool>,
    /// Which of them are shown and hidden at others.
    pub visibility_changes: Vec<bool>,
    /// The nodes of the scene to show, now or at other times where motion is kept, parents before children.
    pub shown: Vec<usize>,
    /// Those of them that hands can seize.
    pub grabbable: Vec<usize>,
}

impl Nodes {
    /// Composes all transforms. Refuses cycles and nodes with two parents, which glTF forbids.
    ///
    /// `scene` is the index of the scene to show, if the file has any; `scale` enlarges all of it. `clips` have
    /// played for `time` seconds.
    pub fn new(
        document: &Document,
        scene: usize,
        scale: f64,
        clips: Vec<Clip>,
        (time, grab, keeps_motion): (f64, Grab, bool),
    ) -> Outcome<Self> {
        let nodes = &document.nodes;
        let parents = parents(nodes)?;
        let roots: Vec<usize> = (0..nodes.len()).filter(|&node| parents[node].is_none()).collect();
        let order = descend(nodes, roots.clone(), &|_| true);
        if order.len() < nodes.len() {
            return Err("its nodes form a cycle; export it again".into());
        }
        let skeleton = Skeleton::new(parents, order, nodes.iter().map(local).collect(), scale, clips);
        let visible = |node: &Node| {
            node.extensions.visibility.as_ref().and_then(|visibility| visibility.visible).unwrap_or(true)
        };
        let skeleton = skeleton.with_hidden(nodes.iter().map(|node| !visible(node)).collect());
        let (pose, visibility_changes) = (skeleton.pose(time), skeleton.visibility_changes());
        let own = skeleton.visibility_channels();
        let is_shown = |node: usize| match own.contains(&node) {
            true => keeps_motion || !pose.hides(node),
            false => visible(&nodes[node]),
        };
        let mut starts: Vec<usize> = match document.scenes.get(scene) {
            Some(scene) => scene.nodes.iter().map(|node| node.0).collect(),
            None => roots,
        };
        starts.sort_unstable();
        starts.dedup();
        let shown = descend(nodes, starts, &is_shown);
        let marked = |node: &usize| nodes[*node].extras.as_ref().is_some_and(|extras| extras.grab);
        let grabbable: Vec<usize> = match grab {
            Grab::Marked => shown.iter().copied().filter(marked).collect(),
            Grab::None => Vec::new(),
        };
        let moving = skeleton.moving(&grabbable);
        Ok(Nodes { pose, moving, visibility_changes, skeleton, shown, grabbable })
    }
}

fn parents(nodes: &[Node]) -> Outcome<Vec<Option<usize>>> {
    let mut parents = vec![None; nodes.len()];
    for (parent, node) in nodes.iter().enumerate() {
        for child in &node.children {
            if parents[child.0].replace(parent).is_some() {
                return Err(format!("node {} has two parents, which glTF forbids; export it again", child.0));
            }
        }
    }
    Ok(parents)
}

/// `starts` and all below them, each once, parents first, without what is not `wanted` and what is below that;
/// no recursion, so depth does not matter.
fn descend(nodes: &[Node], starts: Vec<usize>, wanted: &dyn Fn(usize) -> bool) -> Vec<usize> {
    let mut seen = vec![false; nodes.len()];
    let mut order = starts;
    order.retain(|&start| wanted(start));
    order.iter().for_each(|&start| seen[start] = true);
    let mut next = 0;
    while next < order.len() {
        for child in nodes[order[next]].children.iter().filter(|child| wanted(child.0)) {
            if !std::mem::replace(&mut seen[child.0], true) {
                order.push(child.0);
            }
        }
        next += 1;
    }
    order
}

fn local(node: &Node) -> Local {
    match &node.matrix {
        Some(matrix) => Local::Matrix(DMat4::from_cols_array(matrix)),
        None => Local::Parts {
            translation: DVec3::from_array(node.translation.unwrap_or([0.0; 3])),
            rotation: DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0])),
            scale: DVec3::from_array(node.scale.unwrap_or([1.0; 3])),
        },
    }
}
