//! Building the wide tree: a binary tree, which leaves are worth having, eight children a node.
//!
//! **Two tree builders.** From above by binned SAH (`src/bvh/binary.rs`), and, where some triangles fill
//! little of their boxes, also from below with long triangles' boxes cut (PLOC; `src/bvh/improve.rs`);
//! subtrees are then moved to better places, and the tree with the lower cost is kept. Clustering, cutting
//! and moving are the obvhs crate's, chosen since it builds in parallel and gave better trees than our own
//! alone: on Sponza rays visit a third fewer nodes. Boxes and depth are ours: it promises no depth, and the
//! kernels' stacks are sized from the tree. Where bins cannot separate triangles, or after 60 levels, sets
//! are halved by count, so that a million coincident triangles do not make the tree deep.

use glam::Vec3;
use rayon::prelude::*;

use std::sync::atomic::{AtomicUsize, Ordering};

use super::TreeFor;
use super::binary::{self, Primitive};
use super::binary_tree::BinaryTree;
use super::choice::{Choice, Chosen};
use super::improve;
use super::wide::{LEAF, LeafSlot, WideBvh, WideNode};

impl WideBvh {
    /// Builds a tree over triangles with finite vertices, on all cores, for packets.
    pub fn build(positions: &[Vec3], triangles: &[[u32; 3]]) -> WideBvh {
        WideBvh::build_for(TreeFor::Packets, positions, triangles, &|_| ())
    }

    /// The same for what is to walk it, telling how much of it is done, from 0 to 1.
    ///
    /// Two trees are built where some triangles fill little of their boxes, from above and from below, and the
    /// better one is kept; elsewhere the one from above is.
    pub fn build_for(
        tree_for: TreeFor,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        tell: &(dyn Fn(f64) + Sync),
    ) -> WideBvh {
        let mut primitives = primitives_of(positions, triangles);
        if primitives.is_empty() {
            return WideBvh { nodes: vec![WideNode::VACANT], order: Vec::new() };
        }
        improve::cut(&mut primitives, |index| {
            triangles[index as usize].map(|corner| positions[corner as usize])
        });
        assert!(primitives.len() < 1 << 28, "leaves count their triangles in 28 bits");
        let has_long_triangles = primitives.len() > triangles.len();
        let total = primitives.len() as f64 * if has_long_triangles { 2.0 } else { 1.2 };
        let done = AtomicUsize::new(0);
        let placed = |count: usize| tell((done.fetch_add(count, Ordering::Relaxed) + count) as f64 / total);
        let tree = binary::build(&mut primitives, &placed);
        if !has_long_triangles {
            // Half a gigabyte, for large scenes, which the steps that follow have a use for.
            drop(primitives);
            return WideBvh::from_binary(improve::reinserted(tree), tree_for);
        }
        let from_above = WideBvh::from_binary(improve::reinserted(tree), tree_for);
        let from_below = WideBvh::from_binary(improve::clustered(&primitives), tree_for);
        let cost = |tree: &WideBvh| tree.cost().of(tree_for);
        if cost(&from_below) < cost(&from_above) { from_below } else { from_above }
    }

    /// A tree whose boxes will follow their vertices: no triangle is cut, since pieces would not.
    pub fn build_whole(tree_for: TreeFor, positions: &[Vec3], triangles: &[[u32; 3]]) -> WideBvh {
        let mut primitives = primitives_of(positions, triangles);
        if primitives.is_empty() {
            return WideBvh { nodes: vec![WideNode::VACANT], order: Vec::new() };
        }
        let tree = binary::build(&mut primitives, &|_| ());
        drop(primitives);
        WideBvh::from_binary(improve::reinserted(tree), tree_for)
    }

    /// Makes a tree wide, whoever built it.
    pub fn from_binary(tree: BinaryTree, tree_for: TreeFor) -> WideBvh {
        let order = Vec::with_capacity(tree.triangles.len());
        let mut wide = WideBvh { nodes: vec![WideNode::VACANT], order };
        wide.collapse(&Choice::of(tree, tree_for));
        wide
    }

    /// Emits nodes depth first, so that what is walked together lies together.
    fn collapse(&mut self, choice: &Choice) {
        let mut pending = vec![(0, 0usize)];
        while let Some((root, wide)) = pending.pop() {
            for (slot, child) in choice.children(root).into_iter().enumerate() {
                let Chosen { bounds, first, triangles } = choice.nodes[child as usize];
                let link = if triangles > 0 {
                    self.emit_leaf(&choice.triangles[first as usize..][..triangles as usize])
                } else {
                    self.nodes.push(WideNode::VACANT);
                    pending.push((child, self.nodes.len() - 1));
                    self.nodes.len() as u32 - 1
                };
                self.nodes[wide].set(slot, (bounds.lower, bounds.upper), link);
            }
        }
    }

    fn emit_leaf(&mut self, triangles: &[u32]) -> u32 {
        let (first, leaf_len) = (self.order.len() as u32, triangles.len() as u8);
        for (lane, &triangle) in triangles.iter().enumerate() {
            self.order.push(LeafSlot { triangle, lane: lane as u8, leaf_len });
        }
        LEAF | (u32::from(leaf_len) - 1) << 28 | first
    }
}

/// Triangles and their boxes.
fn primitives_of(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Primitive> {
    assert!(triangles.len() < 1 << 28, "leaves count their triangles in 28 bits");
    let primitive = |(index, corners): (usize, &[u32; 3])| {
        let bounds = improve::bounds_of(&corners.map(|corner| positions[corner as usize]));
        Primitive { bounds, triangle: index as u32 }
    };
    triangles.par_iter().enumerate().map(primitive).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::binary_tree::eight_below;
    use crate::bvh::forest::LONE_TRIANGLES;

    /// A deterministic cloud of small triangles.
    fn cloud(n: usize) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let mut state = 1u32;
        let mut next = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let positions: Vec<Vec3> = (0..n)
            .flat_map(|_| {
                let at = Vec3::new(next(), next(), next()) * 10.0;
                [at, at + Vec3::new(next(), next(), 0.0) * 0.2, at + Vec3::new(0.0, next(), next()) * 0.2]
            })
            .collect();
        let triangles = (0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        (positions, triangles)
    }

    #[test]
    fn trees_hold_every_triangle_once() {
        for n in [0, 1, 2, 8, 9, 100, 20_000] {
            let (positions, triangles) = cloud(n);
            let bvh = WideBvh::build(&positions, &triangles);
            bvh.validate(&positions, &triangles).unwrap();
        }
    }

    #[test]
    fn trees_for_single_rays_have_small_leaves() {
        for n in [0, 1, 2, 3, 9, 100, 20_000] {
            let (positions, triangles) = cloud(n);
            let [packets, single] = [TreeFor::Packets, TreeFor::SingleRays]
                .map(|tree_for| WideBvh::build_for(tree_for, &positions, &triangles, &|_| ()));
            assert_eq!(packets, WideBvh::build(&positions, &triangles));
            single.validate(&positions, &triangles).unwrap();
            assert!(single.is_sound(&positions, &triangles));
            let largest = |tree: &WideBvh| tree.order.iter().map(|slot| slot.leaf_len).max().unwrap_or(0);
            assert!(usize::from(largest(&single)) <= LONE_TRIANGLES);
            let whole = WideBvh::build_whole(TreeFor::SingleRays, &positions, &triangles);
            whole.validate(&positions, &triangles).unwrap();
            assert!(usize::from(largest(&whole)) <= LONE_TRIANGLES);
            if n > 1000 {
                assert!(usize::from(largest(&packets)) > LONE_TRIANGLES);
            }
        }
    }

    #[test]
    fn single_rays_pay_no_more_than_where_the_largest_nodes_are_opened() {
        let (positions, triangles) = cloud(5000);
        let mut primitives = primitives_of(&positions, &triangles);
        let tree = binary::build(&mut primitives, &|_| ());
        // The same leaves, and eight children a node as trees for packets have them.
        let choice = Choice::of(tree, TreeFor::SingleRays);
        let (mut nodes, mut pending) = (0.0, vec![0]);
        let opened = |at: u32| {
            let node = &choice.nodes[at as usize];
            (node.triangles == 0).then_some((node.bounds.half_area(), node.first))
        };
        while let Some(at) = pending.pop() {
            nodes += choice.nodes[at as usize].bounds.half_area();
            pending.extend(eight_below(at, opened).into_iter().filter(|&child| opened(child).is_some()));
        }
        let mut best = WideBvh { nodes: vec![WideNode::VACANT], order: Vec::new() };
        best.collapse(&choice);
        let greedy = nodes / choice.nodes[0].bounds.half_area();
        assert!(best.cost().nodes < greedy, "{} {greedy}", best.cost().nodes);
    }

    #[test]
    fn a_million_coincident_triangles_are_no_trouble() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let triangles = vec![[0, 1, 2]; 1_000_000];
        for tree_for in [TreeFor::Packets, TreeFor::SingleRays] {
            let bvh = WideBvh::build_for(tree_for, &positions, &triangles, &|_| ());
            bvh.validate(&positions, &triangles).unwrap();
            assert!(bvh.depth() <= 20, "{}", bvh.depth());
        }
    }

    #[test]
    fn extreme_scales_and_lines_of_triangles_stay_shallow() {
        for scale in [1e-30f32, 1e-6, 1e6, 1e30] {
            let (positions, triangles) = cloud(1000);
            let positions: Vec<Vec3> = positions.iter().map(|&p| p * scale).collect();
            let bvh = WideBvh::build(&positions, &triangles);
            bvh.validate(&positions, &triangles).unwrap();
        }
        // Every triangle twice as far as the one before: the deepest splits that bins can make.
        let positions: Vec<Vec3> = (-120..120)
            .flat_map(|i| {
                let x = 2.0f32.powi(i);
                [Vec3::new(x, 0.0, 0.0), Vec3::new(x, x, 0.0), Vec3::new(x, 0.0, x)]
            })
            .collect();
        let triangles: Vec<[u32; 3]> = (0..240).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        for tree_for in [TreeFor::Packets, TreeFor::SingleRays] {
            let bvh = WideBvh::build_for(tree_for, &positions, &triangles, &|_| ());
            bvh.validate(&positions, &triangles).unwrap();
            assert!(bvh.depth() <= crate::bvh::MAX_DEPTH);
        }
    }

    #[test]
    fn long_triangles_are_cut_and_trees_come_out_the_same_again() {
        let (mut positions, mut triangles) = cloud(5000);
        for i in 0..400 {
            let from = Vec3::new(0.02 * i as f32, 0.0, 0.0);
            let first = positions.len() as u32;
            positions.extend([from, from + Vec3::splat(9.0), from + Vec3::new(9.0, 9.1, 9.0)]);
            triangles.push([first, first + 1, first + 2]);
        }
        let bvh = WideBvh::build(&positions, &triangles);
        bvh.validate(&positions, &triangles).unwrap();
        assert!(bvh.order.len() > triangles.len(), "none was cut");
        assert_eq!(bvh, WideBvh::build(&positions, &triangles));
        let mut whole: Vec<Primitive> = (triangles.iter().enumerate())
            .map(|(index, corners)| Primitive {
                bounds: improve::bounds_of(&corners.map(|corner| positions[corner as usize])),
                triangle: index as u32,
            })
            .collect();
        let plain = WideBvh::from_binary(binary::build(&mut whole, &|_| ()), TreeFor::Packets);
        assert!(bvh.cost().sum() < plain.cost().sum(), "{:?} {:?}", bvh.cost(), plain.cost());
    }

    #[test]
    fn building_tells_how_far_it_is() {
        let (positions, triangles) = cloud(20_000);
        let told = std::sync::Mutex::new(Vec::new());
        let tell = |done| told.lock().unwrap().push(done);
        WideBvh::build_for(TreeFor::Packets, &positions, &triangles, &tell);
        let told = told.into_inner().unwrap();
        let last = told.iter().copied().fold(0.0, f64::max);
        assert!(told.len() > 3 && last > 0.4 && last <= 1.0, "{told:?}");
    }

    #[test]
    fn validation_notices_a_box_that_is_too_small() {
        let (positions, triangles) = cloud(100);
        let mut bvh = WideBvh::build(&positions, &triangles);
        bvh.nodes[0].upper[0][0] -= 1.0;
        assert!(bvh.validate(&positions, &triangles).is_err());
    }
}
