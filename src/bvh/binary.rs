//! A binary tree by the surface area heuristic, binned (Wald 2007), built top down in parallel.
//!
//! Top-down building bounds the depth whatever the input: where bins cannot separate a set (many
//! coincident triangles) or the tree has grown deep, the set is halved by count.

use glam::Vec3;
use obvhs::bvh2::node::Bvh2Node;

use super::binary_tree::{BinaryTree, Scale};

/// Bins along each axis.
const BINS: usize = 16;
/// Below this depth sets are halved by count, so that no tree gets deeper than this plus 28.
pub(super) const DEPTH_LIMIT: u32 = 60;
/// Sets smaller than this are built by one thread.
const PARALLEL_SET: usize = 4096;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub lower: Vec3,
    /// Upper corner.
    pub upper: Vec3,
}

impl Bounds {
    /// Holds nothing.
    pub const EMPTY: Bounds = Bounds { lower: Vec3::INFINITY, upper: Vec3::NEG_INFINITY };

    /// The box around both.
    pub fn union(self, other: Bounds) -> Bounds {
        Bounds { lower: self.lower.min(other.lower), upper: self.upper.max(other.upper) }
    }

    fn grow(&mut self, point: Vec3) {
        self.lower = self.lower.min(point);
        self.upper = self.upper.max(point);
    }

    /// Half the surface area, 0 for an empty box.
    ///
    /// In `f64`: the areas of scenes of 1e-30 or 1e30 metres do not fit `f32`.
    pub fn half_area(&self) -> f64 {
        if self.lower.x > self.upper.x {
            return 0.0;
        }
        let size = (self.upper - self.lower).as_dvec3();
        size.x * size.y + size.y * size.z + size.z * size.x
    }
}

/// A box with the index of its triangle.
#[derive(Clone, Copy, Debug)]
pub struct Primitive {
    /// Bounds of the triangle.
    pub bounds: Bounds,
    /// Its index in the mesh.
    pub triangle: u32,
}

impl Primitive {
    fn centroid(&self) -> Vec3 {
        // Halved first: the sum of two coordinates of 1e38 would overflow.
        self.bounds.lower * 0.5 + self.bounds.upper * 0.5
    }
}

/// Builds a tree; `primitives` is not empty and gets reordered. `placed` is told of primitives that have
/// found their place, a few thousand at a time.
pub fn build(primitives: &mut [Primitive], placed: &(dyn Fn(usize) + Sync)) -> BinaryTree {
    let scale = Scale::of(primitives);
    let mut nodes = vec![Bvh2Node::default(); 2 * primitives.len() - 1];
    let (root, below) = nodes.split_first_mut().expect("a set is not empty");
    *root = Builder { scale, placed }.build_set(primitives, 0, (below, 1), 0);
    BinaryTree { nodes, triangles: primitives.iter().map(|primitive| primitive.triangle).collect(), scale }
}

struct Builder<'a> {
    scale: Scale,
    placed: &'a (dyn Fn(usize) + Sync),
}

impl Builder<'_> {
    /// The node over a set, which begins at place `first` of all; its descendants take the nodes that are given, with
    /// the index of the first of them.
    fn build_set(
        &self,
        primitives: &mut [Primitive],
        first: usize,
        (below, index): (&mut [Bvh2Node], usize),
        depth: u32,
    ) -> Bvh2Node {
        if let [only] = primitives {
            return BinaryTree::leaf(self.scale.scaled(&only.bounds), first as u32);
        }
        let count = primitives.len();
        let middle = split(primitives, depth);
        let (left, right) = primitives.split_at_mut(middle);
        let (pair, below) = below.split_at_mut(2);
        let (below_left, below_right) = below.split_at_mut(2 * middle - 2);
        let nodes = [(below_left, index + 2), (below_right, index + 2 * middle)];
        let children = self.build_both([left, right], [first, first + middle], nodes, depth + 1);
        if depth == 0 && count < PARALLEL_SET {
            (self.placed)(count);
        }
        pair.copy_from_slice(&children);
        BinaryTree::parent(children, index as u32)
    }

    /// The nodes over two sets, by two threads where they are large.
    fn build_both(
        &self,
        [left, right]: [&mut [Primitive]; 2],
        first: [usize; 2],
        [below_left, below_right]: [(&mut [Bvh2Node], usize); 2],
        depth: u32,
    ) -> [Bvh2Node; 2] {
        if left.len() + right.len() < PARALLEL_SET {
            return [
                self.build_set(left, first[0], below_left, depth),
                self.build_set(right, first[1], below_right, depth),
            ];
        }
        // Parts of large sets that are themselves small are told of here.
        let part = |set: &mut [Primitive], first, below| {
            let len = set.len();
            let node = self.build_set(set, first, below, depth);
            if len < PARALLEL_SET {
                (self.placed)(len);
            }
            node
        };
        rayon::join(|| part(left, first[0], below_left), || part(right, first[1], below_right)).into()
    }
}

/// Reorders a set of at least two and returns where its second part begins.
fn split(primitives: &mut [Primitive], depth: u32) -> usize {
    let half = primitives.len() / 2;
    if primitives.len() == 2 || depth >= DEPTH_LIMIT {
        return half;
    }
    let mut centroids = Bounds::EMPTY;
    for primitive in primitives.iter() {
        centroids.grow(primitive.centroid());
    }
    let binning = Binning::new(centroids);
    match binning.best_plane(primitives) {
        Some((axis, bin)) => {
            let middle = partition(primitives, |p| binning.bin(p.centroid(), axis) < bin);
            if middle == 0 || middle == primitives.len() { half } else { middle }
        }
        None => half,
    }
}

fn partition(primitives: &mut [Primitive], is_left: impl Fn(&Primitive) -> bool) -> usize {
    let mut middle = 0;
    for index in 0..primitives.len() {
        if is_left(&primitives[index]) {
            primitives.swap(middle, index);
            middle += 1;
        }
    }
    middle
}

/// Maps centroids to bins.
struct Binning {
    origin: Vec3,
    scale: Vec3,
}

impl Binning {
    fn new(centroids: Bounds) -> Self {
        let size = centroids.upper - centroids.lower;
        // An axis without extent, or one so small or large that its inverse is not finite, gets no bins.
        let scale = Vec3::from_array(size.to_array().map(|s| {
            let scale = BINS as f32 * 0.999_999 / s;
            if scale.is_finite() { scale } else { 0.0 }
        }));
        Binning { origin: centroids.lower, scale }
    }

    fn bin(&self, centroid: Vec3, axis: usize) -> usize {
        (((centroid[axis] - self.origin[axis]) * self.scale[axis]) as usize).min(BINS - 1)
    }

    /// The axis and the first bin of the second part with the least cost; `None` if nothing separates.
    fn best_plane(&self, primitives: &[Primitive]) -> Option<(usize, usize)> {
        let mut bins = [[(Bounds::EMPTY, 0u32); BINS]; 3];
        for primitive in primitives {
            let centroid = primitive.centroid();
            for (axis, row) in bins.iter_mut().enumerate() {
                let bin = &mut row[self.bin(centroid, axis)];
                bin.0 = bin.0.union(primitive.bounds);
                bin.1 += 1;
            }
        }
        let mut best = None;
        let mut best_cost = f64::INFINITY;
        for (axis, row) in bins.iter().enumerate() {
            for (plane, cost) in plane_costs(row) {
                if cost < best_cost {
                    (best, best_cost) = (Some((axis, plane)), cost);
                }
            }
        }
        best
    }
}

/// Cost of splitting before each bin that leaves something on both sides.
fn plane_costs(row: &[(Bounds, u32); BINS]) -> impl Iterator<Item = (usize, f64)> {
    let mut right = [0.0; BINS];
    let (mut bounds, mut count) = (Bounds::EMPTY, 0);
    for plane in (1..BINS).rev() {
        bounds = bounds.union(row[plane].0);
        count += row[plane].1;
        right[plane] = if count == 0 { f64::INFINITY } else { bounds.half_area() * f64::from(count) };
    }
    let (mut bounds, mut count) = (Bounds::EMPTY, 0);
    (1..BINS).filter_map(move |plane| {
        bounds = bounds.union(row[plane - 1].0);
        count += row[plane - 1].1;
        (count > 0).then(|| (plane, bounds.half_area() * f64::from(count) + right[plane]))
    })
}
