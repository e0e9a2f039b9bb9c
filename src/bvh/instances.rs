//! A tree over a scene some of whose shapes are kept once: for each of their places a door ([`PORTAL`]) that leads to
//! the root of the shape's own tree. Embree calls it two levels.

use glam::Vec3;

use super::binary::{self, Bounds, Primitive};
use super::part_tree::PartTree;
use super::parted::wide_over;
use super::wide::{PORTAL, WideBvh, WideNode};

/// All trees of a scene. A tree by itself is that of one without instances.
#[derive(Clone, Copy, Debug)]
pub struct Trees<'a> {
    /// Over what is placed, and over the doors to instances.
    pub world: &'a WideBvh,
    /// Those of the shapes that are kept once.
    pub shapes: &'a [WideBvh],
}

impl<'a> From<&'a WideBvh> for Trees<'a> {
    fn from(world: &'a WideBvh) -> Self {
        Trees { world, shapes: &[] }
    }
}

impl Trees<'_> {
    /// Levels of all that rays walk.
    pub fn depth(&self) -> u32 {
        self.world.depth() + self.shapes.iter().map(WideBvh::depth).max().unwrap_or(0)
    }
}

impl WideNode {
    /// The door to an instance in a box.
    pub(super) fn portal(instance: u32, bounds: (Vec3, Vec3)) -> Self {
        let mut node = WideNode::VACANT;
        node.set(0, bounds, PORTAL);
        node.children[1] = instance;
        node
    }

    /// The instance that a node is the door to.
    pub fn instance(&self) -> Option<u32> {
        (self.children[0] == PORTAL).then_some(self.children[1])
    }
}

/// The tree over what `still` holds and over instances, by their boxes in the world. They are numbered from 1 on in the
/// order of the boxes, of which there is at least one.
pub fn over_instances(still: WideBvh, boxes: &[(Vec3, Vec3)]) -> WideBvh {
    let mut roots: Vec<WideNode> =
        (1..).zip(boxes).map(|(number, bounds)| WideNode::portal(number, *bounds)).collect();
    let mut bounds: Vec<(Vec3, Vec3)> = boxes.to_vec();
    let has_still = !still.order.is_empty();
    if has_still {
        roots.push(still.nodes[0]);
        bounds.push(super::refit::extent(&still.nodes[0]));
    }
    let primitive = |(triangle, &(lower, upper)): (u32, &(Vec3, Vec3))| Primitive {
        bounds: Bounds { lower, upper },
        triangle,
    };
    let mut primitives: Vec<Primitive> = (0..).zip(&bounds).map(primitive).collect();
    let mut binary = binary::build(&mut primitives, &|_| ());
    // Boxes that lie in each other are halved by count: stacks have an entry for each level.
    let most = 2 * primitives.len().max(2).next_power_of_two().ilog2();
    if wide_over(&binary, &roots).depth > most {
        binary.halve_below(0);
    }
    let top = wide_over(&binary, &roots).nodes.len();
    let mut order = Vec::new();
    let mut below = Vec::new();
    if has_still {
        let part = PartTree::new(still, top, 0, 0);
        if let Some(root) = roots.last_mut() {
            *root = part.root;
        }
        (order, below) = (part.order, part.nodes);
    }
    let mut nodes = wide_over(&binary, &roots).nodes;
    nodes.extend(below);
    WideBvh { nodes, order }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::wide::{EMPTY, LEAF};

    fn corner(node: &WideNode, slot: usize) -> (Vec3, Vec3) {
        (Vec3::from_array(node.lower.map(|row| row[slot])), Vec3::from_array(node.upper.map(|row| row[slot])))
    }

    /// All instances below a node, whose boxes the boxes on the way hold, and the places of its triangles.
    fn walk(tree: &WideBvh, index: u32, bounds: (Vec3, Vec3), found: &mut (Vec<u32>, usize)) {
        let node = &tree.nodes[index as usize];
        if let Some(instance) = node.instance() {
            // What leads there may be rounded outwards.
            let own = corner(node, 0);
            assert!(bounds.0.cmple(own.0).all() && bounds.1.cmpge(own.1).all());
            found.0.push(instance);
            return;
        }
        for slot in (0..8).filter(|&slot| node.children[slot] != EMPTY) {
            let (low, high) = corner(node, slot);
            assert!(low.cmpge(bounds.0).all() && high.cmple(bounds.1).all());
            match node.children[slot] & LEAF {
                0 => walk(tree, node.children[slot], (low, high), found),
                _ => found.1 += super::super::wide::leaf_range(node.children[slot]).1,
            }
        }
    }

    #[test]
    fn each_instance_has_one_door_that_boxes_lead_to() {
        let positions: Vec<Vec3> =
            (0..300).map(|i| Vec3::new((i % 17) as f32, (i % 5) as f32, (i * i % 23) as f32)).collect();
        let triangles: Vec<[u32; 3]> = (0..100).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let everywhere = (Vec3::NEG_INFINITY, Vec3::INFINITY);
        for (count, spread) in [(1usize, 1.0), (8, 1.0), (9, 3.0), (500, 2.0), (500, 0.0)] {
            for still in [&[][..], &triangles] {
                let at = |i: usize| Vec3::new(i as f32, (i * 7 % 13) as f32, (i * 31 % 29) as f32) * spread;
                let boxes: Vec<_> = (0..count).map(|i| (at(i), at(i) + Vec3::splat(0.5))).collect();
                let tree = over_instances(WideBvh::build(&positions, still), &boxes);
                let mut found = (Vec::new(), 0);
                walk(&tree, 0, everywhere, &mut found);
                found.0.sort_unstable();
                assert_eq!(found.0, (1..=count as u32).collect::<Vec<_>>());
                assert!(found.1 >= still.len());
                assert!(tree.depth() <= 24, "{}", tree.depth());
            }
        }
    }
}
