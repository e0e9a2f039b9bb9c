//! A plain binary bounding volume hierarchy in `f64`: binned SAH, one box a node.

use glam::DVec3;

use super::intersect::Ray;

const BINS: usize = 16;
const LEAF_SIZE: usize = 4;

/// Rounding of a slab test is covered by widening its far end by 1 + 2 γ(3) (Ize 2013).
const FAR_SLACK: f64 = 1.0 + 8.0 * f64::EPSILON;

/// The hierarchy over a list of triangles; it keeps their order, not their corners.
#[derive(Debug)]
pub(super) struct Bvh {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Bounds,
    /// A leaf's first entry in `order`, or an inner node's first child (the second follows it).
    first: usize,
    /// Entries of a leaf; 0 for an inner node.
    count: usize,
}

#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: DVec3,
    high: DVec3,
}

impl Bounds {
    const EMPTY: Bounds = Bounds { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    fn of(points: &[DVec3]) -> Self {
        points.iter().fold(Bounds::EMPTY, |b, &p| b.union(Bounds { low: p, high: p }))
    }

    fn union(self, other: Bounds) -> Self {
        Bounds { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn half_area(self) -> f64 {
        let size = (self.high - self.low).max(DVec3::ZERO);
        size.x * size.y + size.y * size.z + size.z * size.x
    }

    /// Whether the ray meets the box at some t in [0, far].
    fn is_met(&self, ray: &Ray, inverse: DVec3, far: f64) -> bool {
        let (mut t_near, mut t_far) = (0.0f64, far);
        for axis in 0..3 {
            let (low, high) = (self.low[axis] - ray.origin[axis], self.high[axis] - ray.origin[axis]);
            if inverse[axis].is_finite() {
                let (a, b) = (low * inverse[axis], high * inverse[axis]);
                t_near = t_near.max(a.min(b));
                t_far = t_far.min(a.max(b) * FAR_SLACK);
            } else if low > 0.0 || high < 0.0 {
                return false;
            }
        }
        t_near <= t_far * FAR_SLACK
    }
}

impl Bvh {
    /// Builds over triangles given by their corners, all finite.
    pub(super) fn new(triangles: &[[DVec3; 3]]) -> Self {
        let boxes: Vec<Bounds> = triangles.iter().map(|corners| Bounds::of(corners)).collect();
        let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
        let mut nodes = vec![Node { bounds: bounds_of(&boxes, &order), first: 0, count: order.len() }];
        let mut open = vec![0];
        while let Some(index) = open.pop() {
            let Node { first, count, .. } = nodes[index];
            if count <= LEAF_SIZE {
                continue;
            }
            let range = &mut order[first..first + count];
            let left = split(&boxes, range);
            let (a, b) = range.split_at(left);
            let child = nodes.len();
            nodes.push(Node { bounds: bounds_of(&boxes, a), first, count: left });
            nodes.push(Node { bounds: bounds_of(&boxes, b), first: first + left, count: count - left });
            nodes[index].first = child;
            nodes[index].count = 0;
            open.extend([child, child + 1]);
        }
        Bvh { nodes, order }
    }

    /// Shows `visit` every triangle whose leaf the ray meets within `far`; what `visit` returns is the
    /// new `far`. A negative one ends the walk.
    pub(super) fn walk(&self, ray: &Ray, mut far: f64, mut visit: impl FnMut(u32, f64) -> f64) {
        let inverse = ray.direction.recip();
        let mut open = if self.order.is_empty() { vec![] } else { vec![0] };
        while let Some(index) = open.pop() {
            let node = &self.nodes[index];
            if !node.bounds.is_met(ray, inverse, far) {
                continue;
            }
            if node.count == 0 {
                open.extend(self.children_far_first(node.first, ray));
            }
            for &triangle in &self.order[node.first..node.first + node.count] {
                far = visit(triangle, far);
            }
        }
    }

    fn children_far_first(&self, child: usize, ray: &Ray) -> [usize; 2] {
        let centre = |i: usize| self.nodes[i].bounds.low + self.nodes[i].bounds.high;
        let first_is_nearer = ray.direction.dot(centre(child + 1) - centre(child)) >= 0.0;
        if first_is_nearer { [child + 1, child] } else { [child, child + 1] }
    }
}

fn bounds_of(boxes: &[Bounds], order: &[u32]) -> Bounds {
    order.iter().fold(Bounds::EMPTY, |all, &i| all.union(boxes[i as usize]))
}

/// Reorders `range` and returns how many of it go left: at least one, and not all.
fn split(boxes: &[Bounds], range: &mut [u32]) -> usize {
    let centre = |i: u32| (boxes[i as usize].low + boxes[i as usize].high) * 0.5;
    let spread =
        range.iter().fold(Bounds::EMPTY, |b, &i| b.union(Bounds { low: centre(i), high: centre(i) }));
    let size = spread.high - spread.low;
    let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
    if size[axis] <= 0.0 {
        return range.len() / 2;
    }
    let bin = |i: u32| {
        let place = (centre(i)[axis] - spread.low[axis]) / size[axis];
        ((place * BINS as f64) as usize).min(BINS - 1)
    };
    let mut bins = [(Bounds::EMPTY, 0usize); BINS];
    for &i in range.iter() {
        let slot = &mut bins[bin(i)];
        *slot = (slot.0.union(boxes[i as usize]), slot.1 + 1);
    }
    let border = cheapest_border(&bins);
    // The extreme centres lie in the first and the last bin, so neither side is empty.
    range.sort_unstable_by_key(|&i| bin(i) >= border);
    range.partition_point(|&i| bin(i) < border)
}

/// The first bin of the right side under the surface area heuristic.
fn cheapest_border(bins: &[(Bounds, usize); BINS]) -> usize {
    let side = |part: &[(Bounds, usize)]| {
        let (bounds, count) = part.iter().fold((Bounds::EMPTY, 0), |(b, n), bin| (b.union(bin.0), n + bin.1));
        bounds.half_area() * count as f64
    };
    let cost = |border: &usize| side(&bins[..*border]) + side(&bins[*border..]);
    (1..BINS).min_by(|a, b| cost(a).total_cmp(&cost(b))).unwrap_or(1)
}
