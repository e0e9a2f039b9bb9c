//! Boxes that follow moved vertices while the tree keeps its shape: for instances that move from frame to frame,
//! where a new tree would take too long.
//!
//! **Refit.** `WideBvh::refit` moves the boxes of a built tree to where its vertices are now, from the leaves
//! up, and tells the change of cost, so that a caller can decide for a new tree. Compact nodes are made from
//! the wide ones in a linear pass. A moving part's tree is fitted in the same way (`src/bvh/parted.rs`), or by
//! devices (`kernels/refit.cl`).

use glam::Vec3;
use rayon::prelude::*;

use super::WideBvh;
use super::binary::Bounds;
use super::improve::bounds_of;
use super::wide::{Cost, EMPTY, LEAF, WideNode, leaf_range};

/// What a refit did to the tree's quality.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Refit {
    /// What a ray visited before; see [`WideBvh::cost`].
    pub before: Cost,
    /// What a ray visits now.
    pub after: Cost,
}

impl Refit {
    /// How many times as much a ray visits as before. Well above 1, a new tree pays; a tree that has just been
    /// built over the moved vertices is the measure, since what moved may be harder or easier by itself.
    pub fn growth(&self) -> f64 {
        self.after.sum() / self.before.sum()
    }
}

impl WideBvh {
    /// Fits all boxes to where the vertices are now, from the leaves up, in time linear in the triangles and on
    /// all cores. `triangles` are those that the tree was built over, `positions` their vertices in metres,
    /// relative to the scene's anchor as ever. Nodes, links and the order of triangles stay.
    ///
    /// Every ray then meets what it would meet in a new tree, only more slowly, the more so the further
    /// neighbours have moved apart: [`Refit`] says by how much. A triangle that was cut for the build is held
    /// whole by each of its leaves from now on. Compact nodes are to be made anew from the wide ones
    /// ([`super::compact::compact_nodes`]), which is linear too.
    ///
    /// # Errors
    /// A sentence about the first vertex that is not finite; the tree is as it was.
    ///
    /// # Panics
    /// If the tree was built over more triangles, or they name vertices that are not there.
    pub fn refit(&mut self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<Refit, String> {
        if let Some(vertex) = positions.par_iter().position_first(|p| !p.is_finite()) {
            return Err(format!("vertex {vertex} is not finite; leave the tree as it is"));
        }
        let before = self.cost();
        let order = &self.order;
        let triangle_bounds = |place: usize| {
            bounds_of(&triangles[order[place].triangle as usize].map(|corner| positions[corner as usize]))
        };
        self.nodes.par_iter_mut().for_each(|node| {
            let children = node.children;
            let is_leaf = |slot: &usize| children[*slot] != EMPTY && children[*slot] & LEAF != 0;
            for slot in (0..8).filter(is_leaf) {
                let (first, count) = leaf_range(children[slot]);
                let bounds = (first..first + count).map(triangle_bounds).fold(Bounds::EMPTY, Bounds::union);
                node.set(slot, (bounds.lower, bounds.upper), children[slot]);
            }
        });
        // Children come after their parents, so that from the end on all below a node is done.
        for index in (0..self.nodes.len()).rev() {
            let children = self.nodes[index].children;
            for (slot, child) in children.into_iter().enumerate().filter(|(_, child)| child & LEAF == 0) {
                let (lower, upper) = extent(&self.nodes[child as usize]);
                self.nodes[index].set(slot, (lower, upper), child);
            }
        }
        Ok(Refit { before, after: self.cost() })
    }
}

/// The box around a node's children. Empty slots are inverted and infinite, and change nothing.
pub(crate) fn extent(node: &WideNode) -> (Vec3, Vec3) {
    let fold = |rows: &[[f32; 8]; 3], start: f32, f: fn(f32, f32) -> f32| {
        Vec3::from_array(rows.map(|row| row.into_iter().fold(start, f)))
    };
    (fold(&node.lower, f32::INFINITY, f32::min), fold(&node.upper, f32::NEG_INFINITY, f32::max))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Small triangles in a cube, and some long ones through it, which builds cut.
    fn cloud(small: usize, long: usize) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let mut state = 7u32;
        let mut next = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let mut positions = Vec::new();
        for i in 0..small + long {
            let at = Vec3::new(next(), next(), next()) * 10.0;
            let size = if i < small { 0.2 } else { 9.0 };
            positions.extend([
                at,
                at + Vec3::new(next(), next(), 0.1) * size,
                at + Vec3::new(0.1, next(), next()) * size,
            ]);
        }
        let triangles = (0..(small + long) as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        (positions, triangles)
    }

    fn twisted(p: Vec3) -> Vec3 {
        glam::Quat::from_rotation_y(0.2 * p.y) * p + Vec3::new(0.0, 0.3 * p.x.sin(), 100.0)
    }

    #[test]
    fn without_motion_nothing_changes() {
        let (positions, triangles) = cloud(5000, 0);
        let fresh = WideBvh::build(&positions, &triangles);
        let mut tree = fresh.clone();
        let refit = tree.refit(&positions, &triangles).unwrap();
        assert_eq!((tree, refit.growth()), (fresh, 1.0));
        let mut empty = WideBvh::build(&[], &[]);
        assert_eq!(empty.refit(&[], &[]).unwrap().growth(), 1.0);
    }

    #[test]
    fn moved_triangles_are_held_and_the_loss_is_told() {
        for long in [0, 300] {
            let (positions, triangles) = cloud(5000, long);
            let mut tree = WideBvh::build(&positions, &triangles);
            assert_eq!(tree.order.len() > triangles.len(), long > 0, "cut or not");
            let moved: Vec<Vec3> = positions.iter().copied().map(twisted).collect();
            assert!(tree.validate(&moved, &triangles).is_err(), "the old boxes do not hold them");
            let refit = tree.refit(&moved, &triangles).unwrap();
            tree.validate(&moved, &triangles).unwrap();
            assert_eq!(refit.after, tree.cost());
            let fresh = WideBvh::build(&moved, &triangles).cost().sum();
            assert!(refit.after.sum() > fresh && refit.growth() < 3.0, "{refit:?} {fresh}");
        }
        // Where every triangle goes elsewhere, the tree is good for nothing, and says so.
        let (positions, triangles) = cloud(2000, 0);
        let mut tree = WideBvh::build(&positions, &triangles);
        let shuffled: Vec<Vec3> = (0..positions.len())
            .map(|i| positions[i / 3 * 3 * 1009 % positions.len()] + positions[i] * 0.01)
            .collect();
        assert!(tree.refit(&shuffled, &triangles).unwrap().growth() > 5.0);
        tree.validate(&shuffled, &triangles).unwrap();
    }

    #[test]
    fn degenerate_motion_leaves_a_valid_tree() {
        let (positions, triangles) = cloud(1000, 20);
        let motions: [fn(Vec3) -> Vec3; 5] = [
            |_| Vec3::splat(3.5),
            |p| Vec3::new(p.x, 0.0, 0.0),
            |p| p * 1e30,
            |p| p * 1e-38,
            |p| Vec3::new(p.x * 1e20, p.y, -p.z),
        ];
        let mut tree = WideBvh::build(&positions, &triangles);
        for (index, motion) in motions.into_iter().enumerate() {
            let moved: Vec<Vec3> = positions.iter().copied().map(motion).collect();
            tree.refit(&moved, &triangles).unwrap();
            tree.validate(&moved, &triangles).unwrap_or_else(|problem| panic!("motion {index}: {problem}"));
        }
        tree.refit(&positions, &triangles).unwrap();
        tree.validate(&positions, &triangles).unwrap();
    }

    #[test]
    fn vertices_that_are_not_finite_are_refused_and_change_nothing() {
        let (positions, triangles) = cloud(100, 0);
        let mut tree = WideBvh::build(&positions, &triangles);
        let before = tree.clone();
        for bad in [f32::NAN, f32::INFINITY] {
            let mut moved = positions.clone();
            moved[17].y = bad;
            assert!(tree.refit(&moved, &triangles).unwrap_err().contains("vertex 17"));
            assert_eq!(tree, before);
        }
    }
}
