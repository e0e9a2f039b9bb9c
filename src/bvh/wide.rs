//! The wide tree's layout: struct of arrays in every node and leaf, for vectors of eight lanes.

use glam::Vec3;

use super::binary::Bounds;
use super::forest::NODE_COST;
use super::{LEAF_TRIANGLES, TreeFor};

/// Eight children: their bounds as arrays, and where they are. 224 bytes.
///
/// A child is [`EMPTY`], a leaf ([`LEAF`] set) or the index of a node. Empty slots have inverted,
/// infinite bounds, but a walker must look at `children`, since an inverted box passes a slab test
/// that takes the minimum and maximum of both planes.
pub use crate::layout::{EMPTY, LEAF, PORTAL, WideNode};

impl WideNode {
    pub(super) const VACANT: WideNode =
        WideNode { lower: [[f32::INFINITY; 8]; 3], upper: [[f32::NEG_INFINITY; 8]; 3], children: [EMPTY; 8] };

    pub(super) fn set(&mut self, slot: usize, bounds: (Vec3, Vec3), child: u32) {
        for axis in 0..3 {
            self.lower[axis][slot] = bounds.0[axis];
            self.upper[axis][slot] = bounds.1[axis];
        }
        self.children[slot] = child;
    }
}

/// A leaf child's first triangle and its number of triangles.
pub fn leaf_range(child: u32) -> (usize, usize) {
    ((child & 0x0fff_ffff) as usize, (child >> 28 & 7) as usize + 1)
}

/// A tree over triangles. Node 0 is the root; it is always there, also without triangles.
#[derive(Clone, Debug, PartialEq)]
pub struct WideBvh {
    /// All nodes; children come after their parents.
    pub nodes: Vec<WideNode>,
    /// For each triangle in leaf order: its index in the mesh, and its place in its leaf.
    pub order: Vec<LeafSlot>,
}

/// Where a triangle lies in leaf order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LeafSlot {
    /// Index in the mesh.
    pub triangle: u32,
    /// Its lane in the leaf.
    pub lane: u8,
    /// Triangles in the leaf.
    pub leaf_len: u8,
}

impl WideBvh {
    /// Vertex coordinates in leaf order, 9 floats a triangle: in each leaf of n triangles n first x,
    /// n first y, n first z, then those of the second and the third vertex. Eight floats of padding
    /// follow, since kernels load eight lanes at any place.
    pub fn leaf_vertices(&self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<f32> {
        let mut vertices = vec![0.0; self.order.len() * 9 + LEAF_TRIANGLES];
        for (place, slot) in self.order.iter().enumerate() {
            let first = (place - slot.lane as usize) * 9;
            for (corner, &index) in triangles[slot.triangle as usize].iter().enumerate() {
                let p = positions[index as usize];
                for axis in 0..3 {
                    let row = (corner * 3 + axis) * slot.leaf_len as usize;
                    vertices[first + row + slot.lane as usize] = p[axis];
                }
            }
        }
        vertices
    }

    /// What a ray costs that crosses the root's box anywhere in any direction, by the surface area
    /// heuristic: the nodes and the leaves that it visits on average, and the triangles of these.
    pub fn cost(&self) -> Cost {
        let (mut cost, mut root) = (Cost { nodes: 0.0, leaves: 0.0, triangles: 0.0 }, Bounds::EMPTY);
        for (index, node) in self.nodes.iter().enumerate().filter(|(_, node)| node.instance().is_none()) {
            for slot in (0..8).filter(|&slot| node.children[slot] != EMPTY) {
                let bounds = Bounds {
                    lower: Vec3::from_array(node.lower.map(|row| row[slot])),
                    upper: Vec3::from_array(node.upper.map(|row| row[slot])),
                };
                if index == 0 {
                    root = root.union(bounds);
                }
                let (child, area) = (node.children[slot], bounds.half_area());
                if child & LEAF != 0 {
                    cost.leaves += area;
                    cost.triangles += area * leaf_range(child).1 as f64;
                } else {
                    cost.nodes += area;
                }
            }
        }
        let area = root.half_area();
        let share = |sum: f64| if area > 0.0 { sum / area } else { 0.0 };
        Cost { nodes: 1.0 + share(cost.nodes), leaves: share(cost.leaves), triangles: share(cost.triangles) }
    }

    /// Levels of nodes; 1 for a root alone. What instances lead to does not count.
    pub fn depth(&self) -> u32 {
        let mut depth = vec![1u32; self.nodes.len()];
        for (index, node) in self.nodes.iter().enumerate().filter(|(_, node)| node.instance().is_none()) {
            for child in node.children.into_iter().filter(|&child| child & LEAF == 0) {
                depth[child as usize] = depth[index] + 1;
            }
        }
        depth.into_iter().max().unwrap_or(0)
    }

    /// Checks the whole tree against its triangles: every triangle in one leaf whose bounds hold it, or in
    /// several whose bounds hold many points of it; every reference in range.
    ///
    /// # Errors
    /// A sentence about the first violation.
    pub fn validate(&self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), String> {
        let mut homes: Vec<Vec<(Vec3, Vec3)>> = vec![Vec::new(); triangles.len()];
        let mut pending = vec![(0u32, None::<(Vec3, Vec3)>)];
        while let Some((index, bounds)) = pending.pop() {
            let node = self.nodes.get(index as usize).ok_or(format!("node {index} does not exist"))?;
            for slot in 0..8 {
                let child = node.children[slot];
                if child == EMPTY {
                    continue;
                }
                let lower = Vec3::from_array(node.lower.map(|row| row[slot]));
                let upper = Vec3::from_array(node.upper.map(|row| row[slot]));
                if bounds.is_some_and(|(l, u)| lower.cmplt(l).any() || upper.cmpgt(u).any()) {
                    return Err(format!("child {slot} of node {index} reaches out of its parent"));
                }
                if child & LEAF == 0 {
                    if child <= index {
                        return Err(format!("node {index} points back to {child}"));
                    }
                    pending.push((child, Some((lower, upper))));
                    continue;
                }
                let (first, count) = leaf_range(child);
                for place in first..first + count {
                    let leaf = self.order.get(place).ok_or(format!("leaf place {place} does not exist"))?;
                    if leaf.lane as usize != place - first || leaf.leaf_len as usize != count {
                        return Err(format!("leaf place {place} has a wrong lane"));
                    }
                    homes[leaf.triangle as usize].push((lower, upper));
                }
            }
        }
        for (index, (triangle, homes)) in triangles.iter().zip(&homes).enumerate() {
            if homes.is_empty() {
                return Err(format!("triangle {index} is in no leaf"));
            }
            let held = |p: Vec3| homes.iter().any(|(l, u)| p.cmpge(*l).all() && p.cmple(*u).all());
            let corners = triangle.map(|vertex| positions[vertex as usize]);
            if !points_of(corners, if homes.len() == 1 { 1 } else { 24 }).into_iter().all(held) {
                return Err(format!("triangle {index} reaches out of its leaves"));
            }
        }
        Ok(())
    }
}

/// Points of a triangle: its corners, and what divides its edges in `steps`, with the points between.
fn points_of([a, b, c]: [Vec3; 3], steps: u32) -> Vec<Vec3> {
    let at = |i: u32, j: u32| {
        if i == steps {
            b
        } else if j == steps {
            c
        } else {
            let (u, v) = (f64::from(i) / f64::from(steps), f64::from(j) / f64::from(steps));
            let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
            (a * (1.0 - u - v) + b * u + c * v).as_vec3()
        }
    };
    (0..=steps).flat_map(|i| (0..=steps - i).map(move |j| at(i, j))).collect()
}

/// What rays visit; see [`WideBvh::cost`].
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Cost {
    /// Nodes.
    pub nodes: f64,
    /// Leaves.
    pub leaves: f64,
    /// Triangles of these leaves.
    pub triangles: f64,
}

impl Cost {
    /// Both together: a node and a leaf take about the same time.
    pub fn sum(&self) -> f64 {
        self.nodes + self.leaves
    }

    /// What the visits cost those that walk the tree: in leaves, or in triangles where these are tested one by one.
    pub fn of(&self, tree_for: TreeFor) -> f64 {
        match tree_for {
            TreeFor::Packets => self.sum(),
            TreeFor::SingleRays => self.nodes * NODE_COST + self.triangles,
        }
    }
}
