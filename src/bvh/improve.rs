//! What the obvhs crate does for the binary tree: cutting the boxes of long triangles, clustering from
//! below (PLOC; Meister and Bittner 2018), and moving subtrees to better places (Meister and Bittner 2018).
//!
//! Only which triangles belong together is taken from it: boxes are those of the primitives, and the depth
//! stays bounded. Areas are computed on coordinates of at most 1, which neither overflow nor vanish.

use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::splits::split_aabbs_preset;
use obvhs::triangle::Triangle;

use super::binary::{Bounds, Primitive};
use super::binary_tree::{BinaryTree, Scale};

/// Share of the nodes that one round of moving subtrees looks at.
const REINSERTED: f32 = 0.15;
/// By how much the boxes of cut triangles are widened, relative to the triangle's largest coordinate: many
/// times the rounding of where a plane cuts an edge.
const CUT_MARGIN: f32 = 1e-6;
/// Area of a box in units of the average one, from which on its triangle may be cut: the crate's own bound.
const LEAST_CUT: f32 = 3.0;

/// Replaces primitives of triangles that fill little of their box by several smaller boxes, which together
/// hold the whole triangle. `corners` are those of the primitives' triangles, in their order.
pub fn cut(primitives: &mut Vec<Primitive>, corners: impl Fn(u32) -> [Vec3; 3]) {
    let scale = Scale::of(primitives);
    let area = |primitive: &Primitive| scale.scaled(&primitive.bounds).half_area();
    let (mut largest, mut sum) = (0.0f32, 0.0);
    for area in primitives.iter().map(area) {
        (largest, sum) = (largest.max(area), sum + f64::from(area));
    }
    let average = (sum / primitives.len().max(1) as f64) as f32;
    // None with a smaller box is ever cut: they need no copy.
    let whole: Vec<usize> =
        (0..primitives.len()).filter(|&place| area(&primitives[place]) > average * LEAST_CUT).collect();
    let triangle = |&place: &usize| {
        let [v0, v1, v2] = corners(primitives[place].triangle).map(|corner| Vec3A::from(scale.point(corner)));
        Triangle { v0, v1, v2 }
    };
    let triangles: Vec<Triangle> = whole.iter().map(triangle).collect();
    let mut boxes: Vec<Aabb> = whole.iter().map(|&place| scale.scaled(&primitives[place].bounds)).collect();
    let mut owners: Vec<u32> = (0..whole.len() as u32).collect();
    split_aabbs_preset(&mut boxes, &mut owners, &triangles, average, largest);
    let mut is_cut = vec![false; whole.len()];
    owners[whole.len()..].iter().for_each(|&owner| is_cut[owner as usize] = true);
    for (piece, (scaled, &owner)) in boxes.iter().zip(&owners).enumerate() {
        if !is_cut[owner as usize] {
            continue;
        }
        let all = primitives[whole[owner as usize]];
        let full = bounds_of(&corners(all.triangle));
        let margin = full.lower.abs().max(full.upper.abs()) * CUT_MARGIN;
        let cut = scale.unscaled(scaled);
        let bounds = Bounds {
            lower: (cut.lower - margin).max(full.lower),
            upper: (cut.upper + margin).min(full.upper),
        };
        let made = Primitive { bounds, ..all };
        match whole.get(piece) {
            Some(&place) => primitives[place] = made,
            None => primitives.push(made),
        }
    }
}

/// The box around a triangle.
pub fn bounds_of([a, b, c]: &[Vec3; 3]) -> Bounds {
    Bounds { lower: a.min(*b).min(*c), upper: a.max(*b).max(*c) }
}

/// A tree that is clustered from below and improved; `primitives` is not empty.
pub fn clustered(primitives: &[Primitive]) -> BinaryTree {
    let scale = Scale::of(primitives);
    let boxes: Vec<Aabb> = primitives.iter().map(|p| scale.scaled(&p.bounds)).collect();
    let indices = (0..primitives.len() as u32).collect();
    let mut builder = PlocBuilder::with_capacity(boxes.len());
    let tree = builder.build(PlocSearchDistance::default(), &boxes, indices, SortPrecision::U64, 0);
    let triangles = tree.primitive_indices.iter().map(|&place| primitives[place as usize].triangle).collect();
    reinserted(BinaryTree { nodes: tree.nodes, triangles, scale })
}

/// The same tree with subtrees moved to where the surface area heuristic likes them better.
pub fn reinserted(tree: BinaryTree) -> BinaryTree {
    let mut moved = Bvh2 {
        nodes: tree.nodes,
        children_are_ordered_after_parents: true,
        // Pieces of one triangle may lie in several leaves.
        uses_spatial_splits: true,
        ..Bvh2::default()
    };
    ReinsertionOptimizer::default().run(&mut moved, REINSERTED, None);
    BinaryTree { nodes: moved.nodes, ..tree }
}
