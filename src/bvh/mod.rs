//! The bounding volume hierarchy that the kernels walk: eight children a node.
//!
//! A binary tree is built by the surface area heuristic, improved, and collapsed to eight children a node;
//! triangles are laid out in the order of its leaves.

pub mod binary;
pub mod binary_tree;
mod build;
pub mod cache;
mod check;
mod choice;
pub mod compact;
mod forest;
mod improve;
pub mod instances;
pub mod part_tree;
pub mod parted;
mod refit;
pub mod wide;

pub use instances::Trees;
pub use parted::Parted;
pub use refit::Refit;
pub(crate) use refit::extent;
pub use wide::{WideBvh, WideNode};

/// What walks a tree: that decides how large leaves are, since it decides what testing their triangles costs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TreeFor {
    /// Vectors of eight lanes, which test all triangles of a leaf in the time of one.
    Packets,
    /// Lanes with a ray each, which test one triangle after the other.
    SingleRays,
}

/// Triangles in a leaf at most; what one vector of eight lanes tests at once.
pub const LEAF_TRIANGLES: usize = 8;

/// Levels of the wide tree at most: the kernels' stacks hold this many times seven entries and one.
///
/// The binary tree is at most 60 levels deep before it halves by count (28 more for the 2^28
/// triangles that leaves can count), and a wide level takes at least one binary level.
pub const MAX_DEPTH: u32 = 88;
