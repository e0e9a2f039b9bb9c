//! The tree of one part of a scene, as it lies in the tree over all of them.

use glam::Vec3;
use rayon::prelude::*;

use super::binary::Bounds;
use super::refit::extent;
use super::wide::{EMPTY, LEAF, LeafSlot, WideBvh, WideNode, leaf_range};

/// Parts of a part's tree that one thread looks at, at least.
const FEW: usize = 64;

/// The tree of one part.
#[derive(Clone, Debug)]
pub struct PartTree {
    pub(super) root: WideNode,
    /// All but the root; links are places in the whole tree.
    pub nodes: Vec<WideNode>,
    /// Where the first of them is in the whole tree.
    pub first_node: usize,
    /// Its triangles, by their numbers in the mesh, in leaf order.
    pub order: Vec<LeafSlot>,
    /// Where the first of them is in the whole leaf order.
    pub first_place: usize,
    /// What a ray visited when the tree was built, as [`PartTree::cost`] tells.
    built: f64,
}

impl PartTree {
    /// A tree's nodes and triangles as they are in the whole one.
    pub(super) fn new(tree: WideBvh, first_node: usize, first_place: usize, first_triangle: usize) -> Self {
        let place = |mut node: WideNode| {
            if node.instance().is_some() {
                return node;
            }
            for child in node.children.iter_mut().filter(|child| **child != EMPTY) {
                *child = match *child & LEAF {
                    // The root is elsewhere, and nothing leads to it.
                    0 => *child - 1 + first_node as u32,
                    _ => *child + first_place as u32,
                };
            }
            node
        };
        let mut nodes = tree.nodes.into_iter().map(place);
        let root = nodes.next().unwrap_or(WideNode::VACANT);
        let moved = |slot: LeafSlot| LeafSlot { triangle: slot.triangle + first_triangle as u32, ..slot };
        let mut part = PartTree {
            root,
            nodes: nodes.collect(),
            first_node,
            order: tree.order.into_iter().map(moved).collect(),
            first_place,
            built: 0.0,
        };
        part.built = part.cost();
        part
    }

    /// Nodes and leaves that a ray visits which meets its box, as [`WideBvh::cost`] has them together.
    pub fn cost(&self) -> f64 {
        let area = |node: &WideNode| -> f64 {
            if node.instance().is_some() {
                return 0.0;
            }
            let slots = (0..8).filter(|&slot| node.children[slot] != EMPTY);
            let corner = |rows: &[[f32; 8]; 3], slot: usize| Vec3::from_array(rows.map(|row| row[slot]));
            let box_of = |slot| Bounds { lower: corner(&node.lower, slot), upper: corner(&node.upper, slot) };
            slots.map(|slot| box_of(slot).half_area()).sum()
        };
        let (lower, upper) = extent(&self.root);
        let whole = Bounds { lower, upper }.half_area();
        let sum = self.nodes.iter().chain([&self.root]).map(area).sum::<f64>();
        if whole > 0.0 { 1.0 + sum / whole } else { 1.0 }
    }

    /// How many times as much a ray visits as when the tree was built.
    pub fn growth(&self) -> f64 {
        self.cost() / self.built
    }

    /// The same where its triangles are elsewhere; `corners` tells, of each of them.
    pub fn growth_at(&self, corners: impl Fn(u32) -> [Vec3; 3] + Sync) -> f64 {
        let (mut moved, mut vertices) = (self.clone(), vec![0.0; self.order.len() * 9]);
        moved.lay_out(&corners, &mut vertices);
        moved.refit(&vertices);
        moved.growth()
    }

    /// All nodes but the root, by how many levels are below each.
    pub fn levels(&self) -> Vec<Vec<u32>> {
        let (mut heights, mut levels) = (vec![0usize; self.nodes.len()], Vec::<Vec<u32>>::new());
        for index in (0..self.nodes.len()).rev() {
            let children = self.nodes[index].children;
            if children.iter().all(|&child| child == EMPTY) {
                continue;
            }
            let below = children.into_iter().filter(|child| child & LEAF == 0);
            let height = below.map(|child| heights[child as usize - self.first_node] + 1).max().unwrap_or(0);
            heights[index] = height;
            levels.resize(levels.len().max(height + 1), Vec::new());
            levels[height].push((self.first_node + index) as u32);
        }
        levels
    }

    /// Boxes from the vertices of the leaves.
    pub(super) fn refit(&mut self, vertices: &[f32]) {
        let (first_place, first_node) = (self.first_place, self.first_node);
        let fit = |node: &mut WideNode| {
            let children = node.children;
            for (slot, child) in children.into_iter().enumerate() {
                if child == EMPTY || child & LEAF == 0 {
                    continue;
                }
                let (first, count) = leaf_range(child);
                let leaf = &vertices[(first - first_place) * 9..(first - first_place + count) * 9];
                node.set(slot, bounds_of_leaf(leaf, count), child);
            }
        };
        self.nodes.par_iter_mut().with_min_len(FEW).for_each(fit);
        fit(&mut self.root);
        // Children come after their parents, so that from the end on all below a node is done.
        for index in (0..self.nodes.len()).rev() {
            let mut node = self.nodes[index];
            self.follow(&mut node, first_node);
            self.nodes[index] = node;
        }
        let mut root = self.root;
        self.follow(&mut root, first_node);
        self.root = root;
    }

    /// Takes the boxes of the nodes below from these.
    fn follow(&self, node: &mut WideNode, first_node: usize) {
        let children = node.children;
        for (slot, child) in children.into_iter().enumerate().filter(|(_, child)| child & LEAF == 0) {
            node.set(slot, extent(&self.nodes[child as usize - first_node]), child);
        }
    }

    /// Writes the vertex coordinates of its triangles in leaf order, many leaves at a time.
    pub(super) fn lay_out(&self, corners: &(impl Fn(u32) -> [Vec3; 3] + Sync), vertices: &mut [f32]) {
        const MANY: usize = 4096;
        let (mut order, mut left) = (&self.order[..], vertices);
        let mut work = Vec::with_capacity(order.len() / MANY + 1);
        while !order.is_empty() {
            // To the end of a leaf.
            let end = (MANY..order.len()).find(|&place| order[place].lane == 0).unwrap_or(order.len());
            let (own, rest) = std::mem::take(&mut left).split_at_mut(end * 9);
            work.push((&order[..end], own));
            (order, left) = (&order[end..], rest);
        }
        work.into_par_iter().for_each(|(order, vertices)| {
            for (place, slot) in order.iter().enumerate() {
                let (first, lane) = ((place - slot.lane as usize) * 9, slot.lane as usize);
                for (corner, p) in corners(slot.triangle).into_iter().enumerate() {
                    for axis in 0..3 {
                        vertices[first + (corner * 3 + axis) * slot.leaf_len as usize + lane] = p[axis];
                    }
                }
            }
        });
    }
}

/// The box around a leaf of so many triangles, from its vertices as they are laid out.
fn bounds_of_leaf(vertices: &[f32], count: usize) -> (Vec3, Vec3) {
    let (mut lower, mut upper) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for (row, values) in vertices.chunks_exact(count).enumerate() {
        let axis = row % 3;
        lower[axis] = values.iter().copied().fold(lower[axis], f32::min);
        upper[axis] = values.iter().copied().fold(upper[axis], f32::max);
    }
    (lower, upper)
}
