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

use super::LEAF_TRIANGLES;
use super::binary::{self, Bounds, Node, Primitive};
use super::improve;
use super::wide::{LEAF, LeafSlot, WideBvh, WideNode};

/// Cost of a binary node in units of a leaf's test. One wide node stands for up to seven binary
/// ones, and eight lanes test eight boxes or eight triangles in about the same time.
const NODE_COST: f64 = 1.0 / 7.0;

impl WideBvh {
    /// Builds a tree over triangles with finite vertices, on all cores.
    pub fn build(positions: &[Vec3], triangles: &[[u32; 3]]) -> WideBvh {
        WideBvh::build_and_tell(positions, triangles, &|_| ())
    }

    /// [`WideBvh::build`], telling how much of it is done, from 0 to 1.
    ///
    /// Two trees are built where some triangles fill little of their boxes, from above and from below, and the
    /// better one is kept; elsewhere the one from above is.
    pub fn build_and_tell(
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
        let root = binary::build(&mut primitives, &placed);
        if !has_long_triangles {
            // Gigabytes, for large scenes, which the steps that follow have a use for.
            drop(primitives);
            return WideBvh::from_binary(improve::reinserted(root));
        }
        let from_above = WideBvh::from_binary(improve::reinserted(root));
        let from_below = WideBvh::from_binary(improve::clustered(&primitives));
        if from_below.cost().sum() < from_above.cost().sum() { from_below } else { from_above }
    }

    /// A tree whose boxes will follow their vertices: no triangle is cut, since pieces would not.
    pub fn build_whole(positions: &[Vec3], triangles: &[[u32; 3]]) -> WideBvh {
        let mut primitives = primitives_of(positions, triangles);
        if primitives.is_empty() {
            return WideBvh { nodes: vec![WideNode::VACANT], order: Vec::new() };
        }
        WideBvh::from_binary(improve::reinserted(binary::build(&mut primitives, &|_| ())))
    }

    /// Makes a tree wide, whoever built it.
    pub fn from_binary(root: Node) -> WideBvh {
        let mut wide =
            WideBvh { nodes: vec![WideNode::VACANT], order: Vec::with_capacity(root.count() as usize) };
        wide.collapse(&Choice::of(root));
        wide
    }

    /// Emits nodes depth first, so that what is walked together lies together.
    fn collapse(&mut self, root: &Choice) {
        let mut pending = vec![(root, 0usize)];
        while let Some((choice, wide)) = pending.pop() {
            for (slot, child) in eight_children(choice).into_iter().enumerate() {
                let (bounds, link) = match child {
                    Choice::Leaf { bounds, triangles } => (bounds, self.emit_leaf(triangles)),
                    Choice::Inner { bounds, .. } => {
                        self.nodes.push(WideNode::VACANT);
                        pending.push((child, self.nodes.len() - 1));
                        (bounds, self.nodes.len() as u32 - 1)
                    }
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

/// The binary tree after it was decided which subtrees become leaves.
enum Choice {
    Leaf { bounds: Bounds, triangles: Vec<u32> },
    Inner { bounds: Bounds, children: Box<[Choice; 2]> },
}

impl Choice {
    /// Subtrees of at most eight triangles become leaves where testing them all costs no more, by
    /// the surface area heuristic, than walking what is below.
    fn of(root: Node) -> Choice {
        Self::with_cost(root).0
    }

    fn with_cost(node: Node) -> (Choice, f64) {
        let bounds = node.bounds();
        let area = bounds.half_area();
        let count = node.count() as usize;
        match node {
            Node::Leaf(primitive) => (Choice::Leaf { bounds, triangles: vec![primitive.triangle] }, area),
            Node::Inner { children, .. } => {
                let [left, right] = *children;
                let ((left, left_cost), (right, right_cost)) = if count > 4096 {
                    rayon::join(|| Self::with_cost(left), || Self::with_cost(right))
                } else {
                    (Self::with_cost(left), Self::with_cost(right))
                };
                let cost = area * NODE_COST + left_cost + right_cost;
                if count <= LEAF_TRIANGLES && area <= cost {
                    let mut triangles = Vec::with_capacity(count);
                    left.gather(&mut triangles);
                    right.gather(&mut triangles);
                    // Pieces of one triangle may have come together.
                    triangles.sort_unstable();
                    triangles.dedup();
                    return (Choice::Leaf { bounds, triangles }, area);
                }
                (Choice::Inner { bounds, children: Box::new([left, right]) }, cost)
            }
        }
    }

    fn gather(&self, triangles: &mut Vec<u32>) {
        match self {
            Choice::Leaf { triangles: own, .. } => triangles.extend_from_slice(own),
            Choice::Inner { children, .. } => children.iter().for_each(|child| child.gather(triangles)),
        }
    }

    fn bounds(&self) -> &Bounds {
        match self {
            Choice::Leaf { bounds, .. } | Choice::Inner { bounds, .. } => bounds,
        }
    }
}

/// Up to eight descendants: the inner one with the largest surface is opened first.
fn eight_children(node: &Choice) -> Vec<&Choice> {
    let mut children = vec![node];
    while children.len() < 8 {
        let inner = children.iter().enumerate().filter_map(|(place, child)| match child {
            Choice::Inner { children, .. } => Some((place, child.bounds().half_area(), children)),
            Choice::Leaf { .. } => None,
        });
        let Some((place, _, halves)) = inner.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        children[place] = &halves[0];
        children.insert(place + 1, &halves[1]);
    }
    children
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn a_million_coincident_triangles_are_no_trouble() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let triangles = vec![[0, 1, 2]; 1_000_000];
        let bvh = WideBvh::build(&positions, &triangles);
        bvh.validate(&positions, &triangles).unwrap();
        assert!(bvh.depth() <= 20, "{}", bvh.depth());
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
        let bvh = WideBvh::build(&positions, &triangles);
        bvh.validate(&positions, &triangles).unwrap();
        assert!(bvh.depth() <= crate::bvh::MAX_DEPTH);
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
        let plain = WideBvh::from_binary(binary::build(&mut whole, &|_| ()));
        assert!(bvh.cost().sum() < plain.cost().sum(), "{:?} {:?}", bvh.cost(), plain.cost());
    }

    #[test]
    fn building_tells_how_far_it_is() {
        let (positions, triangles) = cloud(20_000);
        let told = std::sync::Mutex::new(Vec::new());
        WideBvh::build_and_tell(&positions, &triangles, &|done| told.lock().unwrap().push(done));
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
