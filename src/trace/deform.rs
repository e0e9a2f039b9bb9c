//! Moving parts that devices deform themselves: what of them is sent once, and what for each instant.
//!
//! Where it is wanted, a device has the vertices of such parts at rest, and gets of an instant no more than the matrices
//! of joints and the weights of morph targets, and the few nodes above all parts. Its kernels make vertices, normals and
//! tangents from them (`kernels/deform.cl`), and fit the parts' trees and the top (`kernels/refit.cl`), level by level.
//! They do it in `f32`, the host in `f64`: places differ by some millionths of the part's extent. Parts that are lit by
//! themselves (emitters are fitted on the host), those without normals of their own, and rigid ones stay with the host.
//! Rules: a normal that motion leaves without a direction points upwards; a part that goes farther than 10^36 m, or that
//! weights or matrices take there on the way, stays where it was. Box and tree of such a part are not known to the host:
//! it builds the top's nodes over boxes around all that joints may do to their vertices, and looks in a thread of its own
//! now and then how much slower rays have become. What devices need for it, some 100 bytes a vertex, is counted before it is
//! made (`src/trace/deform/count.rs`).

mod count;
mod reach;
mod rest;

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use glam::{DMat4, DVec3, Vec3};

use crate::bvh::compact::compact_nodes;
use crate::bvh::part_tree::PartTree;
use crate::bvh::parted::Top;
use crate::bvh::{Parted, extent};
use crate::layout;
use crate::scene::animation::{Motion, Pose};
pub use count::deformed_bytes;
use reach::Reach;
pub(super) use rest::Rest;

/// Parts of a scene that devices deform.
#[derive(Debug)]
pub(super) struct Deformation {
    parts: Vec<DeformedPart>,
    /// For each part of the scene, whether it is one of them.
    is_deformed: Vec<bool>,
    rest: Arc<Rest>,
    trees: Arc<DeviceTrees>,
    joints: Vec<[[f32; 4]; 3]>,
    weights: Vec<f32>,
    /// How wide triangles are at least that motion has flattened, in metres.
    width: f32,
}

/// One of them.
#[derive(Debug)]
struct DeformedPart {
    /// Its number among all parts.
    part: usize,
    joints: Range<usize>,
    weights: Range<usize>,
    reach: Reach,
    /// Its tree as it was built.
    tree: Arc<PartTree>,
}

/// The trees of all such parts, as devices have to have them before they fit them.
#[derive(Debug)]
pub(super) struct DeviceTrees {
    pub runs: Vec<TreeRun>,
    /// Nodes but the parts' roots, level after level, those first that have no nodes below.
    pub nodes: Vec<u32>,
    /// Where each level ends.
    pub ends: Vec<usize>,
    /// Nodes of the top, which come first.
    pub top: usize,
    /// The first node of any moving part, and how many there are from there on.
    pub moving: Range<usize>,
}

/// Trees that follow each other.
#[derive(Debug)]
pub(super) struct TreeRun {
    pub first_node: usize,
    pub nodes: Vec<layout::WideNode>,
    compact: OnceLock<Vec<layout::CompactNode>>,
    /// Where the first of their triangles is in leaf order.
    pub first_place: usize,
    pub triangles: Vec<layout::Triangle>,
}

/// Such parts at an instant.
#[derive(Debug)]
pub(super) struct Deformed {
    pub rest: Arc<Rest>,
    pub trees: Arc<DeviceTrees>,
    /// The first three rows of the joints' matrices, relative to the anchor.
    pub joints: Vec<[[f32; 4]; 3]>,
    pub weights: Vec<f32>,
    /// Boxes of the top's nodes, lower corners first; those above such parts are to be fitted.
    pub boxes: Vec<[[f32; 3]; 2]>,
    /// The roots of such parts in the top, and the nodes above, level after level.
    pub nodes: Vec<u32>,
    /// Where each level ends.
    pub ends: Vec<usize>,
    pub width: f32,
}

impl TreeRun {
    /// The compact forms of its nodes, made for the first device that asks.
    pub fn compact(&self) -> &[layout::CompactNode] {
        self.compact.get_or_init(|| compact_nodes(&self.nodes))
    }
}

impl Deformation {
    /// Those parts that devices can deform, of those that `may` lets them have; none where there is none. `pose` is one
    /// in which all are where they are to be. `triangles` makes a range of parts' triangles in leaf order.
    pub fn of(
        motion: &Motion,
        (pose, anchor): (&Pose, DVec3),
        may: impl Fn(usize) -> bool,
        parted: &Parted,
        triangles: impl Fn(Range<usize>) -> Vec<layout::Triangle>,
        width: f32,
    ) -> Option<Self> {
        let (mut rest, mut parts) = (Rest::new(motion.parts.first()?.vertices.start), Vec::new());
        let (mut is_deformed, mut joints, mut weights) = (vec![false; motion.parts.len()], 0, 0);
        for (index, part) in motion.parts.iter().enumerate() {
            let geometry = &*part.geometry;
            if !rest::can_deform(geometry) || !may(index) {
                continue;
            }
            let reach = Reach::of(geometry);
            let matrices = geometry.joint_matrices(pose, part.node, &part.local);
            if reach.at(&matrices, geometry.weights_in(pose), anchor).is_none() {
                continue;
            }
            let own = (joints..joints + matrices.len(), weights..weights + geometry.targets.len());
            (joints, weights) = (own.0.end, own.1.end);
            rest.append(part, own.0.start as u32, own.1.start as u32, reach.middle());
            let tree = Arc::new(parted.parts[index].clone());
            parts.push(DeformedPart { part: index, joints: own.0, weights: own.1, reach, tree });
            is_deformed[index] = true;
        }
        let trees = Arc::new(DeviceTrees::of(&is_deformed, parted, triangles));
        let (joints, weights) = (vec![[[0.0; 4]; 3]; joints], vec![0.0; weights]);
        let rest = Arc::new(rest.ended());
        (!parts.is_empty()).then_some(Deformation { parts, is_deformed, rest, trees, joints, weights, width })
    }

    /// Whether devices deform a part.
    pub fn has(&self, part: usize) -> bool {
        self.is_deformed[part]
    }

    /// The tree of such a part as it was built.
    pub fn tree(&self, part: usize) -> Option<Arc<PartTree>> {
        self.parts.iter().find(|own| own.part == part).map(|own| own.tree.clone())
    }

    /// Takes an instant in, and tells `parted` where the parts may be; what goes too far stays where it was. Which of them are
    /// elsewhere than before.
    pub fn take(&mut self, motion: &Motion, pose: &Pose, anchor: DVec3, parted: &mut Parted) -> Vec<usize> {
        let mut moved = Vec::new();
        for own in &self.parts {
            let part = &motion.parts[own.part];
            let matrices = part.geometry.joint_matrices(pose, part.node, &part.local);
            let weights = part.geometry.weights_in(pose);
            let Some(bounds) = own.reach.at(&matrices, weights, anchor) else { continue };
            parted.loosen(own.part, bounds);
            let joints = matrices.iter().map(|matrix| rows(matrix, own.reach.middle(), anchor));
            let bent = replace(&mut self.joints[own.joints.clone()], joints);
            let weights = weights.iter().map(|&weight| weight as f32);
            if replace(&mut self.weights[own.weights.clone()], weights) || bent {
                moved.push(own.part);
            }
        }
        moved
    }

    /// Takes another tree of a part in.
    pub fn replaced(
        &mut self,
        part: usize,
        parted: &Parted,
        triangles: impl Fn(Range<usize>) -> Vec<layout::Triangle>,
    ) {
        if let Some(own) = self.parts.iter_mut().find(|own| own.part == part) {
            own.tree = Arc::new(parted.parts[part].clone());
            self.trees = Arc::new(DeviceTrees::of(&self.is_deformed, parted, triangles));
        }
    }

    /// What devices need to know of the instant that was taken in, below a top.
    pub fn at(&self, top: &Top) -> Deformed {
        let roots = self.parts.iter().filter_map(|own| top.roots[own.part]);
        let levels = std::iter::once(roots.collect()).chain(top.levels.iter().cloned());
        let (nodes, ends) = in_a_row(levels);
        let corners = |node| {
            let (lower, upper): (Vec3, Vec3) = extent(node);
            [lower.to_array(), upper.to_array()]
        };
        Deformed {
            rest: self.rest.clone(),
            trees: self.trees.clone(),
            joints: self.joints.clone(),
            weights: self.weights.clone(),
            boxes: top.nodes.iter().map(corners).collect(),
            nodes,
            ends,
            width: self.width,
        }
    }
}

impl DeviceTrees {
    fn of(
        is_deformed: &[bool],
        parted: &Parted,
        triangles: impl Fn(Range<usize>) -> Vec<layout::Triangle>,
    ) -> Self {
        let run = |parts: Range<usize>| TreeRun {
            first_node: parted.parts[parts.start].first_node,
            nodes: parted.parts[parts.clone()].iter().flat_map(|part| &part.nodes).copied().collect(),
            compact: OnceLock::new(),
            first_place: parted.parts[parts.start].first_place,
            triangles: triangles(parts),
        };
        let mut levels: Vec<Vec<u32>> = Vec::new();
        for part in parted.parts.iter().zip(is_deformed).filter(|(_, is)| **is).map(|(part, _)| part) {
            let own = part.levels();
            levels.resize(levels.len().max(own.len()), Vec::new());
            levels.iter_mut().zip(own).for_each(|(all, own)| all.extend(own));
        }
        let (nodes, ends) = in_a_row(levels.into_iter());
        let first = parted.parts.first().map_or(parted.top, |part| part.first_node);
        let end = parted.parts.last().map_or(first, |part| part.first_node + part.nodes.len());
        let runs = runs_of(is_deformed, true).into_iter().map(run).collect();
        DeviceTrees { runs, nodes, ends, top: parted.top, moving: first..end }
    }
}

/// The first three rows of a matrix that takes what is relative to `middle` to what is relative to `anchor`.
fn rows(matrix: &DMat4, middle: DVec3, anchor: DVec3) -> [[f32; 4]; 3] {
    let placed = DMat4::from_translation(-anchor) * *matrix * DMat4::from_translation(middle);
    [0, 1, 2].map(|axis| placed.row(axis).as_vec4().to_array())
}

/// Puts others in the place of values: whether any of them is another one.
fn replace<T: PartialEq>(values: &mut [T], others: impl Iterator<Item = T>) -> bool {
    let mut differ = false;
    for (value, other) in values.iter_mut().zip(others) {
        differ |= *value != other;
        *value = other;
    }
    differ
}

/// Lists one after the other, and where each ends.
fn in_a_row(lists: impl Iterator<Item = Vec<u32>>) -> (Vec<u32>, Vec<usize>) {
    let (mut all, mut ends) = (Vec::new(), Vec::new());
    for list in lists {
        all.extend(list);
        ends.push(all.len());
    }
    (all, ends)
}

/// The ranges in which all are `as_this`.
pub(super) fn runs_of(list: &[bool], as_this: bool) -> Vec<Range<usize>> {
    let chunks = list.chunk_by(|a, b| a == b).scan(0, |start, chunk| {
        let range = *start..*start + chunk.len();
        *start = range.end;
        Some((range, chunk[0]))
    });
    chunks.filter(|(_, value)| *value == as_this).map(|(range, _)| range).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_told_apart() {
        let list = [true, true, false, true, false, false];
        assert_eq!(runs_of(&list, true), [0..2, 3..4]);
        assert_eq!(runs_of(&list, false), [2..3, 4..6]);
        assert!(runs_of(&[], true).is_empty());
    }

    #[test]
    fn matrices_go_from_the_middle_of_a_part_to_the_anchor() {
        let (middle, anchor) = (DVec3::new(1e6, 2.0, 3.0), DVec3::new(-5.0, 1e7, 0.25));
        let matrix =
            DMat4::from_translation(anchor - middle + DVec3::X) * DMat4::from_scale(DVec3::splat(2.0));
        let [x, y, z] = rows(&matrix, middle, anchor);
        assert_eq!([x[0], y[1], z[2]], [2.0; 3]);
        assert_eq!([x[3], y[3], z[3]], [1e6 + 1.0, 2.0, 3.0]);
    }
}
