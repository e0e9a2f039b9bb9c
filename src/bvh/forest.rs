//! Wide nodes and leaves for rays that test one triangle after the other.
//!
//! Where eight triangles do not cost what one does, large leaves do not pay, and what a node costs counts for more. Which
//! nodes of the binary tree become wide nodes, their children or leaves is then decided for the least cost of the whole, by
//! dynamic programming: what lies below a node is a forest of one to eight roots, shared out between its two children in the
//! best way (Ylitie, Karras and Laine 2017, "Efficient incoherent ray traversal on GPUs through compressed wide BVHs").

use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};

use super::binary_tree::BinaryTree;
use super::choice::PARALLEL_LEVELS;

/// Cost of a wide node in units of a triangle's test: some 400 instructions to 130 on NVIDIA's cards.
pub(super) const NODE_COST: f64 = 3.0;
/// Triangles in a leaf at most. With three, rays visit 1 % fewer nodes and test 5 % more triangles.
pub(super) const LONE_TRIANGLES: usize = 2;

/// Children of a wide node at most.
const WIDTH: usize = 8;
/// The mark of an inner node that becomes a leaf.
const IS_LEAF: u32 = 1 << 31;

/// What a ray pays below a node as a forest of at most 1, 2 .. 7 roots.
type Costs = [f64; WIDTH - 1];

/// How the forests below each node of a binary tree are shared out.
pub(super) struct Forests {
    /// For each node three bits for each number of roots from two on, as [`first_child`] reads them, and [`IS_LEAF`].
    shares: Vec<AtomicU32>,
    /// Inner nodes at the limit of depth, below which nothing was looked at.
    pub too_deep: Mutex<Vec<u32>>,
}

/// Of so many roots below a node, two or more, those below its first child; 0 where fewer roots are as good.
fn first_child(shares: u32, roots: usize) -> usize {
    (shares >> (3 * (roots - 2)) & 7) as usize
}

impl Forests {
    pub fn of(tree: &BinaryTree, limit: u32) -> Forests {
        let shares = (0..tree.nodes.len()).map(|_| AtomicU32::new(0)).collect();
        let forests = Forests { shares, too_deep: Mutex::default() };
        forests.weigh(tree, 0, 0, limit);
        forests
    }

    /// Whether an inner node becomes a leaf.
    pub fn is_leaf(&self, at: u32) -> bool {
        self.shares(at) & IS_LEAF != 0
    }

    /// How what is below a node is shared out.
    pub fn shares(&self, at: u32) -> u32 {
        self.shares[at as usize].load(Ordering::Relaxed)
    }

    /// Leaves of the binary tree below a node, and what its forests cost.
    fn weigh(&self, tree: &BinaryTree, at: u32, depth: u32, limit: u32) -> (usize, Costs) {
        let area = tree.bounds(at).half_area();
        let Some(first) = tree.children(at) else { return (1, [area; WIDTH - 1]) };
        if depth == limit {
            self.too_deep.lock().expect("no thread has panicked").push(at);
            return (1, [area; WIDTH - 1]);
        }
        let deeper = |at| self.weigh(tree, at, depth + 1, limit);
        let (left, right) = if depth < PARALLEL_LEVELS {
            rayon::join(|| deeper(first), || deeper(first + 1))
        } else {
            (deeper(first), deeper(first + 1))
        };
        let count = left.0 + right.0;
        // The cheapest way to share so many roots, and how many the first child gets.
        let shared = |roots: usize| {
            let ways = (1..roots).filter(|&mine| mine < WIDTH && roots - mine < WIDTH);
            let cost = |mine: usize| left.1[mine - 1] + right.1[roots - mine - 1];
            // Of ways that cost the same the most even one: trees of boxes without a surface stay shallow.
            let by_cost = |a: &(f64, usize), b: &(f64, usize)| {
                a.0.total_cmp(&b.0).then((2 * a.1).abs_diff(roots).cmp(&(2 * b.1).abs_diff(roots)))
            };
            ways.map(|mine| (cost(mine), mine)).min_by(by_cost).expect("two roots or more")
        };
        let (below, mine) = shared(WIDTH);
        let (inner, leaf) = (below + area * NODE_COST, area * count as f64);
        if count <= LONE_TRIANGLES && leaf <= inner {
            // It is one root, however many there may be.
            self.shares[at as usize].store(IS_LEAF, Ordering::Relaxed);
            return (count, [leaf; WIDTH - 1]);
        }
        let mut shares = (mine as u32) << (3 * (WIDTH - 2));
        let mut costs = [inner; WIDTH - 1];
        for roots in 2..WIDTH {
            costs[roots - 1] = costs[roots - 2];
            let (cost, mine) = shared(roots);
            if cost <= costs[roots - 1] {
                costs[roots - 1] = cost;
                shares |= (mine as u32) << (3 * (roots - 2));
            }
        }
        self.shares[at as usize].store(shares, Ordering::Relaxed);
        (count, costs)
    }
}

/// The children of the wide node that an inner node becomes. `opened` tells of an inner node how it is shared out and the
/// first of its two children, which follow each other; nothing of leaves.
pub(super) fn children(root: u32, opened: &impl Fn(u32) -> Option<(u32, u32)>) -> Vec<u32> {
    let mut found = Vec::with_capacity(WIDTH);
    gather(root, WIDTH, opened, &mut found);
    found
}

/// The roots of a node's forest of so many roots at most.
fn gather(at: u32, mut roots: usize, opened: &impl Fn(u32) -> Option<(u32, u32)>, found: &mut Vec<u32>) {
    let Some((shares, first)) = opened(at) else { return found.push(at) };
    while roots > 1 && first_child(shares, roots) == 0 {
        roots -= 1;
    }
    if roots == 1 {
        return found.push(at);
    }
    let mine = first_child(shares, roots);
    gather(first, mine, opened, found);
    gather(first + 1, roots - mine, opened, found);
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::bvh::binary::{self, Bounds, Primitive};

    /// A binary tree over boxes of all sizes, and over points that are all the same.
    fn trees() -> [BinaryTree; 2] {
        let hash = |i: u32| {
            ((i.wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995).wrapping_mul(0x85eb_ca6b) >> 9) as f32 / 8e6
        };
        let boxed = |i: u32| {
            let lower = Vec3::new(hash(6 * i), hash(6 * i + 1), hash(6 * i + 2));
            let size = Vec3::new(hash(6 * i + 3), hash(6 * i + 4), hash(6 * i + 5)).powf(4.0);
            Primitive { bounds: Bounds { lower, upper: lower + size }, triangle: i }
        };
        let point = |i| Primitive { bounds: Bounds { lower: Vec3::ONE, upper: Vec3::ONE }, triangle: i };
        let tree = |mut primitives: Vec<Primitive>| binary::build(&mut primitives, &|_| ());
        [tree((0..3000).map(boxed).collect()), tree((0..600).map(point).collect())]
    }

    fn children_of(tree: &BinaryTree, forests: &Forests, at: u32) -> Vec<u32> {
        let inner = |at: u32| tree.children(at).filter(|_| !forests.is_leaf(at));
        children(at, &|at| inner(at).map(|first| (forests.shares(at), first)))
    }

    fn triangles(tree: &BinaryTree, at: u32) -> usize {
        tree.children(at).map_or(1, |first| triangles(tree, first) + triangles(tree, first + 1))
    }

    /// What the tree costs that is made, and its depth.
    fn made(tree: &BinaryTree, forests: &Forests, at: u32) -> (f64, usize) {
        let area = tree.bounds(at).half_area();
        if tree.children(at).is_none() || forests.is_leaf(at) {
            return (area * triangles(tree, at) as f64, 0);
        }
        let below = children_of(tree, forests, at).into_iter().map(|child| made(tree, forests, child));
        below.fold((area * NODE_COST, 1), |sum, child| (sum.0 + child.0, sum.1.max(child.1 + 1)))
    }

    #[test]
    fn the_tree_that_is_made_is_the_one_that_was_weighed() {
        for tree in trees() {
            let forests = Forests::of(&tree, u32::MAX);
            let (count, costs) = forests.weigh(&tree, 0, 0, u32::MAX);
            let (cost, depth) = made(&tree, &forests, 0);
            assert!((cost - costs[0]).abs() <= 1e-9 * costs[0], "{cost} {costs:?}");
            assert_eq!(count, triangles(&tree, 0));
            assert!(depth <= 8, "{depth} levels of nodes for {count} triangles");
        }
    }
}
