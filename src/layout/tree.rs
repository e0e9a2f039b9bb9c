//! Nodes of trees as kernels see them.

use super::kernel_type::shared_structs;

shared_structs! {

/// Eight children of a node: see `src/bvh/wide.rs`.
pub struct WideNode {
    /// Lower bounds: x of the eight children, then y, then z.
    pub lower: [[f32; 8]; 3],
    /// Upper bounds.
    pub upper: [[f32; 8]; 3],
    /// See [`super::EMPTY`] and [`super::LEAF`].
    pub children: [u32; 8],
}

/// The same in 80 bytes: boxes as bytes, children that lie one after the other (Ylitie et al. 2017).
pub struct CompactNode {
    /// Lower corner of all children.
    pub origin: [f32; 3],
    /// A byte's worth in metres along x, y and z, as a float's exponent each; x in the low byte.
    pub exponents: u32,
    /// The first child that is a node; the others follow it.
    pub first_node: u32,
    /// The first triangle of the first child that is a leaf; the others' follow.
    pub first_triangle: u32,
    /// A byte for each child: 0 where there is none, 1 to 8 a leaf with that many triangles, 9 a node.
    pub kinds: [u32; 2],
    /// Lower bounds above the origin: a byte for each child, along x, y and z.
    pub lower: [[u32; 2]; 3],
    /// Upper bounds.
    pub upper: [[u32; 2]; 3],
}
}
