//! Which subtrees of a binary tree become leaves.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use super::binary::{Bounds, DEPTH_LIMIT};
use super::binary_tree::{BinaryTree, eight_below};
use super::forest::{self, Forests};
use super::{LEAF_TRIANGLES, TreeFor};

/// Cost of a binary node in units of a leaf's test. One wide node stands for up to seven binary
/// ones, and eight lanes test eight boxes or eight triangles in about the same time.
const NODE_COST: f64 = 1.0 / 7.0;
/// Levels near the root, whose subtrees are large enough to be worth a thread.
pub(super) const PARALLEL_LEVELS: u32 = 8;

/// A binary tree after it was decided which subtrees become leaves. Node 0 is the root.
pub struct Choice {
    pub nodes: Vec<Chosen>,
    /// Of the leaves.
    pub triangles: Vec<u32>,
    /// For single rays, how the forests below each node are shared out.
    shares: Option<Vec<u32>>,
}

/// An inner node or a leaf.
#[derive(Clone, Copy)]
pub struct Chosen {
    pub bounds: Bounds,
    /// Of a leaf its first place in the list of triangles, of others their first child; the second one follows it.
    pub first: u32,
    /// Of a leaf; 0 of others.
    pub triangles: u32,
}

impl Choice {
    /// Subtrees become leaves where testing all their triangles costs no more, by the surface area heuristic, than walking
    /// what is below. What lies too deep is halved by count first.
    pub fn of(mut tree: BinaryTree, tree_for: TreeFor) -> Choice {
        let mut leaves = Leaves::of(&tree, DEPTH_LIMIT, tree_for);
        let too_deep = leaves.take_too_deep();
        if !too_deep.is_empty() {
            too_deep.into_iter().for_each(|at| tree.halve_below(at));
            leaves = Leaves::of(&tree, u32::MAX, tree_for);
        }
        let vacant = Chosen { bounds: Bounds::EMPTY, first: 0, triangles: 0 };
        let shares = matches!(leaves, Leaves::Lone(_)).then(|| vec![0]);
        let mut choice =
            Choice { nodes: vec![vacant], triangles: Vec::with_capacity(tree.triangles.len()), shares };
        let mut pending = vec![(0, 0)];
        while let Some((from, to)) = pending.pop() {
            let bounds = tree.bounds(from);
            let inner = tree.children(from).filter(|_| !leaves.contain(from));
            choice.nodes[to] = match inner {
                None => choice.leaf(&tree, from, bounds),
                Some(children) => {
                    let first = choice.nodes.len();
                    choice.nodes.extend([vacant; 2]);
                    if let (Some(shares), Leaves::Lone(forests)) = (&mut choice.shares, &leaves) {
                        shares.extend([0; 2]);
                        shares[to] = forests.shares(from);
                    }
                    pending.extend([(children + 1, first + 1), (children, first)]);
                    Chosen { bounds, first: first as u32, triangles: 0 }
                }
            };
        }
        choice
    }

    /// A leaf of all triangles below a node.
    fn leaf(&mut self, tree: &BinaryTree, from: u32, bounds: Bounds) -> Chosen {
        let (mut found, mut pending) = (Vec::with_capacity(LEAF_TRIANGLES), vec![from]);
        while let Some(at) = pending.pop() {
            match tree.children(at) {
                Some(first) => pending.extend([first, first + 1]),
                None => found.push(tree.triangle(at)),
            }
        }
        // Pieces of one triangle may have come together.
        found.sort_unstable();
        found.dedup();
        let first = self.triangles.len() as u32;
        self.triangles.extend_from_slice(&found);
        Chosen { bounds, first, triangles: found.len() as u32 }
    }

    /// Up to eight descendants of a node, the children of the wide node that it becomes.
    pub fn children(&self, at: u32) -> Vec<u32> {
        let first = |at: u32| {
            let node = &self.nodes[at as usize];
            (node.triangles == 0).then_some((node, node.first))
        };
        match &self.shares {
            Some(shares) => {
                forest::children(at, &|at| first(at).map(|(_, first)| (shares[at as usize], first)))
            }
            None => eight_below(at, |at| first(at).map(|(node, first)| (node.bounds.half_area(), first))),
        }
    }
}

/// The inner nodes that become leaves.
enum Leaves {
    /// Of up to eight triangles, tested together.
    Wide(WideLeaves),
    /// Of few triangles, tested one after the other.
    Lone(Forests),
}

impl Leaves {
    fn of(tree: &BinaryTree, limit: u32, tree_for: TreeFor) -> Leaves {
        match tree_for {
            TreeFor::Packets => Leaves::Wide(WideLeaves::of(tree, limit)),
            TreeFor::SingleRays => Leaves::Lone(Forests::of(tree, limit)),
        }
    }

    /// Inner nodes at the limit of depth, below which nothing was looked at.
    fn take_too_deep(&mut self) -> Vec<u32> {
        let too_deep = match self {
            Leaves::Wide(leaves) => &mut leaves.too_deep,
            Leaves::Lone(forests) => &mut forests.too_deep,
        };
        std::mem::take(too_deep.get_mut().expect("no thread has panicked"))
    }

    fn contain(&self, at: u32) -> bool {
        match self {
            Leaves::Wide(leaves) => leaves.contain(at),
            Leaves::Lone(forests) => forests.is_leaf(at),
        }
    }
}

/// Leaves of up to eight triangles.
struct WideLeaves {
    /// One for each node.
    bits: Vec<AtomicU64>,
    /// Inner nodes at the limit of depth, below which nothing was looked at.
    too_deep: Mutex<Vec<u32>>,
}

impl WideLeaves {
    fn of(tree: &BinaryTree, limit: u32) -> WideLeaves {
        let bits = (0..tree.nodes.len().div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        let leaves = WideLeaves { bits, too_deep: Mutex::default() };
        leaves.weigh(tree, 0, 0, limit);
        leaves
    }

    fn contain(&self, at: u32) -> bool {
        self.bits[at as usize / 64].load(Ordering::Relaxed) & 1 << (at % 64) != 0
    }

    /// Leaves of the binary tree below a node, and what a ray pays there.
    fn weigh(&self, tree: &BinaryTree, at: u32, depth: u32, limit: u32) -> (usize, f64) {
        let area = tree.bounds(at).half_area();
        let Some(first) = tree.children(at) else { return (1, area) };
        if depth == limit {
            self.too_deep.lock().expect("no thread has panicked").push(at);
            return (1, area);
        }
        let deeper = |at| self.weigh(tree, at, depth + 1, limit);
        let (left, right) = if depth < PARALLEL_LEVELS {
            rayon::join(|| deeper(first), || deeper(first + 1))
        } else {
            (deeper(first), deeper(first + 1))
        };
        let (count, cost) = (left.0 + right.0, area * NODE_COST + left.1 + right.1);
        if count <= LEAF_TRIANGLES && area <= cost {
            self.bits[at as usize / 64].fetch_or(1 << (at % 64), Ordering::Relaxed);
            return (count, area);
        }
        (count, cost)
    }
}
