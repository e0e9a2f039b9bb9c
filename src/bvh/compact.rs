//! The same tree in nodes of 80 bytes, for devices with little memory or slow access to it.

use rayon::prelude::*;

use super::wide::{EMPTY, LEAF, PORTAL, leaf_range};
use crate::layout::{CompactNode, WideNode};

/// What stands for a node in [`CompactNode::kinds`].
const INNER: u8 = 9;

/// Every node in its compact form, at its own index. Boxes hold those of the wide nodes.
pub fn compact_nodes(nodes: &[WideNode]) -> Vec<CompactNode> {
    nodes.par_iter().map(compact).collect()
}

/// Builders number the nodes and the triangles below one node one after the other, in the order of its children.
fn compact(node: &WideNode) -> CompactNode {
    if let Some(instance) = node.instance() {
        return CompactNode { exponents: PORTAL, first_node: instance, ..CompactNode::default() };
    }
    let children = node.children.iter().filter(|&&child| child != EMPTY).count();
    let mut result = CompactNode::default();
    let mut kinds = [0u8; 8];
    let mut first_node = None;
    let mut first_triangle = None;
    for (kind, &child) in kinds.iter_mut().zip(&node.children[..children]) {
        if child & LEAF == 0 {
            first_node.get_or_insert(child);
            *kind = INNER;
        } else {
            let (first, count) = leaf_range(child);
            first_triangle.get_or_insert(first as u32);
            *kind = count as u8;
        }
    }
    (result.first_node, result.first_triangle) = (first_node.unwrap_or(0), first_triangle.unwrap_or(0));
    result.kinds = words(kinds);
    for axis in 0..3 {
        let (lower, upper) = (&node.lower[axis][..children], &node.upper[axis][..children]);
        let least = lower.iter().copied().fold(f32::INFINITY, f32::min);
        let most = upper.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        if children == 0 {
            continue;
        }
        let exponent = exponent_for(f64::from(most) - f64::from(least));
        let unit = f64::from(exponent as i32 - 127).exp2();
        // Differences of floats that far apart may round in double precision: outwards here.
        let units = |value: f32| (f64::from(value) - f64::from(least)) / unit;
        let mut bytes = [[0u8; 8]; 2];
        for child in 0..children {
            bytes[0][child] = (units(lower[child]) * (1.0 - 1e-15)).floor() as u8;
            bytes[1][child] = (units(upper[child]) * (1.0 + 1e-15)).ceil().min(255.0) as u8;
        }
        result.origin[axis] = least;
        result.exponents |= exponent << (8 * axis);
        result.lower[axis] = words(bytes[0]);
        result.upper[axis] = words(bytes[1]);
    }
    result
}

/// The least biased exponent of a unit of which 254 are at least `extent`: one byte is left for rounding.
fn exponent_for(extent: f64) -> u32 {
    let exponent = if extent > 0.0 { (extent / 254.0).log2().ceil() as i32 + 127 } else { 1 };
    exponent.clamp(1, 254) as u32
}

fn words(bytes: [u8; 8]) -> [u32; 2] {
    [0, 4].map(|at| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::WideBvh;
    use glam::Vec3;

    fn bytes(words: [u32; 2]) -> [u8; 8] {
        let [a, b] = words.map(u32::to_le_bytes);
        [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]
    }

    /// Every child is where the wide node says, in a box around its own that is hardly larger.
    fn check(tree: &WideBvh) {
        for (index, (wide, compact)) in tree.nodes.iter().zip(compact_nodes(&tree.nodes)).enumerate() {
            let (mut node, mut triangle) = (compact.first_node, compact.first_triangle);
            for (slot, kind) in bytes(compact.kinds).into_iter().enumerate() {
                let child = match kind {
                    0 => EMPTY,
                    INNER => node,
                    count => LEAF | (u32::from(count) - 1) << 28 | triangle,
                };
                node += u32::from(kind == INNER);
                triangle += if kind == INNER { 0 } else { u32::from(kind) };
                assert_eq!(child, wide.children[slot], "child {slot} of node {index}");
                for axis in (0..3).filter(|_| child != EMPTY) {
                    let unit = f64::from((compact.exponents >> (8 * axis) & 255) as i32 - 127).exp2();
                    let at =
                        |row: [u32; 2]| f64::from(compact.origin[axis]) + f64::from(bytes(row)[slot]) * unit;
                    let (low, high) = (at(compact.lower[axis]), at(compact.upper[axis]));
                    let (lower, upper) =
                        (f64::from(wide.lower[axis][slot]), f64::from(wide.upper[axis][slot]));
                    let close = 1.001 * unit;
                    assert!(low <= lower && lower - low <= close, "{low} {lower} {unit}");
                    assert!(high >= upper && high - upper <= close, "{high} {upper} {unit}");
                }
            }
        }
    }

    #[test]
    fn compact_nodes_say_the_same() {
        for scale in [1e-30f32, 1e-3, 1.0, 1e30] {
            let at = |i: usize| {
                Vec3::new((i * 37 % 101) as f32, (i * 53 % 89) as f32, (i * 71 % 97) as f32) * scale
            };
            let positions: Vec<Vec3> = (0..3000).map(|i| at(i) + at(i / 3)).collect();
            let triangles: Vec<[u32; 3]> = (0..1000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            let tree = WideBvh::build(&positions, &triangles);
            assert!(tree.nodes.len() > 20);
            check(&tree);
        }
        check(&WideBvh::build(&[], &[]));
        check(&WideBvh::build(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]]));
    }
}
