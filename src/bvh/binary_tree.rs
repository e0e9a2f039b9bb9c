//! A binary tree in one list of nodes, which is built, improved and made wide without a second copy: forty million
//! nodes are the most that building a large scene's tree takes.

use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;

use super::binary::{Bounds, Primitive};

/// The power of two that makes every coordinate at most 1, as far as `f32` can say it: areas neither overflow nor
/// vanish then.
#[derive(Clone, Copy, Debug)]
pub struct Scale(f32);

impl Scale {
    /// The scale of these.
    pub fn of(primitives: &[Primitive]) -> Scale {
        let largest = |b: &Bounds| b.lower.abs().max(b.upper.abs()).max_element();
        let reach = primitives.iter().map(|p| largest(&p.bounds)).fold(0.0, f32::max);
        Scale(if reach > 0.0 { (-reach.log2().ceil()).clamp(-126.0, 126.0).exp2() } else { 1.0 })
    }

    /// A point, scaled.
    pub fn point(self, point: Vec3) -> Vec3 {
        point * self.0
    }

    /// A box, scaled. Exactly, but for coordinates that vanish beside the largest one: these are rounded outwards.
    pub fn scaled(self, bounds: &Bounds) -> Aabb {
        let inverse = self.0.recip();
        let down = |x: f32| if x * self.0 * inverse > x { (x * self.0).next_down() } else { x * self.0 };
        let lower = bounds.lower.map(down);
        let upper = bounds.upper.map(|x| -down(-x));
        Aabb { min: lower.into(), max: upper.into() }
    }

    /// The box that was scaled.
    pub fn unscaled(self, scaled: &Aabb) -> Bounds {
        let inverse = self.0.recip();
        Bounds { lower: Vec3::from(scaled.min) * inverse, upper: Vec3::from(scaled.max) * inverse }
    }
}

/// A binary tree with one triangle, or a piece of one, in each leaf. Node 0 is the root.
#[derive(Debug)]
pub struct BinaryTree {
    /// Boxes are scaled. An inner node's children follow each other in this list; a leaf knows its place in
    /// `triangles`.
    pub nodes: Vec<Bvh2Node>,
    /// The triangle of each leaf.
    pub triangles: Vec<u32>,
    /// Of the boxes.
    pub scale: Scale,
}

impl BinaryTree {
    /// A leaf for the primitive at a place.
    pub fn leaf(bounds: Aabb, place: u32) -> Bvh2Node {
        Bvh2Node::new(bounds, 1, place)
    }

    /// The parent of two nodes, which lie at `first` and behind it.
    pub fn parent(children: [Bvh2Node; 2], first: u32) -> Bvh2Node {
        Bvh2Node::new(children[0].aabb().union(children[1].aabb()), 0, first)
    }

    /// Bounds of everything below a node.
    pub fn bounds(&self, at: u32) -> Bounds {
        self.scale.unscaled(self.nodes[at as usize].aabb())
    }

    /// The first of a node's two children; the other one follows it. `None` at a leaf.
    pub fn children(&self, at: u32) -> Option<u32> {
        let node = &self.nodes[at as usize];
        (!node.is_leaf()).then_some(node.first_index)
    }

    /// The triangle of a leaf.
    pub fn triangle(&self, at: u32) -> u32 {
        self.triangles[self.nodes[at as usize].first_index as usize]
    }

    /// Halves what lies below a node by count until nothing is left to halve, so that it is as shallow as can be.
    pub fn halve_below(&mut self, at: u32) {
        let (mut leaves, mut pairs, mut pending) = (Vec::new(), Vec::new(), vec![at]);
        while let Some(at) = pending.pop() {
            match self.children(at) {
                Some(first) => {
                    pairs.push(first);
                    pending.extend([first, first + 1]);
                }
                None => leaves.push(self.nodes[at as usize]),
            }
        }
        self.nodes[at as usize] = self.halved(&leaves, &mut pairs);
    }

    /// The node over these leaves, whose descendants take the places of `pairs`.
    fn halved(&mut self, leaves: &[Bvh2Node], pairs: &mut Vec<u32>) -> Bvh2Node {
        if let [only] = leaves {
            return *only;
        }
        let (left, right) = leaves.split_at(leaves.len() / 2);
        let children = [self.halved(left, pairs), self.halved(right, pairs)];
        let first = pairs.pop().expect("a tree has one pair less than leaves");
        self.nodes[first as usize..][..2].copy_from_slice(&children);
        BinaryTree::parent(children, first)
    }
}

/// Up to eight descendants of a node: the inner one with the largest surface is opened first. `opened` tells of an
/// inner node half its surface and the first of its two children, which follow each other.
pub fn eight_below(root: u32, opened: impl Fn(u32) -> Option<(f64, u32)>) -> Vec<u32> {
    let mut children = Vec::with_capacity(8);
    children.push((root, opened(root)));
    while children.len() < 8 {
        let inner = children.iter().enumerate().filter_map(|(place, child)| Some((place, child.1?)));
        let Some((place, (_, first))) = inner.max_by(|a, b| a.1.0.total_cmp(&b.1.0)) else { break };
        children[place] = (first, opened(first));
        children.insert(place + 1, (first + 1, opened(first + 1)));
    }
    children.into_iter().map(|(node, _)| node).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scaled_boxes_hold_what_they_held() {
        let box_of = |lower: f32, upper: f32| Bounds { lower: Vec3::splat(lower), upper: Vec3::splat(upper) };
        let large = Primitive { bounds: box_of(-1.0, 3e38), triangle: 0 };
        for (reach, small) in [(3e38, 1e-5), (3e38, 1e-38), (1.0, 0.3), (1e-44, 1e-45)] {
            let scale = Scale::of(&[Primitive { bounds: box_of(-reach, reach), ..large }]);
            for (lower, upper) in [(small, small), (-small, -small), (-small, small)] {
                let kept = scale.unscaled(&scale.scaled(&box_of(lower, upper)));
                assert!(kept.lower.x <= lower && kept.upper.x >= upper, "{reach} {small}: {kept:?}");
                // What does not vanish is kept exactly.
                assert!(small < 1e-5 * reach || kept == box_of(lower, upper), "{reach} {small}: {kept:?}");
            }
        }
    }

    #[test]
    fn halving_makes_a_chain_shallow_and_keeps_its_leaves() {
        let unit =
            |i: u32| Aabb { min: Vec3::splat(i as f32).into(), max: Vec3::splat(i as f32 + 1.0).into() };
        const LEAVES: u32 = 100;
        // Each inner node has a leaf and the rest.
        let mut nodes = vec![Bvh2Node::default(); 2 * LEAVES as usize - 1];
        let mut rest = BinaryTree::leaf(unit(LEAVES - 1), LEAVES - 1);
        for i in (0..LEAVES - 1).rev() {
            let (first, children) = (2 * i + 1, [BinaryTree::leaf(unit(i), i), rest]);
            nodes[first as usize..][..2].copy_from_slice(&children);
            rest = BinaryTree::parent(children, first);
        }
        nodes[0] = rest;
        let mut tree = BinaryTree { nodes, triangles: (0..LEAVES).collect(), scale: Scale(1.0) };
        tree.halve_below(0);
        let (mut found, mut pending) = (Vec::new(), vec![(0u32, 0)]);
        while let Some((at, depth)) = pending.pop() {
            assert!(depth <= 7);
            let Some(first) = tree.children(at) else {
                found.push(tree.triangle(at));
                continue;
            };
            let union = tree.bounds(first).union(tree.bounds(first + 1));
            assert_eq!(tree.bounds(at), union);
            pending.extend([(first, depth + 1), (first + 1, depth + 1)]);
        }
        found.sort_unstable();
        assert_eq!(found, tree.triangles);
    }
}
