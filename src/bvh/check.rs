//! What must hold of a tree before kernels walk it, in one pass: a tree from a file may be anything. Kernels look
//! neither at where links lead nor how deep they go, and compact nodes tell children by counting.

use glam::Vec3;

use super::MAX_DEPTH;
use super::wide::{EMPTY, LEAF, WideBvh, WideNode, leaf_range};

/// A child's box.
fn bounds(node: &WideNode, slot: usize) -> (Vec3, Vec3) {
    let of = |rows: &[[f32; 8]; 3]| Vec3::new(rows[0][slot], rows[1][slot], rows[2][slot]);
    (of(&node.lower), of(&node.upper))
}

/// False also where something is not a number.
fn holds((lower, upper): (Vec3, Vec3), point: Vec3) -> bool {
    lower.cmple(point).all() && point.cmple(upper).all()
}

impl WideBvh {
    /// Whether kernels may walk the tree and find what is there: every node has one parent, before it; no hole lies
    /// before a child, and the nodes and the triangles below one node follow each other; every place in leaf order
    /// is in one leaf; no path is longer than [`MAX_DEPTH`]; boxes hold those below them, and each corner of each
    /// triangle lies in the box of a leaf that has the triangle.
    pub fn is_sound(&self, positions: &[Vec3], triangles: &[[u32; 3]]) -> bool {
        self.find_unsound(positions, triangles).is_none()
    }

    /// The first thing that is wrong, for tests and messages.
    pub fn find_unsound(&self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Option<&'static str> {
        let count = self.nodes.len();
        if count == 0 {
            return Some("there is no root");
        }
        let mut depth = vec![0u32; count];
        let mut taken = vec![false; self.order.len()];
        // For each triangle the corners that a leaf's box holds.
        let mut held = vec![0u8; triangles.len()];
        depth[0] = 1;
        for (index, node) in self.nodes.iter().enumerate() {
            if depth[index] == 0 {
                return Some("a node has no parent before it");
            }
            if let Some(problem) = order_of_children(node) {
                return Some(problem);
            }
            for slot in 0..8 {
                let child = node.children[slot];
                if child == EMPTY {
                    break;
                }
                let own = bounds(node, slot);
                if !holds(own, own.0) || !own.0.is_finite() || !own.1.is_finite() {
                    return Some("a box is inside out");
                }
                let found = if child & LEAF == 0 {
                    self.check_node(child as usize, depth[index] + 1, own, &mut depth)
                } else {
                    self.check_leaf(child, own, (positions, triangles), &mut taken, &mut held)
                };
                if found.is_some() {
                    return found;
                }
            }
        }
        if !taken.into_iter().all(|place| place) {
            return Some("a place in leaf order is in no leaf");
        }
        (!held.into_iter().all(|corners| corners == 0b111)).then_some("a triangle reaches out of its leaves")
    }

    fn check_node(
        &self,
        child: usize,
        level: u32,
        own: (Vec3, Vec3),
        depth: &mut [u32],
    ) -> Option<&'static str> {
        let Some(seen) = depth.get_mut(child) else { return Some("a link leads nowhere") };
        if *seen != 0 {
            return Some("a node has two parents");
        }
        if level > MAX_DEPTH {
            return Some("it is too deep");
        }
        *seen = level;
        let below = &self.nodes[child];
        let children = below.children.iter().take_while(|&&child| child != EMPTY).count();
        let outside = (0..children).any(|slot| {
            let (lower, upper) = bounds(below, slot);
            !holds(own, lower) || !holds(own, upper)
        });
        outside.then_some("a box reaches out of its parent's")
    }

    fn check_leaf(
        &self,
        child: u32,
        own: (Vec3, Vec3),
        (positions, triangles): (&[Vec3], &[[u32; 3]]),
        taken: &mut [bool],
        held: &mut [u8],
    ) -> Option<&'static str> {
        let (first, count) = leaf_range(child);
        for place in first..first + count {
            let Some(taken) = taken.get_mut(place) else { return Some("a leaf lies beyond the triangles") };
            if std::mem::replace(taken, true) {
                return Some("a place in leaf order is in two leaves");
            }
            let triangle = self.order[place].triangle as usize;
            let Some(corners) = triangles.get(triangle) else { return Some("a triangle does not exist") };
            for (bit, &corner) in corners.iter().enumerate() {
                held[triangle] |= u8::from(holds(own, positions[corner as usize])) << bit;
            }
        }
        None
    }
}

/// Children come before holes, and those of a kind follow each other.
fn order_of_children(node: &WideNode) -> Option<&'static str> {
    let mut ended = false;
    let (mut next_node, mut next_place) = (None, None);
    for child in node.children {
        if child == EMPTY {
            ended = true;
            continue;
        }
        if ended {
            return Some("a hole lies before a child");
        }
        let (next, at, after) = if child & LEAF == 0 {
            (&mut next_node, child as usize, child as usize + 1)
        } else {
            let (first, count) = leaf_range(child);
            (&mut next_place, first, first + count)
        };
        if next.is_some_and(|next| next != at) {
            return Some("children do not follow each other");
        }
        *next = Some(after);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of all sizes, some of them long.
    fn heap(count: usize) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let at = |i: usize| Vec3::new((i * 37 % 101) as f32, (i * 53 % 89) as f32, (i * 71 % 97) as f32);
        let long = |i: usize| if i.is_multiple_of(50) { 200.0 } else { 3.0 };
        let corner = |i: usize| at(i / 3) + at(i) * 0.01 * long(i / 3);
        (
            (0..3 * count).map(corner).collect(),
            (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        )
    }

    #[test]
    fn built_trees_are_sound() {
        for count in [0, 1, 2, 9, 100, 3000] {
            let (positions, triangles) = heap(count);
            let tree = WideBvh::build(&positions, &triangles);
            assert_eq!(tree.find_unsound(&positions, &triangles), None, "{count} triangles");
        }
        let same = vec![Vec3::ONE; 3];
        let triangles = vec![[0, 1, 2]; 5000];
        assert_eq!(WideBvh::build(&same, &triangles).find_unsound(&same, &triangles), None);
    }

    /// What each of these did to the kernels: a hole before a leaf, a chain of nodes and two parents that hide a
    /// path's length made them crash, eight links to one node never ended.
    #[test]
    fn what_brought_kernels_down_is_refused() {
        let (positions, triangles) = heap(3000);
        let tree = WideBvh::build(&positions, &triangles);
        let refused = |what: &str, change: &dyn Fn(&mut WideBvh)| {
            let mut changed = tree.clone();
            change(&mut changed);
            let found = changed.find_unsound(&positions, &triangles);
            assert!(found.is_some_and(|found| found.contains(what)), "{what}: {found:?}");
        };
        let inner = |tree: &WideBvh| {
            let has = |node: &WideNode| node.children.iter().filter(|&&c| c & LEAF == 0).count() > 1;
            tree.nodes.iter().position(has).unwrap()
        };
        refused("hole", &|tree| {
            let node = tree.nodes.iter_mut().find(|node| node.children[1] != EMPTY).unwrap();
            node.children[0] = EMPTY;
        });
        refused("follow each other", &|tree| {
            let at = inner(tree);
            let next = tree.nodes[at].children.into_iter().find(|c| c & LEAF == 0).unwrap();
            tree.nodes[at].children = [next; 8];
        });
        refused("no parent", &|tree| tree.nodes.push(WideNode::VACANT));
        refused("no parent", &|tree| {
            let last = tree.nodes.len() - 1;
            tree.nodes[last].children[0] = last as u32;
            tree.nodes[0].children = [EMPTY; 8];
        });
        refused("nowhere", &|tree| {
            let node = tree.nodes.iter_mut().rev().find(|node| node.children[0] & LEAF == 0).unwrap();
            let shift = 1_000_000;
            node.children.iter_mut().filter(|c| **c & LEAF == 0).for_each(|c| *c += shift);
        });
        refused("two leaves", &|tree| {
            let mut leaves = tree.nodes.iter().flat_map(|node| node.children);
            let leaf = leaves.rfind(|&c| c & LEAF != 0 && c != EMPTY).unwrap();
            let node =
                tree.nodes.iter_mut().find(|n| n.children[0] & LEAF != 0 && n.children[0] != leaf).unwrap();
            node.children = [leaf, EMPTY, EMPTY, EMPTY, EMPTY, EMPTY, EMPTY, EMPTY];
        });
        refused("reaches out", &|tree| tree.nodes[1].upper[0][0] += 1e6);
        refused("reaches out", &|tree| tree.nodes[0].upper[0][0] -= 1.0);
        refused("inside out", &|tree| tree.nodes[0].lower[1][0] = f32::NAN);
        refused("does not exist", &|tree| tree.order[7].triangle = 3000);
        refused("reaches out of its leaves", &|tree| tree.order[7].triangle = tree.order[8].triangle);
    }

    /// The root and its first child both lead to the last node, whose depth would be that of the shorter way.
    #[test]
    fn a_node_with_two_parents_is_refused() {
        let (positions, triangles) = heap(1);
        let whole = WideBvh::build(&positions, &triangles);
        let (mut root, mut between) = (whole.nodes[0], whole.nodes[0]);
        for rows in [&mut root.lower, &mut root.upper] {
            rows.iter_mut().for_each(|row| row[1] = row[0]);
        }
        (root.children[0], root.children[1], between.children[0]) = (1, 2, 2);
        let tree = WideBvh { nodes: vec![root, between, whole.nodes[0]], order: whole.order.clone() };
        assert_eq!(tree.find_unsound(&positions, &triangles), Some("a node has two parents"));
    }

    #[test]
    fn a_chain_of_nodes_is_too_deep() {
        let (positions, triangles) = heap(1);
        let whole = WideBvh::build(&positions, &triangles);
        let chain = |length: u32| {
            let mut tree = WideBvh { nodes: Vec::new(), order: whole.order.clone() };
            for next in 1..length {
                let mut node = whole.nodes[0];
                node.children[0] = next;
                tree.nodes.push(node);
            }
            tree.nodes.push(whole.nodes[0]);
            tree.find_unsound(&positions, &triangles)
        };
        assert_eq!((chain(MAX_DEPTH), chain(MAX_DEPTH + 1)), (None, Some("it is too deep")));
        assert_eq!(chain(20_000), Some("it is too deep"));
    }
}
