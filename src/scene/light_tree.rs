//! A tree over what shines, to choose by power, distance and direction: Conty Estevez and Kulla, "Importance Sampling
//! of Many Lights with Adaptive Tree Splitting", 2018, without the splitting; bounds as in pbrt-v4, section 12.6.3.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Quat, Vec3};

use super::emitters::Emitter;

/// A node: what its emitters have in common.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Lower and upper corner of the box around them.
    pub bounds: [Vec3; 2],
    /// Axis of the cone around their normals.
    pub axis: Vec3,
    /// Cosine of the cone's half angle.
    pub cos_spread: f32,
    /// The sum of their powers.
    pub power: f32,
    /// Where it goes on.
    pub link: Link,
}

/// What a node leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Link {
    /// Two nodes: the first is the next in the list, the second this one.
    Inner(u32),
    /// One emitter.
    Leaf(u32),
}

/// Nodes with their root first, and the way to each emitter: bit k is set where the second child is taken at depth k.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightTree {
    /// The nodes; none without emitters.
    pub nodes: Vec<Node>,
    /// One for each emitter.
    pub trails: Vec<u32>,
}

/// Places that a split along an axis is tried at.
const BINS: usize = 12;

impl LightTree {
    /// Builds the tree; fewer than 2^31 emitters.
    pub fn new(emitters: &[Emitter]) -> Self {
        let mut tree = LightTree { nodes: Vec::new(), trails: vec![0; emitters.len()] };
        let mut order: Vec<u32> = (0..emitters.len() as u32).collect();
        // Deeper down sets are halved, so that 32 bits tell every way.
        let halved = usize::BITS - emitters.len().leading_zeros();
        if !order.is_empty() {
            tree.build(emitters, &mut order, 0, 0, 32u32.saturating_sub(halved + 1));
        }
        tree
    }

    /// Fits all nodes to where the emitters are now; ways stay. The further neighbours have moved apart, the worse
    /// it chooses, without a bias.
    pub fn refit(&mut self, emitters: &[Emitter]) {
        // Children come after their parents.
        for index in (0..self.nodes.len()).rev() {
            let link = self.nodes[index].link;
            self.nodes[index] = match link {
                Link::Leaf(emitter) => Node::of(&emitters[emitter as usize], emitter),
                Link::Inner(second) => {
                    Node { link, ..self.nodes[index + 1].with(&self.nodes[second as usize]) }
                }
            };
        }
    }

    fn build(&mut self, emitters: &[Emitter], order: &mut [u32], trail: u32, depth: u32, searched: u32) {
        let node = order.iter().map(|&i| Node::of(&emitters[i as usize], i)).reduce(|a, b| a.with(&b));
        let Some(node) = node else { return };
        let here = self.nodes.len();
        self.nodes.push(node);
        if let [only] = order {
            self.trails[*only as usize] = trail;
            return;
        }
        let middle = if depth < searched { split(emitters, order) } else { None };
        let middle = middle.unwrap_or_else(|| halve(emitters, order, &node));
        let (first, second) = order.split_at_mut(middle);
        self.build(emitters, first, trail, depth + 1, searched);
        self.nodes[here].link = Link::Inner(self.nodes.len() as u32);
        self.build(emitters, second, trail | 1 << depth, depth + 1, searched);
    }
}

impl Node {
    fn of(emitter: &Emitter, index: u32) -> Node {
        let Emitter { bounds, axis, cos_spread, power, .. } = *emitter;
        Node { bounds, axis, cos_spread, power, link: Link::Leaf(index) }
    }

    fn with(&self, other: &Node) -> Node {
        let (axis, cos_spread) = union((self.axis, self.cos_spread), (other.axis, other.cos_spread));
        let bounds = [self.bounds[0].min(other.bounds[0]), self.bounds[1].max(other.bounds[1])];
        Node { bounds, axis, cos_spread, power: self.power + other.power, link: self.link }
    }

    /// How much it costs to know no more than this node: power by the area and the directions that it fills.
    fn cost(&self) -> f32 {
        let size = self.bounds[1] - self.bounds[0];
        let area = size.x * size.y + size.y * size.z + size.z * size.x + size.length_squared() * 1e-3;
        let spread = self.cos_spread.clamp(-1.0, 1.0).acos();
        let most = (spread + FRAC_PI_2).min(PI);
        let sine = spread.sin();
        let directions = 2.0 * PI * (1.0 - self.cos_spread)
            + FRAC_PI_2
                * (2.0 * most * sine - (spread - 2.0 * most).cos() - 2.0 * spread * sine + self.cos_spread);
        self.power * area * directions.max(1e-3)
    }
}

/// The cone around two cones, each an axis and its half angle's cosine.
fn union(a: (Vec3, f32), b: (Vec3, f32)) -> (Vec3, f32) {
    let (spread_a, spread_b) = (a.1.clamp(-1.0, 1.0).acos(), b.1.clamp(-1.0, 1.0).acos());
    let between = a.0.dot(b.0).clamp(-1.0, 1.0).acos();
    if (between + spread_b).min(PI) <= spread_a {
        return a;
    }
    if (between + spread_a).min(PI) <= spread_b {
        return b;
    }
    let spread = (spread_a + between + spread_b) * 0.5;
    let turn = a.0.cross(b.0);
    if spread >= PI || turn.length_squared() < 1e-12 {
        return (a.0, -1.0);
    }
    (Quat::from_axis_angle(turn.normalize(), spread - spread_a) * a.0, spread.cos())
}

fn centre(emitter: &Emitter) -> Vec3 {
    (emitter.bounds[0] + emitter.bounds[1]) * 0.5
}

/// Parts the list where both sides cost least together: how many are in the first. `None` where all have one place.
fn split(emitters: &[Emitter], order: &mut [u32]) -> Option<usize> {
    let centres = order.iter().map(|&i| centre(&emitters[i as usize]));
    let (low, high) = centres.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), c| (l.min(c), h.max(c)));
    let bin = |axis: usize, index: u32| {
        let at = (centre(&emitters[index as usize])[axis] - low[axis]) / (high[axis] - low[axis]);
        ((at * BINS as f32) as usize).min(BINS - 1)
    };
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in (0..3).filter(|&axis| high[axis] > low[axis]) {
        let mut bins: [Option<Node>; BINS] = [None; BINS];
        for &index in order.iter() {
            let (slot, one) = (&mut bins[bin(axis, index)], Node::of(&emitters[index as usize], index));
            *slot = Some(slot.map_or(one, |all| all.with(&one)));
        }
        let sum = |range: &[Option<Node>]| range.iter().flatten().copied().reduce(|a, b| a.with(&b));
        for at in 1..BINS {
            if let (Some(first), Some(second)) = (sum(&bins[..at]), sum(&bins[at..])) {
                let cost = first.cost() + second.cost();
                if best.is_none_or(|(least, ..)| cost < least) {
                    best = Some((cost, axis, at));
                }
            }
        }
    }
    let (_, axis, at) = best?;
    order.sort_by_key(|&index| bin(axis, index) >= at);
    Some(order.partition_point(|&index| bin(axis, index) < at))
}

fn halve(emitters: &[Emitter], order: &mut [u32], node: &Node) -> usize {
    let size = node.bounds[1] - node.bounds[0];
    let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).unwrap_or(0);
    let at = |index: &u32| centre(&emitters[*index as usize])[axis];
    order.sort_by(|a, b| at(a).total_cmp(&at(b)));
    order.len() / 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::emitters::Source;

    fn emitters(count: u32) -> Vec<Emitter> {
        let place = |i: u32| Vec3::new((i % 31) as f32, (i % 7) as f32 * 3.0, (i / 31) as f32);
        let emitter = |i| Emitter {
            source: Source::Triangle(i),
            power: 1.0 + (i % 5) as f32,
            bounds: [place(i), place(i) + 0.1],
            axis: [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_Y][i as usize % 4],
            cos_spread: if i % 9 == 0 { -1.0 } else { 1.0 },
        };
        (0..count).map(emitter).collect()
    }

    /// The leaf that a trail leads to.
    fn follow(tree: &LightTree, trail: u32) -> u32 {
        let (mut node, mut depth) = (0, 0);
        loop {
            match tree.nodes[node].link {
                Link::Leaf(index) => return index,
                Link::Inner(second) => {
                    node = if trail >> depth & 1 == 1 { second as usize } else { node + 1 };
                    depth += 1;
                }
            }
        }
    }

    #[test]
    fn every_trail_leads_to_its_emitter_within_bounds() {
        for count in [1, 2, 3, 100, 20_000] {
            let emitters = emitters(count);
            let tree = LightTree::new(&emitters);
            assert_eq!(tree.nodes.len(), 2 * emitters.len() - 1);
            for (index, &trail) in tree.trails.iter().enumerate() {
                assert_eq!(follow(&tree, trail), index as u32);
            }
            let total: f32 = emitters.iter().map(|e| e.power).sum();
            assert!((tree.nodes[0].power - total).abs() < total * 1e-4);
        }
        assert_eq!(LightTree::new(&[]), LightTree::default());
    }

    #[test]
    fn a_refitted_tree_holds_moved_emitters() {
        let mut moved = emitters(500);
        let mut tree = LightTree::new(&moved);
        let before = tree.clone();
        tree.refit(&moved);
        for (node, was) in tree.nodes.iter().zip(&before.nodes) {
            assert_eq!((node.link, node.bounds), (was.link, was.bounds));
            assert!((node.power - was.power).abs() <= 1e-4 * was.power);
        }
        for (i, emitter) in moved.iter_mut().enumerate() {
            emitter.bounds = emitter.bounds.map(|p| p * 2.0 + Vec3::splat(i as f32));
            emitter.power *= 3.0;
        }
        tree.refit(&moved);
        let total: f32 = moved.iter().map(|e| e.power).sum();
        assert!((tree.nodes[0].power - total).abs() < total * 1e-4);
        for (index, &trail) in tree.trails.iter().enumerate() {
            let (mut node, mut depth) = (0, 0);
            loop {
                let Node { bounds, link, .. } = tree.nodes[node];
                let own = moved[index].bounds;
                assert!(bounds[0].cmple(own[0]).all() && bounds[1].cmpge(own[1]).all());
                match link {
                    Link::Leaf(found) => break assert_eq!(found, index as u32),
                    Link::Inner(second) => {
                        node = if trail >> depth & 1 == 1 { second as usize } else { node + 1 }
                    }
                }
                depth += 1;
            }
        }
    }

    #[test]
    fn emitters_at_one_place_are_told_apart() {
        let mut many = emitters(5000);
        many.iter_mut().for_each(|e| e.bounds = [Vec3::ONE; 2]);
        let tree = LightTree::new(&many);
        assert!(tree.trails.iter().enumerate().all(|(i, &trail)| follow(&tree, trail) == i as u32));
    }

    #[test]
    fn cones_hold_both() {
        let tilted = Vec3::new(0.0, 0.8, 0.6);
        let (axis, cosine) = union((Vec3::Y, 1.0), (tilted, 1.0));
        assert!((axis.dot(Vec3::Y) - cosine).abs() < 1e-5 && (axis.dot(tilted) - cosine).abs() < 1e-5);
        assert_eq!(union((Vec3::Y, 1.0), (Vec3::NEG_Y, 1.0)).1, -1.0);
        assert_eq!(union((Vec3::Y, -1.0), (tilted, 1.0)), (Vec3::Y, -1.0));
    }
}
