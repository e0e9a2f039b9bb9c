//! Moving parts that the host brings to an instant, as devices take them.

use std::sync::OnceLock;

use crate::bvh::compact::compact_nodes;
use crate::layout;

/// What differs of parts that follow each other.
#[derive(Debug, Default)]
pub(super) struct PartsState {
    /// The tree's nodes from a place on.
    pub nodes: (usize, Vec<layout::WideNode>),
    pub compact: OnceLock<Vec<layout::CompactNode>>,
    /// Vertices in leaf order from a place on.
    pub leaves: (usize, Vec<f32>),
    /// Triangles in leaf order from a place on, where some part has another tree than at first.
    pub triangles: (usize, Vec<layout::Triangle>),
    /// Normals and tangents from a vertex on.
    pub normals: (usize, Vec<u32>),
    pub tangents: (usize, Vec<[f32; 4]>),
}

impl PartsState {
    /// The compact forms of its nodes, made for the first device that asks.
    pub fn compact(&self) -> &[layout::CompactNode] {
        self.compact.get_or_init(|| compact_nodes(&self.nodes.1))
    }
}
