//! From a primitive's mode and indices to triangles, counter-clockwise from the front.

use super::Outcome;
use super::accessor::{Accessor, Component};

/// What a primitive's mode draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Points and lines, which a ray cannot hit.
    Thin,
    /// Three vertices each.
    Triangles,
    /// Each triangle shares an edge with the one before.
    Strip,
    /// All triangles share the first vertex.
    Fan,
}

impl Mode {
    /// From the file's number (glTF 2.0, `primitive.mode`).
    pub fn new(code: usize) -> Option<Self> {
        match code {
            0..=3 => Some(Mode::Thin),
            4 => Some(Mode::Triangles),
            5 => Some(Mode::Strip),
            6 => Some(Mode::Fan),
            _ => None,
        }
    }

    /// Number of triangles that so many indices make.
    pub fn triangles(self, indices: usize) -> usize {
        match self {
            Mode::Thin => 0,
            Mode::Triangles => indices / 3,
            Mode::Strip | Mode::Fan => indices.saturating_sub(2),
        }
    }

    /// Positions in the list of indices of a triangle's corners (glTF 2.0, 3.7.2.1).
    fn corners(self, triangle: usize) -> [usize; 3] {
        let i = triangle;
        match self {
            Mode::Thin | Mode::Triangles => [3 * i, 3 * i + 1, 3 * i + 2],
            Mode::Strip => [i, i + 1 + i % 2, i + 2 - i % 2],
            Mode::Fan => [i + 1, i + 2, 0],
        }
    }
}

/// The triangles of a primitive with `vertices` vertices. Those of strips that only stitch it
/// together, with a vertex twice, are left out.
pub fn triangulate(
    mode: Mode,
    indices: Option<&Accessor<'_>>,
    vertices: usize,
    what: &str,
) -> Outcome<Vec<[u32; 3]>> {
    let Some(indices) = indices else {
        return Ok((0..mode.triangles(vertices)).map(|t| mode.corners(t).map(|i| i as u32)).collect());
    };
    let restart = indices.component.restart();
    let list: Vec<u32> = (0..indices.count).map(|i| indices.get_indices::<1>(i)[0]).collect();
    if let Some(&bad) = list.iter().find(|&&index| index as usize >= vertices || index == restart) {
        return Err(match bad == restart {
            true => format!(
                "{what} has the primitive restart index {bad}, which glTF forbids; export the scene again"
            ),
            false => {
                format!("{what} refers to vertex {bad}, but has only {vertices}; export the scene again")
            }
        });
    }
    let triangles = (0..mode.triangles(list.len())).map(|t| mode.corners(t).map(|i| list[i]));
    let stitch = |t: &[u32; 3]| t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
    Ok(triangles.filter(|t| mode != Mode::Strip || !stitch(t)).collect())
}

/// What an index accessor must be.
pub const INDEX_TYPES: [Component; 3] = [Component::U8, Component::U16, Component::U32];
