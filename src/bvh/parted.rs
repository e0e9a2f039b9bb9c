//! A tree over a scene with moving parts: each part has a tree of its own, whose boxes follow its vertices, below a
//! top that is built anew for every instant. What does not move is one more part, whose tree stays. A moving instance of a
//! shape that is kept once is a part without a tree: a door to the shape's.
//!
//! All of them share one list of nodes: the top, at its beginning, has copies of the parts' roots, since children of
//! one node lie together; after it come the other nodes of the parts, one part after the other.

use std::ops::Range;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::TreeFor;
use super::binary::{self, Bounds, Primitive};
use super::binary_tree::{BinaryTree, eight_below};
use super::part_tree::PartTree;
use super::refit::extent;
use super::wide::{EMPTY, WideBvh, WideNode};

/// The top over all parts.
#[derive(Clone, Debug)]
pub struct Top {
    /// As many nodes as there is room for.
    pub nodes: Vec<WideNode>,
    /// Where each part's root is among them; `None` of parts that are hidden.
    pub roots: Vec<Option<u32>>,
    /// Nodes above the roots of parts by how many levels of them are below each, none first.
    pub levels: Vec<Vec<u32>>,
}

/// All parts, and the top over them.
#[derive(Clone, Debug)]
pub struct Parted {
    /// The root of what does not move, if anything stays.
    still: Option<WideNode>,
    /// The moving parts in the order of the mesh.
    pub parts: Vec<PartTree>,
    /// Doors to moving instances; none to those that are nowhere.
    doors: Vec<Option<WideNode>>,
    /// Parts that are nowhere.
    hidden: Vec<bool>,
    /// Boxes around parts whose own boxes are fitted elsewhere: those of their trees here are out of date.
    loose: Vec<Option<(Vec3, Vec3)>>,
    /// Nodes that the top has room for.
    pub top: usize,
    /// Levels that a part may have.
    depth: u32,
    /// What walks its trees, those to come too.
    pub tree_for: TreeFor,
}

/// Levels that a later tree of a part may have more than the deepest of the first ones.
const SPARE_LEVELS: u32 = 2;

impl Parted {
    /// Builds the trees of parts that are the mesh's last triangles, each a range of them, over the tree `still` of
    /// those before, with a door to each moving instance, by its number and its box. Returns the whole tree too.
    pub fn build(
        tree_for: TreeFor,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        parts: &[Range<usize>],
        still: WideBvh,
        instances: &[(u32, (Vec3, Vec3))],
    ) -> (WideBvh, Parted) {
        let whole =
            |range: &Range<usize>| WideBvh::build_whole(tree_for, positions, &triangles[range.clone()]);
        let trees: Vec<WideBvh> = parts.par_iter().map(whole).collect();
        let has_still = !still.order.is_empty();
        let depth = trees.iter().chain([&still]).map(WideBvh::depth).max().unwrap_or(1) + SPARE_LEVELS;
        let top = 2 * (parts.len() + instances.len() + usize::from(has_still)).max(1);
        let mut whole = WideBvh { nodes: vec![WideNode::VACANT; top], order: Vec::new() };
        let mut still = PartTree::new(still, top, 0, 0);
        whole.nodes.append(&mut still.nodes);
        whole.order.append(&mut still.order);
        let mut parted = Parted {
            still: has_still.then_some(still.root),
            parts: Vec::new(),
            doors: instances.iter().map(|&(number, bounds)| Some(WideNode::portal(number, bounds))).collect(),
            hidden: vec![false; parts.len()],
            loose: vec![None; parts.len()],
            top,
            depth,
            tree_for,
        };
        for (tree, range) in trees.into_iter().zip(parts) {
            let mut part = PartTree::new(tree, whole.nodes.len(), whole.order.len(), range.start);
            // Room for later trees, which may have a few nodes more.
            part.nodes.resize(part.nodes.len() + part.nodes.len() / 4, WideNode::VACANT);
            whole.nodes.extend_from_slice(&part.nodes);
            whole.order.extend_from_slice(&part.order);
            parted.parts.push(part);
        }
        whole.nodes[..top].copy_from_slice(&parted.top().nodes);
        (whole, parted)
    }

    /// Puts the doors to moving instances where these are: their numbers and boxes, `None` for one that is nowhere.
    pub fn place(&mut self, instances: impl Iterator<Item = Option<(u32, (Vec3, Vec3))>>) {
        let door = |(number, bounds)| WideNode::portal(number, bounds);
        self.doors = instances.map(|instance| instance.map(door)).collect();
    }

    /// Leaves a part out of the top from now on, or takes it in again.
    pub fn hide(&mut self, part: usize, hidden: bool) {
        self.hidden[part] = hidden;
    }

    /// Whether the top leaves a part out.
    pub fn is_hidden(&self, part: usize) -> bool {
        self.hidden[part]
    }

    /// Leaves the boxes of a part to others from now on, who keep them in this one.
    pub fn loosen(&mut self, part: usize, bounds: (Vec3, Vec3)) {
        self.loose[part] = Some(bounds);
    }

    /// The box around a part whose boxes others keep.
    pub fn loose(&self, part: usize) -> Option<(Vec3, Vec3)> {
        self.loose[part]
    }

    /// Gives a part another tree over its triangles, the first of which is `first_triangle`. Not where that has more
    /// nodes than there is room for, or is too deep: false then. Its boxes are to be refitted.
    pub fn replace(&mut self, part: usize, tree: WideBvh, first_triangle: usize) -> bool {
        let old = &mut self.parts[part];
        let room = old.nodes.len();
        if tree.nodes.len() > room + 1 || tree.order.len() != old.order.len() || tree.depth() > self.depth {
            return false;
        }
        *old = PartTree::new(tree, old.first_node, old.first_place, first_triangle);
        old.nodes.resize(room, WideNode::VACANT);
        true
    }

    /// Levels of the whole tree at most, whatever its parts do.
    pub fn depth(&self) -> u32 {
        self.depth + self.levels()
    }

    /// Levels of the top at most: those of a top that halves its parts by count.
    fn levels(&self) -> u32 {
        let count = usize::from(self.still.is_some()) + self.parts.len() + self.doors.len();
        count.max(2).next_power_of_two().ilog2()
    }

    fn shown(&self) -> impl Iterator<Item = usize> {
        (0..self.parts.len()).filter(|&part| !self.hidden[part])
    }

    /// What the top leads to, each with its box: what stays, the parts that are shown, and the doors.
    fn roots(&self) -> (Vec<WideNode>, Vec<(Vec3, Vec3)>) {
        let tight = |root: WideNode| (root, extent(&root));
        let part = |part: usize| {
            let root = self.parts[part].root;
            (root, self.loose[part].unwrap_or_else(|| extent(&root)))
        };
        let doors = self.doors.iter().flatten().copied().map(tight);
        self.still.into_iter().map(tight).chain(self.shown().map(part)).chain(doors).unzip()
    }

    /// The top where the parts are now.
    pub fn top(&self) -> Top {
        let (roots, boxes) = self.roots();
        let primitive = |(triangle, &(lower, upper)): (u32, &(Vec3, Vec3))| Primitive {
            bounds: Bounds { lower, upper },
            triangle,
        };
        let mut primitives: Vec<Primitive> = (0..).zip(&boxes).map(primitive).collect();
        let mut over = Over::default();
        if !primitives.is_empty() {
            let mut tree = binary::build(&mut primitives, &|_| ());
            over = wide_over(&tree, &roots);
            if over.depth > self.levels() {
                tree.halve_below(0);
                over = wide_over(&tree, &roots);
            }
        }
        let levels = over.levels();
        let mut top = Top { nodes: over.nodes, roots: vec![None; self.parts.len()], levels };
        top.nodes.resize(self.top, WideNode::VACANT);
        for (part, place) in
            self.shown().zip(&over.places[usize::from(self.still.is_some()).min(over.places.len())..])
        {
            top.roots[part] = Some(*place);
        }
        top
    }

    /// Fits the boxes of a range of parts to where their triangles are now; `corners` tells, of each of them. Returns the
    /// vertex coordinates of these parts in leaf order, as [`WideBvh::leaf_vertices`] has them, without padding.
    pub fn refit(&mut self, parts: Range<usize>, corners: impl Fn(u32) -> [Vec3; 3] + Sync) -> Vec<f32> {
        let parts = &mut self.parts[parts];
        let mut all = vec![0.0; parts.iter().map(|part| part.order.len() * 9).sum()];
        let mut left = &mut all[..];
        let mut work = Vec::with_capacity(parts.len());
        for part in parts {
            let (own, rest) = std::mem::take(&mut left).split_at_mut(part.order.len() * 9);
            work.push((part, own));
            left = rest;
        }
        work.into_par_iter().for_each(|(part, vertices)| {
            part.lay_out(&corners, vertices);
            part.refit(vertices);
        });
        all
    }
}

/// Nodes over roots of trees.
#[derive(Debug, Default)]
pub(super) struct Over {
    /// All of them, with the roots.
    pub nodes: Vec<WideNode>,
    /// Where each root is among them.
    places: Vec<u32>,
    /// Levels above the roots.
    pub depth: u32,
}

impl Over {
    /// Nodes other than the roots, by how many levels of them are below each.
    fn levels(&self) -> Vec<Vec<u32>> {
        let mut is_root = vec![false; self.nodes.len()];
        self.places.iter().for_each(|&place| is_root[place as usize] = true);
        let (mut heights, mut levels) = (vec![0usize; self.nodes.len()], Vec::<Vec<u32>>::new());
        for index in (0..self.nodes.len()).rev().filter(|&index| !is_root[index]) {
            let children = self.nodes[index].children.into_iter().filter(|&child| child != EMPTY);
            let below = children.filter(|&child| !is_root[child as usize]);
            heights[index] = below.map(|child| heights[child as usize] + 1).max().unwrap_or(0);
            levels.resize(levels.len().max(heights[index] + 1), Vec::new());
            levels[heights[index]].push(index as u32);
        }
        levels
    }
}

/// Eight children a node over a binary tree whose leaves stand for `roots`.
pub(super) fn wide_over(tree: &BinaryTree, roots: &[WideNode]) -> Over {
    let (mut nodes, mut places, mut deepest) = (vec![WideNode::VACANT], vec![0; roots.len()], 0);
    let mut pending = vec![(0, 0usize, 1u32)];
    let opened = |at| Some((tree.bounds(at).half_area(), tree.children(at)?));
    while let Some((root, wide, depth)) = pending.pop() {
        deepest = deepest.max(depth);
        for (slot, child) in eight_below(root, opened).into_iter().enumerate() {
            let index = nodes.len();
            if tree.children(child).is_some() {
                nodes.push(WideNode::VACANT);
                pending.push((child, index, depth + 1));
            } else {
                let root = tree.triangle(child) as usize;
                places[root] = index as u32;
                nodes.push(roots[root]);
            }
            let bounds = tree.bounds(child);
            nodes[wide].set(slot, (bounds.lower, bounds.upper), index as u32);
        }
    }
    Over { nodes, places, depth: deepest }
}

/// A triangle that motion has flattened, with an area again: kernels cannot tell a line or a point from what a ray
/// meets. Its last corner is moved by `width`, in metres, or by a few roundings where that is more. Others are as
/// they are.
pub fn solid(corners: [Vec3; 3], width: f32) -> [Vec3; 3] {
    let (e, f) = (corners[1] - corners[0], corners[2] - corners[0]);
    // Far more than roundings make of none.
    if e.cross(f).length_squared() > 1e-8 * e.length_squared() * f.length_squared() {
        return corners;
    }
    let [a, b, c] = corners.map(|corner| corner.as_dvec3());
    if (b - a).cross(c - a) != DVec3::ZERO {
        return corners;
    }
    let width = f64::from(width).max(a.abs().max(b.abs()).max(c.abs()).max_element() * 1e-6).max(1e-30);
    // The two that are farthest apart stay a line; the third leaves it.
    let along = if b != a { b - a } else { c - a };
    let along = along.try_normalize().unwrap_or(DVec3::X);
    let (side, b) = (along.any_orthonormal_vector() * width, if b == a { a + along * width } else { b });
    let c = if c == a || c == b { (a + b) * 0.5 } else { c } + side;
    [a.as_vec3(), b.as_vec3(), c.as_vec3()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::wide::LEAF;

    /// Clusters of triangles around places; the first is what stays.
    fn clusters(places: &[Vec3], each: usize) -> (Vec<Vec3>, Vec<[u32; 3]>, Vec<Range<usize>>) {
        let mut state = 5u32;
        let mut next = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let mut positions = Vec::new();
        for &place in places {
            for _ in 0..each {
                let at = place + Vec3::new(next(), next(), next());
                positions.extend([
                    at,
                    at + Vec3::new(next(), 0.1, 0.0) * 0.2,
                    at + Vec3::new(0.0, next(), 0.1) * 0.2,
                ]);
            }
        }
        let count = places.len() * each;
        let triangles = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let parts = (1..places.len()).map(|part| part * each..(part + 1) * each).collect();
        (positions, triangles, parts)
    }

    fn whole_of(whole: &WideBvh, parted: &Parted) -> WideBvh {
        let mut tree = whole.clone();
        tree.nodes[..parted.top].copy_from_slice(&parted.top().nodes);
        for part in &parted.parts {
            tree.nodes[part.first_node..part.first_node + part.nodes.len()].copy_from_slice(&part.nodes);
        }
        tree
    }

    #[test]
    fn parts_move_and_the_tree_holds_them() {
        let cases = [(1, 100), (2, 1), (2, 300), (9, 50), (40, 7), (300, 3)];
        let kinds = [TreeFor::Packets, TreeFor::SingleRays];
        let all = kinds.into_iter().flat_map(|kind| cases.map(|case| (kind, case)));
        for (tree_for, (count, each)) in all {
            let places: Vec<Vec3> =
                (0..count).map(|i| Vec3::new((i * i % 17) as f32, i as f32, 0.5 * i as f32)).collect();
            let (positions, triangles, parts) = clusters(&places, each);
            let still = WideBvh::build_for(tree_for, &positions, &triangles[..each], &|_| ());
            let (whole, mut parted) = Parted::build(tree_for, &positions, &triangles, &parts, still, &[]);
            whole.validate(&positions, &triangles).unwrap();
            let largest = whole.order.iter().map(|slot| slot.leaf_len).max();
            assert!(tree_for == TreeFor::Packets || largest <= Some(2), "{largest:?}");
            let fresh = WideBvh::build_for(tree_for, &positions, &triangles, &|_| ()).cost().sum();
            assert!(whole.cost().sum() < 1.6 * fresh + 2.0, "{count}: {:?} {fresh}", whole.cost());
            assert!(whole.depth() <= parted.depth());
            // Each part goes a way of its own, through what stays.
            let moved: Vec<Vec3> = positions
                .iter()
                .enumerate()
                .map(|(i, &p)| match i / (3 * each) {
                    0 => p,
                    part => {
                        glam::Quat::from_rotation_z(part as f32) * (p - places[part])
                            + places[count - part] * 0.5
                    }
                })
                .collect();
            let corners = |triangle: u32| triangles[triangle as usize].map(|vertex| moved[vertex as usize]);
            let own = parted.refit(0..parted.parts.len(), corners);
            let tree = whole_of(&whole, &parted);
            tree.validate(&moved, &triangles).unwrap_or_else(|problem| panic!("{count}: {problem}"));
            assert!(tree.depth() <= parted.depth(), "{count}: {} {}", tree.depth(), parted.depth());
            let leaves = tree.leaf_vertices(&moved, &triangles);
            let first = parted.parts.first().map_or(0, |part| part.first_place * 9);
            assert_eq!(own, leaves[first..first + own.len()]);
            // Another tree over the same triangles takes the place of a part's.
            for (part, range) in parts.iter().enumerate().take(parted.parts.len().min(3)) {
                let anew = WideBvh::build_whole(tree_for, &moved, &triangles[range.clone()]);
                let (grown, least) = (parted.parts[part].cost(), anew.cost().sum());
                if parted.replace(part, anew, range.start) {
                    assert!((parted.parts[part].cost() - least).abs() < 1e-3 * least && least < grown * 1.1);
                    assert_eq!(parted.parts[part].growth(), 1.0);
                }
            }
            let mut tree = whole_of(&whole, &parted);
            for part in &parted.parts {
                tree.order[part.first_place..part.first_place + part.order.len()]
                    .copy_from_slice(&part.order);
            }
            tree.validate(&moved, &triangles).unwrap_or_else(|problem| panic!("{count}: {problem}"));
            // Compact nodes find children by their order.
            let inner = |node: &WideNode| {
                node.children.into_iter().filter(|child| child & LEAF == 0).collect::<Vec<_>>()
            };
            for node in &tree.nodes {
                assert!(inner(node).windows(2).all(|pair| pair[1] == pair[0] + 1));
            }
        }
    }

    #[test]
    fn scenes_in_which_all_moves_or_nothing_is_are_trees() {
        let (positions, triangles, _) = clusters(&[Vec3::ZERO, Vec3::X], 20);
        let nothing = || WideBvh::build(&positions, &[]);
        let (whole, _) =
            Parted::build(TreeFor::Packets, &positions, &triangles, &[0..20, 20..40], nothing(), &[]);
        whole.validate(&positions, &triangles).unwrap();
        let (empty, _) = Parted::build(TreeFor::Packets, &positions, &[], &[], nothing(), &[]);
        empty.validate(&positions, &[]).unwrap();
    }

    #[test]
    fn flattened_triangles_get_a_little_area() {
        let p = Vec3::new(3.0, -2.0, 1.0);
        let lines = [
            [p; 3],
            [p, p, p + Vec3::X],
            [p, p + Vec3::X, p],
            [p + Vec3::X, p, p],
            [p, p + Vec3::X, p + 2.0 * Vec3::X],
        ];
        for flat in lines {
            let made = solid(flat, 1e-5);
            let area = (made[1] - made[0]).as_dvec3().cross((made[2] - made[0]).as_dvec3()).length();
            assert!(area > 1e-13 && area < 1e-3, "{flat:?}: {area}");
            assert!(made.iter().zip(flat).all(|(made, was)| made.distance(was) < 1.1), "{flat:?} {made:?}");
        }
        let proper = [p, p + Vec3::X, p + Vec3::Y];
        assert_eq!(solid(proper, 1.0), proper);
    }
}
