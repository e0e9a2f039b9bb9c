//! What the obvhs crate does for the binary tree: cutting the boxes of long triangles, clustering from
//! below (PLOC; Meister and Bittner 2018), and moving subtrees to better places (Meister and Bittner 2018).
//!
//! Only which triangles belong together is taken from it: boxes are those of the primitives, and the depth
//! stays bounded. Areas are computed on coordinates of at most 1, which neither overflow nor vanish.

use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::splits::split_aabbs_preset;
use obvhs::triangle::Triangle;

use super::binary::{self, Bounds, Node, Primitive};

/// Share of the nodes that one round of moving subtrees looks at.
const REINSERTED: f32 = 0.15;
/// By how much the boxes of cut triangles are widened, relative to the triangle's largest coordinate: many
/// times the rounding of where a plane cuts an edge.
const CUT_MARGIN: f32 = 1e-6;

/// The power of two that makes every coordinate at most 1, as far as `f32` can say it.
fn scale_of(primitives: &[Primitive]) -> f32 {
    let largest = |b: &Bounds| b.lower.abs().max(b.upper.abs()).max_element();
    let reach = primitives.iter().map(|p| largest(&p.bounds)).fold(0.0, f32::max);
    if reach > 0.0 { (-reach.log2().ceil()).clamp(-126.0, 126.0).exp2() } else { 1.0 }
}

fn scaled(bounds: &Bounds, scale: f32) -> Aabb {
    Aabb { min: (bounds.lower * scale).into(), max: (bounds.upper * scale).into() }
}

/// Replaces primitives of triangles that fill little of their box by several smaller boxes, which together
/// hold the whole triangle. `corners` are those of the primitives' triangles, in their order.
pub fn cut(primitives: &mut Vec<Primitive>, corners: impl Fn(u32) -> [Vec3; 3]) {
    let scale = scale_of(primitives);
    let triangles: Vec<Triangle> = primitives
        .iter()
        .map(|p| {
            let [v0, v1, v2] = corners(p.triangle).map(|corner| Vec3A::from(corner * scale));
            Triangle { v0, v1, v2 }
        })
        .collect();
    let mut boxes: Vec<Aabb> = primitives.iter().map(|p| scaled(&p.bounds, scale)).collect();
    let mut owners: Vec<u32> = (0..primitives.len() as u32).collect();
    let largest = boxes.iter().map(Aabb::half_area).fold(0.0, f32::max);
    let average = boxes.iter().map(|b| f64::from(b.half_area())).sum::<f64>() / boxes.len().max(1) as f64;
    split_aabbs_preset(&mut boxes, &mut owners, &triangles, average as f32, largest);
    let whole = primitives.len();
    let mut is_cut = vec![false; whole];
    owners[whole..].iter().for_each(|&owner| is_cut[owner as usize] = true);
    for (place, (piece, &owner)) in boxes.iter().zip(&owners).enumerate() {
        if !is_cut[owner as usize] {
            continue;
        }
        let all = primitives[owner as usize];
        let full = bounds_of(&corners(all.triangle));
        let margin = full.lower.abs().max(full.upper.abs()) * CUT_MARGIN;
        let bounds = Bounds {
            lower: (Vec3::from(piece.min) / scale - margin).max(full.lower),
            upper: (Vec3::from(piece.max) / scale + margin).min(full.upper),
        };
        let piece = Primitive { bounds, ..all };
        if place < whole { primitives[place] = piece } else { primitives.push(piece) }
    }
}

/// The box around a triangle.
pub fn bounds_of([a, b, c]: &[Vec3; 3]) -> Bounds {
    Bounds { lower: a.min(*b).min(*c), upper: a.max(*b).max(*c) }
}

/// A tree that is clustered from below and improved; `primitives` is not empty.
pub fn clustered(primitives: &[Primitive]) -> Node {
    let scale = scale_of(primitives);
    let boxes: Vec<Aabb> = primitives.iter().map(|p| scaled(&p.bounds, scale)).collect();
    let indices = (0..primitives.len() as u32).collect();
    let mut builder = PlocBuilder::with_capacity(boxes.len());
    let mut tree = builder.build(PlocSearchDistance::default(), &boxes, indices, SortPrecision::U64, 0);
    improve(&mut tree);
    unpack(&tree, primitives, 0, 0)
}

/// The same tree with subtrees moved to where the surface area heuristic likes them better.
pub fn reinserted(root: Node) -> Node {
    let count = root.count() as usize;
    let mut primitives = Vec::with_capacity(count);
    let mut nodes = Vec::with_capacity(2 * count);
    nodes.push(Bvh2Node::default());
    let bounds = root.bounds();
    let largest = bounds.lower.abs().max(bounds.upper.abs()).max_element();
    let scale = scale_of(&[Primitive {
        bounds: Bounds { lower: Vec3::ZERO, upper: Vec3::splat(largest) },
        triangle: 0,
    }]);
    pack(root, 0, scale, &mut nodes, &mut primitives);
    let mut tree = Bvh2 {
        nodes,
        primitive_indices: (0..primitives.len() as u32).collect(),
        children_are_ordered_after_parents: true,
        ..Bvh2::default()
    };
    improve(&mut tree);
    unpack(&tree, &primitives, 0, 0)
}

fn improve(tree: &mut Bvh2) {
    // Pieces of one triangle may lie in several leaves.
    tree.uses_spatial_splits = true;
    ReinsertionOptimizer::default().run(tree, REINSERTED, None);
}

fn pack(node: Node, at: usize, scale: f32, nodes: &mut Vec<Bvh2Node>, primitives: &mut Vec<Primitive>) {
    let bounds = scaled(&node.bounds(), scale);
    match node {
        Node::Leaf(primitive) => {
            nodes[at] = Bvh2Node::new(bounds, 1, primitives.len() as u32);
            primitives.push(primitive);
        }
        Node::Inner { children, .. } => {
            let first = nodes.len();
            nodes.extend([Bvh2Node::default(); 2]);
            nodes[at] = Bvh2Node::new(bounds, 0, first as u32);
            let [left, right] = *children;
            pack(left, first, scale, nodes, primitives);
            pack(right, first + 1, scale, nodes, primitives);
        }
    }
}

/// Their tree as ours; what lies too deep is halved by count.
fn unpack(tree: &Bvh2, primitives: &[Primitive], at: usize, depth: u32) -> Node {
    let node = &tree.nodes[at];
    if node.prim_count == 1 {
        return Node::Leaf(primitives[tree.primitive_indices[node.first_index as usize] as usize]);
    }
    if node.prim_count > 1 || depth >= binary::DEPTH_LIMIT {
        return binary::halved(&mut gathered(tree, primitives, at), depth);
    }
    let first = node.first_index as usize;
    let deeper = |child| unpack(tree, primitives, child, depth + 1);
    // Near the root subtrees are large enough to be worth a thread.
    let children = if depth < 8 {
        rayon::join(|| deeper(first), || deeper(first + 1))
    } else {
        (deeper(first), deeper(first + 1))
    };
    Node::over([children.0, children.1])
}

/// All primitives below a node.
fn gathered(tree: &Bvh2, primitives: &[Primitive], at: usize) -> Vec<Primitive> {
    let (mut found, mut pending) = (Vec::new(), vec![at]);
    while let Some(at) = pending.pop() {
        let node = &tree.nodes[at];
        let first = node.first_index as usize;
        if node.prim_count == 0 {
            pending.extend([first, first + 1]);
        } else {
            let indices = &tree.primitive_indices[first..first + node.prim_count as usize];
            found.extend(indices.iter().map(|&index| primitives[index as usize]));
        }
    }
    found
}
