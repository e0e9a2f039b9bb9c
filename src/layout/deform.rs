//! What moving parts are made of, as the kernels see it that deform them.

use super::kernel_type::shared_structs;

shared_structs! {

/// A vertex at rest. One more follows the last, for where lists end.
pub struct RestVertex {
    /// In the units of its mesh, from the middle of its part on.
    pub position: [f32; 3],
    /// Its number in the scene's mesh.
    pub vertex: u32,
    /// Unit normal.
    pub normal: [f32; 3],
    /// The first of its influences.
    pub first_influence: u32,
    /// Unit tangent with the bitangent's sign, which is 0 where there is none.
    pub tangent: [f32; 4],
    /// The first thing that morph targets add to it.
    pub first_morph: u32,
}

/// How much a vertex follows a joint.
pub struct Influence {
    /// The joint.
    pub joint: u32,
    /// Its share; a vertex's sum to 1.
    pub share: f32,
}

/// What a morph target adds to a vertex at weight 1.
pub struct Morph {
    /// To the position.
    pub position: [f32; 3],
    /// Which weight it is.
    pub weight: u32,
    /// To the normal.
    pub normal: [f32; 3],
    /// To the tangent.
    pub tangent: [f32; 3],
}
}
